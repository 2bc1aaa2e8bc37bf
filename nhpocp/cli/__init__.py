"""The command line: verbs, messages and exit statuses; no mathematics."""

from nhpocp.cli.entry import main

__all__ = ["main"]
