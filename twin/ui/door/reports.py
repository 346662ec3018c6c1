"""Report problems of a connection once while they last, so that many faulty messages do not fill the log."""

from __future__ import annotations

import math
from collections.abc import Callable


class Reports:
    """Reports a problem only if the last problem of the same kind is more than `quiet` s ago.

    Attributes:
        quiet: time in s; see above.
        tell: function that receives the message.
    """

    def __init__(self, quiet: float) -> None:
        """Start without earlier problems."""
        self.quiet = quiet
        self.tell: Callable[[str], object] = lambda text: None
        self._last: dict[str, float] = {}

    def report(self, kind: str, t: float, text: str) -> None:
        """Store the time t in s of a problem of a kind, and report the problem if it is new."""
        if t - self._last.get(kind, -math.inf) > self.quiet:
            self.tell(text)
        self._last[kind] = t
