"""Systems of other distributions: a throw-away one on sys.path, whole and broken in every way."""

from __future__ import annotations

import json
import sys
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp.cli.entry import status
from nhpocp.errors import InvalidProblemError
from nhpocp.installation import plugins as diagnosed
from nhpocp.problem_file import json_schema, parse_problem, plugins, read_text, starter, systems
from nhpocp.problem_file.registry import SYSTEMS, every_class

FERRY = Path(__file__).parents[1].joinpath("ferry.py").read_text(encoding="utf-8")
PROBLEM = """\
nhpocp: 1
name: over
system: {model: ferry, current: 0.3}
start: {position: [0, 0], theta: 0}
goal: {bow: [0, 2]}
constraints: {state: {bow: [[-5, -5], [5, 5]]}}
solvers: {jacobian: {step_rule: adaptive}, nlp: {intervals: 20}}
output: {samples: 21, pictures: false}
"""
numbers = count()


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Makes a distribution of one module with entry points, and puts it on the path."""
    monkeypatch.syspath_prepend(str(tmp_path))
    modules = []

    def installed(text: str, *names: str, target: str = "Ferry") -> str:
        module = f"throw_away_{next(numbers)}"
        modules.append(module)
        (tmp_path / f"{module}.py").write_text(text, encoding="utf-8")
        info = tmp_path / f"{module}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.2\n", encoding="utf-8"
        )
        points = "\n".join(f"{name} = {module}:{target}" for name in names or ("ferry",))
        (info / "entry_points.txt").write_text(f"[nhpocp.systems]\n{points}\n", encoding="utf-8")
        return module

    yield installed
    for module in modules:
        sys.modules.pop(module, None)


def test_a_plugins_system_is_one_like_any_other(install, tmp_path, capsys, monkeypatch):
    module = install(FERRY)
    monkeypatch.chdir(tmp_path)
    Path("over.yaml").write_text(PROBLEM, encoding="utf-8")
    assert status(["check", "over.yaml"]) == 0
    for solver in ("jacobian", "nlp"):
        assert status(["solve", "over.yaml", "--solver", solver, "-o", solver]) == 0
        assert status(["verify", solver]) == 0
    stored = nhpocp.load_solution("nlp")
    assert stored.problem.system.parameters() == {"current": 0.3}
    np.testing.assert_allclose(stored.trajectory["bow"][-1], [0, 2], atol=1e-5)
    assert status(["compare", "over.yaml", "-o", "both"]) == 0
    capsys.readouterr()
    assert status(["systems", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ferry"]["defaults"] == {"current": 0.5}
    assert status(["init", "new.yaml", "--system", "ferry"]) == 0
    assert status(["check", "new.yaml"]) == 0
    assert status(["solve", "new.yaml", "--set", "output.pictures=false", "-o", "new"]) == 0
    assert "system_ferry" in json_schema()["definitions"]
    assert any(module in line for line in diagnosed())


@pytest.mark.parametrize("line", ["{model: ferry, current: fast}", "{model: ferry, curent: 1}"])
def test_a_plugins_parameters_are_checked_as_ours(install, line):
    install(FERRY)
    with pytest.raises(InvalidProblemError, match="current") as caught:
        read_text(PROBLEM.replace("{model: ferry, current: 0.3}", line))
    assert caught.value.line == 3


def test_unknown_models_are_compared_with_plugins_too(install):
    install(FERRY)
    with pytest.raises(InvalidProblemError, match="did you mean 'ferry'"):
        read_text(PROBLEM.replace("model: ferry", "model: fery"))
    with pytest.raises(InvalidProblemError, match="did you mean 'ferry'"):
        starter("fery")


def test_known_models_ask_no_distribution(monkeypatch):
    def refuse():
        raise AssertionError("looked through every installed distribution")

    monkeypatch.setattr(plugins, "installed", refuse)
    text = "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {y: 1}\n"
    assert parse_problem(text).system.model == "unicycle"
    assert "unicycle" in starter("unicycle")


BROKEN = {
    "does not import": ("import no_such_module\n", "ModuleNotFoundError: No module named 'no_such_module'"),
    "no Python": ("class Ferry(:\n", "SyntaxError"),
    "raises as it is imported": ("1 / 0\n", "ZeroDivisionError: division by zero"),
    "no such class": ("Boat = 1\n", "AttributeError"),
    "no class": ("Ferry = 1\n", "no subclass of nhpocp.System"),
    "no system": ("class Ferry: model = 'ferry'\n", "no subclass of nhpocp.System"),
    "another name": (
        FERRY.replace('model = "ferry"', 'model = "boat"'),
        "calls its model 'boat'; expected 'ferry'",
    ),
    "cannot be made": (
        FERRY.replace("    def heading", "    def __init__(self, current=1): self.x = y\n\n    def heading"),
        "NameError: name 'y' is not defined",
    ),
    "no state space": (FERRY.replace("    state_space = ", "    state_spice = "), "no state_space"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_plugin_is_named_and_harms_no_other(install, name, capsys, tmp_path):
    text, words = BROKEN[name]
    module = install(text)
    file = tmp_path / "over.yaml"
    file.write_text(PROBLEM, encoding="utf-8")
    assert status(["check", str(file)]) == 2
    said = capsys.readouterr().err
    assert f"{file}:3:" in said
    assert module in said
    assert words in said
    assert "Traceback" not in said
    assert status(["systems"]) == 0
    listed = capsys.readouterr()
    assert "unicycle: state x, y, theta" in listed.out
    assert words in listed.err
    assert "Traceback" not in listed.err
    assert set(systems()) == set(SYSTEMS)
    assert "system_unicycle" in json_schema()["definitions"]
    assert any(words in line for line in diagnosed())


EQUATIONS = {
    "unknown name": ("return namespace(state).vector([self.curent, 0, 0])", "AttributeError"),
    "too few": ("return namespace(state).vector([self.current, 0])", "fail at the start"),
    "no symbols": (
        "return __import__('math').sqrt(state[0]) * namespace(state).vector([1, 0, 0])",
        "in NumPy's numbers, but CasADi's",
    ),
}


@pytest.mark.parametrize("name", EQUATIONS)
def test_equations_that_fail_are_named_before_a_solver_meets_them(install, name, tmp_path, capsys):
    line, words = EQUATIONS[name]
    install(FERRY.replace("return namespace(state).vector([self.current, 0, 0])", line))
    with pytest.raises(InvalidProblemError, match=words) as caught:
        parse_problem(PROBLEM)
    assert caught.value.path == "system.model"
    assert caught.value.line == 3


def test_names_claimed_twice_are_refused(install):
    first, second = install(FERRY), install(FERRY)
    with pytest.raises(InvalidProblemError, match="uninstall one") as caught:
        read_text(PROBLEM)
    assert first in str(caught.value)
    assert second in str(caught.value)


def test_a_plugin_cannot_replace_a_model(install):
    install(FERRY.replace('model = "ferry"', 'model = "unicycle"'), "unicycle")
    classes, broken = every_class()
    assert classes["unicycle"].__module__ == "nhpocp.systems.unicycle"
    assert any("unicycle is a model of nhpocp itself" in line for line in broken)
