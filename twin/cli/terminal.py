"""Ask for confirmation on the terminal before a request from a page may write files."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable

from twin.core.errors import TwinError

PATIENCE = 60.0
"""Time in s without an answer after which the answer counts as no."""


class Terminal:
    """A terminal that asks one question at a time; `poll` reads the answer without waiting."""

    def __init__(self, stdin: int) -> None:
        self._stdin = stdin
        self._then: Callable[[bool], object] | None = None
        self._until = 0.0

    @classmethod
    def here(cls) -> Terminal | None:
        """Return the terminal of this program; None if the program has no interactive terminal."""
        try:
            if sys.stdin.isatty() and sys.stdout.isatty() and hasattr(os, "tcgetpgrp"):
                return cls(sys.stdin.fileno())
        except (AttributeError, OSError, ValueError):  # stdin is closed, or replaced by another stream
            pass
        return None

    def ask(self, question: str, then: Callable[[bool], object]) -> None:
        """Print a question; `then` is called with True if the answer is yes, else with False.

        Raises:
            TwinError: another question is unanswered, or the program is in the background.
        """
        if self._then is not None:
            raise TwinError("answer the open question in the terminal first")
        if not self._in_front():
            raise TwinError(
                "twin view runs in the background of its terminal: bring it to the foreground (fg) to answer"
            )
        import termios

        termios.tcflush(self._stdin, termios.TCIFLUSH)  # discard characters typed before the question
        self._then = then
        self._until = time.monotonic() + PATIENCE
        print(f"  {question} [y/N] ", end="", flush=True)

    def poll(self) -> None:
        """Read the answer, if there is one, and call the function `then` of the question."""
        if self._then is None:
            return
        if time.monotonic() > self._until:
            print("  no answer: nothing was written", flush=True)
            self._answer(False)
        elif self._in_front() and select.select([self._stdin], [], [], 0)[0]:
            self._answer(os.read(self._stdin, 1024).strip().lower() in (b"y", b"yes"))

    def _answer(self, yes: bool) -> None:
        then = self._then
        self._then = None  # before the call, which may ask the next question
        assert then is not None
        then(yes)

    def _in_front(self) -> bool:
        """Return whether this program is in the foreground; reading in the background would suspend the program."""
        return os.tcgetpgrp(self._stdin) == os.getpgrp()
