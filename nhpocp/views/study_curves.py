"""How the runs of a study are distributed, and solvers against one another: curves, a colour and a dash a solver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from nhpocp.arrays import Array
from nhpocp.survey import Survey
from nhpocp.views import study_words as words
from nhpocp.views.overlays import WIDTH, Overlay
from nhpocp.views.report_words import run_names
from nhpocp.views.style import axes_grid, line_style, sheet

WIDE = 30.0  # most over least, from which an axis is logarithmic
COLUMNS = 3


def curves(survey: Survey) -> list[Overlay]:
    """Distributions; and performance profiles, where there are several solvers."""
    with sheet():
        made = [_distributions(survey)] if survey.quantities else []
        return [*made, *([_profiles(survey)] if survey.profiles else [])]


DISTRIBUTED = Markup(
    "The share of a solver's solved runs that have at most this value; where a curve passes 0.5 is the median."
)


def _distributions(survey: Survey) -> Overlay:
    quantities = survey.quantities
    columns = min(COLUMNS, len(quantities))
    figure, grid = axes_grid(len(quantities), columns, (WIDTH / columns, 1.95), 0.3)
    for place, (axes, quantity) in enumerate(zip(grid, quantities, strict=True)):
        seen = []
        for k, spread in enumerate(survey.spreads[quantity.name].values()):
            if not spread.count:
                continue
            seen.append(spread.quantiles)
            count = len(spread.quantiles)
            shares = np.arange(1, count + 1) / count
            # a step a run, or a quantile
            x, y = np.r_[spread.quantiles[:1], spread.quantiles], np.r_[0.0, shares]
            axes.step(x, y, where="post", **line_style(k))
        if _wide(seen):
            axes.set_xscale("log")
        axes.set(ylim=(0, 1.02), xlabel=words.quantity_label(quantity, survey.problem))
        if place % columns == 0:
            axes.set_ylabel("share of solved runs")
    _legend(figure, survey)
    return Overlay("distributions", "Distributions", DISTRIBUTED, figure)


def _wide(values: Sequence[Array]) -> bool:
    every = np.concatenate(values) if values else np.ones(1)
    return bool(every.min() > 0 and every.max() / every.min() > WIDE)


PROFILED = Markup(
    "Performance profiles [Dolan &amp; Moré 2002]: ρ(τ) is the share of all design points at which a solver's run is "
    "solved and no worse than τ times the best. At τ = 1 it is the share at which nobody is better (within 0.05 %), on "
    "the right the share that it solves. {} points, which every solver has run."
)


def _profiles(survey: Survey) -> Overlay:
    figure, grid = axes_grid(len(survey.profiles), 2, (WIDTH / 2, 2.3), 0.3)
    for axes, (name, profile) in zip(grid, survey.profiles.items(), strict=True):
        quantity = next(quantity for quantity in survey.quantities if quantity.name == name)
        shares, ratios = profile.shares, profile.ratios
        settled = np.nonzero((shares < shares[:, -1:]).any(axis=0))[0]
        last = min(len(ratios) - 1, int(settled[-1]) + 8 if len(settled) else 16)
        for k in range(len(profile.solvers)):
            axes.step(ratios[: last + 1], shares[k, : last + 1], where="post", **line_style(k))
        axes.set_xscale("log", base=2 if ratios[last] <= 32 else 10)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        if ratios[last] < 2:
            axes.set_xscale("linear")
        label = words.quantity_label(quantity, survey.problem).replace(" [s]", "")
        axes.set(
            ylim=(0, 1.03),
            xlim=(1, ratios[last]),
            xlabel=rf"$\tau$, {label} over the least",
            ylabel=r"$\rho(\tau)$",
        )
    _legend(figure, survey)
    points = next(iter(survey.profiles.values())).points
    return Overlay("profiles", "Performance profiles", PROFILED.format(points), figure)


def _legend(figure: Figure, survey: Survey) -> None:
    names = run_names(survey.solvers)
    if len(names) > 1:
        handles = [Line2D([], [], label=name, **line_style(k)) for k, name in enumerate(names)]
        figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 3))
