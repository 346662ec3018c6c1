"""The report on the newest attempt at a task, made in another process while the World goes on."""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import TwinError
from twin.core.jobs import Call
from twin.ui.session.exercise import MakeReport

_NICE_INCREMENT = 10
"""Increase of the nice value of the process that makes a report; its lower priority keeps the World in real time."""


class AttemptReport:
    """The newest report; a report that is not finished when the next one begins is given up."""

    def __init__(self, make: MakeReport | None) -> None:
        """Make reports by a function; None: make none."""
        self._make = make
        self._attempt = 0
        self._call: Call | None = None

    @property
    def wanted(self) -> bool:
        """Whether reports are made."""
        return self._make is not None

    def begin(self, attempt: int, session: Path, scene: Path) -> None:
        """Begin the report on an attempt from its session file; without the file, nothing happens."""
        if self._make is None or not session.is_file():
            return
        self.close()
        self._attempt = attempt
        self._call = Call(self._make, str(session), str(scene), nice=_NICE_INCREMENT)

    def newest(self) -> tuple[int, bytes | None, str] | None:
        """Return (number of the attempt, page as bytes, error); None if no report was begun.

        While the report is being made, the page is None and the error is "". After a failure, the page is None and the
        error is the reason.
        """
        if self._call is None:
            return None
        if not self._call.done:
            return self._attempt, None, ""
        try:
            return self._attempt, self._call.result(), ""
        except TwinError as error:
            return self._attempt, None, str(error)

    def close(self) -> None:
        """End the process that makes a report."""
        if self._call is not None:
            self._call.close()
