"""Pictures of a Simulation: the plan against the machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nhpocp.arrays import Array
from nhpocp.machine.simulation.playing import Simulation
from nhpocp.views.figures import write_all
from nhpocp.views.style import GREY, OWN_SIZE, Room, axes_grid, legend_above, line_style, say, styled


@styled
def simulation(played: Simulation, room: Room = OWN_SIZE) -> Figure:
    """How far the machine is from the plan over time: position, angle, leg lengths, and the slip at its rollers."""
    path, units = played.trajectory, played.solution.problem.units
    driven = played.drive.name
    length = f" [{units.words('length')}]"
    rate = f" [{units.words('length')}/s]"
    panels: list[tuple[str, Array, list[str]]] = [
        (f"distance from the plan{length}", path["position_error"][:, None], []),
        ("angle from the plan [°]", np.degrees(path["angle_error"])[:, None], []),
        (
            f"{driven.rstrip('s').replace('_', ' ')} less the set-point{length}",
            path[driven] - path[f"planned_{driven}"],
            list(played.drive.labels),
        ),
    ]
    if played.rollers:
        words = [f"contact {number}" for number in played.rollers]
        panels.append((f"slip{rate}", path["slip_rate"], words))
    figure, grid = axes_grid(len(panels), room=room)
    for axes, (words_of_axis, values, names) in zip(grid, panels, strict=True):
        _draw(axes, path["t"], values, names)
        axes.axvline(played.duration, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))
        axes.set_ylabel(words_of_axis)
        axes.set_xlabel("time [s]")
    say(figure, [played.failure])
    return figure


def _draw(axes: Any, times: Array, values: Array, names: Sequence[str]) -> None:
    for i, column in enumerate(values.T):
        axes.plot(times, column, label=names[i] if names else None, **line_style(i))
    axes.margins(x=0.0)
    if names:
        legend_above(axes)


def write_simulation_pictures(
    played: Simulation, folder: Path, formats: Sequence[str] = ("svg", "png")
) -> list[Path]:
    """The pictures of a simulation as files."""
    return write_all({"simulation": simulation}, played, folder, formats, ["simulation"])
