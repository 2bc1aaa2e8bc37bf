"""How the pictures look: one sheet of settings, colours, symbols and units for all of them.

Nothing here keeps state of its own: figures are made with matplotlib's object-oriented interface inside `sheet`.
"""

from __future__ import annotations

import re
import textwrap
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context

PANEL = (3.5, 2.6)  # inches: one column of a journal
DOTS_PER_INCH = 300
# Okabe and Ito's palette, which colour-blind readers can tell apart; the dashes tell the lines apart in grey
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (1, 1.2)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)
GREY, FAINT, ALARM = "0.35", "0.92", "#B2182B"

MANY = 100  # points that can still be told apart in a panel
COMPACT: dict[str, Any] = {
    "handlelength": 2.0,
    "columnspacing": 1.0,
    "handletextpad": 0.5,
}  # for many entries

SETTINGS: dict[str, Any] = {
    "font.family": "STIXGeneral",  # comes with matplotlib, so pictures are the same everywhere
    "mathtext.fontset": "stix",
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.titlesize": 8.5,
    "legend.fontsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "legend.columnspacing": 1.4,
    "legend.borderaxespad": 0.0,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "hatch.linewidth": 0.4,
    "hatch.color": "0.75",
    "figure.dpi": DOTS_PER_INCH,
    "savefig.dpi": DOTS_PER_INCH,
    "savefig.bbox": None,
    "svg.fonttype": "path",
    "svg.hashsalt": "nhpocp",
    "pdf.fonttype": 42,
    "path.simplify": False,
}

_LOCK = threading.RLock()  # rcParams belong to the whole process


@contextmanager
def sheet() -> Iterator[None]:
    """The settings, for as long as a figure is made or saved; one thread at a time."""
    with _LOCK, rc_context(SETTINGS):
        yield


def line_style(index: int) -> dict[str, Any]:
    """Colour and dashes of the index-th leg, axis or component."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def trial_style(count: int) -> dict[str, Any]:
    """Of what was tried and not kept: crosses, or dots where there are too many for crosses."""
    marker: dict[str, Any] = {"marker": "x", "markersize": 2.8, "markeredgewidth": 0.6, "alpha": 0.6}
    if count > MANY:
        marker = {"marker": ".", "markersize": 1.8, "markeredgewidth": 0, "alpha": 0.5}
    return {"linestyle": "none", **marker}


_NOTATION = {"position": "p", "orientation": "R", "leg_lengths": "l", "joint_angles": r"\theta"}
_GREEK = ("alpha", "beta", "gamma", "theta", "phi", "psi", "omega", "sigma", "lambda", "kappa")
_LETTERS = dict(zip(_GREEK, "αβγθφψωσλκ", strict=True))


def symbol(name: str, index: int | None = None) -> str:
    r"""Mathematics for a name of a block: theta0_dot → $\dot{\theta}_0$, (v, 0) → $v_1$; long words stay words."""
    found = re.fullmatch(
        r"(?P<stem>.*?)(?P<number>\d*)(?P<axis>_[a-z])?(?P<dot>_dot)?", _NOTATION.get(name, name)
    )
    if found is None:
        return name
    stem, subscript = found["stem"], found["number"] + (found["axis"] or "").lstrip("_")
    if index is not None:
        subscript += ("," if subscript else "") + str(index + 1)
    if stem in _GREEK:
        stem = "\\" + stem
    elif len(stem) > 1 and not stem.startswith("\\"):
        words = name.replace("_", " ")
        return words if index is None else f"{words} {index + 1}"
    if found["dot"]:
        stem = rf"\dot{{{stem}}}"
    return f"${stem}_{{{subscript}}}$" if subscript else f"${stem}$"


_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def plain_words(words: str) -> str:
    r"""A label without its mathematics: "leg length $l_{1}$" → "leg length l₁", $\sigma_{\min}(S)$ → "σmin(S)"."""

    def plain(formula: re.Match[str]) -> str:
        text = re.sub(r"\\mathcal\{(\w)\}", r"\1", formula[1])
        text = re.sub(r"_\{?([\d,]+)\}?", lambda found: found[1].translate(_LOWERED), text)
        text = re.sub(r"\\dot\{([^}]*)\}", "\\1\N{COMBINING DOT ABOVE}", text)
        text = re.sub(r"\\([a-z]+)", lambda found: _LETTERS.get(found[1], found[1]), text)
        return re.sub(r"[{}_]", "", text)

    return re.sub(r"\$([^$]*)\$", plain, words)


_UNITS = {"length": " [length]", "angle": " [rad]", "": ""}
_RATES = {"length": " [length per unit time]", "angle": " [rad per unit time]", "": ""}


def with_unit(words: str, unit: str, rate: bool = False) -> str:
    """An axis label; inputs are rates of what their unit says."""
    return words + (_RATES if rate else _UNITS)[unit]


def say(figure: Any, sentences: Iterable[str | None]) -> None:
    """Plain words on top of a figure, wrapped to its width."""
    width = int(figure.get_figwidth() * 19.5)
    lines = [line for sentence in sentences if sentence for line in textwrap.wrap(sentence, width)]
    if lines:
        figure.suptitle("\n".join(lines), x=0.02, ha="left", fontsize=8, color=ALARM, linespacing=1.15)


def legend_above(axes: Any, columns: int | None = None, **look: Any) -> None:
    """A legend over the axes, where it hides no line."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.02),
            ncols=columns or min(len(handles), 4),
            **look,
        )
