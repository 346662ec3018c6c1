"""Run one command of the command line: parse its arguments, call its function, and print its errors."""

from __future__ import annotations

import _thread
import argparse
import contextlib
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from types import FrameType

from twin.cli.parser import UsageError, parser
from twin.core.errors import TwinError
from twin.core.program_end import Output, ending, interrupted

# Other modules are imported where they are used, so that `twin --help` takes 46 ms of processor time instead of 64 ms.


_SERVERS = ("serve", "view", "follow")
"""Commands that serve a page until Ctrl-C."""


_SURROGATE = re.compile("[\ud800-\udfff]")
"""A byte of a file name that is not UTF-8, as Python reads it."""

_SHOWN_CHARACTERS = 200
"""Number of characters of such a name that a message shows."""


def run(argv: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    argv = list(argv)
    if sys.stdout is None:  # as after `twin ... >&-`: printing would raise AttributeError
        text = "the standard output is closed, so no verdict can be printed; redirect it to a file or to /dev/null"
        return failed("OutputError", text, as_json=False)
    _settle_all()
    for stream in (sys.stdout, sys.stderr):  # print a question mark for unsupported characters
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    output = Output()
    if not argv:  # no command: say what to do next; this is wrong usage
        from twin.cli.commands import FIRST

        print(FIRST, end="")
        return 2
    args = argparse.Namespace(json="--json" in argv, debug="--debug" in argv)  # until the arguments are parsed
    try:
        with after_imports():
            args = parser().parse_args(argv)
            command = _prepared(args)
        # asyncio, which serves pages, replaces only Python's own handler of Ctrl-C.
        with contextlib.nullcontext() if args.command in _SERVERS else after_imports():
            code = _completed(command, args)
        output.check()
        sys.stdout.flush()  # raises a broken pipe here, where it is handled
        return code
    except UsageError as error:
        print(error.usage, end="", file=sys.stderr)
        return failed("usage", str(error), args.json)
    except TwinError as error:
        _trace(args.debug)
        return failed(type(error).__name__, str(error), args.json)
    except KeyboardInterrupt as stopped:
        _settle_all()  # child processes were killed and have left their temporary folders
        if not interrupted():  # code of a robot did this, perhaps in a thread
            return failed("ProgramEndError", str(ending(stopped)), args.json)
        # a command that can be resumed says so in the exception
        advice = ", ".join(map(str, stopped.args)) or _complete_files()
        print(f"twin: interrupted: {advice}", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader has closed the pipe
        # Python flushes the output once more at its end, and would print the same error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    except Exception as error:
        _trace(args.debug)
        from twin.core.atomic import no_room

        if full := no_room(error):
            return failed("OutputError", full, args.json)
        if isinstance(error, UnicodeEncodeError) and _SURROGATE.search(str(error.object)):
            text = f"{ascii(str(error.object))[:_SHOWN_CHARACTERS]} is not valid UTF-8: rename the file or folder"
            return failed("output", text, args.json)
        if isinstance(error, OSError) and (refused := _refused(error)):
            return failed(type(error).__name__, refused, args.json)
        if isinstance(error, MemoryError):
            text = f"the memory of this computer does not suffice ({error or 'none is left'}): ask for fewer samples"
            return failed(type(error).__name__, text, args.json)
        text = f"internal error, {type(error).__name__}: {error}. Please report it with the output of --debug."
        return failed(type(error).__name__, text, args.json)


def _refused(error: OSError) -> str:
    """Return a message that names the path that the system refuses, as for lack of permission; "" if it names none."""
    if error.filename is not None:
        path = os.fsdecode(error.filename) if isinstance(error.filename, bytes) else str(error.filename)
        if len(path) > _SHOWN_CHARACTERS:
            path = f"{path[:_SHOWN_CHARACTERS]}..."
        return f"{path}: {error.strerror or error}"
    try:
        Path.cwd()
    except OSError:
        return "the working folder no longer exists: change to another folder"
    return ""


def _completed(command: Callable[[argparse.Namespace], int], args: argparse.Namespace) -> int:
    """Run a command to its end and return its exit code.

    Raises:
        ProgramEndError: code that the command runs asks to end the program; without a verdict, that is no success.
    """
    try:
        return int(command(args))
    except SystemExit as end:
        raise ending(end) from end


def _prepared(args: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    """Set up the process, clean up after killed processes, and return the function that runs the command."""
    import logging

    from twin.core import atomic

    atomic.completed.clear()
    # All matrices are small: several threads of the linear algebra library would be slower than one.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Child processes must not import modules (such as a file `numpy.py`) from the folder of a downloaded robot.
    os.environ["PYTHONSAFEPATH"] = "1"
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")
    # The note on stderr that a robot's code is executed is always printed, also with --quiet and --json.
    for running_code in ("twin.robots", "twin.core.foreign.consent"):
        logging.getLogger(running_code).setLevel(logging.INFO)
    if args.no_code:
        from twin.core.foreign.consent import NO_CODE

        os.environ[NO_CODE] = "1"
    from twin.cli.scene_refusal import refuse

    _settle(args)
    refuse(args)
    return import_module(f"twin.cli.commands.{args.command}").run


def _complete_files() -> str:
    """Return a note for an interrupted command: in which folders all files are complete."""
    from twin.core.atomic import completed

    folders = ", ".join(dict.fromkeys(map(str, completed)))
    return f"complete files are in {folders}" if folders else "nothing was written"


def _trace(debug: bool) -> None:
    """With --debug, print the traceback of the current error. An uncaught error would set exit code 1: "disagree"."""
    if debug:
        import traceback

        traceback.print_exc()


def _settle_all() -> None:
    """Complete or remove unfinished files of killed processes; without such files, this takes 0.1 ms."""
    from twin.core.unfinished import abandoned

    if abandoned():
        from twin.core.atomic import settle_all

        settle_all()


def _settle(args: argparse.Namespace) -> None:
    """Complete or remove unfinished files in the folders that this command names, also those of other machines."""
    import tempfile
    from pathlib import Path

    from twin.core.atomic import settle

    settle(Path(tempfile.gettempdir()))
    # any text may be a path, and for others `settle` finds no folder
    for value in vars(args).values():
        if isinstance(value, str) and value:
            settle(Path(value))


def failed(kind: str, message: str, as_json: bool) -> int:
    """Print an error that prevented the check; return exit code 2."""
    if as_json:
        from twin.core import findings
        from twin.core.result import as_json as text_of
        from twin.core.result import record

        finding = findings.error("error." + kind.removesuffix("Error").lower(), "", message)
        print(text_of(record("error", {"error": kind, "message": message, "residuals": []}, [finding])))
    print(f"twin: {message}", file=sys.stderr)
    return 2


_UNINTERRUPTIBLE_FILES = ("<frozen importlib._bootstrap>", str(Path("casadi", "casadi.py")))
"""Endings of file names; functions in these files must not be interrupted."""

_RETRY_INTERVAL = 0.05
"""Time in s between two checks whether such a function is still running."""


@contextlib.contextmanager
def after_imports() -> Iterator[None]:
    """In this context, a Ctrl-C raises KeyboardInterrupt only when no import and no call of CasADi is in progress.

    During an import, native libraries crash at Ctrl-C, or ignore it. CasADi discards exceptions of the Python functions
    that it calls to convert arguments; an exception raised there by Ctrl-C would be lost.
    """
    is_main_thread = threading.current_thread() is threading.main_thread()
    # in other threads, handlers cannot be set; a handler of a program that calls `main` is left alone
    if not is_main_thread or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, or do so later if an unsafe function is on the stack; the handler of SIGINT."""
    calling_frame = frame
    while calling_frame is not None:
        if calling_frame.f_code.co_filename.endswith(_UNINTERRUPTIBLE_FILES):
            # the handler cannot wait, because it runs in the thread of the unsafe function: it is called again
            later = threading.Timer(_RETRY_INTERVAL, _thread.interrupt_main)
            later.daemon = True
            later.start()
            return
        calling_frame = calling_frame.f_back
    signal.default_int_handler(number, frame)
