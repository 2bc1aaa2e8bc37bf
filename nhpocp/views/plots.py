"""Curves of a solution on axes that the caller owns, so that several solutions can share one picture.

Every ``plot_…(axes, solution, label=None, **line)`` draws the same thing: ``label`` names the solution in the legend
where there are several, ``line`` overrides the look of the lines (alpha, linewidth, color).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import OrientationAtPiError
from nhpocp.solution import Outcome, Solution
from nhpocp.state_space import Block, StateSpace
from nhpocp.views.finite_path import Path, path_of, positive, quantity
from nhpocp.views.style import ALARM, COLOURS, FAINT, GREY, line_style, symbol, trial_style, with_unit

_NAMES = {"det_s": r"$\det\,S = 0$", "det_w": r"$\det\,W = 0$"}


def _titled(label: str | None, name: str) -> str:
    return f"{label}: {name}" if label else name


def _lines(
    axes: Any, times: Array, values: Array, names: Sequence[str], label: str | None, line: dict
) -> None:
    for i, name in enumerate(names):
        axes.plot(times, values[:, i], label=_titled(label, name), **{**line_style(i), **line})


def time_axis(axes: Any, path: Path) -> None:
    """Time from 0 to T; hatched where there is no path."""
    axes.set_xlim(0, path.horizon)
    axes.set_xlabel("time $t$ [–]")
    end = path.times[-1] if path.samples else 0.0
    if path.cut and end < path.horizon:
        axes.axvspan(
            end, path.horizon, facecolor=FAINT, edgecolor="0.8", hatch="////", linewidth=0, zorder=0.5
        )


def draw_bounds(axes: Any, solution: Solution, name: str) -> None:
    """Stated limits of a quantity, where they are near enough to the curves to be worth the room."""
    low, high = axes.get_ylim()
    room = 0.5 * (high - low)
    for bound in solution.problem.bounds:
        if bound.quantity != name:
            continue
        for value in np.unique(np.ravel([np.ravel(bound.lower), np.ravel(bound.upper)])):
            if np.isfinite(value) and low - room < value < high + room:
                axes.axhline(value, color=GREY, linewidth=0.7, linestyle=(0, (6, 3)), zorder=1)


def _labels(block: Block) -> list[str]:
    return (
        [symbol(block.name)]
        if block.kind == "scalar"
        else [symbol(block.name, i) for i in range(block.components)]
    )


def labels_with_unit(block: Block) -> list[str]:
    """A name for an axis per number of a vector or scalar block."""
    return [with_unit(name, block.unit) for name in _labels(block)]


def _axis_words(blocks: Iterable[Block]) -> str:
    stems = list(dict.fromkeys(symbol(block.name) for block in blocks))
    return ", ".join(stems) if len(stems) <= 3 else f"{stems[0]}, …, {stems[-1]}"


def _common_unit(space: StateSpace) -> str:
    units = {block.unit for block in space.blocks}
    return units.pop() if len(units) == 1 else ""


def plot_controls(axes: Any, solution: Solution, label: str | None = None, **line: Any) -> None:
    """Every input over time, [Paper] Fig. 2; jumps of a discontinuous control are drawn as jumps."""
    path, space = path_of(solution), solution.problem.system.input_space
    if not space.size:
        time_axis(axes, path)
        axes.set_ylabel("no inputs")
        return
    columns = [quantity(solution, block.name, path) for block in space.blocks]
    if all(column.shape[1] for column in columns):
        times, values = with_jumps(solution, path.times, np.hstack(columns))
        names = [name for block in space.blocks for name in _labels(block)]
        _lines(axes, times, values, names, label, line)
    time_axis(axes, path)
    for block in space.blocks:
        draw_bounds(axes, solution, block.name)
    axes.set_ylabel(with_unit(f"control {_axis_words(space.blocks)}", _common_unit(space), rate=True))


def with_jumps(solution: Solution, times: Array, values: Array) -> tuple[Array, Array]:
    """Samples with both one-sided values put in wherever the control jumps."""
    if not len(times):
        return times, values
    breaks = np.ravel(np.asarray(solution.control.breakpoints, dtype=float))
    breaks = breaks[(breaks > times[0]) & (breaks < times[-1])]
    if not len(breaks):
        return times, values
    left, right = solution.control(breaks, "left"), solution.control(breaks, "right")
    jumps = np.abs(left - right).max(axis=1) > 1e-9 * (1 + np.abs(values).max())
    breaks, left, right = breaks[jumps], left[jumps], right[jumps]
    if not len(breaks):
        return times, values
    kept = np.abs(times[:, None] - breaks).min(axis=1) > 1e-9 * times[-1]
    merged = np.concatenate([times[kept], breaks, breaks])
    order = np.argsort(merged, kind="stable")
    return merged[order], np.concatenate([values[kept], left, right])[order]


def plot_quantity(
    axes: Any, solution: Solution, name: str, words: str, unit: str, label: str | None = None, **line: Any
) -> None:
    """Every component of one entry of the trajectory over time, such as leg_lengths ([Paper] Fig. 2)."""
    path = path_of(solution)
    values = quantity(solution, name, path)
    names = [symbol(name, i if values.shape[1] > 1 else None) for i in range(values.shape[1])]
    _lines(axes, path.times, values, names, label, line)
    time_axis(axes, path)
    draw_bounds(axes, solution, name)
    axes.set_ylabel(with_unit(f"{words} {symbol(name)}", unit))


def plot_blocks(
    axes: Any, solution: Solution, blocks: Sequence[Block], label: str | None = None, **line: Any
) -> None:
    """Vector and scalar blocks of the state over time."""
    path = path_of(solution)
    values = np.hstack([quantity(solution, block.name, path) for block in blocks])
    names = [name for block in blocks for name in _labels(block)]
    if values.shape[1] == len(names):
        _lines(axes, path.times, values, names, label, line)
    time_axis(axes, path)
    for block in blocks:
        draw_bounds(axes, solution, block.name)
    units = {block.unit for block in blocks}
    axes.set_ylabel(with_unit(f"state {_axis_words(blocks)}", units.pop() if len(units) == 1 else ""))


def goal_groups(solution: Solution) -> list[list[Block]]:
    """Blocks and outputs with a goal, as they share a panel: the scalars by unit, every other alone."""
    groups: list[list[Block]] = []
    scalars: dict[str, list[Block]] = {}
    system = solution.problem.system
    for block in [*system.state_space.blocks, *system.pose_outputs]:
        if block.name not in solution.problem.goal:
            continue
        if block.kind != "scalar":
            groups.append([block])
        elif block.unit in scalars:
            scalars[block.unit].append(block)
        else:
            groups.append(scalars.setdefault(block.unit, [block]))
    return groups


def relative_values(solution: Solution, block: Block) -> Array:
    """value - goal, or the rotation vector from goal to value with NaN at a half turn; (samples, components)."""
    path, goal = path_of(solution), solution.problem.goal[block.name]
    values = quantity(solution, block.name, path)
    if block.kind not in ("rotation", "direction"):
        return values - np.ravel(goal) if values.size else values
    found = np.full((path.samples, 3), np.nan)
    for k, value in enumerate(values.reshape(-1, *block.shape)):
        try:
            found[k] = so3.log(value @ goal.T) if block.kind == "rotation" else so3.between(goal, value)
        except OrientationAtPiError:
            continue  # the axis is not defined there
    return found


def half_turns(times: Array, rotation_vectors: Array) -> Array:
    """Times at which the rotation vector is undefined or jumps to its other branch."""
    undefined = np.isnan(rotation_vectors).any(axis=1)
    steps = np.linalg.norm(np.diff(rotation_vectors, axis=0), axis=1)
    jumps = np.flatnonzero(np.nan_to_num(steps) > np.pi)
    return np.unique(np.concatenate([times[undefined], 0.5 * (times[jumps] + times[jumps + 1])]))


def plot_relative(
    axes: Any, solution: Solution, blocks: Sequence[Block], label: str | None = None, **line: Any
) -> None:
    """The path relative to the goal over time, [Paper] section 4 and Fig. 3; half turns are marked."""
    path, column = path_of(solution), 0
    for block in blocks:
        values = relative_values(solution, block)
        stems = ["$r_1$", "$r_2$", "$r_3$"] if block.kind == "rotation" else error_labels(block)
        if block.kind == "rotation":
            _half_turns(axes, path.times, values)
            values = _broken(values)
        for i in range(values.shape[1]):
            style = {**line_style(column), **line}
            axes.plot(path.times, values[:, i], label=_titled(label, stems[i]), **style)
            column += 1
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    time_axis(axes, path)
    axes.set_ylabel(_error_words(blocks))


def error_labels(block: Block) -> list[str]:
    return [_error_symbol(name) for name in _labels(block)]


def _error_symbol(name: str) -> str:
    """The error of p_1 is e_{p,1}."""
    if "$" not in name:
        return name
    return "$e_{" + name.strip("$").replace("_{", ",{", 1) + "}$"


def _error_words(blocks: Sequence[Block]) -> str:
    block = blocks[0]
    if block.kind == "rotation":
        stem = symbol(block.name).strip("$") if "$" in symbol(block.name) else "R"
        return rf"rotation error $[r] = \log({stem}{stem}_d^\mathsf{{T}})$ [rad]"
    if len(blocks) == 1 and "$" in symbol(block.name):
        stem = symbol(block.name).strip("$")
        words = "position error" if block.name == "position" else "error"
        return with_unit(f"{words} ${stem} - {stem}_d$", block.unit)
    return with_unit("difference from the goal", block.unit)


def _half_turns(axes: Any, times: Array, vectors: Array) -> None:
    for i, time in enumerate(half_turns(times, vectors)):
        axes.axvline(
            time,
            color=ALARM,
            linewidth=0.8,
            linestyle=":",
            label="half turn: no unique axis" if i == 0 else None,
        )


def _broken(vectors: Array) -> Array:
    """The same samples with a gap where the branch changes."""
    steps = np.nan_to_num(np.linalg.norm(np.diff(vectors, axis=0), axis=1))
    if not (steps > np.pi).any():
        return vectors
    broken = vectors.copy()
    broken[1:][steps > np.pi] = np.nan
    return broken


Record = Mapping[str, Any]


def own_records(solution: Solution, accepted: bool = True) -> list[Record]:
    """The records, accepted or refused, of the try that the solution came from: the last, or if all failed the best."""
    tries: dict[Any, list[Record]] = {}
    for record in solution.iterations:
        tries.setdefault(record.get("attempt"), []).append(record)

    def least(records: list[Record]) -> float:
        return min((r["error"] for r in records if r.get("error") is not None), default=np.inf)

    found = list(tries.values()) or [[]]
    own = found[-1] if solution.outcome is Outcome.CONVERGED else min(found, key=least)
    return [record for record in own if bool(record.get("accepted", True)) is accepted]


def error_history(solution: Solution, accepted: bool = True) -> tuple[Array, Array]:
    """(k, E) of `own_records`; E is NaN where it is missing or not a positive number."""
    records = own_records(solution, accepted)
    ks = [record.get("k", i) for i, record in enumerate(records)]
    return np.array(ks, dtype=float), positive(record.get("error") for record in records)


def step_sums(solution: Solution) -> tuple[Array, Array] | None:
    """(θ, log of the product of 1-γ) at every accepted record, or None where the solver names no γ.

    A record's own ``gamma`` is the step that led to it; without one it is the setting's.
    """
    common = solution.settings.get("gamma")
    steps = [record.get("gamma", common) for record in own_records(solution)]
    if solution.solver != "jacobian" or len(steps) < 2 or any(step is None for step in steps[1:]):
        return None
    gammas = np.array([0.0, *(float(step) for step in steps[1:])])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.cumsum(gammas), np.cumsum(np.log1p(-np.minimum(gammas, 1.0)))


def plot_convergence(
    axes: Any, solution: Solution, label: str | None = None, references: bool = True, **line: Any
) -> None:
    """E against iteration on a log axis with the decay that eqs. (9) and (17) promise, [Paper] section 3."""
    ks, errors = error_history(solution)
    good = np.flatnonzero(np.isfinite(errors))
    style = {"color": COLOURS[0], "marker": "o", "markersize": 2.2, "linewidth": 1.0, **line}
    axes.plot(ks, errors, label=_titled(label, r"error $\mathcal{E}$"), zorder=3, **style)
    refused = error_history(solution, accepted=False)
    if len(refused[0]):
        axes.plot(
            *refused, label=_titled(label, "trial"), **trial_style(len(refused[0])), color=style["color"]
        )
    axes.set_yscale("log")
    sums = step_sums(solution)
    if references and sums is not None and len(good):
        first = good[0]
        with np.errstate(invalid="ignore", over="ignore"):
            exponential = errors[first] * np.exp(sums[0][first] - sums[0])
            geometric = errors[first] * np.exp(sums[1] - sums[1][first])
        geometric[~(geometric > 0)] = np.nan
        names = (r"$\mathcal{E}(0)\,e^{-\gamma\theta}$", r"$\mathcal{E}(0)\,(1-\gamma)^k$")
        for i, (name, values) in enumerate(zip(names, (exponential, geometric), strict=True), 1):
            axes.plot(ks, values, label=name, linewidth=0.9, zorder=2, **line_style(i))
    if references:
        axes.axhline(
            solution.tolerance,
            color=GREY,
            linewidth=0.8,
            linestyle=":",
            label=f"tolerance {solution.tolerance:g}",
        )
    if len(good):
        _last_point(axes, solution, label, ks[good[-1]], errors[good[-1]])
    finite = [*errors[good], solution.tolerance]
    axes.set_ylim(min(finite) / 2.5, max(finite) * 2.5)
    axes.set_xlim(-0.02 * max(ks.max(initial=1), 1), 1.02 * max(ks.max(initial=1), 1))
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("iteration $k$")
    axes.set_ylabel(r"error $\mathcal{E}$ [–]")


def _last_point(axes: Any, solution: Solution, label: str | None, k: float, error: float) -> None:
    failed = solution.outcome is not Outcome.CONVERGED
    words = f"{solution.outcome.value.replace('_', ' ')}: $\\mathcal{{E}}$ = {error:.2g} at $k$ = {k:g}"
    look = (
        {"marker": "X", "color": ALARM, "markersize": 6}
        if failed
        else {"marker": "D", "color": COLOURS[2], "markersize": 4}
    )
    axes.plot([k], [error], linestyle="none", zorder=5, label=_titled(label, words), clip_on=False, **look)


def crossing_times(solution: Solution) -> dict[str, list[float]]:
    """Times at which each determinant changes sign: the verdict's, or without one those seen in the samples."""
    found: dict[str, list[float]] = {}
    if solution.verdict is not None:
        for crossing in solution.verdict.crossings:
            found.setdefault(crossing.which, []).append(float(crossing.time))
        return found
    path = path_of(solution)
    for name in solution.trajectory:
        if not name.startswith("det_"):
            continue
        values, times = np.ravel(quantity(solution, name, path)), path.times
        for k in np.flatnonzero(values[:-1] * values[1:] < 0):
            share = values[k] / (values[k] - values[k + 1])
            found.setdefault(name, []).append(float(times[k] + share * (times[k + 1] - times[k])))
    return found


def crossing_words(solution: Solution) -> list[str]:
    """Plain sentences on the singularities that the path crosses."""
    sentences = []
    for which, times in crossing_times(solution).items():
        at = ", ".join(f"{time:.3f}" for time in times)
        if which == "det_w":
            sentences.append(
                f"Parallel singularity at t = {at}: det W = 0, the actuators lose hold of the platform there."
            )
        elif which == "det_s":
            sentences.append(f"det S = 0 at t = {at}: the feedback form of the equations is undefined there.")
        else:
            sentences.append(f"{which.replace('_', ' ')} changes sign at t = {at}.")
    return sentences


def plot_margins(axes: Any, solution: Solution, label: str | None = None, **line: Any) -> None:
    """Least singular values along the path, and where the determinants change sign."""
    path = path_of(solution)
    names = [name for name in solution.trajectory if name.startswith("sigma_")]
    seen: list[float] = []
    for i, name in enumerate(names):
        values = np.ravel(quantity(solution, name, path))
        words = rf"$\sigma_{{\min}}({name.removeprefix('sigma_').upper()})$"
        axes.plot(path.times, values, label=_titled(label, words), **{**line_style(i), **line})
        seen += [value for value in values if np.isfinite(value) and value > 0]
    for i, (which, times) in enumerate(crossing_times(solution).items()):
        for j, time in enumerate(times):
            style = {"linestyle": (":", "--")[i % 2], "color": ALARM, "linewidth": 0.9}
            axes.axvline(
                time, label=None if j else _titled(label, _NAMES.get(which, which)), zorder=1.5, **style
            )
    if seen and max(seen) > 30 * min(seen):
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.08 * max(seen, default=1.0))
    for name in names:
        draw_bounds(axes, solution, name)
    time_axis(axes, path)
    axes.set_ylabel(r"least singular value $\sigma_{\min}$ [–]")
