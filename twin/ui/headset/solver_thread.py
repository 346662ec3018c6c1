"""A thread for solvers, so that the event loop never waits for a solver."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import TypeVar

Result = TypeVar("Result")


class SolverThread:
    """A worker thread with a queue of jobs; a new job replaces a waiting job of the same kind, to keep delays short.

    All methods must be called in the event loop. After the end of a job, the event loop calls the function `done` of
    this job with the job's result.
    """

    def __init__(self, broken: Callable[[Exception], object]) -> None:
        """Start the thread; `broken` is called in the event loop with an unexpected exception of a job."""
        self._job_failed = broken
        # A job returns the function that the event loop calls then.
        self._jobs: dict[str, Callable[[], Callable[[], object]]] = {}
        self._condition = threading.Condition()
        self._ended = False
        self._loop = asyncio.get_running_loop()
        self._thread = threading.Thread(target=self._run, daemon=True, name="solver")
        self._thread.start()

    def ask(self, kind: str, job: Callable[[], Result], done: Callable[[Result], object]) -> None:
        """Queue a job, and remove a waiting job of the same kind; `done` is called with the result of the job."""

        def solve() -> Callable[[], object]:
            return partial(done, job())

        with self._condition:
            self._jobs.pop(kind, None)
            self._jobs[kind] = solve
            self._condition.notify()

    def drop(self, *kinds: str) -> None:
        """Remove waiting jobs of these kinds."""
        with self._condition:
            for kind in kinds:
                self._jobs.pop(kind, None)

    def waits(self, kind: str) -> bool:
        """Return whether a job of this kind is waiting."""
        with self._condition:
            return kind in self._jobs

    def close(self, patience: float = 0.2) -> None:
        """End the thread; wait at most `patience` s for the running job."""
        with self._condition:
            self._jobs.clear()
            self._ended = True
            self._condition.notify()
        self._thread.join(patience)

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._jobs or self._ended)
                if self._ended:
                    return
                oldest_kind = next(iter(self._jobs))
                solve = self._jobs.pop(oldest_kind)
            try:
                report = solve()
            except Exception as error:  # a failing job must not end the thread
                logging.getLogger(__name__).exception("a job failed")
                report = partial(self._job_failed, error)
            with self._condition:
                if self._ended:
                    return
            try:
                self._loop.call_soon_threadsafe(report)
            except RuntimeError:  # the event loop has been closed
                return
