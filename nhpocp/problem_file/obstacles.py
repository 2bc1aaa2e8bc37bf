"""The `obstacles` block: what stands around the system."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from nhpocp.bodies.obstacles import KINDS, Entry, Kind, Obstacle
from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.numbers import AtLeast, Number, Positive
from nhpocp.problem_file.states import Strict, Vector3

Vector2 = Annotated[list[Number], Field(min_length=2, max_length=2)]
Sizes = {size: Annotated[list[Positive], Field(min_length=size, max_length=size)] for size in (2, 3)}


def _annotation(kind: Kind, entry: Entry) -> Any:
    vector: Any = Vector2 if kind.dimension == 2 else Vector3
    return {
        "place": vector,
        "direction": vector,
        "size": Positive,
        "sizes": Sizes[kind.dimension],
        "angles": Vector3,
        "angle": Number,
        "places": Annotated[list[vector], AtLeast(kind.dimension + 1, "points")],
        "file": str,
    }[entry.kind]


def _model(name: str, kind: Kind) -> type[Strict]:
    fields: dict[str, Any] = {}
    for key, entry in kind.entries.items():
        wanted = _annotation(kind, entry)
        fields[key] = (
            (wanted, Field(description=entry.meaning))
            if entry.needed
            else (wanted | None, Field(default=None, description=entry.meaning))
        )
    return create_model(f"Obstacle_{name}", __base__=Strict, __doc__=f"{kind.meaning}.", **fields)


class ObstacleData(Strict):
    """One obstacle: a kind, with its place and size, and a name for messages if it is to have one."""

    name: str | None = Field(default=None, description="in messages, as in distance[leg 1, pillar]")


if not TYPE_CHECKING:
    _FIELDS: dict[str, Any] = {
        name: (_model(name, kind) | None, Field(default=None, description=kind.meaning))
        for name, kind in KINDS.items()
    }
    ObstacleData = create_model(
        "ObstacleData", __base__=ObstacleData, __doc__=ObstacleData.__doc__, **_FIELDS
    )


def plain_obstacles(given: Sequence[ObstacleData]) -> list[dict[str, Any]]:
    """As `PlanningProblem` takes them."""
    return [
        {
            key: value if key == "name" else {name: getattr(value, name) for name in value.model_fields_set}
            for key in each.model_fields_set
            if (value := getattr(each, key)) is not None
        }
        for each in given
    ]


def corners_of_meshes(data: Any, beside: FilePath | None) -> list[str]:
    """Overrides that write the corners of meshes into a file's data: a folder of results then needs no other file.

    Errors: `InvalidProblemError` for a mesh that cannot be read, or is none to keep clear of.
    """
    overrides = []
    obstacles = data.get("obstacles") if isinstance(data, Mapping) else None
    for i, each in enumerate(obstacles if isinstance(obstacles, list) else []):
        mesh = each.get("mesh") if isinstance(each, Mapping) else None
        if not isinstance(mesh, Mapping) or not isinstance(mesh.get("file"), str) or "points" in mesh:
            continue
        folder = beside.parent if beside is not None else FilePath()
        try:
            corners = Obstacle("mesh", {"file": folder / mesh["file"]}).entries["points"]
        except InvalidProblemError as error:
            raise error.under(f"obstacles[{i}]") from None
        overrides.append(f"obstacles[{i}].mesh.points={json.dumps(corners)}")
    return overrides
