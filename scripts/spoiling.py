"""Inputs spoilt by chance: bytes, plain data, texts of YAML, stores of studies."""

from __future__ import annotations

import contextlib
import io
import json
import random
import shutil
import sqlite3
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

NUMBERS = [0, -1, 1, 3, 1e-300, 1e-160, 1e-20, 1e20, 1e155, 1e200, -1e308, float("inf"), float("nan"), 2**70]
WORDS = [
    "",
    "~",
    "true",
    "auto",
    "-1 deg",
    "pi/0",
    "1e999",
    "../../out",
    "\u202e",
    "\x1b[2J",
    "=1+1",
    "[",
    "{a: 1}",
]
ODD: list[Any] = [*NUMBERS, *WORDS, None, True, [], {}, [[]], [1, "x"], {"": 0}]
CELLS: list[Any] = [
    *(
        None,
        0,
        -1,
        1,
        3,
        2**62,
        1e308,
        float("inf"),
        "",
        "x",
        "null",
        "1e999",
        "NaN",
        "[" * 5000,
        "\x00",
        "{}",
    ),
    *(b"", b"\xff\xfe", b"[]", '{"goal.x": 1e400}', '{"goal.x": "a"}', '{"": {}}', "[[]]", '"\\ud800"'),
    *(
        str(2**70),
        f'{{"sigma": {2**70}}}',
        "../../out",
        "\x1b[2J",
        "converged",
        "jacobian:x=1",
        "nlp",
        "9" * 5000,
    ),
]
FACTS = ["schema_version", "name", "runs", "axes", "digest", "study", "problem", "problem_file"]


def spoilt_bytes(draw: random.Random, data: bytes) -> bytes:
    """A few bytes changed, taken out, put in, or a line said twice."""
    found = bytearray(data)
    for _ in range(draw.randint(1, 6)):
        place, what = draw.randrange(len(found) + 1), draw.randrange(4)
        if what == 0:
            del found[place : place + draw.randint(1, 30)]
        elif what == 1:
            found[place:place] = bytes(draw.randrange(256) for _ in range(draw.randint(1, 4)))
        elif what == 2:
            found[place:place] = draw.choice([b"\n", b": ", b"&a ", b"*a", b"!!x ", b"- ", b"\t", b"%", b'"'])
        else:
            lines = bytes(found).splitlines(keepends=True) or [b""]
            lines.insert(draw.randrange(len(lines) + 1), draw.choice(lines))
            found = bytearray(b"".join(lines))
    return bytes(found)


def spoilt_data(draw: random.Random, data: Any) -> Any:
    """Plain data with one of its parts replaced, left out or called otherwise."""
    if isinstance(data, dict) and data and draw.random() < 0.9:
        found, key = dict(data), draw.choice(list(data))
        value = found.pop(key)
        what = draw.random()
        if what < 0.8:
            found[key] = spoilt_data(draw, value)
        elif what < 0.9:
            found[f"{key}x"] = value
        return found
    if isinstance(data, list) and data and draw.random() < 0.7:
        place = draw.randrange(len(data))
        return [*data[:place], spoilt_data(draw, data[place]), *data[place + draw.randint(0, 1) :]]
    return draw.choice(ODD)


def spoilt_yaml(draw: random.Random, text: bytes) -> bytes:
    """A YAML text with one part of its structure spoilt."""
    stream = io.BytesIO()
    YAML(typ="safe").dump(spoilt_data(draw, YAML(typ="safe").load(text)), stream)
    return stream.getvalue()


def spoil_database_bytes(draw: random.Random, file: Path) -> None:
    """Flips, cuts, or overwrites bytes of a database, of its first page as often as of all others."""
    data = bytearray(file.read_bytes())
    what = draw.randrange(5)
    if what == 0:
        del data[draw.randrange(len(data)) :]
    elif what == 1:
        place = draw.randrange(0, len(data), 4096)
        data[place : place + 4096] = bytes([draw.randrange(256)]) * 4096
    else:
        for _ in range(draw.choice([1, 1, 3, 30])):
            place = draw.randrange(draw.choice([100, 4096, len(data)]))
            data[place] = draw.choice([0, 255, data[place] ^ 1 << draw.randrange(8), draw.randrange(256)])
    file.write_bytes(data)


def spoil_journal(draw: random.Random, file: Path) -> None:
    """Leaves a journal beside a database: the one of a killed writer, whole or spoilt, or nonsense."""
    if draw.random() < 0.6:
        other = file.with_name("other")
        shutil.copy(file, other)
        writing = sqlite3.connect(other)
        writing.execute("PRAGMA journal_mode = WAL")
        writing.execute("UPDATE runs SET message = 'from the journal' WHERE run < ?", [draw.randint(1, 9)])
        writing.commit()
        journal = other.with_name("other-wal").read_bytes()
        shutil.copy(other, file)
        writing.close()
        other.unlink()
    else:
        journal = draw.randbytes(draw.choice([0, 1, 32, 512, 5000]))
    if draw.random() < 0.6:
        journal = spoilt_bytes(draw, journal[: draw.randrange(len(journal) + 1)])
    file.with_name(f"{file.name}-{draw.choice(['wal', 'wal', 'journal', 'shm'])}").write_bytes(journal)


def spoil_tables(draw: random.Random, file: Path) -> None:
    """Tables, columns and rows dropped, renamed, made anew; facts changed."""
    columns = ["run", "session", "variant", "parameters", "outcome", "converged", "solved_control", "tries"]
    table, column = draw.choice(["study", "sessions", "runs", "runs"]), draw.choice(columns)
    ways: list[tuple[str, list[Any]]] = [
        (f"DROP TABLE {table}", []),
        (f"ALTER TABLE {table} RENAME TO other", []),
        (f"ALTER TABLE runs RENAME COLUMN {column} TO other", []),
        (f"ALTER TABLE runs DROP COLUMN {column}", []),
        ("ALTER TABLE runs ADD COLUMN other TEXT DEFAULT 'x'", []),
        (f"DELETE FROM {table}", []),
        (f"DELETE FROM {table} WHERE rowid % 2", []),
        ("UPDATE runs SET run = ? WHERE run = ?", [draw.choice([0, -5, 99, 2**62]), draw.randint(1, 6)]),
        (f"CREATE TABLE spare AS SELECT * FROM {table}; DROP TABLE {table}", []),
        (f"ALTER TABLE {table} RENAME TO old; CREATE TABLE {table} (x)", []),
        (f"ALTER TABLE {table} RENAME TO old; CREATE VIEW {table} AS SELECT * FROM old", []),
        ("CREATE TRIGGER refuse BEFORE INSERT ON runs BEGIN SELECT RAISE(ABORT, 'no'); END", []),
        ("CREATE TRIGGER empty AFTER INSERT ON sessions BEGIN DELETE FROM runs; END", []),
        (f"ALTER TABLE runs RENAME TO old; CREATE VIEW runs AS {ENDLESS}", []),
        ("PRAGMA user_version = 7", []),
        (
            "UPDATE study SET value = ? WHERE key = 'schema_version'",
            [draw.choice(["0", "2", "", None, "1.0", 1])],
        ),
    ]
    facts = [("UPDATE study SET value = ? WHERE key = ?", [draw.choice(CELLS), draw.choice(FACTS)])]
    facts += [("DELETE FROM study WHERE key = ?", [draw.choice(FACTS)])]
    for text, values in draw.sample([*ways, *facts * 4], draw.choice([1, 1, 2])):
        _executed(file, text, values)


ENDLESS = (
    "WITH RECURSIVE more(run) AS (SELECT 1 UNION ALL SELECT run + 1 FROM more) SELECT run, 1 AS session, "
    "'jacobian' AS variant, '{}' AS parameters, 'converged' AS outcome, 1 AS converged, '' AS message FROM more"
)


def spoil_cells(draw: random.Random, file: Path, columns: dict[str, str]) -> None:
    """Some cells of runs: other kinds of values, their JSON spoilt in bytes or in structure."""
    for _ in range(draw.choice([1, 1, 1, 3])):
        column, run = draw.choice(list(columns)), draw.randint(1, 6)
        with contextlib.closing(sqlite3.connect(file)) as connection:
            (old,) = connection.execute(f"SELECT {column} FROM runs WHERE run = ?", [run]).fetchone() or (
                None,
            )
        value = draw.choice(CELLS)
        if isinstance(old, str) and draw.random() < 0.7:
            if old[:1] in ("{", "[") and draw.random() < 0.7:
                value = json.dumps(spoilt_data(draw, json.loads(old)))
            else:
                value = spoilt_bytes(draw, old.encode())
                value = value if draw.random() < 0.3 else value.decode(errors="replace")
        cast = draw.random() < 0.2 and isinstance(value, bytes)  # text that is no UTF-8
        place = "CAST(? AS TEXT)" if cast else "?"
        _executed(file, f"UPDATE runs SET {column} = {place} WHERE run = ?", [value, run])


def _executed(file: Path, text: str, values: list[Any]) -> None:
    """What SQLite does not let happen does not happen."""
    refused = contextlib.suppress(sqlite3.Error, OverflowError)
    with refused, contextlib.closing(sqlite3.connect(file)) as connection, connection:
        if values:
            connection.execute(text, values)
        else:
            connection.executescript(text)
