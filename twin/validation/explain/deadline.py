"""Time limit of a search."""

from __future__ import annotations

import time

_ELAPSED_PER_PROCESSOR_SECOND = 3.0
"""Elapsed time is limited to this multiple of the processor time, on a machine that is busy with other work."""


class LateError(Exception):
    """The time of a search is over."""


class Deadline:
    """Limit on the processor time of this thread, so that the result does not depend on the load of the machine."""

    def __init__(self, seconds: float = float("inf")) -> None:
        """Start the time; `seconds`: limit in s, infinite by default."""
        self._processor_time_end = time.thread_time() + seconds
        self._elapsed_time_end = time.monotonic() + _ELAPSED_PER_PROCESSOR_SECOND * seconds

    @property
    def left(self) -> float:
        """Remaining processor time in s; not negative."""
        elapsed = (self._elapsed_time_end - time.monotonic()) / _ELAPSED_PER_PROCESSOR_SECOND
        return max(0.0, min(self._processor_time_end - time.thread_time(), elapsed))

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return time.thread_time() > self._processor_time_end or time.monotonic() > self._elapsed_time_end

    def within(self, seconds: float) -> Deadline:
        """Return a deadline in `seconds`, or this one if it is earlier."""
        return Deadline(min(seconds, self.left))

    def check(self) -> None:
        """Raise `LateError` if the time is over."""
        if self.passed:
            raise LateError
