"""Values of a state as a problem file writes them: numbers, vectors, and rotations in one of four ways.

Plain Python, no NumPy: `nhpocp check` has to answer before NumPy would have been imported.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import cos, hypot, sin, sqrt
from typing import Annotated, Any, cast

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from nhpocp.problem_file.issues import Issue, Refusal, unknown_key
from nhpocp.problem_file.numbers import Number, describe
from nhpocp.state_space import Block, StateSpace
from nhpocp.systems.system import System

GROUP_TOLERANCE = 1e-6  # how far a matrix or quaternion may be from SO(3)

Matrix = list[list[float]]
Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Vector4 = Annotated[list[Number], Field(min_length=4, max_length=4)]
WRITINGS = {
    "rpy": "[roll, pitch, yaw]",
    "quaternion": "[w, x, y, z]",
    "rotvec": "[x, y, z]",
    "matrix": "[[…], […], […]]",
}


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

    @model_validator(mode="after")
    def _one_rotation(self) -> Rotation:
        given = [name for name in WRITINGS if getattr(self, name) is not None]
        ways = ", ".join(f"{name}: {form}" for name, form in WRITINGS.items())
        if len(given) != 1:
            came = f"both {given[0]} and {given[1]}" if given else "no rotation"
            place = (given[1],) if given else ()
            raise Refusal([Issue(place, f"{came}; expected exactly one of {ways}", at_key=bool(given))])
        if self.quaternion is not None:
            _check_quaternion(self.quaternion)
        if self.matrix is not None:
            _check_matrix(self.matrix)
        return self

    def rows(self) -> Matrix:
        """The rotation matrix; a matrix or quaternion slightly off the group is projected onto it."""
        if self.rpy is not None:
            return _from_rpy(*self.rpy)
        if self.rotvec is not None:
            angle = hypot(*self.rotvec)
            half = 0.5 if angle < 1e-150 else sin(angle / 2) / angle
            return _from_quaternion([cos(angle / 2), *(half * x for x in self.rotvec)])
        if self.quaternion is not None:
            return _from_quaternion(self.quaternion)
        return nearest_rotation(self.matrix or [])


def _check_quaternion(quaternion: list[float]) -> None:
    norm = hypot(*quaternion)
    if abs(norm - 1) <= GROUP_TOLERANCE:
        return
    near = f"; write [{', '.join(f'{x / norm:.9g}' for x in quaternion)}]" if norm > 1e-6 else ""
    raise Refusal(
        [
            Issue(
                ("quaternion",),
                f"its norm {norm:.9g} is off by {abs(norm - 1):.2g}; expected a unit quaternion [w, x, y, z]{near}",
            )
        ]
    )


def _check_matrix(matrix: Matrix) -> None:
    determinant = sum(matrix[0][j] * _cofactors(matrix)[0][j] for j in range(3))
    pairs = [(i, j) for i in range(3) for j in range(3)]
    off = max(abs(sum(matrix[k][i] * matrix[k][j] for k in range(3)) - (i == j)) for i, j in pairs)
    if off <= 10 * GROUP_TOLERANCE and determinant < 0:
        fault = f"a reflection, det R = {determinant:.6g}; expected a rotation, det R = 1"
    else:
        if off <= 10 * GROUP_TOLERANCE:  # near enough for its nearest rotation to mean something
            near = nearest_rotation(matrix)
            off = max(abs(matrix[i][j] - near[i][j]) for i, j in pairs)
            if off <= GROUP_TOLERANCE:
                return
        fault = (
            f"no rotation matrix: RᵀR is off the unit matrix by {off:.2g}, det R = {determinant:.6g}; "
            "expected the rows of a rotation, or rpy: [roll, pitch, yaw]"
        )
    raise Refusal([Issue(("matrix",), fault)])


def _cofactors(m: Matrix) -> Matrix:
    def minor(i: int, j: int) -> float:
        a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        return m[a][c] * m[b][d] - m[a][d] * m[b][c]

    return [[minor(i, j) for j in range(3)] for i in range(3)]


def nearest_rotation(matrix: Matrix) -> Matrix:
    """The rotation nearest to a matrix already close to one: the polar factor, by Newton's iteration."""
    for _ in range(4):  # doubles the digits each time, from 1e-6
        cofactors = _cofactors(matrix)
        determinant = sum(matrix[0][j] * cofactors[0][j] for j in range(3))
        moved = [[0.5 * (matrix[i][j] + cofactors[i][j] / determinant) for j in range(3)] for i in range(3)]
        change = max(abs(moved[i][j] - matrix[i][j]) for i in range(3) for j in range(3))
        if change < 1e-15:  # already one to rounding: leave every digit as it was written
            break
        matrix = moved
    return [list(row) for row in matrix]


def _from_rpy(roll: float, pitch: float, yaw: float) -> Matrix:
    (sr, cr), (sp, cp), (sy, cy) = ((sin(a), cos(a)) for a in (roll, pitch, yaw))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def _from_quaternion(quaternion: list[float]) -> Matrix:
    norm = sqrt(sum(x * x for x in quaternion))
    w, x, y, z = (q / norm for q in quaternion)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


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


def check_state(space: StateSpace, values: State) -> list[Issue]:
    """What does not fit the system's state: unknown, missing or misshapen blocks."""
    issues = list(_misfits(space.blocks, values))
    if any(issue.at_key for issue in issues):
        return issues  # a name misspelt is one that is missing too
    missing = [
        Issue((block.name,), f"required key is missing; expected {expected(block)}")
        for block in space.blocks
        if block.name not in values
    ]
    return missing + issues


def check_goal(system: System, values: State) -> list[Issue]:
    """What does not fit a goal or via pose: some of the state's blocks, or outputs that depend on the pose alone."""
    blocks = [*system.state_space.blocks, *system.pose_outputs]
    if not values:
        wanted = ", ".join(f"{block.name}: {expected(block)}" for block in blocks)
        return [Issue((), f"empty; expected some of {wanted}")]
    if issues := list(_misfits(blocks, values)):
        return issues
    count, room = sum(b.dimension for b in blocks if b.name in values), system.state_space.dimension
    if count > room:
        named = ", ".join(values)
        return [Issue((), f"fixes {count} numbers of a state that has {room}; leave out one of {named}")]
    return []


def _misfits(blocks: Sequence[Block], values: State) -> Iterator[Issue]:
    names = [block.name for block in blocks]
    for name in values:
        if name not in names:
            yield unknown_key((name,), names)
    for block in blocks:
        if block.name in values and (fault := misfit(block, values[block.name])):
            yield Issue((block.name,), fault)


def expected(block: Block) -> str:
    """How a block's value is written."""
    if block.kind == "rotation":
        return "{rpy: [roll, pitch, yaw]}"
    if block.kind == "direction":
        return "[x, y, z]"
    return "number" if block.kind == "scalar" else f"[{block.components} numbers]"


def misfit(block: Block, value: StateValue) -> str | None:
    """What is wrong with a value for this block, if anything is."""
    kind = {"rotation": "<rotation>", "scalar": "<number>"}.get(block.kind, "<vector>")
    if _kind(value) != kind:
        came = "a rotation" if isinstance(value, Rotation) else describe(value)
        return f"expected {expected(block)}, got {came}"
    if kind == "<vector>":
        numbers = cast("list[float]", value)
        if len(numbers) != block.components:
            return f"{len(numbers)} numbers; expected {block.components}"
        if block.kind == "direction" and hypot(*numbers) < 1e-9:
            return "the zero vector; expected a direction"
    return None


def plain_state(values: State) -> dict[str, Any]:
    """Numbers only: rotations as matrices."""
    return {name: value.rows() if isinstance(value, Rotation) else value for name, value in values.items()}
