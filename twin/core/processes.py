"""Start Python processes that import nothing from the working directory.

`python -c` puts the working directory first on its path: a `numpy.py` next to a downloaded robot would be executed.
`multiprocessing` executes the user's own script again. Child processes of twin are therefore isolated (`-I`). They
import twin and the packages from the same folders as their parent, and receive the function call through a pipe. They
end with their parent, also if it is killed.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import os
import signal
import subprocess
import sys
import weakref
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import util
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any

from twin.core import program_pipe
from twin.core.program_end import name_exits

_PACKAGE_FOLDERS = ("site-packages", "dist-packages")
"""Names of the folders of installed packages."""

_SERVE = "from twin.core.processes import serve; serve()"
"""Program of a worker process; its argument is the file descriptor of its end of the pipe."""

_F_SETSIG = 10
"""F_SETSIG of Linux, which the module `fcntl` does not define: the signal that is sent for a file descriptor."""


def isolated(program: str, *arguments: object) -> list[str]:
    """Return the command line that runs a Python program with these arguments in `sys.argv[1:]`.

    The program's `sys.path` contains the standard library, then the folder of twin, then the folders of installed
    packages, but neither the folders of PYTHONPATH nor the folder of a script. If this process ends before the program
    begins, the program does not begin.
    """
    places = [str(Path(__file__).resolve().parents[2])]
    for place in sys.path:
        if Path(place).is_absolute() and Path(place).name in _PACKAGE_FOLDERS:
            places.append(place)
    # a parent that has ended before this line would never close the pipe by which the kernel kills the child
    preamble = f"import os, sys; os.getppid() == {os.getpid()} or sys.exit(1)\n"
    preamble += f"sys.path += [p for p in {places!r} if p not in sys.path]\n"
    flags = ["-I", "-X", "utf8", *(["-B"] if sys.dont_write_bytecode else [])]
    return [sys.executable, *flags, "-c", preamble + program, *map(str, arguments)]


_SPAWNED = "--multiprocessing-fork"
"""Argument of the processes that `multiprocessing` spawns, except those for its own bookkeeping."""


class Child(subprocess.Popen[bytes]):
    """A child process that the kernel kills at once when this process ends, also if this process is killed.

    The child has the reading end of a pipe, and this process the only writing end. When the writing end closes, the
    kernel sends SIGKILL to the child, also while the child is busy in a native library. PR_SET_PDEATHSIG would kill the
    child already when the thread ends that has started it. A second pipe does the same when the process ends that
    supervises this program: the child need not wait until the memory of this process is freed.

    Args:
        command: the command line, from `isolated`.
        pass_fds: further file descriptors that the child receives.
        options: further arguments of `subprocess.Popen`.
    """

    def __init__(self, command: list[str], pass_fds: Sequence[int] = (), **options: Any) -> None:
        reading, writing = os.pipe()
        weakref.finalize(self, os.close, writing)
        with _with_supervisor(reading) as ends:
            super().__init__(command, pass_fds=(*pass_fds, *ends), **options)
            kill_at_hangup(ends, self.pid)


@contextlib.contextmanager
def _with_supervisor(reading: int) -> Iterator[list[int]]:
    """Yield the reading end of a pipe and a new one of the supervisor's pipe, if there is one; close both afterwards.

    The end is opened anew, because the kernel signals one process for each opening of a pipe.
    """
    ends = [reading]
    try:
        if program_pipe.reading is not None:
            # Without O_NONBLOCK, `open` waits for a writer if the supervisor has just ended.
            ends.append(os.open(f"/proc/self/fd/{program_pipe.reading}", os.O_RDONLY | os.O_NONBLOCK))
        yield ends
    finally:
        for end in ends:
            os.close(end)


def kill_at_hangup(ends: Sequence[int], process: int) -> None:
    """Let the kernel kill a process when the writing end of one of these pipes closes.

    The process must hold the reading ends `ends`.
    """
    for reading in ends:
        fcntl.fcntl(reading, fcntl.F_SETOWN, process)
        fcntl.fcntl(reading, _F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(reading, fcntl.F_SETFL, fcntl.fcntl(reading, fcntl.F_GETFL) | os.O_ASYNC)


@contextlib.contextmanager
def spawning_children() -> Iterator[None]:
    """In this context, the kernel also kills processes that `multiprocessing` spawns (for Dask) with this process.

    The process that removes shared memory of ended processes (`multiprocessing.resource_tracker`) is not killed; it
    ends by itself afterwards.
    """
    spawn = util.spawnv_passfds

    def spawn_child(path: bytes, arguments: Sequence[str], pass_fds: Sequence[int]) -> int:
        if _SPAWNED not in arguments:
            return spawn(path, arguments, pass_fds)
        reading, _writing = os.pipe()  # the kernel closes `_writing` when this process ends
        with _with_supervisor(reading) as ends:
            process = spawn(path, arguments, [*pass_fds, *ends])
            kill_at_hangup(ends, process)
        return process

    util.spawnv_passfds = spawn_child
    try:
        yield
    finally:
        util.spawnv_passfds = spawn


class WorkerProcess:
    """A function call in a separate process; the process ends when this object is deleted, or when this program ends.

    The process ignores Ctrl-C from its start, through an inherited signal mask.

    Args:
        function: function at the top level of a module of twin. Its first argument is the child's end of the pipe, then
            `arguments` follow. Function and arguments are pickled.
        arguments: arguments of the function.

    Attributes:
        line: the parent's end of the pipe: `send`, `recv`, `poll`. The pipe closes when the process ends.
    """

    def __init__(self, function: Callable[..., None], *arguments: object) -> None:
        self.line, child_end = Pipe()
        with child_end:
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                command = isolated(_SERVE, child_end.fileno())
                self._process = Child(command, (child_end.fileno(),), stdin=subprocess.DEVNULL)
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        self._kill = weakref.finalize(self, _kill_and_wait, self._process)
        with contextlib.suppress(OSError):  # the process has already ended: `line` reports it
            self.line.send((function.__module__, function.__qualname__, arguments))

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._process.poll() is None

    @property
    def end_text(self) -> str:
        """Text that says how the process ended; call this only after `line` has closed."""
        status = self._process.wait()
        how = f"with exit code {status}" if status >= 0 else f"by {signal.Signals(-status).name}"
        return f"the worker process ended {how} and gave no result; its last words are above"

    def close(self) -> None:
        """Kill the process, without any clean-up by the process; `line` stays open."""
        self._kill()


def _kill_and_wait(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and wait for its end."""
    process.kill()
    process.wait()


def serve() -> None:
    """In the child process: receive the function call from the parent process, and run it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    name_exits(lambda text: os.write(2, f"twin: {text}\n".encode()))
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with Connection(int(sys.argv[1])) as line, contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        module, name, arguments = line.recv()
        getattr(importlib.import_module(module), name)(line, *arguments)
