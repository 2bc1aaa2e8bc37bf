"""What the tests share: the paper's task on a preset, and small systems with known answers."""

from __future__ import annotations

import atexit
import contextlib
import gc
import io
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

os.environ.setdefault("OMP_NUM_THREADS", "1")  # pytest-xdist already uses every core
os.environ["NHPOCP_CACHE"] = tempfile.mkdtemp(
    prefix="nhpocp-cache-"
)  # of this process of tests and its children
os.environ["NHPOCP_COMPILE"] = "never"  # `auto` builds nothing in the background of tests

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser
from PIL import Image

from nhpocp import interruption, so3
from nhpocp.arrays import namespace
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.compiled import kernel_build, kernels
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.runge_kutta import scheme
from nhpocp.flow.tableau import CLASSICAL
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import document, load_problem, parse_problem
from nhpocp.problem_file.starters import starter
from nhpocp.solvers.least_cost.barrier import barrier_map
from nhpocp.state_space import StateSpace, rotation, scalar
from nhpocp.systems.system import Parameter, System
from nhpocp.systems.three_upu import ThreeUPU

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # begun in the background of a script
    signal.signal(signal.SIGINT, signal.default_int_handler)
document.parse = cache(document.parse.__wrapped__)  # the same few texts, thousands of times
interruption.PATIENCE = 60.0  # the machine may be busy; tests of what nobody looks at set it themselves
atexit.register(shutil.rmtree, os.environ["NHPOCP_CACHE"], ignore_errors=True)


READ_FORMULA, FORMULAS = MathTextParser._parse_cached.__wrapped__, {}


def formula(parser: MathTextParser, *given: Any) -> Any:
    """A formula as matplotlib sets it, which reads it again for every picture."""
    key = parser._output_type, *given
    if key not in FORMULAS:
        FORMULAS[key] = READ_FORMULA(parser, *given)
    return FORMULAS[key]


MathTextParser._parse_cached = formula


def pytest_collection_finish() -> None:
    """What thousands of tests consist of is no garbage: without looking for it 1122 of them took 72 s for 76."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


# [Paper] section 4: λ11 = λ21 = λ32 = .5, λ30 = 1
PAPER_START = np.array([[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])


def yaw(angle: float) -> np.ndarray:
    return so3.from_rpy(np.array([0.0, 0.0, angle]))


@contextlib.contextmanager
def compiled_briefly() -> Iterator[None]:
    """Kernels are built in half the time that -O3 takes, and are half as fast."""
    with pytest.MonkeyPatch.context() as patch:
        quick = ("-O1", "-fPIC", "-shared")
        patch.setattr(kernel_build, "FLAGS", ((*quick, "-march=native"), quick))
        yield


def swift(system: System) -> System:
    """The system, whose sweeps and barrier are compiled from the first on, where there is a compiler.

    Nearly all that continuations do is sweep: 100 steps take 4.6 ms by CasADi's own evaluation and 0.28 by a kernel;
    both take 2.3 s to build. Users have them once a first plan is made; tests/flow/compiled holds both to each other.
    """
    if not kernels._of_sweeps(scheme(dynamics(system), CLASSICAL)).kernel:
        problem, rule = parse_problem(starter(system.model)).with_(system=system), kernels.Compiled()
        basis, integrator = Fourier(0), RungeKutta4(1, rule)
        controls = np.full((1, system.input_space.size, basis.size), 0.1)
        with compiled_briefly():
            flow = integrator.flow(dynamics(system), basis, 1.0)
            flow.ends(problem.start_point, controls, differentiated=False)
            if barrier := barrier_map(problem, basis, 1.0, integrator):
                barrier(controls[0])
    return system


preset_robot = cache(ThreeUPU.preset)


def robot(preset: str) -> ThreeUPU:
    """One robot of each preset for all tests: what is built for it is built once."""
    made = preset_robot(preset)
    return (
        swift(made) if preset == "default" else made
    )  # the others are asked for too little to pay for kernels


LIBRARY = sorted(path.stem for path in (Path(__file__).parents[1] / "problems").glob("*.yaml"))


@cache
def library_problem(name: str) -> PlanningProblem:
    """One object of each problem of the library for all tests, as of `robot`."""
    return load_problem(Path(__file__).parents[1] / "problems" / f"{name}.yaml")


def paper_problem(preset: str = "default", **changes: Any) -> PlanningProblem:
    """The paper's task on one preset; ``changes`` go to `PlanningProblem`, except ``form`` and geometry."""
    geometry = {name: changes.pop(name) for name in list(changes) if name in ThreeUPU.declared}
    values: dict[str, Any] = {
        "system": ThreeUPU.preset(preset, **geometry) if geometry else robot(preset),
        "start": {"position": [0, 0, 25], "orientation": yaw(-np.pi / 6)},
        "goal": {"position": [-0.4, -0.2, 35], "orientation": yaw(-np.pi / 2)},
        "initial": PAPER_START,
        "pictures": False,
    }
    return PlanningProblem(**{**values, **changes})


class Runaway(System):
    """ẋ = x² u: escapes to infinity in finite time."""

    model: ClassVar[str] = "runaway"
    declared: ClassVar[Mapping[str, Parameter]] = {}
    state_space = StateSpace([scalar("x")])
    input_space = StateSpace([scalar("u")])

    def parameters(self) -> dict[str, Any]:
        return {}

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).rows([state * state])


class Integrators(System):
    """ẋ = u, ẏ = w: everything about it is linear."""

    model: ClassVar[str] = "integrators"
    declared: ClassVar[Mapping[str, Parameter]] = {}
    state_space = StateSpace([scalar("x"), scalar("y")])
    input_space = StateSpace([scalar("u"), scalar("w")])

    def parameters(self) -> dict[str, Any]:
        return {}

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).eye(2)


class Turntable(System):
    """A Veselova joint on a table that turns, seen from the room: drift on R × SO(3), ω = (u1, u2, 0) + speed ẑ."""

    model: ClassVar[str] = "turntable"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "speed": Parameter("number", 0.7, "of the table [rad/time]")
    }
    state_space = StateSpace([scalar("angle", "angle"), rotation("orientation")])
    input_space = StateSpace([scalar("u1", "angle"), scalar("u2", "angle")])
    speed: float

    def vector_fields(self, state: Any) -> Any:
        xp = namespace(state)
        c, s = xp.cos(state[0]), xp.sin(state[0])
        return xp.matrix([[0, 0], [c, -s], [s, c], [0, 0]])

    def drift(self, state: Any) -> Any:
        return namespace(state).vector([self.speed, 0, 0, self.speed])

    def constraints(self, state: Any, velocity: Any) -> Any:
        return namespace(velocity).vector([velocity[0] - self.speed, velocity[3] - velocity[0]])


@pytest.fixture
def slow_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    """No kernel is there before a test asks for one: for tests of kernels, and of plans that other processes make.

    There a robot has no kernel, and plans are the same to the last bit only where it has none here.
    """
    monkeypatch.setattr(sys.modules[__name__], "swift", lambda system: system)
    kernels._of_sweeps.cache_clear()


@pytest.fixture
def problem() -> PlanningProblem:
    return paper_problem()


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = ("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A headless Chromium of this machine; tests that need one skip where it is absent."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here: install it to see the pages in a browser")
    playwright = pytest.importorskip("playwright.sync_api", reason="the test extra is not installed")
    with playwright.sync_playwright() as running:
        chromium = running.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", "--disable-quic", *QUIET]
        )
        yield chromium
        chromium.close()


def axe_violations(page: Any) -> list[str]:
    """What axe-core holds against the accessibility of an open page: rule and first element."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [f"{rule['id']}: {rule['help']}: {rule['nodes'][0]['html']}" for rule in found]


def _pixel() -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (1, 1)).save(stream, "PNG")
    return stream.getvalue()


BLANK = {"svg": b'<svg viewBox="0 0 1 1"></svg>', "png": _pixel(), "pdf": b"%PDF-1.4\n"}


@pytest.fixture
def undrawn(monkeypatch):
    draw_nothing(monkeypatch)


def draw_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made and become empty files, for tests of what stands beside them; tests/views draws them."""

    def save(figure: Figure, file: Any, **how: Any) -> None:
        drawing = BLANK[how.get("format") or Path(file).suffix[1:]]
        if isinstance(file, io.StringIO):
            file.write(drawing.decode())
        elif isinstance(file, io.BytesIO):
            file.write(drawing)
        else:
            Path(file).write_bytes(drawing)

    monkeypatch.setattr(Figure, "savefig", save)
