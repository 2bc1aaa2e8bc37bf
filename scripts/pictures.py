#!/usr/bin/env python3
"""Draws the pictures that Markdown shows, small, into problems/pictures/. Run: .venv/bin/python scripts/pictures.py

The report's needs a chromium on the PATH and is left as it is without one. With names of problems: only their motions.
"""

from __future__ import annotations

import shutil
import subprocess
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
SHOWN = {"paper": ("robot", "controls"), "paper_conjecture": ("margins",)}
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
            photograph_report(problem)
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


def photograph_report(problem: nhpocp.PlanningProblem) -> None:
    """The top of the comparison's page, half size."""
    from PIL import Image

    browser = shutil.which("chromium")
    if browser is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "report.html", Path(folder) / "report.png"
        nhpocp.write_report(nhpocp.compare([problem]), page)
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--window-size=1200,3000",
        ]
        subprocess.run(
            [browser, *options, f"--screenshot={shot}", page.as_uri()], check=True, capture_output=True
        )
        with Image.open(shot) as image:
            top = image.convert("L").crop((100, 950, 1100, 2320)).resize((600, 822))
            top.quantize(16).save(PICTURES / "paper_report.png", optimize=True)


if __name__ == "__main__":
    main()
