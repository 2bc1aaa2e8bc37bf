"""C functions from CasADi's: its straight lines for one sample, looped over lanes, and a tableau as constants.

All kinds of kernel are made of these: a lane is what is worked out side by side in memory, so that a compiler makes
vector instructions of it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow import tableau as recipe_of_steps
from nhpocp.flow.compiled.kernel_cache import NotCompilableError
from nhpocp.flow.tableau import Tableau

LANES = 8  # numbers side by side

_FUNCTION = re.compile(r"\nstatic int casadi_f\d+\(.*?\) \{\n(.*?)\n  return 0;\n\}", re.DOTALL)
_INPUT = re.compile(r"arg\[(\d)\]\? arg\[\1\]\[(\d+)\] : 0")
_OUTPUT = re.compile(r"if \(res\[(\d)\]!=0\) res\[\1\]\[(\d+)\]=")
_CONSTANT = re.compile(r"^( *a\d+)=(-?\d[\d.]*(?:e[+-]?\d+)?);$", re.MULTILINE)
_OTHER = re.compile(r"\b(arg|res|iw|w)\b")
_HELPER = re.compile(r"^casadi_real casadi_", re.MULTILINE)
_DEFINITION = re.compile(
    r"^static inline casadi_real casadi_\w+\([^)]*\) \{(?:[^\n]*\}$|.*?^\}$)", re.MULTILINE | re.DOTALL
)
_OF_OURS = """\
#define casadi_real double
#define casadi_inf INFINITY
#define casadi_nan NAN
#ifndef __GNUC__
#define __attribute__(asked)
#endif
"""

SIDE_BY_SIDE = "#pragma omp simd"  # lanes depend on nothing but their own numbers
_LANE_FUNCTION = r"""
static {inlined}void {name}({declared}) {{
  {ignored}
{pragma}
  for (long long l = 0; l < {lanes}; ++l) {{
{defined}
{body}
{undefined}
  }}
}}
"""


class Lanes(NamedTuple):
    """How a C function takes its arguments and results, named in order by letters or words."""

    arguments: str
    results: str
    number: str = "L"
    at: Mapping[str, str] = {}  # where number j of lane l stands, for those that are not packed by lanes
    more: str = ""  # what is declared besides
    inlined: bool = False  # compilers leave out what is called twice, and with it a third of the speed

    def text(self, name: str, body: str, pragma: str = SIDE_BY_SIDE) -> str:
        """The function, from code as of `straight_lines`; it need not read all that it is given."""
        names = self.arguments.split(), self.results.split()
        kinds = [("X", "const double", names[0]), ("Y", "double", names[1])]
        macros = [(f"{x}{i}", word) for x, _, words in kinds for i, word in enumerate(words)]
        declared = [f"{kind} *restrict {word}" for _, kind, words in kinds for word in words]
        place = f"(j) * {self.number} + l"
        return _LANE_FUNCTION.format(
            name=name,
            inlined="inline __attribute__((always_inline)) " if self.inlined else "",
            pragma=pragma,
            ignored=" ".join(f"(void){word};" for _, _, words in kinds for word in words),
            declared=", ".join([self.more] * bool(self.more) + declared),
            lanes=self.number,
            defined="\n".join(
                f"#define {macro}(j) {word}[{self.at.get(word, place)}]" for macro, word in macros
            ),
            body=body,
            undefined="\n".join(f"#undef {macro}" for macro, _ in macros),
        )


def functions_text(
    functions: Mapping[str, tuple[ca.Function, Lanes]], pragma: str = SIDE_BY_SIDE
) -> tuple[str, str]:
    """CasADi's helpers, and a C function for each of its own; one without results does nothing.

    Errors: `NotCompilableError` where CasADi's code is more than straight lines.
    """
    giving = {function.name(): function for function, _ in functions.values() if function.nnz_out()}
    head, bodies = straight_lines(list(giving.values()))
    lines = dict(zip(giving, bodies, strict=True))
    texts = [
        lanes.text(name, lines.get(function.name(), ""), pragma)
        for name, (function, lanes) in functions.items()
    ]
    return head, "".join(texts)


def straight_lines(functions: Sequence[ca.Function]) -> tuple[str, list[str]]:
    """CasADi's helpers and each function's code, its arguments and results behind the macros X0, X1, … and Y0, Y1, ….

    Errors: `NotCompilableError` where that is more than straight lines.
    """
    generator = ca.CodeGenerator("nhpocp_kernel")
    for function in functions:
        generator.add(function)
    text = generator.dump()
    bodies = _FUNCTION.findall(text)
    if len(bodies) != len(functions):
        raise NotCompilableError("CasADi's code for these functions is not straight lines")
    # CasADi's helpers are exported, and so never inlined
    head = _HELPER.sub(
        "static inline casadi_real casadi_", text[: text.index(f"\n/* {functions[0].name()}:(")]
    )
    return head, [_accessed(body) for body in bodies]


def helpers_alone(head: str) -> str:
    """CasADi's helpers in a text that shares its program with others: nothing of it is exported or prefixed."""
    return "\n".join([_OF_OURS, *(definition[0] for definition in _DEFINITION.finditer(head)), ""])


def numbers_apart(text: str) -> tuple[str, Array]:
    """A text with the constants of CasADi's code read from an array, and that.

    Of robots that differ in numbers only one text comes out, and one kernel serves them all.
    """
    numbers = [float(constant) for _, constant in _CONSTANT.findall(text)]
    places = count()
    return _CONSTANT.sub(lambda found: f"{found[1]}=NUMBERS[{next(places)}];", text), np.array(numbers)


def sizes_text(tableau: Tableau, **sizes: int) -> str:
    """Numbers by the letters that the loops call them by; of a tableau S stages and K controls, and PLACE."""
    sizes |= {"S": tableau.stages, "K": tableau.seen}
    return (
        f"\nenum {{ {', '.join(f'{letter} = {size}' for letter, size in sizes.items())} }};\n"
        f"static const int PLACE[S] = {_braced(tableau.places)};\n"
    )


def weights_text(tableau: Tableau) -> str:
    """A and WEIGHT of a tableau, for loops that take its steps themselves."""
    rows = [(*row, *[0.0] * (tableau.stages - len(row))) for row in tableau.rows]
    weights = [tableau.weight(stage) for stage in range(tableau.stages)]
    return f"static const double A[S][S] = {_braced([_braced(row) for row in rows])}, WEIGHT[S] = {_braced(weights)};\n"


def identified(parts: Iterable[ca.Function], tableau: Tableau, *recipe: ModuleType) -> str:
    """A name for the C text that these modules, and this one, make of functions, far cheaper than the text itself."""
    digest = hashlib.sha256()
    for file in (__file__, recipe_of_steps.__file__, *(module.__file__ for module in recipe)):
        digest.update(Path(str(file)).read_bytes())
    return " ".join([digest.hexdigest(), repr(tableau), *(part.serialize() for part in parts)])


def _braced(parts: Sequence[object]) -> str:
    return "{" + ", ".join(map(str, parts)) + "}"


def _accessed(body: str) -> str:
    """A function's code with its arguments and results behind the macros X and Y."""
    body = _OUTPUT.sub(r"Y\1(\2)=", _INPUT.sub(r"X\1(\2)", body))
    if _OTHER.search(body):
        raise NotCompilableError("CasADi's code for this function is not straight lines")
    return body
