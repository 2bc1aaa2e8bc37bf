"""Margins: how far the matrices that a system inverts are from singular, and what these numbers are called."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Margin:
    r"""A number of one regularity matrix M(x) along a path.

    sigma: its least singular value, ≥ 0, the rotation columns divided by a length; det: det M, whose sign says on which
    side of the singular surface det M = 0 a pose is.
    """

    kind: Literal["sigma", "det"]
    matrix: str  # its name in `System.regularity`

    @property
    def name(self) -> str:
        """What trajectories, files and bounds call it: sigma_s, det_w."""
        return f"{self.kind}_{self.matrix}"

    @property
    def letter(self) -> str:
        """What [Paper] calls the matrix."""
        return self.matrix.upper()

    @property
    def symbol(self) -> str:
        """LaTeX without $."""
        return rf"\sigma_{{\min}}({self.letter})" if self.kind == "sigma" else rf"\det\,{self.letter}"


def sigma(matrix: str) -> Margin:
    return Margin("sigma", matrix)


def det(matrix: str) -> Margin:
    return Margin("det", matrix)


def margin(name: str) -> Margin | None:
    """The margin that is called so; None for any other quantity."""
    parts = re.fullmatch(r"(sigma|det)_(.*)", name)
    return Margin(parts[1], parts[2]) if parts else None  # type: ignore[arg-type]
