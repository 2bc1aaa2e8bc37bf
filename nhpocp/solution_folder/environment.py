"""What a result may depend on besides its problem: machine, plugin, compiler."""

from __future__ import annotations

from typing import Any

from nhpocp.machine import compiler, machine


def environment(plugin: str | None = None) -> dict[str, Any]:
    """The machine and its versions, the NLP plugin that was used and the C compiler that is at hand."""
    return {**machine(), "plugin": plugin, "compiler": compiler()}
