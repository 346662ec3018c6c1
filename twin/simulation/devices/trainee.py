"""A simulated trainee at a console with machines: teleoperates, rehearses a motion, and replays it on the machines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.controllers.trainer import MODE, Mode, Phase
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands

_STROKE = 0.045
"""Length in m of a stroke of a hand."""

_WAIT, _REST = 150.0, 0.6
"""Longest time in s that the trainee waits for a replay; pause in s between two steps of the exercise."""


class Trainee(SurgeonHands):
    """Makes the same strokes with both hands, and also writes `pedals.training`.

    The trainee moves the tips along closed triangles by teleoperation. Then the trainee rehearses a motion with the
    model alone, has the record checked, and replays the record on the machines. The motion does not end at its start
    pose. Therefore a second replay, which the trainee requests next, must be refused. At the end, the trainee
    teleoperates again.

    Attributes:
        doing, done: current step of the exercise, and completed fraction of the exercise.
    """

    def __init__(self, seat: Seat, machines: Iterable[str], triangles: int) -> None:
        """Prepare the exercise.

        Args:
            seat: the console.
            machines: names of the machines.
            triangles: number of triangles by teleoperation.
        """
        self._phases, self._triangles, self._mode = [f"{n}.phase" for n in machines], triangles, Mode.TELEOPERATE
        self.doing, self.done = "teleoperate", 0.0
        super().__init__(seat, Habits())

    def _said(self, k: int) -> dict[str, ArrayLike]:
        return super()._said(k) | {MODE: float(self._mode)}

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.5)
        yield from self._show()
        for k in range(self._triangles):
            self.done = 0.6 * k / self._triangles
            yield from self._move_back()
            a, b = self._ways()
            for way in (a, b, -(a + b)):
                yield from self._both(way)
        yield from self._move_back()
        yield from self._ask(Mode.REHEARSE)
        for way in self._ways():
            yield from self._both(way)
        yield from self._ask(Mode.JUDGE)
        for _ in range(2):
            yield from self._ask(Mode.REPLAY)
            yield from self._until(Phase.DONE, Phase.STOPPED)
            yield from self._ask(Mode.TELEOPERATE)

    def _ways(self) -> tuple[Array, Array]:
        """Return two displacements (3,) of a hand in m, at a large angle to each other."""
        way = self._rng.normal(size=3)
        way /= np.linalg.norm(way)
        aside = np.cross(way, self._rng.normal(size=3))
        return _STROKE * way, _STROKE * aside / np.linalg.norm(aside)

    def _both(self, way: Array) -> Iterator[None]:
        ways: Mapping[str, Array] = dict.fromkeys(self.arms, way)
        yield from self._stroke(ways, _REST)

    def _ask(self, mode: Mode) -> Iterator[None]:
        self._mode, self.doing = mode, mode.name.lower()
        self.done = max(self.done, {Mode.REHEARSE: 0.6, Mode.JUDGE: 0.75, Mode.REPLAY: 0.8}.get(mode, 0.0))
        yield from self._rest(_REST)

    def _until(self, *phases: Phase) -> Iterator[None]:
        for _ in range(round(_WAIT / self.dt)):
            if all(self._signals[name][0] in phases for name in self._phases):
                return
            yield
