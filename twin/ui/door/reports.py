"""Report each lasting problem of a connection only once, so that many faulty messages do not fill the log."""

from __future__ import annotations

import math
from collections.abc import Callable


class Reports:
    """Reporter of problems; it skips a problem that follows within `quiet` s after a problem of the same kind.

    Attributes:
        quiet: minimum time in s between a reported problem and the problem of the same kind before it.
        tell: function that receives the text of each reported problem.
    """

    def __init__(self, quiet: float) -> None:
        """Start without earlier problems."""
        self.quiet = quiet
        self.tell: Callable[[str], object] = lambda text: None
        self._last: dict[str, float] = {}

    def report(self, kind: str, t: float, text: str) -> None:
        """Report the problem `text` at time t in s, unless the last problem of this kind is at most `quiet` s ago."""
        if t - self._last.get(kind, -math.inf) > self.quiet:
            self.tell(text)
        self._last[kind] = t
