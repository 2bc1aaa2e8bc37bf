"""How runs are called."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nhpocp import variant_label
from nhpocp.problem_file.variants import overrides, variant
from tests.conftest import paper_problem

KEYS = st.sampled_from(["gamma", "steps", "control.harmonics", "control"])
SETTINGS = st.lists(st.tuples(KEYS, st.integers(1, 3)), max_size=3).map(
    lambda pairs: [f"{key}={value}" for key, value in pairs]
)


def test_a_list_is_one_value() -> None:
    label = "jacobian:control.initial=[[0, 1], [2, 3]],gamma=0.5"
    assert variant_label.parts(label) == ("jacobian", ["control.initial=[[0, 1], [2, 3]]", "gamma=0.5"])


@given(st.lists(st.tuples(st.sampled_from(["jacobian", "nlp"]), SETTINGS), max_size=4))
def test_what_all_have_in_common_is_not_said_and_what_differs_is(runs: list[tuple[str, list[str]]]) -> None:
    labels = [variant_label.joined(name, settings) for name, settings in runs]
    said = variant_label.distinct(labels)
    for i, one in enumerate(labels):
        for k, other in enumerate(labels):
            alike = (one.partition(":")[0], set(variant_label.parts(one)[1])) == (
                other.partition(":")[0],
                set(variant_label.parts(other)[1]),
            )
            if not alike:
                assert said[i] != said[k]


def test_a_variant_may_change_the_control() -> None:
    problem = paper_problem(initial=None)
    other, _ = variant(problem, "jacobian:control.harmonics=3,step_rule=euler,gamma=0.5")
    assert other.basis.parameters() == {"harmonics": 3}
    assert other.solvers["jacobian"].settings()["gamma"] == 0.5
    other, _ = variant(paper_problem(), "nlp:control.basis=legendre,control.degree=4,control=basis")
    assert (other.basis.kind, other.basis.size, other.initial) == ("legendre", 5, None)
    assert other.solvers["nlp"].settings()["control"] == "basis"
    assert overrides("nlp:control=basis") == ("nlp", ["solvers.nlp.control=basis"])


@pytest.mark.parametrize("label", ["jacobian:control.harmonic=3", "jacobian:control.basis=fourrier"])
def test_what_the_control_does_not_have_is_refused(label: str) -> None:
    with pytest.raises(Exception, match="did you mean") as refused:
        variant(paper_problem(initial=None), label)
    assert f"given by --variant {label}" in str(refused.value)
