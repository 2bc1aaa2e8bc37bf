"""The verb `animate`: stored motions as a page that plays, or as a film for slides."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import SOLVED
from nhpocp.cli.options import json_option
from nhpocp.cli.progress import counter
from nhpocp.cli.terminal import put, tell
from nhpocp.errors import InvalidProblemError
from nhpocp.whole import write_file

if TYPE_CHECKING:
    from nhpocp.comparison import Entry

FORMATS = ("html", "gif", "mp4")


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DIR...")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The file to write.")
@click.option(
    "--format",
    "kind",
    type=click.Choice(FORMATS),
    help="A page that plays (default), or a film for slides; else what -o ends in.",
)
@json_option
def animate(folders: tuple[Path, ...], output: Path | None, kind: str | None, as_json: bool) -> int:
    """Show the motions stored in every DIR, side by side.

    Writes animation.html into DIR, or for several beside them: one file that needs no network.
    """
    from nhpocp.comparison_folder import load_comparison

    kind = _kind(output, kind)
    entries = load_comparison(folders).entries
    file = output or _place([Path(entry.folder or ".") for entry in entries]) / f"animation.{kind}"

    from nhpocp.views.animation import check_motions

    check_motions(entries)
    with counter(as_json, "frame") as show:
        write = _writer(kind, entries, show)
        _check_file(file)
        _write(file, write)
    if as_json:
        put({"file": str(file), "format": kind, "folders": [entry.folder for entry in entries]})
    else:
        tell(str(file))
    return SOLVED


def _kind(output: Path | None, kind: str | None) -> str:
    """The format that is asked for, by name or by the file's."""
    ending = output.suffix.lower().lstrip(".") if output else ""
    if kind and ending in FORMATS and ending != kind:
        raise InvalidProblemError(f"--format {kind}, but the file's name ends in .{ending}", file=str(output))
    if kind is None and ending and ending not in FORMATS:
        raise InvalidProblemError(
            f"a file that ends in .{ending}; expected .{', .'.join(FORMATS)}, or say --format",
            file=str(output),
        )
    return kind or ending or "html"


def _place(folders: Sequence[Path]) -> Path:
    """Where the animation goes unless it is said: into a lone folder, beside several that lie together."""
    if len(folders) == 1:
        return folders[0]
    parents = {folder.resolve().parent for folder in folders}
    return folders[0].parent if len(parents) == 1 else Path()


def _check_file(file: Path) -> None:
    """Errors: `InvalidProblemError` for a file that `animate` did not write, and a place that cannot be written to."""
    from nhpocp.views.animation import MARKER

    if file.is_dir():
        raise InvalidProblemError("this is a folder; expected a file's name", file=str(file))
    try:
        if file.exists():
            content = file.read_bytes()
            if MARKER.encode() not in content[:4096] + content[-4096:] and content:
                raise InvalidProblemError(
                    "this file was not written by nhpocp animate and is left alone; choose another with -o",
                    file=str(file),
                )
        file.parent.mkdir(parents=True, exist_ok=True)
        if not os.access(file.parent, os.W_OK):
            raise InvalidProblemError("cannot write here: Permission denied", file=str(file))
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(file)) from error


def _writer(kind: str, entries: Sequence[Entry], show: Any) -> Callable[[Path], Any]:
    """What writes a file of this format. Errors: `MissingDependencyError` for one that this machine cannot make."""
    if kind == "html":
        from nhpocp.views.animation import write_animation

        return lambda file: write_animation(entries, file)
    from nhpocp.views.film import check_writer, write_film

    check_writer(kind)
    return lambda file: write_film(entries, file, kind, show)


def _write(file: Path, write: Callable[[Path], Any]) -> None:
    try:
        write_file(file, write)
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror or error}", file=str(file)) from error
