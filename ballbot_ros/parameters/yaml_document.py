"""YAML files with line numbers, for errors that name file and line."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Hashable
from pathlib import Path

import yaml

from ballbot_ros.errors import BallbotError
from ballbot_ros.files import read_text, shipped_file

_INT, _FLOAT = 'tag:yaml.org,2002:int', 'tag:yaml.org,2002:float'
_COLLECTIONS = ('tag:yaml.org,2002:seq', 'tag:yaml.org,2002:map')
_INTEGER_BITS = 64
MAX_TEXT = 2**18
"""Longest text of a document [byte]; parsing takes up to 400 times as much memory."""


def is_yaml_path(reference: str) -> bool:
    """Return whether something is given by the path of a YAML file instead of its name."""
    return '/' in reference or reference.endswith(('.yaml', '.yml'))


class YamlError(BallbotError):
    """A file that can't be read or is not YAML."""


class _Loader(yaml.SafeLoader):
    """YAML loader that refuses aliases, as ROS does: a few lines of them could fill any memory.

    Numbers follow YAML 1.2: 1e3 is a number, 1:30 is text (not base 60), 0777 is decimal.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(
                problem='aliases are not allowed', problem_mark=event.start_mark
            )
        return super().compose_node(parent, index)


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in (_INT, _FLOAT)]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(_INT, re.compile(r'[-+]?[0-9]+$'), list('-+0123456789'))
_FLOATS = (
    _FLOAT,
    re.compile(
        r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$'
    ),
    list('-+0123456789.'),
)
_Loader.add_implicit_resolver(*_FLOATS)
_Loader.add_constructor(_INT, lambda loader, node: int(loader.construct_scalar(node)))  # type: ignore[arg-type]


class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Writes as libyaml does, which takes a tenth of the time, and without aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True


# A text that the loader would read as a number, such as 1e23, has quotes.
_Dumper.add_implicit_resolver(*_FLOATS)


def yaml_text(data: object, *, has_inner_lines: bool = True) -> str:
    """Return data as YAML; yaml.YAMLError if a value is no number, text, list or mapping.

    With inner lines, each element of the innermost lists has a line of its own.
    """
    style = False if has_inner_lines else None
    text: str = yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=style
    )
    return text


def parse_value(text: str) -> object:
    """Return the value that `text` has in a YAML file, or `text` itself if it is not valid YAML."""
    return _parse(text, text)


def parse_data(text: bytes | str) -> object:
    """Return the content of a YAML text from anyone; None if it is not valid or too long."""
    return _parse(text, None) if len(text) <= MAX_TEXT else None


def _parse(text: bytes | str, otherwise: object) -> object:
    try:
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, AttributeError, LookupError, TypeError, ValueError, RecursionError):
        return otherwise


class YamlDocument:
    """A YAML file's content and the line of every part of it.

    `data` has plain dicts, lists, text and numbers. It raises YamlError, which names file and line,
    if the file can't be read, is not YAML, or has a duplicate key.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._lines: dict[tuple[Hashable, ...], int] = {}
        loader: yaml.SafeLoader | None = None
        try:
            if self.path.stat().st_size > MAX_TEXT:
                raise YamlError(f'{path}: more than {MAX_TEXT} bytes')
            loader = _Loader(read_text(self.path))
            root = loader.get_single_node()
            self.data = None if root is None else self._convert(loader, root, ())
        except OSError as error:
            raise YamlError(f'{path}: {error.strerror}') from None
        except UnicodeDecodeError as error:
            raise YamlError(f'{path}: not UTF-8 text ({error.reason})') from None
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = '' if mark is None else f':{mark.line + 1}'
            raise YamlError(f'{path}{line}: not YAML: {error.problem}') from None
        except RecursionError:
            raise YamlError(f'{path}: nested too deeply') from None
        except yaml.YAMLError as error:
            text = ' '.join(str(error).split())
            raise YamlError(f'{path}: not YAML: {text}') from None
        finally:
            if loader is not None:
                loader.dispose()

    @classmethod
    def named(
        cls, reference: str, folder: str, what: str, kind: type[BallbotError]
    ) -> YamlDocument:
        """Read a shipped file by its name, see `shipped_file`, or the user's own by its path."""
        is_path = is_yaml_path(reference)
        return cls(Path(reference) if is_path else shipped_file(reference, folder, what, kind))

    def where(self, *keys: Hashable) -> str:
        """Return 'file:line' of the part under `keys`, or of its nearest known parent."""
        for length in range(len(keys), -1, -1):
            line = self._lines.get(keys[:length])
            if line is not None:
                return f'{self.path}:{line}'
        return str(self.path)

    def _convert(
        self, loader: yaml.SafeLoader, node: yaml.Node, keys: tuple[Hashable, ...]
    ) -> object:
        self._lines.setdefault(keys, node.start_mark.line + 1)
        if isinstance(node, yaml.CollectionNode) and node.tag not in _COLLECTIONS:
            raise self._error(node, f'unknown tag {node.tag!r}')
        if isinstance(node, yaml.SequenceNode):
            return [
                self._convert(loader, item, (*keys, index)) for index, item in enumerate(node.value)
            ]
        if isinstance(node, yaml.MappingNode):
            mapping: dict[Hashable, object] = {}
            for key_node, value_node in node.value:
                line = key_node.start_mark.line + 1
                if not isinstance(key_node, yaml.ScalarNode):
                    raise YamlError(f'{self.path}:{line}: a key must be plain text')
                key = self._scalar(loader, key_node)
                if key in mapping:
                    raise YamlError(f'{self.path}:{line}: duplicate key {key!r}')
                self._lines[(*keys, key)] = line
                mapping[key] = self._convert(loader, value_node, (*keys, key))
            return mapping
        return self._scalar(loader, node)

    def _scalar(self, loader: yaml.SafeLoader, node: yaml.Node) -> object:
        try:
            value = loader.construct_object(node)
        except (AttributeError, LookupError, ValueError):
            value = []
        if isinstance(value, dict | list | set):
            kind = node.tag.rpartition(':')[2]
            raise self._error(node, f'{reprlib.repr(node.value)} is not a valid {kind}')
        if isinstance(value, int) and value.bit_length() > _INTEGER_BITS:
            raise self._error(node, f'{reprlib.repr(node.value)} is too large')
        return value

    def _error(self, node: yaml.Node, text: str) -> YamlError:
        return YamlError(f'{self.path}:{node.start_mark.line + 1}: {text}')
