"""The report of a study as files beside its store: report.html, and comparison.tex for LaTeX."""

from __future__ import annotations

from pathlib import Path

from nhpocp.solution_folder.pictures import attempted
from nhpocp.solution_folder.target import require_own, unwritable
from nhpocp.study.store import Store
from nhpocp.whole import write_file

PAGE, TABLE = "report.html", "comparison.tex"


def check_home(home: Path) -> None:
    """Errors: `InvalidProblemError` for a file in the place of the report that nhpocp did not write."""
    for name in (PAGE, TABLE):
        require_own(home / name)


def write_report(store: Path, home: Path) -> str:
    """Both files, each whole or not at all, from the store alone; "" or why they could not be written.

    Those of an earlier report are gone then. Errors: `InvalidProblemError` for files that nhpocp did not write, and for
    a store that is none, or whose study can no longer be read.
    """
    check_home(home)
    try:
        home.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(home, error) from error
    why = attempted(lambda: _write(store, home))
    if why:
        for name in (PAGE, TABLE):
            (home / name).unlink(missing_ok=True)
    return why


def _write(store: Path, home: Path) -> None:
    from nhpocp.study.surveying import survey

    with Store.open(store) as opened:
        found = survey(opened)
    from nhpocp.views.latex_table import study_table
    from nhpocp.views.study_report import write_study_report

    write_file(home / TABLE, lambda file: file.write_text(study_table(found), encoding="ascii"))
    write_file(home / PAGE, lambda file: write_study_report(found, file))
