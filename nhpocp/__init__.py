"""nhpocp: motion planning for parallel robots with non-holonomic joints. Public names load when first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nhpocp.analysis import Analysis as Analysis
    from nhpocp.api import analyze as analyze
    from nhpocp.api import calibrate as calibrate
    from nhpocp.api import compare as compare
    from nhpocp.api import load_problem as load_problem
    from nhpocp.api import load_solution as load_solution
    from nhpocp.api import plan_many as plan_many
    from nhpocp.api import save_solution as save_solution
    from nhpocp.api import simulate as simulate
    from nhpocp.api import solve as solve
    from nhpocp.api import steer as steer
    from nhpocp.api import sweep as sweep
    from nhpocp.api import verify as verify
    from nhpocp.api import write_animation as write_animation
    from nhpocp.api import write_report as write_report
    from nhpocp.arrays import namespace as namespace
    from nhpocp.batch import Plan as Plan
    from nhpocp.bodies.obstacles import Obstacle as Obstacle
    from nhpocp.comparison import Comparison as Comparison
    from nhpocp.comparison import Entry as Entry
    from nhpocp.comparison import Run as Run
    from nhpocp.constraints.bound import Bound as Bound
    from nhpocp.constraints.kind import ConstraintKind as ConstraintKind
    from nhpocp.controls.basis import ControlBasis as ControlBasis
    from nhpocp.controls.bspline import BSpline as BSpline
    from nhpocp.controls.chebyshev import Chebyshev as Chebyshev
    from nhpocp.controls.control import Control as Control
    from nhpocp.controls.fourier import Fourier as Fourier
    from nhpocp.controls.legendre import Legendre as Legendre
    from nhpocp.controls.piecewise_constant import PiecewiseConstant as PiecewiseConstant
    from nhpocp.controls.sequence import SequenceBasis as SequenceBasis
    from nhpocp.errors import FrozenError as FrozenError
    from nhpocp.errors import InvalidProblemError as InvalidProblemError
    from nhpocp.errors import MissingDependencyError as MissingDependencyError
    from nhpocp.errors import NhpocpError as NhpocpError
    from nhpocp.errors import NhpocpWarning as NhpocpWarning
    from nhpocp.errors import OrientationAtPiError as OrientationAtPiError
    from nhpocp.errors import TooLargeError as TooLargeError
    from nhpocp.errors import UnknownNameError as UnknownNameError
    from nhpocp.errors import UnreadableSolutionError as UnreadableSolutionError
    from nhpocp.flow.compiled.kernels import Compiled as Compiled
    from nhpocp.flow.compiled.kernels import CompiledWhenReady as CompiledWhenReady
    from nhpocp.flow.compiled.kernels import Interpreted as Interpreted
    from nhpocp.flow.end_point_map import DifferentiatedEndPointMap as DifferentiatedEndPointMap
    from nhpocp.flow.end_point_map import VariationalEndPointMap as VariationalEndPointMap
    from nhpocp.flow.integrators import CasadiRungeKutta as CasadiRungeKutta
    from nhpocp.flow.integrators import Cvodes as Cvodes
    from nhpocp.flow.integrators import RungeKutta4 as RungeKutta4
    from nhpocp.flow.simulation import Motion as Motion
    from nhpocp.frozen import replace as replace
    from nhpocp.horizon import Horizon as Horizon
    from nhpocp.machine.calibration.calibration import Calibration as Calibration
    from nhpocp.machine.feedback.plant import Plant as Plant
    from nhpocp.machine.feedback.simulated_plant import SimulatedPlant as SimulatedPlant
    from nhpocp.machine.feedback.steering import Steered as Steered
    from nhpocp.objectives.objective import ControlObjective as ControlObjective
    from nhpocp.objectives.objective import PathObjective as PathObjective
    from nhpocp.outcome import Outcome as Outcome
    from nhpocp.problem import PlanningProblem as PlanningProblem
    from nhpocp.problem_file import dump_problem as dump_problem
    from nhpocp.solution import Solution as Solution
    from nhpocp.solution import Solver as Solver
    from nhpocp.solution import Verdict as Verdict
    from nhpocp.solvers.continuation.auto import Auto as Auto
    from nhpocp.solvers.continuation.continuation import Continuation as Continuation
    from nhpocp.solvers.continuation.generalized_inverses import Damped as Damped
    from nhpocp.solvers.continuation.generalized_inverses import GeneralizedInverse as GeneralizedInverse
    from nhpocp.solvers.continuation.generalized_inverses import Lagrangian as Lagrangian
    from nhpocp.solvers.continuation.generalized_inverses import MoorePenrose as MoorePenrose
    from nhpocp.solvers.continuation.generalized_inverses import Transpose as Transpose
    from nhpocp.solvers.continuation.multi_start import MultiStart as MultiStart
    from nhpocp.solvers.continuation.step_rules import Adaptive as Adaptive
    from nhpocp.solvers.continuation.step_rules import Euler as Euler
    from nhpocp.solvers.continuation.step_rules import Ode as Ode
    from nhpocp.solvers.continuation.step_rules import StepRule as StepRule
    from nhpocp.solvers.continuation.step_rules import full_step as full_step
    from nhpocp.solvers.least_squares import LeastSquares as LeastSquares
    from nhpocp.solvers.least_squares import LeastSquaresSettings as LeastSquaresSettings
    from nhpocp.solvers.metrics import CoefficientMetric as CoefficientMetric
    from nhpocp.solvers.metrics import L2Metric as L2Metric
    from nhpocp.solvers.nlp.fatrop import Fatrop as Fatrop
    from nhpocp.solvers.nlp.guesses import ProblemGuess as ProblemGuess
    from nhpocp.solvers.nlp.guesses import SolverGuess as SolverGuess
    from nhpocp.solvers.nlp.guesses import StraightGuess as StraightGuess
    from nhpocp.solvers.nlp.ipopt import Ipopt as Ipopt
    from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting as MultipleShooting
    from nhpocp.solvers.nlp.single_shooting import SingleShooting as SingleShooting
    from nhpocp.solvers.nlp.staged_transcription import StagedTranscription as StagedTranscription
    from nhpocp.solvers.settings import SolverSettings as SolverSettings
    from nhpocp.solvers.sinusoids import Sinusoids as Sinusoids
    from nhpocp.solvers.sinusoids import SinusoidsSettings as SinusoidsSettings
    from nhpocp.state_space import Block as Block
    from nhpocp.state_space import StateSpace as StateSpace
    from nhpocp.state_space import deg as deg
    from nhpocp.state_space import direction as direction
    from nhpocp.state_space import matrix as matrix
    from nhpocp.state_space import rotation as rotation
    from nhpocp.state_space import scalar as scalar
    from nhpocp.state_space import vector as vector
    from nhpocp.systems.car import Car as Car
    from nhpocp.systems.car_with_trailers import CarWithTrailers as CarWithTrailers
    from nhpocp.systems.cartan import Cartan as Cartan
    from nhpocp.systems.cartan import Engel as Engel
    from nhpocp.systems.chained import Chained as Chained
    from nhpocp.systems.chained_form import ChainedForm as ChainedForm
    from nhpocp.systems.double_integrator import DoubleIntegrator as DoubleIntegrator
    from nhpocp.systems.free_nilpotent_36 import FreeNilpotent36 as FreeNilpotent36
    from nhpocp.systems.friction_drive_wrist import FrictionDriveWrist as FrictionDriveWrist
    from nhpocp.systems.heisenberg import Heisenberg as Heisenberg
    from nhpocp.systems.legs import Leg as Leg
    from nhpocp.systems.mobile_manipulator import MobileManipulator as MobileManipulator
    from nhpocp.systems.mobility import mobility as mobility
    from nhpocp.systems.nonholonomic_manipulator import NonholonomicManipulator as NonholonomicManipulator
    from nhpocp.systems.orienting_platform import OrientingPlatform as OrientingPlatform
    from nhpocp.systems.parallel_robot import ParallelRobot as ParallelRobot
    from nhpocp.systems.passive_sphere import PassiveSphere as PassiveSphere
    from nhpocp.systems.rigid_body import RigidBody as RigidBody
    from nhpocp.systems.rolling_sphere import RollingSphere as RollingSphere
    from nhpocp.systems.sphere_on_sphere import SphereOnSphere as SphereOnSphere
    from nhpocp.systems.suslov_joint import SuslovJoint as SuslovJoint
    from nhpocp.systems.system import Parameter as Parameter
    from nhpocp.systems.system import System as System
    from nhpocp.systems.three_upu import ThreeUPU as ThreeUPU
    from nhpocp.systems.trident_snake import TridentSnake as TridentSnake
    from nhpocp.systems.truck_with_trailers import TruckWithTrailers as TruckWithTrailers
    from nhpocp.systems.unicycle import Unicycle as Unicycle
    from nhpocp.systems.veselova_joint import VeselovaJoint as VeselovaJoint
    from nhpocp.units import Units as Units
    from nhpocp.via import Via as Via

__version__ = "0.1.0"

_HOMES = {
    "Adaptive": "solvers.continuation.step_rules",
    "Analysis": "analysis",
    "Auto": "solvers.continuation.auto",
    "BSpline": "controls.bspline",
    "Block": "state_space",
    "Bound": "constraints.bound",
    "Calibration": "machine.calibration.calibration",
    "Car": "systems.car",
    "CarWithTrailers": "systems.car_with_trailers",
    "Cartan": "systems.cartan",
    "CasadiRungeKutta": "flow.integrators",
    "Chained": "systems.chained",
    "ChainedForm": "systems.chained_form",
    "Chebyshev": "controls.chebyshev",
    "CoefficientMetric": "solvers.metrics",
    "Comparison": "comparison",
    "Compiled": "flow.compiled.kernels",
    "CompiledWhenReady": "flow.compiled.kernels",
    "ConstraintKind": "constraints.kind",
    "Continuation": "solvers.continuation.continuation",
    "Control": "controls.control",
    "ControlBasis": "controls.basis",
    "ControlObjective": "objectives.objective",
    "Cvodes": "flow.integrators",
    "Damped": "solvers.continuation.generalized_inverses",
    "DifferentiatedEndPointMap": "flow.end_point_map",
    "DoubleIntegrator": "systems.double_integrator",
    "Engel": "systems.cartan",
    "Entry": "comparison",
    "Euler": "solvers.continuation.step_rules",
    "Fatrop": "solvers.nlp.fatrop",
    "Fourier": "controls.fourier",
    "FreeNilpotent36": "systems.free_nilpotent_36",
    "FrictionDriveWrist": "systems.friction_drive_wrist",
    "FrozenError": "errors",
    "GeneralizedInverse": "solvers.continuation.generalized_inverses",
    "Heisenberg": "systems.heisenberg",
    "Horizon": "horizon",
    "Interpreted": "flow.compiled.kernels",
    "InvalidProblemError": "errors",
    "Ipopt": "solvers.nlp.ipopt",
    "L2Metric": "solvers.metrics",
    "Lagrangian": "solvers.continuation.generalized_inverses",
    "LeastSquares": "solvers.least_squares",
    "LeastSquaresSettings": "solvers.least_squares",
    "Leg": "systems.legs",
    "Legendre": "controls.legendre",
    "MissingDependencyError": "errors",
    "MobileManipulator": "systems.mobile_manipulator",
    "MoorePenrose": "solvers.continuation.generalized_inverses",
    "Motion": "flow.simulation",
    "MultiStart": "solvers.continuation.multi_start",
    "MultipleShooting": "solvers.nlp.multiple_shooting",
    "NhpocpError": "errors",
    "NhpocpWarning": "errors",
    "NonholonomicManipulator": "systems.nonholonomic_manipulator",
    "Ode": "solvers.continuation.step_rules",
    "OrientationAtPiError": "errors",
    "OrientingPlatform": "systems.orienting_platform",
    "Outcome": "outcome",
    "ParallelRobot": "systems.parallel_robot",
    "Parameter": "systems.system",
    "PassiveSphere": "systems.passive_sphere",
    "Obstacle": "bodies.obstacles",
    "PathObjective": "objectives.objective",
    "PiecewiseConstant": "controls.piecewise_constant",
    "Plan": "batch",
    "PlanningProblem": "problem",
    "Plant": "machine.feedback.plant",
    "ProblemGuess": "solvers.nlp.guesses",
    "RigidBody": "systems.rigid_body",
    "RollingSphere": "systems.rolling_sphere",
    "Run": "comparison",
    "RungeKutta4": "flow.integrators",
    "SequenceBasis": "controls.sequence",
    "SimulatedPlant": "machine.feedback.simulated_plant",
    "SingleShooting": "solvers.nlp.single_shooting",
    "Sinusoids": "solvers.sinusoids",
    "SinusoidsSettings": "solvers.sinusoids",
    "Solution": "solution",
    "Solver": "solution",
    "SolverGuess": "solvers.nlp.guesses",
    "SolverSettings": "solvers.settings",
    "SphereOnSphere": "systems.sphere_on_sphere",
    "StagedTranscription": "solvers.nlp.staged_transcription",
    "StateSpace": "state_space",
    "Steered": "machine.feedback.steering",
    "StepRule": "solvers.continuation.step_rules",
    "StraightGuess": "solvers.nlp.guesses",
    "SuslovJoint": "systems.suslov_joint",
    "System": "systems.system",
    "ThreeUPU": "systems.three_upu",
    "TooLargeError": "errors",
    "Transpose": "solvers.continuation.generalized_inverses",
    "TridentSnake": "systems.trident_snake",
    "TruckWithTrailers": "systems.truck_with_trailers",
    "Unicycle": "systems.unicycle",
    "Units": "units",
    "UnknownNameError": "errors",
    "UnreadableSolutionError": "errors",
    "VariationalEndPointMap": "flow.end_point_map",
    "Verdict": "solution",
    "VeselovaJoint": "systems.veselova_joint",
    "Via": "via",
    "analyze": "api",
    "calibrate": "api",
    "compare": "api",
    "deg": "state_space",
    "direction": "state_space",
    "dump_problem": "problem_file",
    "full_step": "solvers.continuation.step_rules",
    "load_problem": "api",
    "load_solution": "api",
    "matrix": "state_space",
    "mobility": "systems.mobility",
    "namespace": "arrays",
    "plan_many": "api",
    "replace": "frozen",
    "rotation": "state_space",
    "save_solution": "api",
    "scalar": "state_space",
    "simulate": "api",
    "solve": "api",
    "steer": "api",
    "sweep": "api",
    "vector": "state_space",
    "verify": "api",
    "write_animation": "api",
    "write_report": "api",
}
__all__ = ["__version__", *_HOMES]


if not TYPE_CHECKING:  # who checks types reads the list above, in which a misspelt name is an error

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            from nhpocp.errors import UnknownNameError, suggestion

            raise UnknownNameError(
                f"nhpocp has no {name!r}; {suggestion(name, _HOMES, none='see dir(nhpocp)')}"
            )
        value = getattr(import_module(f"nhpocp.{_HOMES[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
