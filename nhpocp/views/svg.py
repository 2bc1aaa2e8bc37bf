"""A figure as SVG inside a page: no ids that clash, no address, no more digits than paper shows."""

from __future__ import annotations

import re
from io import StringIO

from markupsafe import Markup, escape
from matplotlib.figure import Figure

from nhpocp.views.style import sheet

IMAGES = 200  # dots per inch of what is no line: dense clouds and maps
_NUMBER = re.compile(r"-?\d+\.\d{3,}")


def inline_svg(figure: Figure, prefix: str, description: str) -> Markup:
    """The figure as an <svg> element that fills its container; ``description`` is read to those who do not see it."""
    stream = StringIO()
    with sheet():
        figure.savefig(stream, format="svg", dpi=IMAGES, metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href", "href")
    # clip paths and glyphs are named by their content: the same names in every figure of a page
    text = re.sub(r'(\sid="|href="#|url\(#)', rf"\g<1>{prefix}-", text)
    text = re.sub(r'\sd="[^"]*"', lambda outline: _NUMBER.sub(_short, outline[0]), text)
    text = re.sub(r"\n\s*", "\n", text)
    head = re.match(r"<svg[^>]*>", text)
    box = re.search(r'viewBox="[^"]*"', text)
    if head is None or box is None:
        raise ValueError("matplotlib wrote an SVG without a viewBox")
    opening = Markup('<svg role="img" aria-label="{}" {}>').format(escape(description), Markup(box[0]))
    return opening + Markup(text[head.end() :].strip())


def _short(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")
