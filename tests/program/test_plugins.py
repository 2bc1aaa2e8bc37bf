"""What other distributions add to families: throw-away ones on sys.path, whole and broken in every way."""

from __future__ import annotations

import json
import sys
import warnings
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import nhpocp
from nhpocp import plugins
from nhpocp.cli.entry import status
from nhpocp.controls.registry import BASES
from nhpocp.errors import InvalidProblemError
from nhpocp.installation import EXTENSIBLE
from nhpocp.installation import plugins as diagnosed
from nhpocp.problem_file import json_schema, parse_problem, read_text, starter, systems
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.solvers.registry import SOLVERS, made_solver

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
    """Makes a distribution of one module with entry points, in a folder of its own, and puts that on the path."""
    modules = []

    def installed(text: str, *names: str, target: str = "Ferry", group: str = "nhpocp.systems") -> str:
        module = f"throw_away_{next(numbers)}"
        modules.append(module)
        place = tmp_path / "installed" / module
        info = place / f"{module}-1.2.dist-info"
        info.mkdir(parents=True)
        (place / f"{module}.py").write_text(text, encoding="utf-8")
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.2\n", encoding="utf-8"
        )
        points = "\n".join(f"{name} = {module}:{target}" for name in names or ("ferry",))
        lines = f"[console_scripts]\nx = y:z\n\n[{group}]\n# ours\n{points}\n"
        (info / "entry_points.txt").write_text(lines, encoding="utf-8")
        monkeypatch.syspath_prepend(str(place))
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

    monkeypatch.setattr(SYSTEMS, "plugins", refuse)
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
    assert set(systems()) == set(SYSTEMS.lines)
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
    with pytest.warns(nhpocp.NhpocpWarning, match="unicycle is a name of nhpocp itself"):
        assert dict(SYSTEMS)["unicycle"].__module__ == "nhpocp.systems.unicycle"
    assert any("never used" in line for line in diagnosed())


# --- every family -----------------------------------------------------------------------------------------------------

HEAD = """
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
import nhpocp
from nhpocp import declared, namespace
"""
MEMBERS = {
    "nhpocp.bases": """
@dataclass(frozen=True)
class Member(nhpocp.Legendre):
    kind: ClassVar = "member"
""",
    "nhpocp.objectives": """
class Member(nhpocp.PathObjective):
    name, symbol, meaning, pace = "member", "m", "m", -1
    def scale(self, scales): return 1.0
    def integrand(self, system, state, control, length_scale): return control[0] ** 2
""",
    "nhpocp.constraints": """
class Member(nhpocp.ConstraintKind):
    key, meaning, shape = "member", "m", "number"
    def bounds(self, value, system): return [nhpocp.Bound("member", "x", -value, value)]
    def value(self, bounds, system): return float(bounds[-1].upper)
""",
    "nhpocp.step_rules": """
class Member(nhpocp.StepRule):
    kind = "member"
    def updates(self, here, evaluate): yield here
    def settings(self): return {}
""",
    "nhpocp.solvers": """
@dataclass(frozen=True)
class Member(nhpocp.SolverSettings):
    meaning: ClassVar = "m"
    def solver(self, kernels, others): return nhpocp.Auto()
""",
    "nhpocp.systems": """
class Member(nhpocp.Unicycle):
    model = "member"
""",
}
OF_GROUP = {family.group.name: family for family in EXTENSIBLE}


def test_every_group_is_tried_here():
    assert set(MEMBERS) == set(OF_GROUP)


@pytest.mark.parametrize("group", MEMBERS)
def test_a_member_from_elsewhere_is_one_of_its_family_and_comes_last(group, install):
    family = OF_GROUP[group]
    before = list(family)
    module = install(HEAD + MEMBERS[group], "member", target="Member", group=group)
    assert list(family) == [*before, "member"]
    assert len(family) == len(before) + 1
    assert "member" in family
    member = family["member"]
    assert module in (getattr(member, "__module__", ""), type(member).__module__)
    assert family.faults() == []
    assert family.group.noun.split()[0] in ("a", "an")
    assert f"member, {family.group.noun} (the plugin {module}:Member of {module} 1.2)" in diagnosed()
    assert "did you mean 'member'" in family.unknown("membre")


FAULTS = {
    "does not import": (lambda text: "import no_such_module", "cannot be loaded: ModuleNotFoundError"),
    "raises as it is imported": (
        lambda text: "1 / 0",
        "cannot be loaded: ZeroDivisionError: division by zero",
    ),
    "no such class": (
        lambda text: text.replace("class Member", "class Other"),
        "cannot be loaded: AttributeError",
    ),
    "no member": (lambda text: "class Member: pass", "is no subclass of nhpocp."),
    "no class": (lambda text: "Member = 3", "is no subclass of nhpocp."),
    "cannot be made": (
        lambda text: f"{text.rstrip()}\n    def __init__(self): raise KeyError('x')\n",
        "fails: KeyError: 'x'",
    ),
    "called otherwise": (lambda text: text.replace('"member"', '"other"'), "'other'; expected 'member'"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("group", MEMBERS)
def test_a_broken_member_is_left_out_with_one_sentence(group, fault, install):
    spoil, words = FAULTS[fault]
    if fault == "called otherwise" and not OF_GROUP[group].group.called:
        return  # settings have no name of their own; the solver's is held against it when it is made
    family, before = OF_GROUP[group], list(OF_GROUP[group])
    text = spoil(MEMBERS[group])
    module = install(HEAD + text, "member", target="Member", group=group)
    with pytest.warns(nhpocp.NhpocpWarning) as heard:
        assert [list(family) for _ in range(3)] == [before] * 3
    (told,) = [str(one.message) for one in heard if one.category is nhpocp.NhpocpWarning]
    assert told.startswith(f"the plugin {module}:Member of {module} 1.2 ")
    assert words in told
    assert "\n" not in told
    with pytest.raises(InvalidProblemError, match=f"of {module} 1.2"):
        family["member"]
    assert told in family.unknown("member")
    assert told in family.faults()
    assert told in diagnosed()


@pytest.mark.parametrize("group", MEMBERS)
@pytest.mark.parametrize("which", ["own", "reserved"])
def test_names_that_mean_something_already_are_never_taken(group, which, install):
    family = OF_GROUP[group]
    names = list(family.lines) if which == "own" else list(family.group.reserved)
    if not names:
        return
    before = {name: family[name] for name in family}
    install(HEAD + MEMBERS[group].replace('"member"', repr(names[0])), names[0], target="Member", group=group)
    with pytest.warns(nhpocp.NhpocpWarning, match=f"is never used: {names[0]} is a name of nhpocp itself"):
        assert dict(family) == before


def test_a_name_that_no_file_can_write_is_refused(install):
    install(HEAD + MEMBERS["nhpocp.bases"], "a.b", target="Member", group="nhpocp.bases")
    with pytest.warns(nhpocp.NhpocpWarning, match=r"is called 'a\.b'; expected letters"):
        assert "a.b" not in list(BASES)


def test_a_solver_that_calls_itself_otherwise_is_refused(install):
    install(HEAD + MEMBERS["nhpocp.solvers"], "member", target="Member", group="nhpocp.solvers")
    with pytest.raises(InvalidProblemError, match="a solver that calls itself 'jacobian'; expected 'member'"):
        made_solver("member", SOLVERS["member"]())


def test_a_plugin_that_fails_while_it_runs_is_named_without_a_traceback(install, tmp_path, capsys):
    text = FERRY.replace("def outputs", "def input_label(self):\n        return self.bow\n\n    def outputs")
    module = install(text)
    file = tmp_path / "over.yaml"
    file.write_text(PROBLEM, encoding="utf-8")
    assert status(["solve", str(file), "-o", str(tmp_path / "out"), "--json"]) == 2
    said = capsys.readouterr()
    sentence = f"the plugin {module}:Ferry of {module} 1.2 fails: AttributeError: 'Ferry' object has no attribute 'bow'"
    assert said.err.splitlines()[-1] == sentence
    assert json.loads(said.out)["error"]["message"] == sentence
    with pytest.raises(AttributeError):
        status(["--debug", "solve", str(file), "-o", str(tmp_path / "out")])


def test_a_fault_of_nhpocp_itself_is_blamed_on_no_plugin(install):
    install(FERRY)
    with pytest.raises(TypeError) as caught:
        nhpocp.Fourier(2).table(None, 1.0)
    assert plugins.fault(caught.value) == ""


def test_distributions_are_read_as_pip_and_setuptools_leave_them(tmp_path, monkeypatch):
    wheel, egg, bare = (
        tmp_path / name for name in ("sea_boats-2.0.dist-info", "Lakes.egg-info", "ponds-1.dist-info")
    )
    for folder, point in (
        (wheel, "ferry = boats:Ferry [fast]"),
        (egg, "raft=boats.small : Raft"),
        (bare, "punt = p:P"),
    ):
        folder.mkdir()
        (folder / "entry_points.txt").write_text(
            f"; of ours\n[nhpocp.systems]\n{point}\n\n[other]\nx = y:z\n"
        )
    (wheel / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: Sea-Boats\nVersion: 2.0\n\nName: of a harbour\n"
    )
    (egg / "PKG-INFO").write_text("Metadata-Version: 2.1\nName: Lakes\nVersion: 0.1\n")
    (tmp_path / "file.dist-info").write_text("no folder")
    monkeypatch.setattr(
        sys, "path", [str(tmp_path), str(tmp_path / "none"), str(tmp_path / "file.dist-info"), *sys.path]
    )
    points = plugins.announced("nhpocp.systems")
    assert {name: str(point) for name, (point,) in points.items()} == {
        "ferry": "the plugin boats:Ferry of Sea-Boats 2.0",
        "raft": "the plugin boats.small:Raft of Lakes 0.1",
        "punt": "the plugin p:P of ponds 1",
    }
    assert plugins.announced("other") == {}


def test_what_cannot_be_read_back_is_said_when_it_is_saved(tmp_path):
    @dataclass(frozen=True)
    class Own(nhpocp.Legendre):
        kind: ClassVar[str] = "own"

    problem = nhpocp.PlanningProblem(
        system=nhpocp.Unicycle(),
        start={"x": 0, "y": 0, "theta": 0},
        goal={"x": 1},
        basis=Own(1),
        pictures=False,
    )
    plan = nhpocp.solve(problem)
    with pytest.warns(
        nhpocp.NhpocpWarning, match=r"'own' is a basis that no file can name.*nhpocp\.bases"
    ) as heard:
        nhpocp.save_solution(plan, tmp_path / "own")
    assert [one.filename for one in heard] == [__file__]
    with pytest.raises(nhpocp.UnreadableSolutionError, match="unknown basis 'own'"):
        nhpocp.load_solution(tmp_path / "own")
    with warnings.catch_warnings():
        warnings.simplefilter("error", nhpocp.NhpocpWarning)
        known = nhpocp.solve(replace(problem, basis=nhpocp.Legendre(1)))
        nhpocp.save_solution(known, tmp_path / "known")


def test_every_folder_is_read_once(tmp_path, monkeypatch):
    """`check` has a third of a second; a family asks whenever it is looked into."""
    read = []
    own = plugins._in
    monkeypatch.setattr(plugins, "_in", lambda folder: read.append(folder) or own(folder))
    monkeypatch.syspath_prepend(str(tmp_path))
    for _ in range(3):
        for family in EXTENSIBLE:
            list(family)
    assert read
    assert len(read) == len(set(read))
