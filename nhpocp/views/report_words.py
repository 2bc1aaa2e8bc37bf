"""Numbers and sentences of a report: what was asked, the verdict, the limits of the comparison."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nhpocp import so3, variant_label
from nhpocp.comparison import Entry, Group
from nhpocp.objectives.objective import Objective
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.systems.margins import margin

METHODS = {"jacobian": "Jacobian method", "nlp": "NLP"}
MISSING = "–"


def number(value: Any, digits: int = 4) -> Markup:
    """A number for reading: few digits, a true minus, powers of ten written out."""
    if isinstance(value, bool | str):
        return Markup.escape(value if isinstance(value, str) else "yes" if value else "no")
    if isinstance(value, int):
        return _written(str(value))
    if value is None or not math.isfinite(value):
        return Markup(MISSING)
    if value and not 1e-3 <= abs(value) < 1e6:
        return _written(f"{value:.{min(digits, 3) - 1}e}")
    return _written(f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}" if value else "0")


def given(value: float | None) -> Markup:
    """A number that somebody chose, with the digits that it was given."""
    words = _written(f"{value:g}") if value is not None and math.isfinite(value) else Markup(MISSING)
    return Markup(words.removeprefix("1&#8239;·&#8239;"))


def _written(digits: str) -> Markup:
    """A number's digits as HTML."""
    mantissa, mark, exponent = digits.partition("e")
    power = f"&#8239;·&#8239;10<sup>{int(exponent)}</sup>" if mark else ""
    return Markup((mantissa + power).replace("-", "−"))


def percent(value: float | None) -> Markup:
    """A fraction as per cent; what no reader would call a difference is zero."""
    if value is None:
        return Markup(MISSING)
    return Markup(
        "0 %" if abs(value) < 5e-7 else f"{100 * value:.{1 if value >= 0.01 else 4}f} %".replace("-", "−")
    )


def titles(entries: Sequence[Entry]) -> list[str]:
    """How the runs are called in words: `nlp:control=basis` is NLP (control = basis); only what differs is said."""
    return run_names([entry.variant for entry in entries])


def run_names(labels: Sequence[str]) -> list[str]:
    """How runs of these variants are called in words."""
    parts = [variant_label.parts(label) for label in variant_label.distinct(labels)]
    names = [(METHODS.get(name, name), ", ".join(map(_setting, settings))) for name, settings in parts]
    return [f"{name} ({rest})" if rest else name for name, rest in names]


def _setting(setting: str) -> str:
    return setting.removeprefix("control.").replace("=", " = ", 1)


def control_symbol(problem: PlanningProblem) -> str:
    label = problem.system.input_label()
    return label if isinstance(label, str) else "control"


def cost_symbol(problem: PlanningProblem) -> Markup:
    """The objective as mathematics."""
    return symbol(OBJECTIVES[problem.objective], problem)


def symbol(objective: Objective, problem: PlanningProblem) -> Markup:
    """A cost as mathematics, its times in italics."""
    text = str(Markup.escape(objective.symbol.format(control=control_symbol(problem))))
    return Markup(re.sub(r"\b(d?)([tT])\b", r"\1<i>\2</i>", text))


def cost_label(objective: Objective, problem: PlanningProblem) -> Markup:
    """A cost by its name and, where that is more, its symbol."""
    name, mathematics = Markup.escape(objective.name.replace("_", " ")), symbol(objective, problem)
    return mathematics if mathematics.startswith(name) else name + " " + mathematics


def _named(title: str) -> str:
    return f"the {title}" if title.split(" (")[0] in METHODS.values() else title


def _listed(parts: Iterable[Any]) -> Markup:
    *first, last = [Markup.escape(part) for part in parts]
    return Markup("{} and {}").format(Markup(", ").join(first), last) if first else last


def _start(sentence: Markup) -> Markup:
    return Markup(str(sentence)[:1].upper() + str(sentence)[1:])


# --- the verdict ----------------------------------------------------------------------------------------------------


def verdict(group: Group) -> list[Markup]:
    """Two sentences: who reaches the goal, confirmed, and at what cost."""
    named = list(zip(group.entries, map(_named, titles(group.entries)), strict=True))
    return [_start(_reached(named)), _start(_costs(group, named))]


_Named = Sequence[tuple[Entry, str]]


def _reached(named: _Named) -> Markup:
    good = [_claim(entry, name) for entry, name in named if entry.solution.converged]
    bad = [_failure(entry, name) for entry, name in named if not entry.solution.converged]
    if good and bad:
        reach = "reaches" if len(good) == 1 else "reach"
        return Markup("Confirmed by an independent integration, {} {} the goal; {}.").format(
            _listed(good), reach, _listed(bad)
        )
    who = {1: "the only run reaches", 2: "both runs reach"}.get(len(good), f"all {len(good)} runs reach")
    if good:
        return Markup("{} the goal, and an independent integration confirms it: {}.").format(
            who, _listed(good)
        )
    who = {1: "the only run does not reach", 2: "neither run reaches"}.get(
        len(bad), "none of the runs reaches"
    )
    within = " within its bounds" if named[0][0].solution.problem.bounds else ""
    return Markup("{} the goal{}: {}.").format(who, within, _listed(bad))


def _claim(entry: Entry, name: str) -> Markup:
    error = number(entry.solution.verdict.error if entry.solution.verdict else None, 3)
    return Markup("{} with <i>E</i>&nbsp;=&nbsp;{} (tolerance {})").format(
        name, error, given(entry.solution.tolerance)
    )


def _failure(entry: Entry, name: str) -> Markup:
    """Why a run is not among the verified ones."""
    solution = entry.solution
    if entry.claim_right is False:
        reasons = solution.verdict.refusal if solution.verdict else ""
        return Markup("{} claimed success and was refuted ({})").format(name, reasons or "no reason stored")
    reason = solution.message.removesuffix(solution.outcome.advice).strip().rstrip(".").replace(". ", "; ")
    return Markup("{} ended as <q>{}</q> ({})").format(
        name, solution.outcome.value.replace("_", " "), reason or "no reason stored"
    )


def _costs(group: Group, named: _Named) -> Markup:
    best, what = group.best, cost_symbol(group.problem)
    if best is None:
        return Markup("There is no verified motion whose cost could be compared.")
    good = [pair for pair in named if pair[0].solution.converged and math.isfinite(pair[0].objective_value)]
    if len(good) == 1:
        return Markup("Its {} is {}; there is no other verified motion to compare it with.").format(
            what, number(best, 5)
        )
    winner = min(good, key=lambda pair: pair[0].objective_value)
    times = [entry.solution.timing for entry, _ in good]
    seconds = [number(time.get("build_s", 0.0) + time.get("solve_s", 0.0), 2) + " s" for time in times]
    return Markup(
        'the cheapest motion is that of {}, <span class="whole">{} = {}</span>; {} (built and solved in {}, in the '
        "order of the table)."
    ).format(
        winner[1],
        what,
        number(best, 5),
        _listed(_dearer(*pair, best) for pair in good if pair is not winner),
        _listed(seconds),
    )


def _dearer(entry: Entry, name: str, best: float) -> Markup:
    gap = entry.objective_value / best - 1 if best > 0 else 0.0
    if abs(gap) < 5e-7:
        return Markup("that of {} costs the same").format(name)
    return Markup("that of {} costs {} more ({})").format(
        name, percent(gap), number(entry.objective_value, 5)
    )


# --- what was asked -------------------------------------------------------------------------------------------------


def introduction(source: str | None) -> list[str]:
    """The comment at the head of a problem file, by paragraph."""
    paragraphs: list[list[str]] = [[]]
    for line in (source or "").splitlines():
        if line.strip() and not line.strip().startswith("#"):
            break
        words = line.strip().lstrip("#").strip()
        if not words:
            paragraphs.append([])
        elif not words.startswith(("yaml-language-server", "(write that file with")):
            paragraphs[-1].append(words)
    return [" ".join(words) for words in paragraphs if words]


def facts(group: Group) -> list[tuple[str, Markup]]:
    """The problem term by term, and how it is measured."""
    problem = group.problem
    error = Markup(
        "norm of the differences from the goal at <i>T</i>; a length of {} counts as much as one radian"
    )
    terms = [
        *task(problem, _beginnings(group)),
        ("Error E", error.format(_vector(problem.error_length))),
        ("Length scale", given(problem.scale)),
    ]
    return terms + ([("Reference values", _reference(problem))] if problem.reference else [])


def task(problem: PlanningProblem, beginnings: Markup | None = None) -> list[tuple[str, Markup]]:
    """What is asked, term by term; ``beginnings``: the controls to begin with, unless it is the problem's own."""
    horizon = problem.horizon
    parameters = problem.system.parameters().items()
    stated = ", ".join(f"{key} = {_parameter(value)}" for key, value in parameters if value is not None)
    span = Markup("free in [{}, {}]").format(given(horizon.minimum), given(horizon.maximum))
    return [
        ("System", Markup("{}: {}").format(problem.system.model, stated or "no parameters")),
        ("Start", _pose(problem, problem.start)),
        ("Goal", _pose(problem, problem.goal)),
        *((f"Via pose at {via.share:g} T", _pose(problem, via.goal)) for via in problem.via),
        ("Horizon T", span if horizon.free else given(horizon.fixed)),
        ("Control to begin with", beginnings or _initial(problem)),
        ("Objective", Markup("{}, {}").format(problem.objective.replace("_", " "), cost_symbol(problem))),
        *((("Obstacles", _obstacles(problem)),) if problem.obstacles else ()),
        ("Constraints on the path", _bounds(problem)),
    ]


def units(problem: PlanningProblem) -> str:
    """What the table's numbers are counted in."""
    length = problem.units.length or "the problem file's unit"
    return f"Lengths in {length}, times in {problem.units.time or 'its unit of time'}, angles in radians."


def controls(group: Group) -> dict[Markup, list[int]]:
    """What the runs begin with, and which of them begin so."""
    places: dict[Markup, list[int]] = {}
    for place, entry in enumerate(group.entries):
        places.setdefault(_initial(entry.solution.problem), []).append(place)
    return places


def _beginnings(group: Group) -> Markup:
    """The control to begin with; by the names of the runs where they differ in it."""
    beginnings, names = controls(group), titles(group.entries)
    if len(beginnings) == 1:
        return next(iter(beginnings))
    return Markup("; ").join(
        Markup("{}: {}").format(_listed(names[i] for i in places), words)
        for words, places in beginnings.items()
    )


def _parameter(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) < 400 else f"{text[:400]}…"


def _pose(problem: PlanningProblem, values: Any) -> Markup:
    """The state's blocks, those without a value too, and the outputs that have one."""
    parts = []
    for block in (*problem.system.state_space.blocks, *problem.system.pose_outputs):
        name, free = block.name, block.name not in values
        if free and block in problem.system.pose_outputs:
            continue
        if free:
            parts.append(Markup("{} free").format(name))
        elif block.kind == "rotation":
            angles = np.degrees(np.asarray(so3.to_rpy(np.asarray(values[name])), dtype=float))
            parts.append(Markup("{} roll, pitch, yaw = {}").format(name, _vector(angles, "°")))
        else:
            parts.append(Markup("{} = {}").format(name, _vector(values[name])))
    return Markup("; ").join(parts)


def _vector(values: Any, unit: str = "") -> Markup:
    words = [f"{0.0 if abs(x) < 1e-12 else x:.6g}{unit}".replace("-", "−") for x in np.ravel(values)]
    return Markup(words[0] if len(words) == 1 else f"({', '.join(words)})")


def _initial(problem: PlanningProblem) -> Markup:
    basis = problem.basis
    parameters = ", ".join(f"{value} {key}" for key, value in basis.parameters().items())
    words = f"{basis.kind.replace('_', ' ')}, {parameters}"
    if problem.initial is None:
        return Markup("{}; drawn by a seed").format(words)
    if basis.size > 12:
        return Markup("{}; coefficients in the problem file").format(words)
    rows = [
        Markup('<span class="whole">{}: {}</span>').format(name, _vector(row))
        for name, row in zip(problem.system.input_space.labels, problem.initial, strict=True)
    ]
    return Markup("{} ({}); ").format(words, ", ".join(basis.labels)) + Markup("; ").join(rows)


def _obstacles(problem: PlanningProblem) -> Markup:
    """Each with its numbers; of many corners how many they are."""
    parts = []
    for obstacle in problem.obstacles:
        entries = [
            Markup("{} {}").format(name, _vector(value) if np.size(value) <= 4 else f"of {len(value)} points")
            for name, value in obstacle.entries.items()
            if not isinstance(value, str)
        ]
        parts.append(Markup("{}: {}").format(obstacle.name, Markup(", ").join(entries)))
    return Markup("; ").join(parts)


def _bounds(problem: PlanningProblem) -> Markup:
    parts = []
    for bound in problem.bounds:
        sides = [("≥", bound.lower), ("≤", bound.upper)]
        limits = [f"{sign} {_vector(side)}" for sign, side in sides if np.isfinite(np.ravel(side)).any()]
        parts.append(Markup("{} {}").format(bound.label, " and ".join(limits)))
    return Markup("; ").join(parts) or Markup("none")


def _reference(problem: PlanningProblem) -> Markup:
    parts = []
    for key, value in problem.reference.items():
        if isinstance(value, dict):
            value = ", ".join(
                f"{name} {_parameter(item)}" for name, item in value.items() if item is not None
            )
        if value is not None:
            parts.append(Markup("{}: {}").format(METHODS.get(key, key), _parameter(value)))
    return Markup("; ").join(parts)


# --- the limits -----------------------------------------------------------------------------------------------------

SPACES = Markup(
    "The controls come from different function spaces ({}). Each space has its own optimum, so part of any gap in cost "
    "is the space and not the method; {}."
)
SHARED = "only runs in one space compare the methods alone"
UNSHARED = "the variant nlp:control=basis compares both methods in one space"
TAKEN = (
    "The Jacobian method minimises nothing here: it takes the first control that reaches the goal. Its gap in cost is "
    "what that costs, not a failure."
)
TOLERANCES = Markup(
    "The tolerances differ: {}. A looser one is met with fewer iterations and permits a slightly cheaper motion."
)
LOCAL = (
    "Each method finds a local solution near where it starts; neither proves that no better motion exists."
)
TIMES = (
    "Every time is from one run on the machine below, all runs one after another in one process; a later run may "
    "profit from what an earlier one has loaded. Peak memory is that of the whole process."
)
SAMPLED = "Extremes along the path (margins, legs) are of the stored samples; verification uses a finer grid."
UNVERIFIED = "Runs that are not verified have no part in the optimality gap."


def limits(group: Group) -> list[Markup]:
    """What a reader must not conclude from the table: the sentences that hold of these runs."""
    solutions = [entry.solution for entry in group.entries]
    tried = [entry.solution for entry in group.entries if entry.tried]
    names = titles(group.entries)
    spaces: dict[str, list[str]] = {}
    tolerances: dict[float, list[str]] = {}
    for entry, name in zip(group.entries, names, strict=True):
        basis = entry.solution.control.basis
        if entry.tried:
            space = f"{basis.kind.replace('_', ' ')}, {basis.size} numbers per input"
            spaces.setdefault(space, []).append(name)
        tolerances.setdefault(entry.solution.tolerance, []).append(name)
    shared = SHARED if any(len(who) > 1 for who in spaces.values()) else UNSHARED
    which = Markup("; ").join(Markup("{}: {}").format(space, _listed(who)) for space, who in spaces.items())
    differing = [Markup("{} ({})").format(given(value), ", ".join(who)) for value, who in tolerances.items()]
    sampled = any(
        margin(name) or name.startswith("leg_") for solution in solutions for name in solution.trajectory
    )
    sentences = [
        (len(spaces) > 1, SPACES.format(which, shared)),
        (any(solution.objective == "none" for solution in tried), TAKEN),
        (len(tolerances) > 1, TOLERANCES.format(_listed(differing))),
        (True, LOCAL),
        (True, TIMES),
        (sampled, SAMPLED),
        (any(solution.outcome is not Outcome.CONVERGED for solution in solutions), UNVERIFIED),
    ]
    return [Markup.escape(sentence) for holds, sentence in sentences if holds]
