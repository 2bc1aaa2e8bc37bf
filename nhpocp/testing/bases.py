"""Laws of control bases: exact derivatives and Gram matrix, one-sided limits, numbers and symbols alike, files."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.control import Control
from nhpocp.controls.table import Gram
from nhpocp.errors import expect
from nhpocp.problem_file import control_from_json
from nhpocp.testing.laws import Law, agree, holds, run

SIDES: tuple[Side, ...] = ("left", "right")
HORIZONS = (0.05, 1.0, 2.5, 50.0)
SHARES = tuple(np.linspace(0.0, 1.0, 23))
NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)


def check_basis(basis: ControlBasis) -> None:
    """Holds a control basis against the laws that nhpocp's own keep, for short and long horizons.

    basis: an instance, with parameters that matter. Functions have to be polynomials of a moderate degree, or about as
    smooth, between the `breakpoints`: what is exact is compared with quadrature and difference quotients there.
    Errors: `AssertionError` with the first law that does not hold, and why; `CallError` for what is no basis.
    """
    expect(basis, ControlBasis, "a basis, such as Fourier(2)", "basis")
    run(basis.kind, LAWS, basis)
    for horizon in HORIZONS:
        run(f"{basis.kind} over {horizon:g}", LAWS_OF_A_HORIZON, basis, horizon)
        for share in SHARES:
            run(f"{basis.kind} over {horizon:g}", [derivative_is_that_of_the_table], basis, horizon, share)


def pieces(basis: ControlBasis, horizon: float) -> tuple[Array, Array]:
    """Gauss–Legendre times and weights on the smooth pieces."""
    knots = np.concatenate([[0.0], basis.breakpoints(horizon), [horizon]])
    middles, halves = 0.5 * (knots[1:] + knots[:-1])[:, None], 0.5 * np.diff(knots)[:, None]
    return (middles + halves * NODES).ravel(), (halves * WEIGHTS).ravel()


def apart_from_breakpoints(basis: ControlBasis, share: float, horizon: float) -> float:
    """A time with room for a difference quotient on both sides."""
    time, corners = share * horizon, np.concatenate([[0.0], basis.breakpoints(horizon), [horizon]])
    nearest = float(corners[np.abs(corners - time).argmin()])
    if abs(time - nearest) < 1e-3 * horizon:
        time = nearest + (2e-3 if nearest < 0.5 * horizon else -2e-3) * horizon
    return time


# --- at some horizon --------------------------------------------------------------------------------------------------


def gram_is_the_integral_of_products(basis: ControlBasis, horizon: float) -> None:
    times, weights = pieces(basis, horizon)
    table = basis.table(times, horizon)
    products = table.T @ (weights[:, None] * table)
    agree("gram(horizon)", np.asarray(basis.gram(horizon)), products, 1e-12, horizon)


def one_sided_derivatives_at_a_breakpoint(basis: ControlBasis, horizon: float) -> None:
    corners, step = np.asarray(basis.breakpoints(horizon)), 1e-7 * horizon
    for side, beside in zip(SIDES, (corners - step, corners + step), strict=True):
        limit, near = basis.derivative_table(corners, horizon, side), basis.derivative_table(beside, horizon)
        agree(
            f"derivative_table(…, {side!r})",
            limit,
            near,
            1e-4 * basis.size**2 / horizon,
            0.0,
        )


def derivative_is_that_of_the_table(basis: ControlBasis, horizon: float, share: float) -> None:
    time, step = apart_from_breakpoints(basis, share, horizon), 1e-4 * horizon
    offsets = step * np.array([-2.0, -1.0, 1.0, 2.0])
    quotients = np.array([1.0, -8.0, 8.0, -1.0]) / 12 @ basis.table(time + offsets, horizon) / step
    slopes = basis.derivative_table(np.array([time]), horizon)[0]
    allowed = 1e-7 * basis.size**2 / horizon
    agree(f"derivative_table at t = {time:.4g}", slopes, quotients, allowed, 0.0)


# --- once -------------------------------------------------------------------------------------------------------------


def shapes_are_those_of_its_size(basis: ControlBasis) -> None:
    times, size = np.linspace(0.0, 2.5, 7), basis.size
    holds(len(basis.labels) == size, f"{len(basis.labels)} labels for {size} functions")
    holds(len(set(basis.labels)) == size, f"labels are not distinct: {', '.join(basis.labels)}")
    for what, table in (
        ("table", basis.table(times, 2.5)),
        ("derivative_table", basis.derivative_table(times, 2.5)),
    ):
        holds(
            np.shape(table) == (7, size),
            f"{what} of 7 times is of shape {np.shape(table)}; expected {(7, size)}",
        )
    corners = np.asarray(basis.breakpoints(2.5))
    inside = corners.ndim == 1 and bool(
        ((corners > 0) & (corners < 2.5)).all() and (np.diff(corners) > 0).all()
    )
    holds(inside, f"breakpoints(2.5) are {corners}; expected times inside (0, 2.5) in their order")


def values_are_the_table_for_numbers_and_symbols(basis: ControlBasis) -> None:
    import casadi as ca

    times = np.array([apart_from_breakpoints(basis, share, 2.5) for share in SHARES])
    table = basis.table(times, 2.5)
    agree("values at numbers", [basis.values(time, 2.5) for time in times], table, 1e-13)
    kinds: tuple[Any, ...] = (ca.SX, ca.MX)
    for kind in kinds:
        time = kind.sym("t")
        phi = ca.Function("phi", [time], [basis.values(time, 2.5)])
        rows = [np.array(phi(each)).ravel() for each in times]
        agree(f"values at a CasADi {kind.__name__}", rows, table, 1e-13)


def a_local_table_is_the_table(basis: ControlBasis) -> None:
    times = np.sort(np.concatenate([np.linspace(0, 2.5, 31), basis.breakpoints(2.5)]))
    rows = np.random.default_rng(0).normal(size=(len(times), 3))
    columns = np.arange(2.0 * basis.size).reshape(basis.size, 2)
    for side in SIDES:
        table, local = basis.table(times, 2.5, side), basis.local_table(times, 2.5, side)
        agree("local_table", local.dense(), table, 1e-14)
        agree("local_table @ columns", local @ columns, table @ columns, 1e-12)
        agree("local_table.transposed(rows)", local.transposed(rows), table.T @ rows, 1e-12)


def its_functions_are_independent(basis: ControlBasis) -> None:
    """Else one control has many coefficients."""
    gram, columns = Gram.of(basis.gram(2.5)), np.random.default_rng(0).normal(size=(basis.size, 3))
    full = np.asarray(gram)
    agree("gram, and its transpose,", full, full.T, 1e-14)
    least = float(np.linalg.eigvalsh(full)[0]) if basis.size else 1.0
    holds(least > 0, f"the least eigenvalue of gram(2.5) is {least:.3g}")
    agree("gram.solve", gram @ gram.solve(columns), columns, 1e-6)


def a_file_holds_the_same_control(basis: ControlBasis) -> None:
    control = Control(basis, np.random.default_rng(1).normal(size=(3, basis.size)), 2.5)
    data = json.loads(json.dumps(control.to_json()))
    holds(data.get("horizon") == 2.5, f"to_json gives no horizon of 2.5, but {data.get('horizon')}")
    own = data.get("basis") == basis.kind  # and read by its class, whether that is installed or not
    again = Control(*type(basis).from_json(data), 2.5) if own else control_from_json(data)
    times = np.linspace(0, 2.5, 101)
    for side in SIDES:
        agree("the control read from its file", again(times, side), control(times, side), 1e-13)
    agree("its effort", again.effort, control.effort, 1e-12)


def parameters_make_the_same_basis(basis: ControlBasis) -> None:
    again = type(basis)(**basis.parameters())
    holds(
        again == basis,
        f"made of its parameters {basis.parameters()} it is {again!r}; is it a frozen dataclass?",
    )
    holds(hash(again) == hash(basis), "equal bases have different hashes; write @dataclass(frozen=True)")


LAWS_OF_A_HORIZON: tuple[Law, ...] = (gram_is_the_integral_of_products, one_sided_derivatives_at_a_breakpoint)
LAWS: tuple[Law, ...] = (
    shapes_are_those_of_its_size,
    values_are_the_table_for_numbers_and_symbols,
    a_local_table_is_the_table,
    its_functions_are_independent,
    a_file_holds_the_same_control,
    parameters_make_the_same_basis,
)
