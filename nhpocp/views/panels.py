"""What the pictures of a solution show, as plain data: every panel with its curves, limits and marks.

Nothing is drawn here: `plots` draws panels for paper, `overlays` those of several runs over each other, `curves` hands
them to the animation's page.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nhpocp.arrays import Array
from nhpocp.relative import blocks_with_goal, relative_to
from nhpocp.solution import Solution
from nhpocp.state_space import Block
from nhpocp.systems.margins import Margin, margin
from nhpocp.systems.system import DISTANCE, System
from nhpocp.views.finite_path import FinitePath, path_of, quantity
from nhpocp.views.labels import LEGS, axis_label, notation, symbol

SPREAD = 30.0  # of the least value to the largest, from which an axis is logarithmic
NEAREST = 5  # distances that are shown
HALF_TURN = "half turn: no unique axis"


@dataclass(frozen=True)
class Curve:
    """One number over time: a jump has two values at one time, what cannot be drawn is NaN.

    ``name``: the quantity that it is part of; ``symbol``: mathtext; ``unit``: words; ``limits``: the finite bounds that
    the problem sets it.
    """

    name: str
    symbol: str
    unit: str
    times: Array
    values: Array
    limits: tuple[float, ...] = ()

    @property
    def label(self) -> str:
        return axis_label("", self.symbol, self.unit)


@dataclass(frozen=True)
class Mark:
    """A time that matters to a panel, in words (mathtext), and the one curve that it matters to, if not to all.

    ``alarm``: whether something is amiss there.
    """

    time: float
    words: str
    curve: str = ""
    alarm: bool = True


@dataclass(frozen=True)
class Panel:
    """Curves that share their axes.

    ``group``: control, leg, output, state, error, margin or determinant; ``words`` and ``symbol`` (mathtext): what all
    curves show; ``zero``: zero is the value to look for; ``margin``: a distance from zero, see `logarithmic`.
    """

    group: str
    name: str
    words: str
    symbol: str
    curves: tuple[Curve, ...]
    marks: tuple[Mark, ...] = ()
    zero: bool = False

    @property
    def unit(self) -> str:
        """The unit of all curves; none where they differ."""
        units = {curve.unit for curve in self.curves}
        return units.pop() if len(units) == 1 else ""

    @property
    def label(self) -> str:
        return axis_label(self.words, self.symbol, self.unit)

    @property
    def margin(self) -> bool:
        """Whether the curves are distances from zero, so that axes begin there or are logarithmic."""
        return self.group == "margin"

    @property
    def log(self) -> bool:
        return self.margin and logarithmic(*(curve.values for curve in self.curves))

    def until(self, end: float) -> Panel:
        """The panel up to a time; its first sample in any case."""
        curves = []
        for curve in self.curves:
            count = max(1, int(np.searchsorted(curve.times, end, side="right")))
            curves.append(replace(curve, times=curve.times[:count], values=curve.values[:count]))
        return replace(self, curves=tuple(curves))


def logarithmic(*values: Array) -> bool:
    """The one rule for the axis of a margin: logarithmic where its positive values spread widely."""
    seen = np.concatenate([np.ravel(some) for some in values]) if values else np.empty(0)
    seen = seen[np.isfinite(seen) & (seen > 0)]
    return bool(seen.size and seen.max() > SPREAD * seen.min())


def panels(solution: Solution) -> list[Panel]:
    """Every panel that says something of a solution, whatever became of it, in the order in which they are read."""
    path = path_of(solution)
    every = [
        *_controls(solution, path),
        *_outputs(solution, path),
        *_states(solution, path),
        *_errors(solution, path),
        *_margins(solution, path),
        *_distances(solution, path),
    ]
    return [panel for panel in every if panel.curves]


def of_group(every: Iterable[Panel], *groups: str) -> list[Panel]:
    return [panel for panel in every if panel.group in groups]


def of_quantity(every: Iterable[Panel], name: str) -> list[Curve]:
    return [curve for panel in every for curve in panel.curves if curve.name == name]


def merged(some: Sequence[Panel]) -> Panel:
    """The curves of panels of one group in one panel."""
    curves, symbols = [curve for panel in some for curve in panel.curves], [panel.symbol for panel in some]
    return replace(some[0], symbol=", ".join(symbols), curves=tuple(curves))


# --- curves -----------------------------------------------------------------------------------------------------------


def _curves(solution: Solution, names: Iterable[str], times: Array, values: Array) -> tuple[Curve, ...]:
    """A curve per component of quantities that lie side by side in values (samples, components)."""
    problem, columns, curves = solution.problem, iter(values.T), []
    for name in names:
        bounds = [bound for bound in problem.bounds if bound.quantity == name]
        for place in np.ndindex(*np.shape(solution.trajectory[name])[1:]):
            _, label, unit = notation(problem.system, name, *place, units=problem.units)
            limits = {limit for bound in bounds for limit in bound.limits(place) if np.isfinite(limit)}
            curves.append(Curve(name, label, unit, times, next(columns), tuple(sorted(limits))))
    return tuple(curves)


def _beside(solution: Solution, names: Iterable[str], path: FinitePath) -> Array:
    return np.hstack([np.empty((path.samples, 0)), *(quantity(solution, name, path) for name in names)])


def _stems(system: System, names: Iterable[str]) -> str:
    """The symbols of quantities, in an axis' words."""
    stems = list(dict.fromkeys(notation(system, name).symbol for name in names))
    return ", ".join(stems) if len(stems) <= 3 else f"{stems[0]}, …, {stems[-1]}"


def _via_marks(solution: Solution) -> tuple[Mark, ...]:
    horizon = float(solution.control.horizon)
    return tuple(Mark(via.share * horizon, "via pose", alarm=False) for via in solution.problem.via)


def _controls(solution: Solution, path: FinitePath) -> list[Panel]:
    """Every input. [Paper] Fig. 2."""
    space = solution.problem.system.input_space
    names = [name for name in space.names if name in solution.trajectory]
    curves = _curves(solution, names, *with_jumps(solution, path.times, _beside(solution, names, path)))
    return [Panel("control", "controls", "control", _stems(solution.problem.system, space.names), curves)]


def with_jumps(solution: Solution, times: Array, values: Array) -> tuple[Array, Array]:
    """Samples with both one-sided values put in wherever the control jumps."""
    if not values.size or values.shape[1] != solution.problem.system.input_space.size:
        return times, values
    breaks = np.ravel(np.asarray(solution.control.breakpoints, dtype=float))
    breaks = breaks[(breaks > times[0]) & (breaks < times[-1])]
    left, right = solution.control(breaks, "left"), solution.control(breaks, "right")
    jumps = np.abs(left - right).max(axis=1) > 1e-9 * (1 + np.abs(values).max())
    breaks, left, right = breaks[jumps], left[jumps], right[jumps]
    if not len(breaks):
        return times, values
    kept = np.abs(times[:, None] - breaks).min(axis=1) > 1e-9 * times[-1]
    merged_times = np.concatenate([times[kept], breaks, breaks])
    order = np.argsort(merged_times, kind="stable")
    return merged_times[order], np.concatenate([values[kept], left, right])[order]


def _outputs(solution: Solution, path: FinitePath) -> list[Panel]:
    """What is neither time, state, input nor margin, as the system names it; a table has a panel a row."""
    system, every = solution.problem.system, []
    known = {"t", *system.state_space.names, *system.input_space.names}
    wrapping = {block.name for block in system.output_blocks or () if block.wraps}
    for name in solution.trajectory:
        if name in known or margin(name) or name == DISTANCE:
            continue
        values = quantity(solution, name, path)
        if name in wrapping:  # no line where an angle is cut
            steps = np.abs(np.diff(values, axis=0, prepend=values[:1]))
            values = np.where(np.nan_to_num(steps) > np.pi, np.nan, values)
        curves = _curves(solution, [name], path.times, values)
        group = "leg" if name in LEGS and "leg_lengths" in solution.trajectory else "output"
        shape = np.shape(solution.trajectory[name])[1:]
        for i, row in enumerate(np.ndindex(*shape[:-1])):
            own, (words, stem, _) = f"{name} {i + 1}" if row else name, notation(system, name, *row)
            width = shape[-1] if row else len(curves)
            every.append(Panel(group, own, words, stem, curves[i * width : (i + 1) * width]))
    legs = [panel for name in LEGS for panel in every if panel.name == name and panel.group == "leg"]
    return legs + [panel for panel in every if panel.group != "leg"]


def _states(solution: Solution, path: FinitePath) -> list[Panel]:
    """The numbers of the state, a panel a unit; rotations are told by their errors."""
    groups: dict[str, list[Block]] = {}
    for block in solution.problem.system.state_space.blocks:
        if block.kind != "rotation" and block.name in solution.trajectory:
            groups.setdefault(block.unit, []).append(block)
    every = []
    for unit, blocks in groups.items():
        names = [block.name for block in blocks]
        curves = _curves(solution, names, path.times, _beside(solution, names, path))
        stems = _stems(solution.problem.system, names)
        every.append(Panel("state", f"state {unit}", "state", stems, curves, _via_marks(solution)))
    return every


# --- relative to the goal ---------------------------------------------------------------------------------------------


def _errors(solution: Solution, path: FinitePath) -> list[Panel]:
    """The path relative to the goal: zero at the end is the goal reached. [Paper] section 4 and Fig. 3."""
    every, system, units = [], solution.problem.system, solution.problem.units
    for blocks in _goal_groups(solution):
        curves, marks = [], [*_via_marks(solution)]
        for block in blocks:
            values, unit = relative_values(solution, block), notation(system, block.name, units=units).unit
            if block.kind in ("rotation", "direction"):
                marks += [Mark(time, HALF_TURN) for time in half_turns(path.times, values)]
                values, symbols, unit = _broken(values), ["$r_1$", "$r_2$", "$r_3$"], units.words(block.unit)
            else:
                places = [()] if block.kind == "scalar" else [(i,) for i in range(block.components)]
                symbols = [_error_symbol(notation(system, block.name, *place).symbol) for place in places]
            shown = zip(symbols, values.T, strict=False)
            curves += [Curve(f"error {block.name}", name, unit, path.times, column) for name, column in shown]
        words, all_of_them = _error_words(solution, blocks)
        name = f"error {blocks[0].name}"
        every.append(Panel("error", name, words, all_of_them, tuple(curves), tuple(marks), zero=True))
    return every


def _goal_groups(solution: Solution) -> list[list[Block]]:
    """Blocks and outputs with a goal, as they share a panel: the scalars by unit, every other alone."""
    groups: dict[str, list[Block]] = {}
    for block in blocks_with_goal(solution):
        key = f"scalars {block.unit}" if block.kind == "scalar" else f"block {block.name}"
        groups.setdefault(key, []).append(block)
    return list(groups.values())


def _error_symbol(name: str) -> str:
    """The error of p_1 is e_{p,1}."""
    return "$e_{" + name.strip("$").replace("_{", ",{", 1) + "}$" if "$" in name else name


def _error_words(solution: Solution, blocks: Sequence[Block]) -> tuple[str, str]:
    """Words and symbol of a panel of errors."""
    block, (words, stem, _) = blocks[0], notation(solution.problem.system, blocks[0].name)
    stem, plain = stem.strip("$"), "$" not in stem
    if block.kind == "rotation":
        letter = "R" if plain else stem
        return "rotation error", rf"$[r] = \log({letter} {letter}_d^\mathsf{{T}})$"
    if len(blocks) > 1:
        return "difference from the goal", ""
    if plain:
        return f"error of {stem}", ""
    return f"{words} error".strip(), f"${stem} - {stem}_d$"


def relative_values(solution: Solution, block: Block) -> Array:
    """`relative_to` along the path, as far as it can be drawn; (samples, components)."""
    path, goal = path_of(solution), solution.problem.goal[block.name]
    values = quantity(solution, block.name, path)
    return relative_to(np.asarray(goal), values, block) if values.size else values


def half_turns(times: Array, rotation_vectors: Array) -> Array:
    """Times at which the rotation vector is undefined or jumps to its other branch."""
    undefined = np.isnan(rotation_vectors).any(axis=1)
    jumps = np.flatnonzero(_branch_changes(rotation_vectors))
    return np.unique(np.concatenate([times[undefined], 0.5 * (times[jumps] + times[jumps + 1])]))


def _broken(rotation_vectors: Array) -> Array:
    """Rotation vectors with a gap wherever the branch changes."""
    gaps = np.r_[False, _branch_changes(rotation_vectors)][: len(rotation_vectors)]
    return np.where(gaps[:, None], np.nan, rotation_vectors)


def _branch_changes(rotation_vectors: Array) -> Array:
    """Which steps between samples go from one branch of the logarithm to the other."""
    return np.nan_to_num(np.linalg.norm(np.diff(rotation_vectors, axis=0), axis=1)) > np.pi


# --- distances -------------------------------------------------------------------------------------------------------


def _distances(solution: Solution, path: FinitePath) -> list[Panel]:
    """The distances of the pairs of bodies that come nearest, the nearest first."""
    if DISTANCE not in solution.trajectory or not path.samples:
        return []
    values = quantity(solution, DISTANCE, path)
    pairs = next(block.entries for block in solution.problem.system.quantity_blocks if block.name == DISTANCE)
    curves = _curves(solution, [DISTANCE], path.times, values)
    named = [replace(curve, symbol=pair) for curve, pair in zip(curves, pairs, strict=True)]
    least = np.nan_to_num([np.nanmin(curve.values, initial=np.inf) for curve in named], posinf=1e300)
    nearest = tuple(named[k] for k in np.argsort(least, kind="stable")[:NEAREST])
    return [Panel("distance", "distances", "distance", "$d$", nearest)]


# --- singularities ----------------------------------------------------------------------------------------------------


def _margins(solution: Solution, path: FinitePath) -> list[Panel]:
    """Least singular values, and the determinants by their size at the start, with the zeros that the path crosses."""
    names = [own.name for own in margins_of(solution, "sigma")]
    curves = _curves(solution, names, path.times, _beside(solution, names, path))
    determinants = []
    for own in margins_of(solution, "det"):
        values = np.ravel(quantity(solution, own.name, path))
        first = np.abs(values[:1])
        values = values / first if np.all(first > 0) and len(first) else values
        determinants.append(Curve(own.name, symbol(own.name), "–", path.times, values))
    crossed = [(margin(which), time) for which, times in crossing_times(solution).items() for time in times]
    marks = {
        kind: tuple(
            Mark(time, f"${own.symbol} = 0$", Margin(kind, own.matrix).name) for own, time in crossed if own
        )
        for kind in ("sigma", "det")
    }
    return [
        Panel("margin", "margins", "least singular value", r"$\sigma_{\min}$", curves, marks["sigma"]),
        Panel(
            "determinant",
            "determinants",
            "determinant, its size at the start being 1",
            "",
            tuple(determinants),
            marks["det"],
            zero=True,
        ),
    ]


def margins_of(solution: Solution, kind: str) -> list[Margin]:
    """The margins of one kind, sigma or det, that a trajectory has."""
    return [own for name in solution.trajectory if (own := margin(name)) and own.kind == kind]


def crossing_times(solution: Solution) -> dict[str, list[float]]:
    """Times at which each determinant changes sign: the verdict's, or without one those seen in the samples."""
    times: dict[str, list[float]] = {}
    if solution.verdict is not None:
        for crossing in solution.verdict.crossings:
            times.setdefault(crossing.which, []).append(float(crossing.time))
        return times
    path = path_of(solution)
    for own in margins_of(solution, "det"):
        values = np.ravel(quantity(solution, own.name, path))
        for k in np.flatnonzero(values[:-1] * values[1:] < 0):
            fraction = values[k] / (values[k] - values[k + 1])
            time = path.times[k] + fraction * (path.times[k + 1] - path.times[k])
            times.setdefault(own.name, []).append(float(time))
    return times


_MEANING = {
    "det_w": "Parallel singularity at t = {}: det W = 0, the actuators lose hold of the platform there.",
    "det_s": "det S = 0 at t = {}: the feedback form of the equations is undefined there.",
}


def crossing_words(solution: Solution) -> list[str]:
    """Plain sentences on the singularities that the path crosses."""
    return [
        _MEANING.get(which, f"{which.replace('_', ' ')} changes sign at t = {{}}.").format(
            ", ".join(f"{time:.3f}" for time in times)
        )
        for which, times in crossing_times(solution).items()
    ]
