r"""A comparison or a study as a table for LaTeX, as booktabs rules it: `\input{comparison}` puts it into a paper."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from nhpocp.comparison import Comparison, Group
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.survey import Survey
from nhpocp.views.report_words import control_symbol, run_names, titles

MARKER = "% nhpocp "
HEAD = r": \input this file in a table; the preamble needs \usepackage{booktabs}"
MISSING = "--"
_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\ensuremath{<}",
    ">": r"\ensuremath{>}",
    "|": r"\ensuremath{|}",
    "$": r"{\char36}",  # \$ is in fonts that small installations do not have
    '"': r"{\char34}",
    "`": r"{\char96}",
    "[": "{[}",  # after the end of a row it would begin a length
    "*": "{*}",  # and this would forbid a page break
    "-": "{-}",  # two would become a dash
    **{letter: "\\" + letter for letter in "&%#_{}"},
}
_ACCENTS = dict(
    zip("\u0300\u0301\u0302\u0303\u0308\u0304\u0306\u0307\u030c\u0327", "`'^~\"=u.vc", strict=True)
)

_SIGNS = {"∫": r"\int ", "²": "^2", " dt": r"\,\mathrm{d}t"}
# the pieces of an integral that LaTeX does not take as they are
_PIECE = re.compile(r" dt\b|(?P<word>[A-Za-z]\w{2,})|(?P<rate>[A-Za-z]\u0307)|[^\w|()/+=., ]|_", re.ASCII)


def escaped(text: str) -> str:
    """Any text as LaTeX that prints it; a letter that LaTeX itself does not have as its number in Unicode."""
    return "".join(map(_letter, text))


def _letter(letter: str) -> str:
    if letter.isascii():
        return _SPECIAL.get(letter, letter if letter.isprintable() else " ")
    apart = unicodedata.normalize("NFD", letter)
    base, marks = apart[:1], apart[1:]
    if len(marks) == 1 and base.isascii() and base.isalpha() and marks in _ACCENTS:
        return f"\\{_ACCENTS[marks]}{{{base}}}"
    return f"U+{ord(letter):04X}"


def number(value: float | None, digits: int = 4) -> str:
    """A number for a table: few digits, powers of ten written out."""
    if value is None or not math.isfinite(value):
        return MISSING
    mantissa, mark, exponent = f"{value:.{digits}g}".partition("e")
    if mark:
        return rf"${mantissa}\times10^{{{int(exponent)}}}$"
    return f"${mantissa}$" if value < 0 else mantissa


class _Column(NamedTuple):
    head: str
    align: str
    cell: Callable[[Mapping[str, Any]], str]


def latex_table(comparison: Comparison) -> str:
    """The runs of a comparison as one `tabular`, a row each; several problems stand over their runs, or name them
    where each has one."""
    groups = comparison.groups
    columns = _columns(groups, comparison.rows())
    lines = []
    alone = len(groups) > 1 and all(len(group.entries) == 1 for group in groups)
    for i, group in enumerate(groups):
        lines += [] if i and alone else [r"\midrule"]
        if len(groups) > 1 and not alone:
            lines.append(rf"\multicolumn{{{len(columns)}}}{{@{{}}l}}{{\textbf{{{escaped(group.title)}}}}} \\")
        names = [group.title] if alone else _short(titles(group.entries))
        for name, row in zip(names, Comparison(group.entries).rows(), strict=True):
            lines.append(_row([column.cell({**row, "title": name}) for column in columns]))
    return _tabular("compare", columns, lines)


def study_table(survey: Survey) -> str:
    """The solvers of a study as one `tabular`, a row each: shares, medians of the solved runs and, where there are
    several, shifted geometric means."""
    measured = {quantity.kind: quantity.name for quantity in survey.quantities}
    kinds = [(kind, measured[kind]) for kind in HEADS if kind in measured]
    heads = {
        **HEADS,
        "cost": cost_mathematics(OBJECTIVES[survey.cost].symbol, control_symbol(survey.problem)),
    }
    columns = [
        _Column("solver", "l", lambda row: escaped(row["name"])),
        _Column("runs", "r", lambda row: number(row["stored"], 15)),
        _Column(r"solved [\%]", "r", lambda row: _percent(row["share"], 1)),
        *(_Column(heads[kind], "r", partial(_cell, name)) for kind, name in kinds),
        *(
            _Column(
                rf"mean {heads[kind]} ($s={number(survey.profiles[name].shift).strip('$')}$)",
                "r",
                partial(_cell, f"mean {name}"),
            )
            for kind, name in kinds
            if name in survey.profiles
        ),
    ]
    lines = [r"\midrule"]
    for k, (name, label) in enumerate(zip(_short(run_names(survey.solvers)), survey.solvers, strict=True)):
        stored, solved = survey.tallies[label]
        row = {"name": name, "stored": stored, "share": solved / stored if stored else None}
        row |= {which: survey.spreads[which][label].at(0.5) for _, which in kinds}
        row |= {f"mean {which}": profile.means[k] for which, profile in survey.profiles.items()}
        lines.append(_row([column.cell(row) for column in columns]))
    return _tabular("sweep", columns, lines)


HEADS = {"cost": "", "error": r"$\mathcal{E}$", "evaluations": "evaluations", "seconds": "time [s]"}


def _cell(name: str, row: Mapping[str, Any]) -> str:
    return number(row[name], 3)


def _tabular(verb: str, columns: Sequence[_Column], lines: Sequence[str]) -> str:
    return "\n".join(
        [
            MARKER + verb + HEAD,
            rf"\begin{{tabular}}{{@{{}}{''.join(column.align for column in columns)}@{{}}}}",
            r"\toprule",
            _row([column.head for column in columns]),
            *lines,
            r"\bottomrule",
            r"\end{tabular}",
            "",
        ]
    )


def _short(names: Sequence[str]) -> list[str]:
    """What tells runs apart: of one method alone its settings."""
    parts = [re.fullmatch(r"(.*?) \((.*)\)", name) for name in names]
    methods = {part[1] for part in parts if part}
    return [part[2] for part in parts if part] if all(parts) and len(methods) == 1 else list(names)


def _row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _columns(groups: Sequence[Group], rows: Sequence[Mapping[str, Any]]) -> list[_Column]:
    """The columns; the ending only where one is no success."""
    failed = not all(row["converged"] for row in rows)
    ending = [_Column("ending", "l", lambda row: escaped(row["outcome"].replace("_", " ")))] if failed else []
    return [
        _Column("run", "l", lambda row: escaped(row["title"])),
        _Column("basis", "l", lambda row: escaped((row["basis"] or MISSING).replace("_", " "))),
        *ending,
        _Column(r"$\mathcal{E}$", "r", lambda row: number(row["verified_error"], 2)),
        _Column(_cost(groups), "r", lambda row: number(row["objective_value"])),
        _Column(r"gap [\%]", "r", lambda row: _percent(row["optimality_gap"])),
        _Column("evaluations", "r", lambda row: number(row["evaluations"], 15)),
        _Column("time [s]", "r", lambda row: number(_seconds(row), 2)),
    ]


def _percent(share: float | None, places: int = 2) -> str:
    return MISSING if share is None else f"{100 * share + 0.0:.{places}f}"


def _seconds(row: Mapping[str, Any]) -> float:
    return float(sum(row[key] or 0.0 for key in ("build_s", "solve_s")))


def _cost(groups: Sequence[Group]) -> str:
    """The objective as mathematics, where all problems have the same."""
    symbols = {(OBJECTIVES[g.problem.objective].symbol, control_symbol(g.problem)) for g in groups}
    return cost_mathematics(*symbols.pop()) if len(symbols) == 1 else "cost"


def cost_mathematics(symbol: str, control: str) -> str:
    """A cost as mathematics, or as words where it is none."""
    text = symbol.format(control=control)
    if not text.startswith("∫"):
        return escaped(text)
    return f"${_PIECE.sub(_mathematics, unicodedata.normalize('NFD', text))}$"


def _mathematics(piece: re.Match[str]) -> str:
    """A piece of an integral; a letter that mathematics does not have is text there."""
    letters = piece[0]
    if piece.lastgroup == "word":
        return rf"\mathrm{{{escaped(letters)}}}"
    if piece.lastgroup == "rate":
        return rf"\dot{{{letters[0]}}}"
    return _SIGNS[letters] if letters in _SIGNS else rf"\mbox{{{escaped(letters)}}}"
