"""Whatever ends a verb or takes its disk, in the midst of a file too: the old result or the new one is there, whole."""

import os

import pytest

from nhpocp import whole

faults = (
    pytest.importorskip("tests.faults", reason="processes and limits of POSIX")
    if os.name == "posix"
    else None
)
pytestmark = pytest.mark.skipif(os.name != "posix", reason="processes and limits of POSIX")


@pytest.fixture(scope="module")
def top(tmp_path_factory):
    folder = tmp_path_factory.mktemp("faults")
    with faults.prepared(folder / "before", quick=True):
        yield folder


def struck(trial, full, most):
    """So many faults, one after another; every kind of them is among them."""
    chosen = trial.chosen(full, most)
    assert {fault.kind for fault in chosen} == {fault.kind for fault in trial.faults if fault.full == full}
    for k, fault in enumerate(chosen):
        assert trial.strike(fault, as_json=bool(k % 2)) == []
    return len(chosen)


@pytest.mark.parametrize(
    ("name", "most"), [("solve", 32), ("compare", 24), ("plot", 16), ("export", 8), ("solve --from", 12)]
)
def test_a_verb_may_be_killed_anywhere(name, most, top):
    """At every moment, with real pictures: `python tests/faults.py`."""
    assert struck(faults.Trial.of(name, top), False, most) == most


def test_solve_may_be_killed_where_folders_cannot_be_exchanged(top, monkeypatch):
    monkeypatch.setattr(whole, "_system_renameat2", lambda: None)
    assert struck(faults.Trial.of("solve", top), False, 24) == 24


@pytest.mark.parametrize(
    ("name", "most"),
    [
        *[
            ("solve", 9),
            ("compare", 9),
            ("plot", 6),
            ("analyze", 6),
            ("animate", 4),
            ("schema", 4),
            ("init", 6),
        ],
        *[("export", 4), ("solve --from", 6)],
    ],
)
def test_a_full_disk_costs_a_sentence_and_no_file(name, most, top):
    assert struck(faults.Trial.of(name, top), True, most) == most
