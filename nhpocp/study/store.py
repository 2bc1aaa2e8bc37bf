"""The store of a study: one SQLite file, a row per run as it finishes.

    study     key, value        the texts that say what the runs are, and what tells this study from others
    sessions  session, ...      when and on what runs were performed: versions, processor, workers
    runs      run, ...          `COLUMNS`, and a column an axis, read out of ``parameters``

Its journal is a write-ahead log: readers do not wait, and a killed program leaves a whole file.
"""

from __future__ import annotations

import json
import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from nhpocp.errors import InvalidProblemError, describe
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.study.cells import check_row, check_whole
from nhpocp.study.study import Study

try:
    import fcntl
except (
    ImportError
):  # Windows: two sweeps on one store are not told apart, and store nothing twice all the same
    fcntl = None  # type: ignore[assignment]

VERSION = "1"
PATIENCE = 60.0  # seconds to wait for another program that writes
FACTS = ("schema_version", "name", "runs", "axes", "digest", "study", "problem", "problem_file")
Row = dict[str, Any]
# names that no key of a problem file has, which axes are called by
COLUMNS: dict[str, str] = {
    "run": "INTEGER PRIMARY KEY",
    "session": "INTEGER NOT NULL",
    "variant": "TEXT NOT NULL",
    "parameters": "TEXT NOT NULL",  # JSON: values by the paths of the axes
    "outcome": "TEXT NOT NULL",
    "converged": "INTEGER NOT NULL",
    "message": "TEXT NOT NULL",
    "verified_error": "REAL",
    "final_error": "REAL",
    **dict.fromkeys(costs_of_motion(), "REAL"),
    "evaluations": "INTEGER",
    "margins": "TEXT",  # JSON: the least of each along the path
    "extremes": "TEXT",  # JSON: [least, greatest] of each input and output along the path
    "limits": "TEXT",  # JSON: of each bound the worst place, as in solution.json
    "warnings": "TEXT",  # JSON: sentences
    "settings": "TEXT",  # JSON, of the solver
    "seed": "INTEGER",
    "solved_control": "TEXT",  # JSON, as in solution.json
    "solve_s": "REAL",
    "verify_s": "REAL",
    "tries": "INTEGER NOT NULL",  # 2 after a worker died
    "finished": "TEXT NOT NULL",  # UTC
}


class Store:
    """An open store; ``with`` closes it, and names it in an `InvalidProblemError` that names no file.

    Errors: `InvalidProblemError` where the file is none, or cannot be used.
    """

    def __init__(self, file: Path, connection: sqlite3.Connection, lock: Any = None) -> None:
        self.file, self._connection, self._lock = file, connection, lock

    @classmethod
    def open(cls, file: Path) -> Self:
        """A store to be read."""
        if not file.is_file():
            raise InvalidProblemError("no such file; expected the store of a study", file=str(file))
        # one that may write clears its journal up; where nobody may write, nobody does meanwhile
        writable = os.access(file, os.W_OK) and os.access(file.parent, os.W_OK)
        with _told(file):
            if writable:
                try:
                    return cls._reading(file, "mode=rw")
                except (
                    sqlite3.OperationalError
                ):  # a journal has no room, say; there may be nothing in it to be read
                    journal = file.with_name(f"{file.name}-wal")
                    if journal.exists() and journal.stat().st_size:
                        raise
            return cls._reading(file, "immutable=1")

    @classmethod
    def _reading(cls, file: Path, how: str) -> Self:
        connection = sqlite3.connect(f"{file.resolve().as_uri()}?{how}", uri=True, timeout=PATIENCE)
        try:
            connection.execute("PRAGMA query_only = ON")
            store = cls(file, connection)
            store._check_version()
        except BaseException:
            connection.close()
            raise
        return store

    @classmethod
    def create(cls, file: Path, study: Study, resume: bool) -> Self:
        """The store of a study to write to: a new one, or with ``resume`` one that is there, of the same runs.

        Errors: `InvalidProblemError` for a store that is there without being asked for, is another study's, or is
        written to by another sweep.
        """
        there = file.exists() and file.stat().st_size > 0
        if there and not resume:
            words = "this store exists; --resume runs what is missing, -o names another folder"
            raise InvalidProblemError(words, file=str(file))
        with _told(file):
            file.parent.mkdir(parents=True, exist_ok=True)
            lock = _locked(file)
            try:
                connection = sqlite3.connect(file, timeout=PATIENCE)
                store = cls(file, connection, lock)
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = NORMAL")
                with connection:
                    store._prepare(study)
            except BaseException:
                if lock:
                    lock.close()
                raise
        return store

    def _prepare(self, study: Study) -> None:
        """Makes the tables, or finds those of the same study; in one transaction."""
        connection = self._connection
        connection.execute("BEGIN IMMEDIATE")
        if self._facts(missing=True):
            self._check_version()
            if self._facts().get("digest") != study.digest:
                words = (
                    "this store is of another study, or of an older text of this one; -o names another folder"
                )
                raise InvalidProblemError(words, file=str(self.file))
            last = connection.execute("SELECT max(run) FROM runs").fetchone()[0] or 0
            if last > len(study) and study.optimise:
                words = (
                    f"run {last} is stored, of {len(study)}; --resume takes as many trials as before, or more"
                )
                raise InvalidProblemError(words, file=str(self.file))
            newer = [("runs", str(len(study))), ("study", study.text)]  # more trials may be asked for
            connection.executemany("INSERT OR REPLACE INTO study VALUES (?, ?)", newer)
            return
        axes = [path for factor in study.design.factors for path in factor.paths]
        columns = [f"{name} {kind}" for name, kind in COLUMNS.items()]
        columns += [
            f'"{path}" GENERATED ALWAYS AS (json_extract(parameters, \'$."{path}"\')) VIRTUAL'
            for path in axes
        ]
        connection.execute("CREATE TABLE study (key TEXT PRIMARY KEY, value TEXT)")
        connection.execute(
            "CREATE TABLE sessions (session INTEGER PRIMARY KEY, began TEXT, workers INTEGER, environment TEXT)"
        )
        connection.execute(f"CREATE TABLE runs ({', '.join(columns)})")
        facts = {
            "schema_version": VERSION,
            "name": study.name,
            "runs": str(len(study)),
            "axes": json.dumps(axes),
            "digest": study.digest,
            "study": study.text,
            "problem": study.problem_text,
            "problem_file": study.problem_file,
        }
        connection.executemany("INSERT INTO study VALUES (?, ?)", facts.items())

    def _facts(self, missing: bool = False) -> dict[str, Any]:
        tables = self._connection.execute("SELECT name FROM sqlite_master WHERE name = 'study'").fetchall()
        if not tables and missing:
            return {}
        return dict(self._connection.execute("SELECT key, value FROM study"))

    def _check_version(self) -> None:
        """Errors: `InvalidProblemError` for another version, or where what should be tables are other things."""
        kinds = dict(self._connection.execute("SELECT name, type FROM sqlite_master"))
        for name in ("study", "sessions", "runs"):
            if kinds.get(name) != "table":
                raise InvalidProblemError(
                    f"this is no store of a study (no table {name})", file=str(self.file)
                )
        version = self._facts().get("schema_version")
        if version != VERSION:
            words = f"a store of version {version}; this nhpocp reads version {VERSION}"
            raise InvalidProblemError(words, file=str(self.file))

    @property
    def facts(self) -> dict[str, Any]:
        """What the study is, by key. Errors: `InvalidProblemError` where one is missing or damaged."""
        with _told(self.file):
            facts = self._facts()
        for key in FACTS:
            value = facts.setdefault(key, None)
            if not isinstance(value, str) and (key, value) != ("problem_file", None):
                raise InvalidProblemError(
                    f"damaged: expected text, got {describe(value)}", path=key, file=str(self.file)
                )
        if not re.fullmatch("[0-9]{1,9}", facts["runs"]):
            raise InvalidProblemError("damaged: expected a number of runs", path="runs", file=str(self.file))
        return facts

    @property
    def axes(self) -> list[str]:
        """The paths of the axes. Errors: `InvalidProblemError` where they are damaged."""
        text = self.facts["axes"]
        try:
            axes = json.loads(text)
        except (ValueError, RecursionError):
            axes = None
        if not isinstance(axes, list) or not all(isinstance(path, str) for path in axes):
            raise InvalidProblemError("damaged: expected a list of paths", path="axes", file=str(self.file))
        return axes

    def begin(self, workers: int, environment: Mapping[str, Any]) -> int:
        """A new session; its number."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        with _told(self.file), self._connection:
            values = (now, workers, json.dumps(environment))
            cursor = self._connection.execute(
                "INSERT INTO sessions (began, workers, environment) VALUES (?, ?, ?)", values
            )
        return cursor.lastrowid or 0

    def add(self, rows: Iterable[Row]) -> None:
        """Stores rows, all or none; a run that is there stays as it is."""
        names = ", ".join(COLUMNS)
        places = ", ".join(f":{name}" for name in COLUMNS)
        with _told(self.file), self._connection:
            self._connection.executemany(f"INSERT OR IGNORE INTO runs ({names}) VALUES ({places})", rows)

    def done(self) -> set[int]:
        """The numbers of the runs that are stored. Errors: `InvalidProblemError` for one that the study has not."""
        with _told(self.file):
            runs = {run for (run,) in self._connection.execute("SELECT run FROM runs")}
        most = int(self.facts["runs"])
        for run in runs:
            if not isinstance(run, int) or not 1 <= run <= most:
                words = f"damaged: run {run!r:.40}; the study has 1…{most}"
                raise InvalidProblemError(words, file=str(self.file))
        return runs

    def outcomes(self) -> dict[str, int]:
        """How many runs ended so, by outcome."""
        with _told(self.file):
            counted = "SELECT outcome, count(*) FROM runs GROUP BY outcome ORDER BY count(*) DESC"
            return dict(self._connection.execute(counted))

    def failed(self) -> int | None:
        """The number of the first run that did not converge."""
        with _told(self.file):
            run = self._connection.execute("SELECT min(run) FROM runs WHERE NOT converged").fetchone()[0]
            return None if run is None else int(run)

    def rows(self, where: str = "1", values: Iterable[Any] = ()) -> Iterator[Row]:
        """Rows in the order of their numbers, one at a time. Errors: `InvalidProblemError` for damaged cells."""
        names = list(COLUMNS)
        with _told(self.file):
            query = f"SELECT {', '.join(names)} FROM runs WHERE {where} ORDER BY run"
            for entries in self._connection.execute(query, tuple(values)):
                row = dict(zip(names, entries, strict=True))
                check_row(row, COLUMNS)
                yield row

    def check(self) -> None:
        """Errors: `InvalidProblemError` for a damaged cell in any row."""
        axes = self.axes
        for row in self.rows():
            check_whole(row, axes)

    def row(self, run: int) -> Row:
        """The row of one run. Errors: `InvalidProblemError` where it is not stored."""
        for row in self.rows("run = ?", [run]):
            with _told(self.file):
                check_whole(row, self.axes)
            return row
        count = len(self.done())
        words = f"run {run} is not stored here; {count} of the runs 1…{self.facts['runs']} are"
        raise InvalidProblemError(words, file=str(self.file))

    def control(self, run: int) -> str | None:
        """The control of a run that converged, as it is stored."""
        with _told(self.file):
            query = "SELECT solved_control FROM runs WHERE run = ? AND converged"
            entry = self._connection.execute(query, [run]).fetchone()
            return entry[0] if entry else None

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Within it the store is read as it is now, whatever a sweep adds meanwhile."""
        with _told(self.file):
            self._connection.execute("BEGIN")
            try:
                yield
            finally:
                self._connection.rollback()

    def select(self, query: str, values: Iterable[Any] = ()) -> Iterator[tuple[Any, ...]]:
        """What SQL answers to ``SELECT`` and the query, a row at a time; SQLite sorts what does not fit in memory."""
        with _told(self.file):
            yield from self._connection.execute(f"SELECT {query}", tuple(values))

    def close(self) -> None:
        with suppress(sqlite3.Error):
            self._connection.close()
        if self._lock:  # last: closing any handle of a file drops SQLite's own locks on it
            self._lock.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close()
        if isinstance(error, InvalidProblemError) and error.file is None:
            error.file = str(self.file)


def _locked(file: Path) -> Any:
    """Held as long as it is open. Errors: `InvalidProblemError` where another sweep holds it."""
    if fcntl is None:
        return None
    handle = file.open("ab")
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        handle.close()
        raise InvalidProblemError("another sweep is writing to this store", file=str(file)) from None
    except OSError:  # no locks on this file system
        pass
    return handle


@contextmanager
def _told(file: Path) -> Iterator[None]:
    """What SQLite and the system refuse, in our words."""
    try:
        yield
    except InvalidProblemError as error:
        raise error if error.file else error.changed(file=str(file)) from None
    except (sqlite3.Error, UnicodeDecodeError) as error:  # which the words of SQLite's errors may cause too
        if isinstance(error, sqlite3.OperationalError) and "no such table" not in str(error):
            raise InvalidProblemError(f"cannot use this store: {error}", file=str(file)) from error
        raise InvalidProblemError(f"this is no store of a study ({error})", file=str(file)) from error
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(file)) from error
