"""The command line as a user meets it: verbs, exit statuses, JSON, messages."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nhpocp import planning, verification
from nhpocp.cli import solving, verbs
from nhpocp.cli.entry import status
from nhpocp.outcome import Outcome
from nhpocp.solution_folder import load_solution
from nhpocp.views import figures
from tests.test_comparison import here

PROBLEMS = Path(__file__).parents[2] / "problems"
PROGRAM = "from nhpocp.cli import main; main()"
FAST = ["--set", "solvers.jacobian.gamma=1", "--set", "output.pictures=false"]


def run(*arguments, cwd, **options):
    """One process of the CLI; text output."""
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=300, check=False, **options
    )


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """The paper's problem solved once, for the verbs that read folders."""
    folder = tmp_path_factory.mktemp("solved") / "solution"
    done = run("solve", PROBLEMS / "paper.yaml", *FAST, "-o", folder, "--json", cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    return folder, done


def test_solve_json_is_one_document(solved):
    folder, done = solved
    data = json.loads(done.stdout)
    assert data["converged"] is True
    assert data["evaluations"] == 5
    assert data["folder"] == str(folder)
    stored = json.loads((folder / "solution.json").read_text())
    assert {key: data[key] for key in stored} == stored


def test_solve_writes_under_results_by_default(tmp_path):
    done = here("solve", PROBLEMS / "paper.yaml", *FAST, "--set", "name=mine", cwd=tmp_path)
    assert done.returncode == 0
    assert "converged" in done.stdout
    assert (tmp_path / "results" / "mine" / "jacobian" / "solution.json").exists()


@pytest.mark.parametrize("gamma", [0.1, 0.5])
def test_the_papers_evaluations(gamma, tmp_path):
    done = here(
        *("solve", PROBLEMS / "paper.yaml", "--set", f"solvers.jacobian.gamma={gamma}"),
        *("--set", "output.pictures=false", "--json"),
        cwd=tmp_path,
    )
    assert json.loads(done.stdout)["evaluations"] == {0.1: 70, 0.5: 12}[gamma]


def test_paper_conjecture_reports_its_crossings(tmp_path):
    """[physics §2]: det W = 0 at yaw -62.0° (t ≈ .540) and -77.7° (t ≈ .852); (3) stops at the first."""
    done = here(
        "solve", PROBLEMS / "paper_conjecture.yaml", "--set", "output.pictures=false", "--json", cwd=tmp_path
    )
    data = json.loads(done.stdout)
    assert (done.returncode, data["converged"]) == (0, True)
    crossings = [c for c in data["crossings"] if c["which"] == "det_w"]
    assert [c["t"] for c in crossings] == pytest.approx([0.540, 0.852], abs=1e-3)
    assert [c["yaw"] * 57.29577951 for c in crossings] == pytest.approx([-62.0, -77.7], abs=0.05)
    original = data["verified"]["original"]
    assert original["ok"] is False
    assert original["reached_t"] == pytest.approx(crossings[0]["t"], abs=2e-3)
    assert any("parallel singularity" in warning for warning in data["warnings"])


def test_failure_is_written_and_exits_1(tmp_path):
    done = here(
        *("solve", PROBLEMS / "paper.yaml", "--set", "solvers.jacobian.max_iterations=2"),
        *("--set", "output.pictures=false", "-o", "out"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "iteration_limit" in done.stdout
    assert json.loads((tmp_path / "out" / "solution.json").read_text())["converged"] is False


@pytest.mark.parametrize("solver", ["jacobian", "nlp"])
@pytest.mark.parametrize("iterations", [2, 100])
def test_trace_writes_the_iterations_beside_the_rest(solver, iterations, tmp_path, capsys):
    """Also of a solve that fails."""
    settings = ["--set", f"solvers.{solver}.max_iterations={iterations}", "--set", "solvers.nlp.intervals=8"]
    arguments = ["solve", str(PROBLEMS / "paper.yaml"), *FAST, *settings, "--solver", solver, "--json"]
    assert status([*arguments, "--trace", "-o", str(tmp_path / "out")]) == (iterations == 2)
    records = json.loads(capsys.readouterr().out)["iterations"]
    with (tmp_path / "out" / "iterations.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(records) > 1
    for row, record in zip(rows, records, strict=True):
        assert {name: float(cell) for name, cell in row.items() if cell} == {
            name: value for name, value in record.items() if value is not None
        }
    assert list(rows[0])[:2] == ["k", "error"]


def test_bad_input_exits_2_with_place_and_suggestion(tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text((PROBLEMS / "paper.yaml").read_text().replace("gamma:", "gama:"))
    done = run("solve", file, "--json", cwd=tmp_path)
    assert done.returncode == 2
    error = json.loads(done.stdout)["error"]
    assert error["path"] == "solvers.jacobian.gama"
    assert error["line"] > 1
    assert "did you mean 'gamma'?" in done.stderr
    assert "Traceback" not in done.stderr
    assert f"bad.yaml:{error['line']}:{error['column']}: solvers.jacobian.gama:" in done.stderr
    assert not (tmp_path / "results").exists()


def test_unusable_arguments_exit_2(tmp_path):
    for arguments in (
        ["solve"],
        ["solve", "missing.yaml"],
        ["sovle", "x"],
        ["solve", "x.yaml", "--solver", "magic"],
    ):
        done = here(*arguments, "--json", cwd=tmp_path)
        assert done.returncode == 2, arguments
        assert json.loads(done.stdout)["error"]["message"]
        assert "Traceback" not in done.stderr


def test_a_foreign_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    done = here("solve", PROBLEMS / "paper.yaml", *FAST, "-o", tmp_path, cwd=tmp_path)
    assert done.returncode == 2
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that not even root may write")
def test_unwritable_folder(tmp_path):
    done = here("solve", PROBLEMS / "paper.yaml", *FAST, "-o", "/proc/nhpocp/out", cwd=tmp_path)
    assert done.returncode == 2
    assert "/proc/nhpocp/out: cannot write here" in done.stderr


def test_folder_below_a_file_exits_2(tmp_path):
    (tmp_path / "file").write_text("")
    done = here("solve", PROBLEMS / "paper.yaml", *FAST, "-o", "file/out", cwd=tmp_path)
    assert done.returncode == 2
    assert "cannot write here" in done.stderr


def test_what_cannot_be_written_is_said_before_the_solve(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(planning, "solve", lambda *_: pytest.fail("solved in vain"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years of work")
    monkeypatch.chdir(tmp_path / "mine")
    for folder in ("../mine", "thesis.tex", "thesis.tex/out", "x" * 300):
        assert status(["solve", str(PROBLEMS / "paper.yaml"), "-o", folder]) == 2
        assert f"{folder}: " in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert status(["solve", str(PROBLEMS / "paper.yaml"), "-o", "."]) == 2
    assert ".: this is the current folder" in capsys.readouterr().err
    assert list((tmp_path / "empty").iterdir()) == []


BELOW = ["--set", "goal={position: [0.3, 0.2, -35], orientation: {rpy: [0, 0, -pi/6]}}"]
ENDINGS = {
    Outcome.CONVERGED: [],
    Outcome.OTHER_COMPONENT: BELOW,
    Outcome.ITERATION_LIMIT: ["--set", "solvers.jacobian.max_iterations=1"],
    Outcome.CONSTRAINT_VIOLATED: [
        "--set",
        "constraints.leg_speed=18",
        "--set",
        "solvers.jacobian={step_rule: euler, gamma: 1, max_iterations: 40}",
    ],
    Outcome.INFEASIBLE: ["--set", "constraints.leg_speed=1"],
    Outcome.SINGULAR_S: ["--set", "control.initial=[[0,0,0,0,0], [0,0,0,0,0], [99,99,99,0,0]]"],
}


@pytest.mark.parametrize("outcome", ENDINGS, ids=lambda outcome: outcome.value)
def test_every_ending_is_reported_in_words_and_in_json(outcome, tmp_path, monkeypatch, capsys):
    """Solved once, and written twice."""
    arguments = ["solve", str(PROBLEMS / "paper.yaml"), *FAST, *ENDINGS[outcome], "-o", str(tmp_path / "out")]
    solve, solved = planning.solve, []

    def solve_once(*given):
        solved.append(solved[0] if solved else solve(*given))
        return solved[-1]

    monkeypatch.setattr(planning, "solve", solve_once)
    assert status(arguments) == (outcome is not Outcome.CONVERGED)
    text = capsys.readouterr().out
    assert f"paper (jacobian): {outcome.value}" in text
    assert f"written: {tmp_path / 'out'}" in text
    assert status([*arguments, "--json"]) == (outcome is not Outcome.CONVERGED)
    assert json.loads(capsys.readouterr().out)["outcome"] == outcome.value
    assert len(solved) == 2


def test_a_report_needs_neither_times_nor_a_verdict(solved, capsys):
    solution = load_solution(solved[0])
    solving.report(replace(solution, verdict=None, timing={}), Path("out"))
    said = capsys.readouterr().out
    assert "build" not in said
    assert "effort" in said


def test_verify_confirms_and_refutes(solved, tmp_path):
    folder, _ = solved
    assert here("verify", folder, cwd=tmp_path).returncode == 0
    data = json.loads(here("verify", folder, "--json", cwd=tmp_path).stdout)
    assert data["verified"]["ok"] is True
    forged = tmp_path / "forged"
    forged.mkdir()
    for path in folder.iterdir():
        (forged / path.name).write_bytes(path.read_bytes())
    solution = json.loads((forged / "solution.json").read_text())
    solution["control"]["coefficients"][2][0] += 1e-2
    (forged / "solution.json").write_text(json.dumps(solution))
    done = here("verify", forged, cwd=tmp_path)
    assert done.returncode == 1
    assert "refuted" in done.stdout
    assert here("verify", tmp_path, cwd=tmp_path).returncode == 2


def test_what_is_no_solution_folder_is_said_and_what_may_be_meant(solved, tmp_path, capsys):
    home = tmp_path / "results"
    shutil.copytree(solved[0], home / "paper" / "jacobian")
    for place, words in (
        (tmp_path / "missing", "there is nothing of this name"),
        (PROBLEMS / "paper.yaml", "this is a file; expected the folder that `nhpocp solve` wrote"),
        (tmp_path, "solution.json is missing"),
        (home, f"solution.json is missing; did you mean {home / 'paper' / 'jacobian'}?"),
    ):
        assert status(["verify", str(place)]) == 2
        assert capsys.readouterr().err == f"{place}: no solution folder: {words}\n"


@pytest.mark.parametrize("verb", ["verify", "plot"])
def test_damaged_folders_exit_2(verb, solved, tmp_path, capsys):
    folder = Path(shutil.copytree(solved[0], tmp_path / "copy"))
    stored = json.loads((folder / "solution.json").read_text())
    damages = {
        "solution.json": [b"", b"[" * 100_000, json.dumps({**stored, "tolerance": 1e9}).encode()],
        "arrays.npz": [b"PK", (folder / "arrays.npz").read_bytes()[:-100]],
        "problem.yaml": [b"nhpocp: [1"],
    }
    for name, contents in damages.items():
        good = (folder / name).read_bytes()
        for content in contents:
            (folder / name).write_bytes(content)
            assert status([verb, str(folder), "--json"]) == 2
            said = capsys.readouterr()
            assert json.loads(said.out)["error"]["file"] == str(folder / name)
            assert str(folder / name) in said.err
        (folder / name).write_bytes(good)
    assert status([verb, str(tmp_path / "missing")]) == 2


def test_plot_draws_into_the_folder(solved, tmp_path):
    folder, _ = solved
    done = here("plot", folder, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    pictures = json.loads(done.stdout)["pictures"]
    assert len(pictures) >= 5
    assert all(Path(picture).stat().st_size > 1000 for picture in pictures)


def test_plot_without_room_exits_2(solved, tmp_path, undrawn):
    folder = Path(shutil.copytree(solved[0], tmp_path / "copy"))
    (folder / "controls.svg").unlink(missing_ok=True)
    (folder / "controls.svg").mkdir()
    done = here("plot", folder, "--json", cwd=tmp_path)
    assert done.returncode == 2
    assert json.loads(done.stdout)["error"]["message"] == "cannot write here: Is a directory"
    assert done.stderr == f"{folder}: cannot write here: Is a directory\n"


@pytest.mark.parametrize("verb", ["systems", "schema", "doctor", "check", "verify", "plot", "init", "solve"])
def test_errors_of_the_operating_system_exit_2(verb, monkeypatch, capsys):
    """Whatever the verb meets that nobody foresaw, such as a folder that vanishes under it."""

    def vanish(*_, **__):
        raise FileNotFoundError(2, "No such file or directory", "gone")

    monkeypatch.setattr(verbs.cli.commands[verb], "callback", vanish)
    needed = {"check": ["x.yaml"], "verify": ["x"], "plot": ["x"], "solve": ["x.yaml"]}.get(verb, [])
    assert status([verb, *needed, "--json"]) == 2
    said = capsys.readouterr()
    place = {"file": "gone", "line": None, "column": None, "path": None}
    assert json.loads(said.out)["error"] == {**place, "message": "No such file or directory"}
    assert said.err == "gone: No such file or directory\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a file that is always full")
def test_a_full_standard_output_exits_2(tmp_path):
    for arguments in (["systems"], ["systems", "--json"], ["check", str(PROBLEMS / "paper.yaml")]):
        code = f"import sys; sys.argv[1:] = {arguments!r}\nfrom nhpocp.cli import main\nmain()"
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [sys.executable, "-c", code],
                cwd=tmp_path,
                stdout=full,
                stderr=subprocess.PIPE,
                text=True,
                check=False,
            )
        assert (done.returncode, done.stderr) == (2, "No space left on device\n")


LIMITED = """
import resource, signal
from nhpocp.cli import main
from nhpocp.views import {room}
before = {room}.{name}
def limited(*arguments):  # what is written from here on fails as on a full disk
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))
    try:
        return before(*arguments)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
{room}.{name} = limited
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of the system")
@pytest.mark.parametrize(
    ("verb", "room", "name", "missing"),
    [
        ("solve", "figures", "write_pictures", "the pictures could not be written (File too large)"),
        ("compare", "animation", "animate_runs", "animation.html could not be written (File too large)"),
        (
            "analyze",
            "analysis_figures",
            "write_pictures",
            "the pictures could not be written (File too large)",
        ),
    ],
)
def test_pictures_without_room_are_a_warning_and_the_rest_is_written(verb, room, name, missing, tmp_path):
    program = [sys.executable, "-c", LIMITED.format(room=room, name=name)]
    one_run = ["--only", "--variant", "jacobian:gamma=1"] if verb == "compare" else []
    done = subprocess.run(
        [*program, verb, str(PROBLEMS / "unicycle.yaml"), *one_run, "--json", "-o", "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert any(missing in warning for warning in json.loads(done.stdout)["warnings"])
    names = {path.name for path in (tmp_path / "out").rglob("*")}
    assert names & {"solution.json", "analysis.json"}
    assert "animation.html" not in names
    assert ("robot.png" in names) == (verb == "compare")


def test_what_is_missing_is_said_in_a_terminal_too(monkeypatch, tmp_path, capsys):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(figures, "write_pictures", full)
    assert status([*SOLVE, "--set", "output.pictures=true", "-o", str(tmp_path / "out")]) == 0
    assert "warning: the pictures could not be written (No space left on device)" in capsys.readouterr().out


def test_check_names_every_file(tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("nhpocp: 1\n")
    done = here("check", PROBLEMS / "paper.yaml", bad, PROBLEMS / "unicycle.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "paper.yaml: ok" in done.stdout
    assert "unicycle.yaml: ok" in done.stdout
    assert "bad.yaml" in done.stderr
    filled = json.loads(here("check", PROBLEMS / "paper.yaml", "--json", cwd=tmp_path).stdout)
    assert filled["problem"]["solvers"]["jacobian"]["integrator"] == "rk4"


def test_check_stays_light(tmp_path):
    """What keeps `check` and --help quick: no CasADi, SciPy or Matplotlib, for --help no NumPy, for `check` no other
    verb."""
    light = {"casadi", "scipy", "matplotlib"}
    others = {f"nhpocp.cli.{verb}" for verb in ("analyzing", "animating", "listing", "solving", "starting")}
    for arguments, absent in (
        (["--help"], light | {"numpy"}),
        (["check", str(PROBLEMS / "paper.yaml")], light | others | {"nhpocp.whole"}),
    ):
        code = (
            "import sys; sys.argv[1:] = " + repr(arguments) + "\n"
            "from nhpocp.cli import main\n"
            "try: main()\nexcept SystemExit as e: assert e.code == 0\n"
            f"heavy = {absent} & set(sys.modules)\n"
            "assert not heavy, heavy"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


FAR = ["--set", "goal.position=[0, 0, 500]", "--set", "constraints.leg_length=[20, 60]"]


def test_a_goal_out_of_the_legs_reach_is_warned_of_and_infeasible(tmp_path, capsys):
    file, words = str(PROBLEMS / "paper.yaml"), "leg_length[0] is 501.1, outside [20, 60]"
    line = f"{file}:13:1: warning: goal: {words}; no plan can end there\n"
    assert status(["check", file, *FAR]) == 0
    assert capsys.readouterr() == (f"{file}: ok\n", line)
    assert status(["check", file, *FAR, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == [f"goal: {words}; no plan can end there"]
    assert status(["solve", file, *FAR, "-o", str(tmp_path / "out"), "--json"]) == 1
    said = capsys.readouterr()
    assert said.err == line
    data = json.loads(said.out)
    assert data["outcome"] == "infeasible"
    assert data["message"].startswith(
        "the goal itself breaks leg_length[0], which is 501.1, outside [20, 60]."
    )
    assert data["evaluations"] == 0
    assert (tmp_path / "out" / "failure.png").stat().st_size > 2000


def test_init_writes_a_file_that_checks(tmp_path):
    assert here("init", "mine.yaml", cwd=tmp_path).returncode == 0
    assert here("check", "mine.yaml", cwd=tmp_path).returncode == 0
    again = here("init", "mine.yaml", cwd=tmp_path)
    assert again.returncode == 2
    assert "left alone" in again.stderr


def test_systems_schema_doctor(tmp_path):
    systems = json.loads(here("systems", "--json", cwd=tmp_path).stdout)
    assert "base_radius" in systems["three_upu"]["defaults"]
    assert "three_upu" in here("systems", cwd=tmp_path).stdout
    schema = here("schema", cwd=tmp_path).stdout
    assert json.loads(schema)["type"] == "object"
    assert here("schema", "--json", cwd=tmp_path).stdout == schema
    doctor = json.loads(here("doctor", "--json", cwd=tmp_path).stdout)
    assert "ipopt" in doctor["nlp solvers"]
    assert doctor["casadi"]


def test_every_verb_takes_json():
    for name, verb in verbs.cli.commands.items():
        assert "--json" in [option for parameter in verb.params for option in parameter.opts], name


# --- stopped by hand -------------------------------------------------------------------------------------------------


def raising(function, times=1):
    """The same function, with Ctrl-C pressed as it begins."""

    def pressed(*arguments, **options):
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)
        return function(*arguments, **options)

    return pressed


SOLVE = ["solve", str(PROBLEMS / "paper.yaml"), *FAST]


@pytest.mark.parametrize(
    ("room", "name", "times", "outcome"),
    [
        (planning, "solve", 1, "interrupted"),  # before the first evaluation
        (planning, "verify", 1, "converged"),
        (solving, "_write", 3, "converged"),
        (figures, "write_pictures", 3, "converged"),
        (np, "savez_compressed", 3, "converged"),
        (shutil, "rmtree", 3, "converged"),  # as the last thing, when the folder is in its place
        (solving, "report", 3, "converged"),
    ],
)
def test_ctrl_c_at_any_stage_leaves_a_folder(room, name, times, outcome, tmp_path, monkeypatch, capsys):
    """Drawing ends, with a warning: numbers alone are worth waiting for."""
    pictures = ["--set", "output.pictures=true"] if room is figures else []
    monkeypatch.setattr(room, name, raising(getattr(room, name), times))
    assert status([*SOLVE, *pictures, "-o", str(tmp_path / "out")]) == (outcome != "converged")
    assert load_solution(tmp_path / "out").outcome.value == outcome
    assert outcome in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert not (tmp_path / "out" / "robot.png").exists()
    warnings = load_solution(tmp_path / "out").warnings
    assert any("pictures could not be written (stopped by hand)" in one for one in warnings) == bool(pictures)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_before_the_solve_leaves_nothing(tmp_path, monkeypatch, capsys):
    from nhpocp import problem_file

    monkeypatch.setattr(problem_file, "read", raising(problem_file.read), raising=False)
    assert status([*SOLVE, "-o", str(tmp_path / "out"), "--json"]) == 1
    said = capsys.readouterr()
    assert "stopped by hand" in said.err
    assert "stopped by hand" in json.loads(said.out)["error"]["message"]
    assert list(tmp_path.iterdir()) == []


def test_a_second_ctrl_c_ends_a_verification(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(planning, "verify", raising(verification.verify, 2))
    assert status([*SOLVE, "-o", str(tmp_path / "out")]) == 1
    assert "stopped by hand" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


SLOW = ["--set", "solvers.jacobian.gamma=1e-4", "--set", "solvers.jacobian.max_iterations=100000"]
SOLVING = """
from pathlib import Path
from nhpocp import planning
from nhpocp.cli import main
solve = planning.solve
def watched(problem, solver, progress=None):
    return solve(problem, solver, lambda record: record["k"] == 2 and Path("solving").touch())
planning.solve = watched
main()
"""


def interrupted(cwd, program, due, *arguments, number=signal.SIGINT):
    """A solve into the folder `out` that gets a signal once that is due; (exit status, messages)."""
    process = subprocess.Popen(
        [sys.executable, "-c", program, "solve", str(PROBLEMS / "paper.yaml"), *arguments, "-o", "out"],
        cwd=cwd,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not due(process.pid):
        time.sleep(0.02)
    process.send_signal(number)
    _, messages = process.communicate(timeout=120)
    return process.returncode, messages


def _processor_seconds(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads processor times there")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_solve_leaves_a_readable_folder(number, tmp_path):
    """Slow on purpose: γ = 1e-4 would need 100 000 updates."""
    given = [*SLOW, "--set", "output.pictures=false"]
    solving = (tmp_path / "solving").exists
    code, messages = interrupted(tmp_path, SOLVING, lambda _: solving(), *given, number=number)
    assert code == 1, messages
    data = json.loads((tmp_path / "out" / "solution.json").read_text())
    assert data["outcome"] == "interrupted"
    assert data["evaluations"] > 1
    assert here("verify", "out", cwd=tmp_path).returncode == 1


@needs_proc
@pytest.mark.parametrize(
    ("problem", "seconds"),
    [*(("fast", seconds) for seconds in (0.2, 0.6, 0.9, 1.3, 1.8, 2.5)), ("slow", 1.0)],
)
def test_ctrl_c_at_any_time(problem, seconds, tmp_path):
    """Ends with a folder, or before anything had been evaluated; machines differ in when that is."""
    given = FAST[:2] if problem == "fast" else [*SLOW, *FAST[2:]]
    code, messages = interrupted(tmp_path, PROGRAM, lambda pid: _processor_seconds(pid) >= seconds, *given)
    if not (tmp_path / "out").exists():
        assert code in (1, -signal.SIGINT), messages  # the latter while Python itself still starts
        assert list(tmp_path.iterdir()) == []
        assert "SystemError" not in messages
        return
    solution = load_solution(tmp_path / "out")
    assert solution.outcome.value in ("interrupted", *(["converged"] if problem == "fast" else []))
    assert code in (0 if solution.converged else 1, -signal.SIGINT), messages  # or at Python's very end
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
