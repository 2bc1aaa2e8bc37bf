"""MJCF, the text that MuJoCo reads: elements whose attributes are numbers and arrays. [mujoco.readthedocs.io, XML]"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

Element = ElementTree.Element


def add(parent: Element, tag: str, **attributes: Any) -> Element:
    """A new element in another; a trailing underscore of a name is dropped, and None leaves the attribute out."""
    words = {name.rstrip("_"): _text(value) for name, value in attributes.items() if value is not None}
    return ElementTree.SubElement(parent, tag, words)


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    return " ".join(f"{number:.12g}" for number in np.ravel(np.asarray(value, dtype=float)) + 0.0)  # no -0


def as_text(root: Element) -> str:
    """The document, indented."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def axes(rotation: Any) -> Any:
    """The attribute xyaxes of a frame: the first two columns of its rotation matrix."""
    return np.concatenate([rotation[:, 0], rotation[:, 1]])
