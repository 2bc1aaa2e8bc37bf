"""How objects show themselves in a notebook: by views, which stand above them and are imported when somebody looks.

The one place that names rooms of higher floors: a line each, which nothing imports before it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nhpocp.family import Family

VIEWS: Family[Callable[..., Any]] = Family(
    {
        "card": "nhpocp.views.cards:card",
        "plot": "nhpocp.views.inline:plot",
        "animate": "nhpocp.views.inline:animate",
        "data_frame": "nhpocp.solution_folder.tables:data_frame",
    }
)


class Shown:
    """What a notebook shows as a card: the verdict, a small table, a picture."""

    def _repr_html_(self) -> str:
        html: str = VIEWS["card"](self)
        return html
