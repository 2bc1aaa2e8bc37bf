"""What the benchmark must show: every line a bound, what was seen, and whether it holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from contestants import Row
from many_goals import Throughput, crew_name
from measuring import Cold
from scaling import Curves

NOISE = 1.1  # of a ratio that theory fixes
SAME_OPTIMUM = 1e-6


@dataclass(frozen=True)
class Line:
    """At most ``most``, or at least ``least``, was wanted of ``seen``."""

    words: str
    seen: float | None  # None: not measured
    most: float | None = None
    least: float | None = None
    unit: str = ""

    @property
    def holds(self) -> bool | None:
        if self.seen is None:
            return None
        below = self.most is None or self.seen <= self.most
        return below and (self.least is None or self.seen >= self.least)

    def __str__(self) -> str:
        bounds = [f"≥ {written(self.least)}"] if self.least is not None else []
        bounds += [f"≤ {written(self.most)}"] if self.most is not None else []
        seen = "not measured" if self.seen is None else written(self.seen) + self.unit
        word = {None: "-", True: "yes", False: "NO"}[self.holds]
        return f"{word:3}  wanted {' and '.join(bounds) + self.unit:18} seen {seen:14} {self.words}"


def written(number: float) -> str:
    """1/120 for ratios far below one."""
    return f"1/{1 / number:.3g}" if 5e-4 < number < 0.5 else f"{number:.3g}"


def ratio(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one / other


def end_points(steps: Curves, harmonics: Curves) -> Iterator[Line]:
    """Of the curves; the sizes are those at hand."""
    if steps:
        plain, compiled = steps["plain ca.jacobian"], steps["rk4, compiled"]
        few = 100 if 100 in plain else min(plain)
        words = f"of plain ca.jacobian: end point + Jacobian, h=2, N={few}"
        yield Line(f"{words}, kernel", compiled[few] / plain[few], 1 / 150)
        yield Line(f"{words}, interpreted", steps["rk4, interpreted"][few] / plain[few], 1 / 8)
        ends = min(compiled), max(compiled)
        growth = compiled[ends[1]] / compiled[ends[0]] / (ends[1] / ends[0])
        yield Line(f"times linear growth from N={ends[0]} to N={ends[1]}, kernel", growth, NOISE)
    if harmonics:
        compiled = harmonics["rk4, compiled"]
        ends = min(compiled), max(compiled)
        yield Line(f"from h={ends[0]} to h={ends[1]}, kernel", compiled[ends[1]] / compiled[ends[0]], 2.0)


def solves(rows: Sequence[Row]) -> Iterator[Line]:
    """Of the table."""
    warm: Mapping[str, float] = {row.name: row.solve for row in rows}
    for name in ("continuation, γ = 1", "continuation, auto"):
        for evaluation, most in (("compiled", 1 / 300), ("interpreted", 1 / 70)):
            one = f"{name}, {evaluation}"
            yield Line(f"of Opti's warm solve: {one}", ratio(warm.get(one), warm.get("Opti")), most)
    yield Line("of rockit: Opti", ratio(warm.get("Opti"), warm.get("rockit")), 1.1, 0.9)
    least = "null-space optimum, compiled", "single shooting, L-BFGS"
    yield Line(f"of {least[1]}: {least[0]}", ratio(warm.get(least[0]), warm.get(least[1])), 1 / 5)
    for name, most in (("NLP, interpreted", 1.0), ("NLP, compiled", 1 / 4)):
        yield Line(
            f"of nlpsol's warm solve: {name} (building included)",
            ratio(warm.get(name), warm.get("nlpsol")),
            most,
        )
    optima = {row.name: row.objective for row in rows}
    for name in ("NLP, interpreted", "NLP, compiled"):
        apart = abs(optima[name] - optima["nlpsol"]) if name in optima and "nlpsol" in optima else None
        yield Line(f"between the least efforts of {name} and nlpsol", apart, SAME_OPTIMUM)


def command_line(processes: Mapping[str, Cold]) -> Iterator[Line]:
    """Of whole processes."""
    if not processes:
        return
    solve, imports = processes["nhpocp solve"], processes["imports"]
    yield Line(
        "of importing casadi, numpy, scipy.integrate: nhpocp solve", solve.seconds / imports.seconds, 2.5
    )
    yield Line("peak memory of nhpocp solve", solve.megabytes, 200.0, unit=" MB")


def rates(found: Throughput | None, cores: Sequence[int]) -> Iterator[Line]:
    """Of the largest number of goals."""
    if found is None:
        return
    for number in cores:
        times = found.seconds[crew_name(number, "compiled")]
        count = max(times)
        words = f"per core: {count} goals on {number} core{'s' if number > 1 else ''}, kernel"
        yield Line(words, count / times[count] / number, least=400.0, unit=" solves/s")
    yield Line("goals planned to and verified", found.verified / found.tried, least=1.0)
