"""A study as one self-contained page: what was asked, where it is solved, distributions, solvers compared, failures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from nhpocp.survey import Survey
from nhpocp.views import study_words as words
from nhpocp.views.overlays import Overlay
from nhpocp.views.page import filled
from nhpocp.views.report import embedded
from nhpocp.views.report_tables import versions
from nhpocp.views.report_words import number, percent, run_names
from nhpocp.views.study_charts import charts
from nhpocp.views.study_curves import curves
from nhpocp.whole import write_text

TEMPLATE = "study.html.jinja"
KINDS_OF_FAILURE = 20  # that have a line each
SHARES = {"least": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "largest": 1.0}
LONGEST = 20_000  # characters of a file that is shown


def write_study_report(survey: Survey, path: str | os.PathLike[str]) -> Path:
    """Writes the page and returns its path. The same store gives the same bytes."""
    target = Path(path)
    write_text(target, render(survey))
    return target


def render(survey: Survey) -> str:
    """The page as text."""
    drawn = {overlay.name: overlay for overlay in curves(survey)}
    failures = words.failures(survey, KINDS_OF_FAILURE)
    return filled(
        TEMPLATE,
        title=f"Study: {survey.name}",
        notes=[],
        verdict=words.verdict(survey),
        facts=words.facts(survey),
        task=words.task(survey.problem),
        charts=[_figure(overlay, survey) for overlay in charts(survey)],
        distributions=_figure(drawn["distributions"], survey) if "distributions" in drawn else None,
        spreads=_spreads(survey),
        shares=list(SHARES),
        profiles=_figure(drawn["profiles"], survey) if "profiles" in drawn else None,
        means=_means(survey),
        solvers=run_names(survey.solvers),
        failures=failures,
        more=len(survey.failures) - len(failures),
        limits=list(words.limits(survey)),
        sources=[
            ("The study file", _cut(survey.text)),
            ("The problem around which the axes vary", _cut(survey.problem_text)),
        ],
        machines=versions(survey.environments),
    )


def _figure(overlay: Overlay, survey: Survey) -> dict[str, Any]:
    return embedded(overlay, overlay.name, f"the study {survey.name}")


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}\n… and {len(text) - LONGEST} characters more"


def _spreads(survey: Survey) -> list[dict[str, Any]]:
    """Quantiles: a block a quantity and a line a solver, or one block where there is one solver."""
    names, blocks = run_names(survey.solvers), list[dict[str, Any]]()
    for quantity in survey.quantities:
        label = words.quantity_words(quantity, survey.problem)
        lines = [
            (name, spread.count, [words.value_words(quantity, spread.at(share)) for share in SHARES.values()])
            for name, spread in zip(names, survey.spreads[quantity.name].values(), strict=True)
        ]
        if len(names) == 1:
            blocks = blocks or [{"label": None, "lines": []}]
            blocks[0]["lines"] += [(label, *lines[0][1:])]
        else:
            blocks.append({"label": label, "lines": lines})
    return blocks


def _means(survey: Survey) -> dict[str, Any] | None:
    """Shifted geometric means and shares of success, a line a solver."""
    if not survey.profiles:
        return None
    measured = {quantity.name: quantity for quantity in survey.quantities}
    lines = []
    for k, (name, (stored, solved)) in enumerate(
        zip(run_names(survey.solvers), survey.tallies.values(), strict=True)
    ):
        cells = [percent(solved / stored if stored else None)]
        for profile in survey.profiles.values():
            cells += [percent(float(profile.shares[k, 0])), number(profile.means[k])]
        lines.append((name, cells))
    heads = [
        (words.shift_words(measured[which], profile.shift, survey.problem))
        for which, profile in survey.profiles.items()
    ]
    first = next(iter(survey.profiles.values()))
    return {"heads": heads, "lines": lines, "shared": first.shared, "points": first.points}
