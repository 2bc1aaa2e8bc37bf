"""Kills and full disks at chosen moments of every verb that writes, and what became of its files.

A program too, `python tests/faults.py [MOST]`: every moment, or at most so many a verb, with the pictures as they are.

A write is cut by the system's limit of a file's size: what fits is on the disk, and the rest ends the process at once
(SIGXFSZ, which leaves it no more time than SIGKILL) or fails as on a full disk. So every writer is cut, Pillow's
encoders and NumPy's archives too.
"""

from __future__ import annotations

import builtins
import contextlib
import csv
import errno
import io
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, product
from pathlib import Path
from typing import Any
from unittest import mock

from matplotlib.figure import Figure

from nhpocp import analysis, comparison, planning, whole
from nhpocp.cli import solving
from nhpocp.cli.entry import status
from nhpocp.problem_file import load_problem
from nhpocp.solution_folder import load_solution
from nhpocp.solution_folder.target import remove_own
from nhpocp.study import run as study_run
from nhpocp.study.run import failed_row
from nhpocp.study.store import Store
from nhpocp.study.study import read_study_text
from nhpocp.views import analysis_figures, figures, film
from nhpocp.whole import write_text

UNICYCLE = Path(__file__).parents[1] / "problems" / "unicycle.yaml"
SET = ["--set", "output.samples=11", "--set", "name=u"]
CHANGES = ("rename", "replace", "unlink", "remove", "rmdir", "mkdir", "link")
CREATING = ("mkdir", "open")
STORE = "../before/study.sqlite"  # from a task's folder; read in vain, it leaves no journal there
MISSING = "could not be written"  # the words of what is done without


@dataclass(frozen=True)
class Task:
    """A verb with its arguments, and the solution folders that it may replace or add to."""

    arguments: list[str]
    folders: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fault:
    """What happens right before the change of this number.

    A kill, or a disk without room for another file; with ``room``, files take so many bytes: what is beyond kills, or
    fails.
    """

    moment: int
    name: str
    room: int | None = None
    full: bool = False

    @property
    def kind(self) -> str:
        """Where it strikes, in a word or two."""
        return {"write": "empty file" if self.room is None else "half a file"}.get(self.name, self.name)

    def __str__(self) -> str:
        return f"{'full' if self.full else 'killed'} at change {self.moment}, {self.kind}"


@dataclass
class Changes:
    """Counts what its process changes in the file system, and strikes once."""

    fault: Fault | None
    names: list[str] = field(default_factory=list)
    files: dict[int, Path] = field(default_factory=dict)  # by the moment at which they stood there empty
    sizes: dict[int, int] = field(default_factory=dict)

    def note(self, name: str, file: Any = None) -> None:
        for moment, path in self.files.items():
            with contextlib.suppress(OSError):
                self.sizes[moment] = os.stat(path).st_size
        fault, now = self.fault, len(self.names)
        if fault and fault.full and fault.room is None and fault.moment <= now and name in CREATING:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if fault and fault.moment == now:
            self.strike(fault)
        if file is not None:
            self.files[len(self.names)] = Path(file).absolute()
        self.names.append(name)

    @staticmethod
    def strike(fault: Fault) -> None:
        if fault.room is None:
            if not fault.full:
                os.kill(os.getpid(), signal.SIGKILL)
            return
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN if fault.full else signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_FSIZE, (fault.room, resource.RLIM_INFINITY))

    def noted(self, name: str, function: Any) -> Any:
        def changing(*arguments: Any, **options: Any) -> Any:
            self.note(name)
            return function(*arguments, **options)

        return changing

    def opening(self, function: Any, writes: Any) -> Any:
        """Twice: before a file is opened for writing, and while it is empty."""

        def opened(file: Any, *arguments: Any, **options: Any) -> Any:
            if not writes(*arguments, **options) or isinstance(file, int):
                return function(file, *arguments, **options)
            self.note("open")
            found = function(file, *arguments, **options)
            self.note("write", file)
            return found

        return opened

    def arm(self) -> None:
        for name in CHANGES:
            setattr(os, name, self.noted(name, getattr(os, name)))
        io.open = builtins.open = self.opening(io.open, lambda mode="r", *_, **__: set(mode) & set("wxa+"))
        os.open = self.opening(os.open, lambda flags, *_, **__: flags & (os.O_WRONLY | os.O_RDWR))
        exchanging = whole._system_renameat2()
        if exchanging is not None:
            whole._system_renameat2 = lambda: self.noted("renameat2", exchanging)


@dataclass(frozen=True)
class End:
    """How a run ended; what it changed, by name, and the sizes of the files it wrote."""

    killed: bool
    status: int | None = None
    out: str = ""
    messages: str = ""
    names: tuple[str, ...] = ()
    sizes: tuple[tuple[int, int], ...] = ()


def run(task: Task, home: Path, fault: Fault | None, as_json: bool = False) -> End:
    """The task in a process of its own."""
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        ended = 3
        try:
            ended = _child(task, home, fault, as_json, writing)
        except BaseException:  # noqa: BLE001 - the very thing that is looked for
            os.write(writing, json.dumps({"messages": traceback.format_exc()}).encode())
        finally:
            os._exit(ended)
    os.close(writing)
    with open(reading, "rb") as said:
        words = said.read()
    ended = os.waitpid(process, 0)[1]
    if os.WIFSIGNALED(ended):
        return End(killed=True)
    told = json.loads(words)
    return End(False, **{k: tuple(map(_fixed, v)) if isinstance(v, list) else v for k, v in told.items()})


def _fixed(entry: Any) -> Any:
    return tuple(entry) if isinstance(entry, list) else entry


def _child(task: Task, home: Path, fault: Fault | None, as_json: bool, writing: int) -> int:
    os.chdir(home)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    out, messages, changes = io.StringIO(), io.StringIO(), Changes(fault)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(messages):
        changes.arm()
        ended = status([*task.arguments, *(["--json"] if as_json else [])])
    told = {"status": ended, "out": out.getvalue(), "messages": messages.getvalue()}
    rest = json.dumps({**told, "names": changes.names, "sizes": list(changes.sizes.items())}).encode()
    while rest:
        rest = rest[os.write(writing, rest) :]
    return 0


def _again(before: Path, home: Path) -> None:
    shutil.rmtree(home, ignore_errors=True)
    shutil.copytree(before, home)


def tree(folder: Path) -> dict[str, bytes | None]:
    """Everything under a folder with its content."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def shown(folder: Path) -> dict[str, bytes | None]:
    """What a reader of a folder can see: benches are hidden."""
    return {name: content for name, content in tree(folder).items() if whole.BENCH not in name}


@dataclass(frozen=True)
class Trial:
    """A task, the folder it begins with, the one it runs in, what it makes of it, and the faults that can strike."""

    task: Task
    before: Path
    home: Path
    old: dict[str, bytes | None]
    new: dict[str, bytes | None]
    faults: tuple[Fault, ...]

    @classmethod
    def of(cls, name: str, top: Path) -> Trial:
        """Of a task by its name; within `prepared`."""
        task, before, home = TASKS[name], top / "before" / name, top / "home"
        _again(before, home)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.chdir(home):
            status(task.arguments)  # nothing has to be imported any more
        _again(before, home)
        end = run(task, home, None)
        assert end.status == 0, end.messages
        found = [Fault(k, name) for k, name in enumerate(end.names)]
        found += [Fault(k, name, None, True) for k, name in enumerate(end.names) if name in CREATING]
        for k, size in end.sizes:
            found += [Fault(k, "write", size // 2, full) for full in (False, True) if size > 1]
        return cls(task, before, home, tree(before), tree(home), tuple(found))

    def chosen(self, full: bool, most: int) -> list[Fault]:
        """Full disks, or kills: at most so many, evenly over the moments of every kind in turn."""
        kinds: dict[str, list[Fault]] = {}
        for fault in self.faults:
            if fault.full == full:
                kinds.setdefault(fault.kind, []).append(fault)
        ranked = [
            (rank / len(group), fault)
            for group in kinds.values()
            for rank, fault in enumerate(group[i] for i in _spread(len(group)))
        ]
        return [fault for _, fault in sorted(ranked, key=lambda pair: pair[0])[:most]]

    def strike(self, fault: Fault, as_json: bool = False) -> list[str]:
        """What is not as it should be after this fault."""
        _again(self.before, self.home)
        end = run(self.task, self.home, fault, as_json)
        found = [] if end.killed != fault.full else [f"ended so: {end}"]
        for folder in self.task.folders:
            load_solution(self.home / folder)  # which brings it back
        found += self._broken(shown(self.home), end)
        if end.killed:
            for place in [self.home, *(path for path in self.home.rglob("*") if path.is_dir())]:
                whole.sweep(place, remove_own)
        left = tree(self.home)
        found += [f"{name} was left" for name in left if whole.BENCH in name]
        kept = self.old.keys() & self.new.keys()
        if not self._may_lack(end) and not kept <= left.keys() <= self.old.keys() | self.new.keys():
            found.append(f"there are {sorted(left)}")
        return [f"{' '.join(self.task.arguments)}: {fault}: {what}" for what in found + _unsaid(end, as_json)]

    def _broken(self, seen: dict[str, bytes | None], end: End) -> list[str]:
        """Files that are neither old nor new, folders of solutions that are a mixture."""
        found = [
            f"{name} is neither old nor new"
            for name, content in seen.items()
            if content not in (self.old.get(name), self.new.get(name))
            and not (self._may_lack(end) and name.endswith(".json") and _says_so(content))
            and not (
                self._may_lack(end) and "comparison." in name and _less_stored(content, self.new.get(name))
            )
        ]
        for folder in self.task.folders:
            parts = [
                {name: content for name, content in where.items() if name.startswith(f"{folder}/")}
                for where in (seen, self.old, self.new)
            ]
            if parts[0] not in parts[1:] and not self._may_lack(end) and self.task.arguments[0] != "plot":
                found.append(f"{folder} is a mixture")
        return found

    def _may_lack(self, end: End) -> bool:
        """Whether pictures, or a page, may be missing: that was said, or that there was no room for the rest either."""
        return MISSING in end.out + end.messages or (end.status == 2 and self.task.arguments[0] == "compare")


def _less_stored(content: bytes | None, new: bytes | None) -> bool:
    """Whether a table of runs is the new one but for the folders of runs that had no room, which it leaves empty."""
    if content is None or new is None:
        return False
    rows, wanted = _runs(content), _runs(new)
    return [
        {**row, "folder": row["folder"] or other["folder"]} for row, other in zip(rows, wanted, strict=False)
    ] == wanted


def _runs(table: bytes) -> list[dict[str, Any]]:
    """The rows of a comparison.csv or comparison.json."""
    text = table.decode()
    if text.startswith("{"):
        runs: list[dict[str, Any]] = json.loads(text)["runs"]
        return runs
    return list(csv.DictReader(io.StringIO(text)))


def _says_so(content: bytes | None) -> bool:
    return any(MISSING in warning for warning in json.loads(content or b"{}").get("warnings", ()))


def _unsaid(end: End, as_json: bool) -> list[str]:
    """What a run that was not killed should have said."""
    if end.killed:
        return []
    said = json.loads(end.out) if as_json else {}
    failed = end.status == 2 and ("error" in said or not as_json) and end.messages.strip()
    done = end.status == 0 and (_says_so(end.out.encode()) if as_json else MISSING in end.out + end.messages)
    if "Traceback" in end.messages or not (failed or done):
        return [f"status {end.status} with {end.out[-300:]!r} and {end.messages[-300:]!r}"]
    return []


def _spread(count: int) -> list[int]:
    """0 … count - 1, the first few of which are far from each other."""
    return sorted(range(count), key=lambda k: k * 0.6180339887 % 1.0)


TASKS = {
    "solve": Task(["solve", str(UNICYCLE), *SET, "-o", "out"], folders=("out",)),
    "compare": Task(["compare", str(UNICYCLE), *SET, "-o", "."], folders=("u/jacobian", "u/nlp")),
    "plot": Task(["plot", "out"], folders=("out",)),
    "analyze": Task(["analyze", str(UNICYCLE), *SET, "-o", "out"]),
    "animate": Task(["animate", "out"], folders=("out",)),
    "animate, film": Task(["animate", "out", "-o", "film.gif"], folders=("out",)),
    "schema": Task(["schema", "-o", "schema.json"]),
    "init": Task(["init", "mine.yaml"]),
    "export": Task(["export", STORE, "-o", "runs.csv"]),
    "solve --from": Task(["solve", "--from", STORE, "--run", "1", "-o", "out"], folders=("out",)),
}


@contextlib.contextmanager
def prepared(home: Path, quick: bool) -> Iterator[None]:
    """Every task with what an earlier run left; within, nothing is solved or analysed, and ``quick`` draws little."""
    problem = load_problem(UNICYCLE, [change for change in SET if "=" in change])
    answers = {name: planning.solve(problem, solver) for name, solver in problem.solvers.items()}
    looked = analysis.analyze(problem)
    with contextlib.ExitStack() as stack:

        def patch(place: Any, name: str, new: Any) -> None:
            stack.enter_context(mock.patch.object(place, name, new))

        if quick:
            _draw_little(patch)
        _store(home)
        patch(study_run, "restored", lambda row, _: replace(answers["jacobian"], message=f"run {row['run']}"))
        patch(film, "FRAMES", 3)
        patch(comparison, "peak_memory", lambda: 100.0)
        for age in ("old", "new"):
            patch(
                planning, "solve", lambda _, solver, *__, age=age: replace(answers[solver.name], message=age)
            )
            patch(analysis, "analyze", lambda *_, age=age, **__: replace(looked, notes=[age]))
            if age == "old":
                _earlier(home)
        yield


def _store(home: Path) -> None:
    """The store of two runs."""
    text = UNICYCLE.read_text(encoding="utf-8").replace("\n", "\n    ")
    study = read_study_text(f"nhpocp: 1\nstudy:\n  problem:\n    {text}\n  axes: {{goal.x: [1, 2]}}\n")
    home.mkdir(parents=True, exist_ok=True)
    with Store.create(home / "study.sqlite", study, resume=False) as store:
        session = store.begin(1, {})
        store.add({**failed_row(study, run, "none", 1), "session": session} for run in (1, 2))


def _draw_little(patch: Any) -> None:
    tiny = {name: lambda *_, **__: Figure((1, 1)) for name in ("controls", "robot")}
    patch(figures, "FIGURES", tiny)
    patch(figures, "names_of", lambda _: list(tiny))
    patch(analysis_figures, "FIGURES", tiny)
    patch(analysis_figures, "names_of", lambda _: ["robot"])
    patch(solving, "_report", lambda found, file, _: write_text(file, _page("compare", found.entries)))
    patch(solving, "_animation", lambda entries, file: write_text(file, _page("animate", entries)))


def _page(verb: str, entries: Any) -> str:
    return f'<meta content="nhpocp {verb}">' + " ".join(entry.solution.message for entry in entries)


def _earlier(home: Path) -> None:
    """What each task begins with."""
    for name, task in TASKS.items():
        place = home / name
        place.mkdir(parents=True)
        with contextlib.chdir(place), contextlib.redirect_stdout(io.StringIO()):
            if name in ("solve", "compare", "analyze"):
                status(task.arguments)
            elif name == "solve --from":
                status(["solve", "--from", "../study.sqlite", "--run", "2", "-o", "out"])
            elif task.folders:
                status(TASKS["solve"].arguments)
    for picture in (home / "plot" / "out").glob("*.[ps][nv]g"):
        picture.write_text("old")
    for name in ("animate/out/animation.html", "animate, film/film.gif"):
        (home / name).write_text("nhpocp animate: old")
    (home / "export" / "runs.csv").write_text("old")
    (home / "schema" / "schema.json").write_text('{"$id": "nhpocp.schema.json"}')


def main() -> None:
    most, bad = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000, 0
    with tempfile.TemporaryDirectory() as folder, prepared(Path(folder) / "before", quick=False):
        for full, name in product((False, True), TASKS):
            trial = Trial.of(name, Path(folder))
            chosen = trial.chosen(full, most)
            broken = [trial.strike(fault, as_json=bool(k % 2)) for k, fault in enumerate(chosen)]
            bad += sum(map(bool, broken))
            kinds = sorted(Counter(fault.kind for fault in chosen).items())
            words = ", ".join(f"{kind} {number}" for kind, number in kinds)
            print(f"{name}: {len(chosen)} {'full disks' if full else 'kills'} ({words})", flush=True)
            for what in chain(*broken):
                print(f"  {what}", flush=True)
    print(f"{bad} with faults")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
