r"""Lie brackets of a system's vector fields on R^n × SO(3)^k, along Philip Hall's basis of the free Lie algebra.

A field X gives a point x the tangent vector X(x), rotations in base coordinates: Ṙ = [ω] R. On the packed point, with
X̃ = lift(x, X), the bracket is [X̃, Ỹ] = DỸ X̃ - DX̃ Ỹ. Lowered to tangent numbers that is
    [X, Y] = DY X̃ - DX Ỹ,   and   - ω_X × ω_Y   besides in the rows of a rotation:
D([ω_Y] R) X̃ = [DωY X̃] R + [ω_Y][ω_X] R, and the commutator of the hats is [ω_Y][ω_X] - [ω_X][ω_Y] = -[ω_X × ω_Y].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np

from nhpocp.arrays import Array, cross
from nhpocp.calls import call, mapped
from nhpocp.state_space import StateSpace
from nhpocp.systems.system import System

MOST_OPERATIONS = 40_000  # of the brackets of one degree: up to three seconds to make


@dataclass(frozen=True)
class Word:
    """An element of a Hall basis: a generator, or the bracket of two earlier elements."""

    degree: int
    letter: int = -1  # of a generator
    parts: tuple[Word, Word] | None = None

    def written(self, names: Sequence[str]) -> str:
        """The word with these names of the generators, [a, [a, b]] say."""
        if self.parts is None:
            return names[self.letter]
        return f"[{self.parts[0].written(names)}, {self.parts[1].written(names)}]"


def hall_words(letters: int, degree: int) -> list[list[Word]]:
    """Hall's basis of the free Lie algebra, a list a degree. [Hall]

    [A, B] belongs to it if A and B do, A < B, and B = [C, D] has C ≤ A; elements are ordered by degree, then by age.
    """
    layers = [[Word(1, letter) for letter in range(letters)]]
    age = {word: i for i, word in enumerate(layers[0])}
    for d in range(2, degree + 1):
        layer = [
            Word(d, parts=(a, b))
            for low in range(1, d // 2 + 1)
            for a, b in product(layers[low - 1], layers[d - low - 1])
            if age[a] < age[b] and (b.parts is None or age[b.parts[0]] <= age[a])
        ]
        age.update({word: len(age) + i for i, word in enumerate(layer)})
        layers.append(layer)
    return layers


def bracket(space: StateSpace, x: ca.SX, first: ca.SX, second: ca.SX) -> ca.SX:
    """[X, Y] of two fields (dimension,) of the packed point x, by directional derivatives; no Jacobian is formed."""
    field = ca.jtimes(second, x, space.lift(x, first)) - ca.jtimes(first, x, space.lift(x, second))
    for block in space.blocks:
        if block.kind == "rotation":
            part = space.tangent_slice(block.name)
            field[part] = field[part] - cross(first[part], second[part])
    return field


@dataclass(frozen=True)
class Layer:
    """The brackets of one degree that do not vanish identically.

    words: theirs. values: dimension × words, of the packed point x.
    """

    words: list[Word]
    x: ca.SX
    values: ca.SX

    @cached_property
    def function(self) -> ca.Function:
        """x ↦ the values."""
        (values,) = ca.cse([self.values])
        return ca.Function("brackets", [self.x], [values], ["x"], ["values"])

    def at(self, points: Array) -> Array:
        """Values at points (k, size), (k, dimension, words)."""
        (values,) = call(mapped(self.function, len(points)), points)
        return values.reshape(len(points), len(self.words), -1).swapaxes(1, 2)


class LieAlgebra:
    """The brackets of a system's fields g1, …, gm, and of its drift f if it has one, made degree by degree."""

    def __init__(self, system: System) -> None:
        self._space = system.state_space
        self._x = ca.SX.sym("x", self._space.size)
        columns = ca.horzsplit(ca.densify(ca.SX(system.vector_fields(self._x))))
        self.names = list(system.input_space.labels)
        if not system.driftless:
            columns = [ca.SX(system.drift(self._x)), *columns]
            self.names = ["f", *self.names]
        self.drifting = not system.driftless
        self._fields = dict(zip(hall_words(len(columns), 1)[0], ca.cse(columns), strict=True))
        self.layers = [self._layer(list(self._fields))]

    def deepen(self) -> bool:
        """Adds the brackets of the next degree; False where all of them vanish, and hence all later ones, too.

        Errors: `TooLargeError` where they would take more than `MOST_OPERATIONS`.
        """
        words = hall_words(len(self.names), len(self.layers) + 1)[-1]
        alive = [word for word in words if word.parts and all(part in self._fields for part in word.parts)]
        last = self.layers[-1]
        # a directional derivative along each of two fields costs about three times the field itself, each
        expected = 3 * last.function.n_instructions() * len(alive) / max(len(last.words), 1)
        if expected > MOST_OPERATIONS:
            raise TooLargeError(f"{len(alive)} brackets of degree {len(self.layers) + 1}")
        for word in alive:
            first, second = (self._fields[part] for part in word.parts or ())
            value = ca.sparsify(bracket(self._space, self._x, first, second))
            if value.nnz():
                self._fields[word] = ca.densify(value)
        fresh = [word for word in alive if word in self._fields]
        if fresh:
            self.layers.append(self._layer(fresh))
        return bool(fresh)

    def _layer(self, words: list[Word]) -> Layer:
        return Layer(words, self._x, ca.densify(ca.horzcat(*[self._fields[word] for word in words])))


class TooLargeError(ArithmeticError):
    """Brackets that would take too long to make."""


def factors(layer: Layer, generators: Array) -> Array:
    """The product of the generators' factors (letters,) in every word of a layer, (words,)."""
    return np.array([_factor(word, generators) for word in layer.words])


def _factor(word: Word, generators: Array) -> float:
    if word.parts is None:
        return float(generators[word.letter])
    return _factor(word.parts[0], generators) * _factor(word.parts[1], generators)
