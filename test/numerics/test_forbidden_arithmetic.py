"""What leads to a duty, or into a recording, uses no arithmetic that differs between machines."""

import ast
from pathlib import Path

import pytest

import ballbot_ros

PACKAGE = Path(ballbot_ros.__file__).parent
FLOORS = (
    'numerics', 'plant', 'brick', 'world', 'controller', 'scenario', 'teleop', 'simulation',
)  # fmt: skip
FILES = [
    *(path for floor in FLOORS for path in sorted((PACKAGE / floor).glob('*.py'))),
    PACKAGE / 'messages' / 'conversions.py',
]

# Exact, or rounded alike everywhere: square roots, absolute values, comparisons, whole numbers.
ALLOWED_MATH = {
    'copysign', 'degrees', 'floor', 'ceil', 'frexp', 'inf', 'isfinite', 'isinf', 'isnan', 'nan',
    'pi', 'radians', 'sqrt',
}  # fmt: skip
ALLOWED_NUMPY = {
    # types and constants
    'bool_', 'errstate', 'float32', 'float64', 'inf', 'int32', 'int8', 'ndarray', 'uint64',
    'uint8',
    # making and moving
    'arange', 'array', 'asarray', 'ascontiguousarray', 'empty', 'equal', 'frombuffer', 'full',
    'isin', 'load', 'savez', 'where', 'zeros',
    # whole numbers
    'argmin', 'cumsum', 'unravel_index',
}  # fmt: skip
# Not on the way to a duty: what is measured of a run, and what is read of a message afterwards.
MEASURING = {'clearance', '_outline', 'body_pitch'}


def names_of(tree, module):
    return {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == module
    }


def without_measuring(tree):
    class Remover(ast.NodeTransformer):
        def visit_FunctionDef(self, node):
            return None if node.name in MEASURING else self.generic_visit(node)

    return Remover().visit(tree)


def is_whole(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


@pytest.mark.parametrize('path', FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_forbidden_arithmetic(path):
    tree = without_measuring(ast.parse(path.read_text(encoding='utf-8')))
    assert names_of(tree, 'math') <= ALLOWED_MATH
    assert names_of(tree, 'np') <= ALLOWED_NUMPY
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp):
            assert not isinstance(node.op, ast.MatMult), f'line {node.lineno}: a matrix product'
            if isinstance(node.op, ast.Pow):
                whole = is_whole(node.left) and is_whole(node.right)
                assert whole, f'line {node.lineno}: a power'
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            # From Python 3.12 on, sum() of floats is compensated.
            assert node.func.id not in ('sum', 'pow'), f'line {node.lineno}: {node.func.id}()'
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('scipy'):
            assert [each.name for each in node.names] == ['distance_transform_cdt']
