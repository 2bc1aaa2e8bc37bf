"""Masses that forces push: the simplest system with drift."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, vector
from nhpocp.systems.system import Parameter, System


class DoubleIntegrator(System):
    r"""n masses of one each on R²ⁿ, [Bryson & Ho]:

        q̈ = u

    With drift: what moves goes on moving. From rest to rest over a distance d in time T, ∫u² is at least 12 d²/T³, and
    with |u| ≤ 1 the time is at least 2 √d.
    """

    model: ClassVar[str] = "double_integrator"
    declared: ClassVar[Mapping[str, Parameter]] = {"n": Parameter("integer", 1, "coordinates; at least 1")}
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"q": [-1], "q_dot": [0]},
        "goal": {"q": [0], "q_dot": [0]},
        "control": {"harmonics": 1, "initial": [[0, 3, 0]]},
    }
    n: int

    def __init__(self, n: int = 1) -> None:
        super().__init__(n=n)
        if self.n < 1:
            raise InvalidProblemError(f"{self.n}; expected a whole number of at least 1", path="system.n")
        self.state_space = StateSpace(
            [vector("q", self.n, "length"), vector("q_dot", self.n, "length", symbol=r"\dot q", rate=True)]
        )
        self.input_space = StateSpace([vector("u", self.n, "length")])
        self.plotted = ("q", r"\dot q") if self.n == 1 else ()

    def vector_fields(self, state: Array) -> Array:
        xp = namespace(state)
        return xp.block([[xp.array([[0.0] * self.n] * self.n)], [xp.eye(self.n)]])

    def drift(self, state: Array) -> Array:
        return namespace(state).concatenate([state[self.n :], namespace(state).array([0.0] * self.n)])

    def constraints(self, state: Array, velocity: Array) -> Array:
        return velocity[: self.n] - state[self.n :]

    def drawing(self, state: Array) -> dict[str, Any]:
        """The mass in the plane of its first two coordinates, or in the phase plane (q, q̇), and its velocity."""
        xp = namespace(state)
        here, tip = state[:2], state[:2] + 0.2 * state[self.n : self.n + 2]
        if self.n == 1:
            tip = xp.vector([state[0], 0.0])
        return {
            "lines": {"velocity": xp.rows([here, tip])},
            "points": {"mass": xp.rows([here])},
            "trace": here,
        }
