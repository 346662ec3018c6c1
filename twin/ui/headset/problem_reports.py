"""Report each lasting problem of a connection only once, so that many faulty messages do not fill the log."""

from __future__ import annotations

import math
from collections.abc import Callable


class ProblemReports:
    """Reporter of problems; a problem is not reported if a problem of the same kind occurred in the last `quiet` s.

    Attributes:
        quiet: time in s after a problem during which further problems of the same kind are not reported.
        tell: function that receives the text of each reported problem.
    """

    def __init__(self, quiet: float) -> None:
        """Start without earlier problems."""
        self.quiet = quiet
        self.tell: Callable[[str], object] = lambda text: None
        self._last_times: dict[str, float] = {}

    def report(self, kind: str, t: float, text: str) -> None:
        """Report the problem `text` at time t in s, unless the last problem of this kind is at most `quiet` s ago."""
        if t - self._last_times.get(kind, -math.inf) > self.quiet:
            self.tell(text)
        self._last_times[kind] = t
