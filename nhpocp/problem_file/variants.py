"""Variants of a problem's solvers, `nlp:control=basis,intervals=40`: the settings that differ from the file's."""

from __future__ import annotations

import re
import warnings
from typing import TYPE_CHECKING, Any

from nhpocp import variant_label
from nhpocp.errors import InvalidProblemError, NhpocpWarning, suggestion
from nhpocp.problem_file.dumping import dump_problem
from nhpocp.problem_file.reading import build, read_text
from nhpocp.solvers.registry import SOLVERS

if TYPE_CHECKING:
    from nhpocp.problem import PlanningProblem


def overrides(label: str) -> tuple[str, list[str]]:
    """The solver of a variant and what it sets: ("nlp", ["solvers.nlp.control=basis"]) of `nlp:control=basis`.

    A key that begins with `control.` is one of the file's block `control`; with `control.basis` among them, they are
    all of the block, since no basis knows the keys and coefficients of another.
    Errors: `InvalidProblemError` for another form or an unknown solver.
    """
    name, settings = variant_label.parts(label)
    form = "expected solver:key=value,key=value, such as nlp:control=basis"
    if name not in SOLVERS:
        raise InvalidProblemError(
            f"--variant {label}: {name!r} is no solver; {suggestion(name, SOLVERS)}, as in nlp:control=basis"
        )
    if not all(re.fullmatch(r"\s*[\w.]+\s*=\s*\S.*", setting) for setting in settings):
        raise InvalidProblemError(f"--variant {label}: {form}")
    own = [setting for setting in settings if not setting.startswith("control.")]
    block = [setting.removeprefix("control.") for setting in settings if setting not in own]
    changes = [f"solvers.{name}.{setting}" for setting in own]
    if any(re.match(r"basis\s*=", setting) for setting in block):
        pairs = (setting.partition("=") for setting in block)
        return name, [
            *changes,
            f"control={{{', '.join(f'{key.strip()}: {value}' for key, _, value in pairs)}}}",
        ]
    return name, [*changes, *(f"control.{setting}" for setting in block)]


def variant(problem: PlanningProblem, label: str) -> tuple[PlanningProblem, Any]:
    """The problem with a variant's settings in it, and its solver with them.

    Errors: `InvalidProblemError` naming the variant, for keys and values that a problem file would refuse. Warns, as
    `NhpocpWarning`, of settings that are hardly meant, such as γ without a step rule that makes use of it.
    """
    from nhpocp.planning import own_solver  # and CasADi

    name, changes = overrides(label)
    if changes or name not in problem.solvers:
        try:
            file = read_text(dump_problem(problem), None, changes)
            changed = build(file)
        except InvalidProblemError as error:
            words = re.sub(r" \(given by --set [^)]*\)", "", error.message)
            message = f"{words} (given by --variant {label})"
            raise InvalidProblemError(message, path=error.path) from None
        for doubt in file.doubts:
            if (doubt.path or "").startswith((f"solvers.{name}.", "control.")):
                words = f"--variant {label}: {doubt.path}: {doubt.message}"
                warnings.warn(words, NhpocpWarning, stacklevel=3)
        return changed, own_solver(changed, name)
    return problem, problem.solvers[name]
