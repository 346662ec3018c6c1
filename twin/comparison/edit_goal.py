"""What an edit must achieve, and the steps of a search that reads a changed text again for each value.

Each number of the text that belongs to the joint or link in question is changed a little, and the text is read again:
this shows what the number does, whatever the format is. The text of an edit was therefore read, and it agrees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.comparison.side import RobotSide
from twin.core.spatial import Array

MAX_STEPS = 8
"""Maximum number of steps to the value."""

SMALLEST_SLOPE = 1e-9
"""Change of the residual per change of a number below which the number moves nothing."""

_RELATIVE_STEP = 1e-3
"""Relative change of a number that shows what it does; files in single precision round finer ones away."""

_MAX_REMAINING_SHARE = 0.5
"""Part of the difference that may remain after the first step: a number must be able to remove the other half."""

_FIRST_STEP_VALUE = 0.1
"""Value in the unit of the file below which the first step is that of this value: of zero, no part is a step."""

_LATER_STEP_VALUE = 1e-3
"""The same for the further steps, and where several numbers change together."""

_CONVERGED_SHARE = 0.01
"""Change of the residual, relative to the inaccuracy of the goal, after which the steps end."""

_ROUNDING_SHARE = 0.05
"""Largest change of the residual by rounding, relative to the inaccuracy of the goal."""


@dataclass(frozen=True)
class EditGoal:
    """What an edit must achieve.

    Attributes:
        residual: a function of a side that returns what differs; zero is agreement.
        agrees: a function of a side that returns whether the two sides agree there, and nowhere less than before.
        differing_frames: a function of a side that returns how many further frames differ; fewer make an edit likelier.
        inaccuracy: size of a residual that is only inaccuracy.
    """

    residual: Callable[[RobotSide], Array]
    agrees: Callable[[RobotSide], bool]
    differing_frames: Callable[[RobotSide], int]
    inaccuracy: float

    @property
    def rounding(self) -> float:
        """Largest change of the residual by rounding a value.

        Agreement after a change near the inaccuracy would be a coincidence: one more digit must not matter.
        """
        return _ROUNDING_SHARE * self.inaccuracy

    @property
    def converged_change(self) -> float:
        """Change of the residual by a step after which the steps end."""
        return _CONVERGED_SHARE * self.inaccuracy


def first_step(value: float) -> float:
    """Return the change of a stated value that shows what it does."""
    return _RELATIVE_STEP * max(abs(value), _FIRST_STEP_VALUE)


def later_step(value: float) -> float:
    """Return the change of a value near the goal, or among several, that shows what it does."""
    return _RELATIVE_STEP * max(abs(value), _LATER_STEP_VALUE)


def leaves_too_much(remaining: Array, before: Array) -> bool:
    """Return whether a step from the residual `before` leaves so much that the values cannot remove the difference."""
    return bool(np.linalg.norm(remaining) > _MAX_REMAINING_SHARE * np.linalg.norm(before))
