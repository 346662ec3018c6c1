"""Measures of the forces on the hands in a session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.world.signal_kinds import HAND_FORCE, HAPTICS_ON
from twin.simulation.world.signals import columns

_SWITCH = HAPTICS_ON.name


@dataclass(frozen=True)
class ForceMeasures:
    """Forces in a session, measured in every tick.

    Attributes:
        on: fraction of the session in which the forces were switched on.
        felt: {hand: time in s with a force on it}.
        largest: {hand: largest force on it in N}.
    """

    on: float
    felt: Mapping[str, float]
    largest: Mapping[str, float]


class ForceMeter:
    """Measures the forces on the hands in every tick: the pulse of a grasp lasts 3 ms, less than the kept samples."""

    def __init__(self, sizes: Mapping[str, int], dt: float, hands: Sequence[str]) -> None:
        """Begin with no tick; `sizes`: {signal: number of values} of a World; `dt`: duration of a tick in s."""
        self._dt = dt
        self._columns = columns(sizes)
        self._hands = hands
        self._has_forces = _SWITCH in sizes
        self._ticks = 0
        self._on = 0
        self._felt = dict.fromkeys(hands, 0)
        self._largest = dict.fromkeys(hands, 0.0)

    def add(self, rows: Array) -> None:
        """Add rows (k, m) of all signals, one per tick."""
        if not self._has_forces or not len(rows):
            return
        self._ticks += len(rows)
        # signals are numbers: a flag is 0 or 1
        self._on += int(np.count_nonzero(rows[:, self._columns[_SWITCH]] > 0.5))
        for hand in self._hands:
            forces = np.linalg.norm(rows[:, self._columns[HAND_FORCE.of(hand)]], axis=1)
            self._felt[hand] += int(np.count_nonzero(forces))
            self._largest[hand] = max(self._largest[hand], float(forces.max()))

    def measures(self) -> ForceMeasures | None:
        """Return the measures of the ticks so far; None: there was no tick, or the World has no forces."""
        if self._ticks == 0:
            return None
        felt = {}
        for hand, ticks in self._felt.items():
            felt[hand] = ticks * self._dt
        return ForceMeasures(self._on / self._ticks, felt, dict(self._largest))
