"""Base frame, tool frame and limits of a linkage and of a description whose mimic joints replace its loops."""

from __future__ import annotations

import numpy as np

from twin.comparison.fit_problem import ANGLE_PER_LENGTH
from twin.comparison.items import ComparedItem, moved_frame, placed_by
from twin.comparison.mimic import MimicError
from twin.comparison.properties import KINDS, Properties, PropertyRow, is_same_limit
from twin.comparison.side import UNLIMITED
from twin.core.quantity import moved

_Limits = tuple[float, float] | None
"""Range of a joint in m or rad; None if a side states nothing, as in `side.Axis`."""


def mimic_conventions(mimic: MimicError, tolerance: float) -> tuple[ComparedItem, ...]:
    """Return the frames that differ by more than a distance in m, or its angle."""
    text = f"the base frame of {mimic.linkage} is moved by {placed_by(mimic.base)} in that of {mimic.coupled}"
    candidates = [moved_frame("base frame", text, mimic.base)]
    if mimic.tool is not None:
        text = f"the tool frame of {mimic.coupled} is moved by {placed_by(mimic.tool)} in that of {mimic.linkage}"
        candidates.append(moved_frame("tool frame", text, mimic.tool))
    items = []
    for item in candidates:
        if item.shift > tolerance or item.turn > ANGLE_PER_LENGTH * tolerance:
            items.append(item)
    return tuple(items)


def mimic_properties(mimic: MimicError, linkage_first: bool) -> Properties:
    """Return the comparison of the limits of the driven joint, the only property that is compared."""
    first, second = mimic.limits
    if not linkage_first:
        first, second = second, first
    compared = dict.fromkeys(KINDS, 0)
    texts = (_interval(first), _interval(second))
    if first is None or second is None:
        # a file that states no limits, and one that states that there are none, say the same
        if (first or UNLIMITED) == (second or UNLIMITED):
            return Properties((), compared)
        return Properties((PropertyRow("limits", mimic.leader, *texts, False),), compared)
    compared["limits"] = 1
    if is_same_limit(first[0], second[0]) and is_same_limit(first[1], second[1]):
        return Properties((), compared)
    return Properties((PropertyRow("limits", mimic.leader, *texts, True),), compared)


def _interval(limits: _Limits) -> str:
    """Return the range of a hinge as text."""
    if limits is None:
        return "-"
    if not np.isfinite(limits).any():
        return "no limits"
    return f"{moved(limits[0], True)} .. {moved(limits[1], True)}"
