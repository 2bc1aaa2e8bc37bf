#!/usr/bin/env python3
"""Draws a machine in a physics engine under feedback into problems/pictures/.

Run: .venv/bin/python scripts/steering_picture.py. Needs the extras `physics` and `test`, and a chromium on the PATH.
"""

from __future__ import annotations

import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pictures import PICTURES, ROOT, browser
from PIL import Image

import nhpocp
from nhpocp.machine.feedback.steering import Steered, Steering
from nhpocp.machine.model_errors import ModelErrors
from nhpocp.machine.simulation import Machine, MachineSettings
from nhpocp.views.animation import page
from nhpocp.views.scene import composed, drawn
from nhpocp.views.style import COLOURS, sheet

WRONG, GRAVITY = "roller_tilt=2deg,base_radius=1%", 9.81
SHOWN = (1, 4)  # after so many runs
SIZE, HEIGHT = (300, 250), 250  # of a scene, pixels
WIDE, ZOOM = (540, 350), 1.7  # of what is photographed of it, and how near


def main() -> None:
    problem = nhpocp.load_problem(ROOT / "problems" / "paper.yaml")
    system = ModelErrors.parsed(WRONG, problem.system).machine()[0]
    machine = Machine(system, problem.start, MachineSettings(gravity=GRAVITY))
    steering = Steering(1e-5, 5, "effort", 10.0, settling=0.5)
    steered = steering.run(problem, machine)
    with browser() as opened:
        if opened is None:
            raise SystemExit("no chromium on the PATH")
        scenes = [photograph(opened, steered, system, k) for k in SHOWN]
    parts = [*scenes, errors(steered)]
    whole = Image.new("RGB", (sum(part.width for part in parts), HEIGHT), "white")
    left = 0
    for part in parts:
        whole.paste(part, (left, 0))
        left += part.width
    whole.quantize(220).save(PICTURES / "paper_steering.png", optimize=True)


def photograph(opened: Any, steered: Steered, system: Any, cycle: int) -> Image.Image:
    """The machine where it was measured to stand, the start and the goal dashed."""
    problem, measured = steered.problem, steered.cycles[cycle].measured
    plan = steered.cycles[1].plan
    frame = drawn(system, problem.system.state_space.pack(measured))
    shown = composed(plan, np.array([0.0, 1.0]), [drawn(system, problem.start_point), frame])
    run = {
        "title": "",
        "words": "",
        "alarms": [],
        "description": "",
        "legend": [],
        "has_more": False,
        "panels": [],
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.html"
        file.write_text(page("", "", [{**run, **shown, "trace": None}], (1.0, "")), encoding="utf-8")
        tab = opened.new_page(viewport={"width": 1100, "height": 800}, device_scale_factor=1.0)
        tab.goto(file.as_uri())
        tab.evaluate(f"window.nhpocp.seek(1); window.nhpocp.zoom({ZOOM})")
        tab.wait_for_timeout(100)
        middle = [float(number) for number in 0.5 * (problem.goal["position"] + problem.start["position"])]
        x, y = tab.evaluate(f"window.nhpocp.project(0, {middle})")
        box = tab.locator("#scene-0").bounding_box()
        left, top = box["x"] + x - 0.5 * WIDE[0], max(box["y"] + y - 0.5 * WIDE[1], box["y"] + 4)
        shot = tab.screenshot(clip={"x": left, "y": top, "width": WIDE[0], "height": WIDE[1]})
    error = steered.cycles[cycle].position_error
    words = (
        f"after {cycle} run{'s' if cycle > 1 else ''}: {error:.1g} off"
        if error < 0.1
        else f"after {cycle} run: {error:.2f} off"
    )
    with Image.open(BytesIO(shot)) as image:
        return titled(image.convert("RGB"), words)


def titled(image: Image.Image, words: str) -> Image.Image:
    """Small, under a line of words."""
    image.thumbnail((SIZE[0] - 16, SIZE[1] - 30), Image.Resampling.LANCZOS)
    with sheet():
        figure = Figure(figsize=(SIZE[0] / 100, HEIGHT / 100), dpi=100)
        figure.text(0.5, 0.95, words, ha="center", va="center", fontsize=10)
        base = rendered(figure)
    base.paste(image, ((SIZE[0] - image.width) // 2, 26 + (HEIGHT - 26 - image.height) // 2))
    return base


def errors(steered: Steered) -> Image.Image:
    """Position and angle over the runs."""
    with sheet():
        figure = Figure(figsize=(2.7, HEIGHT / 100), dpi=100)
        axes = figure.add_axes((0.24, 0.18, 0.72, 0.68))
        runs = np.arange(len(steered.cycles))
        for i, (name, words) in enumerate((("position_error", "position"), ("angle_error", "angle [rad]"))):
            values = [getattr(cycle, name) for cycle in steered.cycles]
            axes.plot(runs, values, marker="os"[i], markersize=4, color=COLOURS[i], label=words)
        axes.set(yscale="log", xlabel="runs", xticks=runs)
        axes.legend(frameon=False, fontsize=8)
        figure.text(0.58, 0.95, "error at the goal", ha="center", va="center", fontsize=10)
        return rendered(figure)


def rendered(figure: Figure) -> Image.Image:
    stream = BytesIO()
    figure.savefig(stream, dpi=100)
    with Image.open(stream) as image:
        return image.convert("RGB")


if __name__ == "__main__":
    main()
