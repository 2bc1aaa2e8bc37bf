"""How the pictures look: one sheet of settings and colours for all of them.

Nothing here keeps state of its own: figures are made with matplotlib's object-oriented interface inside `sheet`.
"""

from __future__ import annotations

import io
import textwrap
import threading
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

PANEL = (3.5, 2.6)  # inches: one column of a journal
LEAST_PANEL = 2.6  # inches: narrower panels stand one under another
FLAT = 0.6  # height over width of panels that are fitted into a width
DOTS_PER_INCH = 300
SCREEN = 120  # dots per inch for a screen that shows 96 of them: sharp enough, and a notebook stays small
SHADES = 96  # colours of a picture on a screen, by which nobody tells it from one with all of them
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
# for many entries
COMPACT: dict[str, Any] = {"handlelength": 1.6, "columnspacing": 0.8, "handletextpad": 0.5}

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


class Picture(Figure):
    """A figure that a notebook shows whether or not pyplot has been imported."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        return png(self), {"width": round(96 * self.get_figwidth())}


def png(figure: Figure) -> bytes:
    """A figure as a small PNG for a screen, on white: it reads on dark pages too."""
    stream, small = io.BytesIO(), io.BytesIO()
    with sheet():
        figure.savefig(stream, format="png", dpi=SCREEN, facecolor="white")
    image = Image.open(stream).convert("RGB")
    few = image.quantize(SHADES, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(small, "PNG", optimize=True)
    return small.getvalue()


def data_address(figure: Figure) -> str:
    """A figure as the address of an <img>."""
    return f"data:image/png;base64,{b64encode(png(figure)).decode()}"


P = ParamSpec("P")


def styled(make: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that makes a figure, under the sheet of settings."""

    @wraps(make)
    def made(*subject: P.args, **how: P.kwargs) -> Figure:
        with sheet():
            return make(*subject, **how)

    return made


@dataclass(frozen=True)
class Room:
    """What a picture may take of a page [inch]: its width and height, None where it chooses itself."""

    width: float | None = None
    height: float | None = None

    def columns(self, most: int, least: float = LEAST_PANEL) -> int:
        """How many parts of a least width [inch] stand side by side, at most so many."""
        return most if self.width is None else max(1, min(most, int(self.width / least)))

    def panel(
        self, columns: int, size: tuple[float, float] = PANEL, flat: float = FLAT
    ) -> tuple[float, float]:
        """The size of a part: its own, or what fits the width so many times, at a height over width of ``flat``."""
        if self.width is None:
            return size
        return self.width / columns, flat * self.width / columns


OWN_SIZE = Room()


def axes_grid(
    count: int,
    columns: int = 2,
    size: tuple[float, float] = PANEL,
    head: float = 0.0,
    room: Room = OWN_SIZE,
) -> tuple[Figure, list[Any]]:
    """A figure of equal panels of that size, or fitted into a room, with room for words over them; as many axes as
    asked for. [inch]"""
    columns = room.columns(max(1, min(columns, count)))
    rows = -(-count // columns)
    width, height = room.panel(columns, size)
    figure = Picture(
        figsize=(columns * width, room.height or rows * height + head),
        layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05),
    )
    return figure, [figure.add_subplot(rows, columns, i + 1) for i in range(count)]


def line_style(index: int) -> dict[str, Any]:
    """Colour and dashes of the index-th leg, axis or component."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def trial_style(count: int) -> dict[str, Any]:
    """Of what was tried and not kept: crosses, or dots where there are too many for crosses."""
    marker: dict[str, Any] = {"marker": "x", "markersize": 2.8, "markeredgewidth": 0.6, "alpha": 0.6}
    if count > MANY:
        marker = {"marker": ".", "markersize": 1.8, "markeredgewidth": 0, "alpha": 0.5}
    return {"linestyle": "none", **marker}


# --- pieces of figures ------------------------------------------------------------------------------------------------


def say(figure: Any, sentences: Iterable[str | None]) -> None:
    """Plain words on top of a figure, wrapped to its width."""
    width = int(figure.get_figwidth() * 19.5)
    lines = [line for sentence in sentences if sentence for line in textwrap.wrap(sentence, width)]
    if lines:
        figure.suptitle("\n".join(lines), x=0.02, ha="left", fontsize=8, color=ALARM, linespacing=1.15)


def legend_above(axes: Any, columns: int | None = None, **look: Any) -> None:
    """A legend over the axes, where it hides no line."""
    handles, labels = axes.get_legend_handles_labels()
    most = 2 if any(len(label) > 20 for label in labels) else 4
    if handles:
        axes.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.02),
            ncols=columns or min(len(handles), most),
            **look,
        )
