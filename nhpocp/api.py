"""What `nhpocp` offers in Python: the jobs of this package for what a user has at hand, names as well as objects.

A problem may be the name of its file, a solver its name, a solution its folder. What `nhpocp check` doubts is a
`NhpocpWarning` here, and equations from elsewhere are tried out before a solver meets them.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from nhpocp import planning
from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.declared import whole_number
from nhpocp.doubts import doubts
from nhpocp.errors import CallError, InvalidProblemError, NhpocpWarning, describe, expect
from nhpocp.family import Family
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.reading import build, read
from nhpocp.solution import Progress, Solution, Solver, Verdict
from nhpocp.systems.trial import try_out
from nhpocp.views.inline_progress import followed

if TYPE_CHECKING:
    from nhpocp.analysis import Analysis
    from nhpocp.batch import Plan
    from nhpocp.comparison import Comparison, Entry, Run
    from nhpocp.flow.simulation import Motion
    from nhpocp.machine.calibration.calibration import Calibration
    from nhpocp.machine.feedback.plant import Plant
    from nhpocp.machine.feedback.steering import Steered
    from nhpocp.study.sweep import Tally

Named = str | os.PathLike[str]  # of a file or folder
A_PROBLEM = "a PlanningProblem or the name of a problem file"


def load_problem(path: Named, overrides: Sequence[str] = ()) -> PlanningProblem:
    """The problem that a file describes, with its solvers.

    path: of a YAML file as `nhpocp init` writes. overrides: what `--set` takes, such as "solvers.jacobian.gamma=0.5".
    Errors: `InvalidProblemError` with file, line and column. Warns, as `NhpocpWarning`, of what is hardly meant.
    """
    problem, words = _loaded(path, overrides)
    _warn(words)
    return problem


def solve(
    problem: PlanningProblem | Named, solver: Solver | str | None = None, progress: Progress | None = None
) -> Solution:
    """Solves a problem, then verifies the solution by an independent integration.

    problem: a `PlanningProblem`, or the name of its file. solver: a solver such as `Auto()` or `MultipleShooting()`, or
    the name of one, "jacobian" or "nlp", with the problem's settings; by default its Jacobian method. progress: called
    with a record after every evaluated control; in a notebook, without it, a few lines show how far the solve is.
    The `Solution` has `outcome`, `message`, `converged`, `control`, `costs` and `trajectory`, arrays by name, samples
    first: "t" (samples,) [time], "position" (samples, 3) [length], "orientation" (samples, 3, 3), inputs and outputs.
    A solve that fails is an outcome of the solution, no error.
    Errors: `InvalidProblemError` for what is no problem or no solver, or a problem that the solver cannot take. Warns,
    as `NhpocpWarning`, of what is hardly meant.
    """
    made = _problem(problem)
    with followed(progress, made.name) as listener:
        return planning.solve(made, solver, listener)


def plan_many(
    problem: PlanningProblem | Named,
    goals: Iterable[Mapping[str, Any]],
    solver: Solver | str | None = None,
    executor: Executor | None = None,
    together: int = 64,
) -> Iterator[Plan]:
    """Plans for many goals of one problem, in their order, unverified: 1000 a second where the method is adaptive.

    problem: a `PlanningProblem`, or the name of its file. goals: each a mapping like a problem's goal, as
    {"position": [0, 0, 30]} [length]. solver: as of `solve`. executor: a ProcessPoolExecutor for more cores. together:
    goals that are planned side by side; memory grows with them.
    Each `Plan` has `outcome`, `message`, `error` (E), `control` and `evaluations`.
    Errors: `InvalidProblemError` for a goal that is none, after the plans for those before it. Ctrl-C ends the series.
    """
    from nhpocp import batch

    if isinstance(goals, Mapping | str) or not isinstance(goals, Iterable):
        hint = "; write [goal] for a single one" if isinstance(goals, Mapping) else ""
        raise CallError(f"goals: expected several goals, each a mapping, got {describe(goals)}{hint}")
    made = _problem(problem)
    return batch.plan_many(made, goals, planning.chosen_solver(made, solver), executor, together)


def compare(
    problems: PlanningProblem | Run | Named | Sequence[PlanningProblem | Run | Named],
    variants: str | Sequence[str] = ("jacobian", "nlp"),
    progress: Progress | None = None,
    finished: Callable[[Solution, Run], str | None] | None = None,
) -> Comparison:
    """Solves problems by several methods and lays the verified solutions side by side.

    problems: one or several, each a `PlanningProblem`, the name of its file, or a `Run` with a solver of its own.
    variants: names of solvers, by each of which every problem is solved. progress: as of `solve`. finished: called with
    each solution and its run as soon as it ends, to store it; returns where, or None.
    The `Comparison` has `entries`, `groups` (a problem each), `rows()` and `to_csv()`; costs in each problem's units. A
    run that fails is an entry that says why.
    Errors: `InvalidProblemError` for what is no problem, or an unknown name of a solver.
    """
    from nhpocp import comparison

    many = list(problems) if isinstance(problems, list | tuple) else [problems]
    if not many:
        raise CallError(f"problems: expected at least one, each {A_PROBLEM}, got none")
    wanted = [variants] if isinstance(variants, str) else variants
    made = [item if isinstance(item, comparison.Run) else _problem(item) for item in many]
    with followed(progress) as listener:
        return comparison.compare(made, wanted, listener, finished)


def sweep(
    study: Named,
    folder: Named | None = None,
    *,
    workers: int | None = None,
    make: Callable[[], Executor] | None = None,
    resume: bool = False,
) -> Tally:
    """Performs the runs of a study file, each verified and stored as it ends: a row in ``folder``/study.sqlite.

    study: of a YAML file as `nhpocp init --study` writes. folder: results/NAME of the study unless named. workers:
    processes, one for every core. make: makes the executor to work in instead, which is shut down at the end, such as
    ``lambda: ProcessPoolExecutor(8)`` or ``lambda: DaskExecutor("tcp://first:8786")``. resume: run what the store
    there does not have yet. The `Tally` says how many are solved and verified; `Store.open` reads the rows. Processes
    are begun anew, so a script guards what it does by ``if __name__ == "__main__":``. Ctrl-C ends it, and the tally
    says why it ``stopped``. Errors: `InvalidProblemError`, as for a store that is there without being asked for.
    """
    from nhpocp.solution_folder import folder_name
    from nhpocp.study.study import read_study
    from nhpocp.study.sweep import opened
    from nhpocp.study.sweep import sweep as perform

    _expect_name(study, "the name of a study file", "study")
    read = read_study(Path(study))
    if folder is not None:
        _expect_name(folder, "the name of a folder", "folder")
    many = whole_number(os.cpu_count() or 1 if workers is None else workers, "workers", least=1)
    with opened(read, Path(folder or Path("results") / folder_name(read.name)), resume) as store:
        return perform(read, store, many, make=make)


def steer(
    problem: PlanningProblem | Named,
    plant: Plant,
    *,
    tolerance: float = 1e-3,
    cycles: int = 6,
    objective: str | None = None,
    duration: float | None = None,
    patience: float | None = None,
    rate: float | None = None,
) -> Steered:
    """Brings a machine to a problem's goal: plan, run, measure, and plan the rest again from there.

    problem: a `PlanningProblem`, or the name of its file. plant: the machine, an object with `measure()`,
    `command(set_points)` and `advance(seconds)`, such as `SimulatedPlant`. tolerance: E [rad] that counts as reached.
    cycles: runs at most. objective: what each plan minimises, None: as the file says. duration: of a run [time of the
    machine], None: the problem's horizon. patience: seconds that a method of the plant may take, None: any time.
    rate: how often in a unit of the machine's time the rest of the first plan is corrected under way, None: never.
    `Steered` has `reached`, `outcome`, `message`, and `cycles`, each with its errors and its verified plan. What the
    plant raises ends it as `interrupted`; a plan that fails is not run. Bounds that a machine in the computer broke on
    its way are in `warnings`.
    Errors: `InvalidProblemError` for what is no problem, `CallError` for what is no plant.
    """
    from nhpocp.machine.feedback.steering import Steering

    steering = Steering(tolerance, cycles, objective, duration, patience, rate=rate)
    return steering.run(_problem(problem), plant)


def calibrate(
    problem: PlanningProblem | Named,
    runs: Sequence[Mapping[str, Any] | Named],
    fit: str | Sequence[str] | None = None,
    noise: str | Sequence[float] | None = None,
) -> Calibration:
    """Fits the parameters of a problem's robot to what was measured of one or several runs, all at once.

    problem: a `PlanningProblem`, or the name of its file. runs: each a CSV file as `nhpocp calibrate` reads, or arrays
    by the names of a solution's trajectory, "t" (samples,) [time], "position" (samples, 3) [length], "orientation"
    (samples, 3, 3), NaN where none was measured, "leg_lengths" (samples, motors) [length]. fit: names, as "base_radius,
    roller_tilt[each],base[1].x"; None: the shape, or all joints of unlike legs. noise: standard deviations of positions
    [length], angles [rad], leg lengths [length]; None: estimated. `Calibration` has `fitted`, `outcome`, `message`,
    `estimates`, `system`, `doubts`. Errors: `InvalidProblemError` for names or runs that are none, `CallError` for one.
    """
    from nhpocp.machine.calibration.calibration import Calibrating
    from nhpocp.measured_table import read_measurements

    calibrating = Calibrating.of(_problem(problem), fit, noise)
    robot, read = calibrating.unknowns.system, cast(Any, runs)
    if isinstance(runs, list | tuple):  # anything else is refused there
        read = [read_measurements(Path(r), robot) if isinstance(r, str | os.PathLike) else r for r in runs]
    return calibrating.run(read)


def analyze(
    problem: PlanningProblem | Named,
    *,
    tolerance: float | None = None,
    degree: int | None = None,
    spans: Sequence[Any] = (),
    at: str | float = "start",
) -> Analysis:
    """Whether a motion can exist and where it is in danger: growth vectors, ranks, singular values, a map.

    problem: a `PlanningProblem`, or the name of its file. tolerance: relative, below which singular values count as 0.
    degree: of the longest Lie brackets to look at. spans: the two coordinates of the map of singularities; none: those
    that move most. at: where all other coordinates are held, "start", "goal", or a time [time] of the initial guess.
    Errors: `InvalidProblemError` where these do not fit the problem.
    """
    from nhpocp import analysis

    given = {"tolerance": tolerance, "degree": degree}
    chosen: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return analysis.analyze(_problem(problem), spans=spans, at=at, **chosen)


def simulate(problem: PlanningProblem | Named, control: Control | Array) -> Motion:
    """The motion that a control makes from the problem's start, and what it costs.

    problem: a `PlanningProblem`, or the name of its file. control: a `Control`, or coefficients Λ (inputs, functions)
    over the problem's basis, in units of the inputs.
    The `Motion` has `trajectory`, arrays by name, samples first, and `costs`; NaN from where it cannot be integrated.
    Errors: `InvalidProblemError` for a control of another shape.
    """
    from nhpocp.flow.simulation import simulate as integrated

    made = _problem(problem)
    driven = control if isinstance(control, Control) else made.control(control)
    rows, inputs = len(driven.coefficients), made.system.input_space
    if rows != inputs.size:
        words = (
            f"{rows} rows of coefficients; expected {inputs.size}, one per input ({', '.join(inputs.labels)})"
        )
        raise CallError(words, path="control")
    return integrated(made, driven)


def verify(solution: Solution | Named) -> Verdict:
    """What an independent check finds: the control integrated again by SciPy, and every bound on a fine grid.

    solution: a `Solution`, or the name of its folder. The `Verdict` has `ok`, `error` (E), `reasons` why it is not ok,
    `crossings` and `warnings`. It never raises for a solution that is wrong.
    Errors: `CallError` for what is no solution; `UnreadableSolutionError` for a folder that holds none.
    """
    from nhpocp import verification

    return verification.verify(_solution(solution))


def save_solution(
    solution: Solution,
    folder: Named,
    pictures: Callable[[Solution, Path], Any] | None = None,
    *,
    trace: bool = False,
) -> Path:
    """Writes a solution folder, whole or not at all, and returns its path.

    solution: what `solve` returned. folder: its name; an existing one is replaced only if nhpocp wrote it. pictures:
    called with the solution and the new folder to add files to it. trace: add iterations.csv, a row for every
    evaluated control.
    Errors: `InvalidProblemError` for a folder that is something else or cannot be written, or what is no solution.
    Warns, as `NhpocpWarning`, where `load_solution` will not know a class of your own, which no file can name.
    """
    from nhpocp import solution_folder

    expect(solution, Solution, "a Solution, such as solve(problem) returns", "solution")
    _expect_name(folder, "the name of a folder", "folder")
    _warn(_unreadable(solution))
    return solution_folder.save_solution(solution, folder, pictures, trace=trace)


def _unreadable(solution: Solution) -> Iterator[str]:
    """What of a solution no file can name, so that its folder will not be read back."""
    from nhpocp.controls.registry import BASES
    from nhpocp.controls.sequence import SequenceBasis
    from nhpocp.problem_file.registry import SYSTEMS

    basis = solution.control.basis
    bases = basis.bases if isinstance(basis, SequenceBasis) else (basis,)
    kinds = dict.fromkeys([*(each.kind for each in bases), solution.problem.basis.kind])
    used: list[tuple[Family[Any], str]] = [
        (SYSTEMS, solution.problem.system.model),
        *((BASES, k) for k in kinds),
    ]
    for family, name in used:
        if name not in family and family.group:
            words = f"{name!r} is {family.group.noun} that no file can name, so load_solution will refuse this folder"
            yield f"{words}; give your package an entry point of the group {family.group.name}"


def load_solution(folder: Named) -> Solution:
    """The `Solution` that a folder holds, as `save_solution` and the command line write it.

    folder: its name. Errors: `UnreadableSolutionError` naming the file that is missing or damaged.
    """
    from nhpocp import solution_folder

    _expect_name(folder, "the name of a solution folder", "folder")
    return solution_folder.load_solution(folder)


def write_report(comparison: Comparison, path: Named, animations: Mapping[str, str] | None = None) -> Path:
    """Writes a comparison as one page, and returns its path. The same solutions give the same bytes.

    comparison: what `compare` returned. path: of the HTML file. animations: files that show the motions of a group,
    relative to the page, by the groups' titles.
    Errors: `CallError` for what is no comparison.
    """
    from nhpocp.comparison import Comparison as Expected
    from nhpocp.views import report

    expect(comparison, Expected, "a Comparison, such as compare(problem) returns", "comparison")
    _expect_name(path, "the name of a file", "path")
    return report.write_report(comparison, path, animations)


def write_animation(entries: Solution | Entry | Sequence[Solution | Entry], path: Named) -> Path:
    """Writes motions side by side as one page that plays, and returns its path.

    entries: one or several solutions, or entries of a comparison, at most six. path: of the HTML file.
    Errors: `InvalidProblemError` for a solution without a path, or motions in space beside motions in the plane.
    """
    from nhpocp.comparison import Entry as Expected
    from nhpocp.views import animation

    many: list[Any] = list(entries) if isinstance(entries, list | tuple) else [entries]
    for entry in many:
        expect(entry, (Solution, Expected), "a Solution, or several", "entries")
    _expect_name(path, "the name of a file", "path")
    made = [Expected.of(entry) if isinstance(entry, Solution) else entry for entry in many]
    return animation.write_animation(made, path)


def _problem(given: Any) -> PlanningProblem:
    """The problem that is meant, tried out; the user is warned of what is doubtful in it."""
    if isinstance(given, str | os.PathLike):
        problem, words = _loaded(given, ())
    else:
        expect(given, PlanningProblem, A_PROBLEM, "problem")
        problem, words = given, []
        if given.source is None:  # else `load_problem` has said it
            tolerance = planning.default_solver(given).tolerance
            words = [f"{doubt.path}: {doubt.message}" for doubt in doubts(given, tolerance)]
    if type(problem.system).__module__.partition(".")[0] != "nhpocp":
        try_out(problem.system, problem.start_point)
    _warn(words)
    return problem


def _loaded(path: Any, overrides: Sequence[str]) -> tuple[PlanningProblem, list[str]]:
    """A file's problem, and its doubts in words."""
    _expect_name(path, "the name of a problem file", "path")
    if isinstance(overrides, str):
        raise CallError(
            f"overrides: expected a list of texts, got {describe(overrides)}; write [{overrides!r}]"
        )
    file = read(path, overrides)
    return build(file), file.warnings


def _warn(words: Iterable[str]) -> None:
    """Of each, at the line of the user's code that called."""
    outside = next((depth for depth, name in enumerate(_callers(), 1) if name != __name__), 1)
    for each in words:
        warnings.warn(each, NhpocpWarning, stacklevel=outside)


def _callers() -> Iterator[str]:
    """The modules of the calls that led here, `_warn`'s first."""
    frame = sys._getframe(2)
    while frame:
        yield frame.f_globals.get("__name__", "")
        frame = frame.f_back  # type: ignore[assignment]


def _solution(given: Any) -> Solution:
    if isinstance(given, str | os.PathLike):
        return load_solution(given)
    expect(given, Solution, "a Solution or the name of its folder", "solution")
    solution: Solution = given
    return solution


def _expect_name(given: Any, wanted: str, path: str) -> None:
    if not isinstance(given, str | os.PathLike):
        raise InvalidProblemError(f"expected {wanted}, got {describe(given)}", path=path)
