"""Delay Ctrl-C until imports and calls of CasADi have ended.

During an import, native libraries crash at Ctrl-C, or ignore it. CasADi discards exceptions of the Python functions
that it calls to convert arguments; an exception raised there by Ctrl-C would be lost.
"""

from __future__ import annotations

import _thread
import contextlib
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

_UNSAFE = ("<frozen importlib._bootstrap>", str(Path("casadi", "casadi.py")))
"""Endings of file names; functions in these files must not be interrupted."""

_AGAIN = 0.05
"""Time in s between two checks whether such a function is still running."""


@contextlib.contextmanager
def after_imports() -> Iterator[None]:
    """In this context, a Ctrl-C raises KeyboardInterrupt only when no import and no call of CasADi is in progress."""
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    at = frame
    while at is not None:
        if at.f_code.co_filename.endswith(_UNSAFE):
            later = threading.Timer(_AGAIN, _thread.interrupt_main)
            later.daemon = True
            later.start()
            return
        at = at.f_back
    signal.default_int_handler(number, frame)
