"""The verb `steer`: a plan run on a machine that is not quite the model's, measured, and planned again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.machine_options import machine_options, machine_settings, refuse_machine_options
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.progress import counter
from nhpocp.cli.terminal import put, say, tell

if TYPE_CHECKING:
    from nhpocp.interruption import Interruption
    from nhpocp.machine.feedback.fleet import Fleet
    from nhpocp.machine.feedback.plant import Workshop
    from nhpocp.machine.feedback.steering import Cycle, Steered, Steering
    from nhpocp.machine.model_errors import ModelErrors
    from nhpocp.problem import PlanningProblem

OF_A_FLEET = 2.0  # per cent of every number, and degrees of every angle, where --runs comes without --error
STEPS = 400  # of the integration of a kinematic machine in a run
PLAY = 10.0  # s of a run of a physical machine, unless --duration says so
SETTLING = 0.5  # s that it is given to come to rest


@dataclass(frozen=True)
class _Asked:
    """What is to be done, where, and how it is told."""

    problem: PlanningProblem
    steering: Steering
    wrong: ModelErrors
    workshop: Workshop
    noise: float
    seed: int
    home: Path
    as_json: bool

    @property
    def facts(self) -> dict[str, Any]:
        """Of the machine, for steer.json."""
        return {**self.workshop.facts, "seed": self.seed}


@click.command(
    epilog="Exit status: 0 if the goal is reached within the tolerance, with --runs by every machine; else 1."
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--cycles", type=click.IntRange(1, 1000), default=6, show_default=True, help="Runs at most.")
@click.option(
    "--tolerance", type=float, default=1e-3, show_default=True, help="The error E that counts as reached."
)
@click.option(
    "--machine",
    type=click.Choice(["kinematic", "physics"]),
    default="kinematic",
    show_default=True,
    help="By the system's equations, or of bodies, joints and contacts (extra: physics).",
)
@click.option(
    "--duration", type=float, help="Of a run; default: the problem's horizon, with --machine physics 10 s."
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
@machine_options
@set_option
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="The folder for steer.json, steer.csv and plans."
)
@json_option
@click.pass_context
def steer(context: click.Context, file: Path, output: Path | None, as_json: bool, **given: Any) -> int:
    """Plan FILE, run the plan on a simulated machine, measure, plan the rest again, until the goal is reached.

    The machine is the system with other parameters (--error). A run that leads away from the goal is taken back, and
    a plan that fails is not run. Constraints that the machine broke on its way are warnings. Writes the errors over
    the cycles, a picture of them, and every plan as a solution folder. Default folder: results/NAME/steer.
    """
    from nhpocp.interruption import Interruption
    from nhpocp.machine.feedback.steering import Steering
    from nhpocp.machine.model_errors import ModelErrors
    from nhpocp.solution_folder import folder_name
    from nhpocp.steering_folder import check_home

    problem, runs, errors = load(file, given["overrides"]), given["runs"], given["errors"]
    home = output or Path("results") / folder_name(problem.name) / "steer"
    check_home(home)
    if errors is not None:
        wrong = ModelErrors.parsed(errors, problem.system)
    else:
        wrong = ModelErrors.of_all(OF_A_FLEET, problem.system) if runs else ModelErrors(problem.system, ())
    physics = given["machine"] == "physics"
    steering = Steering(
        tolerance=given["tolerance"],
        cycles=given["cycles"],
        objective=given["objective"],
        rate=given["rate"],
        duration=PLAY if physics and given["duration"] is None else given["duration"],
        settling=SETTLING if physics else 0.0,
    )
    workshop = _workshop(problem, steering, physics, given, context)
    asked = _Asked(problem, steering, wrong, workshop, given["noise"], given["seed"], home, as_json)
    with Interruption() as stop:
        return _one(asked, stop) if runs is None else _many(asked, runs, stop)


def _workshop(
    problem: PlanningProblem, steering: Steering, physics: bool, given: dict[str, Any], context: click.Context
) -> Workshop:
    from nhpocp.machine.feedback.simulated_plant import KinematicWorkshop

    noise = given["noise"]
    if not physics:
        refuse_machine_options(context, "--machine physics")
        return KinematicWorkshop(problem.start, noise, (steering.duration or problem.horizon.fixed) / STEPS)
    from nhpocp.machine.simulation import PhysicsWorkshop

    return PhysicsWorkshop(problem.start, machine_settings(given, noise=(noise, noise)))


def _one(asked: _Asked, stop: Interruption) -> int:
    from nhpocp.steering_folder import save_steering

    problem, steering = asked.problem, asked.steering
    system, gains, values = asked.wrong.machine()
    plant = asked.workshop.made(system, gains, asked.seed)
    with counter(asked.as_json, "cycle") as show:
        steered = steering.with_progress(_counted(show, steering.cycles)).run(problem, plant)
    stop.patient = True  # what was measured is written
    facts = {"plant": {**asked.facts, "wrong": values}}
    _warn(save_steering(steered, asked.home, facts, _pictures(problem)))
    if asked.as_json:
        put(_plain(steered, asked.home))
    else:
        _tell_one(steered, asked.wrong, asked.home)
    return SOLVED if steered.reached else NOT_SOLVED


def _many(asked: _Asked, runs: int, stop: Interruption) -> int:
    from nhpocp.machine.feedback.fleet import steer_fleet
    from nhpocp.solution_folder import plain
    from nhpocp.steering_folder import save_fleet

    with counter(asked.as_json, "machine") as show:
        fleet = steer_fleet(
            asked.problem, asked.wrong, runs, asked.steering, asked.workshop, seed=asked.seed, progress=show
        )
    stop.patient = True
    _warn(save_fleet(fleet, asked.home, {"plant": asked.facts}, _pictures(asked.problem)))
    if asked.as_json:
        head = {"folder": str(asked.home), "outcome": fleet.outcome, "runs": runs, "reached": fleet.reached}
        more = {"warnings": fleet.warnings, "plan_s": fleet.plan_s, "table": fleet.table()}
        put(plain({**head, **more}))
    else:
        _tell_many(fleet, asked)
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
    return plain({**head, "warnings": steered.warnings, "cycles": cycles})


def _tell_one(steered: Steered, wrong: ModelErrors, home: Path) -> None:
    tell(f"{steered.problem.name}: {steered.outcome.value}")
    tell(f"  {steered.message}")
    tell(f"  the machine differs from the model by: {wrong.words}")
    tell("  cycle  error E    position   angle [rad]  planned in [s]")
    for k, cycle in enumerate(steered.cycles):
        seconds = "-" if cycle.plan_s is None else f"{cycle.plan_s:.3f}"
        numbers = [_figure(value) for value in (cycle.error, cycle.position_error, cycle.angle_error)]
        tell(f"  {k:5d}  {numbers[0]:9s}  {numbers[1]:9s}  {numbers[2]:11s}  {seconds}")
    for warning in steered.warnings:
        tell(f"  warning: {warning}")
    tell(f"  written: {home}")


def _tell_many(fleet: Fleet, asked: _Asked) -> None:
    within = f"E = {fleet.tolerance:g}"
    tell(f"{fleet.problem.name}: {fleet.reached} of {fleet.runs} machines reached the goal within {within}")
    tell(
        f"  up to: {fleet.errors.words}; noise {asked.noise:g}; planned in {_figure(fleet.plan_s)} s a cycle (median)"
    )
    tell(f"  {'':37s}least      median     90 %       most")
    for name, rows in fleet.table().items():
        for feedback, values in rows.items():
            label = f"{name.replace('_', ' ')} {feedback} feedback"
            tell(f"  {label:<37s}" + "".join(f"{_figure(value):<11s}" for value in values).rstrip())
    for number, machine in enumerate(fleet.machines):
        if not machine.steered.reached:
            tell(f"  machine {number}: {machine.steered.outcome.value}: {machine.steered.message}")
    for warning in fleet.warnings:
        tell(f"  warning: {warning}")
    tell(f"  written: {asked.home}")


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2e}"
