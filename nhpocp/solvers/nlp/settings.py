"""What a problem file may say of the NLP, and the tables of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp import declared
from nhpocp.errors import InvalidProblemError
from nhpocp.family import Family
from nhpocp.solvers.settings import SolverSettings

if TYPE_CHECKING:
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.solution import Solver

TRANSCRIPTIONS: Family[Any] = Family(
    {
        "multiple": "nhpocp.solvers.nlp.staged_transcription:StagedTranscription",
        "single": "nhpocp.solvers.nlp.single_shooting:SingleShooting",
    }
)
OPTIMIZERS: Family[Any] = Family(
    {"ipopt": "nhpocp.solvers.nlp.ipopt:Ipopt", "fatrop": "nhpocp.solvers.nlp.fatrop:Fatrop"}
)
GUESSES: Family[Any] = Family(
    {
        "problem": "nhpocp.solvers.nlp.guesses:ProblemGuess",
        "jacobian": "nhpocp.solvers.nlp.guesses:SolverGuess",
        "straight": "nhpocp.solvers.nlp.guesses:StraightGuess",
    }
)


@dataclass(frozen=True)
class NlpSettings(SolverSettings):
    """The optimal-control method: multiple shooting."""

    control: str = declared.choice(
        "piecewise_constant", ["piecewise_constant", "basis"], "basis: the one of the block `control`"
    )
    intervals: int = declared.count(50, "shooting intervals")
    steps_per_interval: int | str = declared.declared(
        "auto or whole", "auto", "integration steps per interval"
    )
    shooting: str = declared.choice("multiple", TRANSCRIPTIONS, "transcription")
    plugin: str = declared.choice("ipopt", OPTIMIZERS, "the NLP solver")
    initial: str = declared.choice(
        "problem",
        GUESSES,
        "guess: control.initial, the Jacobian method's plan, than which nothing is dearer, or a straight line",
    )
    tolerance: float = declared.positive(1e-6, "the NLP solver's")
    max_iterations: int = declared.whole(1000, "the NLP solver's")
    starts: int = declared.count(1, "tries: the file's guess, then seeded ones")
    seed: int = declared.whole(0, "of everything random")
    mesh_check: bool = declared.declared(
        "truth", False, "solve again with twice the intervals and say what it changes"
    )

    meaning: ClassVar[str] = "multiple shooting"

    def solver(self, kernels: Kernels | None, others: Mapping[str, Solver]) -> Solver:
        from nhpocp.solvers.continuation.settings import JacobianSettings
        from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

        if self.plugin == "fatrop" and self.shooting == "single":
            raise InvalidProblemError(
                "fatrop needs the stages of multiple shooting", path="solvers.nlp.plugin"
            )
        first = (
            [others.get("jacobian") or JacobianSettings().solver(None, {})]
            if self.initial == "jacobian"
            else []
        )
        return MultipleShooting(
            intervals=self.intervals,
            steps_per_interval=self.steps_per_interval if isinstance(self.steps_per_interval, int) else None,
            over_basis=self.control == "basis",
            transcription=TRANSCRIPTIONS[self.shooting],
            optimizer=OPTIMIZERS[self.plugin](tolerance=self.tolerance, max_iterations=self.max_iterations),
            guess=GUESSES[self.initial](*first),
            starts=self.starts,
            seed=self.seed,
            mesh_check=self.mesh_check,
            **({} if kernels is None else {"kernels": kernels}),
        )
