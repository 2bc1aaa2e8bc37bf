"""What `nhpocp` offers: all that a file can name, written as a file writes it, with numbers of any kind."""

import copy
import pickle
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import nhpocp
from nhpocp import deg
from nhpocp.controls.registry import BASES
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.solvers.continuation import settings as continuation
from nhpocp.solvers.nlp import settings as nlp
from nhpocp.solvers.registry import SOLVERS
from nhpocp.solvers.settings import KERNELS
from tests.conftest import paper_problem

ROOT = Path(__file__).parents[2]
FAMILIES = [
    BASES,
    continuation.STEP_RULES,
    continuation.INVERSES,
    continuation.METRICS,
    continuation.INTEGRATORS,
    continuation.SENSITIVITIES,
    nlp.TRANSCRIPTIONS,
    nlp.OPTIMIZERS,
    nlp.GUESSES,
    KERNELS,
]


def test_all_that_a_file_can_name_is_public():
    members = [family[name] for family in FAMILIES for name in family] + [system_class(m) for m in SYSTEMS]
    members += [type(SOLVERS[name]().solver(None, {})) for name in SOLVERS]
    for changes in ({"step_rule": "auto"}, {"starts": 2, "step_rule": "euler"}):
        members.append(type(continuation.JacobianSettings(**changes).solver(None, {})))
    for member in members:
        assert getattr(nhpocp, member.__name__, None) is member


@pytest.mark.parametrize("document", ["README.md", "nhpocp/README.md", "problems/recipes.md"])
def test_documents_import_from_nhpocp_itself(document):
    text = (ROOT / document).read_text(encoding="utf-8")
    assert not re.findall(r"^from nhpocp\.(?!testing ).*", text, flags=re.MULTILINE)


def test_an_import_loads_nothing_else():
    code = "import sys; before = set(sys.modules); import nhpocp; print(*sorted(set(sys.modules) - before))"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    assert {name.partition(".")[0] for name in said.split()} <= {"nhpocp"} | set(sys.stdlib_module_names)
    assert [name for name in said.split() if name.startswith("nhpocp")] == ["nhpocp"]


HALF = 0.5**0.5
WRITTEN = [  # a turn by -90 deg about z
    {"rpy": [0, 0, -90 * deg]},
    {"rpy": (0, np.float32(0), -np.pi / 2)},
    {"quaternion": np.array([HALF, 0, 0, -HALF])},
    {"rotvec": [0, 0, -90 * deg]},
    {"matrix": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]},
    np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
]


@pytest.mark.parametrize("orientation", WRITTEN, ids=str)
@pytest.mark.parametrize(
    "position", [[0, 0, 35], (0, 0, 35), np.array([0, 0, 35], dtype=np.int8), [0, 0, Fraction(35)]]
)
def test_poses_are_written_as_in_a_file_and_with_any_numbers(orientation, position):
    goal = paper_problem(goal={"position": position, "orientation": orientation}).goal
    np.testing.assert_allclose(goal["orientation"], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-7)
    assert goal["position"].tolist() == [0, 0, 35]


@pytest.mark.parametrize("kind", [float, int, np.float32, np.int64, np.array, Fraction])
def test_numbers_of_every_kind_are_taken(kind):
    two = kind(2)
    problem = paper_problem(
        system=nhpocp.ThreeUPU(base_radius=kind(30)), horizon=two, error_length=two, samples=kind(5),
        bounds={"leg_speed": kind(200), "clearance": kind(0)},
        via=[{"at": Fraction(1, 2), "position": [0, 0, two + 28]}],
    )  # fmt: skip
    assert (problem.horizon.fixed, problem.samples, problem.via[0].share) == (2.0, 5, 0.5)
    assert nhpocp.Fourier(kind(2)) == nhpocp.Fourier(2)
    assert nhpocp.Euler(two).gamma == 2.0
    assert nhpocp.MultipleShooting(intervals=kind(4)).intervals == 4
    assert type(nhpocp.RungeKutta4(kind(7)).steps) is int


def test_a_horizon_is_a_number_or_a_mapping():
    assert paper_problem(horizon=2.0).horizon == nhpocp.Horizon(2.0)
    free = paper_problem(horizon={"min": 0.5, "max": np.float64(3), "initial": 1}).horizon
    assert free == nhpocp.Horizon(1.0, 0.5, 3.0)


ONE_SIDED = [
    {"max": 20 * deg},
    [None, 20 * deg],
    (-np.inf, 20 * deg),
    {"min": None, "max": np.float32(20 * deg)},
]


@pytest.mark.parametrize("written", ONE_SIDED, ids=str)
def test_bounds_are_written_as_in_a_file_with_one_side_or_two(written):
    problem = paper_problem(
        bounds={
            "leg_length": np.array([5, 100]),
            "joint_angle": {"theta4": written},
            "state": {"position": {"min": [-10, -10, 15]}},
            "control": [[-9, 9], {"max": 9}, {"min": -9}],
        }
    )
    lengths, angle, box, control = problem.bounds
    assert (lengths.quantity, lengths.lower, lengths.upper) == ("leg_lengths", 5, 100)
    np.testing.assert_allclose(angle.upper, [np.inf, np.inf, np.inf, 20 * deg], rtol=1e-6)
    assert np.isneginf(angle.lower).all()
    assert np.isposinf(box.upper).all()
    assert np.asarray(control.lower).tolist() == [-9, -np.inf, -9]


@pytest.mark.parametrize(
    "made",
    [
        paper_problem(bounds={"leg_length": [20, 60]}, via=[{"at": 0.5, "position": [0, 0, 30]}]),
        nhpocp.Control(nhpocp.Fourier(1), [[1, 2, 3]]),
        nhpocp.Bound("state.position", "position", [0, 0, 0], np.inf),
        nhpocp.Via(0.5, {"position": np.array([0.0, 0, 30])}),
    ],
    ids=lambda made: type(made).__name__,
)
def test_what_holds_arrays_equals_its_copies_and_has_a_hash(made):
    for twin in (copy.deepcopy(made), pickle.loads(pickle.dumps(made)), nhpocp.replace(made)):
        assert twin == made
        assert hash(twin) == hash(made)
    changes = {"PlanningProblem": {"horizon": 2.0}, "Control": {"horizon": 2.0}, "Bound": {"lower": 1.0}}
    assert nhpocp.replace(made, **changes.get(type(made).__name__, {"share": 0.4})) != made
    assert made != 3


def test_files_and_solvers_go_by_name(tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(
        "nhpocp: 1\nsystem: {model: heisenberg}\nstart: {x: 0, y: 0, z: 0}\ngoal: {x: 0, y: 0, z: 1}\n"
        "solvers: {nlp: {intervals: 6}, jacobian: {step_rule: adaptive}}\noutput: {pictures: false}\n"
    )
    by_name = nhpocp.solve(file, "nlp")
    assert (by_name.solver, by_name.settings["intervals"]) == ("nlp", 6)
    solution = nhpocp.solve(str(file))
    assert solution.settings["step_rule"] == "adaptive"
    comparison = nhpocp.compare(file, "jacobian")
    assert [entry.variant for entry in comparison.entries] == ["jacobian"]
    folder = nhpocp.save_solution(solution, tmp_path / "kept")
    assert nhpocp.verify(folder).ok
    assert nhpocp.load_solution(folder) == nhpocp.load_solution(str(folder))
    problem = nhpocp.load_problem(file)
    motion = nhpocp.simulate(problem, solution.control)
    np.testing.assert_allclose(motion.trajectory["z"], solution.trajectory["z"], atol=1e-9)
    assert nhpocp.write_animation(solution, tmp_path / "motion.html").exists()
    assert nhpocp.analyze(file).points


DOUBTFUL = [  # changes, path, words
    ({"goal": {"orientation": {"rpy": [0, 0, -90]}}}, "goal.orientation.rpy[2]", r"write -90 \* nhpocp.deg"),
    ({"goal": {"position": [0, 0, 25]}}, "goal", "the same as start"),
    ({"bounds": {"leg_length": [1, 20]}}, "start", "no plan can begin there"),
    ({"error_length": 1e4}, "error_length", "lets positions be off"),
    ({"objective": "time"}, "objective", "time is fixed by horizon"),
    (
        {"via": [{"at": 0.7, "orientation": {"rotvec": [0, 0, 30]}}, {"at": 0.2, "position": [0, 0, 30]}]},
        "via[0].orientation.rotvec[2]",
        "turns",
    ),
]  # fmt: skip


def test_obstacles_that_nothing_keeps_away_from_are_doubted():
    with pytest.warns(nhpocp.NhpocpWarning, match="obstacles: nothing asks to keep away from them"):
        nhpocp.load_problem(ROOT / "problems" / "corridor.yaml", ["constraints={}"])


@pytest.mark.parametrize(("changes", "path", "words"), DOUBTFUL)
def test_what_check_doubts_is_a_warning_at_the_users_line(changes, path, words):
    problem = paper_problem(**changes)
    with pytest.warns(nhpocp.NhpocpWarning, match=words) as heard:
        nhpocp.simulate(problem, problem.initial)
    (told,) = [one for one in heard if str(one.message).startswith(f"{path}: ")]
    assert told.filename == __file__


def test_nothing_is_said_of_a_sound_problem_and_a_files_doubts_are_said_once(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error", nhpocp.NhpocpWarning)
        nhpocp.simulate(paper_problem(), paper_problem().initial)
    file = tmp_path / "still.yaml"
    file.write_text("nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {x: 0}\n")
    with pytest.warns(nhpocp.NhpocpWarning, match="goal: the same as start"):
        problem = nhpocp.load_problem(file)
    with warnings.catch_warnings():
        warnings.simplefilter("error", nhpocp.NhpocpWarning)
        nhpocp.simulate(problem, np.zeros((2, 5)))
    with pytest.warns(nhpocp.NhpocpWarning, match="the same as start"):
        nhpocp.simulate(replace(problem, name="other"), np.zeros((2, 5)))


FUNCTIONS = {
    1: "sin cos tan arctan sinh cosh tanh arcsinh exp log log10 sqrt abs sign floor ceil arcsin arccos arctanh",
    2: "arctan2 atan2 minimum maximum hypot",
}


@pytest.mark.parametrize(
    ("count", "name"), [(k, name) for k, names in FUNCTIONS.items() for name in names.split()]
)
def test_numbers_and_symbols_have_the_same_functions(count, name):
    numbers = [np.array([0.3, 0.7]), np.array([0.5, 0.2])][:count]
    symbols = [ca.SX.sym("x", 2) for _ in range(count)]
    value = getattr(nhpocp.namespace(*symbols), name)(*symbols)
    wanted = getattr(nhpocp.namespace(*numbers), name)(*numbers)
    np.testing.assert_allclose(np.ravel(ca.Function("f", symbols, [value])(*numbers)), wanted, rtol=1e-14)
