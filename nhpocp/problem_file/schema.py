"""The problem file as pydantic models: every key, every name that may be a value, every default."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    StrictBool,
    Tag,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from nhpocp.objectives.registry import OBJECTIVES, costs_of_motion
from nhpocp.problem_file.constraints import Constraints, check_constraints
from nhpocp.problem_file.control import BLOCKS, DEFAULT, ControlData
from nhpocp.problem_file.issues import Issue, Refusal
from nhpocp.problem_file.numbers import (
    Checked,
    Choice,
    Number,
    Positive,
    Samples,
    Share,
    Size,
    Whole,
    describe,
    parse_number,
)
from nhpocp.problem_file.settings import Solvers, absent
from nhpocp.problem_file.states import State, StateValue, Strict, check_goal, check_state
from nhpocp.solvers.registry import SOLVERS
from nhpocp.state_space import StateSpace
from nhpocp.systems.system import System

VERSION = 1
SAME_TIME = 1e-6  # share of the horizon, as in `problem`


@dataclass(frozen=True)
class Context:
    """What the rest of the file is checked against."""

    system: System
    outputs: tuple[str, ...] | None  # None: not known before the problem is built

    @property
    def state_space(self) -> StateSpace:
        return self.system.state_space

    @property
    def input_space(self) -> StateSpace:
        return self.system.input_space

    def misfit(self, objective: str, others: Sequence[str]) -> str:
        """What is wrong with an objective for the system, which may have one of the ``others``; empty if nothing."""
        words = OBJECTIVES[objective].lacking(self.system) if objective in OBJECTIVES else ""
        known = [
            name for name in others if name not in OBJECTIVES or not OBJECTIVES[name].lacking(self.system)
        ]
        return f"{words}; expected one of {', '.join(known)}" if words else ""


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


class FreeHorizon(Strict):
    """A duration that the NLP may choose."""

    min: Positive | None = Field(default=None, description="shortest [time]")
    max: Positive | None = Field(default=None, description="longest [time]")
    initial: Positive | None = Field(default=None, description="guess, and what the Jacobian method holds")

    @model_validator(mode="after")
    def _in_order(self) -> FreeHorizon:
        if self.min is None and self.max is None and self.initial is None:
            raise ValueError("empty; expected {min: …, max: …, initial: …} or a number")
        if self.min is not None and self.max is not None and not self.min < self.max:
            raise ValueError(f"min {self.min:g} is not below max {self.max:g}")
        if self.initial is not None and not (self.min or 0) <= self.initial <= (self.max or self.initial):
            raise Refusal([Issue(("initial",), f"{self.initial:g} lies outside min and max")])
        return self


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


def _at_once(times: Sequence[float]) -> Iterator[Issue]:
    """Via poses at the time of an earlier one."""
    earlier: list[float] = []  # in order of time
    for i, time in enumerate(times):
        place = bisect(earlier, time)
        if any(abs(time - other) < SAME_TIME for other in earlier[max(place - 1, 0) : place + 1]):
            yield Issue((i, "at"), f"another via pose is at {time:g} already")
        earlier.insert(place, time)


def _none_is_empty_list(value: Any) -> Any:
    return [] if value is None else value


class ProblemData(Strict):
    """A planning problem: a system, where it starts, where it should end, what to respect and how to solve it."""

    nhpocp: Version = Field(description="schema version")
    name: Name | None = Field(default=None, description="default: the file's stem")
    system: dict[str, Any] = Field(description="the model and its parameters")
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

    @field_validator("start")
    @classmethod
    def _start_fits(cls, value: State, info: ValidationInfo) -> State:
        if info.context and (issues := check_state(info.context.state_space, value)):
            raise Refusal(issues)
        return value

    @field_validator("goal")
    @classmethod
    def _goal_fits(cls, value: State, info: ValidationInfo) -> State:
        if info.context and (issues := check_goal(info.context.system, value)):
            raise Refusal(issues)
        return value

    @field_validator("objective")
    @classmethod
    def _objective_fits(cls, value: str, info: ValidationInfo) -> str:
        if info.context and (words := info.context.misfit(value, list(OBJECTIVES))):
            raise ValueError(words)
        control = info.data.get("control")
        if control and (words := OBJECTIVES[value].lacking_control(control.made())):
            raise ValueError(words)
        return value

    @field_validator("solvers")
    @classmethod
    def _solvers_fit(cls, value: Solvers, info: ValidationInfo) -> Solvers:
        objectives = ["none", *costs_of_motion()]
        if info.context and (words := info.context.misfit(value.jacobian.objective, objectives)):
            raise Refusal([Issue(("jacobian", "objective"), words)])
        return value

    @field_validator("via")
    @classmethod
    def _via_fits(cls, value: list[ViaData], info: ValidationInfo) -> list[ViaData]:
        issues = [
            issue.under((i,))
            for i, via in enumerate(value)
            if info.context
            for issue in check_goal(info.context.system, via.values)
        ]
        issues += _at_once([via.at for via in value])
        if issues:
            raise Refusal(issues)
        return value

    @field_validator("constraints")
    @classmethod
    def _constraints_fit(cls, value: Constraints, info: ValidationInfo) -> Constraints:
        return check_constraints(value, info.context.system, info.context.outputs) if info.context else value
