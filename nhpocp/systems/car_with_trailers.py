"""A tractor that pulls trailers, each hitched on the axle before it or off it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.arrays import Array, dot, namespace
from nhpocp.bodies.hull import Hull, capsule
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, scalar, vector
from nhpocp.systems.planar import (
    across,
    along,
    box,
    footprint,
    link,
    outline,
    vehicle,
    vehicle_footprint,
    wheels,
)
from nhpocp.systems.system import Parameter, System

if TYPE_CHECKING:
    from nhpocp.systems.chained_form import ChainedForm


class CarWithTrailers(System):
    r"""A tractor with n trailers on R² × Rⁿ⁺¹, [Laumond, ch. 1]; off-axle hitches as in [Altafini]:

        ẋ = v_0 cos θ_0,   ẏ = v_0 sin θ_0,   θ̇_0 = ω_0
        L_i θ̇_i = v_{i-1} sin(θ_{i-1} - θ_i) - M_i θ̇_{i-1} cos(θ_{i-1} - θ_i)
        v_i     = v_{i-1} cos(θ_{i-1} - θ_i) + M_i θ̇_{i-1} sin(θ_{i-1} - θ_i)

    (x, y): the middle of the tractor's axle, θ_i: the heading of body i, v_i: the speed of its axle. Trailer i hangs at
    its length L_i behind a hitch that is M_i behind axle i - 1; M_i = 0 is on the axle, and there the Lie algebra loses
    steps where θ_{i-1} - θ_i = ±90°, [Jean]. The output `hitch_angle`, θ_{i-1} - θ_i, is what to bound.
    """

    model: ClassVar[str] = "car_with_trailers"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "lengths": Parameter(
            "numbers", [1.0], "L_i, from each trailer's hitch back to its axle", unit="length"
        ),
        "hitch_offsets": Parameter(
            "numbers",
            None,
            "M_i, from the axle before it back to each hitch; 0 where left out",
            unit="length",
        ),
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "theta": [0, 0]},
        "goal": {"x": 0, "y": 1, "theta": [0, 0]},
        "control": {"harmonics": 3},
    }
    input_space = StateSpace(
        [scalar("v0", "length", symbol="v_0"), scalar("theta0_dot", "angle", symbol=r"\omega_0")]
    )
    lengths: tuple[float, ...]
    hitch_offsets: tuple[float, ...]

    def __init__(
        self, lengths: Sequence[float] = (1.0,), hitch_offsets: Sequence[float] | None = None
    ) -> None:
        parameters: dict[str, Any] = {"lengths": lengths}
        super().__init__(
            **parameters, hitch_offsets=[0.0] * len(lengths) if hitch_offsets is None else hitch_offsets
        )
        if not all(length > 0 for length in self.lengths) or not self.lengths:
            raise InvalidProblemError(
                "expected one length > 0 for each trailer, as in [1, 1]", path="system.lengths"
            )
        if len(self.hitch_offsets) != len(self.lengths):
            words = (
                f"{len(self.hitch_offsets)} numbers; expected one for each of {len(self.lengths)} trailers"
            )
            raise InvalidProblemError(words, path="system.hitch_offsets")
        n = len(self.lengths)
        self.output_blocks = (
            vector("hitch_angle", n, "angle", symbol=r"\beta", words="hitch angle", of_pose=True),
        )
        headings = vector("theta", n + 1, "angle", symbol=r"\theta")
        self.state_space = StateSpace([scalar("x", "length"), scalar("y", "length"), headings])

    def vector_fields(self, state: Array) -> Array:
        xp, theta = namespace(state), state[2:]
        speed, turning = (1.0, 0.0), (0.0, 1.0)  # of a body, for v_0 = 1 and for ω_0 = 1
        rows = [[xp.cos(theta[0]), 0.0], [xp.sin(theta[0]), 0.0], [*turning]]
        for i, (length, offset) in enumerate(zip(self.lengths, self.hitch_offsets, strict=True)):
            c, s = xp.cos(theta[i] - theta[i + 1]), xp.sin(theta[i] - theta[i + 1])
            both = list(zip(speed, turning, strict=True))
            turning = tuple((v * s - offset * w * c) / length for v, w in both)
            speed = tuple(v * c + offset * w * s for v, w in both)
            rows.append([*turning])
        return xp.matrix(rows)

    def axles(self, state: Array) -> list[Array]:
        """The middle of every axle (2,), the tractor's first."""
        places = [state[:2]]
        for i, (length, offset) in enumerate(zip(self.lengths, self.hitch_offsets, strict=True)):
            places.append(places[i] - offset * along(state[2 + i]) - length * along(state[3 + i]))
        return places

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The speed of every axle across its wheels, its velocity by the chain of bodies from the tractor."""
        moving, slips = velocity[:2], [dot(velocity[:2], across(state[2]))]
        for i, (length, offset) in enumerate(zip(self.lengths, self.hitch_offsets, strict=True)):
            moving = moving - offset * velocity[2 + i] * across(state[2 + i])
            moving = moving - length * velocity[3 + i] * across(state[3 + i])
            slips.append(dot(moving, across(state[3 + i])))
        return namespace(state, velocity).vector(slips)

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        n = len(self.lengths)
        return {"hitch_angle": state[2 : 2 + n] - state[3 : 3 + n]}

    def default_length_scale(self) -> float:
        return max(self.lengths)

    def chained_form(self, near: Array) -> ChainedForm | None:
        """Of hitches on the axles: the last axle's place along and across its heading in ``near``, [Sørdalen].

        The last heading within 90° of that, and every hitch angle within 90°.
        """
        from nhpocp.systems.chained_form import ChainedForm

        if any(self.hitch_offsets):
            return None
        heading, n = near[2 + len(self.lengths)], len(self.lengths)
        axis, side = along(heading), across(heading)

        def assemble(first: Array, last: Array, slopes: Sequence[Array]) -> Array:
            xp = namespace(first)
            theta = [heading + xp.arctan(slopes[0])]  # from the last trailer to the tractor
            for slope in slopes[1:]:
                theta.insert(0, theta[0] + xp.arctan(slope))
            here = first * axis + last * side
            for i in reversed(range(n)):
                here = here + self.lengths[i] * along(theta[i + 1])
            return xp.concatenate([here, *theta])

        def of_axle(direction: Array) -> Callable[[Array], Array]:
            return lambda state: dot(direction, self.axles(state)[-1])

        return ChainedForm(self, 0, of_axle(axis), of_axle(side), assemble)

    def bodies(self, state: Array) -> dict[str, Hull]:
        """The footprints with their wheels, and the drawbars, which touch what they are hitched to."""
        axles, size, ahead = self.axles(state), min(self.lengths), "tractor"
        bodies = {ahead: vehicle_footprint(axles[0], state[2], self._nose() / size, size)}
        for i, (here, length) in enumerate(zip(axles[1:], self.lengths, strict=True), start=1):
            theta, own = state[2 + i], f"trailer {i}"
            bar = capsule(here, here + length * along(theta), 0.04 * size)
            bodies[f"drawbar {i}"] = bar.touching(ahead, own, f"drawbar {i - 1}")
            corners = box(-0.25 * size, length - 0.45 * size, 0.28 * size)
            bodies[own] = footprint(here, theta, corners).touching(f"drawbar {i + 1}")
            ahead = own
        return bodies

    def drawing(self, state: Array) -> dict[str, Any]:
        """Tractor and trailers with their wheels, and drawbars to the hitches, behind the axles or on them."""
        axles, size = self.axles(state), min(self.lengths)
        lines = wheels("wheel", axles[0], state[2], 0.23 * size, size)
        lines |= vehicle("tractor", axles[0], state[2], self._nose() / size, size)
        hitches = []
        for i, here in enumerate(axles[1:], start=1):
            theta, length = state[2 + i], self.lengths[i - 1]
            hitches.append(here + length * along(theta))
            lines[f"drawbar {i}"] = link(here, hitches[-1], 0.04 * size)
            lines |= wheels(f"wheel of trailer {i}", here, theta, 0.23 * size, size)
            lines[f"trailer {i}"] = outline(here, theta, box(-0.25 * size, length - 0.45 * size, 0.22 * size))
        return {"lines": lines, "points": {"hitches": namespace(state).rows(hitches)}, "trace": axles[-1]}

    def _nose(self) -> float:
        """From the tractor's axle ahead to where its bonnet begins."""
        return 0.4 * min(self.lengths)
