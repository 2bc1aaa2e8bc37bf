"""Values of a state as a problem file writes them: numbers, vectors, and rotations in one of four ways."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from nhpocp.problem_file.numbers import Number

Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Vector4 = Annotated[list[Number], Field(min_length=4, max_length=4)]


class Strict(BaseModel):
    """A mapping whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class Rotation(Strict):
    """Platform to base, b = p + R b̂, written in exactly one of four ways."""

    rpy: Vector3 | None = Field(
        default=None, description="roll, pitch, yaw [rad]: R = Rz(yaw) Ry(pitch) Rx(roll)"
    )
    quaternion: Vector4 | None = Field(default=None, description="w, x, y, z; a unit quaternion within 1e-6")
    rotvec: Vector3 | None = Field(default=None, description="axis times angle [rad]")
    matrix: Annotated[list[Vector3], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="rows of R; a rotation matrix within 1e-6"
    )


def _kind(value: Any) -> str:
    if isinstance(value, dict | Rotation):
        return "<rotation>"
    return "<vector>" if isinstance(value, list) else "<number>"


StateValue = Annotated[
    Annotated[Number, Tag("<number>")]
    | Annotated[list[Number], Tag("<vector>")]
    | Annotated[Rotation, Tag("<rotation>")],
    Discriminator(_kind),
]
State = dict[str, StateValue]


def plain_state(values: State) -> dict[str, Any]:
    """As `PlanningProblem` takes it."""
    return {
        name: value.model_dump(exclude_none=True) if isinstance(value, Rotation) else value
        for name, value in values.items()
    }
