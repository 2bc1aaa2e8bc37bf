"""Sweeps by workers of Dask: the rows are those of a sweep on this machine, whoever is killed meanwhile."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor, wait

from nhpocp.study import cluster
from nhpocp.study.cluster import SchedulerLostError
from tests.study.test_sweep import LONG, UNICYCLE, alike, count, environment, ran, rows, wait_for


@contextlib.contextmanager
def dask(*arguments, folder):
    """A process of Dask's; its scheduler is found by a file in the folder."""
    with (folder / "log").open("a") as log:
        options = ["--scheduler-file", "scheduler.json", "--no-dashboard"]
        process = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *options, *arguments[1:]],
            cwd=folder,
            env=environment(OMP_NUM_THREADS="1", NHPOCP_COMPILE="never"),
            stdout=log,
            stderr=log,
        )
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def test_a_scheduler_elsewhere_whose_worker_is_killed_loses_nothing(tmp_path, undisturbed):
    (tmp_path / "corners.yaml").write_text(LONG)
    worker = ("worker", "--nthreads", "1", "--no-nanny")
    with (
        dask("scheduler", "--host", "127.0.0.1", "--port", "0", folder=tmp_path),
        dask(*worker, folder=tmp_path) as victim,
        dask(*worker, folder=tmp_path),
    ):
        file = tmp_path / "scheduler.json"
        wait_for(lambda: file.exists() and file.read_text().endswith("}"))
        address, store = json.loads(file.read_text())["address"], tmp_path / "out" / "study.sqlite"

        def kill():
            wait_for(lambda: count(store) >= 4)
            victim.send_signal(signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        status, out, errors = ran("sweep", "corners.yaml", "--dask", address, "-o", "out", cwd=tmp_path)
        killer.join()
        assert (status, errors) == (0, "")
        assert "24 of 24 runs: 24 solved and verified" in out
        assert victim.wait() == -signal.SIGKILL
    alike(rows(store), undisturbed)


def test_workers_here_give_the_rows_of_processes(tmp_path, undisturbed):
    (tmp_path / "corners.yaml").write_text(LONG)
    options = ("--dask", "local", "--workers", 2, "-o", "out", "--json")
    status, out, errors = ran("sweep", "corners.yaml", *options, cwd=tmp_path)
    assert (status, errors, json.loads(out)["converged"]) == (0, "", 24)
    alike(rows(tmp_path / "out" / "study.sqlite"), undisturbed)


class Lost(ThreadPoolExecutor):
    """Workers whose scheduler is lost with their third job, when the others have ended."""

    def __init__(self):
        super().__init__(1)
        self.jobs = []

    def submit(self, *arguments):
        if len(self.jobs) < 2:
            self.jobs.append(super().submit(*arguments))
            return self.jobs[-1]
        wait(self.jobs)
        lost = Future()
        lost.set_exception(SchedulerLostError())
        return lost


def test_what_is_stored_stays_where_the_scheduler_is_lost(tmp_path, monkeypatch, undisturbed):
    (tmp_path / "corners.yaml").write_text(LONG)
    monkeypatch.setattr("nhpocp.study.cluster.DaskExecutor", lambda *_: Lost())
    status, out, errors = ran("sweep", "corners.yaml", "--dask", "tcp://h:1", "-o", "out", cwd=tmp_path)
    assert status == 1
    stored = count(tmp_path / "out" / "study.sqlite")
    assert 0 < stored < 24
    words = (
        f"stopped since Dask's scheduler was lost; {stored} of 24 runs are stored, --resume runs the others"
    )
    assert errors == f"{words}\n"
    assert "report.html" in out


def test_what_is_missing_is_said_before_a_store_is_made(tmp_path, monkeypatch):
    (tmp_path / "corners.yaml").write_text(UNICYCLE)
    monkeypatch.setattr(cluster, "PATIENCE", 0.2)
    status, _, errors = ran("sweep", "corners.yaml", "--dask", "tcp://127.0.0.1:1", cwd=tmp_path)
    assert status == 2
    assert "--dask: no workers of Dask" in errors
    assert "expected local, or the address of a scheduler with workers, as tcp://10.0.0.1:8786" in errors
    status, _, errors = ran("sweep", "corners.yaml", "--dask", "tcp://h:1", "--workers", 2, cwd=tmp_path)
    assert status == 2
    assert "the workers of a scheduler are its own" in errors
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, errors = ran("sweep", "corners.yaml", "--dask", "local", cwd=tmp_path)
    assert status == 3
    assert 'pip install "nhpocp[cluster]"' in errors
    assert list(tmp_path.iterdir()) == [tmp_path / "corners.yaml"]
