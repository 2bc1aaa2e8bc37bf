"""The command line as a user meets it: verbs, exit statuses, JSON, messages."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROBLEMS = Path(__file__).parents[1] / "problems"
FAST = ["--set", "solvers.jacobian.gamma=1", "--set", "output.pictures=false"]


def run(*arguments, cwd, **options):
    """One process of the CLI; text output."""
    command = [sys.executable, "-c", "from nhpocp.cli import main; main()", *map(str, arguments)]
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
    done = run("solve", PROBLEMS / "paper.yaml", *FAST, "--set", "name=mine", cwd=tmp_path)
    assert done.returncode == 0
    assert "converged" in done.stdout
    assert (tmp_path / "results" / "mine" / "jacobian" / "solution.json").exists()


@pytest.mark.parametrize("gamma", [0.1, 0.5])
def test_the_papers_evaluations(gamma, tmp_path):
    done = run(
        *("solve", PROBLEMS / "paper.yaml", "--set", f"solvers.jacobian.gamma={gamma}"),
        *("--set", "output.pictures=false", "--json"),
        cwd=tmp_path,
    )
    assert json.loads(done.stdout)["evaluations"] == {0.1: 70, 0.5: 12}[gamma]


def test_paper_conjecture_reports_its_crossings(tmp_path):
    """[physics §2]: det W = 0 at yaw -62.0° (t ≈ .540) and -77.7° (t ≈ .852); (3) stops at the first."""
    done = run(
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
    done = run(
        *("solve", PROBLEMS / "paper.yaml", "--set", "solvers.jacobian.max_iterations=2"),
        *("--set", "output.pictures=false", "-o", "out"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "iteration_limit" in done.stdout
    assert json.loads((tmp_path / "out" / "solution.json").read_text())["converged"] is False


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
        done = run(*arguments, "--json", cwd=tmp_path)
        assert done.returncode == 2, arguments
        assert json.loads(done.stdout)["error"]["message"]
        assert "Traceback" not in done.stderr


def test_a_foreign_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    done = run("solve", PROBLEMS / "paper.yaml", *FAST, "-o", tmp_path, cwd=tmp_path)
    assert done.returncode == 2
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that not even root may write")
def test_unwritable_folder(tmp_path):
    done = run("solve", PROBLEMS / "paper.yaml", *FAST, "-o", "/proc/nhpocp/out", cwd=tmp_path)
    assert done.returncode == 2
    assert "/proc/nhpocp/out: cannot write here" in done.stderr


def test_folder_below_a_file_exits_2(tmp_path):
    (tmp_path / "file").write_text("")
    done = run("solve", PROBLEMS / "paper.yaml", *FAST, "-o", "file/out", cwd=tmp_path)
    assert done.returncode == 2
    assert "cannot write here" in done.stderr


def test_verify_confirms_and_refutes(solved, tmp_path):
    folder, _ = solved
    assert run("verify", folder, cwd=tmp_path).returncode == 0
    data = json.loads(run("verify", folder, "--json", cwd=tmp_path).stdout)
    assert data["verified"]["ok"] is True
    forged = tmp_path / "forged"
    forged.mkdir()
    for path in folder.iterdir():
        (forged / path.name).write_bytes(path.read_bytes())
    solution = json.loads((forged / "solution.json").read_text())
    solution["control"]["coefficients"][2][0] += 1e-2
    (forged / "solution.json").write_text(json.dumps(solution))
    done = run("verify", forged, cwd=tmp_path)
    assert done.returncode == 1
    assert "refuted" in done.stdout
    assert run("verify", tmp_path, cwd=tmp_path).returncode == 2


def test_plot_draws_into_the_folder(solved, tmp_path):
    folder, _ = solved
    done = run("plot", folder, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    pictures = json.loads(done.stdout)["pictures"]
    assert len(pictures) >= 5
    assert all(Path(picture).stat().st_size > 1000 for picture in pictures)


def test_check_names_every_file(tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("nhpocp: 1\n")
    done = run("check", *sorted(PROBLEMS.glob("*.yaml")), bad, cwd=tmp_path)
    assert done.returncode == 2
    assert "paper.yaml: ok" in done.stdout
    assert "bad.yaml" in done.stderr
    filled = json.loads(run("check", PROBLEMS / "paper.yaml", "--json", cwd=tmp_path).stdout)
    assert filled["problem"]["solvers"]["jacobian"]["integrator"] == "rk4"


def test_check_stays_light(tmp_path):
    """What keeps `check` and --help quick: no NumPy, CasADi, SciPy or Matplotlib."""
    for arguments in (["--help"], ["check", str(PROBLEMS / "paper.yaml")]):
        code = (
            "import sys; sys.argv[1:] = " + repr(arguments) + "\n"
            "from nhpocp.cli import main\n"
            "try: main()\nexcept SystemExit as e: assert e.code == 0\n"
            "heavy = {'numpy', 'casadi', 'scipy', 'matplotlib'} & set(sys.modules)\n"
            "assert not heavy, heavy"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def test_init_writes_a_file_that_checks(tmp_path):
    assert run("init", "mine.yaml", cwd=tmp_path).returncode == 0
    assert run("check", "mine.yaml", cwd=tmp_path).returncode == 0
    again = run("init", "mine.yaml", cwd=tmp_path)
    assert again.returncode == 2
    assert "left alone" in again.stderr


def test_systems_schema_doctor(tmp_path):
    systems = json.loads(run("systems", "--json", cwd=tmp_path).stdout)
    assert "base_radius" in systems["three_upu"]["defaults"]
    assert "three_upu" in run("systems", cwd=tmp_path).stdout
    assert json.loads(run("schema", cwd=tmp_path).stdout)["type"] == "object"
    doctor = json.loads(run("doctor", "--json", cwd=tmp_path).stdout)
    assert "ipopt" in doctor["nlp solvers"]
    assert doctor["casadi"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_solve_leaves_a_readable_folder(number, tmp_path):
    """Slow on purpose: γ = 1e-4 would need 100 000 updates."""
    process = subprocess.Popen(
        [
            *(
                sys.executable,
                "-c",
                "from nhpocp.cli import main; main()",
                "solve",
                str(PROBLEMS / "paper.yaml"),
            ),
            *("--set", "solvers.jacobian.gamma=1e-4", "--set", "solvers.jacobian.max_iterations=100000"),
            *("--set", "output.pictures=false", "-o", "out"),
        ],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    # the kernel hides the loop's start from us: by 4 s of processor time the imports are over
    while process.poll() is None and _processor_seconds(process.pid) < 4:
        time.sleep(0.1)
    process.send_signal(number)
    _, messages = process.communicate(timeout=60)
    assert process.returncode == 1, messages
    data = json.loads((tmp_path / "out" / "solution.json").read_text())
    assert data["outcome"] == "interrupted"
    assert data["evaluations"] > 1
    assert run("verify", "out", cwd=tmp_path).returncode == 1


def _processor_seconds(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
