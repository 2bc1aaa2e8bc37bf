"""Tables of a report: measures, settings, certificates and versions down, runs across."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from markupsafe import Markup

from nhpocp.comparison import Entry, Group
from nhpocp.objectives.registry import OBJECTIVES, costs_of_motion
from nhpocp.views import report_words as words

COLUMNS = 4  # runs side by side in one table, so that it fits a printed page
CLAIMS = {True: "yes", False: "no: refuted", None: "no claim made"}
Measures = Mapping[str, Any]  # of one run, as `Comparison.rows` has them


def results(group: Group, names: Sequence[str], runs: Sequence[Measures]) -> list[dict[str, Any]]:
    """What became of the runs; lines without any value are left out."""
    tables = []
    for some in _pages(len(runs)):
        blocks = []
        for heading, measures in _measures(group).items():
            lines = [(label, [cell(run[key]) for run in runs[some]]) for label, key, cell in measures]
            lines = [(label, cells) for label, cells in lines if any(cell != words.MISSING for cell in cells)]
            blocks += [(heading, lines)] if lines else []
        tables.append({"names": names[some], "blocks": blocks})
    return tables


def _pages(count: int) -> Iterator[slice]:
    return (slice(first, first + COLUMNS) for first in range(0, count, COLUMNS))


def _figures(digits: int) -> Callable[[Any], Markup]:
    """How numbers are written with so many digits."""
    return partial(words.number, digits=digits)


def _measures(group: Group) -> dict[str, list[tuple[Any, str, Callable[[Any], Markup]]]]:
    """Label, key and writing of the table's lines, under their headings."""
    three, four, problem = _figures(3), _figures(4), group.problem
    return {
        "Ending": [
            ("ending", "outcome", lambda value: Markup.escape(value.replace("_", " "))),
            ("was the claim right?", "claim_right", lambda value: Markup(CLAIMS[value])),
            (Markup("verified error <i>E</i>"), "verified_error", three),
            (Markup("tolerance of <i>E</i>"), "tolerance", words.given),
        ],
        "Cost": [
            *(
                (words.cost_label(OBJECTIVES[name], problem), name, _figures(OBJECTIVES[name].digits))
                for name in costs_of_motion()
            ),
            (
                Markup("optimality gap in {}").format(words.cost_symbol(problem)),
                "optimality_gap",
                words.percent,
            ),
        ],
        "Along the path": [
            (Markup("least σ<sub>min</sub>(S)"), "least_sigma_s", four),
            (Markup("least σ<sub>min</sub>(W)"), "least_sigma_w", four),
            ("least leg length", "leg_length_min", four),
            ("greatest leg length", "leg_length_max", four),
            (Markup("peak leg speed |u<sub>i</sub>|"), "peak_leg_speed", four),
        ],
        "On a machine in a physics engine": [
            ("the plan's end", "physics_outcome", lambda value: Markup.escape(value or words.MISSING)),
            (f"off it by [{problem.units.words('length')}]", "physics_position_error", three),
            ("off it by [rad]", "physics_angle_error", three),
            (f"slip at the contacts [{problem.units.words('length')}]", "physics_slip", three),
            ("played over [s]", "physics_duration", three),
        ],
        "Work": [
            ("iterations", "iterations", four),
            ("evaluations of the dynamics", "evaluations", four),
            ("building [s]", "build_s", three),
            ("solving [s]", "solve_s", three),
            ("verifying [s]", "verify_s", three),
            ("peak memory of the process [MB]", "peak_memory_mb", three),
        ],
    }


def settings(names: Sequence[str], entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Every setting of every run, under the problem file's names."""
    return _keyed([(name, _settings(entry)) for name, entry in zip(names, entries, strict=True)])


def certificates(names: Sequence[str], entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """What the optima of the NLP were checked by."""
    mine = [pair for pair in zip(names, entries, strict=True) if pair[1].solution.solver == "nlp"]
    return _keyed([(name, _certificate(entry)) for name, entry in mine])


def _keyed(runs: Sequence[tuple[str, Mapping[str, Markup]]]) -> list[dict[str, Any]]:
    """Keys down, runs across; runs with other keys have tables of their own, those without any have none."""
    tables = []
    for keys in dict.fromkeys(tuple(values) for _, values in runs if values):
        alike = [(name, values) for name, values in runs if tuple(values) == keys]
        for some in _pages(len(alike)):
            lines = [(key, [values[key] for _, values in alike[some]]) for key in keys]
            tables.append({"names": [name for name, _ in alike[some]], "lines": lines})
    return tables


def _settings(entry: Entry) -> dict[str, Markup]:
    return {
        key: words.given(value)
        if isinstance(value, float)
        else Markup.escape(words.MISSING if value is None else value)
        for key, value in entry.solution.settings.items()
    }


def _certificate(entry: Entry) -> dict[str, Markup]:
    """What the NLP's optimum was checked by, computed apart from the optimizer; nothing where it found none."""
    details, chosen = entry.solution.details, entry.solution.settings
    residuals, mesh = details.get("optimality"), details.get("mesh_check")
    if not residuals:
        return {}
    starts, steps = details.get("starts", []), details.get("steps_per_interval", words.MISSING)
    lines: dict[str, Any] = {
        "optimizer's own word": f"{chosen.get('plugin', 'optimizer')}: {details.get('status', '')}",
        "objective at the optimum": details.get("objective_value"),
        "stationarity, max |∇f + ∇gᵀλ|": residuals.get("stationarity"),
        "feasibility, max violation of g": residuals.get("feasibility"),
        "complementarity, max |λ · slack|": residuals.get("complementarity"),
        "intervals × integration steps in each": f"{chosen.get('intervals', words.MISSING)} × {steps}",
        "end point: these steps against finer ones": details.get("resimulated_gap"),
        "defect of the first guess": details.get("guess_defect"),
        "constraints tightened between the nodes": ", ".join(details.get("tightened", [])) or "none",
        "starts": f"best of {len(starts)}" if starts else "one",
    }
    if mesh:
        lines |= {
            "optimum with twice the intervals": mesh.get("objective_value"),
            "change of the optimum from N to 2N": mesh.get("change"),
            "Richardson's estimate of the limit": mesh.get("richardson"),
        }
    return {key: words.number(value, 7 if "optimum" in key else 3) for key, value in lines.items()}


def summary(sections: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One line a run over all problems."""
    lines = []
    for section in sections:
        for i, (name, run) in enumerate(section["runs"]):
            cells = [
                name,
                run["outcome"].replace("_", " "),
                CLAIMS[run["claim_right"]],
                words.number(run["verified_error"], 3),
                words.number(run["objective_value"], 5),
                words.percent(run["optimality_gap"]),
                words.number(sum(run[key] or 0.0 for key in ("build_s", "solve_s")), 3),
            ]
            lines.append({"section": None if i else section, "span": len(section["runs"]), "cells": cells})
    return lines


def versions(machines: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[str]]]:
    """Versions and machine of runs; several values where the runs come from several machines."""
    keys = dict.fromkeys(key for machine in machines for key in machine)
    return [
        (key, list(dict.fromkeys(str(machine[key]) for machine in machines if key in machine)))
        for key in keys
    ]
