"""Measures of the forces on the hands in a session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.simulation.world import Recording


@dataclass(frozen=True)
class ForceMeasures:
    """Forces in a session, measured at samples; a short pulse of a grasp may be missed between two samples.

    Attributes:
        on: fraction of the session in which the forces were switched on.
        felt: {hand: time in s with a force on it}.
        largest: {hand: largest force on it in N}.
    """

    on: float
    felt: Mapping[str, float]
    largest: Mapping[str, float]


def measure(kept: Recording, hands: Sequence[str]) -> ForceMeasures | None:
    """Return the measures of the forces on the given hands; None: the World of the session has no forces."""
    if "haptics.on" not in kept.sizes:
        return None
    felt: dict[str, float] = {}
    largest: dict[str, float] = {}
    for hand in hands:
        force = np.linalg.norm(kept[f"{hand}.force"], axis=1)
        felt[hand] = float(np.sum(force > 0) * kept.dt)
        largest[hand] = float(force.max())
    on = float(np.mean(kept["haptics.on"] > 0.5))
    return ForceMeasures(on, felt, largest)
