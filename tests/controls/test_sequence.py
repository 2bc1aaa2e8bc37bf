"""Controls in sequence: the basis laws, and that joining changes nothing."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.sequence import SequenceBasis, join

RANDOM = np.random.default_rng(5)
PIECES = [
    Control(Fourier(2), RANDOM.normal(size=(3, 5)), 0.5),
    Control(PiecewiseConstant(3), RANDOM.normal(size=(3, 3)), 0.3),
    Control(Fourier(0), RANDOM.normal(size=(3, 1)), 1.2),
]


def test_joined_control_is_its_pieces_one_after_another():
    joined = join(PIECES)
    assert joined.horizon == pytest.approx(2.0)
    assert joined.effort == pytest.approx(sum(piece.effort for piece in PIECES))
    before = 0.0
    for piece in PIECES:
        inner = np.linspace(0, piece.horizon, 9)[1:-1]
        np.testing.assert_allclose(joined(before + inner), piece(inner), atol=1e-12)
        np.testing.assert_allclose(joined([before]), piece([0.0]), atol=1e-12)
        before += piece.horizon
        np.testing.assert_allclose(joined([before], "left"), piece([piece.horizon], "left"), atol=1e-12)


def test_gram_matrix_against_quadrature():
    basis = join(PIECES).basis
    knots = np.union1d([0.0, 2.0], basis.breakpoints(2.0))
    nodes, weights = np.polynomial.legendre.leggauss(20)
    total = np.zeros((basis.size, basis.size))
    for low, high in pairwise(knots):
        table = basis.table(0.5 * (low + high) + 0.5 * (high - low) * nodes, 2.0)
        total += 0.5 * (high - low) * (table.T * weights) @ table
    np.testing.assert_allclose(basis.gram(2.0), total, atol=1e-12)


def test_breakpoints_are_the_joints_and_the_pieces_own():
    np.testing.assert_allclose(join(PIECES).breakpoints, [0.5, 0.6, 0.7, 0.8])


def test_symbols_give_the_same_values():
    basis = join(PIECES).basis
    t = ca.SX.sym("t")
    values = ca.Function("phi", [t], [basis.values(t, 2.0)])
    for time in (0.0, 0.2, 0.55, 0.9, 1.7):
        np.testing.assert_allclose(np.array(values(time)).ravel(), basis.table([time], 2.0)[0], atol=1e-12)


def test_json_round_trip_gives_every_piece_its_horizon():
    joined = join(PIECES)
    data = joined.to_json()
    assert [piece["horizon"] for piece in data["pieces"]] == pytest.approx([0.5, 0.3, 1.2])
    basis, coefficients = SequenceBasis.from_json(data)
    back = Control(basis, coefficients, data["horizon"])
    times = np.linspace(0, 2, 41)
    np.testing.assert_allclose(back(times), joined(times), atol=1e-12)


def test_between_breakpoints_a_piece_does_the_same_alone():
    random = np.random.default_rng(0)
    bases = (Fourier(1), BSpline(2, 3), Fourier(2))
    whole = join(
        [Control(b, random.normal(size=(2, b.size)), t) for b, t in zip(bases, (0.5, 2.0, 1.0), strict=True)]
    )
    knots = [0.0, *whole.breakpoints, whole.horizon]
    for first, last in pairwise(knots):
        own, begin = whole.between(first, last)
        times = np.linspace(first, last, 9)[1:-1]
        np.testing.assert_allclose(own(times - begin), whole(times), atol=1e-12)
        np.testing.assert_allclose(own([last - begin], "left"), whole([last], "left"), atol=1e-9)
    alone = Control(Fourier(1), np.ones((2, 3)), 2.0)
    assert alone.between(0.0, 2.0) == (alone, 0.0)


def test_a_time_beside_a_joint_is_on_its_own_side():
    """A step may end as near to it as that; on the wrong piece its middle would be a whole jump off."""
    basis = SequenceBasis((Fourier(0), Fourier(0)), (0.25, 0.75))
    control = Control(basis, [[1.0, -1.0]], 2.0)
    beside = 0.5 + np.array([-1e-9, 1e-9, -1e-14, 1e-14])
    np.testing.assert_array_equal(control(beside, "right")[:, 0], [1.0, -1.0, -1.0, -1.0])
    np.testing.assert_array_equal(control(beside, "left")[:, 0], [1.0, -1.0, 1.0, 1.0])
