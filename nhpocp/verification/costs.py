"""What a motion costs, integrated along its replay by Gauss and Legendre's rule between the integrator's steps."""

from __future__ import annotations

import numpy as np

from nhpocp.controls.control import Control
from nhpocp.objectives.objective import ControlObjective, PathObjective
from nhpocp.objectives.registry import available
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification.replay import replay

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
AT_ONCE = 256  # steps
PARTS = 400  # of the horizon, at least


def replayed_costs(problem: PlanningProblem, control: Control) -> dict[str, float] | None:
    """The costs that the motion has, effort included; None where the replay ends early."""
    with np.errstate(all="ignore"):
        numeric = NumericSystem(problem.system)
        path = replay(numeric, control, problem.start_point)
        if path.stopped:
            return None
        objectives = [
            o for o in available(problem.system) if o.of_motion and not o.lacking_control(control.basis)
        ]
        costs = dict.fromkeys((objective.name for objective in objectives), 0.0)
        # a rate that is constant is followed in a few steps, on which a cost may have a corner
        knots = np.union1d(path.times, np.linspace(0.0, path.reached, PARTS + 1))
        for first in range(0, len(knots) - 1, AT_ONCE):
            ends = knots[first : first + AT_ONCE + 1]
            middles, halves = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
            times = (middles[:, None] + halves[:, None] * NODES).ravel()
            weights = (halves[:, None] * WEIGHTS).ravel()
            states, controls = path(times), control(times)
            for objective in objectives:
                if isinstance(objective, ControlObjective):
                    values = objective.density(control, times)
                elif isinstance(objective, PathObjective):
                    values = numeric.along(objective.integrand, states, controls, problem.scale)
                costs[objective.name] += float(weights @ values)
        return costs
