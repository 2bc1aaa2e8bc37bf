"""Studies that optimise: trials that a file alone decides on, what counts as best, and what a stop changes: nothing."""

from __future__ import annotations

import json
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from corners import CORNERS
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.errors import InvalidProblemError
from nhpocp.study import optimiser, run
from nhpocp.study.optimisation import Objective
from nhpocp.study.store import Store
from nhpocp.study.study import read_study_text
from nhpocp.study.sweep import sweep
from nhpocp.study.trials import Trial, front
from tests.study.test_study import said
from tests.study.test_sweep import here, ran, rows

HEAD = f"""\
{CORNERS.replace("corners", "designs")}\
    solvers: {{compile: never}}
    output: {{pictures: false}}
"""
AXES = "  axes: {goal.theta: [0, 0.5]}\n"
TEXT = """\
  optimise:
    over: {goal.x: [0.5, 2], horizon: [1, 2]}
    objectives: [effort]
    trials: 20
    batch: 4
    seed: 3
"""


def study(text=TEXT, axes=AXES):
    return read_study_text(HEAD + axes + text, "study.yaml")


def one(parameters):
    """The effort of a made-up run: least at x = 1.2 and the end of the range of horizons."""
    return (parameters["goal.x"] - 1.2) ** 2 + 3 - parameters["horizon"] + 0.1 * parameters["goal.theta"]


def made_up(source, job, cost=one, fails=lambda parameters: False):
    """Rows of runs that nobody has planned, as `run.performed` hands them back."""
    of = run._study(source)
    made = []
    for number in job.runs:
        parameters = of.parameters(number)
        if fails(parameters):
            made.append(run.failed_row(of, number, "Nothing", job.tries))
            continue
        more = {"effort": cost(parameters), "extremes": {"v": [-parameters["goal.x"], 0.1]}, "evaluations": 1}
        ending = {"outcome": "converged", "converged": 1, "message": "", "tries": job.tries}
        values = {"run": number, "variant": of.solver(number), "parameters": parameters}
        made.append(run._as_row(**values, **ending, **more))
    return made


@pytest.fixture
def pretend(monkeypatch):
    """pretend(fails=…): sweeps take made-up runs."""

    def replace(**how):
        monkeypatch.setattr("nhpocp.study.sweep.performed", partial(made_up, **how))

    replace()
    return replace


def swept(of, folder, resume=False, workers=1, progress=None):
    """The tally and the rows' parameters of a sweep in threads."""
    with Store.create(folder / "study.sqlite", of, resume) as store:
        tally = sweep(of, store, workers, progress, lambda: ThreadPoolExecutor(workers))
        return tally, [json.loads(row["parameters"]) for row in store.rows()]


def best(of, tally):
    return front(tally.trials, of.optimise.objectives)


def test_trials_are_outermost_and_keep_their_numbers():
    made = study()
    assert (len(made), made.runs_of_trial(1), made.runs_of_trial(3)) == (40, range(1, 3), range(5, 7))
    known = made.proposed([(0.5, 1), (0.7, 2)])
    assert known.parameters(3) == {"goal.x": 0.7, "horizon": 2, "goal.theta": 0}
    assert known.parameters(4)["goal.theta"] == pytest.approx(0.5)
    assert known.goal_axes == {"goal.theta"}
    assert len(study(axes="")) == 20
    others = [TEXT.replace(a, b) for a, b in (("seed: 3", "seed: 4"), ("batch: 4", "batch: 5"), ("2]", "3]"))]
    assert len({study(text).digest for text in (TEXT, *others)}) == 4
    assert study(TEXT.replace("20", "90")).digest == made.digest == known.digest


WRONG = {
    "over: {goal.x: [2, 0.5]}": "12:20: study.optimise.over.goal.x: 2 is not below 0.5; expected [least, most]",
    "over: {goal.x: 2}": "study.optimise.over.goal.x: expected [least, most], or a list of choices, got the number 2",
    "over: {goal.x: [2]}": "study.optimise.over.goal.x: expected [least, most], or a list of choices, got a list of 1",
    "over: {}": "study.optimise.over: expected a mapping of keys of the problem to their ranges",
    "over: {goal.u: [1, 2]}": "12:12: study.optimise.over.goal.u: unknown key; expected one of x, y, theta",
    "over: {horizont: [1, 2]}": "12:12: study.optimise.over.horizont: unknown key; did you mean 'horizon'?",
    "over: {horizon: [-1, 2]}": "study.optimise.over.horizon[0]: -1 is not positive; expected a number > 0",
    "over: {system.model: [unicycle, unicicle]}": "over.system.model[1]: unknown model 'unicicle'; did you mean",
    "over: {control.harmonics: [1, 5]}": "to 1000; two numbers are a range, three or more are choices",
    "over: {goal.theta: [1, 2]}": "12:12: study.optimise.over.goal.theta: this is an axis, too; expected one of",
    "over: {goal: [1, 2]}": "over.goal: goal.theta is a part of it; expected axes that do not contain one another",
    "over: {goal x: [1, 2]}": "study.optimise.over.goal x: no path of a key",
    "objectives: [effrot]": "13:18: study.optimise.objectives[0]: unknown objective 'effrot'; did you mean 'effort'?",
    "objectives: [{max: sigma_w}]": "study.optimise.objectives[0]: unknown objective 'sigma_w'; expected one of",
    "objectives: [{most: effort}]": "objectives[0]: expected a name such as effort, or {max: sigma_w}, got a mapping",
    "objectives: [effort, {max: effort}]": "objectives[1]: effort is an objective already; expected each once",
    "objectives: []": "study.optimise.objectives: a list of 0; expected 1 or more objectives",
    "trails: 3": "study.optimise.trails: unknown key; did you mean 'trials'?",
    "trials: 0": "study.optimise.trials: 0 is out of range; expected a whole number from 1",
}


@pytest.mark.parametrize("line", WRONG)
def test_mistakes_are_told_where_they_stand(line):
    lines = {
        "over": "over: {goal.x: [0.5, 2]}",
        "objectives": "objectives: [effort]",
        line.split(":")[0]: line,
    }
    with pytest.raises(InvalidProblemError) as caught:
        study("  optimise:\n" + "".join(f"    {each}\n" for each in lines.values()))
    assert WRONG[line] in str(caught.value)
    assert str(caught.value).startswith("study.yaml:")


def test_what_a_study_needs_and_what_does_not_go_together():
    with pytest.raises(
        InvalidProblemError, match=r"2:1: study\.axes: required key is missing; a study has axes, or"
    ):
        study("", axes="")
    with pytest.raises(InvalidProblemError, match=r"study\.solvers: 2 solvers; expected one beside optimise"):
        study(TEXT + "  solvers: [jacobian, nlp]\n")


def test_what_the_objectives_are_read_from():
    text = TEXT.replace(
        "[effort]", "[effort, {max: clearance}, leg_speed, leg_lengths, horizon, {max: sigma_s}]"
    )
    head = HEAD.replace("{model: unicycle}", "{model: three_upu}")
    for end, height in (("start", 25), ("goal", 30)):
        block = f"{end}: {{position: [0, 0, {height}], orientation: {{rpy: [0, 0, -0.5]}}}}"
        old = next(line for line in head.splitlines() if line.strip().startswith(end))
        head = head.replace(old, f"    {block}")
    text = text.replace("goal.x", "system.base_radius").replace("[0.5, 2]", "[20, 40]")
    made = read_study_text(head + text, "study.yaml")
    read = [(quantity.kind, quantity.parts) for quantity in made.measured]
    assert read == [
        ("cost", ("effort",)),
        ("least", ("sigma_s", "sigma_w")),
        ("peak", ("u",)),
        ("peak", ("leg_lengths",)),
        ("cost", ("horizon",)),
        ("least", ("sigma_s",)),
    ]
    row = {
        "effort": 3.0,
        "margins": json.dumps({"sigma_s": 0.2, "sigma_w": 0.1}),
        "extremes": json.dumps({"u": [-7, 5], "leg_lengths": [20, 40]}),
        "solved_control": json.dumps({"horizon": 1.5}),
    }
    assert [quantity.of_run(row) for quantity in made.measured] == [3.0, 0.1, 7, 40, 1.5, 0.2]
    assert [quantity.of_goals([1, 3]) for quantity in made.measured] == [2, 1, 3, 3, 2, 1]
    lost = {**row, "effort": None, "margins": json.dumps({"sigma_w": None}), "extremes": None}
    assert [quantity.of_run(lost) for quantity in made.measured] == [None, None, None, None, 1.5, None]


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5), st.booleans()), max_size=20))
def test_the_front_is_what_no_other_trial_is_as_good_as(made):
    objectives = Objective("effort", False), Objective("clearance", True)
    trials = [
        Trial(k + 1, {}, range(1), int(failed), () if failed else (float(a), float(b)))
        for k, (a, b, failed) in enumerate(made)
    ]
    kept = [trial.values for trial in front(trials, objectives)]
    known = {trial.values for trial in trials if not trial.failed}

    def beaten(mine):
        return any(a <= mine[0] and b >= mine[1] for a, b in known - {mine})

    assert kept == sorted(mine for mine in known if not beaten(mine))


def test_the_optimum_at_a_bound_is_found_and_reached(pretend, tmp_path):
    made = study(TEXT.replace("20", "48"))
    tally, parameters = swept(made, tmp_path)
    (found,) = best(made, tally)
    assert (tally.stored, len(tally.trials), len(parameters)) == (96, 48, 96)
    assert found.point["horizon"] == 2
    assert found.point["goal.x"] == pytest.approx(1.2, abs=0.1)
    both = [one({**found.point, "goal.theta": theta}) for theta in (0, 0.5)]
    assert found.values == pytest.approx([sum(both) / 2])


def test_neither_workers_nor_stops_change_the_trials(pretend, tmp_path, monkeypatch):
    made = study()
    for name in ("whole", "many", "stopped"):
        (tmp_path / name).mkdir()
    _, whole = swept(made, tmp_path / "whole")
    assert swept(made, tmp_path / "many", workers=3)[1] == whole

    def stop_at(least):
        def progress(tally):
            if tally.stored >= least:
                raise KeyboardInterrupt

        return progress

    folder, suggested, calls = tmp_path / "stopped", optimiser._suggested, []
    for least in (3, 25):
        tally, _ = swept(made, folder, resume=True, progress=stop_at(least))
        assert (tally.stopped, tally.stored >= least) == ("by hand", True)

    def in_the_middle(*arguments):  # of a point
        calls.append(arguments)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return suggested(*arguments)

    monkeypatch.setattr(optimiser, "_suggested", in_the_middle)
    assert swept(made, folder, resume=True)[0].stopped
    monkeypatch.setattr(optimiser, "_suggested", suggested)
    tally, parameters = swept(made, folder, resume=True)
    assert (parameters, tally.stored, len(tally.trials)) == (whole, 40, 20)
    (folder / optimiser.FILE).unlink()  # made again from what it is made of
    with pytest.raises(InvalidProblemError, match="run 40 is stored, of 20; --resume takes as many trials"):
        swept(study(TEXT.replace("20", "10")), folder, resume=True)
    tally, parameters = swept(study(TEXT.replace("20", "22")), folder, resume=True)
    assert (parameters[:40], tally.done, len(parameters)) == (whole, 4, 44)


def test_a_store_whose_trials_are_others_is_refused(pretend, tmp_path):
    made = study()
    swept(made, tmp_path)
    (tmp_path / optimiser.FILE).unlink()
    with sqlite3.connect(tmp_path / "study.sqlite") as connection:
        connection.execute("UPDATE runs SET parameters = '{}' WHERE run = 3")
    with pytest.raises(InvalidProblemError, match="run 3 is of another trial than this optimiser's"):
        swept(made, tmp_path, resume=True)
    (tmp_path / optimiser.FILE).write_text("no database" * 400)
    with pytest.raises(InvalidProblemError, match=r"optuna\.sqlite: Optuna cannot use this file"):
        swept(made, tmp_path, resume=True)


def test_trials_with_failed_runs_are_infeasible_and_avoided(pretend, tmp_path):
    pretend(fails=lambda parameters: parameters["horizon"] > 1.6 and parameters["goal.theta"] > 0)
    made = study()
    tally, _ = swept(made, tmp_path)
    (found,) = best(made, tally)
    assert found.point["horizon"] <= 1.6
    infeasible = [trial for trial in tally.trials if trial.failed]
    assert {(trial.failed, trial.values) for trial in infeasible} == {(1, ())}
    assert all(trial.point["horizon"] > 1.6 for trial in infeasible)
    with sqlite3.connect(tmp_path / optimiser.FILE) as connection:
        kinds = dict(connection.execute("SELECT value_type, count(*) FROM trial_values GROUP BY 1"))
        asked = "SELECT value_json, count(*) FROM trial_system_attributes WHERE key LIKE 'constraints:%' GROUP BY 1"
        constraints = dict(connection.execute(asked))
    assert kinds == {"FINITE": 20 - len(infeasible), "INF_POS": len(infeasible)}
    assert constraints == {"0.0": kinds["FINITE"], "1.0": kinds["INF_POS"]}


def test_choices_are_of_those(pretend, tmp_path):
    over = "{goal.x: [2, 0.5, 1.25, 1], horizon: [1, 2], control.basis: [fourier, legendre]}"
    text = TEXT.replace("{goal.x: [0.5, 2], horizon: [1, 2]}", over).replace("[effort]", "[effort, {max: v}]")
    made = study(text)
    tally, parameters = swept(made, tmp_path)
    assert {each["goal.x"] for each in parameters} <= {0.5, 1, 1.25, 2}
    assert {each["control.basis"] for each in parameters} == {"fourier", "legendre"}
    kept = best(made, tally)
    assert len(kept) > 1
    assert [trial.values[1] for trial in kept] == sorted(trial.point["goal.x"] for trial in kept)


def test_the_program_finds_says_and_restores_the_best(tmp_path):
    text = HEAD + TEXT.replace("20", "6").replace("batch: 4", "batch: 3").replace(
        "[effort]", "[{min: effort}]"
    )
    (tmp_path / "designs.yaml").write_text(text)
    assert said("check", tmp_path / "designs.yaml")[1].endswith("designs.yaml: ok, 6 trials, 6 runs\n")
    status, out, errors = ran("sweep", "designs.yaml", "--workers", 1, "-o", "out", cwd=tmp_path)
    assert (status, errors) == (0, "")
    efforts = [row["effort"] for row in rows(tmp_path / "out" / "study.sqlite")]
    number = efforts.index(min(efforts)) + 1
    assert "6 trials; the best:\n  trial " in out
    assert out.endswith(f"nhpocp solve --from out/study.sqlite --run {number}\n")
    status, out, _ = ran("sweep", "designs.yaml", "--resume", "-o", "out", "--json", cwd=tmp_path)
    told = json.loads(out)
    assert (status, told["trials"], told["infeasible"]) == (0, 6, 0)
    (found,) = told["front"]
    assert found == {**found, "trial": number, "values": {"effort": min(efforts)}, "runs": [number]}
    asked = ["solve", "--from", "out/study.sqlite", "--run", number, "-o", "one", "--json"]
    status, out, _ = ran(*asked, cwd=tmp_path)
    assert (status, json.loads(out)["effort"]) == (0, pytest.approx(min(efforts)))
    (tmp_path / "out" / "study.sqlite").unlink()
    status, _, errors = ran("sweep", "designs.yaml", "-o", "out", cwd=tmp_path)
    assert (status, "trials of an earlier sweep, whose store is gone" in errors) == (2, True)


def test_without_optuna_it_is_said_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "designs.yaml").write_text(HEAD + TEXT)
    monkeypatch.setitem(sys.modules, "optuna", None)
    status, _, errors = ran("sweep", "designs.yaml", "-o", "out", cwd=tmp_path)
    assert (status, 'pip install "nhpocp[design]"' in errors) == (3, True)
    assert not (tmp_path / "out").exists()
    assert said("check", tmp_path / "designs.yaml")[0] == 0


def test_a_design_that_is_never_feasible_is_no_success(pretend, tmp_path, monkeypatch):
    pretend(fails=lambda parameters: True)
    monkeypatch.setattr("nhpocp.study.sweep.processes", lambda *_: here())
    (tmp_path / "designs.yaml").write_text(HEAD + TEXT.replace("20", "5"))
    status, out, _ = ran("sweep", "designs.yaml", "-o", "out", cwd=tmp_path)
    assert (status, "5 trials, 5 of them with failed runs: none is feasible\n" in out) == (1, True)
