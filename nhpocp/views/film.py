"""Motions as a film for slides, drawn like the pictures on paper: an animated GIF, or MP4 where ffmpeg is at hand."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from nhpocp.arrays import Array
from nhpocp.comparison import Entry
from nhpocp.errors import InvalidProblemError, MissingDependencyError
from nhpocp.views import drawing, obstacles, report_words
from nhpocp.views.animation import MARKER, check_motions, same_system
from nhpocp.views.finite_path import path_of
from nhpocp.views.panels import crossing_times
from nhpocp.views.scene import drawn, ends_of
from nhpocp.views.style import ALARM, COLOURS, GREY, sheet

FRAMES, SECONDS, REST = 48, 4.8, 1.2  # of the motion, and how long its end stands still [s]
SIDE = 3.6  # inches a scene
DOTS = {"gif": 150, "mp4": 200}  # per inch
PALETTE = 96
NEARLY_WHITE = 248  # a shade that counts as white


def check_writer(kind: str) -> None:
    """Errors: `MissingDependencyError` where a film of this kind cannot be made on this machine."""
    if kind == "mp4" and shutil.which("ffmpeg") is None:
        raise MissingDependencyError(
            "an mp4 needs the program ffmpeg, which is not installed here; install it (Debian: apt install ffmpeg; "
            "conda: conda install ffmpeg), or write a gif with --format gif"
        )


def write_film(entries: Sequence[Entry], file: Path, kind: str, progress: Any = None) -> Path:
    """Writes the film; ``progress(k, count)`` is called after every frame.

    Errors: `InvalidProblemError` as of `animation.check_motions`, `MissingDependencyError` as of `check_writer`.
    """
    check_motions(entries)
    check_writer(kind)
    images = _frames(entries, DOTS[kind], progress)
    if kind == "gif":
        _write_gif(images, file)
    else:
        _write_mp4(images, file)
    return file


@dataclass(frozen=True)
class _Shot:
    """What one run needs in every frame: its times, states, path, standing drawings and the corners around all."""

    entry: Entry
    times: Array
    states: Array
    points: Array
    ends: list[Mapping[str, Any]]
    corners: tuple[Array, Array]

    @classmethod
    def of(cls, entry: Entry) -> _Shot:
        solution = entry.solution
        system, path = solution.problem.system, path_of(solution)
        states, points = drawing.states_of(solution, path), drawing.path_points(solution, path)
        ends = list(ends_of(solution).values())
        some = [drawn(system, state) for state in (*states[::5], states[-1])]
        corners = obstacles.widened(system, *drawing.extent(*some, *ends, points=points))
        return cls(entry, path.times, states, points, ends, corners)


def _frames(entries: Sequence[Entry], dots: int, progress: Any) -> Iterator[Image.Image]:
    """The pictures of equal steps in time, each run at its own sample nearest to the clock."""
    names, shots = report_words.titles(entries), [_Shot.of(entry) for entry in entries]
    if same_system(entries):
        low = np.min([shot.corners[0] for shot in shots], axis=0)
        high = np.max([shot.corners[1] for shot in shots], axis=0)
        shots = [replace(shot, corners=(low, high)) for shot in shots]
    count = len(shots)
    for k, clock in enumerate(np.linspace(0.0, max(shot.times[-1] for shot in shots), FRAMES)):
        with sheet():
            figure = Figure(figsize=(SIDE * count, SIDE), dpi=dots)
            for i, (shot, name) in enumerate(zip(shots, names, strict=True)):
                _scene(figure, (i / count, 0.06, 0.98 / count, 0.84), shot, clock)
                figure.text((i + 0.5) / count, 0.95, name, ha="center", va="center", fontsize=10)
            figure.text(0.02, 0.03, f"$t$ = {clock:.2f}", fontsize=9)
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
            size, colours = canvas.get_width_height(), canvas.buffer_rgba().tobytes()
            yield Image.frombuffer("RGBA", size, colours).convert("RGB")
        if progress is not None:
            progress(k + 1, FRAMES)


def _scene(figure: Any, box: tuple[float, float, float, float], shot: _Shot, clock: float) -> None:
    """One run at one time: the mechanism, its path so far, start and goal dashed, singularities red."""
    system, points = shot.entry.solution.problem.system, shot.points
    k = int(np.argmin(np.abs(shot.times - clock)))
    names = drawing.axis_names(system, len(shot.corners[0]), shot.entry.solution.problem.units)
    axes = drawing.add_view(figure, box, *shot.corners, names, 0.95, not system.plotted)
    obstacles.plot_obstacles(axes, system, *shot.corners)
    for end in shot.ends:
        drawing.plot_robot(axes, end, ghost=True)
    drawing.plot_robot(axes, drawn(system, shot.states[k]))
    if not len(points):
        return
    axes.plot(*points.T, color="0.7", linewidth=0.8, zorder=199)
    axes.plot(*points[: k + 1].T, color=COLOURS[6], linewidth=1.3, zorder=200)
    axes.plot(*points[[k]].T, marker="o", markersize=3, color=GREY, zorder=201)
    for times in crossing_times(shot.entry.solution).values():
        for t in times:
            place = [[float(np.interp(t, shot.times, column))] for column in points.T]
            axes.plot(*place, marker="D", markersize=4, color=ALARM, zorder=202)


def _write_gif(images: Iterator[Image.Image], file: Path) -> None:
    """One palette for all frames, so that only what moves is stored again."""
    pictures = list(images)
    sheet_of_colours = Image.new("RGB", (pictures[0].width, 3 * pictures[0].height))
    for i, picture in enumerate((pictures[0], pictures[len(pictures) // 2], pictures[-1])):
        sheet_of_colours.paste(picture, (0, i * picture.height))
    # the usual median cut would mix the paper's white with its neighbours
    palette = sheet_of_colours.quantize(PALETTE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    # Pillow looks a colour up in cells of a few shades: nearly white would take the paper's place
    palette.putpalette([255 if shade >= NEARLY_WHITE else shade for shade in palette.getpalette() or []])
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    steps = [round(1000 * SECONDS / FRAMES)] * (len(frames) - 1) + [round(1000 * REST)]
    frames[0].save(
        file,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=steps,
        loop=0,
        comment=MARKER.encode(),
        optimize=False,
    )


def _write_mp4(images: Iterator[Image.Image], file: Path) -> None:
    """Frames as raw numbers into ffmpeg."""
    first = next(images)
    width, height = first.width - first.width % 2, first.height - first.height % 2
    command = [
        *("ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
        *("-s", f"{width}x{height}", "-r", str(FRAMES / SECONDS), "-i", "-"),
        *("-vf", f"tpad=stop_mode=clone:stop_duration={REST}", "-pix_fmt", "yuv420p"),
        *("-metadata", f"comment={MARKER}", "-f", "mp4", str(file)),
    ]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        words = b""
        try:
            for picture in (first, *images):
                running.stdin.write(picture.crop((0, 0, width, height)).tobytes())  # type: ignore[union-attr]
        except BrokenPipeError:
            pass  # ffmpeg says below what it did not like
        finally:
            words = running.communicate()[1]
    if running.returncode:
        said = words.decode(errors="replace").strip().splitlines()
        raise InvalidProblemError(
            f"ffmpeg could not write the film: {said[-1] if said else 'no word why'}", file=str(file)
        )
