"""Code on the way to a duty or a recording uses no arithmetic that differs between machines."""

import ast
from pathlib import Path

import ballbot_ros

PACKAGE = Path(ballbot_ros.__file__).parent
FLOORS = (
    'robot', 'robot/plant', 'robot/brick', 'robot/world', 'controllers',
    'controllers/document', 'engine/scenario', 'engine', 'lockstep', 'nodes/teleop',
)  # fmt: skip
# Measurements of a finished run and the analysis of tasks do not lead to a duty, and mpc declares
# that it is not portable.
FILES = {
    *(path for floor in FLOORS for path in (PACKAGE / floor).glob('*.py')),
    PACKAGE / 'recording' / 'messages' / 'conversions.py',
} - {
    PACKAGE / 'engine' / 'scenario' / 'metrics.py',
    PACKAGE / 'engine' / 'scenario' / 'task_timing.py',
    PACKAGE / 'engine' / 'scenario' / 'formulas.py',
    PACKAGE / 'engine' / 'scenario' / 'properties.py',
    PACKAGE / 'engine' / 'brick_schedule.py',
    PACKAGE / 'robot' / 'brick' / 'response_times.py',
    PACKAGE / 'robot' / 'world' / 'clearance.py',
    PACKAGE / 'controllers' / 'mpc.py',
    PACKAGE / 'engine' / 'compilation.py',
}

# Exact, or rounded alike everywhere: square roots, absolute values, comparisons, integers.
ALLOWED_MATH = {
    'copysign', 'degrees', 'floor', 'ceil', 'frexp', 'inf', 'isfinite', 'isinf', 'isnan', 'nan',
    'lcm', 'pi', 'radians', 'sqrt',
}  # fmt: skip
ALLOWED_NUMPY = {
    # types and constants
    'bool_', 'dtype', 'errstate', 'float32', 'float64', 'inf', 'int32', 'int64', 'int8', 'intp',
    'ndarray', 'number', 'uint64', 'uint8',
    # creating and moving
    'append', 'arange', 'array', 'asarray', 'ascontiguousarray', 'column_stack', 'concatenate',
    'empty', 'equal',
    'flatnonzero', 'frombuffer', 'full', 'generic', 'isin', 'load', 'ravel', 'repeat', 'savez',
    'searchsorted', 'transpose', 'unique', 'void', 'where', 'zeros',
    # whole numbers
    'argmax', 'argmin', 'isfinite', 'unravel_index',
    # one number by one, in their order
    'abs', 'cumsum', 'diff', 'floor', 'isnan', 'maximum', 'rint', 'sqrt',
}  # fmt: skip
# Not on the way to a duty: messages that are read afterwards.
READING = {'pitch_angles'}
# The design of the LQG, whose results are parameters of a run.
DESIGNING = {
    'discrete_model', 'feedforward', 'kalman_filter', 'late_voltages', 'measurement', 'regulator',
    'weights', 'with_integral',
}  # fmt: skip


ARITHMETIC = {
    'cmath', 'control', 'math', 'numba', 'numpy', 'random', 'scipy', 'statistics',
}  # fmt: skip
ALLOWED_IMPORTS = {
    'import math',
    'import numpy as np',
    'from numpy.typing import NDArray',
    'from scipy.ndimage import distance_transform_cdt',
}
METHODS = {'sum', 'dot', 'mean', 'std', 'var', 'prod', 'matmul', 'cumprod'}


def names_of(tree, module):
    return {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == module
    }


def without_exceptions(tree):
    class Remover(ast.NodeTransformer):
        def visit_FunctionDef(self, node):
            return None if node.name in READING | DESIGNING else self.generic_visit(node)

    return Remover().visit(tree)


def is_whole(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


def is_allowed_import(node):
    if isinstance(node, ast.Import):
        modules = [each.name for each in node.names]
    else:
        modules = [node.module]
    if not ARITHMETIC & {module.partition('.')[0] for module in modules}:
        return True
    return ast.unparse(node) in ALLOWED_IMPORTS


def forbidden(source):
    """Return the forbidden operations in a source, with their lines."""
    tree = without_exceptions(ast.parse(source))
    found = [f'math.{name}' for name in names_of(tree, 'math') - ALLOWED_MATH]
    found += [f'np.{name}' for name in names_of(tree, 'np') - ALLOWED_NUMPY]
    for node in ast.walk(tree):
        bad = False
        if isinstance(node, ast.Import | ast.ImportFrom):
            bad = not is_allowed_import(node)
        elif isinstance(node, ast.BinOp | ast.AugAssign):
            whole = isinstance(node, ast.BinOp) and is_whole(node.left) and is_whole(node.right)
            bad = isinstance(node.op, ast.MatMult) or (isinstance(node.op, ast.Pow) and not whole)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            # From Python 3.12 on, sum() of floats is compensated.
            bad = node.func.id in ('sum', 'pow')
        elif isinstance(node, ast.Attribute):
            bad = node.attr in METHODS
        if bad:
            found.append(f'line {node.lineno}: {ast.unparse(node)}')
    return found


def test_the_sources_use_no_forbidden_arithmetic():
    found = {str(path): forbidden(path.read_text(encoding='utf-8')) for path in FILES}
    assert {path: operations for path, operations in found.items() if operations} == {}


FORBIDDEN = [
    'y = x ** 2', 'y = x ** 0.5', 'x **= 0.5', 'y = a @ b', 'a @= b', 'y = sum(values)',
    'y = pow(x, 2)', 'y = a.sum()', 'y = a.dot(b)', 'import math as m', 'import numpy',
    'from math import sin', 'import scipy.linalg', 'from numpy.linalg import inv',
    'import statistics', 'import cmath', 'y = math.sin(x)', 'y = math.hypot(x, y)',
    'y = np.linalg.inv(a)', 'y = np.random.default_rng()', 'y = np.exp(x)',
    'from scipy.linalg import expm',
]  # fmt: skip


def test_each_forbidden_operation_is_found():
    assert [source for source in FORBIDDEN if not forbidden(source)] == []
