"""The house's floors: imports point down only (README's map), heavy libraries stay in their rooms."""

import ast
import importlib
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "nhpocp"
FLOORS = {
    0: ("arrays", "calls", "deferred", "errors", "frozen", "kept", "machine", "so3", "state_space", "whole"),
    1: ("systems", "controls"),
    2: ("flow", "solution", "problem", "task", "constraints", "objectives", "scales"),
    3: ("solvers",),
    4: ("planning", "foreseen", "batch", "verification", "comparison", "analysis", "views"),
    5: ("problem_file", "solution_folder", "comparison_folder", "analysis_folder", "sweep", "diagnosis"),
    6: ("__main__", "cli"),
}
CHAINS = [  # inside a floor: a group may import the groups to its right, never those to its left
    ["state_space", "so3", "arrays"],
    ["state_space", "frozen", "errors"],
    ["calls", "arrays kept"],
    ["controls", "controls.basis", "controls.table"],
    ["systems", "systems.system"],
    ["flow.end_point_map flow.simulation", "flow.variational", "flow.integrators flow.kernels"],
    ["solution", "problem", "task constraints", "scales objectives"],
    ["solvers.lockstep", "solvers.strategies", "solvers.continuation", "solvers.generalized_inverses"],
    ["solvers.multiple_shooting", "solvers.shooting_run", "solvers.transcription", "solvers.interval"],
    ["solvers.multiple_shooting", "solvers.strategies", "solvers.generalized_inverses"],
    ["comparison batch", "planning", "verification foreseen"],
    ["views", "analysis", "verification"],
    ["views.film", "views.animation", "views.scene views.curves", "views.plots views.drawing", "views.style"],
    ["analysis.analysis", "analysis.verdict analysis.agility", "analysis.growth", "analysis.brackets"],
    ["sweep diagnosis comparison_folder analysis_folder", "problem_file solution_folder"],
]
ROOMS = {
    "matplotlib": ("views",),
    "mpl_toolkits": ("views",),
    "PIL": ("views",),
    "jinja2": ("views",),
    "dask": ("sweep",),
    "distributed": ("sweep",),
    "ruamel": ("problem_file", "solution_folder"),
    "yaml": ("problem_file", "solution_folder"),
    "click": ("cli",),
    "rich": ("cli",),
}


def module_name(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(ROOT.rglob("*.py"))}
MODULES.pop("__init__", None)  # lazy, and exempt


def within(module, group):
    return any(module == name or module.startswith(f"{name}.") for name in group)


def imports(module):
    """Full names of everything a module imports, wherever the statement stands."""
    path = MODULES[module]
    package = ["nhpocp", *path.relative_to(ROOT).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                yield inner if inner.removeprefix("nhpocp.") in MODULES else base
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
            yield from (a.value for a in node.args if isinstance(a, ast.Constant))


GRAPH = {
    module: {name.removeprefix("nhpocp.") for name in imports(module) if name.startswith("nhpocp.")}
    - {module}
    for module in MODULES
}


def floor(module):
    (found,) = [number for number, group in FLOORS.items() if within(module, group)]
    return found


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_down_only(module):
    for target in GRAPH[module]:
        assert target in MODULES, f"{module} imports nhpocp.{target}, which does not exist"
        assert floor(target) <= floor(module), f"{module} (floor {floor(module)}) imports {target}"
    for chain in CHAINS:
        # the most specific group decides: controls.basis stands right of controls
        def place(name, chain=chain):
            fits = [(len(g), i) for i, part in enumerate(chain) for g in part.split() if within(name, [g])]
            return max(fits)[1] if fits else None

        for target in GRAPH[module]:
            if place(module) is not None and place(target) is not None:
                assert place(module) <= place(target), (
                    f"{module} imports {target}: against {' -> '.join(chain)}"
                )


def test_no_module_imports_in_a_circle():
    assert list(TopologicalSorter(GRAPH).static_order())  # raises CycleError and names the circle


def test_nobody_inside_uses_the_public_door():
    for module in MODULES:
        assert "nhpocp" not in set(imports(module)) or module == "cli", f"{module} imports from nhpocp itself"


def test_verification_shares_nothing_with_what_it_judges():
    seen, waiting = set(), ["verification"] if "verification" in MODULES else []
    while waiting:
        module = waiting.pop()
        seen.add(module)
        waiting += GRAPH[module] - seen
    assert not [module for module in seen if within(module, ("flow", "solvers"))]


@pytest.mark.parametrize("module", MODULES)
def test_heavy_libraries_stay_in_their_rooms(module):
    for name in imports(module):
        rooms = ROOMS.get(name.partition(".")[0])
        assert rooms is None or within(module, rooms), f"{module} imports {name}: only in {', '.join(rooms)}"


@pytest.mark.skipif("problem_file" not in MODULES, reason="no problem_file yet")
def test_checking_a_problem_file_loads_neither_numpy_nor_casadi():
    files = [str(path) for path in sorted((ROOT.parent / "problems").glob("*.yaml"))]
    if not files or not hasattr(importlib.import_module("nhpocp.problem_file"), "read"):
        pytest.skip("nothing to read yet")
    code = (
        "import sys\n"
        "from nhpocp.problem_file import read\n"
        "for file in sys.argv[1:]:\n"
        "    read(file)\n"
        "assert not {'numpy', 'casadi', 'scipy', 'matplotlib'} & set(sys.modules), 'a heavy library was loaded'\n"
    )
    subprocess.run([sys.executable, "-c", code, *files], check=True)
