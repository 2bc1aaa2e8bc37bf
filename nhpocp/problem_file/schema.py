"""The problem file as pydantic models: every key, every name that may be a value, every default."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, StrictBool, Tag, create_model

from nhpocp.errors import InvalidProblemError, describe
from nhpocp.objectives.registry import OBJECTIVES, costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem_file.constraints import Constraints
from nhpocp.problem_file.control import BLOCKS, DEFAULT, ControlData
from nhpocp.problem_file.numbers import (
    Checked,
    Choice,
    Number,
    Positive,
    Samples,
    Share,
    Size,
    Whole,
)
from nhpocp.problem_file.obstacles import ObstacleData
from nhpocp.problem_file.settings import Solvers, absent
from nhpocp.problem_file.states import State, StateValue, Strict
from nhpocp.solvers.registry import SOLVERS
from nhpocp.units import LONGEST, unit_name
from nhpocp.written_numbers import parse_number

VERSION = 1


def _version(value: Any) -> int:
    number = parse_number(value)
    if number != VERSION:
        raise ValueError(f"schema version {number:g}; this nhpocp reads version {VERSION}")
    return VERSION


def _name(value: Any) -> str:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if not isinstance(text, str):
        raise ValueError(f"expected text, got {describe(value)}; put it in quotes")
    bad = sorted({c for c in text if c in "/\\" or not c.isprintable()})
    if not text.strip() or text in (".", "..") or bad or len(text) > 100:
        # a folder of results is called so
        raise ValueError(f"{describe(text)} cannot name a folder; expected letters, digits, - and _")
    return text


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected text, got {describe(value)}; put it in quotes")
    return value


Version = Annotated[int, Checked(_version, {"const": VERSION})]
Name = Annotated[str, Checked(_name, {"type": ["string", "integer"], "minLength": 1})]
Text = Annotated[str, Checked(_text, {"type": "string"})]


def _unit(value: Any) -> str:
    try:
        return unit_name(value)
    except InvalidProblemError as error:
        raise ValueError(error.message) from None


UnitName = Annotated[str, Checked(_unit, {"type": "string", "minLength": 1, "maxLength": LONGEST})]


class UnitsData(Strict):
    """Words for units, in labels, headers and exports; nothing is converted."""

    length: UnitName | None = Field(default=None, description="such as m or mm")
    time: UnitName | None = Field(default=None, description="such as s")


class FreeHorizon(Strict):
    """A duration that the NLP may choose."""

    min: Positive | None = Field(default=None, description="shortest [time]")
    max: Positive | None = Field(default=None, description="longest [time]")
    initial: Positive | None = Field(default=None, description="guess, and what the Jacobian method holds")


def _horizon_kind(value: Any) -> str:
    return "<range>" if isinstance(value, dict | FreeHorizon) else "<number>"


HorizonData = Annotated[
    Annotated[Positive, Tag("<number>")] | Annotated[FreeHorizon, Tag("<range>")],
    Discriminator(_horizon_kind),
]


class ViaData(Strict):
    """A pose to pass on the way."""

    at: Share = Field(description="share of the horizon")
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, StateValue]

    @property
    def values(self) -> State:
        """The state's blocks and the outputs given here."""
        return dict(self.__pydantic_extra__ or {})


class Output(Strict):
    """What a solution folder holds."""

    samples: Samples = Field(default=201, description="samples of the trajectory")
    pictures: StrictBool = Field(default=True, description="draw the pictures")


_COSTS: dict[str, Any] = {
    name: (Number | None, Field(default=None, description=OBJECTIVES[name].meaning))
    for name in costs_of_motion()
}


class ReferenceValues(Strict):
    """What one solver is known to find."""

    outcome: Annotated[str, Choice(*(outcome.value for outcome in Outcome))] | None = Field(
        default=None, description="how it ends, where not as converged"
    )
    horizon: Number | None = Field(default=None, description="duration, where it is free")
    iterations: Whole | None = Field(default=None, description="updates")
    evaluations: Whole | None = Field(default=None, description="evaluated controls")
    tolerance: Positive | None = Field(default=None, description="relative, for this solver alone")


_VALUES = create_model("ReferenceValues", __base__=ReferenceValues, __doc__=ReferenceValues.__doc__, **_COSTS)
_OF_SOLVERS: dict[str, Any] = {
    name: (_VALUES | None, Field(default=None, description=f"of {settings.meaning}"))
    for name, settings in SOLVERS.items()
}


class Reference(Strict):
    """Known results, read by tests and benchmarks."""

    tolerance: Positive | None = Field(default=None, description="relative")
    source: Text | None = Field(default=None, description="where the numbers come from")


if not TYPE_CHECKING:
    Reference = create_model("Reference", __base__=Reference, __doc__=Reference.__doc__, **_OF_SOLVERS)


def _none_is_empty_list(value: Any) -> Any:
    return [] if value is None else value


class ProblemData(Strict):
    """A planning problem: a system, where it starts, where it should end, what to respect and how to solve it."""

    nhpocp: Version = Field(description="schema version")
    name: Name | None = Field(default=None, description="default: the file's stem")
    system: dict[str, Any] = Field(description="the model and its parameters")
    units: Annotated[UnitsData, BeforeValidator(absent)] = Field(
        default_factory=lambda: UnitsData(), description="words for labels and headers; nothing is converted"
    )
    start: State = Field(description="a value for every block of the state")
    goal: State = Field(
        description="a value for every block that matters, or for an output of the pose; what is left out is free"
    )
    horizon: HorizonData = Field(
        default=1.0, description="the duration T, or {min, max, initial} where the NLP may choose"
    )
    control: ControlData = Field(
        default_factory=lambda: BLOCKS[DEFAULT](basis=DEFAULT),
        description="basis of the control, and the control to begin with",
    )
    objective: Annotated[str, Choice(*OBJECTIVES)] = Field(
        default="effort",
        description=", ".join(f"{name} {cost.formula}".rstrip() for name, cost in OBJECTIVES.items()),
    )
    error_length: Size = Field(default=1.0, description="length that counts as much as one radian in E")
    length_scale: Size | None = Field(
        default=None,
        description="divides the rotation columns of S and W; default: the mechanism's own length, else error_length",
    )
    via: Annotated[list[ViaData], BeforeValidator(_none_is_empty_list)] = Field(
        default_factory=list, description="poses to pass on the way"
    )
    obstacles: Annotated[list[ObstacleData], BeforeValidator(_none_is_empty_list)] = Field(
        default_factory=list, description="what stands around the system, for `constraints.distance`"
    )
    constraints: Annotated[Constraints, BeforeValidator(absent)] = Field(
        default_factory=lambda: Constraints(),
        description="what the plan must respect; honoured by both solvers",
    )
    solvers: Annotated[Solvers, BeforeValidator(absent)] = Field(
        default_factory=lambda: Solvers(), description="settings of the solvers"
    )
    output: Annotated[Output, BeforeValidator(absent)] = Field(
        default_factory=lambda: Output(), description="what a solution folder holds"
    )
    reference: Annotated[Reference, BeforeValidator(absent)] = Field(
        default_factory=lambda: Reference(), description="known results, read by tests and benchmarks"
    )
