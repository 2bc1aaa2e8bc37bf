"""The benchmark of the planner in C runs, and its plans are Python's; no timing."""

from dataclasses import replace

from benchmark_c_planner import compared, report

from nhpocp.flow.compiled.kernels import Interpreted


def test_a_short_run_finds_python_s_plans_and_would_see_others(capsys):
    rows = compared(2, 1, Interpreted())
    assert report(rows) == 0
    said = capsys.readouterr().out
    assert "converged, converged: 2" in said
    assert "times as long (wanted: at least 4)" in said
    assert report([replace(rows[0], difference=2e-9), rows[1]]) == 1
    assert report([replace(rows[0], outcome="stagnated"), rows[1]]) == 1
