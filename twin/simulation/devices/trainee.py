"""A simulated trainee at a console with machines: teleoperates, rehearses a motion, and replays it on the machines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.controllers.trainer_states import MODE, TrainerMode, TrainerPhase
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands
from twin.simulation.world.signal_kinds import ROBOT_PHASE

_STROKE_LENGTH = 0.045
"""Length in m of a stroke of a hand."""

_LONGEST_WAIT = 150.0
"""Longest time in s that the trainee waits for a replay."""

_STEP_PAUSE = 0.6
"""Pause in s between two steps of the exercise."""

_DONE_AT_MODE = {TrainerMode.REHEARSE: 0.6, TrainerMode.JUDGE: 0.75, TrainerMode.REPLAY: 0.8}
"""Completed fraction of the exercise when the trainee asks for a mode."""


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
        self._phases = [ROBOT_PHASE.of(machine) for machine in machines]
        self._triangles = triangles
        self._mode = TrainerMode.TELEOPERATE
        self.doing = "teleoperate"
        self.done = 0.0
        super().__init__(seat, Habits())

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        values = super()._output_signals(k)
        values[MODE] = float(self._mode)
        return values

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.5)
        yield from self._show()
        for k in range(self._triangles):
            self.done = 0.6 * k / self._triangles
            yield from self._move_back()
            first, second = self._sides()
            yield from self._stroke_both(first)
            yield from self._stroke_both(second)
            yield from self._stroke_both(-(first + second))  # back to the first corner
        yield from self._move_back()
        yield from self._request(TrainerMode.REHEARSE)
        for side in self._sides():
            yield from self._stroke_both(side)
        yield from self._request(TrainerMode.JUDGE)
        for _ in range(2):
            yield from self._request(TrainerMode.REPLAY)
            yield from self._await_end_of_replay()
            yield from self._request(TrainerMode.TELEOPERATE)

    def _sides(self) -> tuple[Array, Array]:
        """Return two displacements (3,) of a hand in m, at a large angle to each other."""
        first = self._rng.normal(size=3)
        first /= np.linalg.norm(first)
        second = np.cross(first, self._rng.normal(size=3))
        return _STROKE_LENGTH * first, _STROKE_LENGTH * second / np.linalg.norm(second)

    def _stroke_both(self, displacement: Array) -> Iterator[None]:
        strokes: Mapping[str, Array] = dict.fromkeys(self.arms, displacement)
        yield from self._stroke(strokes, _STEP_PAUSE)

    def _request(self, mode: TrainerMode) -> Iterator[None]:
        self._mode = mode
        self.doing = mode.name.lower()
        self.done = max(self.done, _DONE_AT_MODE.get(mode, 0.0))
        yield from self._rest(_STEP_PAUSE)

    def _await_end_of_replay(self) -> Iterator[None]:
        for _ in range(round(_LONGEST_WAIT / self.dt)):
            if all(self._signals[name][0] in (TrainerPhase.DONE, TrainerPhase.STOPPED) for name in self._phases):
                return
            yield
