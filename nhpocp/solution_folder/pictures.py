"""What can be drawn again later: attempted, and said where it is missing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nhpocp.interruption import Interruption
from nhpocp.whole import write_files


def attempted(write: Callable[[], Any]) -> str:
    """Has something written; "" or why there is none: no room, no permission, Ctrl-C, which ends it soon."""
    try:
        with Interruption(patient=False) as interruption:
            interruption.check()
            write()
    except OSError as error:
        return error.strerror or str(error)
    except KeyboardInterrupt:
        return "stopped by hand"
    return ""


def drawn(draw: Callable[[Path], Any], folder: Path) -> str:
    """Has pictures added to a folder, all or none; "" or a warning. The numbers matter more."""
    why = attempted(lambda: write_files(folder, draw))
    return f"the pictures could not be written ({why})" if why else ""
