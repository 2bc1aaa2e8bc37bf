"""A truck that pulls trailers, with what its driver can do: engine and steering wheel answer at limited rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from nhpocp.arrays import Array, dot, namespace
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.car_with_trailers import CarWithTrailers
from nhpocp.systems.planar import across, along, wheels
from nhpocp.systems.system import Parameter


class TruckWithTrailers(CarWithTrailers):
    r"""A truck that pulls n trailers as a `CarWithTrailers` does, its front axle steered by δ, on R² × Rⁿ⁺³:

        θ̇_0 = v tan δ / L_0,   v̇ = a,   δ̇ = w

    v, the speed of the truck's rear axle, and δ are states, so that both and their rates can be bounded: a system with
    drift, velocity-affine. Not defined at δ = ±90°.
    """

    model: ClassVar[str] = "truck_with_trailers"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "wheelbase": Parameter("positive", 1.0, "L_0, between the truck's axles", unit="length"),
        **CarWithTrailers.declared,
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "theta": [0, 0], "v": 0, "delta": 0},
        "goal": {"x": 2, "y": 0.2, "theta": [0, 0], "v": 0, "delta": 0},
        "control": {"harmonics": 3, "initial": [[0, 8, 0, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0, 0]]},
    }
    input_space = StateSpace(
        [scalar("v_dot", "length", symbol=r"\dot v"), scalar("delta_dot", "angle", symbol=r"\dot\delta")]
    )
    wheelbase: float

    def __init__(
        self,
        wheelbase: float = 1.0,
        lengths: Sequence[float] = (1.0,),
        hitch_offsets: Sequence[float] | None = None,
    ) -> None:
        super().__init__(lengths, hitch_offsets)
        self.wheelbase = self.declared["wheelbase"].checked("wheelbase", wheelbase)
        driven = [scalar("v", "length", rate=True), scalar("delta", "angle", symbol=r"\delta")]
        self.state_space = StateSpace([*self.state_space.blocks, *driven])

    def vector_fields(self, state: Array) -> Array:
        xp, still = namespace(state), [[0.0, 0.0]] * (self.state_space.dimension - 2)
        return xp.matrix([*still, [1.0, 0.0], [0.0, 1.0]])

    def drift(self, state: Array) -> Array:
        xp = namespace(state)
        rolling = super().vector_fields(state[:-2]) @ xp.vector([1.0, xp.tan(state[-1]) / self.wheelbase])
        return xp.concatenate([state[-2] * rolling, xp.array([0.0, 0.0])])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """Every axle's speed across its wheels, the front one's too, and the rear one's along them but for v."""
        xp, heading = namespace(state, velocity), state[2]
        front = velocity[:2] + self.wheelbase * velocity[2] * across(heading)
        more = [dot(front, across(heading + state[-1])), dot(velocity[:2], along(heading)) - state[-2]]
        return xp.concatenate([super().constraints(state[:-2], velocity[:-2]), xp.vector(more)])

    def chained_form(self, near: Array) -> None:
        return None  # with speed and steering as states, nothing moves at once

    def default_length_scale(self) -> float:
        return max(self.wheelbase, *self.lengths)

    def drawing(self, state: Array) -> dict[str, Any]:
        """The train, and the front wheels as they are steered."""
        drawn, size = super().drawing(state[:-2]), min(self.lengths)
        front = state[:2] + self.wheelbase * along(state[2])
        lines = wheels("front wheel", front, state[2], 0.23 * size, size, state[-1]) | drawn["lines"]
        return {**drawn, "lines": lines}

    def _nose(self) -> float:
        return self.wheelbase
