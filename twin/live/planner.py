"""Preparing a protocol in a process of its own, which ends with its answer or with the viewer."""

from __future__ import annotations

import os
import signal
import threading
from multiprocessing import get_context
from multiprocessing.connection import Connection

from twin.live.timeline import Playback, prepare


class Planner:
    """One protocol that is being prepared. `answer` is a playback, or what went wrong, once `done`."""

    def __init__(self, robot: str, protocol: str | None) -> None:
        spawn = get_context("spawn")
        self._results, to_us = spawn.Pipe(duplex=False)
        self._process = spawn.Process(target=_work, args=(to_us, robot, protocol), daemon=True, name="planner")
        # Ctrl-C is for the viewer: the process inherits the mask, since it could be hit before it asks for that itself.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        to_us.close()
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
        self._process.kill()  # it holds nothing that would need to be put away
        self._process.join()
        self._reader.join()
        self._results.close()

    def _read(self) -> None:
        try:
            self.answer = self._results.recv()
        except (EOFError, OSError):
            self.answer = "the process that plans has ended"


def _work(results: Connection, robot: str, protocol: str | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(5)
    try:
        answer: Playback | str = prepare(robot, protocol)
    except Exception as error:  # whatever it is, the viewer lives on and shows it
        answer = str(error) or type(error).__name__
    results.send(answer)
