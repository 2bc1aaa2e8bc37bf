"""The verbs `systems` and `doctor`: what this installation has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from nhpocp.cli.exit_status import SOLVED
from nhpocp.cli.options import json_option
from nhpocp.cli.terminal import put, say, tell


@click.command()
@json_option
def systems(as_json: bool) -> int:
    """List the models: states, inputs, parameters, presets."""
    from nhpocp.problem_file import systems as listing

    models = listing()
    if as_json:
        put(models)
        return SOLVED
    for name, entry in models.items():
        states, inputs = (", ".join(_block(block) for block in entry[part]) for part in ("states", "inputs"))
        tell(f"{name}: state {states}; input {inputs}")
        for parameter, default in entry["defaults"].items():
            value = (
                ""
                if default is None
                else f" = {default:.6g}"
                if isinstance(default, float)
                else f" = {default}"
            )
            choices = entry["parameters"][parameter].get("choices", ())
            words = f" (one of {', '.join(choices)})" if choices else ""
            tell(f"  {parameter}{value}: {entry['meanings'][parameter]}{words}")
        if entry["presets"]:
            tell(f"  presets: {', '.join(entry['presets'])}")
    return SOLVED


def _block(block: Mapping[str, Any]) -> str:
    return block["name"] + "".join(f"[{size}]" for size in block["shape"])


@click.command()
@click.option("--clear-cache", is_flag=True, help="Remove the compiled kernels from the cache first.")
@json_option
def doctor(clear_cache: bool, as_json: bool) -> int:
    """Say which versions, plugins, compiler and compiled kernels are at hand."""
    if clear_cache:
        from nhpocp.flow.compiled.kernel_folder import clear_cache as clear

        say(f"{clear()} kernels removed from the cache")
    from nhpocp.installation import diagnose

    facts = diagnose()
    if as_json:
        put(facts)
    else:
        for name, value in facts.items():
            if isinstance(value, dict):
                value = [f"{part} {entry}" for part, entry in value.items()]
            shown = ", ".join(value) if isinstance(value, list) else value
            tell(f"{name}: {'none' if value is None else shown}")
    return SOLVED
