"""Singular values and the rank read off them, with the gap that shows how safe the reading is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nhpocp.arrays import Array
from nhpocp.singular_values import svd


@dataclass(frozen=True)
class Spectrum:
    """Singular values in falling order; those above ``tolerance`` times the largest count."""

    values: tuple[float, ...]
    tolerance: float

    @classmethod
    def of(cls, matrix: Array, tolerance: float) -> Spectrum:
        """Of a finite matrix."""
        return cls(tuple(float(value) for value in svd(matrix, compute_uv=False)), tolerance)

    @property
    def largest(self) -> float:
        return max(self.values, default=0.0)

    @property
    def rank(self) -> int:
        return sum(value > self.tolerance * self.largest for value in self.values)

    @property
    def least_kept(self) -> float | None:
        """The least singular value that counts, over the largest."""
        return self.values[self.rank - 1] / self.largest if self.rank else None

    @property
    def largest_dropped(self) -> float | None:
        """The largest that does not, over the largest of all; None where all count."""
        return self.values[self.rank] / self.largest if 0 < self.rank < len(self.values) else None

    @property
    def doubtful(self) -> bool:
        """Whether a tolerance a hundred times larger or smaller would give another rank."""
        kept, dropped = self.least_kept, self.largest_dropped
        return bool(
            (kept is not None and kept < 100 * self.tolerance)
            or (dropped is not None and dropped > 0.01 * self.tolerance)
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "rank": self.rank,
            "singular_values": list(self.values),
            "least_kept": self.least_kept,
            "largest_dropped": self.largest_dropped,
            "doubtful": self.doubtful,
        }
