"""`--set a.b=value`: changes a document before it is checked, and keeps its comments."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.document import Document, dotted, read_tree

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node

Path = tuple[str | int, ...]
_KEY = re.compile(r"[^.\[\]\s=]+|\[\d+\]")


def split(item: str) -> tuple[Path, Node]:
    """("solvers", "jacobian", "gamma") and the node 0.5 from solvers.jacobian.gamma=0.5; the value is YAML."""
    from nhpocp.problem_file.composing import Tree, unshared

    name, equals, text = item.partition("=")
    name = name.strip()
    words = _KEY.findall(name)
    if not equals or not words or not re.fullmatch(rf"({_KEY.pattern})((\.[^.\[\]\s=]+)|\[\d+\])*", name):
        raise InvalidProblemError(f"--set {item}: expected --set key=value, such as --set horizon=2")
    path = tuple(int(word.strip("[]")) if word.startswith("[") else word for word in words)
    try:
        # as a list's only item, so that an empty value is null and plain text is itself
        tree = Tree(f"- {text}", comments=True)
        if not isinstance(tree.plain()[0], list) or len(tree.root.value) != 1:
            raise InvalidProblemError("not one value")
    except InvalidProblemError as error:
        raise InvalidProblemError(f"--set {item}: {error.message}", path=dotted(path)) from None
    return path, unshared(tree.root.value[0], marked=False)


def apply(
    text: str, overrides: Sequence[str], file: str | None
) -> tuple[Document, list[str], list[InvalidProblemError]]:
    """The document of a text with every override in it.

    Beside it the paths that were set (they stand in no line of it), and what was made to fit them, as doubts.
    """
    from ruamel.yaml.error import YAMLError

    from nhpocp.problem_file.fitting import fit_initial, nested_size

    tree = read_tree(text, file, comments=True)
    changes = [split(item) for item in overrides]
    tree.unshare()
    before = nested_size(tree.root)
    for path, value in changes:
        _assign(tree.root, path, value)
    fitted = fit_initial(tree.root, before, [path for path, _ in changes])
    try:
        written = tree.write()
    except (YAMLError, ValueError, AttributeError) as error:
        raise InvalidProblemError(
            f"--set cannot change this file ({type(error).__name__}); edit the file instead", file=file
        ) from None
    return Document(written, *tree.plain()), [dotted(path) for path, _ in changes], fitted


def within(path: str, outer: str) -> bool:
    """Whether a dotted path is another one, or leads further in."""
    return path.startswith(outer) and path[len(outer) : len(outer) + 1] in ("", ".", "[")


def _assign(here: Any, path: Path, value: Any) -> None:
    """Puts a node at a path below another one; mappings on the way are made."""
    from nhpocp.problem_file.composing import mapping, nothing, scalar

    for i, part in enumerate(path):
        name, where = f"--set {dotted(path)}", dotted(path[:i]) or "the file"
        if here.id == "sequence":
            place, count = int(part) if isinstance(part, int) or part.isdecimal() else -1, len(here.value)
            if not 0 <= place < count:
                words = f"{name}: {where} is a list of {count}; expected an index 0…{count - 1}"
                raise InvalidProblemError(words, path=dotted(path))
        elif here.id == "mapping" and isinstance(part, str):
            keys = [key.value for key, _ in here.value]
            if part not in keys:
                here.value.append((scalar(part), scalar("")))
            place = keys.index(part) if part in keys else len(keys)
        else:
            raise InvalidProblemError(f"{name}: {where} has no keys to set", path=dotted(path))
        entry = here.value[place]
        old = entry[1] if here.id == "mapping" else entry
        new = value if i == len(path) - 1 else mapping(old) if nothing(old) else old
        if new is not old:
            new.comment = old.comment  # of the same line
            here.value[place] = (entry[0], new) if here.id == "mapping" else new
        here = new
