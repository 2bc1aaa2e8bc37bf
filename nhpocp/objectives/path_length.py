"""The length of the path of the pose."""

from __future__ import annotations

from nhpocp.arrays import Array, dot, namespace, norm
from nhpocp.objectives.objective import PathObjective
from nhpocp.scales import Scales
from nhpocp.systems.system import System


class PathLength(PathObjective):
    """∫ √(|ṗ|² + (length_scale |ω|)²) dt [length]; angles count by length_scale."""

    name = "path_length"
    symbol = "path length"
    meaning = "length of the path"
    pace = 0
    digits = 5
    softenings = (1.0, 0.1, 0.05)

    def scale(self, scales: Scales) -> float:
        units = {block.unit for block in scales.system.state_space.blocks}
        return max(scales.radius if unit == "angle" else scales.of(unit) for unit in units)

    def integrand(self, system: System, state: Array, control: Array, length_scale: float) -> Array:
        return norm(_pose_speeds(system, state, control, length_scale))

    def searched(
        self, system: System, state: Array, control: Array, length_scale: float, rest: Array
    ) -> Array:
        """√(speed² + rest²) - rest, written so that nothing cancels.

        The length has no derivative at rest, and no second one along the many paces of one path: with them a minimiser
        gets stuck, or wanders. This has both, is 0 at rest, and is least for the same path at an even pace wherever the
        pace is free; elsewhere it is less than the length by at most ``rest`` times the duration.
        """
        velocity = _pose_speeds(system, state, control, length_scale)
        squared = dot(velocity, velocity)
        return squared / (namespace(state, control).sqrt(squared + rest * rest) + rest)


def _pose_speeds(system: System, state: Array, control: Array, length_scale: float) -> Array:
    xp, space = namespace(state, control), system.state_space
    weights = [length_scale if b.unit == "angle" else 1.0 for b in space.blocks for _ in range(b.dimension)]
    return xp.array(weights) * system.velocity(state, control)
