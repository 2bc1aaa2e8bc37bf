"""`--set a.b=value`: changes a document before it is validated, and keeps its comments."""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from io import StringIO
from typing import Any

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.document import Document, dotted, parse

Path = tuple[str | int, ...]
_KEY = re.compile(r"[^.\[\]\s=]+|\[\d+\]")


def split(item: str) -> tuple[Path, Any]:
    """("solvers", "jacobian", "gamma"), 0.5 from solvers.jacobian.gamma=0.5; the value is YAML."""
    name, equals, text = item.partition("=")
    name = name.strip()
    words = _KEY.findall(name)
    if not equals or not words or not re.fullmatch(rf"({_KEY.pattern})((\.[^.\[\]\s=]+)|\[\d+\])*", name):
        raise InvalidProblemError(f"--set {item}: expected --set key=value, such as --set horizon=2")
    path = tuple(int(word.strip("[]")) if word.startswith("[") else word for word in words)
    try:
        # as a list's only item, so that an empty value is null and plain text is itself
        value = parse(f"- {text}").data[0] if text.strip() else None
    except (InvalidProblemError, LookupError, TypeError) as error:
        reason = error.message if isinstance(error, InvalidProblemError) else "not one value"
        raise InvalidProblemError(f"--set {item}: {reason}", path=dotted(path)) from None
    return path, value


def apply(document: Document, overrides: Sequence[str], file: str | None) -> tuple[Document, list[str]]:
    """The document with every override in it, and the paths that were set (they stand in no line of the file)."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    changes = [split(item) for item in overrides]
    yaml = YAML(typ="rt")
    yaml.preserve_quotes, yaml.width = True, 4096
    yaml.indent(mapping=2, sequence=4, offset=2)
    try:
        tree = yaml.load(document.text)
        if document.aliases:
            tree = _unshare(tree)
        for path, value in changes:
            _assign(tree, path, value)
        stream = StringIO()
        yaml.dump(tree, stream)
    except (YAMLError, ValueError, AttributeError) as error:
        if isinstance(error, InvalidProblemError):
            raise
        raise InvalidProblemError(
            f"--set cannot change this file ({type(error).__name__}); edit the file instead", file=file
        ) from None
    changed = parse(stream.getvalue())
    paths = [dotted(path) for path, _ in changes]
    marks = {
        path: document.marks[path]
        for path in changed.marks
        if path in document.marks and not any(within(path, done) for done in paths)
    }
    return Document(changed.data, changed.text, marks, changed.aliases), paths


def within(path: str, outer: str) -> bool:
    """Whether a dotted path is another one, or leads further in."""
    return path.startswith(outer) and path[len(outer) : len(outer) + 1] in ("", ".", "[")


def _assign(tree: Any, path: Path, value: Any) -> None:
    here = tree
    for i, part in enumerate(path):
        last = i == len(path) - 1
        where = dotted(path[:i]) or "the file"
        name = f"--set {dotted(path)}"
        if isinstance(here, list):
            index = int(part) if isinstance(part, int) or part.isdigit() else -1
            if not 0 <= index < len(here):
                raise InvalidProblemError(
                    f"{name}: {where} is a list of {len(here)}; expected an index 0…{len(here) - 1}",
                    path=dotted(path),
                )
            part = index
        elif not isinstance(here, dict) or isinstance(part, int):
            raise InvalidProblemError(f"{name}: {where} has no keys to set", path=dotted(path))
        if last:
            here[part] = value
        else:
            if isinstance(here, dict) and here.get(part) is None:
                here[part] = {}
            here = here[part]


def _unshare(node: Any) -> Any:
    """The same tree where every alias is a copy: a change in one place must not show in another."""
    node = copy.deepcopy(node, {})
    if hasattr(node, "anchor"):
        node.yaml_set_anchor(None)
    if isinstance(node, dict | list):
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            node[key] = _unshare(node[key])
    return node
