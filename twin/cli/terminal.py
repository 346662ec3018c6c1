"""Questions that a page has to the person at the terminal: what it wants to write is written when he says so."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable

from twin.core.errors import TwinError

PATIENCE = 60.0
"""Seconds after which no answer is a no."""


class Terminal:
    """One question at a time; `poll` looks for its answer without waiting."""

    def __init__(self, stdin: int) -> None:
        self._stdin = stdin
        self._then: Callable[[bool], object] | None = None
        self._until = 0.0

    @classmethod
    def here(cls) -> Terminal | None:
        """Return the terminal that this program was started in, if somebody can answer there."""
        try:
            if sys.stdin.isatty() and sys.stdout.isatty() and hasattr(os, "tcgetpgrp"):
                return cls(sys.stdin.fileno())
        except (AttributeError, OSError, ValueError):  # closed, or in the place of one
            pass
        return None

    def ask(self, question: str, then: Callable[[bool], object]) -> None:
        """Print a question; `then` is called with whether the answer was yes.

        Raises:
            TwinError: another question waits, or the program is in the background.
        """
        if self._then is not None:
            raise TwinError("a question waits in the terminal: answer that first")
        if not self._in_front():
            raise TwinError("twin view is in the background of its terminal: bring it back there (fg) to be asked")
        import termios

        termios.tcflush(self._stdin, termios.TCIFLUSH)  # what was typed before is no answer
        self._then, self._until = then, time.monotonic() + PATIENCE
        print(f"  {question} [y/N] ", end="", flush=True)

    def poll(self) -> None:
        """Take the answer if there is one."""
        if self._then is None:
            return
        if time.monotonic() > self._until:
            print("  no answer: not written", flush=True)
            self._answer(False)
        elif self._in_front() and select.select([self._stdin], [], [], 0)[0]:
            self._answer(os.read(self._stdin, 1024).strip().lower() in (b"y", b"yes"))

    def _answer(self, yes: bool) -> None:
        then, self._then = self._then, None
        assert then is not None
        then(yes)

    def _in_front(self) -> bool:
        """Return whether what is typed comes to this program; to read it in the background would stop it."""
        return os.tcgetpgrp(self._stdin) == os.getpgrp()
