"""The study file as pydantic models: every key, every default."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from nhpocp.declared import LARGEST_COUNT
from nhpocp.errors import InvalidProblemError, describe
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem_file.numbers import AtLeast, Checked, Choice, Count, Number, Whole
from nhpocp.problem_file.schema import Name, Text, Version
from nhpocp.problem_file.states import Strict
from nhpocp.written_numbers import parse_number

SAMPLINGS = ("grid", "random", "latin_hypercube", "sobol")
ORDERS = ("given", "nearest")
SPREADS = ("linspace", "logspace", "range")  # levels at stated places
DISTRIBUTIONS = ("uniform", "loguniform")  # from which samples are drawn

Sampling = Annotated[str, Choice(*SAMPLINGS)]
Two = Annotated[list[Number], Field(min_length=2, max_length=2)]
Three = Annotated[list[Number], Field(min_length=3, max_length=3)]


class SpreadData(Strict):
    """Levels of an axis, given by a rule: exactly one of linspace, logspace, range, uniform, loguniform."""

    linspace: Three | None = Field(default=None, description="[from, to, number of levels], evenly spaced")
    logspace: Three | None = Field(default=None, description="[from, to, number], with a constant ratio")
    range: Three | None = Field(default=None, description="[from, to, step]; the end belongs to it")
    uniform: Two | None = Field(default=None, description="[least, most]: drawn, all equally likely")
    loguniform: Two | None = Field(default=None, description="[least, most]: drawn, the logarithm uniform")
    samples: Count | None = Field(default=None, description="how many are drawn; default: the study's")
    sampling: Sampling | None = Field(default=None, description="how they are drawn; default: the study's")
    seed: Whole | None = Field(default=None, description="of the drawing; default: the study's")

    @model_validator(mode="after")
    def _one_rule(self) -> SpreadData:
        given = [name for name in (*SPREADS, *DISTRIBUTIONS) if getattr(self, name) is not None]
        if len(given) != 1:
            came = " and ".join(given) or "none"
            raise ValueError(f"expected one of {', '.join((*SPREADS, *DISTRIBUTIONS))}, got {came}")
        drawing = [name for name in ("samples", "sampling", "seed") if getattr(self, name) is not None]
        if drawing and given[0] in SPREADS:
            raise ValueError(
                f"{drawing[0]} belongs to {' and '.join(DISTRIBUTIONS)}; {given[0]} has its own number"
            )
        _check_numbers(given[0], getattr(self, given[0]))
        return self


def _check_numbers(rule: str, numbers: Sequence[float]) -> None:
    first, last = numbers[:2]
    if rule in ("linspace", "logspace") and (numbers[2] < 1 or numbers[2] != int(numbers[2])):
        raise ValueError(f"{rule}: {numbers[2]:g} is no number of levels; expected a whole number from 1")
    if rule in ("logspace", "loguniform") and min(first, last) <= 0:
        raise ValueError(f"{rule}: {min(first, last):g} is not positive; expected two positive numbers")
    if rule in DISTRIBUTIONS and not first < last:
        raise ValueError(f"{rule}: {first:g} is not below {last:g}; expected [least, most]")
    if rule == "range" and not (numbers[2] != 0 and (last - first) / numbers[2] >= 0):
        raise ValueError(f"range: steps of {numbers[2]:g} do not lead from {first:g} to {last:g}")
    count = (last - first) / numbers[2] if rule == "range" else 0 if rule in DISTRIBUTIONS else numbers[2]
    if count > LARGEST_COUNT:
        raise ValueError(f"{rule}: {count:g} levels; expected {LARGEST_COUNT} at most")


def _levels(value: Any) -> list[Any]:
    if not isinstance(value, list) or not value:
        came = "an empty list" if value == [] else describe(value)
        raise ValueError(f"expected a list of levels, or a rule such as {{linspace: [0, 1, 5]}}, got {came}")
    levels: list[Any] = value
    return levels


def _axis_kind(value: Any) -> str:
    return "<spread>" if isinstance(value, dict | SpreadData) else "<levels>"


AxisData = Annotated[
    Annotated[list[Any], Checked(_levels, {"type": "array", "minItems": 1}), Tag("<levels>")]
    | Annotated[SpreadData, Tag("<spread>")],
    Discriminator(_axis_kind),
]


def _axes(value: Any) -> Any:
    if not isinstance(value, dict) or not value:
        raise ValueError(
            f"expected a mapping of keys of the problem to their levels, got {describe(value or None)}"
        )
    return value


def _problem(value: Any) -> Any:
    if not isinstance(value, str | dict):
        raise ValueError(
            f"expected the path of a problem file, or the keys of a problem, got {describe(value)}"
        )
    return value


def _solvers(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _range(value: Any) -> list[Any]:
    """Two numbers, the least and the most, or choices as they are written."""
    values = _listed(value)
    try:
        numbers = [parse_number(each) for each in values]
    except ValueError:
        return values
    if len(numbers) == 2 and not numbers[0] < numbers[1]:
        raise ValueError(f"{values[0]} is not below {values[1]}; expected [least, most]")
    return values


def _listed(value: Any) -> list[Any]:
    if not isinstance(value, list) or len(value) < 2:
        came = f"a list of {len(value)}" if isinstance(value, list) else describe(value)
        raise ValueError(f"expected [least, most], or a list of choices, got {came}")
    values: list[Any] = value
    return values


def _over(value: Any) -> Any:
    if not isinstance(value, dict) or not value:
        words = "expected a mapping of keys of the problem to their ranges"
        raise ValueError(f"{words}, such as {{system.base_radius: [20, 40]}}, got {describe(value or None)}")
    return value


def _objectives(value: Any) -> Any:
    return [value] if isinstance(value, str | dict) else value


def _objective(value: Any) -> dict[str, str]:
    """By the direction, the name."""
    given = {"min": value} if isinstance(value, str) else value
    if isinstance(given, dict) and len(given) == 1 and set(given) <= {"min", "max"}:
        (name,) = given.values()
        if isinstance(name, str):
            return {str(direction): name for direction in given}
    raise ValueError(f"expected a name such as effort, or {{max: sigma_w}}, got {describe(value)}")


NAME_SCHEMA = {
    "anyOf": [{"enum": [*OBJECTIVES, "horizon", "clearance", "sigma_s", "sigma_w"]}, {"type": "string"}]
}
SIDE_SCHEMA = {"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": False}
ObjectiveData = Annotated[
    dict[str, str],
    Checked(
        _objective,
        {
            "anyOf": [
                NAME_SCHEMA,
                {**SIDE_SCHEMA, "properties": dict.fromkeys(("min", "max"), NAME_SCHEMA)},
            ]
        },
    ),
]


class OptimiseData(Strict):
    """Which design is best: an optimiser proposes points, and the runs of the axes are made at each."""

    over: Annotated[
        dict[str, Annotated[list[Any], Checked(_range, {"type": "array", "minItems": 2})]],
        BeforeValidator(_over),
    ] = Field(description="by the path of a problem's key: [least, most], or a list of choices")
    objectives: Annotated[list[ObjectiveData], AtLeast(1, "objectives"), BeforeValidator(_objectives)] = (
        Field(description="made least, or {max: NAME} greatest: costs, margins, speeds")
    )
    trials: Count = Field(default=100, description="points that are proposed")
    batch: Count = Field(default=4, description="trials proposed at a time, for about as many workers")
    seed: Whole = Field(default=0, description="of the optimiser")


class StudyData(Strict):
    """A problem, axes along which it varies, and the solvers to run at every design point."""

    name: Name | None = Field(default=None, description="default: the file's stem")
    problem: Annotated[Any, Checked(_problem, {"type": ["string", "object"]})] = Field(
        description="path of a problem file, from this file's folder; or the keys of a problem"
    )
    axes: Annotated[dict[str, AxisData], BeforeValidator(_axes)] = Field(
        default_factory=dict, description="levels by the dotted path of a problem's key: a list, or a rule"
    )
    solvers: Annotated[list[Text], AtLeast(1, "solvers"), BeforeValidator(_solvers)] = Field(
        default_factory=lambda: ["jacobian"], description='such as [jacobian, "nlp:initial=jacobian"]'
    )
    samples: Count = Field(default=16, description="of axes that are drawn")
    sampling: Sampling = Field(
        default="random",
        description="of axes that are drawn: together (random, latin_hypercube, sobol), or each evenly spaced (grid)",
    )
    seed: Whole = Field(default=0, description="of the drawing")
    order: Annotated[str, Choice(*ORDERS)] = Field(
        default="given", description="nearest: goals begin with the plan to their neighbour"
    )
    optimise: OptimiseData | None = Field(
        default=None, description="the best of many designs, each of which is run over the axes"
    )

    @model_validator(mode="after")
    def _complete(self) -> StudyData:
        if not (self.axes or self.optimise):
            raise InvalidProblemError(
                "required key is missing; a study has axes, or something to optimise", path="axes"
            )
        if self.optimise and len(self.solvers) > 1:
            words = (
                f"{len(self.solvers)} solvers; expected one beside optimise, by which designs are compared"
            )
            raise InvalidProblemError(words, path="solvers")
        return self


class StudyFileData(Strict):
    """A study file."""

    nhpocp: Version = Field(description="schema version")
    study: StudyData = Field(description="what to run")
