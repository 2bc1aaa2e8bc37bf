"""The scaling curves as a picture in a paper's quality: log–log, told apart by colour, dash and marker."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from many_goals import Throughput
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator
from scaling import Curves

from nhpocp.views.style import COLOURS, DASHES, GREY, sheet

SIZE = (7.0, 5.6)  # inches: two columns of a journal
MARKERS = ("o", "s", "^", "D", "v", "P")
# words and look by name; what the reader is to compare keeps its look from panel to panel
EVALUATIONS = {
    "rk4, compiled": ("kernel", 0),
    "rk4, interpreted": ("interpreted", 1),
    "rk4, variational": ("eqs. (11)–(12)", 2),
    "plain ca.jacobian": ("plain ca.jacobian", 3),
    "rk": ("CasADi rk", 4),
    "cvodes": ("CVODES", 5),
}
PROGRAMMES = {"nhpocp": ("nhpocp", 0), "nlpsol": ("nlpsol script", 3), "Opti": ("Opti script", 4)}
WANTED_RATE = 400.0  # goals a second and core


def look(place: int) -> dict[str, Any]:
    return {
        "color": COLOURS[place],
        "linestyle": DASHES[place],
        "marker": MARKERS[place],
        "markersize": 3.2,
        "markeredgewidth": 0,
        "linewidth": 1.1,
    }


def draw(axes: Any, curves: Curves, looks: Mapping[str, tuple[str, int]], factor: float = 1.0) -> None:
    """The curves on log–log axes, times ``factor``; sizes and values are written as plain numbers."""
    for name, (words, place) in looks.items():
        if curves.get(name):
            values = [factor * value for value in curves[name].values()]
            axes.plot(list(curves[name]), values, label=words, **look(place))
    sizes = sorted({size for curve in curves.values() for size in curve})
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(FixedLocator(sizes))
    axes.xaxis.set_minor_locator(NullLocator())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: grouped(value)))


def grouped(value: float) -> str:
    """10000 as 10 000."""
    return f"{value:,.0f}".replace(",", "\u2009") if value >= 10 else f"{value:g}"


def title(axes: Any, letter: str, words: str) -> None:
    axes.set_title(f"({letter}) {words}", loc="left", pad=4)


def rates(found: Throughput) -> Curves:
    """Goals a second in place of seconds."""
    return {
        name: {count: count / time for count, time in curve.items()} for name, curve in found.seconds.items()
    }


def goal_looks(found: Throughput) -> dict[str, tuple[str, int]]:
    """Kernel and interpreted as in the panels above; several cores apart from both."""
    looks = {"compiled, 1 core": ("kernel, 1 core", 0), "interpreted, 1 core": ("interpreted, 1 core", 1)}
    several = [name for name in found.seconds if name not in looks]
    words = {name: (name.replace("compiled", "kernel"), 2 + place) for place, name in enumerate(several)}
    return looks | words


def picture(
    steps: Curves, harmonics: Curves, harmonics_at: int, intervals: Curves, goals: Throughput
) -> Figure:
    """Four panels: end points over steps and over harmonics, NLPs over intervals, goals over their number.

    harmonics_at: the steps of the second.
    """
    with sheet():
        figure = Figure(figsize=SIZE, layout="constrained")
        (over_n, over_h), (over_k, over_g) = figure.subplots(2, 2)
        for axes, curves in ((over_n, steps), (over_h, harmonics)):
            draw(axes, curves, EVALUATIONS, factor=1e3)
            axes.set_ylabel("end point and Jacobian [ms]")
        over_n.set_xlabel("RK4 steps $N$")
        over_h.set_xlabel("harmonics $h$")
        title(over_n, "a", "over steps, $h = 2$")
        title(over_h, "b", f"over harmonics, $N = {harmonics_at}$")
        draw(over_k, intervals, PROGRAMMES)
        over_k.set(xlabel="intervals $N$", ylabel="one NLP [s]")
        title(over_k, "c", "multiple shooting")
        draw(over_g, rates(goals), goal_looks(goals))
        over_g.axhline(WANTED_RATE, color=GREY, linewidth=0.7, linestyle=":")
        over_g.set(xlabel="goals", ylabel="goals planned per second")
        title(over_g, "d", "continuation, auto, many goals")
        for axes, corner in ((over_k, "upper left"), (over_g, "best")):
            axes.legend(loc=corner, handlelength=2.8)
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))  # few decades
            axes.yaxis.set_minor_locator(NullLocator())
        handles, labels = over_n.get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside upper center", ncols=6, handlelength=2.8, columnspacing=1.2
        )
    return figure


def save(figure: Figure, folder: Path) -> Path:
    """As PNG; the file."""
    file = folder / "scaling.png"
    with sheet():
        figure.savefig(file, metadata={"Software": None})
    return file
