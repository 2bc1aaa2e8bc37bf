"""nhpocp: motion planning for parallel robots with non-holonomic joints. Public names load when first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nhpocp.analysis import Analysis as Analysis
    from nhpocp.analysis import analyze as analyze
    from nhpocp.arrays import namespace as namespace
    from nhpocp.batch import Plan as Plan
    from nhpocp.batch import plan_many as plan_many
    from nhpocp.comparison import Comparison as Comparison
    from nhpocp.comparison import Run as Run
    from nhpocp.comparison import compare as compare
    from nhpocp.controls.bspline import BSpline as BSpline
    from nhpocp.controls.control import Control as Control
    from nhpocp.controls.fourier import Fourier as Fourier
    from nhpocp.controls.legendre import Legendre as Legendre
    from nhpocp.controls.piecewise_constant import PiecewiseConstant as PiecewiseConstant
    from nhpocp.errors import FrozenError as FrozenError
    from nhpocp.errors import InvalidProblemError as InvalidProblemError
    from nhpocp.errors import NhpocpError as NhpocpError
    from nhpocp.flow.integrators import CasadiRungeKutta as CasadiRungeKutta
    from nhpocp.flow.integrators import Cvodes as Cvodes
    from nhpocp.flow.integrators import RungeKutta4 as RungeKutta4
    from nhpocp.frozen import replace as replace
    from nhpocp.outcome import Outcome as Outcome
    from nhpocp.planning import solve as solve
    from nhpocp.problem import Horizon as Horizon
    from nhpocp.problem import PlanningProblem as PlanningProblem
    from nhpocp.problem_file import load_problem as load_problem
    from nhpocp.solution import Solution as Solution
    from nhpocp.solution import Verdict as Verdict
    from nhpocp.solution_folder import load_solution as load_solution
    from nhpocp.solution_folder import save_solution as save_solution
    from nhpocp.solvers.continuation.continuation import Continuation as Continuation
    from nhpocp.solvers.continuation.generalized_inverses import MoorePenrose as MoorePenrose
    from nhpocp.solvers.continuation.step_rules import Adaptive as Adaptive
    from nhpocp.solvers.continuation.step_rules import Euler as Euler
    from nhpocp.solvers.continuation.step_rules import Ode as Ode
    from nhpocp.solvers.metrics import CoefficientMetric as CoefficientMetric
    from nhpocp.solvers.metrics import L2Metric as L2Metric
    from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting as MultipleShooting
    from nhpocp.state_space import StateSpace as StateSpace
    from nhpocp.state_space import direction as direction
    from nhpocp.state_space import rotation as rotation
    from nhpocp.state_space import scalar as scalar
    from nhpocp.state_space import vector as vector
    from nhpocp.systems.legs import Leg as Leg
    from nhpocp.systems.mobility import mobility as mobility
    from nhpocp.systems.parallel_robot import ParallelRobot as ParallelRobot
    from nhpocp.systems.system import Parameter as Parameter
    from nhpocp.systems.system import System as System
    from nhpocp.systems.three_upu import ThreeUPU as ThreeUPU
    from nhpocp.verification import verify as verify
    from nhpocp.views.animation import write_animation as write_animation
    from nhpocp.views.report import write_report as write_report

__version__ = "0.1.0"

_HOMES = {
    "Adaptive": "solvers.continuation.step_rules",
    "BSpline": "controls.bspline",
    "Analysis": "analysis",
    "CasadiRungeKutta": "flow.integrators",
    "CoefficientMetric": "solvers.metrics",
    "Comparison": "comparison",
    "Continuation": "solvers.continuation.continuation",
    "Control": "controls.control",
    "Cvodes": "flow.integrators",
    "Euler": "solvers.continuation.step_rules",
    "Fourier": "controls.fourier",
    "FrozenError": "errors",
    "Horizon": "problem",
    "InvalidProblemError": "errors",
    "L2Metric": "solvers.metrics",
    "Leg": "systems.legs",
    "Legendre": "controls.legendre",
    "MoorePenrose": "solvers.continuation.generalized_inverses",
    "MultipleShooting": "solvers.nlp.multiple_shooting",
    "NhpocpError": "errors",
    "Ode": "solvers.continuation.step_rules",
    "Outcome": "outcome",
    "ParallelRobot": "systems.parallel_robot",
    "Parameter": "systems.system",
    "PiecewiseConstant": "controls.piecewise_constant",
    "Plan": "batch",
    "PlanningProblem": "problem",
    "Run": "comparison",
    "RungeKutta4": "flow.integrators",
    "Solution": "solution",
    "StateSpace": "state_space",
    "System": "systems.system",
    "ThreeUPU": "systems.three_upu",
    "Verdict": "solution",
    "analyze": "analysis",
    "compare": "comparison",
    "direction": "state_space",
    "load_problem": "problem_file",
    "load_solution": "solution_folder",
    "mobility": "systems.mobility",
    "namespace": "arrays",
    "plan_many": "batch",
    "replace": "frozen",
    "rotation": "state_space",
    "save_solution": "solution_folder",
    "scalar": "state_space",
    "solve": "planning",
    "vector": "state_space",
    "verify": "verification",
    "write_animation": "views.animation",
    "write_report": "views.report",
}
__all__ = ["__version__", *_HOMES]


if not TYPE_CHECKING:  # who checks types reads the list above, in which a misspelt name is an error

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module 'nhpocp' has no attribute {name!r}")
        value = getattr(import_module(f"nhpocp.{_HOMES[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
