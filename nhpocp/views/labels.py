"""What a quantity is called on axes and in pages: words, symbol and unit, as mathtext, HTML or plain text."""

from __future__ import annotations

import re
from html import unescape
from typing import NamedTuple

from markupsafe import Markup, escape

from nhpocp.state_space import scalar
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS
from nhpocp.systems.margins import margin, sigma
from nhpocp.systems.system import System
from nhpocp.units import Units

LEGS = ("leg_lengths", "u", LEG_ACCELERATIONS)  # the quantities of legs
UNNAMED = Units()
_GREEK = dict(
    zip(
        (
            *("alpha", "beta", "gamma", "delta", "theta", "phi", "varphi", "psi", "omega", "Omega", "sigma"),
            *("lambda", "kappa", "rho", "tau"),
        ),
        "αβγδθφφψωΩσλκρτ",
        strict=True,
    )
)


class Notation(NamedTuple):
    """How one number of a quantity is written.

    ``words``: its name where it has one besides its symbol; ``symbol``: mathtext; ``unit``: words, "rad per unit time"
    say, "" for a number that has none and for one whose unit nobody states.
    """

    words: str
    symbol: str
    unit: str


def notation(system: System, name: str, *place: int, units: Units = UNNAMED) -> Notation:
    """Words, symbol and unit of an entry of a system's trajectories; ``place`` picks a component;
    inputs are rates of what their unit says."""
    blocks = {block.name: block for block in (*system.state_space.blocks, *system.quantity_blocks)}
    inputs = {block.name: block for block in system.input_space.blocks}
    if margin(name):
        return Notation("least singular value", symbol(name), "–")
    block = inputs.get(name) or blocks.get(name) or scalar(name)
    # the numbers of a unit vector are none of its angle
    unit = "" if block.kind == "direction" else units.words(block.unit, block.rate or name in inputs)
    words = "control" if name in inputs else block.words
    return Notation(words, symbol(block.symbol or name, *place), unit)


def axis_label(words: str, mathtext: str, unit: str) -> str:
    """A label such as "leg length $l_{1}$ [length]"."""
    return " ".join(part for part in (words, mathtext, f"[{unit}]" if unit else "") if part)


def symbol(name: str, *place: int) -> str:
    r"""Mathematics for a name: theta0_dot → $\dot{\theta}_0$, (v, 0) → $v_1$, det_s → $\det\,S$; long words stay."""
    if known := margin(name):
        return f"${known.symbol if known.matrix != 'jacobian' else sigma('j').symbol}$"
    parts = re.fullmatch(r"(.*?)_?(\d*)(_[a-z])?(_dot)?", name)
    stem, number, axis, dot = parts.groups() if parts else (name, "", None, None)
    indices = [number + (axis or "").lstrip("_"), *(str(index + 1) for index in place)]
    below = ",".join(index for index in indices if index)
    if stem in _GREEK:
        stem = "\\" + stem
    elif len(stem) > 1 and not stem.startswith("\\"):
        return " ".join([name.replace("_", " "), *indices[1:]])
    stem = rf"\dot{{{stem}}}" if dot else stem
    return f"${stem}_{{{below}}}$" if below else f"${stem}$"


def markup(label: str) -> Markup:
    r"""A label with mathematics as HTML: "length $l_{1}$" → "length <i>l</i><sub>1</sub>"."""
    parts = label.split("$")
    return Markup("").join(_formula(part) if i % 2 else escape(part) for i, part in enumerate(parts))


def _formula(mathtext: str) -> Markup:
    text = re.sub(r"\\math\w+\{(\w+)\}", r"\1", str(escape(mathtext)))
    text = (
        re.sub(r"\\dot(?:\{([^}]*)\}|(\\[a-z]+)| (\w))", "\\1\\2\\3\N{COMBINING DOT ABOVE}", text)
        .replace(r"\dots", "…")
        .replace(r"\,", " ")
        .replace(" - ", " − ")
    )
    text = re.sub(r"\\([A-Za-z]+)", lambda command: _GREEK.get(command[1], command[1]), text)
    # letters on their own are variables; min, det and log are not
    text = re.sub(r"(?<![A-Za-z&])[A-Za-zα-ωΩ]\N{COMBINING DOT ABOVE}?(?![A-Za-z])", r"<i>\g<0></i>", text)
    for mark, tag in (("_", "sub"), ("^", "sup")):
        inner = rf"\{mark}(?:\{{((?:[^{{}}]|\{{[^{{}}]*\}})*)\}}|(<i>\w</i>|\w))"
        text = re.sub(inner, lambda part, tag=tag: f"<{tag}>{_upright(part[1] or part[2])}</{tag}>", text)  # type: ignore[misc]
    return Markup(re.sub(r"[{}]", "", text))


def _upright(text: str) -> str:
    return re.sub(r"</?i>", "", text)


_LOWERED = str.maketrans("0123456789aehijklmnoprstuvx", "₀₁₂₃₄₅₆₇₈₉ₐₑₕᵢⱼₖₗₘₙₒₚᵣₛₜᵤᵥₓ")


def plain_words(label: str) -> str:
    r"""A label without its mathematics: "leg length $l_{1}$" → "leg length l₁", $\sigma_{\min}(S)$ → "σmin(S)"."""

    def lowered(subscript: re.Match[str]) -> str:
        short = re.fullmatch(r"\w(,\w)*|\d+", subscript[1])
        return subscript[1].translate(_LOWERED) if short else subscript[1]

    text = re.sub(r"<sub>(.*?)</sub>", lowered, str(markup(label)))
    return unescape(re.sub(r"<[^>]*>", "", text))
