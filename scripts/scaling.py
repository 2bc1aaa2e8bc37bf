"""How the times grow: end points and Jacobians with the steps and the harmonics, NLPs with the intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import end_points as jacobians
import own
import rival_nlpsol
import rival_opti
from measuring import interleaved, medians, warm

Curves = dict[str, dict[int, float]]  # name: {size: seconds}
PATIENCE = 3.0  # seconds of a call: a way that takes longer is not asked for more
Make = Callable[[int], Callable[[], object]]  # size ↦ what is timed


def grow(ways: Mapping[str, Make], sizes: Sequence[int], rounds: int) -> Curves:
    """Median times of every way and size, all in the same rounds; a way ends where a call exceeds ``PATIENCE``."""
    runs: dict[tuple[str, int], Callable[[], object]] = {}
    once: dict[tuple[str, int], float] = {}
    for name, make in ways.items():
        for size in sizes:
            runs[name, size] = make(size)
            once[name, size] = warm(runs[name, size], rounds)
            if once[name, size] > PATIENCE:
                break
    curves: Curves = {name: {} for name in ways}
    for (name, size), time in medians(interleaved(runs, rounds, once)).items():
        curves[name][size] = time
    return curves


def evaluation(name: str, harmonics: int, steps: int) -> Callable[[], object]:
    """One end point with its Jacobian, the way of this name."""
    way, given = jacobians.ways(harmonics, steps)[name](), jacobians.coefficients(harmonics)
    return lambda: way(given)


def over_steps(sizes: Sequence[int], rounds: int, harmonics: int = 2) -> Curves:
    ways = jacobians.ways(harmonics)
    return grow({name: partial(evaluation, name, harmonics) for name in ways}, sizes, rounds)


def over_harmonics(sizes: Sequence[int], rounds: int, steps: int = 500) -> Curves:
    ways = jacobians.ways(sizes[0])
    return grow({name: partial(evaluation, name, steps=steps) for name in ways}, sizes, rounds)


def over_intervals(sizes: Sequence[int], rounds: int) -> Curves:
    """Ours with building, the peers built before."""
    ways: dict[str, Make] = {
        "nhpocp": lambda size: own.build("nlp", "interpreted", size),
        "nlpsol": rival_nlpsol.build,
        "Opti": lambda size: rival_opti.build(size, expand=False),  # expanding hundreds takes minutes
    }
    return grow(ways, sizes, rounds)
