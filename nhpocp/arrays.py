"""One text for CasADi and NumPy: the few operations that the formulas of this package need.

``namespace(x)`` looks at the operands and returns the library that can work on them, so that a formula written
once gives numbers for numbers and symbols for symbols. Both libraries are imported only when first asked for,
which lets the systems declare their names and parameters without either.
Vectors are (n,) arrays in NumPy and n×1 columns in CasADi; ``A @ x`` means the same in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

Array = Any  # np.ndarray, or a CasADi SX, MX or DM


class NumPyNamespace:
    """Numbers."""

    def __init__(self) -> None:
        import numpy

        self._np = numpy
        self.sin, self.cos, self.sqrt = numpy.sin, numpy.cos, numpy.sqrt
        self.atan2, self.where, self.solve = numpy.arctan2, numpy.where, numpy.linalg.solve
        self.eye = numpy.eye

    def array(self, values: Any) -> Array:
        return self._np.asarray(values, dtype=float)

    def vector(self, entries: Sequence[Any]) -> Array:
        """Column of scalars."""
        return self._np.array(entries, dtype=float)

    def concatenate(self, parts: Sequence[Any]) -> Array:
        """Vectors and scalars, one after another."""
        return self._np.concatenate([self._np.atleast_1d(part) for part in parts])

    def rows(self, rows: Sequence[Any]) -> Array:
        """Matrix with these vectors as rows."""
        return self._np.stack(rows)

    def matrix(self, rows: Sequence[Sequence[Any]]) -> Array:
        """Matrix with these scalars."""
        return self.rows([self.vector(row) for row in rows])

    def block(self, blocks: Sequence[Sequence[Any]]) -> Array:
        return self._np.block([list(row) for row in blocks])

    def dot(self, a: Array, b: Array) -> Array:
        return a @ b

    def cross(self, a: Array, b: Array) -> Array:
        # numpy.cross is ten times slower on a single pair
        return self.vector([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


class CasadiNamespace:
    """Symbols (SX, MX) and CasADi's own numbers (DM)."""

    def __init__(self) -> None:
        import casadi

        self._ca = casadi
        self.sin, self.cos, self.sqrt = casadi.sin, casadi.cos, casadi.sqrt
        self.atan2, self.where, self.solve = casadi.atan2, casadi.if_else, casadi.solve
        self.eye, self.array, self.dot = casadi.DM.eye, casadi.DM, casadi.dot
        self.cross = casadi.cross  # written out, a quarter of a solve would go into making expressions

    def vector(self, entries: Sequence[Any]) -> Array:
        return self._ca.vertcat(*entries)

    concatenate = vector

    def rows(self, rows: Sequence[Any]) -> Array:
        return self._ca.vertcat(*[row.T for row in rows])

    def matrix(self, rows: Sequence[Sequence[Any]]) -> Array:
        return self.rows([self.vector(row) for row in rows])

    def block(self, blocks: Sequence[Sequence[Any]]) -> Array:
        return self._ca.vertcat(*[self._ca.horzcat(*row) for row in blocks])

    def jacobian(self, expression: Array, variable: Array) -> Array:
        return self._ca.jacobian(expression, variable)

    def symbol(self, size: int) -> Array:
        """A column of new SX symbols."""
        return self._ca.SX.sym("s", size)

    def substitute(self, expression: Array, symbol: Array, value: Array) -> Array:
        return self._ca.substitute(expression, symbol, value)


Namespace = NumPyNamespace | CasadiNamespace
_numpy, _casadi = cache(NumPyNamespace), cache(CasadiNamespace)


@cache
def _of_casadi(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == "casadi"


def namespace(*operands: Any) -> Namespace:
    """CasADi if any operand belongs to it, else NumPy."""
    return _casadi() if any(map(_of_casadi, map(type, operands))) else _numpy()


def symbolic() -> CasadiNamespace:
    """CasADi, for what only symbols can do."""
    return _casadi()


def cross(a: Array, b: Array) -> Array:
    """a × b of two 3-vectors."""
    return namespace(a, b).cross(a, b)


def dot(a: Array, b: Array) -> Array:
    """a · b."""
    return namespace(a, b).dot(a, b)


def norm(a: Array) -> Array:
    """Euclidean length of a vector; not differentiable at 0."""
    xp = namespace(a)
    return xp.sqrt(xp.dot(a, a))


def unit(a: Array) -> Array:
    """a / |a|."""
    return a / norm(a)


def adjugate_3x3(rows: Sequence[Array]) -> tuple[Array, Array]:
    """Adjugate and determinant of the matrix with these rows."""
    r1, r2, r3 = rows
    xp = namespace(r1, r2, r3)
    c1, c2, c3 = cross(r2, r3), cross(r3, r1), cross(r1, r2)
    return xp.rows([c1, c2, c3]).T, xp.dot(r1, c1)


def solve_3x3(rows: Sequence[Array], right: Array) -> Array:
    """X with ``rows[i] · X = right[i]`` by Cramer's rule: one division in all, no factorisation to differentiate."""
    adjugate, determinant = adjugate_3x3(rows)
    return adjugate @ right * (1.0 / determinant)
