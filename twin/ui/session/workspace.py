"""The reachable set of a robot in its present orientation, found in a process of its own.

A thread would share the interpreter with the hand that drags; a process of low priority leaves it alone.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

import numpy as np

from twin.core.errors import KinematicsError, TwinError
from twin.core.processes import Apart
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.kinematics import Kinematics

CHUNK = 20_000
"""Poses between two looks at whether to stop: less than half a second of work."""


@dataclass(frozen=True, eq=False)
class Job:
    """What to evaluate.

    Attributes:
        robot, variants, parameters: as `twin.load` takes them.
        limits: (n, 2) of the active joints, in rad or m; infinite where there is none.
        T_base_tool: (4, 4), its orientation is kept, its position is the centre of the box.
        reach: half the edge of the box, in m.
        count: poses in all.
    """

    robot: str
    variants: dict[str, str] | str | None
    parameters: dict[str, float]
    limits: Array
    T_base_tool: Array
    reach: float
    count: int = 1_000_000


@dataclass(frozen=True, eq=False)
class Chunk:
    """What was found since the last time.

    Attributes:
        points: (m, 3) float32, reachable positions of the tool in base, in m.
        condition: (m,) float32, condition numbers there, infinite at a singularity.
        evaluated, count: poses evaluated so far, reachable or not, and poses in all; 0 with an error.
        error: why the job ended early or found nothing; empty if all is well.
    """

    points: np.ndarray
    condition: np.ndarray
    evaluated: int
    count: int
    error: str = ""


def poses(job: Job, first: int, last: int) -> Array:
    """Return poses (last - first, 4, 4) of a job in the order of evaluation, the present one first.

    Positions are an additive recurrence: any beginning of it is spread evenly over the box.
    """
    root = 1.2207440846057596  # of x^4 = x + 1: the most even in three dimensions
    i = np.arange(first, last)[:, None]
    Ts = np.tile(job.T_base_tool, (last - first, 1, 1))
    Ts[:, :3, 3] += job.reach * (2 * ((0.5 + i / root ** np.arange(1, 4)) % 1) - 1)
    return Ts


def evaluate(job: Job) -> Iterator[Chunk]:
    """Yield the reachable poses of a job, chunk by chunk.

    Reachable is where the closed inverse has a solution within the limits; as in `Kinematics.inverse`, other
    postures of a redundant arm are not looked for.

    Raises:
        TwinError: the robot is unknown or has no closed inverse, the job does not fit it, or nothing is reachable.
    """
    from twin.api import load

    kin = load(job.robot, variants=job.variants, parameters=job.parameters).kinematics()
    _check(kin, job)
    solved = reached = 0
    for first in range(0, job.count, CHUNK):
        last = min(first + CHUNK, job.count)
        Ts = poses(job, first, last)
        q = kin.inverse_many(Ts)
        good = ((q >= job.limits[:, 0]) & (q <= job.limits[:, 1])).all(axis=1)
        solved, reached = solved + int(np.isfinite(q[:, 0]).sum()), reached + int(good.sum())
        if last == job.count and not reached:
            why = "the joint limits allow none" if solved else "none is within reach"
            raise KinematicsError(f"{kin.formula.name}: of {job.count} positions with this orientation {why}.")
        condition = kin.condition_many(Ts[good], q[good])
        yield Chunk(Ts[good, :3, 3].astype(np.float32), condition.astype(np.float32), last, job.count)


def _check(kin: Kinematics, job: Job) -> None:
    name, n = kin.formula.name, len(kin.joints)
    if not kin.closed_inverse:
        raise KinematicsError(f"{name}: its equations have no closed inverse; solving pose by pose takes too long.")
    if np.shape(job.limits) != (n, 2) or job.count < 1:
        raise KinematicsError(f"{name}: limits {np.shape(job.limits)} must be ({n}, 2), count {job.count} at least 1.")
    if n < 6:
        held = np.isfinite(kin.inverse_many(poses(replace(job, reach=1e-2 * job.reach), 0, 1000))[:, 0])
        if held[0] and held.mean() < 0.01:  # a surface: its thickness is the tolerance of the equations
            raise KinematicsError(f"{name}: its {n} joints cannot move the tool every way and hold its orientation.")


class Cloud:
    """One job at a time, in a process that begins with the first and stays for the next.

    All methods return at once and may be called from any thread. `close` when done; without it the process ends
    with this one, however that ends.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: Apart | None = None
        self._number, self._running = 0, False

    def start(self, job: Job) -> None:
        """Begin a job; what runs is cancelled, and nothing more of it is polled."""
        with self._lock:
            if self._process is None or not self._process.alive:
                self._close()
                self._open()
            self._say(job)

    def poll(self) -> Chunk | None:
        """Return what is new of the present job, None if nothing is."""
        with self._lock:
            new: list[Chunk] = []
            with suppress(queue.Empty):
                while self._running:
                    number, chunk = self._inbox.get_nowait()
                    if number in (self._number, None):
                        new.append(chunk)
                    if number is None:
                        self._close()
            if not new:
                return None
            self._running = not new[-1].error and new[-1].evaluated < new[-1].count
            points, condition = (np.concatenate([getattr(c, n) for c in new]) for n in ("points", "condition"))
            return replace(new[-1], points=points, condition=condition)

    def cancel(self) -> None:
        """Stop what runs, at the latest after its present chunk; the process stays."""
        with self._lock:
            if self._process is not None:
                self._say(None)

    def close(self) -> None:
        """End the process; `start` would begin another."""
        with self._lock:
            self._close()

    def _say(self, job: Job | None) -> None:
        assert self._process is not None
        self._number += 1
        self._running = job is not None
        with suppress(OSError):  # the process has ended: poll tells
            self._process.line.send((self._number, job))

    def _open(self) -> None:
        self._process = Apart(_work)
        self._inbox: queue.SimpleQueue[tuple[int | None, Chunk]] = queue.SimpleQueue()
        # A pipe holds less than a chunk: read without a thread, poll would wait for a process of low priority.
        threading.Thread(target=_read, args=(self._process.line, self._inbox), daemon=True).start()

    def _close(self) -> None:
        self._running = False
        if self._process is None:
            return
        self._process.close()
        self._process = None


def _read(results: Connection, inbox: queue.SimpleQueue) -> None:
    with results, suppress(EOFError, OSError):
        while True:
            inbox.put(results.recv())
    inbox.put((None, _failed("The process that finds the reachable set has ended.")))


def _work(line: Connection) -> None:
    """Run jobs until the viewer's end of the line is closed, by whatever end of the viewer."""
    os.nice(10)
    while True:
        number, job = line.recv()
        if job is None or line.poll():
            continue
        for chunk in _told(job):
            line.send((number, chunk))
            if line.poll():
                break


def _told(job: Job) -> Iterator[Chunk]:
    """Yield the chunks of a job, and as the last one what went wrong."""
    try:
        yield from evaluate(job)
    except TwinError as error:
        yield _failed(str(error))
    except Exception as error:  # whatever it is, the viewer lives on
        yield _failed(f"{job.robot}: {type(error).__name__}: {error}")


def _failed(error: str) -> Chunk:
    return Chunk(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), 0, 0, error)
