"""Under active bounds the NLP finds what a plain script finds, and keeps the bounds between its nodes too."""

import active_bounds
import pytest

from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

INTERVALS = 15
SAMPLE = [  # (robot, kind, goal); a leg is often longest at the goal, where such a bound leaves no interior
    ("default", "leg_length", 0),
    ("unequal", "leg_length", 0),
    ("unequal", "leg_speed", 0),
    ("suslov", "platform_normal_box", 0),
]


@pytest.mark.parametrize(("robot", "kind", "goal"), SAMPLE)
def test_the_nlp_loses_no_case_that_a_plain_script_solves(robot, kind, goal):
    kinds = [k for k in active_bounds.KINDS if k.__name__ == kind]
    ((_, _, _, problem),) = active_bounds.cases([robot], kinds, [goal], INTERVALS)
    plain = active_bounds.plain(problem, INTERVALS)
    solution, _ = active_bounds.ours(problem, MultipleShooting(intervals=INTERVALS, kernels=Interpreted()))
    assert active_bounds.holds(*active_bounds.judged(problem, solution.control)), solution.message
    if active_bounds.holds(*active_bounds.judged(problem, plain.control)):
        assert solution.details["objective_value"] <= 1.001 * plain.cost
