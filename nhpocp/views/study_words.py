"""Names and sentences of a study's report: axes, quantities, what was asked, what must not be concluded."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from typing import Any

from markupsafe import Markup, escape

from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.survey import Axis, Failures, Map, Quantity, Survey
from nhpocp.views import report_words
from nhpocp.views.labels import Notation, axis_label, markup, notation, symbol
from nhpocp.views.latex_table import cost_mathematics
from nhpocp.views.report_words import given, number

ANGLES = ("roll", "pitch", "yaw")
LONGEST = 16  # characters of a level that is no number
FEW_LEVELS = 12  # that are named one by one
_END = re.compile(r"(start|goal)\.(\w+)(\.rpy)?(?:\[(\d+)\])?")


# --- axes -----------------------------------------------------------------------------------------------------------


def axis_notation(axis: Axis, problem: PlanningProblem) -> Notation:
    """Words, symbol and unit of an axis: that of a state's number, or the last name of the key's path."""
    unit, system = "°" if axis.degrees else "", problem.system
    if end := _END.fullmatch(axis.path):
        blocks = {block.name: block for block in (*system.state_space.blocks, *system.pose_outputs)}
        which, name, angles, place = end.groups()
        block = blocks.get(name)
        if block is not None and angles and place and int(place) < 3:
            several = sum(other.kind == "rotation" for other in system.state_space.blocks) > 1
            words = f"{which} {name} {ANGLES[int(place)]}" if several else f"{which} {ANGLES[int(place)]}"
            return Notation(words, "", unit or "rad")
        if block is not None and block.kind in ("vector", "scalar"):
            of = notation(system, name, *([int(place)] if place else []), units=problem.units)
            return Notation(" ".join(filter(None, [which, of.words])), of.symbol, unit or of.unit)
    *above, last = re.findall(r"\w+", axis.path.partition("[")[0])
    place = axis.path.partition("[")[2].rstrip("]")
    if last in ("min", "max", "initial") and above:
        return Notation(f"{above[-1]} {last}".replace("_", " "), "", unit)
    named = symbol(last, *([int(place)] if place.isdigit() else []))
    return Notation("", named, unit) if "$" in named else Notation(named, "", unit)


def axis_words(axis: Axis, problem: PlanningProblem) -> str:
    """The label of an axis in a picture."""
    return axis_label(*axis_notation(axis, problem))


def level_words(axis: Axis, level: Any, unit: bool = False) -> str:
    """A level as a picture writes it."""
    if axis.numeric:
        written = f"{axis.shown(level):.3g}".replace("-", "\N{MINUS SIGN}")
        return written + "°" * (unit and axis.degrees)
    text = level if isinstance(level, str) else json.dumps(level, default=str)
    text = text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
    return text.replace("\\", "").replace("$", r"\$")


def panel_words(axis: Axis, level: Any, problem: PlanningProblem) -> str:
    """The title of a panel: an axis and its level."""
    words, named, unit = axis_notation(axis, problem)
    of = " ".join(filter(None, [words, named]))
    named_unit = f" {unit}" if unit and not axis.degrees and problem.units.length else ""
    return f"{of} = {level_words(axis, level, unit=True)}{named_unit}"


def _levels(axis: Axis) -> str:
    unit = " deg" if axis.degrees else ""
    if axis.numeric and (axis.drawn or len(axis.levels) > FEW_LEVELS):
        least, most = (level_words(axis, value) for value in (min(axis.levels), max(axis.levels)))
        return f"{len(axis.levels)} {'drawn ' if axis.drawn else ''}from {least} to {most}{unit}"
    shown = ", ".join(level_words(axis, level).replace(r"\$", "$") for level in axis.levels[:FEW_LEVELS])
    return shown + (", …" if len(axis.levels) > FEW_LEVELS else "") + unit


# --- quantities -----------------------------------------------------------------------------------------------------


def quantity_label(quantity: Quantity, problem: PlanningProblem) -> str:
    """The label of a quantity in a picture."""
    if quantity.kind == "cost":
        control = report_words.control_symbol(problem)
        mathematics = cost_mathematics(OBJECTIVES[quantity.name].symbol, control).replace(r"\int ", r"\int\,")
        name = quantity.name.replace("_", " ")
        return f"{name} {mathematics}" if mathematics.startswith("$") and "mbox" not in mathematics else name
    if quantity.kind == "margin":
        return axis_label("least", symbol(quantity.name), "–")
    return {"error": "verified error $E$", "evaluations": "evaluations", "seconds": "solving [s]"}[
        quantity.kind
    ]


def quantity_words(quantity: Quantity, problem: PlanningProblem) -> Markup:
    """The name of a quantity in a table."""
    if quantity.kind == "cost":
        return report_words.cost_label(OBJECTIVES[quantity.name], problem)
    return markup(quantity_label(quantity, problem).replace(" [–]", ""))


# --- what was asked -------------------------------------------------------------------------------------------------


def facts(survey: Survey) -> list[tuple[str, Any]]:
    """Terms and their meanings, at the head of the page."""
    rows: list[tuple[str, Any]] = []
    names = report_words.run_names(survey.solvers)
    for axis in survey.axes:
        label = markup(axis_words(axis, survey.problem))
        rows.append((f"Axis {axis.path}", Markup("{}: {}").format(label, _levels(axis))))
    points = survey.runs // len(names)
    rows.append(("Solvers", "; ".join(names)))
    rows.append(("Runs", f"{points} points × {len(names)} solvers" if len(names) > 1 else f"{points} points"))
    rows.append(("Order", ORDERS.get(survey.order, survey.order)))
    spent = Markup("{} by the clock, {} of solving and verifying").format(
        duration(survey.seconds), duration(survey.processor)
    )
    if survey.workers:
        spent += f"; processes: {', '.join(map(str, survey.workers))}"
    rows.append(("Time", spent))
    rows.append(("Store", survey.store))
    return rows


ORDERS = {"given": "as given", "nearest": "nearest: a goal begins with the plan to its neighbour"}


def task(problem: PlanningProblem) -> list[tuple[str, Any]]:
    """The problem around which the axes vary."""
    return list(report_words.task(problem))


def duration(seconds: float) -> str:
    """Seconds as people read them."""
    if seconds < 120:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


# --- the verdict ----------------------------------------------------------------------------------------------------


def verdict(survey: Survey) -> list[str]:
    """How many were solved; by which solver, and what became of the others."""
    stored, solved = survey.stored, survey.solved
    missing = f" of {survey.runs}" if stored < survey.runs else ""
    sentences = [
        f"{stored}{missing} runs: {solved} solved and confirmed by an independent integration, "
        f"{stored - solved} failed."
    ]
    if stored < survey.runs:
        sentences.append(f"{survey.runs - stored} runs are not stored yet; nhpocp sweep --resume runs them.")
    if len(survey.solvers) > 1:
        names = report_words.run_names(survey.solvers)
        parts = [
            f"{name} {good} of {some}"
            for name, (some, good) in zip(names, survey.tallies.values(), strict=True)
        ]
        sentences.append("Solved by " + "; ".join(parts) + ".")
    if survey.failures:
        most = survey.failures[0]
        sentences.append(f"The commonest failure: {failure_words(most)} ({most.count} runs).")
    return sentences


def failure_words(some: Failures) -> str:
    """How runs failed: their ending, and the bounds and determinants by which."""
    by = f": {', '.join(some.broken)}" if some.broken else ""
    return some.outcome.replace("_", " ") + by


def failures(survey: Survey, most: int) -> list[dict[str, Any]]:
    """The table of failures, the commonest first."""
    return [
        {
            "ending": some.outcome.replace("_", " "),
            "broken": ", ".join(some.broken) or report_words.MISSING,
            "counts": [some.counts.get(label, 0) for label in survey.solvers],
            "count": some.count,
            "command": f"nhpocp solve --from {shlex.quote(survey.store)} --run {some.run}",
            "again": some.kept,
            "message": some.message.removesuffix(Outcome(some.outcome).advice).strip(),
            "advice": Outcome(some.outcome).advice,
        }
        for some in survey.failures[:most]
    ]


# --- pictures -------------------------------------------------------------------------------------------------------


def over_words(chart: Map) -> Markup:
    """What the cells of a map hold together."""
    parts = []
    if chart.beside:
        names = ", ".join(axis.path for axis in chart.beside)
        parts.append(Markup("A cell holds all levels of {}: shares and medians of its runs.").format(names))
    for axis, group in zip([chart.columns, chart.rows], chart.group, strict=True):
        if axis is not None and group > 1:
            parts.append(Markup("{} levels of {} share a cell.").format(group, axis.path))
    return Markup(" ").join(parts)


# --- limits ---------------------------------------------------------------------------------------------------------

FAILED = (
    "A run that failed says that this solver, so set, found no plan; where the goal itself breaks a bound, or lies "
    "across a singular surface, there is none."
)
LOCAL = "Every plan is a local one: neither solver proves that no better motion exists."
BATCHED = (
    "Goals that differ in nothing else were planned together: the seconds of such a run are its share of theirs, and "
    "what was built is in none of them."
)
SECONDS = (
    "Seconds are of solving alone, one run each, in processes that worked beside one another; what they share, such as "
    "a processor's cache, counts too."
)
CHAINED = (
    "Each goal began with the plan to its neighbour (order: nearest): effort and evaluations depend on the way through "
    "the goals, too."
)
UNMINIMISED = (
    "The Jacobian method minimises nothing where its objective is none: its effort is that of the first control that "
    "reaches the goal."
)


def limits(survey: Survey) -> Iterator[str]:
    """What a reader must not conclude: the sentences that hold of this study."""
    if survey.solved < survey.stored:
        yield FAILED
    yield LOCAL
    if survey.unminimised:
        yield UNMINIMISED
    if survey.order == "nearest":
        yield CHAINED
    yield BATCHED if survey.batched else SECONDS


def value_words(quantity: Quantity, value: float | None) -> Markup:
    """A number of a table of quantiles."""
    return given(value) if quantity.kind == "evaluations" else number(value, 4)


def shift_words(quantity: Quantity, shift: float, problem: PlanningProblem) -> Markup:
    """Which shift a geometric mean has."""
    unit = " s" if quantity.kind == "seconds" else ""
    return Markup("{}: shift {}{}").format(quantity_words(quantity, problem), given(shift), escape(unit))
