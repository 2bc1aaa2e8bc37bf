"""Systems of the textbooks whose brackets go deep: cars, trailers, chained form, Engel's and Cartan's distributions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import namespace
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.system import Parameter, System

TWO = StateSpace([scalar("u1"), scalar("u2")])


class Car(System):
    """ẋ = v cos θ, ẏ = v sin θ, θ̇ = v tan φ / L, φ̇ = w: growth (2, 3, 4)."""

    model: ClassVar[str] = "car"
    declared: ClassVar[Mapping[str, Parameter]] = {"wheelbase": Parameter("positive", 1.0, "L [length]")}
    state_space = StateSpace(
        [scalar("x", "length"), scalar("y", "length"), scalar("theta", "angle"), scalar("phi", "angle")]
    )
    input_space = StateSpace([scalar("v", "length"), scalar("w", "angle")])
    wheelbase: float

    def vector_fields(self, state: Any) -> Any:
        xp, theta, phi = namespace(state), state[2], state[3]
        turn = xp.sin(phi) / xp.cos(phi) / self.wheelbase
        return xp.matrix([[xp.cos(theta), 0], [xp.sin(theta), 0], [turn, 0], [0, 1]])


class Trailers(System):
    """A unicycle with trailers, θ̇_i = v_{i-1} sin(θ_{i-1} - θ_i) / d_i and v_i = v_{i-1} cos(θ_{i-1} - θ_i)."""

    model: ClassVar[str] = "trailers"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "lengths": Parameter("numbers", (1.0, 1.0), "d_i [length]")
    }
    input_space = StateSpace([scalar("v", "length"), scalar("w", "angle")])
    lengths: tuple[float, ...]

    def __init__(self, **parameters: Any) -> None:
        super().__init__(**parameters)
        angles = [scalar(f"theta{i}", "angle") for i in range(len(self.lengths) + 1)]
        self.state_space = StateSpace([scalar("x", "length"), scalar("y", "length"), *angles])

    def vector_fields(self, state: Any) -> Any:
        xp, speed = namespace(state), 1.0
        rows = [[xp.cos(state[2]), 0], [xp.sin(state[2]), 0], [0, 1]]
        for i, length in enumerate(self.lengths):
            bend = state[2 + i] - state[3 + i]
            rows.append([speed * xp.sin(bend) / length, 0])
            speed = speed * xp.cos(bend)
        return xp.matrix(rows)


class Chained5(System):
    """ẋ1 = u1, ẋ2 = u2, ẋ3 = x2 u1, ẋ4 = x3 u1, ẋ5 = x4 u1."""

    model: ClassVar[str] = "chained5"
    state_space = StateSpace([scalar(f"x{i}") for i in range(1, 6)])
    input_space = TWO

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).matrix([[1, 0], [0, 1], [state[1], 0], [state[2], 0], [state[3], 0]])


class Engel(System):
    """ẋ = u1, ẏ = u2, ż = ½ (x u2 - y u1), v̇ = ½ (x² + y²) u2: growth (2, 3, 4)."""

    model: ClassVar[str] = "engel"
    state_space = StateSpace([scalar(name) for name in "xyzv"])
    input_space = TWO

    def vector_fields(self, state: Any) -> Any:
        x, y = state[0], state[1]
        return namespace(state).matrix([[1, 0], [0, 1], [-0.5 * y, 0.5 * x], [0, 0.5 * (x * x + y * y)]])


class Cartan(System):
    """Engel's, and ẇ = -½ (x² + y²) u1: growth (2, 3, 5)."""

    model: ClassVar[str] = "cartan"
    state_space = StateSpace([scalar(name) for name in "xyzvw"])
    input_space = TWO

    def vector_fields(self, state: Any) -> Any:
        x, y = state[0], state[1]
        half = 0.5 * (x * x + y * y)
        return namespace(state).matrix([[1, 0], [0, 1], [-0.5 * y, 0.5 * x], [0, half], [-half, 0]])


EVERY = (Car(), Trailers(), Trailers(lengths=(1.0, 1.0, 1.0)), Chained5(), Engel(), Cartan())
