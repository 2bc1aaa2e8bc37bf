"""scripts/killed_sweeps.py: what it would notice. The kills themselves: tests/study/test_sweep.py has two."""

import json

import killed_sweeps
import pytest


def row(run, **changed):
    known = dict.fromkeys(killed_sweeps.COMPARED, 1.0)
    control = {"basis": "fourier", "coefficients": [[1.0, 2.0]]}
    return {**known, "run": run, "outcome": "converged", "solved_control": json.dumps(control), **changed}


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ([row(1), row(2)], []),
        ([row(1), row(2, effort=1 + 1e-9)], []),
        ([row(1)], ["runs [1]"]),
        ([row(1), row(1)], ["runs [1, 1]"]),
        ([row(1), row(2, outcome="diverged")], ["run 2: outcome: 'diverged', not 'converged'"]),
        ([row(1), row(2, effort=1.1)], ["run 2: effort: 1.1, not 1.0"]),
        ([row(1), row(2, effort=None)], ["run 2: effort: None, not 1.0"]),
        ([row(1), row(2, solved_control='{"coefficients": [[1.0, 2.1]]}')], ["run 2: solved_control: "]),
    ],
)
def test_every_difference_is_named(found, expected):
    wrong, worst = killed_sweeps.differences(found, [row(1), row(2)])
    assert [said.startswith(start) for said, start in zip(wrong, expected, strict=True)] == [True] * len(
        expected
    )
    assert (worst > killed_sweeps.SAME) == bool(expected)
