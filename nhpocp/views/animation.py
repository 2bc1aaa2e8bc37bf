"""Motions as one self-contained page that plays: scenes side by side on one clock, and the quantities over time.

The page carries its own painter and player (animation_*.js), 35 kB of script. plotly was tried first: moving one ball
and 100 points of a line cost it 41 ms of script a frame (headless Chromium, median of 60, 2 shared cores), loading it
5 s, its script alone is 4.8 MB, and its scenes need WebGL, which remote desktops often lack. This takes about 10 ms for
all of the paper's robot and its curves, anywhere.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from nhpocp.comparison import Entry
from nhpocp.errors import InvalidProblemError
from nhpocp.solution import Solution
from nhpocp.views import drawing, report_words
from nhpocp.views.curves import as_data
from nhpocp.views.finite_path import path_of
from nhpocp.views.labels import markup
from nhpocp.views.page import filled
from nhpocp.views.panels import crossing_words, panels
from nhpocp.views.routes import ROUTE, route_places
from nhpocp.views.scene import drawn, scene
from nhpocp.whole import write_text

TEMPLATE = "animation.html.jinja"
MARKER = "nhpocp animate"  # in every file that this makes, so that it may be replaced
LARGEST = 6  # motions side by side
SAMPLES, LEAST = 1001, 201  # of all motions together, but so many of each: a page stays well below 6 MB


def write_animation(entries: Sequence[Entry], path: str | os.PathLike[str]) -> Path:
    """Writes the page and returns its path. The same solutions give the same bytes.

    Its data are JSON, in the element `animation-data`: `runs`, each with `times`, and `parts` whose `values` hold one
    entry a sample, such as the two ends of "leg 1", a_i and b_i in base coordinates, as they were stored.
    Errors: `InvalidProblemError` as of `check_motions`.
    """
    target = Path(path)
    write_text(target, render(entries))
    return target


def animate_runs(entries: Sequence[Entry], path: Path) -> Path | None:
    """Writes the page of those runs that have a path to show, the first `LARGEST`; nothing where none has."""
    moved = [entry for entry in entries if entry.tried and path_of(entry.solution).samples]
    return write_animation(moved[:LARGEST], path) if moved else None


def check_motions(entries: Sequence[Entry]) -> None:
    """Errors: `InvalidProblemError` for a solution without a path, for too many, and for motions in space beside
    motions in the plane; different systems of one dimension may stand side by side."""
    if len(entries) > LARGEST:
        raise InvalidProblemError(f"{len(entries)} solutions; expected at most {LARGEST} side by side")
    dimensions: dict[int, str] = {}
    for entry in entries:
        solution, place = entry.solution, entry.folder or entry.solution.problem.name
        if not path_of(solution).samples:
            raise InvalidProblemError(
                f"this solution has no path to show: it ended as {solution.outcome.value}, {solution.message}",
                file=place,
            )
        numbers = drawing.dimension(drawn(solution.problem.system, solution.problem.start_point))
        dimensions.setdefault(numbers, place)
    if len(dimensions) > 1:
        raise InvalidProblemError(
            f"{dimensions[2]} moves in the plane and {dimensions[3]} in space; expected motions of one kind"
        )


def render(entries: Sequence[Entry], samples: int | None = None) -> str:
    """The page as text; ``samples``: of each motion at most, unless as many as a page of this size has room for."""
    check_motions(entries)
    names = report_words.titles(entries)
    problems = list(dict.fromkeys(entry.solution.problem.name for entry in entries))
    if len(problems) > 1:
        names = [f"{e.solution.problem.name}, {name}" for e, name in zip(entries, names, strict=True)]
    most = samples or max(LEAST, SAMPLES // len(entries))
    runs = [run(entry.solution, name, most) for entry, name in zip(entries, names, strict=True)]
    horizon = max(path_of(entry.solution).times[-1] for entry in entries)
    unit = entries[0].solution.problem.units.time or ""
    _one_box(entries, runs)
    times = sorted({crossing["t"] for run in runs for crossing in run["crossings"]})
    ticks = [t / horizon for t in times]
    return page(f"Motion: {', '.join(problems)}", _lead(runs, times), runs, (horizon, unit), ticks)


def page(
    title: str, lead: str, runs: Sequence[Any], clock: tuple[float, str], ticks: Sequence[float] = ()
) -> str:
    """The page of runs, `run`; clock: how long it runs, and the unit of that; ticks: shares of it to be marked."""
    data = {"horizon": float(clock[0]), "time_unit": clock[1], "runs": runs}
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return filled(
        TEMPLATE,
        title=title,
        lead=lead,
        data=data,
        ticks=[f"{tick:.4f}" for tick in ticks],
        marker=MARKER,
        text=Markup(text.replace("<", "\\u003c")),  # no end of the script inside it
    )


def _lead(runs: Sequence[Any], crossings: Sequence[float]) -> str:
    words = "Positions are those of the stored trajectory. Dashed outlines are the start and the goal"
    if crossings:
        words += "; red marks are singularities that the path crosses"
    return f"{words}. {'All motions run on one clock. ' if len(runs) > 1 else ''}"


def run(solution: Solution, title: str, most: int) -> dict[str, Any]:
    """One solution's part of the page's data."""
    shown, curves = scene(solution, most), as_data(panels(solution), 4 * most)
    system = solution.problem.system.model
    alarms = [*crossing_words(solution), *filter(None, [path_of(solution).words])]
    if not solution.converged:
        alarms.append(f"This motion is not a verified solution: {solution.message}")
    return {
        "title": title,
        "words": _words(solution),
        "alarms": alarms,
        "description": f"The moving {system} of {title}, from start to goal; the curves give its numbers over time",
        "legend": legend(solution),
        "has_more": any(panel["more"] for panel in curves),
        "panels": curves,
        **shown,
    }


def _words(solution: Solution) -> Markup:
    """The system, the ending, the verified error and the cost of a run, on a line."""
    system, number = solution.problem.system, report_words.number
    words = Markup("{}: {}").format(system.model, solution.outcome.value.replace("_", " "))
    if solution.verdict and solution.verdict.error is not None:
        words += Markup(", verified error <i>E</i> = {}").format(number(solution.verdict.error, 3))
    cost = Markup(", ∫|{}|² d<i>t</i> = {}")
    return words + cost.format(
        report_words.control_symbol(solution.problem), number(solution.control.effort, 5)
    )


def legend(solution: Solution) -> list[tuple[str, str]]:
    """Words (HTML) and colours of the legs, of the kinds of lines that the scene shows, and of the route."""
    shown = drawn(solution.problem.system, solution.problem.start_point)
    gone = {name for solid in shown.get("solids", {}).values() for name in solid.get("replaces", ())}
    lines = {
        name: line
        for name, line in shown["lines"].items()
        if not {name, drawing.split_name(name)[0]} & gone or drawing.is_closed(np.asarray(line))
    }
    entries = drawing.legend_entries({**shown, "lines": lines})
    entries += [("route", ROUTE)] if route_places(solution) is not None else []
    return [(str(markup(words)), look["color"]) for words, look in entries]


def same_system(entries: Sequence[Entry]) -> bool:
    """Whether all runs move one mechanism."""
    systems = [entry.solution.problem.system for entry in entries]
    return all(
        system.model == systems[0].model and system.parameters() == systems[0].parameters()
        for system in systems
    )


def _one_box(entries: Sequence[Entry], runs: Sequence[dict[str, Any]]) -> None:
    """Motions of one system are seen in one box, so that they can be compared by eye."""
    if same_system(entries):
        low = [min(values) for values in zip(*(run["low"] for run in runs), strict=True)]
        high = [max(values) for values in zip(*(run["high"] for run in runs), strict=True)]
        for part in runs:
            part.update(low=low, high=high)
