#!/usr/bin/env python3
"""The whole benchmark: nhpocp against its peers on the paper's task, how the times grow, and what was wanted of them.

Prints and stores table.md, table.csv, benchmark.json and scaling.png. Interleaved rounds, medians; ratios of one run
mean something, times on a shared machine little. Kernels are built first, where they are not in the cache.
Run: .venv/bin/python scripts/benchmark.py [--rounds 5] [--quick] [--only PART …] [--names WORD …] [-o FOLDER]
Ends with 1 where a wanted line does not hold; --quick (tiny sizes, one round) always with 0.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # cores are counted in processes

import csv
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import scaling
import scaling_picture
import wanted
from contestants import Row, contestants, measured
from many_goals import Throughput, throughput
from measuring import SCRIPTS, Cold, circumstances, cold_rounds

PARTS = ("end-points", "solvers", "command-line", "nlp-curve", "goals")


@dataclass(frozen=True)
class Sizes:
    """What is measured."""

    rounds: int = 5
    steps: tuple[int, ...] = (50, 100, 200, 500, 1000)
    harmonics: tuple[int, ...] = (2, 5, 10, 20, 50)
    harmonics_at: int = 500  # steps
    intervals: tuple[int, ...] = (50, 100, 200, 500, 1000)
    goals: tuple[int, ...] = (1, 10, 100, 1000, 10_000)
    cores: tuple[int, ...] = (1, 2)
    table: tuple[int, int] = (50, 100)  # intervals, steps


QUICK = Sizes(1, (5, 10), (2, 3), 10, (5,), (1, 2), (1, 2), (10, 20))


@dataclass
class Results:
    """Everything that was measured, plain."""

    circumstances: dict[str, Any]
    sizes: Sizes
    rows: list[Row] = field(default_factory=list)
    processes: dict[str, Cold] = field(default_factory=dict)
    steps: scaling.Curves = field(default_factory=dict)
    harmonics: scaling.Curves = field(default_factory=dict)
    intervals: scaling.Curves = field(default_factory=dict)
    goals: Throughput | None = None

    def lines(self) -> list[wanted.Line]:
        return [
            *wanted.end_points(self.steps, self.harmonics),
            *(wanted.solves(self.rows) if self.rows else ()),
            *wanted.command_line(self.processes),
            *wanted.rates(self.goals, self.sizes.cores),
        ]


def end_points(results: Results, names: Sequence[str]) -> None:
    sizes = results.sizes
    results.steps = scaling.over_steps(sizes.steps, sizes.rounds)
    results.harmonics = scaling.over_harmonics(sizes.harmonics, sizes.rounds, sizes.harmonics_at)


def solvers(results: Results, names: Sequence[str]) -> None:
    everybody = contestants(*results.sizes.table)
    taking_part = [one for one in everybody if not names or any(name in one.name for name in names)]
    if not taking_part:
        sys.exit(f"nobody has {' or '.join(names)} in the name: {'; '.join(one.name for one in everybody)}")
    results.rows = measured(taking_part, results.sizes.rounds)


def command_line(results: Results, names: Sequence[str]) -> None:
    """`nhpocp solve` with verification and files, against importing what it cannot do without."""
    with tempfile.TemporaryDirectory() as folder:
        solve = ["solve", str(SCRIPTS.parent / "problems" / "paper.yaml"), "--set", "output.pictures=false"]
        program = "import sys; from nhpocp.cli import main; sys.exit(main())"
        commands = {
            "nhpocp solve": [sys.executable, "-c", program, *solve, "-o", str(Path(folder) / "solution")],
            "imports": [sys.executable, "-c", "import casadi, numpy, scipy.integrate"],
        }
        results.processes = cold_rounds(commands, results.sizes.rounds)


def nlp_curve(results: Results, names: Sequence[str]) -> None:
    results.intervals = scaling.over_intervals(results.sizes.intervals, results.sizes.rounds)


def goals(results: Results, names: Sequence[str]) -> None:
    sizes = results.sizes
    results.goals = throughput(sizes.goals, sizes.cores, sizes.rounds)


MEASURES: dict[str, Callable[[Results, Sequence[str]], None]] = dict(
    zip(PARTS, (end_points, solvers, command_line, nlp_curve, goals), strict=True)
)


def table(rows: Sequence[Row]) -> list[str]:
    """The contestants in Markdown."""
    if not rows:
        return []
    opti = next((row.solve for row in rows if row.name == "Opti"), None)
    lines = [
        "| | warm solve [ms] | of Opti | ready [s] | whole process [s] | peak [MB] | error | ∫\\|v\\|² | least |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.name} | {1e3 * row.solve:.3g} | {wanted.written(row.solve / opti) if opti else '–'} "
        f"| {row.ready:.2f} | {row.cold:.2f} | {row.megabytes:.0f} | {row.error:.1e} | {row.effort:.4f} "
        f"| {'yes' if row.least or 'NLP' in row.name else 'no'} |"
        for row in rows
    ]
    return lines


def curves(words: str, found: scaling.Curves, unit: str = "ms", factor: float = 1e3) -> list[str]:
    """Curves in Markdown."""
    if not found:
        return []
    sizes = sorted({size for curve in found.values() for size in curve})
    lines = ["", f"| {words} [{unit}] | {' | '.join(map(str, sizes))} |", "|---" * (len(sizes) + 1) + "|"]
    for name, curve in found.items():
        cells = [f"{factor * curve[size]:.3g}" if size in curve else "–" for size in sizes]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def told(results: Results) -> str:
    """Everything in Markdown."""
    machine = results.circumstances
    lines = [
        f"{machine['date']}, {machine['processor']}, {machine['cores']} cores, load {machine['load']}, "
        f"{results.sizes.rounds} rounds; Python {machine['python']}, CasADi {machine.get('casadi')}, "
        f"NumPy {machine.get('numpy')}, SciPy {machine.get('scipy')}; {machine['compiler']}",
        "",
        *table(results.rows),
    ]
    if results.processes:
        lines += ["", "| whole process | [s] | peak [MB] |", "|---|---|---|"]
        lines += [
            f"| {name} | {one.seconds:.2f} | {one.megabytes:.0f} |" for name, one in results.processes.items()
        ]
    lines += curves("end point + Jacobian, h = 2, over N", results.steps)
    lines += curves(f"the same, N = {results.sizes.harmonics_at}, over h", results.harmonics)
    lines += curves("NLP over N", results.intervals, "s", 1)
    if results.goals:
        lines += curves("all goals, over their number", results.goals.seconds, "s", 1)
    lines += ["", *map(str, results.lines())]
    return "\n".join(lines) + "\n"


def store(results: Results, folder: Path) -> None:
    """The files; the picture where every curve was measured."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "table.md").write_text(told(results), encoding="utf-8")
    with (folder / "table.csv").open("w", encoding="utf-8", newline="") as target:
        writer = csv.DictWriter(target, [one.name for one in fields(Row)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in results.rows)
    plain = asdict(results) | {"wanted": [asdict(line) | {"holds": line.holds} for line in results.lines()]}
    text = json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "benchmark.json").write_text(text, encoding="utf-8")
    if results.goals and results.steps and results.intervals:
        figure = scaling_picture.picture(
            results.steps, results.harmonics, results.sizes.harmonics_at, results.intervals, results.goals
        )
        scaling_picture.save(figure, folder)


def read(words: Sequence[str] | None = None) -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="tiny sizes, one round: does everything run?")
    parser.add_argument("--only", nargs="+", choices=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--names", nargs="+", default=(), help="of contestants, or parts of names")
    parser.add_argument("-o", "--output", type=Path, default=Path("results") / "benchmark")
    return parser.parse_args(words)


def main(arguments: argparse.Namespace) -> int:
    sizes = QUICK if arguments.quick else Sizes(rounds=arguments.rounds)
    results = Results(circumstances(), sizes)
    for part in arguments.only or PARTS:
        print(f"{part} …", file=sys.stderr, flush=True)
        MEASURES[part](results, arguments.names)
        store(results, arguments.output)  # what is there is there, should the next part fail
    print(told(results), end="")
    failed = [line for line in results.lines() if line.holds is False]
    return 1 if failed and not arguments.quick else 0


if __name__ == "__main__":
    sys.exit(main(read()))
