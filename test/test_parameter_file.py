"""Parameter files in ROS form."""

import pytest
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line, refusal, yaml_texts

from ballbot_ros.errors import BallbotError
from ballbot_ros.files import share_directory
from ballbot_ros.parameters import (
    ALL_NODES,
    CONTROLLER,
    GAMEPAD,
    GYRO,
    NODES,
    PLANT,
    SONAR,
    TABLE,
    ParameterSet,
)
from ballbot_ros.parameters.files import (
    format_parameters,
    read_parameter_file,
    write_parameter_file,
)

values_of_rows = {
    row: st.sampled_from(row.choices)
    if row.choices
    else st.text(st.characters(exclude_categories=('Cs',)), max_size=20)
    if isinstance(row.default, str)
    else st.booleans()
    if isinstance(row.default, bool)
    else st.integers(*row.bounds)
    if isinstance(row.default, int)
    else st.floats(*row.bounds)
    if isinstance(row.default, float)
    else st.lists(st.floats(*row.bounds), min_size=4, max_size=4)
    for row in TABLE
}
assignments = st.sampled_from(TABLE).flatmap(
    lambda row: st.tuples(st.just(row), values_of_rows[row])
)


@pytest.fixture(scope='module')
def read(tmp_path_factory):
    """Read a parameter file of the given text."""
    path = tmp_path_factory.mktemp('parameters') / 'file.yaml'

    def read_text(text):
        path.write_bytes(text.encode(errors='replace'))
        return read_parameter_file(path)

    return read_text


def everything(parameters):
    return {node: parameters.of_node(node) for node in NODES}


def test_a_file_sets_what_it_names(read):
    parameters = read(
        'plant_sim:\n'
        '  ros__parameters:\n'
        '    gravity: 1.62\n'
        '    plant_model: nonlinear\n'
        'controller: {ros__parameters: {k_f: [-1, -2, -3, -4]}}\n'
    )
    assert sorted(parameters) == [
        (CONTROLLER, 'k_f', (-1.0, -2.0, -3.0, -4.0)),
        (PLANT, 'gravity', 1.62),
        (PLANT, 'plant_model', 'nonlinear'),
    ]


@pytest.mark.parametrize('key', ['gyro_driver', '/gyro_driver', '/**/gyro_driver', '/**'])
def test_every_form_of_a_node_name_in_ros_is_accepted(read, key):
    parameters = read(f'{key}: {{ros__parameters: {{noise: 0.7}}}}\n')
    assert list(parameters) == [(GYRO, 'noise', 0.7)]


def test_a_wildcard_parameter_reaches_all_nodes_that_have_it(read):
    parameters = read('/**: {ros__parameters: {seed: 42}}\n')
    sharers = {PLANT, GYRO, 'encoder_driver', SONAR, CONTROLLER, GAMEPAD}
    assert {node for node, _, _ in parameters} == sharers
    assert {(name, value) for _, name, value in parameters} == {('seed', 42)}


@given(st.lists(assignments, max_size=8))
def test_a_written_file_reads_back(read, chosen):
    parameters = ParameterSet()
    for row, value in chosen:
        parameters.set(row.nodes[0], row.name, value)
    again = read(format_parameters(parameters))
    assert everything(again) == everything(parameters)
    assert format_parameters(again) == format_parameters(parameters)


def test_a_written_file_holds_every_parameter_of_its_nodes(tmp_path):
    path = tmp_path / 'all.yaml'
    write_parameter_file(path, ParameterSet(), ALL_NODES)
    assert {(row.name, node) for row in TABLE for node in row.nodes} == {
        (name, node) for node, name, _ in read_parameter_file(path)
    }
    write_parameter_file(path, ParameterSet(), [GYRO])
    assert 'plant_sim' not in path.read_text(encoding='utf-8')


def test_the_shipped_file_holds_the_defaults():
    shipped = read_parameter_file(share_directory() / 'config/ballbot.yaml')
    assert everything(shipped) == everything(ParameterSet())
    assert len(list(shipped)) == sum(len(row.nodes) for row in TABLE)


MISTAKES = [
    ('plant_sim:\n  ros__parameters:\n    grafity: 1\n', 3, "no parameter 'grafity'"),
    ('plant_sim:\n  ros__parameters:\n    gravity: -1\n', 3, '-1 is not within 0 … 100 m/s²'),
    ('plant_sim:\n  ros__parameters:\n    gravity: .nan\n', 3, 'nan is not within'),
    ('plant_sim:\n  ros__parameters:\n    gravity: ten\n', 3, "'ten' is not a number"),
    ('plant_sim:\n  ros__parameters:\n    gravity:\n', 3, 'None is not a number'),
    ('plant_sim:\n  ros__parameters:\n    lockstep: 1\n', 3, '1 is not true or false'),
    ('plant_sim:\n  ros__parameters:\n    plant_model: x\n', 3, 'not one of linear, nonlinear'),
    ('plant_sim:\n  ros__parameters: {a: {b: 1}}\n', 2, "no parameter 'a'"),
    ('controller:\n  ros__parameters:\n    k_f:\n      - 1\n', 3, 'not a list of 4 numbers'),
    ('gyro: {ros__parameters: {noise: 1}}\n', 1, "unknown node 'gyro'"),
    ('1: {ros__parameters: {noise: 1}}\n', 1, "unknown node '1'"),
    ('/**: {ros__parameters: {voice: 1}}\n', 1, "no node has a parameter 'voice'"),
    ('plant_sim:\n  gravity: 1\n', 1, 'must contain ros__parameters and nothing else'),
    ('plant_sim: {}\n', 1, 'must contain ros__parameters and nothing else'),
    ('plant_sim:\n', 1, 'is not a mapping'),
    ('plant_sim:\n  ros__parameters:\n', 2, 'is not a mapping'),
    ('plant_sim:\n  ros__parameters: [1]\n', 2, 'is not a mapping'),
    ('- plant_sim\n', 1, 'is not a mapping'),
    ('plant_sim\n', 1, 'is not a mapping'),
    ('"two\\nlines": 1\n', 1, 'is not a mapping'),
    ('a: 1\na: 2\n', 2, "duplicate key 'a'"),
    ('a: [\n', 2, 'not YAML'),
]


def test_mistakes_are_reported_in_one_line_with_file_and_line(read):
    for text, line, told in MISTAKES:
        message = refusal(BallbotError, read, text)
        assert f'file.yaml:{line}: ' in message, text
        assert told in message, text


@pytest.mark.parametrize('number', ['9' * 400, '9' * 5000, '0x' + 'f' * 5000, '1e999'])
@pytest.mark.parametrize('name', ['gravity', 'duration', 'start_pitch_x'])
def test_a_number_beyond_all_bounds_is_refused_in_one_line(read, name, number):
    with pytest.raises(BallbotError, match=r'^[^\n]*file\.yaml:3: [^\n]*$'):
        read(f'plant_sim:\n  ros__parameters:\n    {name}: {number}\n')


def test_an_empty_file_is_refused(read):
    with pytest.raises(BallbotError, match='is not a mapping'):
        read('# nothing\n')


@given(yaml_texts('plant_sim', 'controller', '/**', 'ros__parameters', 'gravity', 'k_f', 'mode'))
def test_any_text_is_read_or_refused_in_one_line(read, text):
    assert is_read_or_refused_in_one_line(read, text)


@given(st.sampled_from(TABLE), st.text(max_size=20))
def test_any_value_is_read_or_refused_in_one_line(read, row, value):
    text = f'{row.nodes[0]}:\n  ros__parameters:\n    {row.name}: {value}\n'
    assert is_read_or_refused_in_one_line(read, text)


def test_a_file_that_can_not_be_written_is_named(tmp_path):
    (tmp_path / 'full.yaml').symlink_to('/dev/full')
    with pytest.raises(BallbotError, match=r'full.yaml: No space left on device$'):
        write_parameter_file(tmp_path / 'full.yaml', ParameterSet(), ALL_NODES)
