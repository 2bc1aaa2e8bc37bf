"""Numbers and sentences of a report: what was asked, the verdict, the limits of the comparison."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nhpocp import so3
from nhpocp.comparison import Entry, Group
from nhpocp.objectives.objective import Objective
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome

METHODS = {"jacobian": "Jacobian method", "nlp": "NLP"}
MISSING = "–"


def number(value: Any, digits: int = 4) -> Markup:
    """A number for reading: few digits, a true minus, powers of ten written out."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return Markup(MISSING)
    if isinstance(value, bool | str):
        return Markup.escape(value if isinstance(value, str) else "yes" if value else "no")
    if isinstance(value, int):
        return Markup(f"{value}".replace("-", "−"))
    if value == 0:
        return Markup("0")
    if 1e-3 <= abs(value) < 1e6:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        return Markup(f"{value:.{places}f}".replace("-", "−"))
    mantissa, exponent = f"{value:.{min(digits, 3) - 1}e}".split("e")
    power = str(int(exponent)).replace("-", "−")
    return Markup(f"{mantissa.replace('-', '−')}&#8239;·&#8239;10<sup>{power}</sup>")


def given(value: float | None) -> Markup:
    """A number that somebody chose, with the digits that it was given."""
    if value is None or not math.isfinite(value):
        return Markup(MISSING)
    mantissa, mark, exponent = f"{value:g}".replace("-", "−").partition("e")
    if not mark:
        return Markup(mantissa)
    power = Markup("10<sup>{}</sup>").format(str(int(exponent.replace("−", "-"))).replace("-", "−"))
    return power if mantissa == "1" else Markup("{}&#8239;·&#8239;{}").format(mantissa, power)


def percent(value: float | None) -> Markup:
    """A share as per cent; what no reader would call a difference is zero."""
    if value is None:
        return Markup(MISSING)
    return Markup(
        "0 %" if abs(value) < 5e-7 else f"{100 * value:.{1 if value >= 0.01 else 4}f} %".replace("-", "−")
    )


def titles(entries: Sequence[Entry]) -> list[str]:
    """How the runs are called in words: `nlp:control=basis` is NLP (control = basis)."""
    found = []
    for entry in entries:
        name, colon, rest = entry.variant.partition(":")
        words = METHODS.get(name, name)
        found.append(f"{words} ({rest.replace('=', ' = ').replace(',', ', ')})" if colon else words)
    return found


def _named(title: str) -> str:
    return f"the {title}" if title.split(" (")[0] in METHODS.values() else title


def _listed(parts: Iterable[Any], last: str = "and") -> Markup:
    items = list(parts)
    if len(items) < 2:
        return Markup("").join(items)
    return Markup("{} {} {}").format(Markup(", ").join(items[:-1]), last, items[-1])


def _start(sentence: Markup) -> Markup:
    return Markup(str(sentence)[:1].upper() + str(sentence)[1:])


# --- the verdict ----------------------------------------------------------------------------------------------------


def cost_symbol(problem: PlanningProblem) -> Markup:
    """The objective as mathematics."""
    return symbol(OBJECTIVES[problem.objective], problem)


def symbol(objective: Objective, problem: PlanningProblem) -> Markup:
    """A cost as mathematics, its times in italics."""
    label = problem.system.input_label()
    text = objective.symbol.format(control=label if isinstance(label, str) else "control")
    return Markup(re.sub(r"\b(d?)([tT])\b", r"\1<i>\2</i>", str(Markup.escape(text))))


def cost_row(objective: Objective, problem: PlanningProblem) -> Markup:
    """The heading of a cost's row: its name and, where that is more, its symbol."""
    name, mathematics = Markup.escape(objective.name.replace("_", " ")), symbol(objective, problem)
    return mathematics if mathematics.startswith(name) else name + " " + mathematics


def verdict(group: Group) -> list[Markup]:
    """Two sentences: who reaches the goal, confirmed, and at what cost."""
    names = titles(group.entries)
    return [_start(_reached(group.entries, names)), _start(_costs(group, names))]


def _claim(entry: Entry, name: str) -> Markup:
    checked = entry.solution.verdict
    error = number(checked.error if checked else None, 3)
    tolerance = given(entry.solution.tolerance)
    return Markup("{} with <i>E</i>&nbsp;=&nbsp;{} (tolerance {})").format(_named(name), error, tolerance)


def _failure(entry: Entry, name: str) -> Markup:
    """Why a run is not among the verified ones."""
    solution = entry.solution
    if entry.claim_right is False:
        checked = solution.verdict
        reasons = "; ".join(checked.reasons) if checked else ""
        return Markup("{} claimed success and was refuted ({})").format(
            _named(name), reasons or "no reason stored"
        )
    words = solution.outcome.value.replace("_", " ")
    reason = solution.message.removesuffix(solution.outcome.advice).strip().rstrip(".").replace(". ", "; ")
    return Markup("{} ended as <q>{}</q> ({})").format(_named(name), words, reason or "no reason stored")


def _reached(entries: Sequence[Entry], names: Sequence[str]) -> Markup:
    pairs = list(zip(entries, names, strict=True))
    good = [_claim(entry, name) for entry, name in pairs if entry.solution.converged]
    bad = [_failure(entry, name) for entry, name in pairs if not entry.solution.converged]
    if not good:
        who = {1: "The only run does not reach", 2: "Neither run reaches"}.get(
            len(pairs), "None of the runs reaches"
        )
        return Markup("{} the goal: {}.").format(who, _listed(bad))
    if bad:
        return Markup("Confirmed by an independent integration, {} {} the goal; {}.").format(
            _listed(good), "reaches" if len(good) == 1 else "reach", _listed(bad)
        )
    who = {1: "The only run reaches", 2: "Both runs reach"}.get(len(good), f"All {len(good)} runs reach")
    return Markup("{} the goal, and an independent integration confirms it: {}.").format(who, _listed(good))


def _costs(group: Group, names: Sequence[str]) -> Markup:
    best = group.best
    good = [
        (entry, name)
        for entry, name in zip(group.entries, names, strict=True)
        if entry.solution.converged and math.isfinite(entry.objective_value)
    ]
    if best is None:
        return Markup("There is no verified motion whose cost could be compared.")
    what = cost_symbol(group.problem)
    winner, title = min(good, key=lambda pair: pair[0].objective_value)
    first = Markup('the cheapest motion is that of {}, <span class="whole">{} = {}</span>').format(
        _named(title), what, number(best, 5)
    )
    if len(good) == 1:
        return Markup("Its {} is {}; there is no other verified motion to compare it with.").format(
            what, number(best, 5)
        )
    others = [_dearer(entry, name, best) for entry, name in good if entry is not winner]
    return Markup("{}; {} (built and solved in {}, in the order of the table).").format(
        first, _listed(others), _times([entry for entry, _ in good])
    )


def _times(entries: Sequence[Entry]) -> Markup:
    return _listed(
        Markup("{} s").format(
            number(e.solution.timing.get("build_s", 0.0) + e.solution.timing.get("solve_s", 0.0), 2)
        )
        for e in entries
    )


def _dearer(entry: Entry, name: str, best: float) -> Markup:
    gap = entry.objective_value / best - 1 if best > 0 else 0.0
    if abs(gap) < 5e-7:
        return Markup("that of {} costs the same").format(_named(name))
    return Markup("that of {} costs {} more ({})").format(
        _named(name), percent(gap), number(entry.objective_value, 5)
    )


# --- what was asked -------------------------------------------------------------------------------------------------


def controls(group: Group) -> dict[Markup, list[int]]:
    """What the runs begin with, and which of them begin so."""
    found: dict[Markup, list[int]] = {}
    for place, entry in enumerate(group.entries):
        found.setdefault(_initial(entry.solution.problem), []).append(place)
    return found


def _beginnings(group: Group) -> Markup:
    """The control to begin with; by the names of the runs where they differ in it."""
    found, names = controls(group), titles(group.entries)
    if len(found) == 1:
        return next(iter(found))
    parts = [
        Markup("{}: {}").format(_listed(Markup.escape(names[i]) for i in places), words)
        for words, places in found.items()
    ]
    return Markup("; ").join(parts)


def facts(group: Group) -> list[tuple[str, Markup]]:
    """The problem term by term."""
    problem = group.problem
    system, space = problem.system, problem.system.state_space
    parameters = [
        f"{key} = {_parameter(value)}" for key, value in system.parameters().items() if value is not None
    ]
    horizon = problem.horizon
    span = (
        Markup("free in [{}, {}]").format(given(horizon.minimum), given(horizon.maximum))
        if horizon.free
        else given(horizon.fixed)
    )
    found = [
        ("System", Markup("{}: {}").format(system.model, ", ".join(parameters) or "no parameters")),
        ("Start", _pose(problem, problem.start, space.names)),
        ("Goal", _target(problem, problem.goal)),
        *((f"Via pose at {via.share:g} T", _target(problem, via.goal)) for via in problem.via),
        ("Horizon T", span),
        ("Control to begin with", _beginnings(group)),
        ("Objective", Markup("{}, {}").format(problem.objective.replace("_", " "), cost_symbol(problem))),
        ("Constraints on the path", _bounds(problem)),
        ("Error E", _error(problem)),
        ("Length scale", given(problem.scale)),
    ]
    if problem.reference:
        found.append(("Reference values", _reference(problem)))
    return found


def _parameter(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = str(value)
    return text if len(text) < 400 else f"{text[:400]}…"


def _target(problem: PlanningProblem, values: Any) -> Markup:
    """A goal or via pose: the state's blocks, and the outputs that it names."""
    outputs = [output.name for output in problem.system.pose_outputs if output.name in values]
    return _pose(problem, values, [*problem.system.state_space.names, *outputs])


def _pose(problem: PlanningProblem, values: Any, names: Sequence[str]) -> Markup:
    kinds = {block.name: block.kind for block in problem.system.state_space.blocks}
    parts = []
    for name in names:
        if name not in values:
            parts.append(Markup("{} free").format(name))
        elif kinds.get(name) == "rotation":
            angles = np.degrees(np.asarray(so3.to_rpy(np.asarray(values[name])), dtype=float))
            parts.append(Markup("{} roll, pitch, yaw = {}").format(name, _vector(angles, "°")))
        else:
            parts.append(Markup("{} = {}").format(name, _vector(np.ravel(values[name]))))
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
        Markup('<span class="whole">{}: {}</span>').format(name, _vector(row)) for name, row in _rows(problem)
    ]
    return Markup("{} ({}); ").format(words, ", ".join(basis.labels)) + Markup("; ").join(rows)


def _rows(problem: PlanningProblem) -> Iterable[tuple[str, Any]]:
    return zip(problem.system.input_space.labels, problem.initial, strict=True)


def _bounds(problem: PlanningProblem) -> Markup:
    if not problem.bounds:
        return Markup("none")
    parts = []
    for bound in problem.bounds:
        sides = [
            Markup("{} {}").format(sign, _vector(side))
            for sign, side in (("≥", bound.lower), ("≤", bound.upper))
            if np.isfinite(np.ravel(side)).any()
        ]
        parts.append(Markup("{} {}").format(bound.label, _listed(sides)))
    return Markup("; ").join(parts)


def _error(problem: PlanningProblem) -> Markup:
    return Markup(
        "norm of the differences from the goal at <i>T</i>; a length of {} counts as much as one radian"
    ).format(_vector(problem.error_length))


def _reference(problem: PlanningProblem) -> Markup:
    parts = []
    for key, value in problem.reference.items():
        if isinstance(value, dict):
            pairs = ", ".join(
                f"{name} {_parameter(item)}" for name, item in value.items() if item is not None
            )
            parts.append(Markup("{}: {}").format(METHODS.get(key, key), pairs))
        elif value is not None:
            parts.append(Markup("{}: {}").format(key, _parameter(value)))
    return Markup("; ").join(parts)


def comments(source: str | None) -> tuple[list[str], list[tuple[str, str]]]:
    """A problem file's introduction by paragraph, and its lines that say what is assumed: (line, comment)."""
    paragraphs: list[list[str]] = [[]]
    assumed = []
    heading = True
    for line in (source or "").splitlines():
        stripped = line.strip()
        if heading and stripped.startswith("#"):
            words = stripped.lstrip("#").strip()
            if words.startswith(("yaml-language-server", "(write that file with")):
                continue
            paragraphs.append([]) if not words else paragraphs[-1].append(words)
            continue
        heading = heading and not stripped
        code, mark, words = _uncommented(line)
        if mark and code.strip() and re.match(r"assum", words.strip(), re.IGNORECASE):
            assumed.append((code.strip(), words.strip()))
    return [" ".join(words) for words in paragraphs if words], assumed


def _uncommented(line: str) -> tuple[str, str, str]:
    """A line of YAML parted at its comment; a # within quotes is none."""
    quoted = re.sub(r"\"[^\"]*\"|'[^']*'", lambda found: "x" * len(found[0]), line)
    place = quoted.find(" #")
    return (line, "", "") if place < 0 else (line[:place], "#", line[place + 2 :])


# --- the limits -----------------------------------------------------------------------------------------------------


def limits(group: Group) -> list[Markup]:
    """What a reader must not conclude from the table."""
    entries, names = group.entries, titles(group.entries)
    found = _spaces(entries, names)
    if any(entry.tried and entry.solution.objective == "none" for entry in entries):
        found.append(
            Markup(
                "The Jacobian method minimises nothing here: it takes the first control that reaches the goal. Its gap "
                "in cost is what that costs, not a failure."
            )
        )
    tolerances: dict[float, list[str]] = {}
    for entry, name in zip(entries, names, strict=True):
        tolerances.setdefault(entry.solution.tolerance, []).append(name)
    if len(tolerances) > 1:
        parts = [Markup("{} ({})").format(given(value), ", ".join(who)) for value, who in tolerances.items()]
        found.append(
            Markup(
                "The tolerances differ: {}. A looser one is met with fewer iterations and permits a slightly cheaper "
                "motion."
            ).format(_listed(parts))
        )
    found += [
        Markup(
            "Each method finds a local solution near where it starts; neither proves that no better motion exists."
        ),
        Markup(
            "Every time is from one run on the machine below, all runs one after another in one process; a later run "
            "may profit from what an earlier one has loaded. Peak memory is that of the whole process."
        ),
    ]
    if any(name.startswith(("sigma_", "leg_")) for entry in entries for name in entry.solution.trajectory):
        words = "Extremes along the path (margins, legs) are of the stored samples; verification uses a finer grid."
        found.append(Markup(words))
    if any(entry.solution.outcome is not Outcome.CONVERGED for entry in entries):
        found.append(Markup("Runs that are not verified have no part in the optimality gap."))
    return found


def _spaces(entries: Sequence[Entry], names: Sequence[str]) -> list[Markup]:
    """Which runs share a space of controls, where not all do."""
    spaces: dict[str, list[str]] = {}
    for entry, name in zip(entries, names, strict=True):
        if entry.tried:
            basis = entry.solution.control.basis
            words = f"{basis.kind.replace('_', ' ')}, {basis.size} numbers per input"
            spaces.setdefault(words, []).append(name)
    if len(spaces) < 2:
        return []
    parts = [
        Markup("{}: {}").format(space, _listed(Markup.escape(name) for name in who))
        for space, who in spaces.items()
    ]
    shared = any(len(who) > 1 for who in spaces.values())
    advice = (
        "only runs in one space compare the methods alone"
        if shared
        else "the variant nlp:control=basis compares both methods in one space"
    )
    return [
        Markup(
            "The controls come from different function spaces ({}). Each space has its own optimum, so part of any gap "
            "in cost is the space and not the method; {}."
        ).format(Markup("; ").join(parts), advice)
    ]
