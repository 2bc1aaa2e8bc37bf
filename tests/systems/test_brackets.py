"""Lie brackets on R^n × SO(3)^k obey the laws of a Lie algebra, and say where short manoeuvres lead."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.state_space import StateSpace, rotation, scalar, vector
from nhpocp.systems import brackets
from nhpocp.systems.brackets import LieAlgebra, TooLargeError, bracket, hall_words

SPACE = StateSpace([vector("p", 2, "length"), rotation("A"), scalar("s"), rotation("B")])
SEEDS = st.integers(0, 10**6)


def field(seed, x):
    """A smooth field of no symmetry on `SPACE`."""
    random = np.random.default_rng(seed)
    mixed = ca.DM(0.4 * random.standard_normal((SPACE.dimension, SPACE.size))) @ x
    return ca.sin(mixed + ca.DM(random.standard_normal(SPACE.dimension)))


def place(seed):
    """A random point."""
    random = np.random.default_rng(seed)
    values = {"p": np.zeros(2), "A": np.eye(3), "s": 0.0, "B": np.eye(3)}
    return SPACE.retract(SPACE.pack(values), random.standard_normal(SPACE.dimension))


def numbers(x, expression, point):
    return ca.Function("value", [x], [ca.densify(expression)])(point).full().ravel()


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_antisymmetry_and_jacobis_identity(seed):
    x, point = ca.SX.sym("x", SPACE.size), place(seed)
    X, Y, Z = (field(seed + i, x) for i in range(3))

    def b(first, second):
        return bracket(SPACE, x, first, second)

    np.testing.assert_allclose(numbers(x, b(X, Y) + b(Y, X), point), 0, atol=1e-13)
    cyclic = b(X, b(Y, Z)) + b(Y, b(Z, X)) + b(Z, b(X, Y))
    np.testing.assert_allclose(numbers(x, cyclic, point), 0, atol=1e-12)
    assert np.abs(numbers(x, b(X, b(Y, Z)), point)).max() > 1e-3


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_leibniz_rule(seed):
    """[X, f Y] = f [X, Y] + (X f) Y."""
    x, point = ca.SX.sym("x", SPACE.size), place(seed)
    X, Y = field(seed, x), field(seed + 1, x)
    f = ca.cos(ca.dot(ca.DM(np.random.default_rng(seed).standard_normal(SPACE.size)), x))
    along = ca.jtimes(f, x, SPACE.lift(x, X))
    expected = f * bracket(SPACE, x, X, Y) + along * Y
    np.testing.assert_allclose(numbers(x, bracket(SPACE, x, X, f * Y) - expected, point), 0, atol=1e-12)


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_agrees_with_the_bracket_of_the_packed_point(seed):
    """Lifted to all the numbers of a point, where Lie brackets are the usual ones, and lowered again."""
    x, point = ca.SX.sym("x", SPACE.size), place(seed)
    X, Y = field(seed, x), field(seed + 1, x)
    lifted = [SPACE.lift(x, X), SPACE.lift(x, Y)]
    ambient = ca.jacobian(lifted[1], x) @ lifted[0] - ca.jacobian(lifted[0], x) @ lifted[1]
    own = numbers(x, bracket(SPACE, x, X, Y), point)
    np.testing.assert_allclose(own, numbers(x, SPACE.lower(x, ambient), point), atol=1e-12)
    # the commutator is tangent to the group: nothing is lost on the way down
    np.testing.assert_allclose(SPACE.lift(point, own), numbers(x, ambient, point), atol=1e-12)


def walk(function, point, time):
    """The flow of a packed field."""
    sign = np.sign(time)
    found = solve_ivp(
        lambda _, y: sign * function(y).full().ravel(), (0, abs(time)), point, rtol=1e-12, atol=1e-13
    )
    return found.y[:, -1]


@pytest.mark.parametrize("seed", range(3))
def test_is_where_a_square_of_flows_leads(seed):
    """e^{-εY} e^{-εX} e^{εY} e^{εX} x = x + ε² [X, Y](x) + O(ε³)."""
    x, point = ca.SX.sym("x", SPACE.size), place(seed)
    X, Y = field(seed, x), field(seed + 1, x)
    flows = [ca.Function("lifted", [x], [ca.densify(SPACE.lift(x, one))]) for one in (X, Y)]
    expected, errors = numbers(x, bracket(SPACE, x, X, Y), point), []
    for step in (0.04, 0.02, 0.01):
        end = point
        for which, sign in ((0, 1), (1, 1), (0, -1), (1, -1)):
            end = walk(flows[which], end, sign * step)
        errors.append(np.abs(SPACE.difference(end, point) / step**2 - expected).max())
    assert errors[-1] < 0.1 * np.abs(expected).max()
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.1)


@pytest.mark.parametrize(
    ("letters", "counts"), [(1, [1, 0, 0, 0]), (2, [2, 1, 2, 3, 6, 9]), (3, [3, 3, 8, 18])]
)
def test_halls_basis_has_as_many_elements_as_witt_says(letters, counts):
    assert [len(layer) for layer in hall_words(letters, len(counts))] == counts


def test_words_are_written_with_their_names():
    assert [word.written("ab") for layer in hall_words(2, 3) for word in layer] == [
        *("a", "b", "[a, b]", "[a, [a, b]]", "[b, [a, b]]")
    ]


def test_nilpotent_algebras_end():
    for model in ("heisenberg", "free_nilpotent_36"):
        algebra = LieAlgebra(system_class(model)())
        assert algebra.deepen()
        assert not algebra.deepen()
        assert not algebra.deepen()  # and stays so


def test_brackets_that_grow_too_large_are_refused(monkeypatch):
    monkeypatch.setattr(brackets, "MOST_OPERATIONS", 5000)
    algebra = LieAlgebra(system_class("three_upu")())
    assert algebra.deepen()
    with pytest.raises(TooLargeError, match="8 brackets of degree 3"):
        algebra.deepen()


@pytest.mark.parametrize("model", SYSTEMS)
def test_the_first_layer_is_the_system(model):
    system = system_class(model)()
    blocks = system.state_space.blocks
    point = system.state_space.pack(
        {b.name: np.eye(3) if b.kind == "rotation" else np.ones(b.shape) for b in blocks}
    )
    values = LieAlgebra(system).layers[0].at(np.tile(point, (2, 1)))
    fields = np.asarray(system.vector_fields(point))
    expected = fields if system.driftless else np.column_stack([system.drift(point), fields])
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(values, [expected, expected], rtol=1e-10, atol=1e-12)
