"""How many evaluations a search may take."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass
class Budget:
    """Evaluations that are allowed: who evaluates takes them one by one, who searches asks what has come of it."""

    allowed: float = inf
    taken: int = 0
    refused: bool = False  # more were asked for than allowed

    @property
    def left(self) -> float:
        return self.allowed - self.taken

    def take(self) -> bool:
        """Whether there was another evaluation to take."""
        self.refused = self.left <= 0
        self.taken += not self.refused
        return not self.refused

    def extend(self, more: int) -> None:
        self.allowed += more
        self.refused = False
