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
from twin.simulation.devices.hand import HandMotion
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands
from twin.simulation.world.signal_kinds import SURGEON_TARGET

_LARGEST_STROKES = 25
"""Maximum number of strokes per press of the pedal."""

_LARGEST_PRESSES = 12
"""Maximum number of presses of the pedal, after which the surgeon gives up."""

_ANGLE_TOLERANCE = 0.08 * DEG
"""Largest angle in rad between line and upper side that the surgeon accepts; ASSUMED."""

_OFFSET_TOLERANCE = 0.01
"""Largest distance between corresponding ends of line and upper side, divided by the length of the line, that the
surgeon accepts; ASSUMED."""

_ANGLE_NOISE = 0.02 * DEG
"""Standard deviation in rad of the surgeon's error in seeing the angle; ASSUMED."""

HABITS = Habits(hand=HandMotion(misjudge=0.05))
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
        self.task = task
        self.upper = np.array(upper, float)
        self.line = line
        super().__init__(seat, HABITS)

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        values = super()._output_signals(k)
        values[SURGEON_TARGET.name] = 0.0
        return values

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        for _ in range(_LARGEST_PRESSES):
            self._camera = True
            yield from self._rest(0.1)
            yield from self._align()
            self._camera = False
            yield from self._rest(self.habits.settle)
            displacement, angle = self._seen_error()
            if self._is_aligned(displacement, angle):
                break
        else:
            self.missed.append(self.task)
        yield from self._rest(0.2)

    def _align(self) -> Generator[None, None, None]:
        """Move the camera by strokes of both hands until the upper side lies on the line."""
        right, left = self.arms
        for _ in range(_LARGEST_STROKES):
            displacement, angle = self._seen_error()
            if self._is_aligned(displacement, angle):
                return
            common = self._misjudged(displacement) / self.habits.drag
            roll = float(self._misjudged(np.array([0.0, 0.0, angle]))[2])
            half_distance = (self._positions[right] - self._positions[left]) / 2
            opposite = spatial.rotation_z(roll) @ half_distance - half_distance
            strokes = {right: common + opposite, left: common - opposite}
            yield from self._stroke(strokes, self.habits.settle)

    def _is_aligned(self, displacement: Array, angle: float) -> bool:
        """Return whether the surgeon accepts the remaining displacement (3,) in m and the remaining angle in rad."""
        length = float(np.linalg.norm(self.upper[1] - self.upper[0]))
        depth = length / (2 * self._half_picture * self.line)  # here, the rectangle appears as long as the line
        relative = np.abs(displacement / [length, length, depth])
        return abs(angle) < _ANGLE_TOLERANCE and float(relative.max()) < _OFFSET_TOLERANCE

    def _seen_error(self) -> tuple[Array, float]:
        """Return the displacement (3,) in m and the angle in rad by which the scene has to move in the picture."""
        ends = self._in_picture({"left": self.upper[0], "right": self.upper[1]})
        left = ends["left"]
        right = ends["right"]
        left_seen = left[:2] / -left[2]  # the camera looks along -z
        right_seen = right[:2] / -right[2]
        across = right_seen - left_seen
        angle = -float(np.arctan2(across[1], across[0])) + _ANGLE_NOISE * float(self._rng.normal())
        ratio = float(np.linalg.norm(across)) / (2 * self._half_picture * self.line)
        middle = (left_seen + right_seen) / 2
        depth = -(left[2] + right[2]) / 2
        displacement = np.array([*(-middle * depth), depth * (1 - ratio)])
        return displacement, angle
