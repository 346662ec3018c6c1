"""Run work in another process: one call with one result (`Call`), or jobs that yield results in pieces (`Stream`).

The process ends when its `Call` or `Stream` is deleted, or when this program ends. The process ignores Ctrl-C.
`usable_processors` says how many processors the parallel work of one command may use.
"""

from __future__ import annotations

import importlib
import os
import queue
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar, cast

from twin.core.atomic import no_room
from twin.core.errors import TwinError
from twin.core.processes import WorkerProcess
from twin.core.program_end import ending

PROCESSORS = "TWIN_PROCESSORS"
"""Environment variable that limits the number, for computers that several people or programs share."""

Answer = TypeVar("Answer")
"""What the function of a `Call` returns."""

Piece = TypeVar("Piece")
"""A part of the result of a job, as the function of a `Stream` yields it."""


@cache
def usable_processors() -> int:
    """Return the number of processors for parallel work: that of `TWIN_PROCESSORS`, else all that the system grants.

    Both are read once: a compiled kernel asks at every call.

    Raises:
        TwinError: `TWIN_PROCESSORS` is not a whole number of at least 1.
    """
    # The system grants fewer processors than the computer has, for example in a container or under `taskset`.
    granted = len(os.sched_getaffinity(0))
    limit = os.environ.get(PROCESSORS)
    if not limit:
        return granted
    if not limit.isdecimal() or int(limit) < 1:
        raise TwinError(f"{PROCESSORS} is {limit!r}: give a whole number of processors, 1 or more, or unset it")
    return min(int(limit), granted)


class Call(Generic[Answer]):
    """A function call in a separate process; the process ends at the end of the `with` block, or at `close`.

    Args:
        function: function at the top level of a module; function, arguments and result are pickled.
        arguments: arguments of the function.
        nice: increase of the process's nice value, which lowers its priority.
    """

    def __init__(self, function: Callable[..., Answer], *arguments: object, nice: int = 0) -> None:
        self._process = WorkerProcess(_send_answer, function.__module__, function.__qualname__, arguments, nice)
        self._outcome: tuple[Answer, None] | tuple[None, str] | None = None
        # A result may be larger than the pipe's buffer, so a thread reads the pipe continuously.
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def done(self) -> bool:
        """Whether a result or an error has arrived."""
        return self._outcome is not None

    def result(self) -> Answer:
        """Wait for the result and return it.

        Raises:
            TwinError: the function raised an error, or the process ended without a result.
        """
        self._reader.join()
        assert self._outcome is not None
        answer, error = self._outcome
        if error is not None:
            raise TwinError(error)
        return cast("Answer", answer)

    def close(self) -> None:
        """Kill the process."""
        self._process.close()
        self._reader.join()
        self._process.line.close()

    def __enter__(self) -> Call[Answer]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self) -> None:
        try:
            self._outcome = self._process.line.recv()
        except (EOFError, OSError):
            self._outcome = (None, self._process.end_text)


def _send_answer(line: Connection, module: str, name: str, arguments: tuple[object, ...], nice: int) -> None:
    """Send (result, None) of a call, or (None, error text)."""
    os.nice(nice)
    try:
        function = getattr(importlib.import_module(module), name)
        outcome = (function(*arguments), None)
    except (Exception, SystemExit) as error:
        outcome = (None, _error_text(error))
    line.send(outcome)


class Stream(Generic[Piece]):
    """Jobs that run one at a time in another process; the process starts with the first job and stays alive.

    Each job is one call of `function`, which yields pieces of the result. No method waits; all methods may be called
    from any thread. A job is cancelled only after its current piece, so each piece should take less than 0.5 s.
    """

    def __init__(self, function: Callable[[Any], Iterator[Piece]], nice: int = 10) -> None:
        """Set the function of all jobs; `nice` is added to the nice value of the process, which lowers its priority."""
        self._function = function
        self._nice = nice
        self._lock = threading.Lock()
        self._process: WorkerProcess | None = None
        self._number = 0  # of the last job
        self._running = False

    def start(self, job: object) -> None:
        """Start a job; a running job is cancelled and its pieces are discarded."""
        with self._lock:
            if self._process is None or not self._process.alive:
                self._close()
                self._open()
            self._send(job)

    def poll(self) -> tuple[list[Piece], str | None]:
        """Return (new pieces, end).

        In the first call after the end of a job, `end` is "" (done) or an error text; otherwise, `end` is None.
        """
        with self._lock:
            new: list[Piece] = []
            with suppress(queue.Empty):
                while self._running:
                    number, piece, end = self._inbox.get_nowait()
                    if number not in (self._number, None):
                        continue
                    if end is None:
                        new.append(cast("Piece", piece))
                        continue
                    self._running = False
                    if number is None:
                        self._close()
                    return new, end
            return new, None

    def cancel(self) -> None:
        """Cancel the running job; the process stays alive."""
        with self._lock:
            if self._process is not None:
                self._send(None)

    def close(self) -> None:
        """Kill the process; a later `start` creates a new one."""
        with self._lock:
            self._close()

    def _send(self, job: object) -> None:
        """Send the next job to the process; None cancels the running one."""
        assert self._process is not None
        self._number += 1
        self._running = job is not None
        with suppress(OSError):  # the process has ended: `poll` reports it
            self._process.line.send((self._number, job))

    def _open(self) -> None:
        """Start the process, and a thread that reads its pieces."""
        function = self._function
        self._process = WorkerProcess(_send_pieces, function.__module__, function.__qualname__, self._nice)
        self._inbox: queue.SimpleQueue[tuple[int | None, Piece | None, str | None]] = queue.SimpleQueue()
        # A piece may be larger than the pipe's buffer; without this thread, `poll` would wait for the process.
        threading.Thread(target=_fill, args=(self._process, self._inbox), daemon=True).start()

    def _close(self) -> None:
        self._running = False
        if self._process is not None:
            self._process.close()
            self._process = None


def _fill(process: WorkerProcess, inbox: queue.SimpleQueue) -> None:
    """Put (number of the job, piece, end) into the inbox until the process ends; its own end has no number."""
    with process.line as line, suppress(EOFError, OSError):
        while True:
            inbox.put(line.recv())
    inbox.put((None, None, process.end_text))


def _send_pieces(line: Connection, module: str, name: str, nice: int) -> None:
    """Run jobs until the other end of the pipe is closed."""
    os.nice(nice)
    function = getattr(importlib.import_module(module), name)
    while True:
        number, job = line.recv()
        if job is None or line.poll():
            continue
        try:
            for piece in function(job):
                line.send((number, piece, None))
                if line.poll():
                    break
            else:
                line.send((number, None, ""))
        except (BrokenPipeError, ConnectionResetError):
            raise
        except (Exception, SystemExit) as error:  # any error is reported; the calling program continues
            line.send((number, None, _error_text(error)))


def _error_text(error: BaseException) -> str:
    """Return an error as text for the parent process; the text of an unexpected error names its function and line."""
    if isinstance(error, SystemExit):
        return str(ending(error))
    if isinstance(error, TwinError):
        return str(error)
    if isinstance(error, OSError) and (full := no_room(error)):
        return full
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({last.name}, line {last.lineno})"
