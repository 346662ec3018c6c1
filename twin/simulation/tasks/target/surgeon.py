"""A simulated surgeon, with a random seed, who touches the targets of a task with both hands at once.

The grippers open on the way and close at the target. The motion of the hands is in `devices.surgeon_hands`.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands
from twin.simulation.world.signal_kinds import SURGEON_TARGET

_STALLED = 12
"""Number of strokes without progress after which the surgeon gives up a target."""


class ScriptedSurgeon(SurgeonHands):
    """Writes `<hand>.pose` (16,) with tremor, `<hand>.grip`, the pedals, and `surgeon.target`.

    `surgeon.target` is the index of the target, -1 at the start. The surgeon sees the tips (from `<robot>.q`) in the
    picture (`<camera>.view`) only between two strokes (single hand motions). The device ends after the last target.

    Attributes:
        targets: (name, points) of each target; `points` is {hand: position (3,) for its tip in m in the World}.
        tolerance: largest distance in m of a tip from its point.
        hold: time in s for which the tips remain at a target.
        missed: names of the targets that the surgeon gave up.
    """

    def __init__(
        self,
        seat: Seat,
        targets: Sequence[tuple[str, Mapping[str, Array]]],
        tolerance: float,
        hold: float,
        habits: Habits | None = None,
    ) -> None:
        """Connect the surgeon to a console; for `targets`, `tolerance` and `hold`, see the class.

        Raises:
            WorldError: a target is for another hand.
        """
        arms = seat.arms
        for name, points in targets:
            if not points or not set(points) <= set(arms):
                named_hands = ", ".join(points) or "no hand"
                raise WorldError(f"target '{name}' is for {named_hands}, not for {', '.join(arms)}")
        self.targets = tuple(targets)
        self.tolerance = tolerance
        self.hold = hold
        self._target = -1
        super().__init__(seat, habits or Habits())

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        values = super()._output_signals(k)
        values[SURGEON_TARGET.name] = float(self._target)
        return values

    def _missing(self, points: Mapping[str, Array]) -> dict[str, Array]:
        """Return the vector (3,) in m from the tip of each hand to its point, in the frame of the picture."""
        tips = {}
        for hand in points:
            T_world_tip = self._tool(hand) @ self.arms[hand].T_tool_tip
            tips[hand] = T_world_tip[:3, 3]
        points_seen = self._in_picture(points)
        tips_seen = self._in_picture(tips)
        missing = {}
        for hand in points:
            missing[hand] = points_seen[hand] - tips_seen[hand]
        return missing

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        for i, (name, points) in enumerate(self.targets):
            self._target = i
            yield from self._look(points)
            yield from self._turn_grip(dict.fromkeys(self.arms, self.habits.open))
            reached = yield from self._touch(points)
            if not reached:
                self.missed.append(name)
                continue
            yield from self._turn_grip(dict.fromkeys(self.arms, 0.0))
            yield from self._rest(self.hold)
        yield from self._rest(0.2)

    def _touch(self, points: Mapping[str, Array]) -> Generator[None, None, bool]:
        """Move the tips to their points; return whether they have reached the points."""
        least = np.inf
        stalled = 0
        while stalled < _STALLED:
            missing = self._missing(points)
            distance = max(float(np.linalg.norm(vector)) for vector in missing.values())
            if distance < 0.5 * self.tolerance:  # the rest of the tolerance is for tremor
                return True
            if distance < 0.98 * least:  # less than this is tremor, not progress
                least = distance
                stalled = 0
            else:
                stalled += 1
            strokes = {}
            for hand, vector in missing.items():
                strokes[hand] = self._misjudged(vector) / self.scale
            yield from self._stroke(strokes, self.habits.hand.pause)
        return False
