"""The mobile manipulator: a planar arm on a base with two driven wheels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, ClassVar

from nhpocp.arrays import Array, dot, namespace
from nhpocp.bodies.hull import Hull, capsule
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, scalar, vector
from nhpocp.systems.planar import across, along, box, footprint, link, outline, wheels
from nhpocp.systems.system import Parameter, System


class MobileManipulator(System):
    r"""A planar arm on a differential-drive base, on R³ × Rⁿ, [Bayle, Fourquet & Renaud]:

        ẋ = v cos θ,   ẏ = v sin θ,   θ̇ = (v_r - v_l)/b,   v = (v_r + v_l)/2,   q̇ = u

    (x, y): the middle of the axle, θ: the heading, v_r, v_l: the speeds of the wheels' rims, b: the track. The arm of
    links l_j stands `base_offset` ahead of the axle, q_j: its joints' angles, the first from the heading. `tip`, the
    end of the arm, and `tip_angle` may be goals: the arm and the base share the way.
    """

    model: ClassVar[str] = "mobile_manipulator"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "links": Parameter("numbers", [1.0, 1.0], "l_j, of the arm's links", unit="length"),
        "base_offset": Parameter(
            "number", 0.3, "from the axle ahead to the arm's first joint", unit="length"
        ),
        "track": Parameter("positive", 0.6, "b, between the wheels", unit="length"),
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "theta": 0, "q": ["45 deg", "-90 deg"]},
        "goal": {"tip": [1.5, 2]},
        "control": {"harmonics": 2},
    }
    links: tuple[float, ...]
    base_offset: float
    track: float

    def __init__(
        self, links: Sequence[float] = (1.0, 1.0), base_offset: float = 0.3, track: float = 0.6
    ) -> None:
        parameters: dict[str, Any] = {"links": links, "base_offset": base_offset, "track": track}
        super().__init__(**parameters)
        if not self.links or not all(length > 0 for length in self.links):
            raise InvalidProblemError(
                "expected one length > 0 for each link, as in [1, 1]", path="system.links"
            )
        joints = len(self.links)
        self.state_space = StateSpace(
            [
                scalar("x", "length"),
                scalar("y", "length"),
                scalar("theta", "angle", symbol=r"\theta"),
                vector("q", joints, "angle"),
            ]
        )
        self.input_space = StateSpace(
            [
                scalar("v_right", "length", symbol="v_r"),
                scalar("v_left", "length", symbol="v_l"),
                vector("q_dot", joints, "angle", symbol=r"\dot q"),
            ]
        )
        self.output_blocks = (
            vector("tip", 2, "length", symbol="e", words="end of the arm", of_pose=True),
            scalar("tip_angle", "angle", symbol=r"\theta_e", words="heading of the last link", of_pose=True),
        )

    def vector_fields(self, state: Array) -> Array:
        xp, n = namespace(state), len(self.links)
        c, s, turn = 0.5 * xp.cos(state[2]), 0.5 * xp.sin(state[2]), 1.0 / self.track
        still = [0.0] * n
        base = [[c, c, *still], [s, s, *still], [turn, -turn, *still]]
        arm = [[0.0, 0.0, *(1.0 if i == k else 0.0 for k in range(n))] for i in range(n)]
        return xp.matrix([*base, *arm])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The speed of the axle across the wheels."""
        return namespace(state, velocity).vector([dot(velocity[:2], across(state[2]))])

    def _arm(self, state: Array) -> tuple[list[Array], Array]:
        """The arm's joints and its tip (2,) each, and the heading of the last link."""
        heading = state[2]
        places = [state[:2] + self.base_offset * along(heading)]
        for i, length in enumerate(self.links):
            heading = heading + state[3 + i]
            places.append(places[-1] + length * along(heading))
        return places, heading

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        places, heading = self._arm(state)
        return {"tip": places[-1], "tip_angle": heading}

    def default_length_scale(self) -> float:
        return max(self.links)

    def bodies(self, state: Array) -> dict[str, Hull]:
        """The base, and the links, which reach over it; a link touches its neighbours."""
        (places, _), half = self._arm(state), 0.5 * self.track
        front, thick = max(self.base_offset + 0.3 * half, half), 0.06 * max(self.links)
        bodies = {"base": footprint(state[:2], state[2], box(-0.8 * half, front, 1.2 * half))}
        for i, (start, end) in enumerate(pairwise(places), start=1):
            bodies[f"link {i}"] = capsule(start, end, thick).touching("base", f"link {i - 1}")
        return bodies

    def drawing(self, state: Array) -> dict[str, Any]:
        """The base with its two wheels, and the arm."""
        xp, (places, _), half = namespace(state), self._arm(state), 0.5 * self.track
        front, thick = max(self.base_offset + 0.3 * half, half), 0.06 * max(self.links)
        arm = {f"link {i + 1}": link(*ends, thick) for i, ends in enumerate(pairwise(places))}
        return {
            "lines": {
                **wheels("wheel", state[:2], state[2], half, 1.6 * self.track),
                "base": outline(state[:2], state[2], box(-0.8 * half, front, 0.9 * half)),
                **arm,
            },
            "points": {"joints": xp.rows(places[:-1]), "tip": xp.rows([places[-1]])},
            "trace": places[-1],
        }
