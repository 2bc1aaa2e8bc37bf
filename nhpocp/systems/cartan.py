"""Rank-two distributions of a car's kind: Cartan's (2, 3, 5), flat, and Engel's (2, 3, 4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.system import System


class Engel(System):
    r"""The flat system with growth vector (2, 3, 4) on R⁴, [Ardentov & Sachkov]:

        ẋ = u1,   ẏ = u2,   ż = ½ (x u2 - y u1),   v̇ = ½ (x² + y²) u2

    z is the area that (x, y) sweeps, v a moment of it. Every system with this growth vector looks so from near by.
    """

    model: ClassVar[str] = "engel"
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "z": 0, "v": 0},
        "goal": {"x": 0, "y": 0, "z": 0, "v": 0.5},
        "control": {"harmonics": 2, "initial": [[0, 1, 0, 0, 1], [0, 0, 1, 1, 0]]},
    }
    state_space = StateSpace([scalar("x"), scalar("y"), scalar("z"), scalar("v")])
    input_space = StateSpace([scalar("u1"), scalar("u2")])

    def vector_fields(self, state: Array) -> Array:
        return namespace(state).matrix(_rows(state)[:4])

    def constraints(self, state: Array, velocity: Array) -> Array:
        return namespace(state, velocity).vector(_residuals(state, velocity)[:2])

    def drawing(self, state: Array) -> dict[str, Any]:
        """(x, y) in the plane, the area z as height above it."""
        xp = namespace(state)
        foot, tip = xp.vector([state[0], state[1], 0.0]), state[:3]
        return {"lines": {"area z": xp.rows([foot, tip])}, "points": {"x, y": xp.rows([foot])}, "trace": tip}


class Cartan(Engel):
    r"""The flat system with growth vector (2, 3, 5) on R⁵, [Sachkov]:

        ẋ = u1,   ẏ = u2,   ż = ½ (x u2 - y u1),   v̇ = ½ (x² + y²) u2,   ẇ = -½ (x² + y²) u1

    Straight lines in (x, y) are abnormal extremals: the end point's Jacobian loses rank along them, so that a goal on
    one, 0 → (1, 0, 0, 0, -1/6) at cost 1, is reached by no regular control near it. Balls that roll
    on a plane or on another ball look so from near by.
    """

    model: ClassVar[str] = "cartan"
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "z": 0, "v": 0, "w": 0},
        "goal": {"x": 0, "y": 0, "z": 0, "v": 0.5, "w": 0},
        "control": {"harmonics": 2, "initial": [[0, 1, 0, 0, 1], [0, 0, 1, 1, 0]]},
    }
    state_space = StateSpace([*Engel.state_space.blocks, scalar("w")])

    def vector_fields(self, state: Array) -> Array:
        return namespace(state).matrix(_rows(state))

    def constraints(self, state: Array, velocity: Array) -> Array:
        return namespace(state, velocity).vector(_residuals(state, velocity))


def _rows(state: Array) -> list[list[Array]]:
    half = 0.5 * (state[0] ** 2 + state[1] ** 2)
    return [[1.0, 0.0], [0.0, 1.0], [-0.5 * state[1], 0.5 * state[0]], [0.0, half], [-half, 0.0]]


def _residuals(state: Array, velocity: Array) -> list[Array]:
    half = 0.5 * (state[0] ** 2 + state[1] ** 2)
    swept = 0.5 * (state[0] * velocity[1] - state[1] * velocity[0])
    moments = [velocity[3] - half * velocity[1]]
    return [
        velocity[2] - swept,
        *moments,
        *([velocity[4] + half * velocity[0]] if state.shape[0] == 5 else []),
    ]
