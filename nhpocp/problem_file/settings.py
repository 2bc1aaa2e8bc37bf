"""The `solvers` block: settings of both methods, as names and numbers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from nhpocp.objectives.registry import costs_of_motion
from nhpocp.problem_file.numbers import AutoOrCount, Choice, Count, Positive, Whole
from nhpocp.problem_file.states import Strict


def absent(value: Any) -> Any:
    """A block whose lines are all commented out reads as nothing: the same as left out."""
    return {} if value is None else value


class JacobianSettings(Strict):
    """The Jacobian method: continuation by [Paper] eqs. (16)-(17)."""

    step_rule: Literal["euler", "adaptive", "ode", "auto"] = Field(
        default="euler", description="how far a step goes"
    )
    gamma: Positive = Field(
        default=0.1, description="γ of (17), the share of the error that a step should remove"
    )
    inverse: Literal["moore_penrose", "damped", "transpose", "lagrangian"] = Field(
        default="moore_penrose",
        description="how the end point's Jacobian is inverted; lagrangian brings a metric of its own",
    )
    metric: Literal["coefficients", "l2"] = Field(
        default="coefficients",
        description="size of a control: of its coefficients (the paper's), or ∫|control|²",
    )
    tolerance: Positive = Field(default=1e-3, description="the error E at which to stop")
    max_iterations: Whole = Field(default=500, description="updates before giving up, in each try")
    integrator: Literal["rk4", "rk", "cvodes"] = Field(
        default="rk4", description="own RK4, or one of CasADi's"
    )
    steps: Count = Field(default=100, description="integration steps over the horizon")
    sensitivity: Literal["automatic", "variational"] = Field(
        default="automatic",
        description="the end point's Jacobian: by differentiating the integrator, or by (11)-(12)",
    )
    objective: Annotated[str, Choice("none", *costs_of_motion())] = Field(
        default="none", description="what the null-space phase minimises"
    )
    starts: Count = Field(default=1, description="tries: the file's control, then seeded ones")
    seed: Whole = Field(default=0, description="of everything random")


class NlpSettings(Strict):
    """The optimal-control method: multiple shooting."""

    control: Literal["piecewise_constant", "basis"] = Field(
        default="piecewise_constant", description="basis: the one of the block `control`"
    )
    intervals: Count = Field(default=50, description="shooting intervals")
    steps_per_interval: AutoOrCount = Field(default="auto", description="integration steps per interval")
    shooting: Literal["multiple", "single"] = Field(default="multiple", description="transcription")
    plugin: Literal["ipopt", "fatrop"] = Field(default="ipopt", description="the NLP solver")
    initial: Literal["problem", "jacobian", "straight"] = Field(
        default="problem",
        description="guess: control.initial, the Jacobian method's solution, or a straight line",
    )
    tolerance: Positive = Field(default=1e-6, description="the NLP solver's")
    max_iterations: Whole = Field(default=1000, description="the NLP solver's")
    starts: Count = Field(default=1, description="tries: the file's guess, then seeded ones")
    seed: Whole = Field(default=0, description="of everything random")
    mesh_check: bool = Field(
        default=False, description="solve again with twice the intervals and say what it changes"
    )


class Solvers(Strict):
    """Settings of both methods."""

    jacobian: Annotated[JacobianSettings, BeforeValidator(absent)] = Field(
        default_factory=lambda: JacobianSettings(), description="the Jacobian method"
    )
    nlp: Annotated[NlpSettings, BeforeValidator(absent)] = Field(
        default_factory=lambda: NlpSettings(), description="multiple shooting"
    )
    compile: Literal["auto", "always", "never"] = Field(
        default="auto", description="whether to compile the integrator with the system's C compiler"
    )
