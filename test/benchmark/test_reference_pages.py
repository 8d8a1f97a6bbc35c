"""The files generated from the parameter table are up to date."""

from pathlib import Path

import pytest

from ballbot_ros.cli.command import COMMANDS
from ballbot_ros.parameters import ALL_NODES, TABLE, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file
from benchmark.reference_pages import command_help, default_file, parameter_tables

ROOT = Path(__file__).parents[2]


def test_the_default_file_is_the_table():
    assert (ROOT / 'config/ballbot.yaml').read_text(encoding='utf-8') == default_file()


def test_the_tables_of_the_site_have_every_parameter():
    tables = parameter_tables()
    assert [row.name for row in TABLE if f'| `{row.name}` |' not in tables] == []


def test_the_page_of_commands_has_every_command_and_option():
    text = command_help()
    for name in COMMANDS:
        assert f'\n## ballbot {name}\n' in f'\n{text}'
    assert '## ballbot study rerun' in text
    assert '--real-time-factor' in text


def test_the_default_file_sets_every_default():
    read = read_parameter_file(ROOT / 'config/ballbot.yaml')
    for node in ALL_NODES:
        assert read.of_node(node) == ParameterSet().of_node(node)


def test_ros_takes_every_value_of_the_default_file(domain):
    rclpy = pytest.importorskip('rclpy')
    context = rclpy.Context()
    arguments = ['--ros-args', '--params-file', str(ROOT / 'config/ballbot.yaml')]
    rclpy.init(args=arguments, context=context, domain_id=domain)
    try:
        for name in ALL_NODES:
            node = rclpy.create_node(
                name,
                context=context,
                allow_undeclared_parameters=True,
                automatically_declare_parameters_from_overrides=True,
            )
            for key, value in ParameterSet().of_node(name).values().items():
                got = node.get_parameter(key).value
                got = tuple(got) if isinstance(value, tuple) else got
                assert got == value, f'{name}.{key}'
                assert type(got) is type(value), f'{name}.{key}'
            node.destroy_node()
    finally:
        context.try_shutdown()
