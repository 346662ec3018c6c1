"""What is proved about: the timed path of a protocol, as planning made it.

Each phase is a series q(s), s from 0 to 1, of all driven joints, and a rate ds/dt whose square is linear in s between
grid points. The samples of a plan at 1 kHz are values of these functions; a proof is about the functions themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.core.errors import ProtocolError
from twin.core.spatial import Array

_NEAREST = 1e-12
"""Smallest distance in s of two grid points."""


@dataclass(frozen=True)
class TimedPhase:
    """One phase of a protocol.

    Attributes:
        name: name in the protocol.
        coefficients: (degree + 1, n) Chebyshev coefficients in 2 s - 1 of the driven joints, in m or rad.
        grid: (g,) grid points of s from 0 to 1.
        rates: (g,) ds/dt at the grid points; its square is linear in s between them.
        start, duration: in s.
        smoothing: length in s of a moving average of the motion over time, which keeps a jerk limit; 0 without one.
        rcm: (3,) registered RCM in m, in base; None if there is none.
        enforced: whether the shaft must pass through the RCM; otherwise its distance is only monitored.
        tip_speed, rotation_speed: limits of the moved frame in m/s and rad/s.
    """

    name: str
    coefficients: Array
    grid: Array
    rates: Array
    start: float
    duration: float
    smoothing: float
    rcm: Array | None
    enforced: bool
    tip_speed: float
    rotation_speed: float

    def times(self, s: Array) -> Array:
        """Return the times (k,) in s at path parameters s (k,), rounded; for texts and pictures."""
        squares = self.rates**2
        spans = 2 * np.diff(self.grid) / (self.rates[1:] + self.rates[:-1])
        ends = np.concatenate([[0.0], np.cumsum(spans)])
        segment = np.clip(np.searchsorted(self.grid, s, side="right") - 1, 0, len(spans) - 1)
        fraction = (s - self.grid[segment]) / (self.grid[segment + 1] - self.grid[segment])
        rate = np.sqrt(np.maximum(squares[segment] + fraction * (squares[segment + 1] - squares[segment]), 0.0))
        # At the start of a phase both rates are 0, and so is the way: the quotient must be the time 0.
        total = np.maximum(rate + self.rates[segment], 1e-300)
        times = self.start + ends[segment] + 2 * (s - self.grid[segment]) / total
        # A moving average delays the motion by half of its window.
        return times + self.smoothing / 2


class RailGap(NamedTuple):
    """Two driven joints whose carriages are on one rail.

    Attributes:
        first, second: their indices among the driven joints.
        smallest: smallest distance in m of their coordinates.
        name: name of the gap.
    """

    first: int
    second: int
    smallest: float
    name: str


@dataclass(frozen=True)
class TimedPath:
    """The phases of a protocol, one after the other.

    Attributes:
        protocol: its name.
        phases: the phases.
        T_tool_frame: (4, 4) pose of the moved frame in the tool frame.
        shaft_axis: (3,) direction of the shaft in the moved frame, a unit vector.
        rcm_tolerance: accepted distance in m of the shaft from the RCM.
        gaps: of driven joints on a common rail.
    """

    protocol: str
    phases: tuple[TimedPhase, ...]
    T_tool_frame: Array
    shaft_axis: Array
    rcm_tolerance: float
    gaps: Sequence[RailGap] = ()

    def require_finite(self) -> None:
        """Raise `ProtocolError` if a number of the path is not finite."""
        for phase in self.phases:
            for what, numbers in (
                ("the path", phase.coefficients),
                ("the grid", phase.grid),
                ("the rates", phase.rates),
            ):
                if not np.isfinite(numbers).all():
                    raise ProtocolError(
                        f"{self.protocol}: phase '{phase.name}': {what} has a value that is not a finite number; "
                        "plan the protocol again"
                    )
            if len(phase.grid) < 2 or not (np.diff(phase.grid) > _NEAREST).all():
                raise ProtocolError(
                    f"{self.protocol}: phase '{phase.name}': the grid points do not increase by {_NEAREST:g} or more"
                )
        if not (np.isfinite(self.T_tool_frame).all() and np.isfinite(self.shaft_axis).all()):
            raise ProtocolError(f"{self.protocol}: the moved frame or its shaft axis is not a finite number")
