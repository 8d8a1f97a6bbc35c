"""The registry of the nodes against the parameter table and the modules."""

from types import SimpleNamespace

import pytest

from ballbot_ros.nodes import executables
from ballbot_ros.nodes.registry import REGISTRY, NodeEntry, make_node
from ballbot_ros.parameters import (
    ALL_NODES,
    EXECUTABLES,
    GYRO,
    NODES,
    PLANT,
    SUPERVISOR,
    GyroParameters,
    PlantParameters,
)


def test_registry_and_parameter_table_have_the_same_nodes_in_one_order():
    assert tuple(REGISTRY) == EXECUTABLES
    assert EXECUTABLES[: len(NODES)] == NODES
    assert {*ALL_NODES} - {*EXECUTABLES} == {SUPERVISOR}


def test_class_and_main_of_each_node_are_where_the_registry_says():
    pytest.importorskip('rclpy')
    pytest.importorskip('viser')
    for name in EXECUTABLES:
        assert callable(REGISTRY[name].maker), name
        assert callable(REGISTRY[name].main), name


def test_a_class_of_several_nodes_knows_which_one_it_is(monkeypatch):
    def module(entry):
        return SimpleNamespace(**{entry.class_name: lambda *given: given})

    monkeypatch.setattr(NodeEntry, 'load', module)
    for name, cls in ((GYRO, GyroParameters), (PLANT, PlantParameters)):
        several = (cls,) if name == GYRO else ()
        assert REGISTRY[name].maker() == several
        values = cls()
        assert make_node(values) == (*several, values)


def test_each_node_is_a_function_of_the_executables():
    for name in EXECUTABLES:
        assert getattr(executables, name).args == (name,)


def test_special_attributes_of_a_module_are_not_nodes():
    assert not hasattr(executables, '__path__')
