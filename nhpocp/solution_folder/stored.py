"""The parts of solution.json as pydantic models, by which they are written, and read back within bounds.

A field is called as the attribute that it holds, and by its alias in the file; further keys are ignored.
"""

from __future__ import annotations

from math import nan
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)

from nhpocp.constraints.bound import Bound, BoundReport
from nhpocp.errors import InvalidProblemError, UnreadableSolutionError, describe
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem_file.document import dotted
from nhpocp.solution import Crossing

SCHEMA_VERSION = 1
Duration = Annotated[float, Field(gt=0)]
Known = Annotated[float | None, AfterValidator(lambda value: nan if value is None else value)]  # null is NaN


class Stored(BaseModel):
    """A mapping of solution.json."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False, frozen=True)

    @classmethod
    def written(cls, part: Any) -> dict[str, Any]:
        """An object as the file has it; `plain_data.plain` makes JSON of that."""
        return {field.alias or name: getattr(part, name) for name, field in cls.model_fields.items()}


class StoredReplay(Stored):
    error: float | None
    reached: float = Field(alias="reached_t")
    ok: bool
    agreement: float | None


class StoredVerdict(Stored):
    error: float | None
    ok: bool
    method: str
    reasons: list[str]
    reached: float | None = Field(default=None, alias="reached_t")
    original: StoredReplay | None
    rolling: float | None
    leg_rate: float | None
    orthogonality: float | None
    trajectory_deviation: float | None
    warnings: list[str]

    @classmethod
    def written(cls, part: Any) -> dict[str, Any]:
        original = part.original and StoredReplay.written(part.original)
        return {**super().written(part), "original": original}


class StoredCrossing(Stored):
    model_config = ConfigDict(extra="allow")

    which: str
    time: float = Field(alias="t")
    returns: bool
    touches: bool = False  # folders of 0.1 know changes of sign alone

    def crossing(self) -> Crossing:
        known = {name: getattr(self, name) for name in type(self).model_fields}
        return Crossing(**known, state=self.model_extra or {})


class StoredBound(Stored):
    name: str = ""  # worked out again from the problem where a folder is read
    worst: Known
    allowed: Known = nan  # folders of older versions have none
    ok: bool
    time: Known = Field(alias="t")
    component: tuple[int, ...]
    value: Known = nan

    def report(self, bound: Bound) -> BoundReport:
        return BoundReport(bound, **{name: value for name, value in self if name != "name"})


class StoredRecord(Stored):
    """One iteration; the numbers that pictures and reports use."""

    model_config = ConfigDict(extra="allow")

    k: int
    error: float | None = None
    gamma: float | None = None
    __pydantic_extra__: dict[str, JsonValue]


class StoredControl(Stored):
    """What every control has; its basis reads the rest."""

    model_config = ConfigDict(extra="allow")

    basis: str
    horizon: Duration
    __pydantic_extra__: dict[str, JsonValue]


class StoredSolution(Stored):
    schema_version: int
    name: str
    solver: str
    settings: dict[str, JsonValue]
    tolerance: Annotated[float, Field(ge=0)]
    outcome: Outcome
    message: str
    warnings: list[str]
    final_error: Known
    verified: StoredVerdict | None
    objective: str
    effort: float | None
    iterations: list[StoredRecord]
    evaluations: Annotated[int, Field(ge=0)]
    control: StoredControl
    trajectory: dict[str, JsonValue]
    crossings: list[StoredCrossing]
    constraints: dict[str, StoredBound]
    details: dict[str, JsonValue]
    timing: dict[str, float]

    @property
    def costs(self) -> dict[str, float]:
        """What the motion costs, as far as it is known."""
        costs = {name: getattr(self, name) for name in costs_of_motion()}
        return {name: cost for name, cost in costs.items() if cost is not None}

    @field_validator("schema_version")
    @classmethod
    def _readable(cls, version: int) -> int:
        if version != SCHEMA_VERSION:
            raise ValueError(f"version {version}; this nhpocp reads version {SCHEMA_VERSION}")
        return version

    @field_validator("settings")
    @classmethod
    def _gamma_is_a_number(cls, settings: dict[str, Any]) -> dict[str, Any]:
        gamma = settings.get("gamma")
        if gamma is not None and not isinstance(gamma, float | int):
            raise InvalidProblemError(f"expected a number, got {describe(gamma)}", path="gamma")
        return settings

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        """What verification allows is what the solver was asked for."""
        asked = self.settings.get("tolerance")
        if asked != self.tolerance:
            came = f"{self.tolerance:g}, but settings.tolerance is {describe(asked)}"
            raise InvalidProblemError(came, path="tolerance")
        return self


# with every cost that there is; a folder need not know those that came after it
_COSTS: dict[str, Any] = {name: (float | None, None) for name in costs_of_motion() if name != "effort"}
_WITH_COSTS = create_model("StoredSolution", __base__=StoredSolution, **_COSTS)
_EXPECTED = {
    "bool_type": "true or false",
    "dict_type": "a mapping",
    "enum": "an outcome",
    "finite_number": "a finite number",
    "float_type": "a number",
    "greater_than": "a number above 0",
    "greater_than_equal": "a number of at least 0",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_type": "a mapping",
    "string_type": "text",
    "tuple_type": "a list",
}


def parse_stored(text: bytes, file: str) -> StoredSolution:
    """The content of solution.json.

    Errors: `UnreadableSolutionError` with the key that is wrong.
    """
    try:
        return _WITH_COSTS.model_validate_json(text)
    except ValidationError as error:
        detail: Any = error.errors(include_url=False)[0]
    kind, path, context = detail["type"], detail["loc"], detail.get("ctx") or {}
    cause = context.get("error")
    if isinstance(cause, InvalidProblemError):
        path, message = (*path, cause.path), cause.message
    elif kind == "json_invalid":
        message = f"damaged: this is not JSON: {cause}"
    elif kind == "missing":
        message = "required key is missing"
    elif kind == "value_error":
        message = str(cause)
    else:
        message = f"expected {_EXPECTED.get(kind, 'something else')}, got {describe(detail.get('input'))}"
    raise UnreadableSolutionError(message, file=file, path=dotted(path) or None)
