"""Enumerations with text values."""

from __future__ import annotations

from enum import Enum


class TextEnum(str, Enum):
    """Members are strings and print as their values, in messages, files and JSON."""

    __str__ = str.__str__
