"""Property-based tests with the same examples in every run, without time limits."""

from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot_ros.errors import BallbotError

__all__ = ['given', 'is_read_or_refused_in_one_line', 'refusal', 'settings', 'yaml_texts']

settings.register_profile('laws', derandomize=True, max_examples=60, deadline=None, database=None)
settings.load_profile('laws')

SIGNS = [
    '\n',
    '\n  ',
    '- ',
    '? ',
    ': ',
    '&a ',
    '*a',
    '<<: ',
    '!!int ',
    '---\n',
    *'[]{},"\'|>#%\t\0',
]
VALUES = ['1', '-1', '1e999', '0x_', '.nan', '-.inf', 'null', 'true', '2024-99-99']
"""Fragments of YAML."""


def yaml_texts(*words):
    """Return a strategy of texts that are often nearly YAML, with these words in it."""
    nearly = st.lists(st.sampled_from((*words, *SIGNS, *VALUES)), max_size=30).map(''.join)
    return nearly | st.text(max_size=60)


def is_read_or_refused_in_one_line(read, *arguments):
    """Return whether reading gave no error, or one of our own with a text of one line."""
    try:
        read(*arguments)
    except BallbotError as error:
        return '\n' not in str(error)
    return True


def refusal(error, function, *arguments):
    """Return the text of the error that a call must raise, which must be one line."""
    text = None
    try:
        function(*arguments)
    except error as refused:
        text = str(refused)
    assert text is not None, f'{function} accepts {arguments}'
    assert '\n' not in text, arguments
    return text
