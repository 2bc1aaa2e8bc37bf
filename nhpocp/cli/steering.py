"""The verb `steer`: a plan run on a machine that is not quite the model's, measured, and planned again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.progress import counter
from nhpocp.cli.terminal import put, say, tell

if TYPE_CHECKING:
    from nhpocp.interruption import Interruption
    from nhpocp.machine.feedback.fleet import Fleet
    from nhpocp.machine.feedback.steering import Cycle, Steered, Steering
    from nhpocp.machine.model_errors import ModelErrors
    from nhpocp.problem import PlanningProblem

OF_A_FLEET = 2.0  # per cent of every number, and degrees of every angle, where --runs comes without --error
STEPS = 400  # of the machine's integration in a run


@click.command(
    epilog="Exit status: 0 if the goal is reached within the tolerance, with --runs by every machine; else 1."
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--cycles", type=click.IntRange(1, 1000), default=6, show_default=True, help="Runs at most.")
@click.option(
    "--tolerance", type=float, default=1e-3, show_default=True, help="The error E that counts as reached."
)
@click.option(
    "--error",
    "errors",
    metavar="NAME=AMOUNT,...",
    help="What of the machine is not as in the model: roller_tilt=2deg,base_radius=1%; 2% alone: every number, and "
    "angles by 2 degrees.  [default: nothing; with --runs 2%]",
)
@click.option(
    "--noise", type=float, default=0.0, show_default=True, help="Standard deviation of what is measured."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all that is random."
)
@click.option(
    "--runs",
    type=click.IntRange(1, 100_000),
    help="So many machines, each number up to its --error, uniformly.",
)
@click.option(
    "--rate", type=float, help="Correct the rest of the first plan under way, so often in a unit of time."
)
@click.option("--objective", help="What each plan minimises, such as effort; default: as the file says.")
@set_option
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="The folder for steer.json, steer.csv and plans."
)
@json_option
def steer(
    file: Path,
    cycles: int,
    tolerance: float,
    errors: str | None,
    noise: float,
    seed: int,
    runs: int | None,
    rate: float | None,
    objective: str | None,
    overrides: tuple[str, ...],
    output: Path | None,
    as_json: bool,
) -> int:
    """Plan FILE, run the plan on a simulated machine, measure, plan the rest again, until the goal is reached.

    The machine is the system with other parameters (--error). A run that leads away from the goal is taken back, and
    a plan that fails is not run. Writes the errors over the cycles, a picture of them, and every plan as a solution
    folder. Default folder: results/NAME/steer.
    """
    from nhpocp.interruption import Interruption
    from nhpocp.machine.feedback.steering import Steering
    from nhpocp.machine.model_errors import ModelErrors
    from nhpocp.solution_folder import folder_name
    from nhpocp.steering_folder import check_home

    problem = load(file, overrides)
    home = output or Path("results") / folder_name(problem.name) / "steer"
    check_home(home)
    if errors is not None:
        wrong = ModelErrors.parsed(errors, problem.system)
    else:
        wrong = ModelErrors.of_all(OF_A_FLEET, problem.system) if runs else ModelErrors(problem.system, ())
    steering = Steering(tolerance=tolerance, cycles=cycles, objective=objective, rate=rate)
    with Interruption() as stop:
        if runs is None:
            return _one(problem, steering, wrong, noise, seed, home, as_json, stop)
        return _many(problem, steering, wrong, noise, seed, runs, home, as_json, stop)


def _one(
    problem: PlanningProblem,
    steering: Steering,
    wrong: ModelErrors,
    noise: float,
    seed: int,
    home: Path,
    as_json: bool,
    stop: Interruption,
) -> int:
    from nhpocp.machine.feedback.simulated_plant import SimulatedPlant
    from nhpocp.steering_folder import save_steering

    system, gains, values = wrong.machine()
    step = problem.horizon.fixed / STEPS
    plant = SimulatedPlant(system, problem.start, noise=noise, gains=gains, seed=seed, step=step)
    with counter(as_json, "cycle") as show:
        steered = steering.with_progress(_counted(show, steering.cycles)).run(problem, plant)
    stop.patient = True  # what was measured is written
    machine = {"kind": "simulated", "wrong": values, "noise": noise, "seed": seed}
    missing = save_steering(steered, home, {"plant": machine}, _pictures(problem))
    _warn(missing)
    if as_json:
        put(_plain(steered, home))
    else:
        _tell_one(steered, wrong, home)
    return SOLVED if steered.reached else NOT_SOLVED


def _many(
    problem: PlanningProblem,
    steering: Steering,
    wrong: ModelErrors,
    noise: float,
    seed: int,
    runs: int,
    home: Path,
    as_json: bool,
    stop: Interruption,
) -> int:
    from nhpocp.machine.feedback.fleet import steer_fleet
    from nhpocp.solution_folder import plain
    from nhpocp.steering_folder import save_fleet

    with counter(as_json, "machine") as show:
        fleet = steer_fleet(problem, wrong, runs, steering, noise=noise, seed=seed, progress=show)
    stop.patient = True
    machine = {"kind": "simulated", "noise": noise, "seed": seed}
    _warn(save_fleet(fleet, home, {"plant": machine}, _pictures(problem)))
    if as_json:
        head = {"folder": str(home), "outcome": fleet.outcome, "runs": runs, "reached": fleet.reached}
        put(plain({**head, "plan_s": fleet.plan_s, "table": fleet.table()}))
    else:
        _tell_many(fleet, home)
    return SOLVED if fleet.reached == runs else NOT_SOLVED


def _counted(show: Callable[[int, int], None] | None, most: int) -> Callable[[Cycle], None]:
    done = [-1]  # the first is before any run

    def count(cycle: Cycle) -> None:
        done[0] += 1
        if show:
            show(done[0], most)

    return count


def _pictures(problem: PlanningProblem) -> Callable[[Any, Path], None] | None:
    def write(subject: Any, folder: Path) -> None:
        from nhpocp.views.steering_figures import write_pictures  # once the numbers are written

        write_pictures(subject, folder)

    return write if problem.pictures else None


def _warn(missing: list[str]) -> None:
    for warning in missing:
        say(f"warning: {warning}")


def _plain(steered: Steered, home: Path) -> Any:
    """The document of --json."""
    from nhpocp.solution_folder import plain

    names = ("error", "position_error", "angle_error", "plan_s", "plan_outcome", "corrections", "returned")
    cycles = [{name: cycle.to_json()[name] for name in names} for cycle in steered.cycles]
    head = {"folder": str(home), "outcome": steered.outcome.value, "message": steered.message}
    return plain({**head, "cycles": cycles})


def _tell_one(steered: Steered, wrong: ModelErrors, home: Path) -> None:
    tell(f"{steered.problem.name}: {steered.outcome.value}")
    tell(f"  {steered.message}")
    tell(f"  the machine differs from the model by: {wrong.words}")
    tell("  cycle  error E    position   angle [rad]  planned in [s]")
    for k, cycle in enumerate(steered.cycles):
        seconds = "-" if cycle.plan_s is None else f"{cycle.plan_s:.3f}"
        numbers = [_figure(value) for value in (cycle.error, cycle.position_error, cycle.angle_error)]
        tell(f"  {k:5d}  {numbers[0]:9s}  {numbers[1]:9s}  {numbers[2]:11s}  {seconds}")
    tell(f"  written: {home}")


def _tell_many(fleet: Fleet, home: Path) -> None:
    within = f"E = {fleet.tolerance:g}"
    tell(f"{fleet.problem.name}: {fleet.reached} of {fleet.runs} machines reached the goal within {within}")
    tell(
        f"  up to: {fleet.errors.words}; noise {fleet.noise:g}; planned in {_figure(fleet.plan_s)} s a cycle (median)"
    )
    tell(f"  {'':37s}least      median     90 %       most")
    for name, rows in fleet.table().items():
        for feedback, values in rows.items():
            label = f"{name.replace('_', ' ')} {feedback} feedback"
            tell(f"  {label:<37s}" + "".join(f"{_figure(value):<11s}" for value in values).rstrip())
    for number, machine in enumerate(fleet.machines):
        if not machine.steered.reached:
            tell(f"  machine {number}: {machine.steered.outcome.value}: {machine.steered.message}")
    tell(f"  written: {home}")


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2e}"
