"""Options that say what a machine of bodies, joints and contacts is like, for every verb that has one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from nhpocp.machine.simulation import MachineSettings

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_OPTIONS = (
    click.option(
        "--gravity", type=float, default=0.0, show_default=True, help="Downwards [m/s²]; 9.81 on earth."
    ),
    click.option("--payload", type=float, default=0.0, show_default=True, help="On the platform [kg]."),
    click.option("--friction", type=float, default=3.0, show_default=True, help="Of rollers on balls."),
    click.option(
        "--press", type=float, default=50.0, show_default=True, help="Of a roller against its ball [N]."
    ),
    click.option(
        "--servo",
        default="2e4,200",
        show_default=True,
        metavar="STIFFNESS[,DAMPING]",
        help="Of the motors [N/m, N s/m].",
    ),
    click.option("--latency", type=float, default=0.0, show_default=True, help="Of every command [s]."),
)
NAMES = ("gravity", "payload", "friction", "press", "servo", "latency")


def machine_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--gravity, --payload, --friction, --press, --servo, --latency."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def machine_settings(given: dict[str, Any], **more: Any) -> MachineSettings:
    """The machine of these options, which are taken out of ``given``; ``more``: other fields of it."""
    from nhpocp.machine.simulation import MachineSettings

    own = {name: given.pop(name) for name in NAMES}
    stiffness, damping = numbers(own.pop("servo"), "--servo")
    own |= {"stiffness": stiffness} if damping is None else {"stiffness": stiffness, "damping": damping}
    return MachineSettings(**own, **more)


def refuse_machine_options(context: click.Context, wanted: str) -> None:
    """Errors: `click.UsageError` where one of them was given, and there is no such machine without ``wanted``."""
    for name in NAMES:
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{name} is of machines of bodies and contacts; add {wanted}", context)


def numbers(text: str, option: str) -> tuple[float, float | None]:
    """One number or two."""
    first, comma, second = text.partition(",")
    return _amount(first, option), _amount(second, option) if comma else None


def _amount(text: str, option: str) -> float:
    """0.1 or 2deg: angles in radians."""
    parts = re.fullmatch(rf"\s*{_NUMBER}\s*(deg)?\s*", text)
    if parts is None:
        words = f"{text!r}; expected a number such as 0.1 or 2deg"
        raise click.BadParameter(words, param_hint=option)
    number = float(parts[1])
    return math.radians(number) if parts[2] else number
