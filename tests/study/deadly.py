"""Work that kills its process, as the system does where memory is lacking; sent to workers by name."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

from nhpocp.study import run
from nhpocp.study.study import read_study_text


def performed(source, job):
    """As `run.performed`; the process dies so many times at a run of a horizon as the file of deaths says."""
    file = Path(os.environ["NHPOCP_TEST_DEATHS"])
    study = read_study_text(source.text, source.file, source.problem_text)
    for number in job.runs:
        horizon, deaths = str(study.parameters(number)["horizon"]), json.loads(file.read_text())
        if number in first_of(study, horizon) and deaths.get(horizon):
            file.write_text(json.dumps({**deaths, horizon: deaths[horizon] - 1}))
            os.kill(os.getpid(), signal.SIGKILL)
    return run.performed(source, job)


def first_of(study, horizon):
    """The number of the first run of that horizon."""
    return [next(k for k in range(1, len(study) + 1) if str(study.parameters(k)["horizon"]) == horizon)]
