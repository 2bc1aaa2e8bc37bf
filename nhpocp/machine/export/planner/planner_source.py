"""The C text of a planner: the kernel's loops over one path, the numbers of a problem, and the texts around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from string import Template
from typing import Any, cast

import numpy as np

from nhpocp import so3
from nhpocp.controls.table import Gram, Table
from nhpocp.flow.compiled.c_functions import LANES, Lanes
from nhpocp.flow.compiled.sweep_source import path_source, slots
from nhpocp.flow.runge_kutta import Grid
from nhpocp.foreseen import ON_THE_SURFACE
from nhpocp.machine.export.planner import algebra_text, answer_text, loop_text, path_text
from nhpocp.machine.export.planner.numbers_text import array, defined, enumerated, lines
from nhpocp.machine.export.planner.parts import Parts
from nhpocp.outcome import Outcome
from nhpocp.scales import LEAST
from nhpocp.solvers.continuation import stop_criteria, trust_region
from nhpocp.solvers.continuation.generalized_inverses import MoorePenrose
from nhpocp.solvers.continuation.singularity_crossings import SINGULAR, SINGULAR_BELOW
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.metrics import L2Metric
from nhpocp.systems.numeric import EXPANDED
from nhpocp.task import HALF_TURN_WITHIN

UNITS = {"": "NUMBER", "length": "LENGTH", "angle": "ANGLE"}
ENDINGS = {  # of a planner, in its words
    Outcome.CONVERGED: "the goal is reached, and by finer steps as well",
    Outcome.NOT_VERIFIED: "finer steps miss the goal: plan with more of them",
    Outcome.ITERATION_LIMIT: "no control is left to try: another to begin with, or a larger max_iterations",
    Outcome.STAGNATED: "no step, however short, reduces the error: another control to begin with, or more functions",
    Outcome.DIVERGED: "the error grows without bound: another control to begin with",
    Outcome.RANK_DEFICIENT: "no change of this control moves the end in every direction: another to begin with",
    Outcome.SINGULAR_S: "the path runs into det S = 0: another control to begin with",
    Outcome.SINGULAR_W: "the path runs into det W = 0: another control to begin with",
    Outcome.ORIENTATION_AT_PI: "the error in orientation is a half turn, whose axis is ambiguous",
    Outcome.NOT_FINITE: "a number is not finite, of the poses or along the path of the first control",
    Outcome.OTHER_COMPONENT: "start and goal lie on different sides of a singular surface",
}
BAD_INPUT, NO_ROTATION = (
    "bad_input",
    "nine numbers of the start or the goal are no rotation",
)  # Python raises there
SWEEPS = 60  # of the Jacobi method, at most; five are many
ROUNDING = 1e-15  # for each column: rows that are orthogonal up to that stay as they are


@dataclass(frozen=True)
class PlannerSource:
    """The C file of a planner.

    parts: what it plans. name: what its own names begin with. header: the file that it includes.
    Errors, of `text`: `NotCompilableError` where CasADi's code is more than straight lines.
    """

    parts: Parts
    name: str
    header: str

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Of arrays, by the names that the C text has for them."""
        parts, space = self.parts, self.parts.problem.system.state_space
        steps = len(parts.flow.grid.h)
        turns = sum(block.kind == "rotation" and block.name in parts.task.values for block in space.blocks)
        return {
            "FUNCTIONS": parts.problem.basis.size,
            "COLUMNS": parts.initial.size,
            "ROWS": len(parts.task.rows),
            "FIXED": len(parts.fixed),
            "TURNS": turns,
            "ANGLES": max(1, turns),
            **{f"{prefix}STEPS": len(grid.h) for prefix, (grid, _) in parts.grids.items()},
            **{f"{prefix}SAMPLES": len(grid.samples) for prefix, (grid, _) in parts.grids.items()},
            "WIDTH": parts.grids[""][1].values.shape[1],
            "BLOCKS": -(-slots(parts.scheme) * steps // LANES),
            "WINDOW": stop_criteria.STAGNATION_WINDOW,
            "NONE": -1,
        }

    def text(self) -> str:
        """All of it."""
        parts, eliminated = self.parts, self._eliminated
        texts = [
            HEAD,
            path_source(parts.scheme, self._functions),
            *(f"{part}\n" for part in (enumerated(self.sizes), defined(self._constants), self._arrays)),
            algebra_text.ALGEBRA,
            algebra_text.STEPS_WITHIN,
            algebra_text.DETERMINANT if eliminated else "",
            path_text.PATH,
            loop_text.SCALES,
            loop_text.LOOP,
            answer_text.COMPONENTS if parts.separating else "",
            *((answer_text.GROUP, answer_text.ROTATIONS) if self._rotations else ()),
            answer_text.JOINTS if parts.joint_labels else "",
            answer_text.ANSWER,
        ]
        names, pieces = self._names, self._pieces
        return "".join(
            each.substitute(names, **pieces) if isinstance(each, Template) else each for each in texts
        )

    @property
    def _names(self) -> dict[str, str]:
        return {"name": self.name, "upper": self.name.upper(), "header": self.header}

    @property
    def _eliminated(self) -> bool:
        """Whether a determinant is found by elimination."""
        large = any(surface.size > EXPANDED for surface in self.parts.breaking)
        return large or bool(self.parts.separating)

    @property
    def _pieces(self) -> dict[str, str]:
        """What stands in the texts where problems differ."""
        parts, names, upper = self.parts, self._names, self.name.upper()
        lost = "approached(work)" if parts.breaking else f"{upper}_NOT_FINITE"
        crossing = "place->crossing != NONE ? place->crossing : " if parts.breaking else ""
        by_pivots = "SURFACE_SIZE[which] > EXPANDED ? determinant(SURFACE_SIZE[which], numbers) : "
        surfaces = path_text.SURFACES.substitute(
            names, determinant=f"{by_pivots if self._eliminated else ''}*numbers"
        )
        own_length = parts.problem.system.own_length
        return {
            **{
                f"{prefix.lower()}first": "0" if table.first is None else f"{prefix}FIRST"
                for prefix, (_, table) in parts.grids.items()
            },
            "surfaces": surfaces if parts.breaking else "",
            "look": path_text.LOOK if parts.breaking else "",
            "slopes": path_text.SLOPES if parts.scheme.entries else "",
            "lost": f"{crossing}{lost}",
            "lost_here": lost,
            "length": "OWN_LENGTH" if own_length else "span(start, goal, LENGTH, ERROR_LENGTH)",
            "common_unit": loop_text.COMMON_UNIT if self._by_l2 else "",
            "metric": loop_text.BY_GRAM if self._by_l2 else loop_text.BY_COEFFICIENTS,
            "group": answer_text.GROUP_CHECK.substitute(names) if self._rotations else "",
            "apart": answer_text.APART_CHECK.substitute(names) if parts.separating else "",
            "set_joints": "\n    set_joints(plan, work);" if parts.joint_labels else "",
            "names": "\n".join(
                f'    case {upper}_{word.upper()}:\n        return "{word}";' for word in words()
            ),
        }

    @property
    def _by_l2(self) -> bool:
        return isinstance(self.parts.method.metric, L2Metric)

    @property
    def _rotations(self) -> list[int]:
        """Where rotations begin in a packed pose."""
        space = self.parts.problem.system.state_space
        return [space.point_slice(b.name).start for b in space.blocks if b.kind == "rotation"]

    @property
    def _functions(self) -> dict[str, tuple[Any, Lanes]]:
        """CasADi's, besides those of the path."""
        parts = self.parts
        return {
            "difference": (parts.task.difference_function, Lanes("x wanted", "e angles", "1")),
            "separating": (parts.separating_function, Lanes("y", "entries", "1")),
            "joints": (parts.joints, Lanes("y u", "values rates", "1")),
        }

    @property
    def _constants(self) -> dict[str, Any]:
        """Numbers of the method, each where Python has it."""
        parts = self.parts
        problem, region = parts.problem, trust_region
        rule, inverse = cast(Adaptive, parts.method.step_rule), cast(MoorePenrose, parts.method.inverse)
        constants = {
            "NUMBER": 0,
            "LENGTH": 1,
            "ANGLE": 2,
            "ERROR_LENGTH": problem.error_length,
            "OWN_LENGTH": problem.system.own_length or 0.0,
            "LEAST_SPAN": LEAST,
            "TIME": problem.scales.time,
            "HALF_TURN": np.pi - HALF_TURN_WITHIN,
            "RANK": inverse.rank_tolerance,
            "FIRST_RADIUS": rule.first_radius,
            **{
                name: getattr(region, name)
                for name in (
                    *("LEAST_GAIN", "LEAST_PREDICTED", "SMALLEST", "NEGLIGIBLE", "POOR", "GOOD"),
                    *("NARROWER", "NARROWEST", "WIDER", "DAMPINGS", "LONG"),
                )
            },
            "DIVERGED_ABOVE": stop_criteria.DIVERGED_ABOVE,
            "STAGNATION": stop_criteria.STAGNATION_FRACTION,
            "SINGULAR_BELOW": SINGULAR_BELOW,
            "ON_THE_SURFACE": ON_THE_SURFACE,
            "GROUP_TOLERANCE": so3.GROUP_TOLERANCE,
            "ROUNDED": so3.ROUNDED,
            "EXPANDED": EXPANDED,
            "SWEEPS": SWEEPS,
            "ORTHOGONAL": ROUNDING * parts.initial.size,
            "LARGEST": max((each.size for each in (*parts.breaking, *parts.separating)), default=1),
            "SURFACES": len(parts.breaking),
            "SEPARATING": len(parts.separating),
            "APART": max(1, sum(each.size**2 for each in parts.separating)),
            "ROTATIONS": len(self._rotations),
        }
        if self._by_l2:
            constants["ROOT_OF_HORIZON"] = float(np.sqrt(problem.horizon.fixed))
        return constants

    @property
    def _arrays(self) -> str:
        """Numbers of the problem and of its grids."""
        parts, upper = self.parts, self.name.upper()
        problem, task = parts.problem, parts.task
        space, inputs = problem.system.state_space, problem.system.input_space
        point_units = [UNITS[block.unit] for block in space.blocks for _ in range(block.size)]
        scales = [
            scale
            for each in parts.separating
            for scale in each.size * list(problem.system.column_scales(each.name, problem.scale))
        ]
        return lines(
            [
                *(part for prefix, grid in parts.grids.items() for part in _grid(prefix, *grid)),
                array("int", "FIXED_AT", parts.fixed, "[FIXED]"),
                array("int", "POINT_UNITS", [point_units[i] for i in parts.fixed], "[FIXED]"),
                array("int", "TANGENTS", task.rows, "[ROWS]"),
                array("int", "ROW_UNITS", [UNITS[unit] for unit in task.units], "[ROWS]"),
                array("double", "WEIGHTS", task.weights, "[ROWS]"),
                array("int", "INPUT_UNITS", [UNITS[unit] for unit in inputs.tangent_units], "[M]"),
                *_surfaces("SURFACE", parts.breaking),
                *_surfaces("SEPARATING", parts.separating),
                array(
                    "int",
                    "SURFACE_STATUS",
                    [
                        f"{upper}_{SINGULAR.get(each.name, Outcome.NOT_FINITE).value.upper()}"
                        for each in parts.breaking
                    ],
                )
                if parts.breaking
                else "",
                array("double", "COLUMN_SCALES", scales) if scales else "",
                array("int", "ROTATION_AT", self._rotations) if self._rotations else "",
                array("double", "GRAM_ROOT", _root(problem), "[FUNCTIONS][FUNCTIONS]") if self._by_l2 else "",
                *self._given,
            ]
        )

    @property
    def _given(self) -> list[str]:
        """The file's own poses and control, for whoever wants them."""
        parts, name = self.parts, self.name
        named = {
            f"start[{name.upper()}_STATE]": parts.problem.start_point,
            f"goal[{name.upper()}_STATE]": parts.problem.goal_point,
            f"initial[{name.upper()}_COEFFICIENTS]": parts.initial.ravel(),
            f"times[{name.upper()}_TIMES]": parts.flow.times,
        }
        return [
            array("double", f"{name}_{what}", values, "").removeprefix("static ")
            for what, values in named.items()
        ]


SIGNATURE = "nhpocp export --format c-planner"  # in the first line of either file
HEAD = Template(
    f"/* Written by {SIGNATURE}; $header says what this is."
    + """
 * At first come CasADi's code of the equations and its loops, then numbers, then the method. */
#include "$header"

#include <math.h>
#ifdef ${upper}_EXAMPLE
#include <stdio.h>
#endif

"""
)


def words() -> list[str]:
    """Names of the endings."""
    return [*(ending.value for ending in ENDINGS), BAD_INPUT]


def _grid(prefix: str, grid: Grid, table: Table) -> list[str]:
    return [
        array("double", f"{prefix}H", grid.h),
        array("long long", f"{prefix}NODES", grid.nodes.ravel()),
        array("double", f"{prefix}PHI", table.values.ravel()),
        array("int", f"{prefix}FIRST", np.asarray(table.first).ravel()) if table.first is not None else "",
    ]


def _surfaces(prefix: str, surfaces: list[Any]) -> list[str]:
    if not surfaces:
        return []
    return [
        array("int", f"{prefix}_SIZE", [each.size for each in surfaces]),
        array("int", f"{prefix}_AT", [each.first for each in surfaces]),
    ]


def _root(problem: Any) -> list[list[float]]:
    gram = np.asarray(Gram.of(problem.basis.gram(problem.horizon.fixed)))
    return [list(row) for row in np.linalg.cholesky(gram)]
