"""The verb `plot`: pictures of a stored motion, as large as a page has room for them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from nhpocp.cli.exit_status import SOLVED
from nhpocp.cli.options import json_option
from nhpocp.cli.terminal import put, tell
from nhpocp.errors import suggestion
from nhpocp.solution_folder.target import KINDS, PICTURES

if TYPE_CHECKING:
    from nhpocp.views.style import Room

USUAL = ("svg", "png")
UNITS = {"mm": 25.4, "cm": 2.54, "in": 1.0, "pt": 72.27}  # to an inch; pt is TeX's
LEAST, MOST = 1.0, 40.0  # inches
_LENGTH = rf"(\d+(?:\.\d*)?)\s*({'|'.join(UNITS)})"


def _listed(text: str, known: Iterable[str], option: str) -> list[str]:
    """The words of a list such as pdf,svg, each once. Errors: `click.BadParameter` for one that is not known."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    for word in words or [text]:
        if word not in known:
            raise click.BadParameter(f"{word!r}; {suggestion(word, list(known))}", param_hint=option)
    return list(dict.fromkeys(words))


def _room(text: str | None) -> Room:
    """What a picture may take: 84mm wide, or 84mm x 60mm. Errors: `click.BadParameter` for anything else."""
    from nhpocp.views.style import Room

    if text is None:
        return Room()
    lengths = re.fullmatch(rf"\s*{_LENGTH}\s*(?:x\s*{_LENGTH})?\s*", text)
    if lengths is None:
        words = f"{text!r}; expected a width, or a width and a height, with units ({', '.join(UNITS)}): 84mm, 84mmx60mm"
        raise click.BadParameter(words, param_hint="--size")
    pairs = [(lengths[1], lengths[2]), *([(lengths[3], lengths[4])] if lengths[3] else [])]
    inches = [float(number) / UNITS[unit] for number, unit in pairs]
    if not all(LEAST <= length <= MOST for length in inches):
        raise click.BadParameter(f"{text!r}; expected lengths from 26mm to 1000mm", param_hint="--size")
    return Room(*inches)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "kinds",
    metavar="KIND,...",
    default=",".join(USUAL),
    show_default=True,
    help=f"Of {', '.join(KINDS)}; text in SVG and PDF stays text.",
)
@click.option(
    "--only", metavar="NAME,...", help=f"Of {', '.join(PICTURES)}; default: those that say something."
)
@click.option(
    "--size",
    metavar="WIDTH[xHEIGHT]",
    help="Such as 84mm, a journal's column: panels that find no place side by side stand one under another.",
)
@json_option
def plot(folder: Path, kinds: str, only: str | None, size: str | None, as_json: bool) -> int:
    """Draw the pictures of the solution in FOLDER, into it."""
    formats = _listed(kinds, KINDS, "--format")
    names = None if only is None else _listed(only, PICTURES, "--only")

    from nhpocp.solution_folder import load_solution, unwritable
    from nhpocp.views.figures import write_pictures

    room = _room(size)
    solution = load_solution(folder)
    try:
        written = [str(path) for path in write_pictures(solution, folder, formats, names, room, text=True)]
    except OSError as error:
        raise unwritable(folder, error) from error
    if as_json:
        put({"folder": str(folder), "pictures": written})
    else:
        tell("\n".join(written))
    return SOLVED
