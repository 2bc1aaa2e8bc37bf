#!/usr/bin/env python3
"""Draws the pictures that Markdown shows, small, into problems/pictures/. Run: .venv/bin/python scripts/pictures.py

The report's needs a chromium on the PATH and is left as it is without one.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import functional_flow
from goals import paper_task

import nhpocp
from nhpocp.views import analysis_figures, figures

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "problems" / "pictures"
SHOWN = {"paper": ("robot", "controls"), "paper_conjecture": ("margins",)}
MAPPED = "paper_conjecture"  # the map of its singularities


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    for name, pictures in SHOWN.items():
        problem = nhpocp.load_problem(ROOT / "problems" / f"{name}.yaml")
        solution = nhpocp.solve(problem)
        for picture in pictures:
            save(getattr(figures, picture)(solution), f"{name}_{picture}")
        if name == "paper":
            photograph_report(problem)
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
