"""scripts/_environment: what it refuses, mends and installs. pip is a stub: no network."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
# pip notes where it was asked to install; the program is there afterwards
PIP = """
import sys
import tomllib
from pathlib import Path
if "install" in sys.argv:
    (Path(sys.prefix) / "installed").write_text(" ".join(sys.argv))
    program = Path(sys.prefix) / "bin" / "nhpocp"
    program.write_text("#!/bin/sh\\n")
    program.chmod(0o755)
"""
# a Python whose environments have that pip
MAKER = f"""#!{sys.executable}
import os, subprocess, sys
from pathlib import Path
if sys.argv[1:3] != ["-m", "venv"]:
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
subprocess.run([sys.executable, "-m", "venv", "--without-pip", *sys.argv[3:]], check=True)
(packages,) = Path(sys.argv[-1]).glob("lib/python*/site-packages")
(packages / "pip").mkdir()
(packages / "pip" / "__init__.py").touch()
(packages / "pip" / "__main__.py").write_text({PIP!r})
"""
OLD = "#!/bin/sh\ncase $1 in --version) echo Python 3.10.13 ;; *) exit 1 ;; esac\n"

pytestmark = pytest.mark.skipif(os.name != "posix", reason="scripts for a POSIX shell")


def program(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.fixture
def clone(tmp_path):
    """What the set-up reads of a clone, and beside it a Python to make environments with."""
    folder = tmp_path / "clone"
    shutil.copytree(ROOT / "scripts", folder / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    (folder / "nhpocp").mkdir()
    program(tmp_path / "maker", MAKER)
    return folder


def set_up(clone, **variables):
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("NHPOCP", "PYTHON"))
    }
    return subprocess.run(
        ["sh", "-c", 'extras=""; . scripts/_environment'],
        cwd=clone,
        env={**environment, "PYTHON": str(clone.parent / "maker"), **variables},
        capture_output=True,
        text=True,
        timeout=120,
    )


def installed(clone, name=".venv"):
    return (clone / name / "installed").read_text() if (clone / name / "installed").exists() else None


def bare(clone):
    """As an interrupted set-up leaves it: before pip came."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(clone / ".venv")], check=True)


def without_python(clone):
    bare(clone)
    shutil.rmtree(clone / ".venv" / "bin")


def python_is_gone(clone):
    """As after an upgrade of the system: the link leads nowhere."""
    bare(clone)
    (clone / ".venv" / "bin" / "python").unlink()
    (clone / ".venv" / "bin" / "python").symlink_to("/nowhere/python3")


def pip_is_broken(clone):
    bare(clone)
    (packages,) = (clone / ".venv").glob("lib/python*/site-packages")
    (packages / "pip").mkdir()  # a namespace: it can be imported, not run


def python_of_another_home(clone):
    bare(clone)
    base = Path(sys.base_prefix) / "bin" / "python3"
    (clone / ".venv" / "bin" / "python").unlink()
    program(clone / ".venv" / "bin" / "python", f'#!/bin/sh\nexec {base} "$@"\n')


def nothing(clone):
    pass


def empty(clone):
    (clone / ".venv").mkdir()


@pytest.mark.parametrize(
    "left",
    [nothing, empty, bare, without_python, python_is_gone, pip_is_broken, python_of_another_home],
    ids=lambda left: left.__name__,
)
def test_what_an_interrupted_set_up_left_is_made_anew(left, clone):
    left(clone)
    run = set_up(clone)
    assert (run.returncode, run.stderr) == (0, "")
    assert "making the environment" in run.stdout
    assert "--only-binary :all:" in installed(clone)
    assert "--constraint scripts/constraints.txt" in installed(clone)
    assert set_up(clone).stdout == ""  # all is there


def test_an_interrupted_installation_is_begun_again_in_the_same_environment(clone):
    set_up(clone)
    (clone / ".venv" / "installed").unlink()
    (clone / ".venv" / ".nhpocp").unlink()  # written last
    run = set_up(clone)
    assert run.returncode == 0
    assert "making" not in run.stdout
    assert installed(clone)


@pytest.mark.parametrize(
    ("name", "words"), [("old", "is Python 3.10.13"), ("none", "is no Python that runs")]
)
@pytest.mark.parametrize("made", [False, True])
def test_a_python_that_is_too_old_is_refused_before_anything_is_made(made, name, words, clone):
    if made:
        set_up(clone)
    program(clone.parent / "old", OLD)
    before = sorted(clone.rglob("*"))
    run = set_up(clone, PYTHON=str(clone.parent / name))
    assert (run.returncode, run.stdout) == (3, "")
    assert f"needs Python 3.11 or newer; PYTHON={clone.parent / name} {words}" in run.stderr
    assert sorted(clone.rglob("*")) == before


def base_python(clone):
    (clone / ".venv" / "bin").mkdir(parents=True)
    (clone / ".venv" / "bin" / "python").symlink_to(Path(sys.base_prefix) / "bin" / "python3")


def own_folder(clone):
    (clone / ".venv").mkdir()
    (clone / ".venv" / "thesis.tex").write_text("mine")


@pytest.mark.parametrize("left", [base_python, own_folder], ids=lambda left: left.__name__)
def test_a_folder_that_is_no_environment_is_refused_and_left_alone(left, clone):
    left(clone)
    before = sorted(clone.rglob("*"))
    run = set_up(clone)
    assert (run.returncode, run.stdout) == (3, "")
    assert f"{clone / '.venv'} is no virtual environment" in run.stderr
    assert sorted(clone.rglob("*")) == before


def test_another_place_may_be_named_from_the_root(clone):
    assert set_up(clone, NHPOCP_VENV="elsewhere").returncode == 0
    assert installed(clone, "elsewhere")
    assert not (clone / ".venv").exists()


@pytest.mark.parametrize(("lowest", "newest"), [(0, 0), (1, 0), (0, 1)])
def test_the_whole_check_removes_its_environments_and_fails_if_either_fails(lowest, newest, clone):
    (clone / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", clone / ".ci")
    program(clone / "bin" / "chromium", "#!/bin/sh\n")  # none is looked for
    for name, status in (("test_lowest", lowest), ("test", newest)):
        text = f'#!/bin/sh\nmkdir "$NHPOCP_VENV"\necho {name}: {status} failed\nexit {status}\n'
        program(clone / "scripts" / name, text)
    (clone / "tmp").mkdir()
    variables = {"TMPDIR": str(clone / "tmp"), "PATH": f"{clone / 'bin'}:{os.environ['PATH']}"}
    run = subprocess.run([clone / ".ci" / "run"], env=variables, capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stderr) == (max(lowest, newest), "")
    assert run.stdout == f"test_lowest: {lowest} failed\ntest: {newest} failed\n"
    assert list((clone / "tmp").iterdir()) == []


# --- versions --------------------------------------------------------------------------------------------------------


def pins(name):
    lines = (ROOT / "scripts" / name).read_text(encoding="utf-8").splitlines()
    return dict(re.fullmatch(r"([\w.-]+)==([\w.]+)", line).groups() for line in lines)


def test_the_lowest_versions_that_are_tested_are_those_that_are_stated():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    everywhere = [line for line in project["dependencies"] if ";" not in line]
    stated = dict(re.match(r"([\w.-]+)>=([\w.]+)", line).groups() for line in everywhere)
    assert len(stated) == len(everywhere)
    lowest = {name.lower(): version for name, version in pins("constraints-lowest.txt").items()}
    assert {name: lowest[name] for name in stated} == stated


def test_the_version_is_cited_as_it_is():
    cited = YAML(typ="safe", pure=True).load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_the_same_tools_test_both():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tools = [re.match(r"[\w.-]+", line).group() for line in project["optional-dependencies"]["test"]]
    tools.remove("pandas")  # a library of the extra `notebook`, which goes with NumPy's version
    lowest, newest = pins("constraints-lowest.txt"), pins("constraints.txt")
    assert f"pandas>={lowest['pandas']}" in project["optional-dependencies"]["notebook"]
    assert {name: lowest[name] for name in tools} == {name: newest[name] for name in tools}
