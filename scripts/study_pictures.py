#!/usr/bin/env python3
"""Draws the main figures of studies into problems/pictures/. Run: .venv/bin/python scripts/study_pictures.py STORE…

STORE: what `nhpocp sweep` wrote for a file of problems/studies/, a study.sqlite each.
"""

from __future__ import annotations

import sys
from pathlib import Path

from pictures import save

from nhpocp.study.store import Store
from nhpocp.study.surveying import survey
from nhpocp.views.study_charts import charts
from nhpocp.views.study_curves import curves


def main() -> None:
    for store in sys.argv[1:]:
        with Store.open(Path(store)) as opened:
            found = survey(opened)
        drawn = {overlay.name: overlay for overlay in [*charts(found), *curves(found)]}
        best = "profiles" if "profiles" in drawn else next(iter(drawn))
        save(drawn[best].figure, f"{found.name}_study")


if __name__ == "__main__":
    main()
