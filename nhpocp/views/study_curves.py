"""How the runs of a study are distributed, and solvers against one another: curves, a colour and a dash a solver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from nhpocp.arrays import Array
from nhpocp.survey import Survey
from nhpocp.views import study_words as words
from nhpocp.views.overlays import WIDTH, Overlay
from nhpocp.views.report_words import run_names
from nhpocp.views.style import axes_grid, line_style, sheet

WIDE = 30.0  # most over least, from which an axis is logarithmic
COLUMNS = 3
TICKS = (
    (1, 1.1, 1.2, 1.5),
    (1, 1.5, 2, 3, 5),
    (1, 2, 5, 10, 20, 50, 100),
)  # of ratios up to the last of these


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
        else:  # numbers that do not run into one another
            axes.xaxis.set_major_locator(MaxNLocator(4))
            axes.ticklabel_format(axis="x", scilimits=(-2, 4))
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
        unsettled = np.nonzero((shares < shares[:, -1:]).any(axis=0))[0]
        last = float(ratios[unsettled[-1] + 1] if len(unsettled) else 1.0) ** 1.05 * 1.02
        for k, share in enumerate(shares):
            steps = np.r_[0, np.nonzero(np.diff(share))[0] + 1]
            x, y = np.r_[ratios[steps], last], np.r_[share[steps], share[-1]]
            axes.step(x, y, where="post", **line_style(k))
        axes.set(xscale="log", ylim=(0, 1.03), xlim=(1, last), ylabel=r"$\rho(\tau)$")
        ticks = next((some for some in TICKS if last < 1.3 * some[-1]), None)
        axes.xaxis.set_major_locator(FixedLocator(ticks) if ticks else LogLocator())
        axes.xaxis.set_minor_locator(NullLocator() if ticks else LogLocator(subs="auto"))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        measured = words.quantity_label(quantity, survey.problem).replace("solving [s]", "solving time")
        axes.set_xlabel(rf"$\tau$, {measured} over the least")
    _legend(figure, survey)
    points = next(iter(survey.profiles.values())).points
    return Overlay("profiles", "Performance profiles", PROFILED.format(points), figure)


def _legend(figure: Figure, survey: Survey) -> None:
    names = run_names(survey.solvers)
    if len(names) > 1:
        handles = [Line2D([], [], label=name, **line_style(k)) for k, name in enumerate(names)]
        figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 3))
