"""Stores whose rows are made up: studies of any size without a solve."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.study.store import COLUMNS, Store
from nhpocp.study.study import Study, read_study_text

ROBOT = """\
nhpocp: 1
study:
  name: made_up
  problem:
    system: {model: three_upu, preset: default}
    start: {position: [0, 0, 25], orientation: {rpy: [0, 0, -30 deg]}}
    goal: {position: [0, 0, 32], orientation: {rpy: [0, 0, -60 deg]}}
    constraints: {leg_length: [24, 46]}
"""
ENDINGS = ("converged", "infeasible", "singular_s", "stagnated", "not_verified")
TILTS = """\
  axes:
    goal.position[2]: [28, 31, 34]
    goal.orientation.rpy[0]: {linspace: [-40 deg, 40 deg, 5]}
    goal.orientation.rpy[1]: {linspace: [-20 deg, 20 deg, 4]}
"""
DRAWN = """\
  axes:
    goal.position[0]: {uniform: [-2, 2]}
    goal.position[1]: {uniform: [-2, 2]}
    goal.orientation.rpy[2]: {uniform: [-90 deg, -30 deg]}
  samples: 30
"""
BOTH = '  solvers: [jacobian, "nlp:intervals=20"]\n'
Row = dict[str, Any]


def row_of(study: Study, run: int, random: np.random.Generator) -> Row:
    """A row that might be one; four of five are solved."""
    place = 0 if random.random() < 0.8 else int(random.integers(1, len(ENDINGS)))
    outcome = ENDINGS[place]
    said = {"infeasible": "the goal itself breaks leg_length[1].", "singular_s": "det S changes sign."}
    return dict.fromkeys(COLUMNS) | {
        "run": run,
        "variant": study.solver(run),
        "parameters": json.dumps(study.parameters(run)),
        "outcome": outcome,
        "converged": int(not place),
        "message": said.get(outcome, "E = 1."),
        "verified_error": float(random.random()) * 1e-3,
        "effort": float(random.lognormal()),
        "evaluations": int(random.integers(3, 300)),
        "margins": json.dumps({"sigma_s": float(random.random()), "sigma_w": float(random.random())}),
        "limits": json.dumps({"leg_length": {"worst": 0.0, "ok": outcome != "not_verified"}}),
        "settings": json.dumps({"objective": "none"}),
        "solved_control": None if outcome == "stagnated" else "{}",
        "solve_s": float(random.lognormal(-1)),
        "verify_s": 0.1,
        "tries": 1,
        "finished": "2026-11-29T13:00:10+00:00",
    }


def store_of(
    text: str, file: Path, change: Callable[[Row], Row] = dict, runs: int | None = None
) -> tuple[Path, Study, list[Row]]:
    """The store of a study's text, with the study and the rows in it: the first ``runs``, all unless said."""
    study, random = read_study_text(text, "made_up.yaml"), np.random.default_rng(0)
    numbers = range(1, (len(study) if runs is None else runs) + 1)
    rows = [change(row_of(study, run, random)) for run in numbers]
    with Store.create(file, study, resume=False) as store:
        session = store.begin(2, {"nhpocp": "0.0", "processor": "none"})
        rows = [{**row, "session": session} for row in rows]
        store.add(rows)
    return file, study, rows
