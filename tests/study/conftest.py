"""What the tests of studies share."""

from __future__ import annotations

import pytest

from nhpocp.study.store import Store
from nhpocp.study.study import read_study_text
from nhpocp.study.sweep import sweep


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """The rows of the long study, whose sweep nothing came between, in this process's own children."""
    from tests.study.test_sweep import LONG, here, rows

    study = read_study_text(LONG, "corners.yaml")
    file = tmp_path_factory.mktemp("long") / "study.sqlite"
    with Store.create(file, study, resume=False) as store:
        assert sweep(study, store, 1, make=here).converged == len(study) == 24
    return rows(file)
