"""A system's bodies and the obstacles around it: which of them are to be kept apart, and how far apart they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from nhpocp.arrays import Array, namespace
from nhpocp.bodies.distance import distance
from nhpocp.bodies.hull import HalfSpace, Hull
from nhpocp.bodies.obstacles import Obstacle


def alone(model: str) -> str:
    """Why the bodies of a system have no distances, in words."""
    return f"the bodies of {model} touch by construction or are one; name obstacles"


@dataclass(frozen=True)
class Surroundings:
    """Obstacles, and the pairs of names whose distance counts.

    pairs: of bodies that do not meet by construction, and of every body that moves with every obstacle.
    """

    obstacles: tuple[Obstacle, ...]
    pairs: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, bodies: Mapping[str, Hull], obstacles: Sequence[Obstacle]) -> Surroundings:
        pairs = [
            (one, other)
            for one, other in combinations(bodies, 2)
            if other not in bodies[one].touches
            and one not in bodies[other].touches
            and not (bodies[one].fixed and bodies[other].fixed)
        ]
        moving = [name for name, body in bodies.items() if not body.fixed]
        pairs += [(name, obstacle.name) for obstacle in obstacles for name in moving]
        return cls(tuple(obstacles), tuple(pairs))

    def shapes(self) -> dict[str, Hull | HalfSpace]:
        """The obstacles by name."""
        return {obstacle.name: obstacle.shape for obstacle in self.obstacles}

    def distances(self, bodies: Mapping[str, Hull]) -> Array:
        """The signed distances [length] of the pairs, (n,), or the one of a single pair."""
        shapes = {**self.shapes(), **bodies}
        found = [distance(bodies[one], shapes[other]) for one, other in self.pairs]
        return namespace(*found).vector(found) if len(found) != 1 else found[0]
