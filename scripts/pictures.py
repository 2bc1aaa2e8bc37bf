#!/usr/bin/env python3
"""Draws the pictures that Markdown shows, small, into problems/pictures/. Run: .venv/bin/python scripts/pictures.py

The report's and the film need the extra `test` and a chromium on the PATH, without which they are left as they are.
With names of problems: only their motions.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import functional_flow
import numpy as np
from goals import paper_task
from matplotlib.figure import Figure

import nhpocp
from nhpocp.views import analysis_figures, drawing, figures, obstacles
from nhpocp.views.finite_path import path_of
from nhpocp.views.style import sheet

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "problems" / "pictures"
SHOWN = {"paper_conjecture": ("controls", "relative_pose", "margins")}
FRAMES, TRIMMED = 26, 70  # of the film, pixels off its top
MAPPED = "paper_conjecture"  # the map of its singularities


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    problems = sorted((ROOT / "problems").glob("*.yaml"))
    for file in problems:
        if sys.argv[1:] and file.stem not in sys.argv[1:]:
            continue
        problem = nhpocp.load_problem(file)
        solution = nhpocp.solve(problem, named_solver(file))
        save(motion(solution), f"{file.stem}_motion")
        if sys.argv[1:]:
            continue
        for picture in SHOWN.get(file.stem, ()):
            save(getattr(figures, picture)(solution), f"{file.stem}_{picture}")
        if file.stem == "paper":
            photograph_comparison()
    if not sys.argv[1:]:
        draw_singularities()
        draw_functional_flow()


def named_solver(file: Path) -> str:
    """The solver that a file's first comment names, as in `# nlp: …`; the Jacobian method otherwise."""
    named = re.search(r"^# (nlp|sinusoids): ", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return named[1] if named else "jacobian"


def save(figure: Any, name: str) -> None:
    """Small: 64 colours are enough."""
    from PIL import Image

    path = PICTURES / f"{name}.png"
    figure.savefig(path, dpi=110, metadata={"Software": None})
    with Image.open(path) as image:
        small = image.convert("RGB").quantize(64)
    small.save(path, optimize=True)


def motion(solution: nhpocp.Solution) -> Figure:
    """A motion for the gallery: the mechanism at the start and in the middle, the goal as a ghost, the path."""
    path, system = path_of(solution), solution.problem.system
    points, goal = drawing.path_points(solution, path), drawing.goal_pose(solution.problem)
    poses = drawing.poses_of(solution)[:2]
    shown = [pose.drawing for pose in [*poses, *([goal] if goal else [])]]
    low, high = obstacles.widened(system, *drawing.extent(*shown, points=points))
    with sheet():
        figure = Figure(figsize=(4.4, 2.2))
        for i, pose in enumerate(poses):
            box = (i / 2, 0.04, 0.48, 0.88)
            names = drawing.axis_names(system, len(low), solution.problem.units)
            axes = drawing.add_view(figure, box, low, high, names, 0.84, not system.plotted)
            obstacles.plot_obstacles(axes, system, low, high)
            if goal:
                drawing.plot_robot(axes, goal.drawing, ghost=True)
            drawing.plot_robot(axes, pose.drawing)
            drawing.plot_path(axes, points)
            figure.text((i + 0.5) / 2, 0.955, pose.words, ha="center", va="center")
    return figure


def draw_singularities() -> None:
    analysis = nhpocp.analyze(nhpocp.load_problem(ROOT / "problems" / f"{MAPPED}.yaml"))
    save(analysis_figures.singularity_map(analysis), f"{MAPPED}_map")


def draw_functional_flow() -> None:
    problem = paper_task("default")
    times, values = functional_flow.functional_flow(problem)
    found = {n: functional_flow.coefficient_flow(problem, n) for n in functional_flow.INTERVALS}
    save(functional_flow.figure(times, values, found), "functional_flow")


@contextmanager
def browser() -> Iterator[Any]:
    """A chromium, or None where there is none."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium")
    if program is None:
        yield None
        return
    with sync_playwright() as running:
        opened = running.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        yield opened
        opened.close()


def photograph_comparison() -> None:
    """The comparison of `problems/paper.yaml` as its pages show it: what is asserted, and the robot on its way."""
    problem = nhpocp.load_problem(ROOT / "problems" / "paper.yaml")  # another: nothing of it is built yet
    comparison = nhpocp.compare([problem])
    with tempfile.TemporaryDirectory() as folder, browser() as opened:
        if opened is not None:
            photograph_report(opened, nhpocp.write_report(comparison, Path(folder) / "report.html"))
            film_animation(
                opened, nhpocp.write_animation(comparison.entries, Path(folder) / "animation.html")
            )


def photograph_report(opened: Any, page: Path) -> None:
    """From its verdict to its first figure, half size."""
    from PIL import Image

    tab = opened.new_page(viewport={"width": 1200, "height": 900}, device_scale_factor=1.2)
    tab.goto(page.as_uri())
    first = tab.get_by_role("heading", name="Verdict").bounding_box()
    last = tab.locator("figure").first.bounding_box()
    if first is None or last is None:
        raise RuntimeError("the report shows neither verdict nor figure")
    top, left = first["y"] - 8, first["x"] - 8
    size = {"width": last["width"] + 16, "height": last["y"] + last["height"] + 8 - top}
    shot = tab.screenshot(full_page=True, clip={"x": left, "y": top, **size})
    with Image.open(BytesIO(shot)) as image:
        small = image.convert("L").resize((620, round(620 * image.height / image.width)))
        small.quantize(16).save(PICTURES / "paper_report.png", optimize=True)


def film_animation(opened: Any, page: Path) -> None:
    """Both methods' robots on one clock, forth and held for a moment at both ends."""
    from PIL import Image

    tab = opened.new_page(viewport={"width": 1000, "height": 800})
    tab.goto(page.as_uri())
    first, last = (tab.locator(f"#scene-{run}").bounding_box() for run in (0, 1))
    if first is None or last is None:
        raise RuntimeError("the page shows no scenes")
    size = {"width": last["x"] + last["width"] - first["x"], "height": first["height"] - TRIMMED}
    clip = {"x": first["x"], "y": first["y"] + TRIMMED, **size}
    frames = []
    for time in np.linspace(0.0, 1.0, FRAMES):
        tab.evaluate(f"window.nhpocp.seek({time})")
        tab.wait_for_timeout(50)
        with Image.open(BytesIO(tab.screenshot(clip=clip))) as image:
            small = image.convert("RGB").resize((720, round(720 * image.height / image.width)))
        frames.append(small)
    palette = frames[FRAMES // 2].quantize(200)  # with fewer, legs lose theirs to greys
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [1200, *[80] * (FRAMES - 2), 2000]
    target = PICTURES / "paper_playing.gif"
    frames[0].save(target, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True)


if __name__ == "__main__":
    main()
