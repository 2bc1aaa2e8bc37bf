"""The verbs for the first minutes: `init` writes a problem file to begin with, `schema` what editors check it by."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import click

from nhpocp.cli.options import json_option
from nhpocp.cli.terminal import put, say, tell
from nhpocp.errors import InvalidProblemError
from nhpocp.whole import write_text

SCHEMA, STUDY_SCHEMA = "nhpocp.schema.json", "nhpocp.study.schema.json"
study_option = click.option("--study", is_flag=True, help="Of a study, `nhpocp sweep`, instead of a problem.")


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Write it to this file instead, such as the one beside a problem; an older one is replaced.",
)
@study_option
@json_option
def schema(output: Path | None, study: bool, as_json: bool) -> int:
    """Print the JSON schema of problem files.

    For editors; the same with and without --json. It knows what other packages add.
    """
    if output is None:
        put(_schema(study))
        return 0
    if output.exists() and not _is_schema(output):
        raise InvalidProblemError("this is no schema of nhpocp and is left alone", file=str(output))
    _write(output.resolve(), _text(study))  # a link that is named here is kept
    if as_json:
        put({"schema": str(output)})
    else:
        tell(str(output))
    return 0


@click.command()
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.option(
    "--system", "model", default="three_upu", show_default=True, help="A model of `nhpocp systems`."
)
@study_option
@json_option
def init(file: Path | None, model: str, study: bool, as_json: bool) -> int:
    """Write a commented starter FILE and its JSON schema beside it; no file is ever replaced.

    FILE: problem.yaml, or study.yaml, unless named.
    """
    file = file or Path("study.yaml" if study else "problem.yaml")
    known = STUDY_SCHEMA if study else SCHEMA
    if not file.name or file.is_dir():
        example = file / "problem.yaml"
        raise InvalidProblemError(f"this is a folder; name a file, such as {example}", file=str(file))
    beside = file.with_name(known)
    if file.name in (SCHEMA, STUDY_SCHEMA):
        raise InvalidProblemError(
            "this is the schema's name; name another, such as problem.yaml", file=str(file)
        )
    content, text = _starter(model, known, study), _text(study)
    if os.path.lexists(file):
        raise _exists(file)
    if not os.path.lexists(beside):  # first, so that a run that fails here can be repeated
        _write(beside, text, new=True)
    elif not beside.is_file() or beside.read_text(encoding="utf-8", errors="replace") != text:
        renewing = f"nhpocp schema {'--study ' if study else ''}-o {beside}"
        say(f"{beside}: not this version's schema, and left alone; `{renewing}` renews an older one")
    _write(file, content, new=True)
    if as_json:
        put({"file": str(file), "schema": str(beside)})
    else:
        tell(f"{file}\n{beside}\nnext: nhpocp {'sweep' if study else 'solve'} {file}")
    return 0


def _schema(study: bool) -> Any:
    if study:
        from nhpocp.study.starter import study_schema

        return study_schema()
    from nhpocp.problem_file import json_schema

    return json_schema()


def _starter(model: str, schema: str, study: bool) -> str:
    if study:
        from nhpocp.study.starter import study_starter

        return study_starter(model, schema)
    from nhpocp.problem_file import starter

    return starter(model, schema)


def _text(study: bool) -> str:
    return json.dumps(_schema(study), indent=1, ensure_ascii=False) + "\n"


def _is_schema(path: Path) -> bool:
    """Whether a file is a schema that this program wrote, of whatever version."""
    from nhpocp.problem_file.document import read_file

    try:
        content = json.loads(read_file(path))
    except (ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("$id") in (SCHEMA, STUDY_SCHEMA)


def _write(path: Path, text: str, *, new: bool = False) -> None:
    try:
        write_text(path, text, new=new)
    except FileExistsError:
        raise _exists(path) from None
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(path)) from error


def _exists(path: Path) -> InvalidProblemError:
    return InvalidProblemError("this file exists and is left alone; name another", file=str(path))
