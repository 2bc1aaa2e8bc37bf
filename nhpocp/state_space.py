"""Named blocks of R^n × SO(3)^k: how a state is packed, moved and compared.

A point is one flat vector of ``size`` numbers, a rotation taking nine (its rows, platform to base). A tangent vector
has ``dimension`` numbers, a rotation taking three: the angular velocity ω in base coordinates, Ṙ = [ω] R.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import pi, prod
from typing import Any, ClassVar, Literal, get_args

from nhpocp import so3
from nhpocp.arrays import Array, namespace, norm
from nhpocp.constructed import Constructed
from nhpocp.declared import Degrees, degrees_hint, whole_number
from nhpocp.errors import InvalidProblemError, describe, expect
from nhpocp.frozen import Frozen
from nhpocp.written_numbers import numbers_in

Kind = Literal["vector", "scalar", "rotation", "direction", "matrix"]
Unit = Literal["length", "angle", ""]
deg = Degrees(pi / 180)  # in radians, the unit of every angle in Python: `30 * deg` is a file's `30 deg`
UNIT_WORDS = {"length": "[length]", "angle": "[rad]", "": ""}


@dataclass(frozen=True)
class Block(Constructed):
    """One named quantity: a part of a state or of an input, or an output, and all that is known of it.

    `vector`, `scalar`, `rotation`, `direction` and `matrix` make them; a direction, a unit vector, and a matrix are
    outputs only. name: printable. kind: one of these five. components: numbers of a vector, or in each row of a matrix;
    rows: of a matrix. unit: "length", "angle" [rad], or "". symbol: how formulas call it, LaTeX without $; none: by its
    name. words: how axes call it besides. wraps: angles that jump by 2π where they are cut. of_pose: an output that
    depends on the state alone, so that it may be a goal. rate: the power of time that divides it; inputs are rates
    by themselves. entries: what its numbers are called in messages, where that is not 1, 2, ….
    Errors: `InvalidProblemError` for an unknown kind or unit, or numbers of components that are none.
    """

    name: str
    kind: Kind
    components: int = 1  # numbers of a vector, or in each row of a matrix
    unit: Unit = ""
    symbol: str = field(default="", compare=False)
    words: str = field(default="", compare=False, kw_only=True)
    rows: int = 1  # of a matrix
    wraps: bool = False
    of_pose: bool = False
    rate: int = 0
    entries: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        path = f"block {self.name!r}"
        expect(self.name, str, "a name", "block")
        if self.kind not in get_args(Kind):
            words = f"kind {self.kind!r}; expected one of {', '.join(get_args(Kind))}"
            raise InvalidProblemError(words, path=path)
        if self.unit not in UNIT_WORDS:
            words = f"unit {self.unit!r}; expected 'length', 'angle', or '' for none"
            raise InvalidProblemError(words, path=path)
        whole_number(self.components, path)
        whole_number(self.rows, path)

    @property
    def size(self) -> int:
        """Numbers in a packed point."""
        return prod(self.shape)

    @property
    def dimension(self) -> int:
        """Numbers in a tangent vector."""
        return {"rotation": 3, "direction": 2}.get(self.kind, self.size)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the block's value."""
        shapes = {"scalar": (), "rotation": (3, 3), "direction": (3,), "matrix": (self.rows, self.components)}
        return shapes.get(self.kind, (self.components,))

    @property
    def written(self) -> str:
        """How a value is written, in messages."""
        kinds = {"rotation": "{rpy: [roll, pitch, yaw]}", "direction": "[x, y, z]", "scalar": "number"}
        return kinds.get(self.kind, f"[{self.components} numbers]")

    def checked(self, value: Any) -> Array:
        """A value for this block as numbers of its `shape`, as problem files write it or as an array.

        Rotations are made exact, directions unit vectors. Errors: `InvalidProblemError`, its path inside the value.
        """
        import numpy as np

        if self.kind == "rotation" and isinstance(value, Mapping):
            return so3.from_mapping(value)
        try:
            value = numbers_in(value)
            if np.asarray(value).dtype.kind in "bUS":  # NumPy would read texts and truth values as numbers
                raise ValueError
            numbers = np.array(value, dtype=float)
        except (TypeError, ValueError):
            words = f"expected {self.written}, got {describe(value)}{degrees_hint(value)}"
            raise InvalidProblemError(words) from None
        if numbers.shape != self.shape:
            if len(self.shape) == 1 == numbers.ndim:
                raise InvalidProblemError(f"{len(numbers)} numbers; expected {self.shape[0]}")
            raise InvalidProblemError(f"expected {self.written}, got {describe(value)}")
        if not np.isfinite(numbers).all():
            raise InvalidProblemError("NaN or infinity; expected finite numbers")
        if self.kind == "rotation":
            return so3.on_group(numbers)
        if self.kind == "direction":
            length = float(norm(numbers))
            if length < 1e-9:
                raise InvalidProblemError("the zero vector; expected a direction")
            # else it would change each time it is read
            return numbers if abs(length - 1) < 1e-15 else numbers / length
        return numbers

    @property
    def labels(self) -> list[str]:
        """One column name per packed number."""
        places = product(*(range(size) for size in self.shape))
        return [self.name + "".join(f"[{i}]" for i in place) for place in places]


def vector(name: str, components: int, unit: Unit = "", **known: Any) -> Block:
    """A vector (components,) of a state, an input or an output.

    name: of the trajectory's entry. components: how many numbers. unit: "length", "angle" [rad], or "" for none. known:
    more of a `Block`, such as symbol, wraps, of_pose.
    Errors: `InvalidProblemError` for another unit, or components that are no whole number.
    """
    return Block(name, "vector", components, unit, **known)


def scalar(name: str, unit: Unit = "", **known: Any) -> Block:
    """A number of a state, an input or an output.

    name: of the trajectory's entry. unit: "length", "angle" [rad], or "" for none. known: more of a `Block`, such as
    symbol, wraps, of_pose.
    Errors: `InvalidProblemError` for another unit.
    """
    return Block(name, "scalar", 1, unit, **known)


def rotation(name: str, symbol: str = "R") -> Block:
    """A rotation (3, 3) of a state, platform to base: Ṙ = [ω] R with ω in base coordinates [rad per time].

    name: of the trajectory's entry. symbol: how formulas call it.
    Errors: `InvalidProblemError` for a name that is no text.
    """
    return Block(name, "rotation", 3, "angle", symbol)


def direction(name: str, **known: Any) -> Block:
    """A unit vector (3,) among the outputs.

    name: of the trajectory's entry. known: more of a `Block`, such as symbol, and of_pose where it may be a goal.
    Errors: `InvalidProblemError` for a name that is no text.
    """
    return Block(name, "direction", 3, "angle", **known)


def matrix(name: str, rows: int, columns: int, unit: Unit = "", **known: Any) -> Block:
    """A matrix (rows, columns) among the outputs.

    name: of the trajectory's entry. rows, columns: how many. unit: "length", "angle" [rad], or "" for none. known: more
    of a `Block`, such as symbol, wraps.
    Errors: `InvalidProblemError` for another unit, or sizes that are no whole numbers.
    """
    return Block(name, "matrix", columns, unit, rows=rows, **known)


def shaped(name: str, shape: tuple[int, ...]) -> Block:
    """A block of which nothing is known but the shape of its value, () to (rows, columns)."""
    if len(shape) == 2:
        return matrix(name, shape[0], shape[1])
    return vector(name, shape[0]) if shape else scalar(name)


def check_distinct(parts: Iterable[tuple[str, Block]]) -> None:
    """Names of parts of a state or trajectory: printable, and none twice, among those of the parts' numbers either.

    parts: what it is, and its block. Errors: `InvalidProblemError`, as for `x[0]` beside the vector `x`.
    """
    taken: dict[str, str] = {}
    for what, block in parts:
        name, labels = block.name, block.labels
        words, names = f"{what} {name!r}", dict.fromkeys([name, *labels])
        if not name or not name.isprintable():
            raise InvalidProblemError(f"{words}: expected a name of one or more printable characters")
        for each in names:
            if each in taken:
                both = f"{taken[each]} and {words}"
                raise InvalidProblemError(f"{both} are both called {each!r}; rename one of them")
        taken |= dict.fromkeys(names, words)


class StateSpace(Frozen):
    """A product of blocks, in order. Points may be numbers or CasADi symbols.

    blocks: made by `vector`, `scalar` and `rotation`. A point is packed (size,), a rotation as nine numbers row by row;
    a tangent vector has (dimension,) numbers, three for a rotation.
    Errors: `InvalidProblemError` for two of one name, or a block that is an output only.
    """

    noun: ClassVar[str] = "space"

    def __init__(self, blocks: Sequence[Block]) -> None:
        for block in blocks if isinstance(blocks, list | tuple) else [blocks]:
            expect(block, Block, "a list of blocks such as [vector('position', 3, 'length')]", "StateSpace")
        self.blocks = tuple(blocks)
        self.names = tuple(block.name for block in blocks)
        self.size = sum(block.size for block in blocks)
        self.dimension = sum(block.dimension for block in blocks)
        self._points: dict[str, slice] = {}
        self._tangents: dict[str, slice] = {}
        point = tangent = 0
        for block in blocks:
            if block.kind in ("direction", "matrix"):
                raise InvalidProblemError(f"{block.name} is a {block.kind}: an output, not a part of a state")
            self._points[block.name] = slice(point, point + block.size)
            self._tangents[block.name] = slice(tangent, tangent + block.dimension)
            point, tangent = point + block.size, tangent + block.dimension
        check_distinct([("block", block) for block in blocks])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StateSpace) and self.blocks == other.blocks

    def __hash__(self) -> int:
        return hash(self.blocks)

    def with_(self, **changes: Any) -> StateSpace:
        """A state space of these blocks, or of others: ``blocks``."""
        return StateSpace(**{"blocks": self.blocks, **changes})

    def __repr__(self) -> str:
        return f"StateSpace({', '.join(f'{block.name}: {block.kind}{list(block.shape)}' for block in self.blocks)})"

    @property
    def labels(self) -> list[str]:
        """One column name per number of a packed point."""
        return [label for block in self.blocks for label in block.labels]

    @property
    def tangent_units(self) -> list[Unit]:
        """The unit of each tangent number: length, angle, or none."""
        return [block.unit for block in self.blocks for _ in range(block.dimension)]

    @property
    def tangent_labels(self) -> list[str]:
        """One name per tangent number."""
        return [
            block.name if block.kind == "scalar" else f"{block.name}[{i}]"
            for block in self.blocks
            for i in range(block.dimension)
        ]

    def tangent_slice(self, name: str) -> slice:
        """Where a block's velocity stands in a tangent vector."""
        return self._tangents[name]

    def point_slice(self, name: str) -> slice:
        """Where a block's numbers stand in a packed point."""
        return self._points[name]

    def pack(self, values: Mapping[str, Any]) -> Array:
        """One flat point (size,) from a value per block."""
        missing = [name for name in self.names if name not in values]
        unknown = [name for name in values if name not in self.names]
        if missing or unknown:
            wrong = {"missing": missing, "unknown": unknown}
            said = [f"{what}: {', '.join(names)}" for what, names in wrong.items() if names]
            raise InvalidProblemError("; ".join([f"a state needs exactly {', '.join(self.names)}", *said]))
        xp = namespace(*values.values())
        parts = []
        for block in self.blocks:
            value = values[block.name]
            if block.kind == "rotation":
                rows = xp.array(value) if isinstance(value, list) else value
                parts += [rows[i, :].T for i in range(3)]
            else:
                parts.append(value)
        return xp.concatenate(parts)

    def unpack(self, point: Array) -> dict[str, Array]:
        """A value per block: (n,) vectors, scalars, 3×3 rotations."""
        xp = namespace(point)
        values = {}
        for block in self.blocks:
            part = point[self._points[block.name]]
            if block.kind == "rotation":
                part = xp.rows([part[0:3], part[3:6], part[6:9]])
            elif block.kind == "scalar":
                part = part[0]
            values[block.name] = part
        return values

    def split(self, points: Array) -> dict[str, Array]:
        """A NumPy array (samples, size) as one array per block: (samples,) + block.shape."""
        return {
            block.name: points[:, self._points[block.name]].reshape((len(points), *block.shape))
            for block in self.blocks
        }

    def lift(self, point: Array, velocity: Array) -> Array:
        """Time derivative (size,) of the packed point for a tangent vector (dimension,): Ṙ = [ω] R."""
        xp, values = namespace(point, velocity), self.unpack(point)
        parts = []
        for block in self.blocks:
            part = velocity[self._tangents[block.name]]
            if block.kind == "rotation":
                rate = so3.hat(part) @ values[block.name]
                parts += [rate[i, :].T for i in range(3)]
            else:
                parts.append(part)
        return xp.concatenate(parts)

    def lower(self, point: Array, rate: Array) -> Array:
        """The tangent vector (dimension,) of a packed derivative: ω = vee(Ṙ Rᵀ). `lower(x, lift(x, ξ)) = ξ`."""
        xp, values = namespace(point, rate), self.unpack(point)
        parts = []
        for block in self.blocks:
            part = rate[self._points[block.name]]
            if block.kind == "rotation":
                part = so3.vee(xp.rows([part[0:3], part[3:6], part[6:9]]) @ values[block.name].T)
            parts.append(part)
        return xp.concatenate(parts)

    def retract(self, point: Array, tangent: Array) -> Array:
        """The point reached by a tangent vector: x + δ, and exp(δ) R for rotations."""
        xp, values = namespace(point, tangent), self.unpack(point)
        parts = []
        for block in self.blocks:
            part = tangent[self._tangents[block.name]]
            if block.kind == "rotation":
                turned = so3.exp(part) @ values[block.name]
                parts += [turned[i, :].T for i in range(3)]
            else:
                parts.append(point[self._points[block.name]] + part)
        return xp.concatenate(parts)

    def difference(self, point: Array, origin: Array) -> Array:
        """The tangent vector from ``origin`` to ``point``: x - x₀, and log(R R₀ᵀ). [Paper] eq. (8), misprint mended.

        Errors: `OrientationAtPiError` for numbers where the rotations differ by a half turn.
        """
        xp = namespace(point, origin)
        here, there = self.unpack(point), self.unpack(origin)
        parts = []
        for block in self.blocks:
            if block.kind == "rotation":
                parts.append(so3.log(here[block.name] @ there[block.name].T))
            else:
                parts.append(here[block.name] - there[block.name])
        return xp.concatenate(parts)

    def chart(self, coordinates: Array, origin: Array) -> Array:
        """The point with local coordinates (dimension,) about an origin: a rational `retract` (`so3.cayley`)."""
        xp, values = namespace(coordinates, origin), self.unpack(origin)
        parts = []
        for block in self.blocks:
            part = coordinates[self._tangents[block.name]]
            if block.kind == "rotation":
                turned = so3.cayley(part) @ values[block.name]
                parts += [turned[i, :].T for i in range(3)]
            else:
                parts.append(origin[self._points[block.name]] + part)
        return xp.concatenate(parts)

    def coordinates(self, point: Array, origin: Array) -> Array:
        """The local coordinates of a point about an origin; `chart` undone."""
        xp = namespace(point, origin)
        here, there = self.unpack(point), self.unpack(origin)
        parts = []
        for block in self.blocks:
            if block.kind == "rotation":
                parts.append(so3.cayley_inverse(here[block.name] @ there[block.name].T))
            else:
                parts.append(here[block.name] - there[block.name])
        return xp.concatenate(parts)

    def nearest(self, point: Array) -> Array:
        """The packed numbers (…, size) with their rotations made exact; a fixed-step integrator leaves SO(3)."""
        import numpy as np

        exact = np.array(point, dtype=float)
        for block in self.blocks:
            if block.kind == "rotation":
                entries = exact[..., self._points[block.name]]
                rotations = so3.nearest(entries.reshape((*exact.shape[:-1], 3, 3)))
                exact[..., self._points[block.name]] = rotations.reshape(entries.shape)
        return exact

    def weights(self, error_length: float) -> list[float]:
        """One weight per tangent number: 1/error_length for lengths, 1 for the rest."""
        return [1.0 / error_length if unit == "length" else 1.0 for unit in self.tangent_units]

    def distance(self, point: Array, origin: Array, error_length: float = 1.0) -> Array:
        """E = √(|Δp/error_length|² + |r|²), [Paper] section 4 with the length made explicit."""
        xp = namespace(point, origin)
        return norm(xp.array(self.weights(error_length)) * self.difference(point, origin))
