"""The worlds of the benchmark are connected, blocked and the same again, and its rows judge what was planned."""

import numpy as np
import pytest
from benchmark_worlds import kept, solved, table
from worlds import least_distance, straight, world

from nhpocp.verification.distances import Distances


@pytest.mark.parametrize("number", [1, 2, 3])  # a unicycle, a robot, a car
def test_a_walk_leads_around_what_is_in_the_way(number):
    place, again = world(number), world(number)
    assert again.problem.obstacles == place.problem.obstacles
    system = place.problem.system
    np.testing.assert_array_equal(place.walk[0], place.problem.start_point)
    np.testing.assert_allclose(place.walk[-1], place.problem.goal_point, atol=1e-12)
    assert 3 <= len(place.problem.obstacles) <= 8
    assert least_distance(system, place.walk) > place.bound
    assert least_distance(system, straight(place.problem)) < place.bound
    distances = Distances(system, system.surroundings)  # the product's, another use of the library
    corners = distances.corners(place.walk)
    measured = min(distances.measure(corners, k).min() for k in range(len(system.surroundings.pairs)))
    assert least_distance(system, place.walk) == pytest.approx(measured, abs=1e-5)


def test_a_plan_counts_only_with_the_distance_that_was_asked_for(capsys):
    row = solved(1, "auto")
    assert row["converged"]
    assert kept(row)
    near = row | {"distance": 0.98 * row["bound"]}
    assert not kept(near)
    dearer = row | {"method": "nlp", "effort": 1.1 * row["effort"]}
    table([row, dearer])
    assert "costs no more in 0 of 1" in capsys.readouterr().out
    table([near, row | {"method": "nlp"}])
    said = capsys.readouterr().out
    assert "| unicycle | auto | 0 of 1 |" in said
    assert "world 1, unicycle, auto: converged (distance 0.0392, bound 0.04)" in said
