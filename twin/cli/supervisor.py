"""Run a command in a child process, so that a program that ends early never counts as a passed check.

The equations of a robot are Python code of their author. `os._exit(0)`, `os.execv` or an exit handler in them would end
the program with exit code 0 and without a verdict. Therefore the command runs in a child process, which reports its
exit code through a pipe after it has printed its result. Without this report, the exit code is 2. A signal from
elsewhere ends both processes, as usual; one that the command sends to its supervisor ends only the command.
"""

from __future__ import annotations

import os
import signal
import sys
import time

from twin.core import program_pipe

TYPE_CHECKING = False  # as in `typing`, whose import takes a while
if TYPE_CHECKING:
    from collections.abc import Callable

_FORWARDED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that another process sends to this program; the command in the child process receives them."""

_FROM_TERMINAL = 0x80
"""`si_code` of a signal that the kernel sent (SI_KERNEL). A terminal sends Ctrl-C to the child process as well."""

_GROUP_REACHED = 0.005
"""Time in s after which a signal that was sent to a process group has reached all its processes."""

_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux: the kernel signals the child when its parent ends."""

_CODE = "exit code "
"""Beginning of the line of a report that states the exit code; other lines state what ended the process, and where."""

_LONGEST = 4096
"""Maximum number of bytes of a report; a pipe transfers them in one piece."""


def supervised(command: Callable[[], int]) -> int:
    """Run a command in a child process and return its exit code; 2 if the child ends without reporting one."""
    reading, writing = os.pipe()
    running, end_of_run = os.pipe()  # nothing is written: the writing end closes when this process ends
    interrupts = os.eventfd(0)
    parent = os.getpid()
    # blocked before the fork: a signal in between would end this process without its child
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {*_FORWARDED, signal.SIGCHLD})
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.close(end_of_run)
        program_pipe.reading = running
        program_pipe.interrupts = interrupts
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        return _child(command, writing, parent)
    os.close(writing)
    os.close(running)
    status, sent = _ended(child, end_of_run, interrupts)
    os.close(interrupts)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    os.set_blocking(reading, False)
    try:
        report = os.read(reading, _LONGEST).decode(errors="replace")
    except BlockingIOError:  # a grandchild holds the pipe open, and nothing was reported
        report = ""
    lines = report.splitlines()
    for line in lines:
        code = line.removeprefix(_CODE)
        if code != line and code.isdecimal():
            # what ends the program after its result, an exit handler, does not change the exit code
            return int(code)
    killed = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    if killed in sent:  # end by the same signal as the child, so that the sender sees it
        signal.signal(killed, signal.SIG_DFL)
        os.kill(parent, killed)
    return _unfinished(status, lines[-1] if lines else "")


def _child(command: Callable[[], int], writing: int, parent: int) -> int:
    """In the child process: run the command, report its exit code, and return it."""
    import faulthandler

    from twin.core.program_end import name_exits

    _end_with(parent)
    faulthandler.enable()  # a crash of a native library prints the Python line that called it

    def report(text: str) -> None:
        one_line = " ".join(text.splitlines())  # a file name may contain a line that looks like an exit code
        line = f"{one_line}\n".encode()
        os.write(writing, line[-_LONGEST:])

    name_exits(report)
    try:
        code = command()
    except SystemExit as end:  # of argparse, after --help and --version; one raised by a command is an error there
        code = int(end.code or 0)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):  # code has closed the output: nobody has seen a verdict
        code = 2
    os.write(writing, f"{_CODE}{code}\n".encode())
    return code


def _end_with(parent: int) -> None:
    """Let the kernel kill this process when its parent ends."""
    import ctypes

    ctypes.CDLL(None, use_errno=True).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:  # the parent ended before
        os.kill(os.getpid(), signal.SIGKILL)


class _Bystander:
    """A process of this process group that blocks all forwarded signals; those it received tell which went to all.

    A signal that another process sends to the whole group, as `timeout` does, has reached the child already. Forwarded
    once more, it would be a second Ctrl-C, which interrupts the clean-up after the first.
    """

    def __init__(self, end_of_run: int) -> None:
        parent = os.getpid()
        self.process = os.fork()
        if self.process == 0:
            os.close(end_of_run)
            _end_with(parent)
            while True:
                signal.pause()

    def received(self, number: int) -> bool:
        """Return whether the process received this signal."""
        from pathlib import Path

        time.sleep(_GROUP_REACHED)
        pending = 0
        for line in Path(f"/proc/{self.process}/status").read_text(encoding="ascii").splitlines():
            if line.startswith("ShdPnd:"):
                pending = int(line.split()[1], 16)
        return bool(pending >> (number - 1) & 1)

    def end(self) -> None:
        """End the process."""
        os.kill(self.process, signal.SIGKILL)
        os.waitpid(self.process, 0)


def _ended(child: int, end_of_run: int, interrupts: int) -> tuple[int, set[int]]:
    """Wait for the end of the child; return its status and the signals that it received from elsewhere.

    Only this process may have the writing end `end_of_run` of the pipe. The eventfd `interrupts` counts the interrupts
    from elsewhere.
    """
    bystander = _Bystander(end_of_run)
    sent: set[int] = set()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            bystander.end()
            return status, sent
        received = signal.sigwaitinfo({*_FORWARDED, signal.SIGCHLD})
        if received.si_signo == signal.SIGCHLD:
            continue
        if not _descends(received.si_pid, child):
            sent.add(received.si_signo)
            if received.si_signo == signal.SIGINT:
                os.eventfd_write(interrupts, 1)
        if received.si_code == _FROM_TERMINAL:
            continue
        if bystander.received(received.si_signo):
            bystander.end()  # a blocked signal stays with its process
            bystander = _Bystander(end_of_run)
            continue
        os.kill(child, received.si_signo)


def _descends(process: int, ancestor: int) -> bool:
    """Return whether a process is `ancestor` or descends from it; False of a process that no longer exists."""
    from pathlib import Path

    while process > 1:
        if process == ancestor:
            return True
        try:
            status = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        except OSError:
            return False
        after_name = status.rpartition(")")[2].split()
        process = int(after_name[1])
    return False


def _unfinished(status: int, place: str) -> int:
    """Print why there is no verdict, and return exit code 2."""
    if os.WIFSIGNALED(status):
        how = f"was ended by {signal.Signals(os.WTERMSIG(status)).name}"
    else:
        how = f"ended with exit code {os.WEXITSTATUS(status)}"
    where = f" ({place})" if place else ""
    from twin.cli.command_line import failed

    return failed(
        "EndedError",
        f"the program {how}{where} before it printed a verdict, so nothing was checked. Look for what ends the process "
        "in the robot's formula.py (os._exit, os.exec, os.kill, exit handlers, ctypes), or for a lack of memory.",
        "--json" in sys.argv,
    )
