"""Pictures for papers: as wide as a column, text as text, fonts that journals take."""

from __future__ import annotations

import re
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest

from nhpocp.views.figures import FIGURES, write_pictures
from nhpocp.views.style import DOTS_PER_INCH, Room
from tests.views.test_figures import failed, good, lines_of, spinner, toy

COLUMN = Room(84 / 25.4)  # inches


def words(file: Path) -> list[str]:
    """What an SVG says, a text each."""
    return [
        "".join(text.itertext()) for text in ElementTree.parse(file).iter("{http://www.w3.org/2000/svg}text")
    ]


@pytest.mark.parametrize(
    ("case", "name"),
    [
        *((good, name) for name in FIGURES),
        (failed, "failure"),
        (toy, "robot"),
        (toy, "margins"),
        (spinner, "robot"),
    ],
)
def test_every_picture_fits_a_column(case: Any, name: str, tmp_path: Path) -> None:
    (file,) = write_pictures(case(), tmp_path, ("png",), [name], COLUMN)
    width, _ = struct.unpack(">II", file.read_bytes()[16:24])
    assert abs(width / DOTS_PER_INCH - 84 / 25.4) < 2 / DOTS_PER_INCH


@pytest.mark.parametrize(("millimetres", "side_by_side"), [(84, 1), (125, 1), (140, 2), (174, 2)])
def test_panels_stand_as_the_width_allows(millimetres: float, side_by_side: int) -> None:
    figure = FIGURES["relative_pose"](good(), room=Room(millimetres / 25.4))
    assert figure.axes[0].get_gridspec().get_geometry() == (2 // side_by_side, side_by_side)
    assert figure.get_figwidth() == pytest.approx(millimetres / 25.4)


def test_a_height_that_is_asked_for_is_kept() -> None:
    for name in FIGURES:
        assert FIGURES[name](good(), room=Room(3.3, 2.0)).get_size_inches() == pytest.approx([3.3, 2.0])


def test_in_a_column_nothing_is_cut_and_no_text_lies_on_another(tmp_path: Path) -> None:
    for name in ("controls", "relative_pose", "convergence"):
        figure = FIGURES[name](good(), room=COLUMN)
        figure.savefig(tmp_path / "drawn.png")
        axes = figure.axes
        labels = [label for own in axes for label in (own.xaxis.label, own.yaxis.label)]
        boxes = [text.get_window_extent() for text in labels]
        boxes += [own.get_legend().get_window_extent() for own in axes]
        for i, box in enumerate(boxes):
            inside = figure.bbox.padded(1)
            assert inside.contains(box.x0, box.y0)
            assert inside.contains(box.x1, box.y1)
            assert not any(box.overlaps(other) for other in boxes[:i])
        assert all(lines_of(own) for own in axes)


@pytest.mark.parametrize("millimetres", [60, 84, 100, 120, 174])
def test_the_names_of_the_axes_of_a_mechanism_stay_in_its_view(millimetres: float) -> None:
    """A narrow view leaves as much room for them as a wide one."""
    figure = FIGURES["robot"](good(), room=Room(millimetres / 25.4))
    figure.draw_without_rendering()
    rights = [axes.get_position(original=True).x1 * figure.bbox.width for axes in figure.axes]
    gap = 0.05 * figure.bbox.width / len({axes.get_position().x0 for axes in figure.axes})
    for axes, right in zip(figure.axes, rights, strict=True):
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            box = axis.label.get_window_extent()
            assert box.x1 <= right + gap
            assert figure.bbox.contains(box.x0, box.y0)
            assert figure.bbox.contains(box.x1, box.y1)


def test_text_of_svg_is_text_in_fonts_of_its_own(tmp_path: Path) -> None:
    first, *_ = files = write_pictures(good(), tmp_path / "a", ("svg",), room=COLUMN, text=True)
    said = words(first)
    assert {"control v [rad per unit time]", "leg length l [length]", "v1"} <= set(said)
    every = "".join(file.read_text(encoding="utf-8") for file in files)
    faces = set(re.findall(r"@font-face \{ font-family: (\w+); font-style: (\w+)", every))
    assert {("STIXGeneral", "normal"), ("STIXGeneral", "italic")} <= faces
    for file in files:
        text = file.read_text(encoding="utf-8")
        used = set(re.findall(r"font-family: '(\w+)'", text))
        assert used <= set(re.findall(r"font-family: (\w+)", text))
        assert not any(
            0xE000 <= ord(letter) < 0xF900 for letter in "".join(words(file))
        )  # no font's private letters
    (again,) = write_pictures(good(), tmp_path / "b", ("svg",), [first.stem], room=COLUMN, text=True)
    assert first.read_bytes() == again.read_bytes()


def test_fonts_of_pdf_are_type_42_and_embedded(tmp_path: Path) -> None:
    for file in write_pictures(good(), tmp_path, ("pdf",), ["controls", "robot"], room=COLUMN):
        content = file.read_bytes()
        assert b"/Type3" not in content.replace(b" ", b"")
        assert b"/CIDFontType2" in content
        assert b"/FontFile2" in content
