"""YAML with line numbers."""

import math

import laws
import pytest
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line, yaml_texts

from ballbot_ros.parameters.yaml_document import YamlDocument, YamlError, parse_value, yaml_text

texts = yaml_texts(
    'a', 'b: ', '!!map ', '!!float ', '!!bool ', '!!timestamp ', '...\n', '12:60', 'yes', '\x85',
    '\ufeff', 'é', '=',
)  # fmt: skip


@pytest.fixture(scope='module')
def read(tmp_path_factory):
    """Read a document of the given text or bytes."""
    path = tmp_path_factory.mktemp('yaml') / 'file.yaml'

    def read_content(content):
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return YamlDocument(path)

    return read_content


def refusal(read, content):
    """Return the error without the file's name; it must be one line."""
    line = laws.refusal(YamlError, read, content)
    assert 'file.yaml:' in line
    return line.split('file.yaml:')[1]


def test_a_document_is_plain_data(read):
    document = read('a: 1\nb: [x, 2.5, true, null]\nc: {d: "e"}\n')
    assert document.data == {'a': 1, 'b': ['x', 2.5, True, None], 'c': {'d': 'e'}}


@pytest.mark.parametrize('content', ['', '# nothing\n', '---\n'])
def test_an_empty_document_is_none(read, content):
    assert read(content).data is None


def test_every_part_knows_its_line(read):
    document = read('# comment\na: 1\nb:\n  - x\n  - y\nc:\n  d:\n    e: 2\n')
    lines = {('a',): 2, ('b',): 3, ('b', 0): 4, ('b', 1): 5, ('c', 'd'): 7, ('c', 'd', 'e'): 8}
    for keys, line in lines.items():
        assert document.where(*keys) == f'{document.path}:{line}'


def test_a_missing_part_has_the_line_of_its_parent(read):
    document = read('a: 1\nc:\n  d: 2\n')
    assert document.where('c', 'x', 'y') == f'{document.path}:2'
    assert document.where('x') == f'{document.path}:1'
    assert read('').where('x') == str(document.path)


@pytest.mark.parametrize(
    ('content', 'line'),
    [
        ('a: 1\nb: [1, 2\n', 3),
        ('a: 1\n  b: 2\n', 2),
        ('a: 1\n\tb: 2\n', 2),
        ('a: "open\n', 2),
        ('a: 1\nb: *unknown\n', 2),
        ('a: 1\n--- \nb: 2\n', 2),
        ('a: 1\nb: !mine x\n', 2),
        ('a: 1\nb: !!python/name:os.getcwd x\n', 2),
    ],
)
def test_malformed_text_is_refused_with_its_line(read, content, line):
    assert refusal(read, content).startswith(f'{line}: not YAML: ')


@pytest.mark.parametrize(
    ('content', 'line', 'told'),
    [
        ('a: 1\nb: 2\na: 3\n', 3, "duplicate key 'a'"),
        ('a:\n  b: 1\n  b: 1\n', 3, "duplicate key 'b'"),
        ('1: x\n1: y\n', 2, 'duplicate key 1'),
        ('a: 1\n? [b]\n: 2\n', 2, 'a key must be plain text'),
        ('{a: 1}: 2\n', 1, 'a key must be plain text'),
    ],
)
def test_keys_are_plain_and_unique(read, content, line, told):
    assert refusal(read, content) == f'{line}: {told}'


@pytest.mark.parametrize('content', [b'a: \xff\n', b'\xfe\xff\x00a'])
def test_text_that_is_not_utf_8_is_refused(read, content):
    assert 'not UTF-8' in refusal(read, content)


def test_control_characters_are_refused(read):
    assert 'not YAML' in refusal(read, 'a: \0\n')


@pytest.mark.parametrize(
    'content',
    [
        'a: 1\nb: 2024-13-45\n',
        'a: 1\nb: 2024-01-01T99:00:00Z\n',
        'a: 1\nb: !!int x\n',
        'a: 1\nb: !!float x\n',
        'a: 1\nb: !!bool x\n',
        'a: 1\nb: !!timestamp x\n',
        f'a: 1\nb: {"1" * 5000}\n',
        'a: 1\nb: !mine {c: 2}\n',
        'a: 1\n? !!map b\n: 2\n',
    ],
    ids=lambda content: content[5:30],
)
def test_a_value_that_does_not_fit_its_type_is_refused_with_its_line(read, content):
    assert refusal(read, content).startswith('2: ')


@pytest.mark.parametrize(
    'content', ['[' * 3000, '{a: ' * 3000, 'a: &x [*x]\n', 'a: &x {b: *x}\n'], ids=range(4)
)
def test_a_document_without_end_is_refused(read, content):
    refusal(read, content)


@pytest.mark.parametrize('name', ['missing.yaml', '.', 'x' * 300 + '.yaml'])
def test_a_file_that_can_not_be_read_is_refused_by_its_name(tmp_path, name):
    text = laws.refusal(YamlError, YamlDocument, tmp_path / name)
    assert text.startswith(f'{tmp_path / name}: ')


@given(texts)
def test_any_text_is_read_or_refused_in_one_line(read, text):
    assert is_read_or_refused_in_one_line(read, text.encode(errors='replace'))


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused_in_one_line(read, data):
    assert is_read_or_refused_in_one_line(read, data)


NUMBERS = [
    ('1e3', 1000.0), ('-1E-2', -0.01), ('1.5e+06', 1.5e6), ('.5', 0.5), ('5.', 5.0),
    ('010', 10),
    ('1:30', '1:30'), ('1_000', '1_000'), ('0x10', '0x10'), ('-.inf', -math.inf), ('', None),
    ('[1, 2.0]', [1, 2.0]), ('true', True), ('a: [', 'a: ['), ('2024-99-99', '2024-99-99'),
]  # fmt: skip


def test_numbers_are_those_of_yaml_1_2():
    for text, value in NUMBERS:
        assert parse_value(text) == value, text
        assert type(parse_value(text)) is type(value), text


@given(st.one_of(st.from_regex(r'[-+]?[0-9]{1,4}[eE][-+]?[0-9]{1,4}', fullmatch=True), st.floats()))
def test_a_text_that_looks_like_a_number_stays_a_text(value):
    read = parse_value(yaml_text([value]))
    assert repr(read) == repr([value])
