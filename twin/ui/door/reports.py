"""Report problems of a connection once while they last, so that many faulty messages do not fill the log."""

from __future__ import annotations

import math
from collections.abc import Callable


class Reports:
    """Passes on the first problem of a kind, and the next one only after a time without any.

    Attributes:
        tell: function that receives the message.
    """

    def __init__(self, quiet: float) -> None:
        """Begin without problems; `quiet` is the time in s without a problem of a kind before it is reported again."""
        self.quiet = quiet
        self.tell: Callable[[str], object] = lambda text: None
        self._last: dict[str, float] = {}

    def report(self, kind: str, t: float, text: str) -> None:
        """Note a problem of a kind at time t in s, and pass it on if it is new."""
        if t - self._last.get(kind, -math.inf) > self.quiet:
            self.tell(text)
        self._last[kind] = t
