"""The house as nhpocp/README.md draws it: imports point down and along arrows, heavy libraries stay in their rooms."""

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / "nhpocp"


def drawn(text):
    """Floors (room → number) and arrows (room → rooms on the same floor) of the map's lines."""
    floors, arrows, number = {}, {}, None
    for line in text.splitlines():
        given, chain = re.fullmatch(r"(\d)?\s+(.*)", line).groups()
        number = int(given) if given else number
        groups = [[name.strip().replace("/", ".") for name in part.split(",")] for part in chain.split("->")]
        for group, targets in zip(groups, [*groups[1:], []], strict=True):
            for room in group:
                floors.setdefault(room, number)
                assert floors[room] == number, f"{room} stands on two floors"
                arrows.setdefault(room, set()).update(targets)
    return floors, arrows


def reached(graph, start):
    """All that arrows lead to, from one node."""
    seen, waiting = set(), [start]
    while waiting:
        new = graph[waiting.pop()] - seen
        seen |= new
        waiting += new
    return seen


FLOORS, ARROWS = drawn(
    re.search(r"## The map.*?```\n(.*?)\n```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)[1]
)
ROOMS = {
    "matplotlib": ("views",),
    "mpl_toolkits": ("views",),
    "PIL": ("views",),
    "jinja2": ("views",),
    "IPython": ("views",),
    "pandas": ("solution_folder",),
    "ruamel": ("problem_file",),
    "pydantic": ("problem_file", "solution_folder", "study"),
    "sqlite3": ("study",),
    "pyarrow": ("study",),
    "optuna": ("study",),
    "sqlalchemy": ("study",),
    "mcap": ("machine",),
    "mujoco": ("machine.simulation",),
    "ompl": ("solvers.route",),
    "click": ("cli",),
    "rich": ("cli",),
}


def module_name(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(ROOT.rglob("*.py"))}
MODULES.pop("__init__", None)  # lazy, and exempt
ANNOUNCED = re.compile(r"nhpocp\.([\w.]+):\w+")


def within(module, group):
    return any(module == name or module.startswith(f"{name}.") for name in group)


@cache
def read(module):
    """Full names of everything a module imports, wherever the statement stands, and all its texts."""
    path = MODULES[module]
    package = ["nhpocp", *path.relative_to(ROOT).parts[:-1]]
    names, texts = set(), set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                names.add(inner if inner.removeprefix("nhpocp.") in MODULES else base)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
            names.update(a.value for a in node.args if isinstance(a, ast.Constant))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            texts.add(node.value)
    return names, texts


def imports(module):
    return read(module)[0]


@cache
def graph():
    return {
        module: {name.removeprefix("nhpocp.") for name in imports(module) if name.startswith("nhpocp.")}
        - {module}
        for module in MODULES
    }


@cache
def room(module):
    """The innermost room of the map that a module is in; the package of a room alone is in none."""
    names = [name for name in FLOORS if within(module, [name])]
    return max(names, key=len, default=None)


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_down_and_along_the_arrows(module):
    here = room(module)
    if here is None:  # a package with rooms in it holds words only
        assert not graph()[module]
        return
    for target in graph()[module]:
        assert target in MODULES, f"{module} imports nhpocp.{target}, which does not exist"
        there = room(target)
        down = FLOORS[there] < FLOORS[here] or there == here or there in reached(ARROWS, here)
        assert down, (
            f"{module} (floor {FLOORS[here]}) imports {target}: the map leads nowhere from {here} to {there}"
        )


def test_the_map_shows_what_there_is():
    assert {room(module) for module in MODULES} - {None} == set(FLOORS)
    assert list(TopologicalSorter(ARROWS).static_order())
    used = {(room(module), room(target)) for module in MODULES for target in graph()[module]}
    assert {(here, there) for here in ARROWS for there in ARROWS[here]} <= used, (
        "an arrow that nobody goes along"
    )


def test_no_module_imports_in_a_circle():
    assert list(TopologicalSorter(graph()).static_order())  # raises CycleError and names the circle


def announced(module):
    """The modules that a module's lines "nhpocp.module:name" name, to be imported when they are asked for."""
    lines = map(ANNOUNCED.fullmatch, read(module)[1])
    return {line[1] for line in lines if line}


@pytest.mark.parametrize(
    "module",
    [
        module
        for module, path in MODULES.items()
        if module != "shown" and re.search(f'"{ANNOUNCED.pattern}"', path.read_text(encoding="utf-8"))
    ],
)
def test_families_announce_what_is_not_above_them(module):
    assert announced(module)
    for target in announced(module):
        assert FLOORS[room(target)] <= FLOORS[room(module)], f"{module} announces {target} of a higher floor"


def test_what_shows_objects_stands_above_them_and_exists():
    for target in announced("shown"):
        assert room(target) in ("views", "solution_folder")
    views = importlib.import_module("nhpocp.shown").VIEWS
    assert all(callable(views[name]) for name in views)


def test_nobody_inside_uses_the_public_door():
    for module in MODULES:
        assert "nhpocp" not in set(imports(module)) or module == "cli", f"{module} imports from nhpocp itself"


def test_verification_shares_nothing_with_what_it_judges():
    seen = {
        name for module in MODULES if within(module, ["verification"]) for name in reached(graph(), module)
    }
    assert not [module for module in seen if within(module, ("flow", "solvers"))]


@pytest.mark.parametrize("module", MODULES)
def test_heavy_libraries_stay_in_their_rooms(module):
    for name in imports(module):
        rooms = ROOMS.get(name.partition(".")[0])
        assert rooms is None or within(module, rooms), f"{module} imports {name}: only in {', '.join(rooms)}"


@pytest.mark.skipif("problem_file" not in MODULES, reason="no problem_file yet")
def test_checking_a_problem_file_loads_no_casadi():
    files = [str(path) for path in sorted((ROOT.parent / "problems").glob("*.yaml"))]
    if not files or not hasattr(importlib.import_module("nhpocp.problem_file"), "read"):
        pytest.skip("nothing to read yet")
    code = (
        "import sys\n"
        "from nhpocp.problem_file import read\n"
        "for file in sys.argv[1:]:\n"
        "    read(file)\n"
        "assert not {'casadi', 'scipy', 'matplotlib'} & set(sys.modules), 'a heavy library was loaded'\n"
    )
    subprocess.run([sys.executable, "-c", code, *files], check=True)
