"""A validated problem file made into a `PlanningProblem`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from nhpocp.constraints.registry import bounds_of
from nhpocp.controls.registry import BASES
from nhpocp.errors import InvalidProblemError, MissingDependencyError
from nhpocp.problem_file.control import ControlBlock
from nhpocp.problem_file.issues import suggestion
from nhpocp.problem_file.plugins import words
from nhpocp.problem_file.reading import ProblemFile, read, read_text
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.problem_file.schema import FreeHorizon, ProblemData
from nhpocp.problem_file.settings import BLOCKS
from nhpocp.problem_file.states import Strict, plain_state
from nhpocp.provenance import c_compiler, without_compiler
from nhpocp.solvers.registry import SOLVERS
from nhpocp.solvers.settings import KERNELS

if TYPE_CHECKING:
    from nhpocp.controls.basis import ControlBasis
    from nhpocp.controls.control import Control
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.problem import PlanningProblem
    from nhpocp.solution import Solver


def load_problem(path: str | FilePath, overrides: Sequence[str] = ()) -> PlanningProblem:
    """The problem that a file describes.

    Errors: `InvalidProblemError` with file, line and column.
    """
    return build(read(path, overrides))


def parse_problem(text: str, file: str | None = None, overrides: Sequence[str] = ()) -> PlanningProblem:
    """The same from a text."""
    return build(read_text(text, file, overrides))


def build(file: ProblemFile) -> PlanningProblem:
    """The problem of a validated file."""
    from nhpocp.problem import Horizon, PlanningProblem, Via

    data, system = file.data, file.system
    horizon = data.horizon
    try:
        problem = PlanningProblem(
            system=system,
            start=plain_state(data.start),
            goal=plain_state(data.goal),
            name=data.name or "problem",
            horizon=(
                Horizon(initial=horizon.initial, minimum=horizon.min, maximum=horizon.max)
                if isinstance(horizon, FreeHorizon)
                else Horizon(initial=horizon)
            ),
            basis=build_basis(data.control),
            initial=None if data.control.initial == "auto" else data.control.initial,
            objective=data.objective,
            error_length=data.error_length,
            length_scale=data.length_scale,
            via=[Via(via.at, plain_state(via.values)) for via in data.via],
            bounds=bounds_of(data.constraints.given(), system),
            solvers=_build_solvers(data),
            samples=data.output.samples,
            pictures=data.output.pictures,
            reference=data.reference.model_dump(exclude_none=True),
            source=file.text,
        )
        if system.model not in SYSTEMS:
            _try_out(problem)
    except InvalidProblemError as error:
        raise file.located(error) from None
    return problem


def _try_out(problem: PlanningProblem) -> None:
    """Asks a system from elsewhere for its velocity, in numbers and in symbols, before any solver does."""
    import numpy as np

    from nhpocp.systems.numeric import numeric_system

    system, point, control = problem.system, problem.start_point, np.ones(problem.system.input_space.size)
    try:
        velocity = np.asarray(system.velocity(point, control), dtype=float)
        rate = np.array(numeric_system(system).rate_function(point, control)).ravel()
        shape = velocity.shape
        agree = shape == (system.state_space.dimension,) and np.allclose(
            rate, np.asarray(system.state_space.lift(point, velocity)), equal_nan=True
        )
    except Exception as error:
        fault = f"the equations of {system.model} fail at the start: {words(error)}"
        raise InvalidProblemError(fault, path="system.model") from error
    if not agree:  # float() of a CasADi symbol is NaN and no error
        fault = (
            f"the velocity of {system.model} at the start is {velocity} in NumPy's numbers, but CasADi's expressions "
            f"give the rate {rate}; expected the same, {system.state_space.dimension} numbers of velocity"
        )
        raise InvalidProblemError(fault, path="system.model")


def build_basis(data: ControlBlock) -> ControlBasis:
    """The basis of a `control` block."""
    return data.made()


def control_from_json(data: Mapping[str, Any]) -> Control:
    """The control that a solution file describes.

    Errors: `InvalidProblemError` for a basis that this version does not have, or data that is none.
    """
    from nhpocp.controls.control import Control
    from nhpocp.controls.sequence import SequenceBasis

    try:
        kind = data["basis"]
        if kind not in (known := [*BASES, SequenceBasis.kind]):
            raise InvalidProblemError(
                f"unknown basis {kind!r}; {suggestion(str(kind), known)}", path="control.basis"
            )
        cls = SequenceBasis if kind == SequenceBasis.kind else BASES[kind]
        basis, coefficients = cls.from_json(data)
        return Control(basis, coefficients, float(data["horizon"]))
    except (LookupError, TypeError) as error:
        raise InvalidProblemError(f"no control in {type(error).__name__}: {error}", path="control") from None


def _build_solvers(data: ProblemData) -> dict[str, Solver]:
    """Every solver, in the order of the registry; those that come later may begin with what an earlier one finds."""
    if data.solvers.compile == "always" and not c_compiler():
        raise MissingDependencyError(
            f"solvers.compile: `always` needs a C compiler, but {without_compiler()}; install one, or write `auto`"
        )
    kernels = KERNELS[data.solvers.compile]()
    solvers: dict[str, Solver] = {}
    for name in SOLVERS:
        solvers[name] = build_solver(name, getattr(data.solvers, name), solvers, kernels)
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
    return SOLVERS[name](**block.model_dump()).solver(kernels, others or {})


def _validated(name: str, model: type[Any], data: Any) -> Any:
    from pydantic import ValidationError

    from nhpocp.problem_file.issues import dotted
    from nhpocp.problem_file.messages import translate

    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        issue = translate(error, model)[0].under(("solvers", name))
        raise InvalidProblemError(issue.words, path=dotted(issue.path)) from None
