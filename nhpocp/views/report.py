"""A comparison as one self-contained page: what was asked, the verdict, the table, pictures, limits, certificates."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nhpocp.comparison import Comparison, Entry, Group
from nhpocp.views import report_tables as tables
from nhpocp.views import report_words as words
from nhpocp.views.overlays import WIDTH, Overlay, overlays
from nhpocp.views.page import filled
from nhpocp.views.readout import readout
from nhpocp.views.svg import inline_svg
from nhpocp.whole import write_text

TEMPLATE = "report.html.jinja"
COLUMN = 59  # rem: the width of the page's text


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
    groups = comparison.groups
    sections = [_section(group, i) for i, group in enumerate(groups)]
    for group, section in zip(groups, sections, strict=True):
        section["animation"] = (animations or {}).get(group.title)
    names = [group.title for group in groups]
    return filled(
        TEMPLATE,
        title=f"Motion planning compared: {', '.join(names[:3])}{' and more' if len(names) > 3 else ''}",
        sections=sections,
        notes=comparison.notes,
        summary=tables.summary(sections) if len(sections) > 1 else None,
        machines=tables.versions([entry.machine for entry in comparison.entries]),
    )


def _section(group: Group, place: int) -> dict[str, Any]:
    """One problem's part of the page."""
    names, runs = words.titles(group.entries), Comparison(group.entries).rows()
    named = list(zip(names, group.entries, strict=True))
    failed = [(name, entry) for name, entry in named if not entry.solution.converged]
    return {
        "id": f"problem-{place + 1}",
        "title": group.title,
        "introduction": words.introduction(group.problem.source),
        "facts": words.facts(group),
        "verdict": words.verdict(group),
        "units": words.units(group.problem),
        "runs": list(zip(names, runs, strict=True)),
        "tables": tables.results(group, names, runs),
        "failures": [(name, entry.solution.outcome.value, _reasons(entry)) for name, entry in failed],
        "warnings": [(name, told) for name, entry in named if (told := _warnings(entry))],
        "figures": [
            embedded(overlay, f"p{place + 1}-{overlay.name}", ", ".join(names))
            for overlay in overlays(group.entries, names)
        ],
        "limits": words.limits(group),
        "certificates": tables.certificates(names, group.entries),
        "settings": tables.settings(names, group.entries),
        "sources": _sources(group, names),
    }


def _sources(group: Group, names: Sequence[str]) -> list[tuple[str, str]]:
    """The problem files; of each control to begin with one, called by its runs where there are several."""
    every = [
        (", ".join(names[i] for i in places), group.entries[places[0]].solution.problem.source)
        for places in words.controls(group).values()
    ]
    known = [(who, source) for who, source in every if source]
    return known if len(every) > 1 else [("", source) for _, source in known]


def embedded(overlay: Overlay, prefix: str, of: str) -> dict[str, Any]:
    """A picture of a page, and its numbers for the page's script where curves run over time or iterations.

    prefix: of its ids; of: what it is a picture of, for those who do not see it.
    """
    description = f"{overlay.title} of {of}. {overlay.caption.striptags()}"
    svg = inline_svg(overlay.figure, prefix, description)  # lays the figure out
    numbers = readout(overlay.figure, overlay.abscissa) if overlay.abscissa else None
    share = min(1.0, overlay.figure.get_figwidth() / WIDTH)
    return {
        "title": overlay.title,
        "caption": overlay.caption,
        "svg": svg,
        "readout": numbers,
        "width": None if share > 0.99 else round(COLUMN * share, 1),
    }


def _reasons(entry: Entry) -> list[str]:
    verdict = entry.solution.verdict
    refuted = list(verdict.reasons) if verdict and entry.claim_right is False else []
    return list(dict.fromkeys([entry.solution.message, *(f"Refuted: {reason}" for reason in refuted)]))


def _warnings(entry: Entry) -> list[str]:
    verdict = entry.solution.verdict
    return list(dict.fromkeys([*entry.solution.warnings, *(verdict.warnings if verdict else ())]))
