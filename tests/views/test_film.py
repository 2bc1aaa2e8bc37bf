"""Films for slides: a GIF that Pillow opens and that moves, MP4 through ffmpeg where there is one."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from nhpocp.errors import InvalidProblemError, MissingDependencyError
from nhpocp.views import film
from nhpocp.views.animation import MARKER
from tests.views.test_animation import entries
from tests.views.test_figures import crossing, of_library

FFMPEG = """#!{python}
import sys
data = sys.stdin.buffer.read()
if {fails}:
    sys.exit("a wrong codec")
size = sys.argv[sys.argv.index("-s") + 1]
open(sys.argv[-1], "w").write(f"{{len(data)}} {{size}} {{' '.join(sys.argv)}}")
"""


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(film, "FRAMES", 4)


def test_a_gif_moves_and_says_who_made_it(tmp_path):
    seen = []
    runs = entries(of_library("unicycle"), replace(of_library("unicycle"), solver="nlp"))
    file = film.write_film(runs, tmp_path / "a.gif", "gif", lambda k, count: seen.append((k, count)))
    with Image.open(file) as picture:
        assert picture.n_frames == 4
        assert picture.size == (1080, 540)
        frames = []
        for k in range(4):
            picture.seek(k)
            frames.append(np.asarray(picture.convert("RGB"), dtype=int))
    assert (frames[0][:5, :5] == 255).all()
    assert all(np.abs(frames[k + 1] - frames[k]).max() > 100 for k in range(3))
    assert seen == [(k, 4) for k in range(1, 5)]
    assert MARKER.encode() in file.read_bytes()
    assert file.stat().st_size < 2e5


def test_a_robot_in_space_has_a_film(tmp_path):
    film.write_film(entries(crossing()), tmp_path / "a.gif", "gif")
    with Image.open(tmp_path / "a.gif") as picture:
        first = np.asarray(picture.convert("RGB"), dtype=int)
        alarm = (np.abs(first - [0xB2, 0x18, 0x2B]).sum(axis=2) < 60).sum()
    assert alarm > 20  # both crossings of det W = 0


def ffmpeg(folder, monkeypatch, fails):
    program = folder / "ffmpeg"
    program.write_text(FFMPEG.format(python=sys.executable, fails=fails))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))


def test_an_mp4_is_what_ffmpeg_makes_of_the_frames(tmp_path, monkeypatch):
    ffmpeg(tmp_path, monkeypatch, fails=False)
    film.write_film(entries(of_library("unicycle")), tmp_path / "a.mp4", "mp4")
    count, size, *command = (tmp_path / "a.mp4").read_text().split()
    width, height = map(int, size.split("x"))
    assert int(count) == 4 * width * height * 3
    assert "yuv420p" in command


def test_what_ffmpeg_refuses_is_said(tmp_path, monkeypatch):
    ffmpeg(tmp_path, monkeypatch, fails=True)
    with pytest.raises(InvalidProblemError, match="a wrong codec"):
        film.write_film(entries(of_library("unicycle")), tmp_path / "a.mp4", "mp4")


def test_without_ffmpeg_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingDependencyError, match=r"ffmpeg.*apt install ffmpeg"):
        film.write_film(entries(of_library("unicycle")), tmp_path / "a.mp4", "mp4")
    assert not (tmp_path / "a.mp4").exists()
