"""Rows of a benchmark, appended to a file as they come; what is found there is not measured again."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def resumed(
    file: Path,
    keys: Sequence[str],
    asked: Sequence[tuple[Any, ...]],
    solved: Callable[..., Row],
    workers: int,
) -> list[Row]:
    """The rows of all that is asked, from the file or by ``solved`` in processes. keys: a row's, of what was asked."""
    file.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {tuple(row[key] for key in keys) for row in rows}
    wanted = [task for task in asked if task not in done]
    with ProcessPoolExecutor(workers) as pool, file.open("a") as target:
        for number, future in enumerate(as_completed([pool.submit(solved, *task) for task in wanted]), 1):
            rows.append(future.result())
            target.write(json.dumps(rows[-1]) + "\n")
            target.flush()
            print(f"{number} of {len(wanted)}", end="\r", flush=True)
    return [row for row in rows if tuple(row[key] for key in keys) in set(asked)]
