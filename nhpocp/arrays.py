"""One text for CasADi and NumPy: the few operations that the formulas of this package need.

``namespace(x)`` looks at the operands and returns the library that can work on them, so that a formula written
once gives numbers for numbers and symbols for symbols. Both libraries are imported only when first asked for,
which lets the systems declare their names and parameters without either.
Vectors are (n,) arrays in NumPy and n×1 columns in CasADi; ``A @ x`` means the same in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from nhpocp.errors import UnknownNameError, suggestion

Array = Any  # np.ndarray, or a CasADi SX, MX or DM


class _Functions:
    """What both libraries offer under NumPy's names."""

    pi = math.pi

    if not TYPE_CHECKING:  # who checks types sees what there is

        def __getattr__(self, name: str) -> Any:
            known = [each for each in [*vars(self), *dir(type(self))] if not each.startswith("_")]
            near = suggestion(name, known)
            raise UnknownNameError(f"namespace(…) has no {name!r}, for it has to work on symbols too; {near}")


class NumPyNamespace(_Functions):
    """Numbers."""

    def __init__(self) -> None:
        import numpy

        self._np = numpy
        self.sin, self.cos, self.tan = numpy.sin, numpy.cos, numpy.tan
        self.arcsin, self.arccos, self.arctan = numpy.arcsin, numpy.arccos, numpy.arctan
        self.arctan2 = self.atan2 = numpy.arctan2
        self.sinh, self.cosh, self.tanh = numpy.sinh, numpy.cosh, numpy.tanh
        self.arcsinh, self.arccosh, self.arctanh = numpy.arcsinh, numpy.arccosh, numpy.arctanh
        self.exp, self.log, self.log10, self.sqrt = numpy.exp, numpy.log, numpy.log10, numpy.sqrt
        self.abs, self.sign, self.floor, self.ceil = numpy.abs, numpy.sign, numpy.floor, numpy.ceil
        self.minimum, self.maximum, self.hypot = numpy.minimum, numpy.maximum, numpy.hypot
        self.where, self.solve, self.eye, self.sum = numpy.where, numpy.linalg.solve, numpy.eye, numpy.sum

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


class CasadiNamespace(_Functions):
    """Symbols (SX, MX) and CasADi's own numbers (DM)."""

    def __init__(self) -> None:
        import casadi

        self._ca = casadi
        self.sin, self.cos, self.tan = casadi.sin, casadi.cos, casadi.tan
        self.arcsin, self.arccos, self.arctan = casadi.arcsin, casadi.arccos, casadi.arctan
        self.arctan2 = self.atan2 = casadi.arctan2
        self.sinh, self.cosh, self.tanh = casadi.sinh, casadi.cosh, casadi.tanh
        self.arcsinh, self.arccosh, self.arctanh = casadi.arcsinh, casadi.arccosh, casadi.arctanh
        self.exp, self.log, self.log10, self.sqrt = casadi.exp, casadi.log, casadi.log10, casadi.sqrt
        self.abs, self.sign, self.floor, self.ceil = casadi.fabs, casadi.sign, casadi.floor, casadi.ceil
        self.minimum, self.maximum, self.hypot = casadi.fmin, casadi.fmax, casadi.hypot
        self.where, self.solve = casadi.if_else, casadi.solve
        self.eye, self.array, self.dot, self.sum = casadi.DM.eye, casadi.DM, casadi.dot, casadi.sum1
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

    def along(self, expression: Array, variable: Array, direction: Array) -> Array:
        """The derivative of an expression in one direction of a variable, shorter than `jacobian` @ direction."""
        return self._ca.jtimes(expression, variable, direction)

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
    """The functions that work on these operands: CasADi's if any of them is a symbol, else NumPy's.

    operands: the arrays, numbers or symbols that a formula is made of, any shape. `xp = namespace(state)` has, under
    NumPy's names, sin, cos, tan, arcsin, arccos, arctan, arctan2, sinh, cosh, tanh and their inverses, exp, log, log10,
    sqrt, abs, sign, floor, ceil, minimum, maximum, hypot, where, sum, pi (angles in radians); `vector(entries)` (n,),
    `matrix(rows)` of scalars and `rows(vectors)` (m, n), `concatenate(parts)`, `block(blocks)`, `array(numbers)`,
    `eye(n)`, `dot(a, b)`, `cross(a, b)`, `solve(A, b)`. A formula written with it gives numbers for numbers and symbols
    for symbols; `math.cos` and `numpy.cos` know no symbols.
    Errors: `UnknownNameError` for a function that is none of these.
    """
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
