"""Standard streams that are closed or in another encoding, and names that are not UTF-8."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from nhpocp.cli.entry import status

PROBLEM = str(Path(__file__).parents[2] / "problems" / "unicycle.yaml")
QUICK = ["--set", "output.pictures=false"]
posix = pytest.mark.skipif(os.name != "posix", reason="the shell of POSIX, names as bytes")


def shell(redirections, *arguments, cwd, **environment):
    """The program under `sh`, its streams as the redirections say."""
    line = f'exec "$@" {redirections}'
    return subprocess.run(
        ["sh", "-c", line, "sh", sys.executable, "-m", "nhpocp", *arguments],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        timeout=300,
        check=False,
    )


@posix
@pytest.mark.parametrize("closed", ["2>&-", ">&-", "<&-", ">&- 2>&- <&-"])
def test_a_closed_stream_loses_nothing_but_what_it_would_have_shown(closed, tmp_path):
    done = shell(closed, "solve", PROBLEM, *QUICK, "-o", "out", cwd=tmp_path)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    assert json.loads((tmp_path / "out" / "solution.json").read_text(encoding="utf-8"))["converged"]
    assert bool(done.stdout) == (">&-" not in closed.replace("2>&-", ""))


@posix
@pytest.mark.parametrize("verb", [["check", PROBLEM], ["check", PROBLEM, "--json"], ["systems"], ["--help"]])
def test_verbs_that_only_say_something_say_it_to_nobody(verb, tmp_path):
    done = shell(">&-", *verb, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a file that is always full")
@pytest.mark.parametrize(
    ("verb", "ended", "says"),
    [
        (["check", PROBLEM, "--set", "start.theta=90"], 0, b": ok"),
        (["check", "gone.yaml", "--json"], 2, b"no such file"),
        (["checks", "--json"], 2, b"No such command"),
    ],
)
def test_messages_that_nobody_takes_are_done_without(verb, ended, says, tmp_path):
    assert shell("", *verb, cwd=tmp_path).stderr
    done = shell("2>/dev/full", *verb, cwd=tmp_path)
    assert done.returncode == ended
    assert says in done.stdout


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "cp437", "ascii"])
def test_what_an_encoding_lacks_is_an_escape(encoding, tmp_path, capsys):
    done = shell("", "systems", cwd=tmp_path, PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"three_upu") or b"three_upu: " in done.stdout
    document = shell("", "systems", "--json", cwd=tmp_path, PYTHONIOENCODING=encoding)
    assert status(["systems", "--json"]) == 0
    assert json.loads(document.stdout.decode(encoding)) == json.loads(capsys.readouterr().out)


@posix
def test_names_that_are_not_text_are_names(tmp_path):
    folder = b"cmp\xff"
    few = ["--set", "solvers.nlp.intervals=8", "--set", "solvers.nlp.mesh_check=false"]
    done = shell("", "compare", PROBLEM, *QUICK, *few, "--json", "-o", folder, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, b"")
    for text in (
        done.stdout,
        (Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + folder)) / "comparison.json").read_bytes(),
    ):
        places = [row["folder"] for row in json.loads(text.decode("utf-8"))["runs"]]
        assert [os.fsencode(place) for place in places] == [
            folder + b"/unicycle/jacobian",
            folder + b"/unicycle/nlp",
        ]
    again = shell("", "compare", "--from", folder, "-o", folder, cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, b"")
    assert b"report: cmp\\udcff" in again.stdout
