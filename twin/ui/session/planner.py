"""Preparing a protocol in a process of its own, which ends with its answer or with the viewer."""

from __future__ import annotations

import os
import threading
from multiprocessing.connection import Connection

from twin.core.processes import Apart
from twin.ui.session.timeline import Playback, prepare


class Planner:
    """One protocol that is being prepared. `answer` is a playback, or what went wrong, once `done`."""

    def __init__(self, robot: str, protocol: str | None) -> None:
        self._process = Apart(_work, robot, protocol)
        self.answer: Playback | str | None = None
        # A pipe holds less than a playback: it is read as it comes.
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def done(self) -> bool:
        """Whether there is an answer."""
        return self.answer is not None

    def close(self) -> None:
        """End the process."""
        self._process.close()
        self._reader.join()
        self._process.line.close()

    def _read(self) -> None:
        try:
            self.answer = self._process.line.recv()
        except (EOFError, OSError):
            self.answer = "the process that plans has ended"


def _work(results: Connection, robot: str, protocol: str | None) -> None:
    os.nice(5)
    try:
        answer: Playback | str = prepare(robot, protocol)
    except Exception as error:  # whatever it is, the viewer lives on and shows it
        answer = str(error) or type(error).__name__
    results.send(answer)
