"""Processes that work on a list of jobs, each with a limit of time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from twin.core.jobs import Stream

_PAUSE = 0.005
"""Time in s between two looks at the processes."""

Job = TypeVar("Job")

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class NoAnswer:
    """Why a job has no answer; `late`: it took more time than a job may take."""

    reason: str
    late: bool = False


class Workers(Generic[Job, Answer]):
    """Processes that work on a list of jobs; a crash or a hang of one costs one job.

    Args:
        function: function at the top level of a module that yields the only answer of a job.
        count: number of processes.
        seconds: time in s for one job.
    """

    def __init__(self, function: Callable[[Job], Iterator[Answer]], count: int, seconds: float) -> None:
        self._function = function
        self._count = count
        self._seconds = seconds

    def answers(self, jobs: Sequence[Job]) -> Iterator[tuple[Job, Answer | NoAnswer]]:
        """Yield (job, its answer, or why there is none) as they end."""
        waiting = list(reversed(jobs))
        running: dict[Stream[Answer], tuple[Job, float]] = {}
        idle: list[Stream[Answer]] = []
        for _ in range(min(self._count, len(jobs))):
            idle.append(Stream(self._function, nice=0))
        streams = list(idle)
        try:
            while waiting or running:
                while waiting and idle:
                    job = waiting.pop()
                    stream = idle.pop()
                    stream.start(job)
                    running[stream] = (job, time.monotonic())
                ended = False
                for stream, (job, since) in list(running.items()):
                    answer = self._answer(stream, since)
                    if answer is not None:
                        del running[stream]
                        idle.append(stream)
                        ended = True
                        yield job, answer
                if not ended:
                    time.sleep(_PAUSE)
        finally:
            for stream in streams:
                stream.close()

    def _answer(self, stream: Stream[Answer], since: float) -> Answer | NoAnswer | None:
        """Return the answer of a process, or why there is none; None while it works."""
        pieces, end = stream.poll()
        if pieces:
            return pieces[0]
        if end is not None:
            return NoAnswer(end or "the process gave no answer")
        if time.monotonic() - since > self._seconds:
            stream.close()  # ends the process; the next job of this stream starts a new one
            return NoAnswer(f"it takes more than {self._seconds:g} s (--seconds)", late=True)
        return None
