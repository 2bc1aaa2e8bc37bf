"""The closed list of how a solve can end, each with a sentence that says what to try."""

from __future__ import annotations

from enum import Enum


class Outcome(Enum):
    """How a solve can end; each with a sentence that says what to try."""

    CONVERGED = "converged"
    NOT_VERIFIED = "not_verified"
    CONSTRAINT_VIOLATED = "constraint_violated"
    ITERATION_LIMIT = "iteration_limit"
    STAGNATED = "stagnated"
    DIVERGED = "diverged"
    RANK_DEFICIENT = "rank_deficient"
    SINGULAR_S = "singular_s"
    SINGULAR_W = "singular_w"
    ORIENTATION_AT_PI = "orientation_at_pi"
    NOT_FINITE = "not_finite"
    INFEASIBLE = "infeasible"
    NOT_REACHED = "not_reached"
    OTHER_COMPONENT = "other_component"
    INTERRUPTED = "interrupted"
    SOLVER_ERROR = "solver_error"

    @property
    def advice(self) -> str:
        return _ADVICE[self]


_ADVICE = {
    Outcome.CONVERGED: "The goal is reached and the path was confirmed by an independent integration.",
    Outcome.NOT_VERIFIED: "The solver's path does not survive re-integration; use more steps or intervals.",
    Outcome.CONSTRAINT_VIOLATED: (
        "The goal is reached but a stated constraint is broken; loosen it, or try the other solver or more intervals."
    ),
    Outcome.ITERATION_LIMIT: "Raise max_iterations; for the Jacobian method also gamma, up to 1.",
    Outcome.STAGNATED: (
        "The error no longer falls; try another control.initial, more harmonics, or a smaller gamma."
    ),
    Outcome.DIVERGED: "The error grows without bound; try a smaller gamma or another control.initial.",
    Outcome.RANK_DEFICIENT: (
        "To working precision the control cannot move the end point in every direction; try `initial: auto` or "
        "another seed, more functions, or the nlp solver. `nhpocp analyze` says whether any control can."
    ),
    Outcome.SINGULAR_S: (
        "The path runs into det S = 0, where eq. (7) is undefined; try another control.initial, a "
        "smaller gamma or `form: original`."
    ),
    Outcome.SINGULAR_W: (
        "The path runs into det W = 0, where the actuators lose the platform; try another control.initial."
    ),
    Outcome.ORIENTATION_AT_PI: (
        "The orientation error is a half turn, whose axis is ambiguous; try another control.initial "
        "or turn the goal slightly."
    ),
    Outcome.NOT_FINITE: "The integration overflowed; try more steps or a smaller initial control.",
    Outcome.INFEASIBLE: "The constraints cannot be met together; loosen the ones named.",
    Outcome.NOT_REACHED: "Every way that was tried failed; see the message for what was tried.",
    Outcome.OTHER_COMPONENT: (
        "Start and goal lie on different sides of a singular surface; choose a goal on the start's side."
    ),
    Outcome.INTERRUPTED: "The solve was stopped by hand; what was found so far is kept.",
    Outcome.SOLVER_ERROR: "The solver itself failed; see solver.log.",
}
