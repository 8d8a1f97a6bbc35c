"""The language of properties, such as ``after each push: always for 3 s: abs(pitch_x_deg) < 5``.

A property is any number of scopes, each followed by a colon, and a formula. The operators bind the
stronger, the later they are in `_OPERATORS`; those of time end in a colon, after which all belongs
to them up to the next closing parenthesis. Names of signals are those of an export.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from ballbot_ros.engine.scenario.formulas import (
    FUNCTIONS,
    Always,
    Both,
    Comparison,
    Formula,
    Until,
    Value,
    either,
    eventually,
    negation,
)
from ballbot_ros.engine.scenario.metrics import UNITS
from ballbot_ros.engine.scenario.properties import (
    CLEARANCE,
    DRIVE_MODES,
    EVENTS,
    Property,
    Scope,
    first_tick,
    last_tick,
)
from ballbot_ros.errors import ScenarioError, did_you_mean

_OF_PLANES = {
    'm': 'position estimated_position reference_position',
    'm_per_s': 'speed reference_speed commanded_speed',
    'deg': 'pitch encoder estimated_pitch',
    'deg_per_s': 'pitch_rate motor_rate gyro estimated_gyro_offset',
    'percent': 'duty stick',
    'n_m': 'motor_torque',
}
SIGNAL_UNITS: Mapping[str, str] = {
    f'{name}_{plane}_{unit}': unit
    for unit, names in _OF_PLANES.items()
    for name in names.split()
    for plane in 'xy'
} | {'distance_m': 'm', 'battery_v': 'v', CLEARANCE: 'm'}
"""The signals, which are the columns of an export and the clearance, and their units."""

_TOKEN = re.compile(r'\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+|[A-Za-z_]\w*|<=|>=|[-+*/<>():])')
_MOST_TOKENS = 300
_END = 'the end'
_COMPARISONS = '<', '<=', '>', '>='
_OPERATORS = ('implies',), ('until',), ('or',), ('and',), _COMPARISONS, ('+', '-'), ('*', '/')
_DURATIONS = {'always': 'for', 'eventually': 'within', 'until': 'within'}
_UNITS = tuple(dict.fromkeys(SIGNAL_UNITS.values()))


class _Operand(NamedTuple):
    """A part of a property.

    Its unit has the exponents of base units; that of a bare number is None: it takes any.
    """

    node: Value | Formula
    unit: Mapping[str, int] | None
    horizon: float = 0.0

    def formula(self, word: str) -> Formula:
        """Return the formula that `word` needs."""
        if not isinstance(self.node, Formula):
            raise ScenarioError(f'{word} needs comparisons, such as `pitch_x_deg < 5`, not a value')
        return self.node


def parse_property(name: str, text: str) -> Property:
    """Read a property; ScenarioError says on one line what is wrong, and what is expected."""
    parser = _Parser(text)
    try:
        scopes, whole = parser.scopes(), parser.whole()
    except RecursionError:
        raise ScenarioError('nested too deeply') from None
    formula, unit = whole.formula('a property'), _unit_text(whole.unit or {})
    return Property(name, text, scopes, formula, whole.horizon, unit, tuple(parser.signals))


class _Parser:
    """Reads the tokens of a text from left to right; `signals` are those that it has read."""

    def __init__(self, text: str) -> None:
        self.signals: dict[str, None] = {}
        self._tokens: list[tuple[str, int]] = []
        self._at = at = 0
        while rest := text[at:].strip():
            if not (found := _TOKEN.match(text, at)):
                at = text.index(rest, at) + 1
                raise ScenarioError(f'{rest[0]!r} (character {at}) has no meaning')
            self._tokens.append((found[1], found.start(1) + 1))
            at = found.end()
        if len(self._tokens) > _MOST_TOKENS:
            raise ScenarioError(f'has more than {_MOST_TOKENS} words and signs')
        self._tokens.append((_END, 0))

    @property
    def _next(self) -> str:
        return self._tokens[self._at][0]

    def _take(self, *words: str) -> str:
        """Return the next token and go on if it is one of some, or else ''."""
        token = self._next
        self._at += token in words
        return token if token in words else ''

    def _expect(self, *words: str, after: str = '') -> str:
        return self._take(*words) or self._fail(' or '.join(map(repr, words)) + after)

    def _fail(self, expected: str) -> str:
        token, character = self._tokens[self._at]
        found = f'{token!r} (character {character})' if character else token
        raise ScenarioError(f'expected {expected}, not {found}')

    def _number(self, expected: str = 'a number') -> float:
        if not (self._next[0].isdigit() or self._next[0] == '.'):
            self._fail(expected)
        self._at += 1
        return float(self._tokens[self._at - 1][0])

    def scopes(self) -> tuple[Scope, ...]:
        """Read the scopes at the beginning."""
        found: list[Scope] = []
        while word := self._take('after', 'until', 'while', 'from'):
            if word == 'while':
                found.append(Scope(word, self._expect(*DRIVE_MODES)))
            elif word == 'from':
                start = self._number()
                end = math.inf if self._take('s') else self._end_after(start)
                found.append(Scope(word, start=start, end=end))
            else:
                found.append(Scope(word, *self._event(word)))
            self._expect(':')
        return tuple(found)

    def _event(self, word: str) -> tuple[str, int]:
        """Read which events are meant: their kind, and the number of one."""
        articles = ('each', 'the') if word == 'after' else ('the',)
        article = self._expect(*articles, *EVENTS)
        if article in articles:
            if article == 'the':
                self._expect('first')
            return self._expect(*EVENTS), int(article == 'the')
        number = self._next
        if not number.isdecimal() or int(number) < 1:
            self._fail(f'the number of the {article}, from 1')
        self._at += 1
        return article, int(number)

    def _end_after(self, start: float) -> float:
        """Read the rest of ``from A to B s``."""
        self._expect('to')
        end = self._number()
        self._expect('s')
        if end < start:
            raise ScenarioError(f'time goes back from {start:g} to {end:g} s')
        return end

    def _window(self, word: str) -> tuple[int, float]:
        """Read the window of an operator of time, and its colon; return its ticks."""
        given = self._expect(_DURATIONS[word], 'from', ':', after=f' after {word!r}')
        if given == ':':
            return 0, math.inf
        start = self._number() if given == 'from' else 0.0
        end = self._end_after(start) if given == 'from' else self._number()
        if given != 'from':
            self._expect('s')
        self._expect(':')
        if first_tick(start) > last_tick(end):
            raise ScenarioError(f'no tick of 4 ms is within {start:g} … {end:g} s')
        return first_tick(start), last_tick(end)

    def whole(self) -> _Operand:
        """Read a formula up to the end."""
        found = self._operand()
        if self._next != _END:
            self._fail(f'an operator, a unit ({", ".join(_UNITS)}) or {_END}')
        return found

    def _operand(self, level: int = 0) -> _Operand:
        """Read operands that are joined by operators of some level, or that bind stronger."""
        if level == len(_OPERATORS):
            return self._factor()
        if _OPERATORS[level] is _COMPARISONS and (word := self._take('not', *_DURATIONS)):
            return self._of_one(word, level)
        left = self._operand(level + 1)
        while word := self._take(*_OPERATORS[level]):
            if word == 'until':
                start, end = self._window(word)
                left = _until(left, self._operand(), start, end)
            else:
                left = _joined(word, left, self._operand(level + (word != 'implies')))
        return left

    def _of_one(self, word: str, level: int) -> _Operand:
        if word == 'not':
            operand = self._operand(level)
            return operand._replace(node=negation(operand.formula(word)))
        start, end = self._window(word)
        operand = self._operand()
        make = Always if word == 'always' else eventually
        return _Operand(
            make(start, end, operand.formula(word)), operand.unit, operand.horizon + end
        )

    def _factor(self) -> _Operand:
        if self._take('-'):
            return _joined('-', _Operand(Value(0.0), None), self._factor())
        if self._take('('):
            inner = self._operand()
            self._expect(')')
            return inner
        if self._take('abs'):
            self._expect('(')
            inner = self._operand()
            self._expect(')')
            return _joined('abs', inner)
        name = self._next
        if self._take(*SIGNAL_UNITS):
            self.signals[name] = None
            return _Operand(Value(name), {SIGNAL_UNITS[name]: 1})
        if '_' in name:
            hint = did_you_mean(name, SIGNAL_UNITS) or f'; known: {", ".join(SIGNAL_UNITS)}'
            raise ScenarioError(f'unknown signal {name!r}{hint}')
        number = Value(self._number('a signal or a number'))
        unit = self._take(*_UNITS)
        return _Operand(number, {unit: 1} if unit else None)


def _until(before: _Operand, then: _Operand, start: int, end: float) -> _Operand:
    held = before.formula('until')
    until: Formula = Until(end - start, held, then.formula('until'))
    if start:  # what comes before the window is always, and the rest later
        until = Both(Always(0, start - 1, held), eventually(start, start, until))
    horizon = end + max(before.horizon, then.horizon)
    return _Operand(until, _same('until', before, then), horizon)


def _same(word: str, *operands: _Operand) -> Mapping[str, int] | None:
    """Return the common unit of operands, which must be the same."""
    units = [each.unit for each in operands if each.unit is not None]
    if all(each == units[0] for each in units):
        return units[0] if units else None
    texts = ' and '.join(_unit_text(each) or 'a pure number' for each in units)
    is_of_formulas = isinstance(operands[0].node, Formula)
    hint = ': divide each side by its bound, as in `abs(pitch_x_deg) / 5 deg < 1`'
    raise ScenarioError(f'{word!r} joins different units, {texts}{hint * is_of_formulas}')


def _joined(word: str, *operands: _Operand) -> _Operand:
    """Return what an operator or a function makes of one or two operands."""
    if word in ('and', 'or', 'implies'):
        left, right = (each.formula(word) for each in operands)
        node = Both(left, right) if word == 'and' else either(left, right)
        if word == 'implies':
            node = either(negation(left), right)
        return _Operand(node, _same(word, *operands), max(each.horizon for each in operands))
    nodes = [each.node for each in operands if isinstance(each.node, Value)]
    if len(nodes) < len(operands):
        raise ScenarioError(f'{word!r} needs values, not comparisons')
    numbers = [each.of for each in nodes if isinstance(each.of, float)]
    are_numbers = len(numbers) == len(nodes)
    if word in _COMPARISONS:
        if are_numbers:
            raise ScenarioError(f'{word!r} compares numbers only, no signal')
        larger, smaller = nodes if '>' in word else nodes[::-1]
        return _Operand(Comparison(larger, smaller), _same(word, *operands))
    if word == '/' and nodes[1].of == 0.0:
        raise ScenarioError('divides by 0')
    has_units = any(each.unit is not None for each in operands)
    unit = _product(word, *operands) if has_units and word in '*/' else _same(word, *operands)
    function = FUNCTIONS[word]
    value = Value(function(*numbers)) if are_numbers else Value(function, tuple(nodes))
    return _Operand(value, unit)


def _product(word: str, left: _Operand, right: _Operand) -> Mapping[str, int]:
    exponents = Counter(left.unit or {})
    for name, exponent in (right.unit or {}).items():
        exponents[name] += exponent if word == '*' else -exponent
    return {name: exponent for name, exponent in exponents.items() if exponent}


def _unit_text(unit: Mapping[str, int]) -> str:
    """Return a unit as text, such as m/s."""
    return '·'.join(
        UNITS.get(name, 'N·m') + (f'^{exponent}' if exponent != 1 else '')
        for name, exponent in unit.items()
    )
