#!/usr/bin/env python3
"""Draws the pictures that Markdown shows, small, into problems/pictures/. Run: .venv/bin/python scripts/pictures.py"""

from __future__ import annotations

from pathlib import Path

import nhpocp
from nhpocp.views import figures

ROOT = Path(__file__).resolve().parents[1]
SHOWN = {"paper": ("robot", "controls"), "paper_conjecture": ("margins",)}


def main() -> None:
    folder = ROOT / "problems" / "pictures"
    folder.mkdir(exist_ok=True)
    for name, pictures in SHOWN.items():
        solution = nhpocp.solve(nhpocp.load_problem(ROOT / "problems" / f"{name}.yaml"))
        for picture in pictures:
            figure = getattr(figures, picture)(solution)
            figure.savefig(folder / f"{name}_{picture}.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
