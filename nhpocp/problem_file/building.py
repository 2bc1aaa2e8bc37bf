"""A validated problem file made into a `PlanningProblem`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from nhpocp.bodies.obstacles import Obstacle
from nhpocp.constraints.leg_acceleration import lacking_derivative
from nhpocp.constraints.registry import bounds_of
from nhpocp.controls.control import Control
from nhpocp.controls.registry import BASES
from nhpocp.errors import InvalidProblemError, MissingDependencyError, refuse
from nhpocp.family import reason
from nhpocp.horizon import Horizon
from nhpocp.objectives.registry import OBJECTIVES, available, costs_of_motion
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.obstacles import plain_obstacles
from nhpocp.problem_file.schema import FreeHorizon, ProblemData
from nhpocp.problem_file.settings import BLOCKS
from nhpocp.problem_file.states import Strict, plain_state
from nhpocp.solvers.registry import SOLVERS, made_solver
from nhpocp.solvers.settings import KERNELS
from nhpocp.systems.system import System
from nhpocp.units import Units
from nhpocp.via import Via

if TYPE_CHECKING:
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.solution import Solver


def assembled(data: ProblemData, system: System, obstacles_read: bool = True) -> PlanningProblem:
    """The problem of a file, without its solvers.

    obstacles_read: whether the file's obstacles are those of the ``data``; without them, distances are left out.
    Errors: `InvalidProblemError` for everything in it that does not fit together, by its path in the file; `others`.
    """
    wrong: list[InvalidProblemError] = []

    def part(make: Callable[[], Any], instead: Any) -> Any:
        try:
            return make()
        except InvalidProblemError as error:
            wrong.extend((error, *error.others))
            return instead

    chosen, costs = data.solvers.jacobian.objective, costs_of_motion()
    known = [objective.name for objective in available(system) if objective.name in costs]
    if chosen not in ("none", *known):
        words = f"{chosen!r} is none of {', '.join(known)}, the objectives of {system.model}; or write none"
        wrong.append(InvalidProblemError(words, path="solvers.jacobian.objective"))
    basis = data.control.made()
    if words := OBJECTIVES[data.objective].lacking_control(basis):
        wrong.append(InvalidProblemError(words, path="objective"))
    obstacles = (
        part(lambda: Obstacle.several(plain_obstacles(data.obstacles)), None) if obstacles_read else None
    )
    limits = data.constraints.given()
    if obstacles is None and system.has_bodies:
        limits.pop("distance", None)
    around = system.among(obstacles) if obstacles and system.has_bodies else system
    problem = part(
        lambda: PlanningProblem(
            system=system,
            start=plain_state(data.start),
            goal=plain_state(data.goal),
            name=data.name or "problem",
            horizon=part(lambda: _horizon(data.horizon), Horizon()),
            basis=basis,
            initial=None if data.control.initial == "auto" else data.control.initial,
            objective=data.objective,
            error_length=data.error_length,
            length_scale=data.length_scale,
            via=[Via(data.via[i].at, plain_state(data.via[i].values)) for i in via_order(data)],
            obstacles=obstacles or (),
            bounds=part(lambda: bounds_of(limits, around), []),
            samples=data.output.samples,
            pictures=data.output.pictures,
            reference=data.reference.model_dump(exclude_none=True),
            units=Units(**data.units.model_dump()),
        ),
        None,
    )
    if problem and (words := lacking_derivative(problem.bounds, basis)):
        wrong.append(InvalidProblemError(words, path="constraints.leg_acceleration", at_key=True))
    refuse(wrong)
    return problem


def via_order(data: ProblemData) -> list[int]:
    """The places of the via poses in the file, in the order of time: that of the problem."""
    return sorted(range(len(data.via)), key=lambda i: data.via[i].at)


def _horizon(given: float | FreeHorizon) -> Horizon:
    if isinstance(given, FreeHorizon):
        return Horizon(initial=given.initial, minimum=given.min, maximum=given.max)
    return Horizon(initial=given)


def control_from_json(data: Mapping[str, Any]) -> Control:
    """The control that a solution file describes.

    Errors: `InvalidProblemError` for a basis that this version does not have, or data that is none.
    """
    from nhpocp.controls.sequence import SequenceBasis

    try:
        kind = data["basis"]
        if kind not in [*BASES, SequenceBasis.kind]:
            raise InvalidProblemError(
                f"unknown basis {kind!r}; {BASES.unknown(str(kind))}", path="control.basis"
            )
        cls = SequenceBasis if kind == SequenceBasis.kind else BASES[kind]
        basis, coefficients = cls.from_json(data)
        return Control(basis, coefficients, float(data["horizon"]))
    except InvalidProblemError:
        raise
    except (LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise InvalidProblemError(f"no control in {type(error).__name__}: {error}", path="control") from None


def build_solvers(data: ProblemData) -> dict[str, Solver]:
    """Every solver, in the order of the registry; those that come later may begin with what an earlier one finds."""
    from nhpocp.provenance import c_compiler, without_compiler

    if data.solvers.compile == "always" and not c_compiler():
        raise MissingDependencyError(
            f"solvers.compile: `always` needs a C compiler, but {without_compiler()}; install one, or write `auto`"
        )
    kernels = KERNELS[data.solvers.compile]()
    solvers: dict[str, Solver] = {}
    for name in SOLVERS:
        try:
            solvers[name] = build_solver(name, getattr(data.solvers, name), solvers, kernels)
        except Exception as error:
            if name in SOLVERS.lines or name in data.solvers.model_fields_set:
                raise
            SOLVERS.complain(SOLVERS.plugins()[name][0], f"fails: {reason(error)}")  # and harms no other
    return solvers


def build_solver(
    name: str,
    data: Strict | Mapping[str, Any] | None = None,
    others: Mapping[str, Solver] | None = None,
    kernels: Kernels | None = None,
) -> Solver:
    """A solver object from its settings: a block of the file, validated or plain data; None: the defaults.

    ``others`` and ``kernels``: as of `SolverSettings.solver`. Errors: `InvalidProblemError` with the key that is wrong.
    """
    if name not in SOLVERS:
        raise InvalidProblemError(f"unknown solver {name!r}; available: {', '.join(SOLVERS)}", path="solvers")
    block = data if isinstance(data, Strict) else _validated(name, BLOCKS[name], data or {})
    return made_solver(name, SOLVERS[name](**block.model_dump()), kernels, others or {})


def _validated(name: str, model: type[Any], data: Any) -> Any:
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise translate(error, model)[0].under(f"solvers.{name}") from None
