"""A model of a Hessian that is dense only among the directions in which something was learnt of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.singular_values import svd

MOST = 100  # directions; among no more coefficients than that the model is the full matrix
DEPENDENT = 1e-10  # of a vector: what is left of it outside the directions that counts as none
FLATTEST, STEEPEST = 1e-4, 1e5  # curvatures of the model, times its first one, beyond which it begins again


@dataclass(frozen=True)
class Curvature:
    """The symmetric matrix ``flat`` I, but ``inner`` (r, r) among the orthonormal columns of ``seen`` (n, r)."""

    flat: float
    seen: Array
    inner: Array

    @classmethod
    def first(cls, flat: float, size: int) -> Curvature:
        """``flat`` I, of no directions; of all, among no more than `MOST`."""
        seen = np.eye(size) if size <= MOST else np.empty((size, 0))
        return cls(flat, seen, flat * np.eye(seen.shape[1]))

    @property
    def full(self) -> Array:
        """Itself (n, n), for which there must be room."""
        return self @ np.eye(len(self.seen))

    def __matmul__(self, columns: Array) -> Array:
        within = self.seen.T @ columns
        return np.asarray(self.flat * (columns - self.seen @ within) + self.seen @ (self.inner @ within))

    def over(self, *vectors: Array) -> Curvature:
        """Itself, with directions that span these vectors (n,) or (n, k) too."""
        size, rank = self.seen.shape
        if rank == size:
            return self
        columns = np.column_stack(vectors)
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        for _ in range(2):  # the second time for what rounding left
            columns = columns - self.seen @ (self.seen.T @ columns)
        left, values, _ = svd(columns, full_matrices=False)
        new = left[:, values > DEPENDENT]
        inner = self.flat * np.eye(rank + new.shape[1])
        inner[:rank, :rank] = self.inner
        return Curvature(self.flat, np.hstack([self.seen, new]), inner)

    def updated(self, step: Array, change: Array) -> Curvature:
        """The BFGS update for a step along which the gradient changed so. [Nocedal, Wright, ch. 6 and 18.3]

        Of more than `MOST` directions those are forgotten whose curvature differs least from ``flat``.
        """
        there = self.over(step, change)
        seen, inner = there.seen, _bfgs(there.inner, there.seen.T @ step, there.seen.T @ change, self.flat)
        if MOST < len(inner) < len(seen):
            values, vectors = np.linalg.eigh(inner)
            told = np.argsort(np.abs(np.log(np.maximum(values, np.finfo(float).tiny) / self.flat)))[-MOST:]
            seen, inner = seen @ vectors[:, told], np.diag(values[told])
        return Curvature(self.flat, seen, inner)


def _bfgs(hessian: Array, step: Array, change: Array, scale: float) -> Array:
    """Powell's damped update: stays positive definite; back to ``scale`` I where it would end nearly singular."""
    image = hessian @ step
    curvature, along = float(step @ image), float(step @ change)
    if curvature <= 0:
        return hessian
    theta = 1.0 if along >= 0.2 * curvature else 0.8 * curvature / (curvature - along)
    mixed = theta * change + (1 - theta) * image
    if not FLATTEST * scale * (step @ step) < step @ mixed > mixed @ mixed / (STEEPEST * scale):
        return scale * np.eye(len(step))
    return hessian - np.outer(image, image) / curvature + np.outer(mixed, mixed) / float(step @ mixed)
