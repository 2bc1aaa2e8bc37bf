"""How long a motion takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.constructed import Constructed
from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError

INSTANT = 1e-12  # fraction of a duration, in the place of 0


@dataclass(frozen=True)
class Horizon(Constructed):
    """The duration T: fixed, or free between two values for the solvers that can choose it.

    initial: T [time], the first guess of a free one, or None. minimum, maximum: the shortest and the longest T [time];
    one of them makes it free. A problem takes a number too, or a file's {"min": 0.5, "max": 3, "initial": 1}.
    Errors: `InvalidProblemError` for what is no duration > 0, or outside its limits.
    """

    initial: float | None = 1.0
    minimum: float | None = None
    maximum: float | None = None

    def __post_init__(self) -> None:
        for name in ("initial", "minimum", "maximum"):
            value = getattr(self, name)
            if value is None:
                continue
            if real(value, "horizon", "a duration > 0") <= 0:
                words = f"{value:g} is not a duration; expected a number > 0"
                raise InvalidProblemError(words, path="horizon")
            object.__setattr__(self, name, float(value))
        if self.initial is None and not self.free:
            words = "empty; expected {min: …, max: …, initial: …} or a number"
            raise InvalidProblemError(words, path="horizon")
        lower, upper = self.minimum or 0.0, self.maximum or np.inf
        if self.free and not lower < upper:
            raise InvalidProblemError(f"min {lower:g} is not below max {upper:g}", path="horizon")
        if self.free and self.initial is not None and not lower <= self.initial <= upper:
            words = f"{self.initial:g} lies outside min and max, [{lower:g}, {upper:g}]"
            raise InvalidProblemError(words, path="horizon.initial")

    @classmethod
    def of(cls, given: Any) -> Horizon:
        """A horizon as Python or a file writes it: a number, or a mapping with some of min, max and initial."""
        if isinstance(given, Horizon):
            return given
        if not isinstance(given, Mapping):
            return cls(real(given, "horizon", "a duration, or {'min': …, 'max': …, 'initial': …}"))
        for name in given:
            if name not in ("min", "max", "initial"):
                known = ("min", "max", "initial")
                raise InvalidProblemError("unknown key", path=f"horizon.{name}", word=str(name), known=known)
        return cls(given.get("initial"), given.get("min"), given.get("max"))

    @property
    def free(self) -> bool:
        return self.minimum is not None or self.maximum is not None

    @property
    def range(self) -> tuple[float, float]:
        """The shortest and the longest duration; without a minimum, an instant beside the first of those known."""
        known = next(value for value in (self.initial, self.maximum, self.minimum) if value is not None)
        return self.minimum or INSTANT * known, self.maximum or np.inf

    @property
    def first(self) -> float:
        """The duration to begin with: the one that is given, or the middle of a free one's range."""
        if self.initial is not None:
            return self.initial
        if self.minimum is not None and self.maximum is not None:
            return 0.5 * (self.minimum + self.maximum)
        return self.minimum or self.maximum or 1.0

    def kept(self, duration: float) -> float:
        """The nearest duration that is allowed: an optimizer meets bounds up to its tolerance."""
        return float(np.clip(duration, *self.range))

    @property
    def fixed(self) -> float:
        """The duration that a solver holds which cannot choose it."""
        if self.initial is None:
            raise InvalidProblemError(
                "the horizon is free and the Jacobian method holds it fixed; add `initial: 1` beside min and max",
                path="horizon",
            )
        return self.initial
