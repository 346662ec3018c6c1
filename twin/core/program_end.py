"""Limits for running the Python code of a robot's author: it may not end the program, and it must return in time.

`sys.exit()` in a formula would otherwise end a check without a verdict, and with exit code 0. The same is true of code
that sends the output of this program elsewhere.
"""

from __future__ import annotations

import builtins
import contextlib
import os
import select
import signal
import sys
import sysconfig
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import TextIO

from twin.core import program_pipe
from twin.core.errors import TwinError

SECONDS = "TWIN_CODE_SECONDS"
"""Environment variable: the longest time in s that one piece of an author's code may run."""

_DEFAULT_SECONDS = 60.0

_RAISING_INTERVAL = 1.0
"""Interval in s at which the error is raised again: code may catch it, and native libraries may discard it."""

_COUNTING_SECONDS = 2.0
"""Longest time in s until the supervisor has counted an interrupt that this process received."""

_SIGNAL_FUNCTIONS = ("kill", "killpg")
"""Functions of `os` that send a signal, also to this process and to the one that supervises it."""

_LIBRARY_PATHS = ("stdlib", "purelib", "platlib")

_LIBRARY_FILES = (str(Path(__file__).resolve().parents[1]), *map(sysconfig.get_path, _LIBRARY_PATHS), "<frozen ")
"""Beginnings of file names: files of twin, of the standard library and of installed packages."""


class ProgramEndError(TwinError):
    """Code of an author tries to end the program, or runs longer than allowed."""


class _LateError(Exception):
    """Code still runs after the allowed time."""


class Output:
    """The output of this program at one time, to find code that replaces or closes it.

    A verdict that is printed to a replaced or closed output is not seen.
    """

    def __init__(self) -> None:
        self._stream = sys.stdout
        self._print = builtins.print
        self._file = _open_file()

    def restore(self) -> list[str]:
        """Restore the output as far as possible; return what had been done to it, as verbs with objects."""
        changes = []
        if sys.stdout is not self._stream:
            changes.append("replaces sys.stdout")
            sys.stdout = self._stream
        if builtins.print is not self._print:
            changes.append("replaces print")
            builtins.print = self._print
        if _is_closed(self._stream):
            changes.append("closes sys.stdout")
        elif _open_file() != self._file:
            changes.append("closes or redirects the file descriptor 1")
        return changes

    def check(self, place: str = "") -> None:
        """Restore the output; `place` is "file:line" of the code that ran in the meantime, "" if it is not known.

        Raises:
            ProgramEndError: the output was not the same as before.
        """
        changes = self.restore()
        if changes:
            subject = place or "code of the robot"
            actions = " and ".join(changes)
            raise ProgramEndError(
                f"{subject}: the code {actions}, so no verdict can be printed. Use contextlib.redirect_stdout, which "
                "restores the output."
            )


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _is_closed(stream: TextIO | None) -> bool:
    try:
        return stream is not None and stream.closed
    except ValueError:  # its buffer was detached
        return True


def _open_file() -> tuple[int, int] | None:
    """Return device and inode of the file that is open at file descriptor 1; None if it is closed."""
    try:
        status = os.fstat(1)
    except OSError:
        return None
    return status.st_dev, status.st_ino


@contextlib.contextmanager
def contained(code: Path | Callable[..., object]) -> Iterator[None]:
    """In this context, code that ends the program or does not return in time raises a `ProgramEndError`.

    Time and output are checked only in the main thread; the time is measured only by the outermost context.

    Args:
        code: the file or function that runs in this context.

    Raises:
        ProgramEndError: the code raises SystemExit, KeyboardInterrupt or the like, runs longer than
            `TWIN_CODE_SECONDS` (default: 60 s), or replaces or closes the output of this program. The message gives
            file and line; for the output, those of `code`.
    """
    output = Output() if _in_main_thread() else None
    try:
        with _timed():
            yield
    except KeyboardInterrupt as stop:
        if _raised_by_handler(stop) and interrupted():
            raise
        raise ending(stop) from stop
    except _LateError as late:
        place = _authored_line(traceback.extract_tb(late.__traceback__))
        raise ProgramEndError(f"{place}: {late}") from late
    except Exception:
        raise
    except BaseException as end:  # SystemExit, or another exception that handlers of errors do not catch
        raise ending(end) from end
    else:
        if output is not None:
            output.check(_source(code))
    finally:
        if output is not None:
            output.restore()


def _source(code: Path | Callable[..., object]) -> str:
    """Return "file" of a file, "file:line" of a function; "" of a callable object without code."""
    if isinstance(code, Path):
        return str(code)
    inside = getattr(code, "__code__", None)
    return f"{inside.co_filename}:{inside.co_firstlineno}" if inside else ""


def ending(error: BaseException) -> ProgramEndError:
    """Return the error for code that tries to end the program by `error`; its message gives file and line."""
    name = type(error).__name__
    if isinstance(error, SystemExit):
        name = "SystemExit"
        if error.code is not None:
            name = f"SystemExit({error.code!r})"
    text = f"the code ends the program by {name}, so nothing can be checked. Return a value instead."
    # A signal to a process group may come twice: the first interrupt is that of the code, the second comes anywhere.
    first = error
    while isinstance(first, KeyboardInterrupt) and isinstance(first.__context__, KeyboardInterrupt):
        first = first.__context__
    place = _authored_line(traceback.extract_tb(first.__traceback__))
    if place:
        text = f"{place}: {text}"
    return ProgramEndError(text).with_traceback(error.__traceback__)


def name_exits(report: Callable[[str], object]) -> None:
    """Let calls of functions of `os` that can end this process first report their file and line, each place once.

    Signals are reported only if code of an author sends them. Child processes that are forked from this process do not
    report.
    """
    process = os.getpid()
    reported: set[str] = set()

    def reporting(name: str, function: Callable[..., object]) -> Callable[..., None]:
        """Return a function of `os` that reports its caller before it is called."""

        def reported_call(*arguments: object) -> None:
            if os.getpid() == process:
                place = _authored_line(traceback.extract_stack()[:-1])
                text = f"os.{name} was called"
                if place:
                    text += f" at {place}"
                if text not in reported and (place or name not in _SIGNAL_FUNCTIONS):
                    reported.add(text)
                    report(text)
            function(*arguments)

        return reported_call

    for name in ("_exit", "execv", "execve", *_SIGNAL_FUNCTIONS):
        setattr(os, name, reporting(name, getattr(os, name)))


def _authored_line(frames: Sequence[traceback.FrameSummary]) -> str:
    """Return "file:line" of the innermost frame in a file of an author; "" if there is none."""
    for frame in reversed(frames):
        if not frame.filename.startswith(_LIBRARY_FILES):
            return f"{frame.filename}:{frame.lineno}"
    return ""


def _raised_by_handler(stop: KeyboardInterrupt) -> bool:
    """Return whether the handler of SIGINT raised this; what code raises has that code's own frame as the last."""
    handler = signal.getsignal(signal.SIGINT)
    code = getattr(handler, "__code__", None)
    if code is None:  # Python's own handler has no frame
        return True
    last_frame: FrameType | None = None
    for frame, _ in traceback.walk_tb(stop.__traceback__):
        last_frame = frame
    return last_frame is not None and last_frame.f_code is code


def interrupted() -> bool:
    """Return whether an interrupt of this process comes from elsewhere, such as Ctrl-C; assumed if not supervised.

    Code may call `_thread.interrupt_main`, or send SIGINT to its own process; its supervisor receives nothing then.
    """
    if program_pipe.interrupts is None:
        return True
    counted, _, _ = select.select([program_pipe.interrupts], [], [], _COUNTING_SECONDS)
    return bool(counted)


@contextlib.contextmanager
def _timed() -> Iterator[None]:
    """Raise a `_LateError` in the main thread after the allowed time."""
    remaining, _ = signal.getitimer(signal.ITIMER_REAL)
    # Python allows handlers of signals only in the main thread; an outer context has set the timer already.
    if not _in_main_thread() or remaining:
        yield
        return
    seconds = _allowed_seconds()

    def late(number: int, frame: FrameType | None) -> None:
        raise _LateError(
            f"the code has run for {seconds:g} s without an end; {SECONDS}={10 * seconds:g} in the environment allows "
            "ten times as long"
        )

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds, _RAISING_INTERVAL)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL if before is None else before)


def _allowed_seconds() -> float:
    """Return the longest time in s that code may run.

    Raises:
        TwinError: the environment states no positive number.
    """
    text = os.environ.get(SECONDS, "")
    try:
        seconds = float(text) if text else _DEFAULT_SECONDS
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < sys.float_info.max:
        raise TwinError(f"{SECONDS}={text}: give a positive number of seconds.")
    return seconds
