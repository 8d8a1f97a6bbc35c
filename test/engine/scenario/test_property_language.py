"""The language of properties: how it is read, and what it says about mistakes."""

import pytest

from ballbot_ros.analysis.signals import SIGNALS
from ballbot_ros.engine.scenario.property_language import SIGNAL_UNITS, parse_property
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.errors import ScenarioError

UNITS = 'm, m_per_s, deg, deg_per_s, percent, n_m, v'
DIVIDE = 'divide each side by its bound, as in `abs(pitch_x_deg) / 5 deg < 1`'


def same(one, other):
    first, second = parse_property('', one), parse_property('', other)
    return (first.formula, first.scopes) == (second.formula, second.scopes)


def test_the_signals_are_the_columns_of_an_export():
    columns = {column: signal.unit for signal in SIGNALS for column in signal.columns}
    assert {**columns, 'wall_clearance_m': 'm'} == SIGNAL_UNITS


def test_precedence():
    for text, explicit in {
        'pitch_x_deg < 1 or pitch_x_deg > 2 and pitch_y_deg < 1': (
            '(pitch_x_deg < 1) or ((pitch_x_deg > 2) and (pitch_y_deg < 1))'
        ),
        'not pitch_x_deg < 1 and pitch_y_deg < 1': '(not (pitch_x_deg < 1)) and (pitch_y_deg < 1)',
        'pitch_x_deg < 1 and pitch_y_deg < 1 until: pitch_x_deg > 2 or pitch_y_deg > 2': (
            '(pitch_x_deg < 1 and pitch_y_deg < 1) until: (pitch_x_deg > 2 or pitch_y_deg > 2)'
        ),
        'pitch_x_deg < 1 implies pitch_x_deg < 2 implies pitch_x_deg < 3': (
            'pitch_x_deg < 1 implies (pitch_x_deg < 2 implies pitch_x_deg < 3)'
        ),
        'always: pitch_x_deg < 1 and pitch_y_deg < 1': (
            'always: (pitch_x_deg < 1 and pitch_y_deg < 1)'
        ),
        'pitch_x_deg < 1 until within 2 s: pitch_x_deg > 2 or pitch_y_deg > 2': (
            'pitch_x_deg < 1 until within 2 s: (pitch_x_deg > 2 or pitch_y_deg > 2)'
        ),
        '-1 < pitch_x_deg + 2 * pitch_y_deg': '(-1) < (pitch_x_deg + (2 * pitch_y_deg))',
        'pitch_x_deg < 1 until from 0.004 to 1 s: pitch_y_deg > 1': (
            '(always for 0 s: pitch_x_deg < 1) and (eventually from 0.004 to 0.004 s: '
            'pitch_x_deg < 1 until within 0.996 s: pitch_y_deg > 1)'
        ),
        'pitch_x_deg - 1 - 2 < 3': '(pitch_x_deg - 1) - 2 < 3',
        'pitch_x_deg > 1': '1 < pitch_x_deg',
        'pitch_x_deg >= 1': '1 <= pitch_x_deg',
        'pitch_x_deg < 2 * 3': 'pitch_x_deg < 6',
        'eventually within 2 s: pitch_x_deg < 1': 'eventually from 0 to 2 s: pitch_x_deg < 1 deg',
        'from 2 s: always for 0.5 s: pitch_x_deg < 1': 'from 2s:always for .5 s:pitch_x_deg<1',
    }.items():
        assert same(text, explicit), text
    assert not same('pitch_x_deg - (1 - 2) < 3', 'pitch_x_deg - 1 - 2 < 3')


def test_the_robustness_has_the_unit_of_what_is_compared():
    for text, unit in {
        'abs(pitch_x_deg) < 5': '°',
        'always: abs(duty_x_percent) < 60 percent': '%',
        'abs(speed_x_m_per_s - speed_y_m_per_s) < 0.3': 'm/s',
        'motor_torque_x_n_m < 1': 'N·m',
        'abs(pitch_x_deg) / 5 deg < 1 and wall_clearance_m / 0.05 m > 1': '',
        'pitch_x_deg / duty_x_percent < 1 deg / 60 percent': '°·%^-1',
        'position_x_m * position_x_m < 1': 'm^2',
        '2 * pitch_x_deg < 4': '°',
    }.items():
        assert parse_property('', text).unit == unit, text


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'expected a signal or a number, not the end'),
        ('always:', 'expected a signal or a number, not the end'),
        ('always: pich_x_deg < 3',
         "unknown signal 'pich_x_deg' (did you mean pitch_x_deg or pitch_y_deg?)"),
        ('roll_angle < 3', f"unknown signal 'roll_angle'; known: {', '.join(SIGNAL_UNITS)}"),
        ('pitch_x_deg < 3 &', "'&' (character 17) has no meaning"),
        ('pitch_x_deg', 'a property needs comparisons, such as `pitch_x_deg < 5`, not a value'),
        ('not pitch_x_deg', 'not needs comparisons, such as `pitch_x_deg < 5`, not a value'),
        ('abs(pitch_x_deg < 3) < 2', "'abs' needs values, not comparisons"),
        ('-1 < pitch_x_deg < 1', "'<' needs values, not comparisons"),
        ('(pitch_x_deg < 3) + 1 < 2', "'+' needs values, not comparisons"),
        ('3 < 4 deg', "'<' compares numbers only, no signal"),
        ('pitch_x_deg < 3 degrees',
         f"expected an operator, a unit ({UNITS}) or the end, not 'degrees' (character 17)"),
        ('(pitch_x_deg < 3', "expected ')', not the end"),
        ('pitch_x_deg < and', "expected a signal or a number, not 'and' (character 15)"),
        ('pitch_x_deg / 0 < 1', 'divides by 0'),
        ('pitch_x_deg < 3 m', "'<' joins different units, ° and m"),
        ('pitch_x_deg + speed_x_m_per_s < 3', "'+' joins different units, ° and m/s"),
        ('pitch_x_deg < 3 and duty_x_percent < 60',
         f"'and' joins different units, ° and %: {DIVIDE}"),
        ('pitch_x_deg < 3 until: duty_x_percent / 60 percent < 1',
         f"'until' joins different units, ° and a pure number: {DIVIDE}"),
        ('height < 3', "expected a signal or a number, not 'height' (character 1)"),
        ('pitch_x_deg < 3 until pitch_x_deg > 3',
         "expected 'within' or 'from' or ':' after 'until', not 'pitch_x_deg' (character 23)"),
        ('always pitch_x_deg < 3',
         "expected 'for' or 'from' or ':' after 'always', not 'pitch_x_deg' (character 8)"),
        ('always within 2 s: pitch_x_deg < 3',
         "expected 'for' or 'from' or ':' after 'always', not 'within' (character 8)"),
        ('eventually for 2 s: pitch_x_deg < 3',
         "expected 'within' or 'from' or ':' after 'eventually', not 'for' (character 12)"),
        ('always for 2: pitch_x_deg < 3', "expected 's', not ':' (character 13)"),
        ('always for 2 s pitch_x_deg < 3', "expected ':', not 'pitch_x_deg' (character 16)"),
        ('always for long: pitch_x_deg < 3', "expected a number, not 'long' (character 12)"),
        ('always from 3 to 2 s: pitch_x_deg < 3', 'time goes back from 3 to 2 s'),
        ('always from 3 s: pitch_x_deg < 3', "expected 'to', not 's' (character 15)"),
        ('always from 0.001 to 0.003 s: pitch_x_deg < 3',
         'no tick of 4 ms is within 0.001 … 0.003 s'),
        ('from 3 to 2 s: pitch_x_deg < 3', 'time goes back from 3 to 2 s'),
        ('after pushes: pitch_x_deg < 3',
         "expected 'each' or 'the' or 'push' or 'fault', not 'pushes' (character 7)"),
        ('after push: pitch_x_deg < 3',
         "expected the number of the push, from 1, not ':' (character 11)"),
        ('after push 0: pitch_x_deg < 3',
         "expected the number of the push, from 1, not '0' (character 12)"),
        ('after each push pitch_x_deg < 3', "expected ':', not 'pitch_x_deg' (character 17)"),
        ('until each push: pitch_x_deg < 3',
         "expected 'the' or 'push' or 'fault', not 'each' (character 7)"),
        ('while flying: pitch_x_deg < 3',
         "expected 'remote' or 'autonomous', not 'flying' (character 7)"),
        ('pitch_x_deg < 3 and after each push: pitch_x_deg < 3',
         "expected a signal or a number, not 'after' (character 21)"),
        ('(' * 290, 'nested too deeply'),
        ('1 +' * 151, 'has more than 300 words and signs'),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(text, message):
    with pytest.raises(ScenarioError) as error:
        parse_property('a', text)
    assert str(error.value) == message


SCENARIO = """\
purpose: x
duration: 5
{more}
properties:
  one: "always: abs(pitch_x_deg) < 5"
  {name}: {text}
"""


def test_a_mistake_in_a_scenario_names_file_and_line(tmp_path):
    path = tmp_path / 'mine.yaml'
    for name, text, more, message in (
        ('two', '"pich_x_deg < 3"', '',
         "'two': unknown signal 'pich_x_deg' (did you mean pitch_x_deg or pitch_y_deg?)"),
        ('two', '3', '', "'two': 3 is not a text"),
        ('3', '"pitch_x_deg < 3"', '', '3 is no name for a property'),
        ('peak_pitch_deg', '"pitch_x_deg < 3"', '', "'peak_pitch_deg' is no name for a property"),
        ('two', '"always: wall_clearance_m > 0.1"', '', "'two': wall_clearance_m needs a map"),
        ('two', '"after push 1: pitch_x_deg < 3"', '', "'two': push 1: the scenario has none"),
        ('two', '"until push 3: pitch_x_deg < 3"',
         'pushes: [{time: 2, duration: 0.1, force: 1, direction: left}]',
         "'two': push 3: the scenario has 1"),
        ('two', '"after fault 1: pitch_x_deg < 3"', '', "'two': fault 1: the scenario has none"),
    ):  # fmt: skip
        path.write_text(SCENARIO.format(name=name, text=text, more=more), encoding='utf-8')
        with pytest.raises(ScenarioError) as error:
            load_scenario(str(path))
        assert str(error.value) == f'{path}:6: {message}'


def test_a_text_may_have_several_lines(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(
        SCENARIO.format(name='two', text='>\n    always:\n    pitch_x_deg < 3', more='')
    )
    assert load_scenario(str(path)).properties[1].text == 'always: pitch_x_deg < 3'
