"""A comparison as one self-contained page: what was asked, the verdict, the table, pictures, limits, certificates."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from nhpocp.comparison import Comparison, Entry, Group
from nhpocp.objectives.registry import OBJECTIVES, costs_of_motion
from nhpocp.views import report_words as words
from nhpocp.views.overlays import Overlay, overlays
from nhpocp.views.readout import readout
from nhpocp.views.svg import inline_svg
from nhpocp.whole import write_text

TEMPLATE = "report.html.jinja"
COLUMNS = 4  # runs side by side in one table, so that it fits a printed page
CLAIMS = {True: "yes", False: "no: refuted", None: "no claim made"}
Row = Mapping[str, Any]


def write_report(
    comparison: Comparison, path: str | os.PathLike[str], animations: Mapping[str, str] | None = None
) -> Path:
    """Writes the page and returns its path. The same solutions give the same bytes.

    ``animations``: files that show the motions of a group, relative to the page, by the groups' titles.
    """
    target = Path(path)
    write_text(target, render(comparison, animations))
    return target


def render(comparison: Comparison, animations: Mapping[str, str] | None = None) -> str:
    """The page as text."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,  # names, messages and comments are users' words
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    rows = {id(entry): row for entry, row in zip(comparison.entries, comparison.rows(), strict=True)}
    groups = comparison.groups
    sections = [
        _section(group, [rows[id(entry)] for entry in group.entries], i) for i, group in enumerate(groups)
    ]
    for group, section in zip(groups, sections, strict=True):
        section["animation"] = (animations or {}).get(group.title)
    names = [group.title for group in groups]
    return environment.get_template(TEMPLATE).render(
        title=f"Motion planning compared: {', '.join(names[:3])}{' and more' if len(names) > 3 else ''}",
        sections=sections,
        notes=comparison.notes,
        summary=_summary(sections) if len(sections) > 1 else None,
        machines=_machines(comparison.entries),
    )


def _section(group: Group, rows: Sequence[Row], place: int) -> dict[str, Any]:
    """One problem's part of the page."""
    names = words.titles(group.entries)
    introduction, assumed = words.comments(group.problem.source)
    return {
        "id": f"problem-{place + 1}",
        "title": group.title,
        "introduction": introduction,
        "assumed": assumed,
        "facts": words.facts(group),
        "verdict": words.verdict(group),
        "runs": list(zip(names, rows, strict=True)),
        "tables": _tables(group, names, rows),
        "failures": [
            (name, entry.solution.outcome.value, _reasons(entry))
            for name, entry in zip(names, group.entries, strict=True)
            if not entry.solution.converged
        ],
        "warnings": [
            (name, _warnings(entry))
            for name, entry in zip(names, group.entries, strict=True)
            if _warnings(entry)
        ],
        "figures": [
            _figure(overlay, f"p{place + 1}-{overlay.name}", names)
            for overlay in overlays(group.entries, names)
        ],
        "limits": words.limits(group),
        "certificates": _chunked(
            names, group.entries, _certificate, lambda entry: entry.solution.solver == "nlp"
        ),
        "settings": _chunked(names, group.entries, lambda entry: _texts(entry.solution.settings)),
        "sources": _sources(group, names),
    }


def _sources(group: Group, names: Sequence[str]) -> list[tuple[str, str]]:
    """The problem files; of each control to begin with one, called by its runs where there are several."""
    found = [
        (", ".join(names[i] for i in places), group.entries[places[0]].solution.problem.source)
        for places in words.controls(group).values()
    ]
    known = [(who, source) for who, source in found if source]
    return known if len(found) > 1 else [("", source) for _, source in known]


def _figure(overlay: Overlay, prefix: str, names: Sequence[str]) -> dict[str, Any]:
    """A picture of the page, and its numbers for the page's script where curves run over time or iterations."""
    description = f"{overlay.title} of {', '.join(names)}. {overlay.caption.striptags()}"
    return {
        "title": overlay.title,
        "caption": overlay.caption,
        "svg": inline_svg(overlay.figure, prefix, description),
        "readout": readout(overlay.figure, overlay.abscissa)
        if overlay.abscissa
        else None,  # once it is laid out
    }


def _reasons(entry: Entry) -> list[str]:
    verdict = entry.solution.verdict
    refuted = list(verdict.reasons) if verdict and entry.claim_right is False else []
    return list(dict.fromkeys([entry.solution.message, *(f"Refuted: {reason}" for reason in refuted)]))


def _warnings(entry: Entry) -> list[str]:
    verdict = entry.solution.verdict
    return list(dict.fromkeys([*entry.solution.warnings, *(verdict.warnings if verdict else ())]))


# --- tables ---------------------------------------------------------------------------------------------------------

Measure = tuple[Any, Callable[[Row], Markup]]


def _number(key: str, digits: int = 4) -> Callable[[Row], Markup]:
    return lambda row: words.number(row[key], digits)


def _seconds(key: str) -> Callable[[Row], Markup]:
    return lambda row: words.number(row[key], 3)


def _legs(row: Row) -> Markup:
    if row["leg_length_min"] is None:
        return words.number(None)
    return Markup("{} … {}").format(words.number(row["leg_length_min"]), words.number(row["leg_length_max"]))


def _measures(group: Group) -> dict[str, list[Measure]]:
    """The table's rows under their headings."""
    costs = [OBJECTIVES[name] for name in costs_of_motion()]
    goal = Markup("optimality gap in {}").format(words.cost_symbol(group.problem))
    return {
        "Ending": [
            ("ending", lambda row: Markup.escape(row["outcome"].replace("_", " "))),
            ("was the claim right?", lambda row: Markup(CLAIMS[row["claim_right"]])),
            (Markup("verified error <i>E</i>"), _number("verified_error", 3)),
            (Markup("tolerance of <i>E</i>"), lambda row: words.given(row["tolerance"])),
        ],
        "Cost": [
            *((words.cost_row(cost, group.problem), _number(cost.name, cost.digits)) for cost in costs),
            (goal, lambda row: words.percent(row["optimality_gap"])),
        ],
        "Along the path": [
            (Markup("least σ<sub>min</sub>(S)"), _number("least_sigma_s")),
            (Markup("least σ<sub>min</sub>(W)"), _number("least_sigma_w")),
            ("leg lengths, least … greatest", _legs),
            (Markup("peak leg speed |u<sub>i</sub>|"), _number("peak_leg_speed")),
        ],
        "Work": [
            ("iterations", _number("iterations")),
            ("evaluations of the dynamics", _number("evaluations")),
            ("building [s]", _seconds("build_s")),
            ("solving [s]", _seconds("solve_s")),
            ("verifying [s]", _seconds("verify_s")),
            ("peak memory of the process [MB]", _number("peak_memory_mb", 3)),
        ],
    }


def _tables(group: Group, names: Sequence[str], rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Measures down, runs across; rows without any value are left out."""
    tables = []
    for first in range(0, len(rows), COLUMNS):
        some = rows[first : first + COLUMNS]
        blocks = []
        for heading, measures in _measures(group).items():
            lines = [(label, [cell(row) for row in some]) for label, cell in measures]
            lines = [(label, cells) for label, cells in lines if any(cell != words.MISSING for cell in cells)]
            if lines:
                blocks.append((heading, lines))
        tables.append({"names": names[first : first + COLUMNS], "blocks": blocks})
    return tables


def _chunked(
    names: Sequence[str],
    entries: Sequence[Entry],
    texts: Callable[[Entry], Mapping[str, Markup]],
    wanted: Callable[[Entry], bool] = lambda entry: True,
) -> list[dict[str, Any]]:
    """Keys down, runs across, in tables that fit a page."""
    chosen = [(name, texts(entry)) for name, entry in zip(names, entries, strict=True) if wanted(entry)]
    chosen = [(name, values) for name, values in chosen if values]
    tables = []
    for method in dict.fromkeys(tuple(values) for _, values in chosen):
        same = [(name, values) for name, values in chosen if tuple(values) == method]
        for first in range(0, len(same), COLUMNS):
            some = same[first : first + COLUMNS]
            lines = [(key, [values[key] for _, values in some]) for key in method]
            tables.append({"names": [name for name, _ in some], "lines": lines})
    return tables


def _texts(values: Mapping[str, Any]) -> dict[str, Markup]:
    return {key: _text(value) for key, value in values.items()}


def _text(value: Any) -> Markup:
    if isinstance(value, float):
        return words.given(value)
    return Markup.escape(words.MISSING if value is None else value)


def _certificate(entry: Entry) -> dict[str, Markup]:
    """What the NLP's optimum was checked by, computed apart from the optimizer; nothing where it found none."""
    details, settings = entry.solution.details, entry.solution.settings
    residuals = details.get("optimality")
    if not residuals:
        return {}
    mesh = details.get("mesh_check") or {}
    found: dict[str, Any] = {
        "optimizer's own word": f"{settings.get('plugin', 'optimizer')}: {details.get('status', '')}",
        "objective at the optimum": details.get("objective_value"),
        "stationarity, max |∇f + ∇gᵀλ|": residuals.get("stationarity"),
        "feasibility, max violation of g": residuals.get("feasibility"),
        "complementarity, max |λ · slack|": residuals.get("complementarity"),
        "intervals × integration steps in each": (
            f"{settings.get('intervals', words.MISSING)} × {details.get('steps_per_interval', words.MISSING)}"
        ),
        "end point: these steps against 8 times as many": details.get("resimulated_gap"),
        "defect of the first guess": details.get("guess_defect"),
        "constraints tightened between the nodes": ", ".join(details.get("tightened", [])) or "none",
        "starts": _starts(details.get("starts", [])),
        "optimum with twice the intervals": mesh.get("objective_value"),
        "change of the optimum from N to 2N": mesh.get("change"),
        "Richardson's estimate of the limit": mesh.get("richardson"),
    }
    if not mesh:
        found = dict(list(found.items())[:-3])
    return {key: words.number(value, 7 if "optimum" in key else 3) for key, value in found.items()}


def _starts(starts: Sequence[Mapping[str, Any]]) -> str:
    return f"best of {len(starts)}" if starts else "one"


def _summary(sections: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One line a run over all problems."""
    lines = []
    for section in sections:
        for i, (name, row) in enumerate(section["runs"]):
            times = [row[key] for key in ("build_s", "solve_s") if row[key] is not None]
            lines.append(
                {
                    "section": section if i == 0 else None,
                    "span": len(section["runs"]),
                    "cells": [
                        name,
                        row["outcome"].replace("_", " "),
                        CLAIMS[row["claim_right"]],
                        words.number(row["verified_error"], 3),
                        words.number(row["objective_value"], 5),
                        words.percent(row["optimality_gap"]),
                        words.number(sum(times), 3),
                    ],
                }
            )
    return lines


def _machines(entries: Sequence[Entry]) -> list[tuple[str, list[str]]]:
    """Versions and machine; several values where the runs come from several machines."""
    keys = list(dict.fromkeys(key for entry in entries for key in entry.machine))
    return [
        (key, list(dict.fromkeys(str(entry.machine[key]) for entry in entries if key in entry.machine)))
        for key in keys
    ]
