"""Pictures and players inside the output of a notebook's cell, of one solution."""

from __future__ import annotations

import gzip
from base64 import b64encode
from collections.abc import Sequence
from html import escape

from matplotlib.figure import Figure

from nhpocp.comparison import Entry
from nhpocp.errors import CallError, suggestion
from nhpocp.solution import Solution
from nhpocp.views.animation import render
from nhpocp.views.figures import FIGURES, names_of
from nhpocp.views.style import SCREEN, data_address


class Figures(tuple[Figure, ...]):
    """Several figures, which a notebook shows one below the other."""

    def _repr_html_(self) -> str:
        return "".join(map(_image, self))


def _image(figure: Figure) -> str:
    look = f'style="max-width:100%;height:auto" width="{96 * figure.get_figwidth():.0f}"'
    return f'<p><img {look} alt="{escape(str(figure.get_label()))}" src="{data_address(figure)}"></p>'


def plot(solution: Solution, names: Sequence[str] = ()) -> Figure | Figures:
    """The pictures of these names as `Solution.plot` hands them out."""
    for name in names:
        if name not in FIGURES:
            raise CallError(f"no picture is called {name!r}; {suggestion(str(name), FIGURES)}", path="plot")
    figures = Figures(_inline(solution, name) for name in names or names_of(solution))
    return figures[0] if len(names) == 1 else figures


def _inline(solution: Solution, name: str) -> Figure:
    figure = FIGURES[name](solution)
    figure.set_label(f"{name.replace('_', ' ')} of {solution.problem.name} by {solution.solver}")
    figure.set_dpi(SCREEN)  # what pyplot's own display goes by
    return figure


class Player:
    """A page that plays a motion, which a notebook shows in a frame of its own; ``page`` is its text."""

    def __init__(self, page: str, title: str, height: int) -> None:
        self.page, self.title, self.height = page, title, height

    def __repr__(self) -> str:
        return f"<Player of {self.title}>"

    def _repr_html_(self) -> str:
        # packed, and unpacked by the browser, for a notebook keeps what it has shown: a quarter of the page's size.
        # Without allow-same-origin the frame cannot reach the notebook around it.
        packed = b64encode(gzip.compress(self.page.encode(), mtime=0)).decode()
        look = "width:100%;border:1px solid rgba(128,128,128,.45);border-radius:6px;background:#fff"
        return (
            f'<iframe title="{escape(self.title)}" sandbox="allow-scripts" height="{self.height}" style="{look}" '
            f'srcdoc="{escape(UNPACKING.replace("PACKED", packed))}"></iframe>'
        )


UNPACKING = """<!doctype html><meta charset="utf-8"><p>This player needs JavaScript, and a browser of 2023 or later.</p>
<script>
(async () => {
  const bytes = Uint8Array.from(atob("PACKED"), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const page = await new Response(stream).text();
  document.open();
  document.write(page);
  document.close();
})();
</script>"""


def animate(solution: Solution, samples: int, height: int) -> Player:
    """The player of a solution's motion with at most so many samples, in a frame of that height [pixels]."""
    title = f"{solution.problem.name} by {solution.solver}"
    return Player(render([Entry.of(solution)], samples), title, height)
