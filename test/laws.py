"""Property-based tests that draw the same examples in every run, however slow the machine."""

from hypothesis import given, settings

__all__ = ['given']

settings.register_profile('laws', derandomize=True, max_examples=60, deadline=None, database=None)
settings.load_profile('laws')
