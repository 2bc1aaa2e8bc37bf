"""Corners of the body in an STL file, text or binary."""

from __future__ import annotations

import re
from pathlib import Path

from nhpocp.arrays import Array
from nhpocp.bodies.hull import solid
from nhpocp.errors import InvalidProblemError

HEADER, RECORD = 84, 50  # bytes of a binary file before its triangles, and of each
LARGEST = 20_000_000  # bytes
DENT = 1e-3  # of a body's size: how far a mesh may lie inside its convex hull


def convex_corners(file: Path) -> Array:
    """The corners (n, 3) of the convex hull of a mesh.

    Errors: `InvalidProblemError` for a file that is none, or a mesh that is not convex or has too many corners.
    """
    import numpy as np

    triangles = _triangles(file)
    points = np.unique(triangles.reshape(-1, 3), axis=0)
    try:
        hull = solid(points)
    except ValueError as error:
        raise InvalidProblemError(f"{file}: {error}") from None
    depth, corners = np.full(len(triangles), np.inf), np.array(hull.corners)
    inside = corners.mean(axis=0)
    for face in hull.faces:
        normal = np.cross(corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[1]])
        normal = normal / np.linalg.norm(normal) * np.sign(normal @ (corners[face[0]] - inside))
        depth = np.minimum(depth, (normal @ corners[face[0]] - triangles @ normal).max(axis=1))
    size = float(np.ptp(points, axis=0).max())
    if depth.max() > DENT * size:
        raise InvalidProblemError(
            f"{file}: the mesh is not convex, its surface lies up to {depth.max():.3g} inside its hull; split it into "
            "convex parts, one obstacle each"
        )
    return corners


def _triangles(file: Path) -> Array:
    """(n, 3, 3)."""
    import numpy as np

    try:
        with file.open("rb") as stream:
            raw = stream.read(LARGEST + 1)
    except OSError as error:
        raise InvalidProblemError(f"cannot read {file}: {error.strerror}") from None
    if len(raw) > LARGEST:
        raise InvalidProblemError(f"{file} is larger than 20 MB; export a coarser mesh")
    count = int.from_bytes(raw[80:84], "little")
    if len(raw) >= HEADER and len(raw) == HEADER + RECORD * count and count:
        records = np.frombuffer(raw, np.uint8, offset=HEADER).reshape(count, RECORD)[:, 12:48]
        numbers = np.ascontiguousarray(records).view("<f4").astype(float)
    else:
        words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", raw)
        try:
            numbers = np.array(words, dtype=float)
        except ValueError:
            numbers = np.empty(0)
        if not len(numbers) or len(numbers) % 3:
            raise InvalidProblemError(f"{file} is no STL file, neither text nor binary")
    if not np.isfinite(numbers).all():
        raise InvalidProblemError(f"{file} has corners that are not finite")
    return numbers.reshape(-1, 3, 3)
