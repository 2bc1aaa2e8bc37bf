"""A simulated machine as a page that plays, with the plan beside it as faint lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from markupsafe import Markup

from nhpocp.arrays import Array
from nhpocp.machine.simulation.playing import Simulation
from nhpocp.views.animation import legend, page
from nhpocp.views.curves import as_data
from nhpocp.views.finite_path import thinned
from nhpocp.views.panels import Curve, Panel
from nhpocp.views.scene import PLANNED, composed, drawn
from nhpocp.whole import write_text

SAMPLES = 401


def write_simulation_page(played: Simulation, path: Path, title: str = "") -> Path:
    """Writes the page and returns its path."""
    write_text(path, render(played, title))
    return path


def render(played: Simulation, title: str = "") -> str:
    """The page as text; its data are JSON, as of `write_animation`, the plan's parts being called "planned …"."""
    path, problem = played.trajectory, played.solution.problem
    finite = np.isfinite(path["position"]).all(axis=1) & np.isfinite(path["orientation"]).all(axis=(1, 2))
    count = len(finite) if finite.all() else max(1, int(np.argmin(finite)))
    chosen, pack = thinned(count, SAMPLES), problem.system.state_space.pack
    frames, planned = (
        [
            drawn(
                system,
                pack(
                    {"position": path[f"{which}position"][k], "orientation": path[f"{which}orientation"][k]}
                ),
            )
            for k in chosen
        ]
        for system, which in ((played.system, ""), (problem.system, "planned_"))
    )
    times = path["t"][chosen]
    title = title or problem.name
    run = {
        "title": title,
        "words": _words(played),
        "alarms": [words for words in [played.failure] if words],
        "description": f"The machine of {title} as it was measured, and the plan in faint lines; curves over time",
        "legend": [*legend(played.solution), ("the plan", PLANNED)],
        "has_more": bool(played.rollers),
        "panels": as_data(_panels(played), 4 * SAMPLES),
        **composed(played.solution, times, frames, planned),
    }
    lead = f"Positions are those that were measured in {played.engine}; the thin red lines are where the plan has them."
    return page(f"Simulation: {problem.name}", lead, [run], (float(times[-1]), "s"))


def _words(played: Simulation) -> Markup:
    unit = played.solution.problem.units.length or ""
    words = Markup("{}: {} {} and {}° from the plan at the end")
    off, turned = f"{played.position_error:.3g}", f"{np.degrees(played.angle_error):.3g}"
    return words.format(played.outcome, off, unit, turned)


def _panels(played: Simulation) -> list[Panel]:
    """How far from the plan, what motors and servos do, and what is felt at the rollers."""
    path, length = played.trajectory, played.solution.problem.units.words("length")
    driven, legs = played.drive.name, played.drive.labels
    lag, words = path[driven] - path[f"planned_{driven}"], driven.rstrip("s").replace("_", " ")
    every = [
        _panel(played, "error", "distance from the plan", length, path["position_error"][:, None]),
        _panel(played, "error", "angle from the plan", "°", np.degrees(path["angle_error"])[:, None]),
        _panel(played, "leg", f"{words} less the set-point", length, lag, legs),
        _panel(played, "control", "motor force", "N", path["motor_force"], legs),
    ]
    if played.rollers:
        slip, pressed = path["slip_rate"], path["normal_force"]
        contacts = tuple(f"contact {number}" for number in played.rollers)
        every.append(_panel(played, "output", "slip", f"{length}/s", slip, contacts))
        every.append(_panel(played, "output", "force at the contact", "N", pressed, contacts))
    return every


def _panel(
    played: Simulation, group: str, words: str, unit: str, values: Array, labels: tuple[str, ...] = ()
) -> Panel:
    times, name = played.trajectory["t"], words.replace(" ", "_")
    symbols = labels or (words.split()[0],)
    curves = tuple(Curve(name, s, unit, times, column) for s, column in zip(symbols, values.T, strict=True))
    return Panel(group, name, words, "", curves, zero=True)
