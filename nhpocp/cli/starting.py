"""The verbs for the first minutes: `init` writes a problem file to begin with, `schema` what editors check it by."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from nhpocp.cli.options import json_option
from nhpocp.cli.terminal import put, say, tell
from nhpocp.errors import InvalidProblemError
from nhpocp.whole import write_text

SCHEMA = "nhpocp.schema.json"


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Write it to this file instead, such as the one beside a problem; an older one is replaced.",
)
@json_option
def schema(output: Path | None, as_json: bool) -> int:
    """Print the JSON schema of problem files.

    For editors; the same with and without --json. It knows what other packages add.
    """
    from nhpocp.problem_file import json_schema

    if output is None:
        put(json_schema())
        return 0
    if output.exists() and not _is_schema(output):
        raise InvalidProblemError("this is no schema of nhpocp and is left alone", file=str(output))
    _write(output.resolve(), _text())  # a link that is named here is kept
    if as_json:
        put({"schema": str(output)})
    else:
        tell(str(output))
    return 0


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default=Path("problem.yaml"))
@click.option(
    "--system", "model", default="three_upu", show_default=True, help="A model of `nhpocp systems`."
)
@json_option
def init(file: Path, model: str, as_json: bool) -> int:
    """Write a commented starter FILE and its JSON schema beside it; no file is ever replaced."""
    from nhpocp.problem_file import starter

    if not file.name or file.is_dir():
        example = file / "problem.yaml"
        raise InvalidProblemError(f"this is a folder; name a file, such as {example}", file=str(file))
    beside = file.with_name(SCHEMA)
    if file.name == SCHEMA:
        raise InvalidProblemError(
            "this is the schema's name; name another, such as problem.yaml", file=str(file)
        )
    content, text = starter(model, SCHEMA), _text()
    if os.path.lexists(file):
        raise _exists(file)
    if not os.path.lexists(beside):  # first, so that a run that fails here can be repeated
        _write(beside, text, new=True)
    elif not beside.is_file() or beside.read_text(encoding="utf-8", errors="replace") != text:
        say(
            f"{beside}: not this version's schema, and left alone; `nhpocp schema -o {beside}` renews an older one"
        )
    _write(file, content, new=True)
    if as_json:
        put({"file": str(file), "schema": str(beside)})
    else:
        tell(f"{file}\n{beside}\nnext: nhpocp solve {file}")
    return 0


def _text() -> str:
    from nhpocp.problem_file import json_schema

    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


def _is_schema(path: Path) -> bool:
    """Whether a file is a schema that this program wrote, of whatever version."""
    from nhpocp.problem_file.document import read_file

    try:
        content = json.loads(read_file(path))
    except (ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("$id") == SCHEMA


def _write(path: Path, text: str, *, new: bool = False) -> None:
    try:
        write_text(path, text, new=new)
    except FileExistsError:
        raise _exists(path) from None
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(path)) from error


def _exists(path: Path) -> InvalidProblemError:
    return InvalidProblemError("this file exists and is left alone; name another", file=str(path))
