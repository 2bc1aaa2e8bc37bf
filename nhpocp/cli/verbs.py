"""The verbs by name, each announced in one line and imported when it is called or listed.

Everything heavy is imported inside the verb that needs it, so that --help and check answer at once.
"""

from __future__ import annotations

from typing import Any, cast

import click

from nhpocp.family import Family

VERBS: Family[click.Command] = Family(
    {
        "analyze": "nhpocp.cli.analyzing:analyze",
        "animate": "nhpocp.cli.animating:animate",
        "calibrate": "nhpocp.cli.calibrating:calibrate",
        "check": "nhpocp.cli.checking:check",
        "compare": "nhpocp.cli.solving:compare",
        "doctor": "nhpocp.cli.listing:doctor",
        "export": "nhpocp.cli.exporting:export",
        "init": "nhpocp.cli.starting:init",
        "plot": "nhpocp.cli.plotting:plot",
        "schema": "nhpocp.cli.starting:schema",
        "simulate": "nhpocp.cli.simulating:simulate",
        "solve": "nhpocp.cli.solving:solve",
        "steer": "nhpocp.cli.steering:steer",
        "sweep": "nhpocp.cli.sweeping:sweep",
        "systems": "nhpocp.cli.listing:systems",
        "verify": "nhpocp.cli.checking:verify",
    }
)


# a click.Group reads its commands and no more; it is typed for those that are added later
@click.group(commands=cast(Any, VERBS), context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="nhpocp")
@click.option("--debug", is_flag=True, help="Show tracebacks.")
def cli(debug: bool) -> None:
    """Plan motions for parallel robots with non-holonomic joints."""
