#!/usr/bin/env python3
"""Draws the pictures that Markdown shows, small, into problems/pictures/. Run: .venv/bin/python scripts/pictures.py

The report's needs the extra `test` and a chromium on the PATH; without the latter it is left as it is. With names of
problems: only their motions.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import functional_flow
from goals import paper_task
from matplotlib.figure import Figure

import nhpocp
from nhpocp.views import analysis_figures, drawing, figures
from nhpocp.views.finite_path import path_of
from nhpocp.views.style import sheet

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "problems" / "pictures"
SHOWN = {"paper": ("robot",), "paper_conjecture": ("controls", "relative_pose", "margins")}
MAPPED = "paper_conjecture"  # the map of its singularities


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    problems = sorted((ROOT / "problems").glob("*.yaml"))
    for file in problems:
        if sys.argv[1:] and file.stem not in sys.argv[1:]:
            continue
        problem = nhpocp.load_problem(file)
        solution = nhpocp.solve(problem)
        save(motion(solution), f"{file.stem}_motion")
        if sys.argv[1:]:
            continue
        for picture in SHOWN.get(file.stem, ()):
            save(getattr(figures, picture)(solution), f"{file.stem}_{picture}")
        if file.stem == "paper":
            photograph_report()
    if not sys.argv[1:]:
        draw_singularities()
        draw_functional_flow()


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
    points, goal = drawing.path_points(solution, path), drawing.goal_pose(solution)
    poses = drawing.poses_of(solution)[:2]
    shown = [pose.drawing for pose in [*poses, *([goal] if goal else [])]]
    low, high = drawing.extent(*shown, points=points)
    with sheet():
        figure = Figure(figsize=(4.4, 2.2))
        for i, pose in enumerate(poses):
            box = (i / 2, 0.04, 0.48, 0.88)
            axes = drawing.add_view(figure, box, low, high, drawing.axis_names(system, len(low)), zoom=0.84)
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


def photograph_report() -> None:
    """The comparison's page from its verdict to its first figure, half size."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    browser = shutil.which("chromium")
    if browser is None:
        return
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        page, shot = Path(folder) / "report.html", Path(folder) / "report.png"
        problem = nhpocp.load_problem(ROOT / "problems" / "paper.yaml")  # another: nothing of it is built yet
        nhpocp.write_report(nhpocp.compare([problem]), page)
        opened = running.chromium.launch(executable_path=browser, args=["--no-sandbox", "--disable-gpu"])
        tab = opened.new_page(viewport={"width": 1200, "height": 900}, device_scale_factor=1.2)
        tab.goto(page.as_uri())
        first = tab.get_by_role("heading", name="Verdict").bounding_box()
        last = tab.locator("figure").first.bounding_box()
        if first is None or last is None:
            raise RuntimeError("the report shows neither verdict nor figure")
        top, left = first["y"] - 8, first["x"] - 8
        size = {"width": last["width"] + 16, "height": last["y"] + last["height"] + 8 - top}
        tab.screenshot(path=shot, full_page=True, clip={"x": left, "y": top, **size})
        opened.close()
        with Image.open(shot) as image:
            small = image.convert("L").resize((620, round(620 * image.height / image.width)))
            small.quantize(16).save(PICTURES / "paper_report.png", optimize=True)


if __name__ == "__main__":
    main()
