"""A validated problem file made into a `PlanningProblem`: here, and only here, names become objects.

`AVAILABLE` lists what each name of the file can be built from; a name that the file may use and that is not listed is
answered with what is.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping, Sequence
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
from nhpocp.problem_file.settings import JacobianSettings, NlpSettings
from nhpocp.problem_file.states import plain_state
from nhpocp.provenance import c_compiler, without_compiler

if TYPE_CHECKING:
    from nhpocp.controls.basis import ControlBasis
    from nhpocp.controls.control import Control
    from nhpocp.problem import PlanningProblem

# key -> name in the file -> "module:Class"
AVAILABLE: dict[str, dict[str, str]] = {
    "solvers.jacobian.step_rule": {
        "euler": "nhpocp.solvers.continuation.step_rules:Euler",
        "adaptive": "nhpocp.solvers.continuation.step_rules:Adaptive",
        "ode": "nhpocp.solvers.continuation.step_rules:Ode",
        "auto": "nhpocp.solvers.continuation.step_rules:Adaptive",
    },
    "solvers.jacobian.inverse": {
        "moore_penrose": "nhpocp.solvers.continuation.generalized_inverses:MoorePenrose",
        "damped": "nhpocp.solvers.continuation.generalized_inverses:Damped",
        "transpose": "nhpocp.solvers.continuation.generalized_inverses:Transpose",
        "lagrangian": "nhpocp.solvers.continuation.generalized_inverses:Lagrangian",
    },
    "solvers.jacobian.metric": {
        "coefficients": "nhpocp.solvers.metrics:CoefficientMetric",
        "l2": "nhpocp.solvers.metrics:L2Metric",
    },
    "solvers.jacobian.integrator": {
        "rk4": "nhpocp.flow.integrators:RungeKutta4",
        "rk": "nhpocp.flow.integrators:CasadiRungeKutta",
        "cvodes": "nhpocp.flow.integrators:Cvodes",
    },
    "solvers.jacobian.sensitivity": {
        "automatic": "nhpocp.flow.end_point_map:DifferentiatedEndPointMap",
        "variational": "nhpocp.flow.end_point_map:VariationalEndPointMap",
    },
    "solvers.compile": {
        "auto": "nhpocp.flow.compiled.kernels:CompiledWhenReady",
        "always": "nhpocp.flow.compiled.kernels:Compiled",
        "never": "nhpocp.flow.compiled.kernels:Interpreted",
    },
    "solvers.nlp.shooting": {
        "multiple": "nhpocp.solvers.nlp.transcription:Transcription",
        "single": "nhpocp.solvers.nlp.single_shooting:SingleShooting",
    },
    "solvers.nlp.plugin": {
        "ipopt": "nhpocp.solvers.nlp.optimizers:Ipopt",
        "fatrop": "nhpocp.solvers.nlp.optimizers:Fatrop",
    },
    "solvers.nlp.initial": {
        "problem": "nhpocp.solvers.nlp.guesses:ProblemGuess",
        "jacobian": "nhpocp.solvers.nlp.guesses:SolverGuess",
        "straight": "nhpocp.solvers.nlp.guesses:StraightGuess",
    },
}


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


def _available(key: str, name: str) -> Callable[..., Any]:
    """The class behind a name of the file."""
    known = AVAILABLE[key]
    if name not in known:
        raise InvalidProblemError(_not_available(key, name, list(known)), path=key)
    module, _, attribute = known[name].partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), attribute)
    return found


def _not_available(key: str, value: Any, known: Sequence[Any]) -> str:
    setting = key.rpartition(".")[2]
    return f"{setting} {value!r} is not available in this version; available: {', '.join(map(str, known))}"


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


def _build_solvers(data: ProblemData) -> dict[str, Any]:
    """Both solvers; the NLP's `initial: jacobian` is the file's own Jacobian method."""
    if data.solvers.compile == "always" and not c_compiler():
        raise MissingDependencyError(
            f"solvers.compile: `always` needs a C compiler, but {without_compiler()}; install one, or write `auto`"
        )
    kernels = _available("solvers.compile", data.solvers.compile)()
    jacobian = build_solver("jacobian", data.solvers.jacobian, kernels=kernels)
    return {"jacobian": jacobian, "nlp": build_solver("nlp", data.solvers.nlp, jacobian, kernels)}


def build_solver(
    name: str,
    data: JacobianSettings | NlpSettings | Mapping[str, Any] | None = None,
    jacobian: Any = None,
    kernels: Any = None,
) -> Any:
    """A solver object from its settings: a block of the file, validated or plain data; None: the defaults.

    ``jacobian``: the solver whose solution `initial: jacobian` of the NLP starts from. ``kernels``: how the Jacobian
    method's own integrator evaluates its sweeps, and the NLP its intervals; None: by their default.
    """
    if name not in _BUILDERS:
        raise InvalidProblemError(_not_available("solver", name, list(_BUILDERS)), path="solvers")
    model, builder = _BUILDERS[name]
    settings = data if isinstance(data, model) else _validated(name, model, data or {})
    return builder(settings, jacobian, kernels)


def _validated(name: str, model: type[Any], data: Any) -> Any:
    from pydantic import ValidationError

    from nhpocp.problem_file.issues import dotted
    from nhpocp.problem_file.messages import translate

    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        issue = translate(error, model)[0].under(("solvers", name))
        raise InvalidProblemError(issue.words, path=dotted(issue.path)) from None


def _build_jacobian(data: JacobianSettings, _: Any, kernels: Any) -> Any:
    from nhpocp.solvers.continuation.continuation import Continuation

    integrator = _available("solvers.jacobian.integrator", data.integrator)
    chosen = {"kernels": kernels} if kernels is not None and data.integrator == "rk4" else {}
    rule = _available("solvers.jacobian.step_rule", data.step_rule)
    solver = Continuation(
        step_rule=rule() if data.step_rule in ("adaptive", "auto") else rule(gamma=data.gamma),
        inverse=_available("solvers.jacobian.inverse", data.inverse)(),
        metric=_available("solvers.jacobian.metric", data.metric)(),
        integrator=integrator(steps=data.steps, **chosen),
        sensitivity=_available("solvers.jacobian.sensitivity", data.sensitivity),
        tolerance=data.tolerance,
        max_iterations=data.max_iterations,
        objective=data.objective,
        seed=data.seed,
    )
    if data.step_rule == "auto":
        from nhpocp.solvers.continuation.auto import Auto

        return Auto(solver, restarts=max(Auto.restarts, data.starts - 1))
    if data.starts > 1:
        from nhpocp.solvers.continuation.multi_start import MultiStart

        return MultiStart(solver, data.starts)
    return solver


def _build_nlp(data: NlpSettings, jacobian: Any, kernels: Any) -> Any:
    from nhpocp.solvers.nlp.guesses import SolverGuess
    from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

    if data.plugin == "fatrop" and data.shooting == "single":
        raise InvalidProblemError("fatrop needs the stages of multiple shooting", path="solvers.nlp.plugin")
    maker = _available("solvers.nlp.initial", data.initial)
    transcription: Any = _available("solvers.nlp.shooting", data.shooting)
    return MultipleShooting(
        intervals=data.intervals,
        steps_per_interval=data.steps_per_interval if isinstance(data.steps_per_interval, int) else None,
        over_basis=data.control == "basis",
        transcription=transcription,
        optimizer=_available("solvers.nlp.plugin", data.plugin)(
            tolerance=data.tolerance, max_iterations=data.max_iterations
        ),
        guess=SolverGuess(jacobian or build_solver("jacobian")) if maker is SolverGuess else maker(),
        starts=data.starts,
        seed=data.seed,
        mesh_check=data.mesh_check,
        **({} if kernels is None else {"kernels": kernels}),
    )


_BUILDERS: dict[str, tuple[type[Any], Callable[[Any, Any, Any], Any]]] = {
    "jacobian": (JacobianSettings, _build_jacobian),
    "nlp": (NlpSettings, _build_nlp),
}
