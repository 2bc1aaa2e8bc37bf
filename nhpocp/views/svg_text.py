"""SVG whose text is text, found by a search and changed by an editor, in fonts that the file brings along."""

from __future__ import annotations

import base64
import logging
import re
from collections import defaultdict
from collections.abc import Mapping
from html import escape, unescape
from io import BytesIO, StringIO
from itertools import groupby
from typing import Any, cast

from matplotlib import font_manager, rc_context
from matplotlib.figure import Figure

# of the widths of STIX, for programs that do not read the fonts of a file
OTHERS = "'STIX Two Text', 'Times New Roman', Times, 'Liberation Serif', serif"
_FONT = re.compile(r"font-family: '(\w+)'")
_SPANS = re.compile(r"<text>\s*((?:<tspan [^>]*>[^<]*</tspan>\s*)+)</text>")
_SPAN = re.compile(r'<tspan x="([^"]*)" y="([^"]*)" style="([^"]*)">([^<]*)</tspan>')
_TEXT = re.compile(r'<(?:text|tspan)\b[^>]*style="([^"]*font-family[^"]*)"[^>]*>([^<]+)<')
_APART = re.compile(r"[=+−<>≤≥±·]")  # what mathematics sets with room around it

Face = tuple[str, str, str]  # family, style and weight, as CSS has them


def text_svg(figure: Figure, metadata: Mapping[str, Any]) -> str:
    """The figure as SVG; the same figure gives the same text."""
    stream = StringIO()
    with rc_context({"svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata=dict(metadata))
    text = _SPANS.sub(_in_words, stream.getvalue())
    faces = "".join(_face(face, used) for face, used in sorted(_used(text).items()))
    text = _FONT.sub(rf"font-family: '\1', {OTHERS}", text)
    return text.replace('<style type="text/css">', f'<style type="text/css">{faces}', 1)


def _in_words(formula: re.Match[str]) -> str:
    """Matplotlib sets every letter of a formula by itself; those of one word are put together again."""
    letters = sorted(_SPAN.findall(formula[1]), key=lambda span: float(span[0]))
    runs = []
    place = 0
    for i, (_, y, style, letter) in enumerate(letters):
        before = letters[i - 1] if i else None
        apart = before is None or (y, style) != before[1:3] or _APART.search(letter + before[3])
        place += bool(apart)
        runs.append(place)
    words = []
    for _, pairs in groupby(zip(runs, letters, strict=True), key=lambda pair: pair[0]):
        spans = [span for _, span in pairs]
        (x, y, style, _), word = spans[0], "".join(letter for *_, letter in spans).replace("\xa0", " ")
        words.append(f'<tspan x="{x}" y="{y}" style="{style}">{word}</tspan>')
    return f'<text xml:space="preserve">{"".join(words)}</text>'


def _used(text: str) -> dict[Face, set[str]]:
    """The letters of every face that a text uses."""
    used: dict[Face, set[str]] = defaultdict(set)
    for style, letters in _TEXT.findall(text):
        css = dict(part.split(": ", 1) for part in style.split("; "))
        family = css["font-family"].split("'")[1]
        used[family, css.get("font-style", "normal"), css.get("font-weight", "400")] |= set(unescape(letters))
    return used


def _face(face: Face, letters: set[str]) -> str:
    """The part of a font that has these letters, as a rule of a style sheet."""
    from fontTools import subset
    from fontTools.ttLib import TTFont

    family, style, weight = face
    wanted = font_manager.FontProperties(family=family, style=cast(Any, style), weight=int(weight))
    file = font_manager.findfont(wanted, fallback_to_default=False)
    logging.getLogger("fontTools").setLevel(logging.ERROR)  # it tells of tables that it leaves out
    options = subset.Options(layout_features=[], hinting=False, recalc_timestamp=False)
    font, stream = TTFont(file, recalcTimestamp=False), BytesIO()
    subsetter = subset.Subsetter(options)
    subsetter.populate(text="".join(sorted(letters)))
    subsetter.subset(font)
    font.save(stream)
    data = base64.b64encode(stream.getvalue()).decode()
    return (
        f"@font-face {{ font-family: {escape(family)}; font-style: {style}; font-weight: {weight}; "
        f"src: url(data:font/ttf;base64,{data}); }}\n"
    )
