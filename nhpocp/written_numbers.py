"""Numbers as files and Python may write them: 0.5, -pi/6, 2*pi/3, 75 deg. Nothing else is evaluated."""

from __future__ import annotations

import re
from math import isfinite, pi
from typing import Any

from nhpocp.declared import Degrees
from nhpocp.errors import describe

_DECIMAL = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_PI = re.compile(rf"(?P<sign>-)?(?:(?P<factor>{_DECIMAL})\*)?pi(?:/(?P<divisor>{_DECIMAL}))?")
_DEGREES = re.compile(rf"(?P<degrees>[-+]?{_DECIMAL}(?:[eE][-+]?[0-9]+)?) +deg")
PATTERN = rf"^(-?({_DECIMAL}\*)?pi(/{_DECIMAL})?|[-+]?{_DECIMAL}([eE][-+]?[0-9]+)? +deg)$"


def parse_number(value: Any) -> float:
    """The number that a value from a file stands for.

    Errors: ValueError in words fit for the user.
    """
    if isinstance(value, str):
        number = _from_text(value)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, got {describe(value)}")
    else:
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
    if not isfinite(number):
        raise ValueError(f"{'NaN' if number != number else 'infinity'}; expected a finite number")
    return number


def _from_text(text: str) -> float:
    if parts := _DEGREES.fullmatch(text):
        return Degrees(float(parts["degrees"]) * pi / 180)
    if parts := _PI.fullmatch(text):
        divisor = float(parts["divisor"] or 1)
        if divisor == 0:
            raise ValueError(f"{text!r} divides by zero")
        number = float(parts["factor"] or 1) * pi / divisor
        return -number if parts["sign"] else number
    raise ValueError(f"expected a number, got {describe(text)}{_hint(text)}")


def _hint(text: str) -> str:
    """What to write instead, where the intention can be guessed."""
    squeezed = re.sub(r"\s+|_", "", text)
    if parts := re.fullmatch(r"(.*?[0-9.])(deg|°|degrees?)", squeezed, re.IGNORECASE):
        return f"; write {parts[1] + ' deg'!r}" if _DEGREES.fullmatch(parts[1] + " deg") else ""
    if text != squeezed and _PI.fullmatch(squeezed):
        return f"; write {squeezed!r}"
    if re.fullmatch(rf"[-+]?{_DECIMAL}([eE][-+]?[0-9]+)?", squeezed):
        return f"; write {squeezed}" if squeezed != text else "; remove the quotes"
    if parts := re.fullmatch(rf"([-+]?{_DECIMAL}(?:[eE][-+]?[0-9]+)?)([a-zA-Zµ/]+)", squeezed):
        if parts[2] in ("rad", "radian", "radians"):
            return f"; radians are plain numbers: write {parts[1]}"
        return f"; {parts[2]!r} is no unit here, only deg is: write {parts[1]}, in the unit of your other numbers"
    return "; numbers are written 0.5, 1e-3, -pi/6, 2*pi/3 or 75 deg" if re.search("pi|[0-9]", text) else ""


def numbers_in(value: Any) -> Any:
    """A number or lists of them, with the texts among them as the numbers that they stand for. Errors: ValueError."""
    if isinstance(value, str):
        return parse_number(value)
    return [numbers_in(part) for part in value] if isinstance(value, list | tuple) else value
