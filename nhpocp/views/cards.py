"""Cards that a notebook shows of a problem, a solution, a comparison, an analysis or a system.

The verdict, a small table and a picture, as a piece of HTML that inherits the page's colours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from nhpocp.analysis import Analysis
from nhpocp.comparison import Comparison, Group
from nhpocp.doubts import doubts
from nhpocp.errors import one_line
from nhpocp.plain_text import brief
from nhpocp.planning import default_solver
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.systems.system import System
from nhpocp.views import analysis_figures, analysis_words, figures, report_words
from nhpocp.views.drawing import Pose
from nhpocp.views.overlays import overlays
from nhpocp.views.page import filled
from nhpocp.views.report_words import METHODS, given, number
from nhpocp.views.style import data_address

TEMPLATE = "cards.html.jinja"
INCH = 88  # pixels
MOST = 4  # problems of a comparison that are shown


@dataclass
class Part:
    """One thing that a card tells of; ``head``: of a table whose rows are more than a term and its words."""

    title: str
    tag: str = ""
    mood: str = "plain"  # good, bad
    subtitle: Any = ""
    sentences: Sequence[Any] = ()
    rows: Sequence[Sequence[Any]] = ()
    head: Sequence[Any] = ()
    warnings: Sequence[str] = ()
    picture: str = field(default="", init=False)
    width: int = field(default=0, init=False)
    description: str = field(default="", init=False)

    def drawn(self, description: str, draw: Callable[[], Figure | None]) -> Part:
        """With a picture, if there is one; what fails while it is drawn costs no more than the picture."""
        try:
            figure = draw()
            if figure is not None:
                self.picture, self.width = data_address(figure), round(INCH * figure.get_figwidth())
                self.description = description
        except Exception as error:  # noqa: BLE001 - a system's `drawing` is anybody's code
            self.warnings = [*self.warnings, f"no picture: {one_line(error)}"]
        return self


def card(shown: Any) -> str:
    """The card of an object, as HTML in which everything is escaped."""
    return filled(TEMPLATE, parts=parts_of(shown))


@singledispatch
def parts_of(shown: Any) -> list[Part]:
    """What a card tells of an object."""
    raise NotImplementedError(f"no card shows a {type(shown).__name__}")


@parts_of.register
def _of_solution(solution: Solution) -> list[Part]:
    verdict, problem, good = solution.verdict, solution.problem, solution.converged
    part = Part(
        problem.name,
        solution.outcome.value.replace("_", " ") if verdict else "not verified yet",
        "good" if good else "bad" if verdict else "plain",
        f"by the {METHODS.get(solution.solver, solution.solver)}",
        [solution.message],
        _measures(solution),
        warnings=list(dict.fromkeys([*solution.warnings, *(verdict.warnings if verdict else ())])),
    )
    if good or not verdict:
        return [part.drawn(f"The motion of {problem.name}", lambda: figures.robot(solution))]
    return [part.drawn("Why the solve failed", lambda: figures.failure(solution))]


def _measures(solution: Solution) -> list[tuple[Any, Any]]:
    verdict, problem = solution.verdict, solution.problem
    rows: list[tuple[Any, Any]] = []
    if verdict:
        error = Markup("{}, wanted {}").format(number(verdict.error, 3), given(solution.tolerance))
        rows.append((Markup("verified error <i>E</i>"), error))
        kept = sum(report.ok for report in verdict.bounds)
        rows += [("bounds kept", f"{kept} of {len(verdict.bounds)}")] if verdict.bounds else []
        rows += [("refuted", reason) for reason in verdict.reasons]
    if not problem.goal_is_a_pose and solution.pose_reached:
        rows.append(("pose reached", solution.pose_reached))
    rows.append(("effort", number(solution.control.effort, 6)))
    cost = solution.costs.get(problem.objective) if problem.objective != "effort" else None
    rows += [(problem.objective.replace("_", " "), number(cost, 6))] if cost is not None else []
    if problem.horizon.free:
        rows.append((Markup("duration <i>T</i>"), number(solution.control.horizon, 5)))
    rows.append(("evaluations", number(solution.evaluations)))
    seconds = solution.timing.get("total_s")
    return rows + ([("time", number(seconds, 2) + " s")] if seconds is not None else [])


@parts_of.register
def _of_problem(problem: PlanningProblem) -> list[Part]:
    said = [f"{doubt.path}: {doubt.message}" for doubt in doubts(problem, default_solver(problem).tolerance)]
    part = Part(
        problem.name,
        "doubtful" if said else "ok",
        "bad" if said else "good",
        problem.system.model,
        rows=report_words.task(problem),
        warnings=said,
    )
    return [part.drawn(f"The mechanism of {problem.name} at its start", lambda: figures.task(problem))]


@parts_of.register
def _of_comparison(comparison: Comparison) -> list[Part]:
    parts = [_of_group(group) for group in comparison.groups[:MOST]]
    rest = len(comparison.groups) - len(parts)
    if rest or comparison.notes or not parts:
        words = [f"{rest} more problems are in rows() and in the report."] if rest else []
        parts.append(Part("" if parts else "no runs", warnings=[*comparison.notes, *words]))
    return parts


def _of_group(group: Group) -> Part:
    names, runs = report_words.titles(group.entries), Comparison(group.entries).rows()
    good = sum(entry.solution.converged for entry in group.entries)
    rows = [
        (
            name,
            run["outcome"].replace("_", " "),
            number(run["verified_error"], 3),
            number(run["objective_value"], 5),
            report_words.percent(run["optimality_gap"]),
            number(run["evaluations"]),
            number(sum(run[key] or 0.0 for key in ("build_s", "solve_s")), 2),
        )
        for name, run in zip(names, runs, strict=True)
    ]
    cost = report_words.cost_symbol(group.problem)
    head = ["run", "ending", Markup("<i>E</i>"), cost, "gap", "evaluations", "time [s]"]
    part = Part(
        group.title,
        f"{good} of {len(rows)} verified",
        "good" if good == len(rows) else "bad",
        group.problem.system.model,
        report_words.verdict(group),
        rows,
        head,
    )

    def draw() -> Figure | None:
        made = overlays(group.entries, names, ("path",)) or overlays(group.entries, names, ("controls",))
        return made[0].figure if made else None

    return part.drawn(f"The motions of {', '.join(names)}", draw)


@parts_of.register
def _of_analysis(analysis: Analysis) -> list[Part]:
    said = analysis.controllability
    mood = {"controllable": "good", "not controllable": "bad"}.get(said.kind, "plain")
    part = Part(
        analysis.problem.name,
        said.kind,
        mood,
        analysis_words.size(analysis.problem.system),
        [said.sentence],
        analysis_words.rows(analysis),
        warnings=analysis.notes,
    )
    names = analysis_figures.names_of(analysis)
    draw = (lambda: analysis_figures.FIGURES[names[0]](analysis)) if names else (lambda: None)
    return [part.drawn(f"{names[0].replace('_', ' ') if names else ''} of {analysis.problem.name}", draw)]


@parts_of.register
def _of_system(system: System) -> list[Part]:
    spaces = {"state": system.state_space.blocks, "inputs": system.input_space.blocks}
    spaces["outputs"] = tuple(system.output_blocks or ())
    names = [f"{word} {', '.join(block.name for block in some)}" for word, some in spaces.items() if some]
    known = system.declared
    parameters = [
        (
            name,
            value if isinstance(value, str) else brief(value),
            known[name].described if name in known else "",
        )
        for name, value in system.parameters().items()
        if value is not None
    ]
    drift = "driftless" if system.driftless else "with drift"
    part = Part(
        system.model,
        subtitle=f" {system.state_space.dimension} dimensions, {system.input_space.size} inputs, {drift}",
        sentences=["; ".join(names)],
        rows=parameters,
        head=["parameter", "value", "meaning"],
    )
    return [part.drawn(f"The {system.model} at rest", lambda: _at_rest(system))]


def _at_rest(system: System) -> Figure | None:
    """A system that brings an example where that starts, its rotations unturned; none for one that draws nothing.

    An example is one of the default parameters: a vector that has other numbers is 0.
    """
    start = system.example.get("start", {})
    if set(start) != set(system.state_space.names):
        return None
    values = {}
    for block in system.state_space.blocks:
        value = np.eye(3) if block.kind == "rotation" else _numbers(start[block.name])
        values[block.name] = value if np.shape(value) == block.shape else np.zeros(block.shape)
    drawn = system.drawing(np.asarray(system.state_space.pack(values), dtype=float))
    return figures.standing(system, Pose("", drawn)) if drawn["lines"] else None


def _numbers(written: Any) -> Any:
    """Numbers as an example has them; one that is written as text, an angle, counts as 0."""
    if isinstance(written, list | tuple):
        return [_numbers(entry) for entry in written]
    return written if isinstance(written, int | float) else 0.0
