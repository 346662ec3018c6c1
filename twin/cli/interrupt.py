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
        if calling_frame.f_code.co_filename.endswith(_UNSAFE):
            # the handler cannot wait, because it runs in the thread of the unsafe function: it is called again
            later = threading.Timer(_AGAIN, _thread.interrupt_main)
            later.daemon = True
            later.start()
            return
        calling_frame = calling_frame.f_back
    signal.default_int_handler(number, frame)
