"""The legs' check by differences: exact for any geometry and pose, so that what it finds is the equations' fault."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from nhpocp import so3
from nhpocp.systems.legs import Leg
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.verification import geometry

coordinate = st.floats(-1, 1)
triple = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    legs=st.tuples(*[st.tuples(triple, triple, triple, triple, st.booleans())] * 3),
    position=triple,
    turn=triple,
    control=triple,
)
def test_rolling_holds_for_any_geometry_and_pose(legs, position, turn, control):
    assume(all(np.linalg.norm(part) > 0.2 for leg in legs for part in leg[2:4]))
    assume(np.linalg.norm(control) > 0.1)
    robot = ThreeUPU(
        legs=[
            Leg(tuple(20 * x for x in a), tuple(10 * x for x in b), r, w4, "suslov" if suslov else "veselova")
            for a, b, r, w4, suslov in legs
        ]
    )
    pose = {"position": 10 * np.array(position) + [0, 0, 40], "orientation": so3.exp(2 * np.array(turn))}
    states, numeric = robot.state_space.pack(pose)[None], NumericSystem(robot)
    assume(abs(numeric.determinants(states)["s"][0]) > 1e-2)
    rolling, leg_rate = geometry.residuals(numeric, states, np.array([control]))
    assert rolling[0] < 1e-8
    assert leg_rate[0] < 1e-8


@settings(max_examples=25, deadline=None, derandomize=True)
@given(beside=st.floats(2e-3, 0.1), heading=st.floats(0, 6.3), turn=triple, control=triple)
def test_rolling_holds_for_a_leg_beside_its_own_w4(beside, heading, turn, control):
    """Its frame turns about it the faster the nearer they are."""
    assume(np.linalg.norm(control) > 0.1)
    robot = ThreeUPU(20.0, 19.0, 0.7, "normal")
    leg, rotation = robot.legs[2], so3.exp(0.5 * np.array(turn))
    along = so3.exp(beside * np.array([np.cos(heading), np.sin(heading), 0.0])) @ leg.w4
    position = np.asarray(leg.base) + 30.0 * rotation @ along - rotation @ leg.platform
    states, numeric = (
        robot.state_space.pack({"position": position, "orientation": rotation})[None],
        NumericSystem(robot),
    )
    assume(min(abs(values[0]) for values in numeric.determinants(states).values()) > 1e-2)
    rolling, leg_rate = geometry.residuals(numeric, states, np.array([control]))
    assert rolling[0] < 5e-7  # allowed 1e-6
    assert leg_rate[0] < 5e-7
