"""One text for numbers and symbols: the namespace follows its operands, and both give the same numbers."""

import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.arrays import CasadiNamespace, NumPyNamespace, cross, dot, namespace, norm, solve_3x3, unit

LAW = settings(max_examples=50, deadline=None, derandomize=True)
KINDS = [ca.SX, ca.MX]

entries = st.floats(-10, 10, allow_subnormal=False)
vectors = st.tuples(entries, entries, entries).map(np.array)


def evaluate(kind, function, *arguments):
    """A function of vectors, evaluated through CasADi symbols."""
    symbols = [kind.sym(f"x{i}", len(argument)) for i, argument in enumerate(arguments)]
    return np.array(ca.Function("f", symbols, [ca.densify(function(*symbols))])(*arguments)).squeeze()


@pytest.mark.parametrize("operands", [(1.0,), (np.ones(3), 2), ([1, 2], None)])
def test_numbers_are_numpys(operands):
    assert isinstance(namespace(*operands), NumPyNamespace)


@pytest.mark.parametrize("operand", [ca.SX.sym("x"), ca.MX.sym("x"), ca.DM(1)])
def test_one_casadi_operand_makes_it_casadis(operand):
    assert isinstance(namespace(np.ones(3), operand), CasadiNamespace)
    assert namespace(operand) is namespace(operand, 1.0)


@LAW
@given(vectors, vectors)
def test_products_agree_with_numpy(a, b):
    assert np.array_equal(cross(a, b), np.cross(a, b))
    assert dot(a, b) == pytest.approx(np.dot(a, b), abs=1e-12)
    assert norm(a) == pytest.approx(np.linalg.norm(a), abs=1e-12)
    for kind in KINDS:
        assert np.allclose(evaluate(kind, cross, a, b), np.cross(a, b), rtol=0, atol=1e-12)
        assert np.allclose(evaluate(kind, dot, a, b), a @ b, rtol=0, atol=1e-12)


@LAW
@given(vectors.filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_unit_has_length_one_and_the_same_direction(a):
    assert norm(unit(a)) == pytest.approx(1)
    assert np.allclose(norm(a) * unit(a), a)


@LAW
@given(vectors, vectors, vectors, vectors)
def test_solve_3x3_solves(r1, r2, r3, right):
    matrix = np.array([r1, r2, r3])
    if np.linalg.cond(matrix) > 1e5:
        return
    expected = np.linalg.solve(matrix, right)
    tolerance = 1e-13 * np.linalg.cond(matrix) ** 2 * (1 + np.abs(expected).max())
    assert np.abs(solve_3x3([r1, r2, r3], right) - expected).max() < tolerance
    for kind in KINDS:
        found = evaluate(kind, lambda a, b, c, d: solve_3x3([a, b, c], d), r1, r2, r3, right)
        assert np.abs(found - expected).max() < tolerance


def test_building_blocks_agree():
    a, b, m = np.array([1.0, 2, 3]), np.array([4.0, 5, 6]), np.arange(9.0).reshape(3, 3)
    numbers, symbols = namespace(1.0), namespace(ca.DM(1))
    pairs = [
        (numbers.vector([1, 2.0, 3]), symbols.vector([1, 2.0, 3])),
        (numbers.concatenate([a, 7.0, b]), symbols.concatenate([ca.DM(a), 7.0, ca.DM(b)])),
        (numbers.rows([a, b]), symbols.rows([ca.DM(a), ca.DM(b)])),
        (numbers.block([[m, 2 * m], [m.T, m]]), symbols.block([[ca.DM(m), 2 * m], [m.T, m]])),
        (numbers.eye(3), symbols.eye(3)),
        (numbers.solve(m + 9 * np.eye(3), a), symbols.solve(ca.DM(m + 9 * np.eye(3)), ca.DM(a))),
    ]
    for expected, found in pairs:
        assert np.allclose(np.array(ca.densify(found)).reshape(expected.shape), expected, rtol=1e-14)


def test_importing_arrays_loads_neither_library():
    code = "import sys, nhpocp.arrays; assert not {'numpy', 'casadi'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
