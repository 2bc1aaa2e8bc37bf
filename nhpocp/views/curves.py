"""Quantities over time as plain data, for pages that draw them: the panels beside an animation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from nhpocp.arrays import Array
from nhpocp.solution import Solution
from nhpocp.views import plots
from nhpocp.views.finite_path import path_of, quantity, thinned
from nhpocp.views.style import COLOURS, symbol, with_unit

MOST_CURVES = 6  # in one panel
DASHES = ("", "6 2", "6 2 1 2", "1.5 1.5", "9 3", "4 1.5 1 1.5 1 1.5")  # of `style.DASHES`, for SVG
Panel = dict[str, Any]
_LETTERS = dict(
    zip(
        ("alpha", "beta", "gamma", "theta", "phi", "psi", "omega", "sigma", "lambda", "kappa"),
        "αβγθφψωσλκ",
        strict=True,
    )
)


def markup(mathtext: str) -> Markup:
    r"""Mathematics of `style.symbol` as HTML: $\dot{\theta}_{1}$ is θ̇ with a subscript; words stay words."""
    if not mathtext.startswith("$"):
        return escape(mathtext)
    text = mathtext.strip("$").replace(r"\min", "min")
    for name, letter in _LETTERS.items():
        text = text.replace(f"\\{name}", letter)
    text = str(escape(re.sub(r"\\dot\{(.)\}", "\\1\u0307", text)))
    stem, _, below = text.partition("_")
    letters, bracket, rest = stem.partition("(")
    subscript = below.replace("{", "").replace("}", "")
    if "(" in subscript:  # σ_{min}(S)
        subscript, _, rest = subscript.partition("(")
        bracket = "("
    found = f"<i>{letters}</i>" + (f"<sub>{subscript}</sub>" if subscript else "")
    return Markup(found + bracket + rest)


def panels(solution: Solution, most: int) -> list[Panel]:
    """Controls, outputs, error against the goal, margins, in this order; ``more`` marks what can wait.

    Legs stand for all the outputs of a system that has some, else its outputs, or the numbers of its state.
    ``most``: points of a curve at most.
    """
    found = [_controls(solution)] if solution.problem.system.input_space.size else []
    outputs = _outputs(solution)
    legs = [panel for panel in outputs if panel["name"] == "leg_lengths"]
    rest = [{**panel, "more": bool(legs)} for panel in outputs if panel not in legs]
    found += legs or ([] if rest else _states(solution))
    found += _errors(solution)
    found += _margins(solution)
    found = [panel for panel in [*found, *rest] if panel["curves"]]
    for curve in (curve for panel in found for curve in panel["curves"]):
        kept = thinned(len(curve["t"]), most)
        curve.update(t=[curve["t"][k] for k in kept], y=[curve["y"][k] for k in kept])
    return found


def _panel(name: str, title: str, curves: Iterable[tuple[str, Array, Array]], **more: Any) -> Panel:
    """One panel; every curve has words (mathtext), times and values."""
    drawn = [
        {
            "label": markup(words),
            "colour": COLOURS[i % len(COLOURS)],
            "dash": DASHES[i % len(DASHES)],
            "t": [float(f"{value:.7g}") for value in times],
            "y": [float(f"{value:.6g}") if np.isfinite(value) else None for value in values],
        }
        for i, (words, times, values) in enumerate(curves)
    ]
    return {"name": name, "title": title, "curves": drawn, "marks": [], "zero": False, "log": False, **more}


def _controls(solution: Solution) -> Panel:
    path, space = path_of(solution), solution.problem.system.input_space
    times, values = plots.with_jumps(
        solution, path.times, np.hstack([quantity(solution, block.name, path) for block in space.blocks])
    )
    names = [name for block in space.blocks for name in names_of(block.name, block.components, block.kind)]
    units = {block.unit for block in space.blocks}
    title = with_unit("controls", units.pop() if len(units) == 1 else "", rate=True)
    shown = zip(names[:MOST_CURVES], values.T, strict=False)
    return _panel("controls", title, [(name, times, column) for name, column in shown])


def names_of(name: str, count: int, kind: str = "vector") -> list[str]:
    """Mathematics for the components of a quantity."""
    return [symbol(name)] if kind == "scalar" else [symbol(name, i) for i in range(count)]


def _outputs(solution: Solution) -> list[Panel]:
    """Everything in the trajectory that is neither time, state, input nor margin, as the system names it."""
    system, path = solution.problem.system, path_of(solution)
    known = {"t", *system.state_space.names, *system.input_space.names}
    units = {block.name: block.unit for block in system.pose_outputs if block.kind != "direction"}
    found = []
    for name in solution.trajectory:
        values = quantity(solution, name, path)
        if name in known or name.startswith(("sigma_", "det_")) or not 0 < values.shape[1] <= MOST_CURVES:
            continue
        kind = "vector" if values.shape[1] > 1 else "scalar"
        words = zip(names_of(name, values.shape[1], kind), values.T, strict=True)
        title = with_unit(name.replace("_", " "), units.get(name, ""))
        found.append(_panel(name, title, [(label, path.times, column) for label, column in words]))
    return found


def _states(solution: Solution) -> list[Panel]:
    """The numbers of the state, a panel a unit."""
    path = path_of(solution)
    groups: dict[str, list[tuple[str, Array, Array]]] = {}
    for block in solution.problem.system.state_space.blocks:
        if block.kind != "rotation":
            values = quantity(solution, block.name, path).T
            named = zip(names_of(block.name, block.components, block.kind), values, strict=True)
            groups.setdefault(block.unit, []).extend((name, path.times, column) for name, column in named)
    return [
        _panel(f"state {unit}", with_unit("state", unit), curves[:MOST_CURVES])
        for unit, curves in groups.items()
    ]


def _errors(solution: Solution) -> list[Panel]:
    """The path relative to the goal: zero at the end is the goal reached. [Paper] Fig. 3."""
    times, found = path_of(solution).times, []
    for blocks in plots.goal_groups(solution):
        curves = []
        for block in blocks:
            values = plots.relative_values(solution, block)
            turned = block.kind in ("rotation", "direction")
            names = names_of("r", values.shape[1]) if turned else plots.error_labels(block)
            curves += [(name, times, column) for name, column in zip(names, values.T, strict=True)]
        first = blocks[0]
        words = "rotation error" if first.kind == "rotation" else f"{_stem(blocks)} error"
        title = with_unit(words, "angle" if first.kind in ("rotation", "direction") else first.unit)
        found.append(_panel(f"error {first.name}", title, curves[:MOST_CURVES], zero=True))
    return found


def _stem(blocks: Sequence[Any]) -> str:
    return blocks[0].name.replace("_", " ") if len(blocks) == 1 else "state"


def _margins(solution: Solution) -> list[Panel]:
    """Least singular values, with the times at which a determinant changes its sign."""
    path = path_of(solution)
    names = [name for name in solution.trajectory if name.startswith("sigma_")]
    curves = [
        (
            rf"$\sigma_{{\min}}({name.removeprefix('sigma_').upper()})$",
            path.times,
            np.ravel(quantity(solution, name, path)),
        )
        for name in names
    ]
    seen = np.concatenate([values for _, _, values in curves]) if curves else np.empty(0)
    seen = seen[np.isfinite(seen) & (seen > 0)]
    marks = [{"t": t, "which": which} for which, ts in plots.crossing_times(solution).items() for t in ts]
    log = bool(seen.size and seen.max() > 30 * seen.min() and not marks)
    return [_panel("margins", "margins: least singular values", curves, marks=marks, zero=not log, log=log)]
