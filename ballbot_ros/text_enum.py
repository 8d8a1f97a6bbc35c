"""Enumerations whose members are words."""

from __future__ import annotations

from enum import Enum


class TextEnum(str, Enum):
    """Members are texts, and print as such: in messages, files and JSON the value is enough."""

    __str__ = str.__str__
