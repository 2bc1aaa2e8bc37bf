"""What a solver hands back, and what verification says of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.constraints.bound import BoundReport
from nhpocp.controls.control import Control
from nhpocp.declared import whole_number
from nhpocp.deferred import Deferred, Named, extended
from nhpocp.frozen import ByValue
from nhpocp.outcome import Outcome
from nhpocp.plain_text import brief, visible
from nhpocp.problem import PlanningProblem
from nhpocp.shown import VIEWS, Shown
from nhpocp.systems.margins import det, margin


@dataclass(frozen=True)
class Crossing:
    """A zero of a determinant along the path."""

    which: str  # det_s or det_w
    time: float
    state: Mapping[str, Any]  # the pose there, plain data
    returns: bool  # the sign is the same at the start and at the end
    touches: bool = False  # the zero is met from one side: the sign does not change there

    @property
    def matrix(self) -> str:
        """The name of the regularity matrix."""
        known = margin(self.which)
        return known.matrix if known else self.which

    @property
    def letter(self) -> str:
        """What [Paper] calls the matrix."""
        return det(self.matrix).letter

    def __repr__(self) -> str:
        return f"<Crossing of det {self.letter} = 0 at t = {self.time:.4g}>"

    def to_json(self) -> dict[str, Any]:
        known = {"which": self.which, "t": self.time, "returns": self.returns, "touches": self.touches}
        return {**known, **self.state}


@dataclass(frozen=True)
class Replay:
    """An independent integration of a stored control."""

    error: float | None  # E at the time reached; None where the end was not reached
    reached: float  # time up to which the equations could be integrated
    ok: bool
    agreement: float | None = None  # max distance from the replay of the system's own equations


@dataclass(frozen=True)
class Verdict:
    """What an independent check found.

    ok: whether everything holds that must; reasons: why it does not. error: E [rad] at the end of the replay; reached:
    the time [time] that it came to; method: how it was integrated. original: the `Replay` of (3) under u. rolling,
    leg_rate: relative residuals of the joints and of the legs' rates, from geometry alone. orthogonality: of the
    rotations. trajectory_deviation: of the stored motion from the replayed one. crossings: zeros of determinants.
    bounds: a report each. warnings: what is worth knowing and breaks nothing.
    """

    error: float | None
    ok: bool
    method: str
    reasons: Sequence[str] = ()  # why not ok
    reached: float | None = None  # time up to which the replay could follow the control
    original: Replay | None = None
    rolling: float | None = None  # max |r·ω_leg|/|ω_leg| from geometry alone
    leg_rate: float | None = None  # max |l̇ - u|/|u| from geometry alone
    orthogonality: float | None = None  # max |RᵀR - I| along the replay
    trajectory_deviation: float | None = None  # max distance of the stored trajectory from the replay
    crossings: Sequence[Crossing] = ()
    bounds: Sequence[BoundReport] = ()
    warnings: Sequence[str] = ()

    @property
    def refusal(self) -> str:
        """The reasons in one sentence."""
        return "; ".join(self.reasons)

    def __repr__(self) -> str:
        said = "ok" if self.ok else f"refuted: {visible(self.refusal)}"
        error = "" if self.error is None else f", E = {self.error:.3g}"
        crossed = f", {len(self.crossings)} crossings" if self.crossings else ""
        return f"<Verdict {said}{error}{crossed}>"


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(ByValue, Shown):
    """A control, the motion it makes, and how it was found.

    problem: what was solved. solver, settings, tolerance: by which method, and the E [rad] that counts as reached.
    outcome, message: how it ended, and what to try. final_error: E as the solver believes. control: a `Control`.
    trajectory: arrays by name, samples first: "t" (samples,) [time], then state blocks, inputs, outputs and margins, as
    "position" (samples, 3) [length]. costs: integrals over the motion by name (effort, leg_effort, path_length).
    iterations: one record per evaluated control. evaluations: of the dynamics over the whole horizon. objective: what
    was minimised. warnings: sentences. timing: seconds by name. log: the optimizer's own words. details: what only one
    solver has to say, plain data. verdict: what verification says of it, a `Verdict` (None before).
    """

    problem: PlanningProblem
    solver: str
    settings: Mapping[str, Any]
    tolerance: float
    outcome: Outcome
    message: str
    final_error: float
    control: Control
    trajectory: Mapping[str, Array]
    costs: Mapping[str, float] = field(default_factory=dict)
    iterations: Sequence[Mapping[str, Any]] = ()
    evaluations: int = 0
    objective: str = "none"
    warnings: Sequence[str] = ()
    timing: Mapping[str, float] = field(default_factory=dict)
    log: str = ""
    # what only one solver has to say, plain JSON data
    details: Mapping[str, Any] = field(default_factory=dict)
    verdict: Verdict | None = None

    def __post_init__(self) -> None:
        for name in ("trajectory", "costs"):
            entries = getattr(self, name)
            if not isinstance(entries, Deferred | Named):
                object.__setattr__(self, name, Named(entries))

    def __repr__(self) -> str:
        error = self.verdict.error if self.verdict and self.verdict.error is not None else self.final_error
        ending = self.outcome.value if self.verdict else f"{self.outcome.value} (nobody has verified it)"
        numbers = f"E = {error:.3g}, effort {self.control.effort:.6g}, {self.evaluations} evaluations"
        return f"<Solution of {brief(self.problem.name)} by {self.solver}: {ending}, {numbers}>"

    @property
    def converged(self) -> bool:
        """True only where the solver claims it and verification confirms it."""
        return self.outcome is Outcome.CONVERGED and self.verdict is not None and self.verdict.ok

    @property
    def refuted(self) -> bool:
        """Whether the solver claimed success and verification changed that into what it says."""
        claimed = self.outcome in (Outcome.NOT_VERIFIED, Outcome.CONSTRAINT_VIOLATED)
        return claimed and self.verdict is not None and self.message.startswith(f"{self.verdict.refusal}. ")

    @property
    def pose_reached(self) -> str:
        """The state at the end in words, angles in degrees; empty where the path does not reach its end."""
        parts = []
        for block in self.problem.system.state_space.blocks:
            value = np.asarray(self.trajectory[block.name][-1], dtype=float)
            if not np.isfinite(value).all():
                return ""
            if block.kind == "rotation":
                angles = np.degrees(np.asarray(so3.to_rpy(value), dtype=float))
                parts.append(f"{block.name} roll, pitch, yaw = {_numbers(angles)} deg")
            else:
                parts.append(f"{block.name} = {_numbers(np.ravel(value))}")
        return ", ".join(parts)

    def plot(self, *names: str) -> Any:
        """Its pictures, as `nhpocp plot` draws them, in the output of a notebook's cell.

        names: of "controls", "relative_pose", "convergence", "margins", "distances", "robot", "trees" and "failure";
        none: all that say something. Returns matplotlib's Figure of one name, else a tuple of them; for print, save one
        with `figure.savefig("robot.pdf")`, or `dpi=300`.
        Errors: `CallError` for another name.
        """
        return VIEWS["plot"](self, names)

    def animate(self, samples: int = 101, height: int = 640) -> Any:
        """A player of the motion, in a frame of its own in the output of a notebook's cell.

        samples: of the motion, at most; the player goes smoothly between them, and fewer make a smaller notebook.
        height: of the frame [pixels]. `nhpocp.write_animation` writes the page to a file.
        Errors: `InvalidProblemError` for a solution without a path, or numbers that are none.
        """
        counts = whole_number(samples, "animate.samples", 2), whole_number(height, "animate.height", 1)
        return VIEWS["animate"](self, *counts)

    def to_dataframe(self) -> Any:
        """The trajectory as a pandas DataFrame, a row per sample with the columns of trajectory.csv: t, state, ….

        Errors: `MissingDependencyError` where pandas is not installed.
        """
        return VIEWS["data_frame"](self)

    def judged(self, verdict: Verdict, verify_seconds: float = 0.0) -> Solution:
        """This solution with a verdict; a claim that it refutes changes the outcome."""
        outcome, message = self.outcome, self.message
        if outcome is Outcome.CONVERGED and not verdict.ok:
            broken = [report for report in verdict.bounds if not report.ok]
            only_bounds = bool(broken) and len(verdict.reasons) == len(broken)
            outcome = Outcome.CONSTRAINT_VIOLATED if only_bounds else Outcome.NOT_VERIFIED
            message = f"{verdict.refusal}. {outcome.advice}"
        timing = {**self.timing, "verify_s": verify_seconds}
        timing["total_s"] = sum(timing.get(key, 0.0) for key in ("build_s", "solve_s", "verify_s"))
        return replace(self, outcome=outcome, message=message, verdict=verdict, timing=timing)


def _numbers(values: Array) -> str:
    words = [f"{0.0 if abs(value) < 1e-9 else value:.6g}" for value in values]
    return words[0] if len(words) == 1 else f"({', '.join(words)})"


class Progress(Protocol):
    """Called after every evaluated control or iteration with its record: the one that the Solution keeps, and more.

    ``tolerance``; ``phase``, what the solver is at, in words; ``at_most``: calls until a limit ends this search;
    ``expected``: those until the goal, where theory foretells them, else None; ``way``: which of several tries this is;
    ``cost`` and ``worst_bound`` (words), once the goal is reached and more is asked for, of the control before;
    ``stage``: what is done besides solving (then k and error are None). `compare` adds ``name``, ``variant``, ``run``
    and ``runs``. Entries that take work, such as ``sigma_jacobian``, are worked out when they are looked at.
    """

    def __call__(self, record: Mapping[str, Any]) -> None: ...


def telling(progress: Progress | None, **more: Any) -> Progress | None:
    """A listener that is told more with every record; None where nobody listens."""
    if progress is None:
        return None
    listener = progress
    return lambda record: listener(extended(record, **more))


class Method(Protocol):
    """What a Solution says of the solver that made it."""

    name: ClassVar[str]

    @property
    def tolerance(self) -> float:
        """The E that counts as reached."""
        ...

    def settings(self) -> dict[str, Any]:
        """Every setting as plain data, under the problem file's names."""
        ...


class Solver(Method, Protocol):
    """A way to solve a `PlanningProblem`."""

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        """A Solution whatever happens: failures are outcomes, not exceptions; Ctrl-C becomes `interrupted`."""
        ...
