"""Entry point: runs a verb and turns errors into messages and exit statuses."""

from __future__ import annotations

import gc
import io
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

import click

from nhpocp import plugins
from nhpocp.cli.exit_status import BAD_INPUT, MISSING_PART, NOT_SOLVED, SOLVED
from nhpocp.cli.terminal import abandon, error_data, open_streams, put, say
from nhpocp.cli.verbs import cli
from nhpocp.errors import MissingDependencyError, NhpocpError, NhpocpWarning

NO_ROOM = "failed to map segment"  # the system's words, of a shared library
BY_HAND = "stopped by hand; no solution was written"


def main() -> None:
    """The program `nhpocp`."""
    # pydantic would look through every installed package for plugins, a tenth of the time of `check`
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # where it keeps its fonts is nobody's worry
    # NumPy's warnings of overflow: what they led to is said in words, and beside --json they would be noise
    warnings.simplefilter("ignore", RuntimeWarning)
    open_streams()
    gc.set_threshold(100_000)  # looking for circles of garbage at every turn took a tenth of `solve`
    arguments = sys.argv[1:]
    if "--debug" in arguments:  # wherever it stands
        arguments = ["--debug", *(argument for argument in arguments if argument != "--debug")]
    ended = status(arguments)
    gc.freeze()  # what is left is not worth collecting: that took a quarter of the time of `check`
    sys.exit(ended)


def status(arguments: Sequence[str]) -> int:
    """Runs a verb; its exit status."""
    as_json, debug = "--json" in arguments, "--debug" in arguments
    try:
        with _stopped_alike(), _warnings_said():
            returned = cli.main(args=list(arguments), prog_name="nhpocp", standalone_mode=False)
        sys.stdout.flush()
    except click.ClickException as error:
        error.show(words := io.StringIO())
        say(words.getvalue().rstrip("\n"))
        return _answer(as_json, error_data(error, message=error.format_message()), BAD_INPUT)
    except (click.Abort, KeyboardInterrupt) as error:
        say(BY_HAND)
        return _answer(as_json, error_data(error, message=BY_HAND), NOT_SOLVED)
    except MemoryError as error:
        if debug:
            raise
        message = f"out of memory: {error}" if str(error) else "out of memory"
        say(message)
        return _answer(as_json, error_data(error, message=message), NOT_SOLVED)
    except NhpocpError as error:
        if debug:
            raise
        say(str(error))
        missing = isinstance(error, MissingDependencyError)
        return _answer(as_json, error_data(error), MISSING_PART if missing else BAD_INPUT)
    except BrokenPipeError:
        abandon(sys.stdout)
        return NOT_SOLVED
    except OSError as error:
        if debug:
            raise
        place = None if error.filename is None else os.fsdecode(str(error.filename))
        message = error.strerror or str(error)
        say(f"{place}: {message}" if place else message)
        return _answer(as_json, error_data(error, file=place, message=message), BAD_INPUT)
    except Exception as error:
        if not debug and isinstance(error, ImportError) and NO_ROOM in str(error):
            say("out of memory: a library finds no room")
            return _answer(as_json, error_data(error, message="out of memory"), NOT_SOLVED)
        if debug or not (fault := plugins.fault(error)):
            raise
        say(fault)
        return _answer(as_json, error_data(error, message=fault), BAD_INPUT)
    return returned if isinstance(returned, int) else SOLVED


@contextmanager
def _warnings_said() -> Iterator[None]:
    """What nhpocp warns of is a sentence for people, without the line of code that it came from."""
    shown = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if issubclass(category, NhpocpWarning):
            say(f"warning: {message}")
        else:
            shown(message, category, *place, **more)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


@contextmanager
def _stopped_alike() -> Iterator[None]:
    """SIGTERM and SIGHUP act like Ctrl-C, unless they are to be ignored (`nohup`)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    changed = [number for number in numbers if before[number] is not signal.SIG_IGN]
    try:
        for number in changed:
            signal.signal(number, _as_ctrl_c)
        yield
    finally:
        for number in changed:
            signal.signal(number, before[number])


def _as_ctrl_c(number: int, frame: FrameType | None) -> None:
    act = signal.getsignal(signal.SIGINT)
    if not callable(act):  # in the background of a script Ctrl-C means others
        raise KeyboardInterrupt
    act(signal.SIGINT, frame)


def _answer(as_json: bool, data: Any, status: int) -> int:
    """The exit status, after the data in JSON where that was asked for, if standard output takes it."""
    try:
        if as_json:
            put(data)
        sys.stdout.flush()
    except OSError:
        abandon(sys.stdout)
    return status
