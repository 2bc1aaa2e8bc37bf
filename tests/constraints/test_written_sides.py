"""One side, the other or both, by name or in a list, in every kind of constraint, from a file and from Python."""

from __future__ import annotations

import jsonschema
import numpy as np
import pytest

from nhpocp.constraints.registry import KINDS, bounds_of
from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import dump_problem, parse_problem
from nhpocp.problem_file.editor_schema import json_schema
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import paper_problem

TEXT = dump_problem(paper_problem(pictures=False))
# a key, what may be written, and the list or number that says the same
SAME = [
    ("leg_length", {"max": 60}, [None, 60]),
    ("leg_length", {"min": 20}, [20, None]),
    ("leg_length", {"min": 20, "max": 60}, [20, 60]),
    ("leg_speed", {"max": 200}, 200),
    ("leg_acceleration", {"max": 900}, 900),
    ("clearance", {"min": 0.05}, 0.05),
    ("control", {"max": 10}, 10),
    ("control", [{"max": 3}, {"min": -2}, [-1, 1]], [[None, 3], [-2, None], [-1, 1]]),
    ("distance", {"min": 3}, 3),
    ("joint_angle", {"cone": {"max": 2}}, {"cone": [None, 2]}),
    ("joint_angle", {"theta3": {"max": 2}}, {"theta3": [None, 2]}),
    ("state", {"position": {"max": 50}}, {"position": [None, 50]}),
    ("state", {"position": {"min": [-9, -9, 5]}}, {"position": [[-9, -9, 5], [None, None, None]]}),
]


def same(one, other) -> None:
    assert [bound.label for bound in one] == [bound.label for bound in other]
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(*np.broadcast_arrays(a.lower, b.lower))
        np.testing.assert_array_equal(*np.broadcast_arrays(a.upper, b.upper))


@pytest.mark.parametrize(("key", "written", "meant"), SAME)
def test_sides_by_name_are_the_list(key, written, meant):
    system = ThreeUPU()
    wanted = bounds_of({key: meant}, system)
    same(bounds_of({key: written}, system), wanted)
    text = str({key: written}).replace("None", "null").replace("'", "")
    problem = parse_problem(f"{TEXT}constraints: {text}\n")
    same(problem.bounds, wanted)
    same(parse_problem(dump_problem(problem.with_())).bounds, wanted)


def test_every_kind_is_among_them():
    assert {key for key, _, _ in SAME} == set(KINDS)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("leg_length: {}", "got an empty mapping"),
        ("leg_length: [-.inf, 3]", "write null, or {max: …}"),
        ("leg_length: [-inf, 20 deg]", "write null, or {max: …}"),
        ("leg_length: {mx: 3}", "did you mean 'max'?"),
        ("leg_speed: {min: 3}", "required key is missing"),
        ("state: {position: {max: [1, 2]}}", "2 bounds a side; expected 3"),
        (
            "joint_angle: {theta3: {min: 30 deg, max: 20 deg}}",
            "lower bound 30 deg is above upper bound 20 deg",
        ),
    ],
)
def test_other_sides_are_refused_in_words(written, message):
    with pytest.raises(InvalidProblemError) as caught:
        parse_problem(f"{TEXT}constraints: {{{written}}}\n")
    assert message in "; ".join(error.message for error in caught.value.each)


@pytest.mark.parametrize("value", [{"min": 3}, {}, {"min": 1, "max": 3}])
def test_a_size_has_one_side(value):
    with pytest.raises(InvalidProblemError, match=r"expected a number, or \{max: …\}"):
        bounds_of({"leg_speed": value}, ThreeUPU())


@pytest.mark.parametrize(("key", "written", "meant"), SAME)
def test_editors_take_what_the_reader_takes(key, written, meant):
    validator = jsonschema.Draft7Validator(json_schema())
    task = {
        "nhpocp": 1,
        "system": {"model": "three_upu"},
        "start": {"position": [0, 0, 25], "orientation": {"rpy": [0, 0, 0]}},
        "goal": {"position": [0, 0, 30]},
    }
    for value in (written, meant):
        assert not list(validator.iter_errors(task | {"constraints": {key: value}}))
    assert list(validator.iter_errors(task | {"constraints": {key: {"mx": 3}}}))
