"""A simulated surgeon, with a random seed, who aligns the endoscope with a rectangle by both hands.

The surgeon looks at the ends of the rectangle's upper side in the picture, presses the camera pedal, and moves both
hands. The hands move in the same direction to move the scene, and in opposite directions to roll the scene. After each
press, the surgeon looks again. The motion of the hands is in `devices.surgeon_hands`; all habits are ASSUMED.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.simulation.devices.hand import Hand
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands

_STROKES, _PRESSES = 25, 12
"""Maximum number of strokes per press of the pedal, and of presses; after these presses, the surgeon gives up."""

_TURNED, _ASIDE = 0.08 * DEG, 0.01
"""Largest errors that the surgeon accepts, ASSUMED: angle in rad between line and upper side; distance between
corresponding ends of line and upper side, divided by the length of the line."""

_ACUITY = 0.02 * DEG
"""Standard deviation in rad of the surgeon's error in seeing the angle; ASSUMED."""

HABITS = Habits(hand=Hand(misjudge=0.05))
"""Habits in moving the camera: a stroke of both hands has a larger error of judgement than a stroke of one hand."""


class CameraSurgeon(SurgeonHands):
    """Writes what `SurgeonHands` writes, and `surgeon.target`, which is always 0.

    Attributes:
        missed: name of the task if the surgeon gave it up.
    """

    def __init__(self, seat: Seat, task: str, upper: Array, line: float) -> None:
        """Connect the surgeon to a console.

        Args:
            seat: the console.
            task: name of the task.
            upper: (2, 3) left and right end of the rectangle's upper side in m in the World.
            line: length of the line divided by the height of the picture.
        """
        self.task, self.upper, self.line = task, np.array(upper, float), line
        super().__init__(seat, HABITS)

    def _said(self, k: int) -> dict[str, ArrayLike]:
        return super()._said(k) | {"surgeon.target": 0.0}

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        for _ in range(_PRESSES):
            self._camera = True
            yield from self._rest(0.1)
            yield from self._align()
            self._camera = False
            yield from self._rest(self.habits.settle)
            way, turn = self._seen()
            if self._near(way, turn):
                break
        else:
            self.missed.append(self.task)
        yield from self._rest(0.2)

    def _align(self) -> Generator[None, None, None]:
        """Move the camera by strokes of both hands until the upper side lies on the line."""
        right, left = self.arms
        for _ in range(_STROKES):
            way, turn = self._seen()
            if self._near(way, turn):
                return
            together = self._misjudged(way) / self.habits.drag
            against = float(self._misjudged(np.array([0.0, 0.0, turn]))[2])
            half = (self._p[right] - self._p[left]) / 2
            apart = spatial.rotation_z(against) @ half - half
            yield from self._stroke({right: together + apart, left: together - apart}, self.habits.settle)

    def _near(self, way: Array, turn: float) -> bool:
        """Return whether the surgeon accepts the remaining displacement `way` (3,) in m and rotation `turn` in rad."""
        length = float(np.linalg.norm(self.upper[1] - self.upper[0]))
        far = length / (2 * self._half * self.line)  # at this distance, the rectangle appears as long as the line
        return abs(turn) < _TURNED and float(np.abs(way / [length, length, far]).max()) < _ASIDE

    def _seen(self) -> tuple[Array, float]:
        """Return the displacement (3,) in m and the angle in rad by which the scene has to move in the picture."""
        ends = self._in_picture({"left": self.upper[0], "right": self.upper[1]})
        a, b = ends["left"], ends["right"]
        across = b[:2] / -b[2] - a[:2] / -a[2]  # the upper side as it appears in the picture
        turn = -float(np.arctan2(across[1], across[0])) + _ACUITY * float(self._rng.normal())
        longer = float(np.linalg.norm(across)) / (2 * self._half * self.line)
        middle = (a[:2] / -a[2] + b[:2] / -b[2]) / 2
        depth = -(a[2] + b[2]) / 2
        return np.array([*(-middle * depth), depth * (1 - longer)]), turn
