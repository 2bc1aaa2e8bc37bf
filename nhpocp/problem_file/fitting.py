"""A first control made to fit a basis of another size that `--set` asks for, so that a loop over sizes is one line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nhpocp.controls.registry import BASES
from nhpocp.declared import declarations
from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.composing import Tree, resolve, unshared
from nhpocp.problem_file.control import DEFAULT


def nested_size(root: Any) -> tuple[str, int] | None:
    """Kind and functions per input of a file's basis, of which smaller ones are the first; None if it is no such."""
    control = _entries(_entries(root).get("control"))
    kind = resolve(control["basis"].value) if _is_scalar(control.get("basis")) else DEFAULT
    if kind not in list(BASES) or not (basis := BASES[kind]).nested:
        return None
    sizes = {name: declared.default for name, declared in declarations(basis).items()}
    sizes |= {name: resolve(control[name].value) for name in sizes if _is_scalar(control.get(name))}
    whole = all(
        isinstance(sizes[name], int) and 0 <= sizes[name] <= (declared.most or 0)
        for name, declared in declarations(basis).items()
    )
    return (kind, basis(**sizes).size) if whole else None


def fit_initial(
    root: Any, before: tuple[str, int] | None, paths: Sequence[Sequence[str | int]]
) -> list[InvalidProblemError]:
    """Pads `control.initial` with zeros, or cuts it, where overrides at ``paths`` changed its basis from ``before``.

    A file that contradicts itself stays as it is, to be refused. Returns what is to be said of it.
    """
    after = nested_size(root)
    initial = _entries(_entries(root).get("control")).get("initial")
    own = any(tuple(path[:2]) == ("control", "initial") for path in paths)
    if own or not before or not after or before == after or before[0] != after[0]:
        return []
    old, new = before[1], after[1]
    rows = initial.value if initial is not None and initial.id == "sequence" else []
    if not rows or any(row.id != "sequence" or len(row.value) != old for row in rows):
        return []
    zero = Tree("- 0", comments=True).root.value[0]
    for row in rows:
        comment = row.value[-1].comment  # of the line
        row.value = [*row.value[:new], *(unshared(zero, marked=False) for _ in range(new - old))]
        row.value[-1].comment = comment
    done = f"padded with zeros from {old} to {new}" if new > old else f"cut from {old} to {new}"
    return [
        InvalidProblemError(f"{done} columns, to fit the basis that --set asks for", path="control.initial")
    ]


def _is_scalar(node: Any) -> bool:
    return node is not None and node.id == "scalar"


def _entries(node: Any) -> dict[str, Any]:
    """The nodes of a mapping by their keys; none where it is no mapping."""
    if node is None or node.id != "mapping":
        return {}
    return {key.value: value for key, value in node.value if _is_scalar(key)}
