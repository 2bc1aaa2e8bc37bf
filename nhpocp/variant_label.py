"""How a run is called: `nlp:control=basis,intervals=40` is a solver and the settings that differ."""

from __future__ import annotations

from collections.abc import Iterable


def parts(label: str) -> tuple[str, list[str]]:
    """The solver, and the settings key=value in order: ("nlp", ["control=basis", "intervals=40"])."""
    name, colon, rest = label.partition(":")
    settings, depth = [""], 0
    for letter in rest:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth <= 0:  # not within a list or a mapping
            settings.append("")
        else:
            settings[-1] += letter
    return name, [setting.strip() for setting in settings] if colon else []


def joined(label: str, settings: Iterable[str]) -> str:
    """The label with more settings."""
    more = list(settings)
    return label + (":" if ":" not in label else ",") + ",".join(more) if more else label


def distinct(labels: Iterable[str]) -> list[str]:
    """The labels without the settings that all runs of one solver have in common."""
    every = [parts(label) for label in labels]
    shared: dict[str, set[str]] = {}
    for name, settings in every:
        shared[name] = shared.get(name, set(settings)) & set(settings)
    single = {name for name in shared if sum(other == name for other, _ in every) == 1}
    return [
        joined(name, [own for own in settings if name in single or own not in shared[name]])
        for name, settings in every
    ]
