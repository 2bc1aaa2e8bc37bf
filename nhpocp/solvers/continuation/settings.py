"""What a problem file may say of the Jacobian method, and the tables of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import signature
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp import declared
from nhpocp.errors import InvalidProblemError
from nhpocp.family import Family, Group
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.solvers.route.wanted import ROUTE, ROUTE_SECONDS, ROUTES
from nhpocp.solvers.settings import SolverSettings

if TYPE_CHECKING:
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.solution import Solver

# `auto` is no rule: it is a solver that tries several ways
STEP_RULES: Family[Any] = Family(
    {
        "euler": "nhpocp.solvers.continuation.step_rules:Euler",
        "adaptive": "nhpocp.solvers.continuation.step_rules:Adaptive",
        "ode": "nhpocp.solvers.continuation.step_rules:Ode",
    },
    group=Group(
        "nhpocp.step_rules",
        "nhpocp.solvers.continuation.step_rules:StepRule",
        "kind",
        "a step rule",
        ("auto",),
    ),
)
INVERSES: Family[Any] = Family(
    {
        "moore_penrose": "nhpocp.solvers.continuation.generalized_inverses:MoorePenrose",
        "damped": "nhpocp.solvers.continuation.generalized_inverses:Damped",
        "transpose": "nhpocp.solvers.continuation.generalized_inverses:Transpose",
        "lagrangian": "nhpocp.solvers.continuation.generalized_inverses:Lagrangian",
    }
)
METRICS: Family[Any] = Family(
    {"coefficients": "nhpocp.solvers.metrics:CoefficientMetric", "l2": "nhpocp.solvers.metrics:L2Metric"}
)
INTEGRATORS: Family[Any] = Family(
    {
        "rk4": "nhpocp.flow.integrators:RungeKutta4",
        "rk": "nhpocp.flow.integrators:CasadiRungeKutta",
        "cvodes": "nhpocp.flow.integrators:Cvodes",
    }
)
SENSITIVITIES: Family[Any] = Family(
    {
        "automatic": "nhpocp.flow.end_point_map:DifferentiatedEndPointMap",
        "variational": "nhpocp.flow.end_point_map:VariationalEndPointMap",
    }
)


@dataclass(frozen=True)
class JacobianSettings(SolverSettings):
    """The Jacobian method: continuation by [Paper] eqs. (16)-(17)."""

    step_rule: str = declared.choice(
        "auto", [*STEP_RULES, "auto"], "how far a step goes; auto: other ways too"
    )
    gamma: float = declared.positive(
        0.1, "γ of (17) for euler and ode, the share of the error that a step should remove"
    )
    inverse: str = declared.choice(
        "moore_penrose",
        INVERSES,
        "how the end point's Jacobian is inverted; lagrangian brings a metric of its own",
    )
    metric: str = declared.choice(
        "coefficients", METRICS, "size of a control: of its coefficients (the paper's), or ∫|control|²"
    )
    tolerance: float = declared.positive(1e-3, "the error E at which to stop")
    max_iterations: int = declared.whole(
        500, "updates before giving up, in each try; auto: 25 while others are left"
    )
    integrator: str = declared.choice("rk4", INTEGRATORS, "own RK4, or one of CasADi's")
    steps: int = declared.count(100, "integration steps over the horizon")
    sensitivity: str = declared.choice(
        "automatic",
        SENSITIVITIES,
        "the end point's Jacobian: by differentiating the integrator, or by (11)-(12)",
    )
    objective: str = declared.choice(
        "none", ["none", *costs_of_motion()], "what the null-space phase minimises"
    )
    starts: int = declared.count(1, "tries: the file's control, then seeded ones")
    seed: int = declared.whole(0, "of everything random")
    route: str = declared.choice("auto", ROUTES, ROUTE)
    route_seconds: float = declared.positive(10.0, ROUTE_SECONDS)

    meaning: ClassVar[str] = "the Jacobian method"

    def solver(self, kernels: Kernels | None, others: Mapping[str, Solver]) -> Solver:
        from nhpocp.solvers.continuation.auto import Auto
        from nhpocp.solvers.continuation.continuation import Continuation
        from nhpocp.solvers.continuation.multi_start import MultiStart

        chosen = {"kernels": kernels} if kernels is not None and self.integrator == "rk4" else {}
        rule = STEP_RULES["adaptive" if self.step_rule == "auto" else self.step_rule]
        solver = Continuation(
            step_rule=rule(**{"gamma": self.gamma} if "gamma" in signature(rule).parameters else {}),
            inverse=INVERSES[self.inverse](),
            metric=METRICS[self.metric](),
            integrator=INTEGRATORS[self.integrator](steps=self.steps, **chosen),
            sensitivity=SENSITIVITIES[self.sensitivity],
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
            objective=self.objective,
            seed=self.seed,
        )
        if self.step_rule == "auto":
            restarts = max(Auto.restarts, self.starts - 1)
            return Auto(solver, restarts, self.route, self.route_seconds)
        if self.route == "always":
            words = "`route: always` needs `step_rule: auto`; the other rules follow no routes"
            raise InvalidProblemError(words, path="solvers.jacobian.route")
        return MultiStart(solver, self.starts) if self.starts > 1 else solver
