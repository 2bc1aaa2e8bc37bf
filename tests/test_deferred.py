"""Mappings worked out when they are looked at."""

import pickle

import pytest

from nhpocp.deferred import Deferred


def test_the_rest_is_worked_out_once_and_only_if_asked_for():
    made = []

    def rest():
        made.append(1)
        return {"b": 2, "c": 3}

    first = Deferred(rest, {"a": 1})
    more = first | {"d": 4} | {"a": 0}
    assert (first["a"], more["a"], more["d"], made) == (1, 0, 4, [])
    assert more["b"] == first["c"] - 1 == 2
    assert list(first) == ["a", "b", "c"]
    assert list(more) == ["a", "d", "b", "c"]
    assert first == {"a": 1, "b": 2, "c": 3}
    assert more == {"a": 0, "b": 2, "c": 3, "d": 4}
    assert len(made) == 1


def test_what_is_missing_is_a_key_error():
    with pytest.raises(KeyError):
        Deferred(dict, {"a": 1})["z"]


def test_a_pickled_one_comes_back_as_a_dict():
    copy = pickle.loads(pickle.dumps(Deferred(lambda: {"b": 2}, {"a": 1})))
    assert isinstance(copy, dict)
    assert copy == {"a": 1, "b": 2}


def test_a_solve_integrates_its_motion_only_for_those_who_look(monkeypatch):
    from nhpocp.flow import simulation
    from nhpocp.solvers.continuation.continuation import Continuation
    from nhpocp.solvers.continuation.step_rules import Adaptive
    from tests.conftest import paper_problem

    called, own = [], simulation.settled_path
    monkeypatch.setattr(simulation, "settled_path", lambda *given: called.append(1) or own(*given))
    solution = Continuation(step_rule=Adaptive()).solve(paper_problem())
    assert solution.costs["effort"] == pytest.approx(solution.control.effort)
    assert not called
    assert solution.trajectory["t"][-1] == 1.0
    assert solution.costs["path_length"] > 10
    assert len(called) == 1
