"""Warn about numbers of a protocol that are probably in a wrong unit: metres for millimetres, radians for degrees.

Such numbers are possible, so they cause warnings, not errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, warning
from twin.planning.protocol.phases.insertion import InsertionTable
from twin.planning.protocol.tables import ProtocolTable

_TIP_SPEEDS = (0.2, 2000.0)
"""Plausible range of the tip speed in mm/s."""

_ROTATION_SPEEDS = (1.0, 720.0)
"""Plausible range of the rotation speed in deg/s."""

_SPEED_RAMPS = (2e-3, 30.0)
"""Plausible range in s of the time from rest to full speed."""

_ACCELERATION_RAMPS = (2e-4, 30.0)
"""Plausible range in s of the time from zero to full acceleration."""

_WHOLE_DEGREE_TOLERANCE = 0.02
"""Distance in deg from a whole number up to which an angle is one: rounding of radians with four digits."""

_SMALLEST_TELLING_DEG = 0.9
"""Angles in deg below which rounding to a whole number says nothing."""

_LARGEST_RADIANS = 2 * np.pi + 1e-3
"""Largest angle that is written in radians: a full turn, rounded to three digits."""

_ROUNDING = 1e-6
"""Rounding of a number of steps of 0.05 deg."""

_SMALLEST_DEPTH = 0.5
"""Insertion depth in mm below which the number looks like metres."""

_NEAR_ORIGIN = 1.0
"""Distance in mm from the origin below which a position is probably in metres, if another one is far from it."""

_FAR_FROM_ORIGIN = 100.0
"""Distance in mm from the origin above which a position is far from it."""


def plausible(table: ProtocolTable, file: str) -> Iterator[Finding]:
    """Yield a warning for each number that is implausible in its unit but usual in another unit."""
    yield from _angles(table, file)
    yield from _positions(table, file)
    yield from _depths(table, file)
    for kind, limits in table.limits.items():
        tip = _MotionLimits(
            "tip", limits.tip_speed_mm_s, limits.tip_acceleration_mm_s2, limits.tip_jerk_mm_s3, _TIP_SPEEDS, "mm", "m/s"
        )
        yield from tip.warnings(f"limits.{kind}", file)
        rotation = _MotionLimits(
            "rotation",
            limits.rotation_speed_deg_s,
            limits.rotation_acceleration_deg_s2,
            limits.rotation_jerk_deg_s3,
            _ROTATION_SPEEDS,
            "deg",
            "rad/s",
        )
        yield from rotation.warnings(f"limits.{kind}", file)


def _angles(table: ProtocolTable, file: str) -> Iterator[Finding]:
    """Yield a warning for each waypoint whose angles look like radians."""
    for name, waypoint in table.waypoints.items():
        angles = waypoint.angles_deg
        if angles is not None and _are_radians(angles):
            first, second, third = angles
            written = f"{first:g}, {second:g}, {third:g}"
            first, second, third = np.rad2deg(angles)
            converted = f"{first:.4g}, {second:.4g}, {third:.4g}"
            text = f"waypoint '{name}': angles ({written}) deg look like radians: converted, they are ({converted}) deg"
            yield _warning(text, file, "degrees are expected; multiply by 180/pi")


def _positions(table: ProtocolTable, file: str) -> Iterator[Finding]:
    """Yield a warning for each waypoint whose position looks like metres."""
    distances = {}
    for name, waypoint in table.waypoints.items():
        if waypoint.position_mm is not None:
            distances[name] = np.linalg.norm(waypoint.position_mm)
    farthest = max(distances.values(), default=0.0)
    for name, distance in distances.items():
        if 0 < distance < _NEAR_ORIGIN and farthest > _FAR_FROM_ORIGIN:
            text = f"waypoint '{name}' is {distance:.3g} mm from the origin, another waypoint {farthest:.4g} mm"
            yield _warning(f"{text}: the position of '{name}' looks like metres", file, "positions are in mm")


def _depths(table: ProtocolTable, file: str) -> Iterator[Finding]:
    """Yield a warning for each insertion depth that looks like metres."""
    depths = {}
    for name, waypoint in table.waypoints.items():
        if waypoint.depth_mm is not None:
            depths[f"waypoint '{name}'"] = waypoint.depth_mm
    for phase in table.phases:
        if isinstance(phase, InsertionTable):
            depths[f"phase '{phase.name}'"] = phase.depth_mm
    for what, depth in depths.items():
        if 0 < abs(depth) < _SMALLEST_DEPTH:
            yield _warning(f"{what}: a depth of {depth:g} mm looks like metres", file, "depths are in mm")


@dataclass(frozen=True)
class _MotionLimits:
    """Limits of the tip's motion or of its rotation, in `unit` per s, s2 and s3.

    `confused_unit` is a unit of speed that is often written by mistake; `plausible` is the range of plausible speeds.
    """

    name: str
    speed: float
    acceleration: float
    jerk: float | None
    plausible: tuple[float, float]
    unit: str
    confused_unit: str

    def warnings(self, where: str, file: str) -> Iterator[Finding]:
        """Yield a warning for each limit that is implausible by itself or beside the one before."""
        unit = self.unit
        ramp = self.speed / self.acceleration
        if not _contains(self.plausible, self.speed):
            text = f"{where}: a {self.name} speed of {self.speed:g} {unit}/s is probably in a wrong unit"
            yield _warning(f"{text} ({self.confused_unit}?)", file, f"speeds are in {unit}/s")
        elif not _contains(_SPEED_RAMPS, ramp):
            text = (
                f"{where}: with {self.acceleration:g} {unit}/s2, the {self.name} reaches {self.speed:g} {unit}/s after "
                f"{ramp:.3g} s: one of these values is probably in a wrong unit"
            )
            yield _warning(text, file, f"accelerations are in {unit}/s2")
        if self.jerk is None:
            return
        jerk_ramp = self.acceleration / self.jerk
        if not _contains(_ACCELERATION_RAMPS, jerk_ramp):
            text = (
                f"{where}: with {self.jerk:g} {unit}/s3, the {self.name} reaches {self.acceleration:g} {unit}/s2 after "
                f"{jerk_ramp:.3g} s: one of these values is probably in a wrong unit"
            )
            yield _warning(text, file, f"jerks are in {unit}/s3")


def _contains(interval: tuple[float, float], value: float) -> bool:
    """Return whether a value is in the interval, its ends included."""
    low, high = interval
    return low <= value <= high


def _are_radians(angles: Sequence[float]) -> bool:
    """Return whether angles given in degrees look like radians: converted to degrees, they become round numbers."""
    written = np.array(angles, float)
    written = written[written != 0]  # zero is the same in both units
    # more than a full turn is not written in radians
    if not len(written) or np.abs(written).max() > _LARGEST_RADIANS:
        return False
    in_degrees = np.rad2deg(written)
    is_whole = np.abs(in_degrees - np.round(in_degrees)) < _WHOLE_DEGREE_TOLERANCE
    is_round_in_degrees = is_whole & (np.abs(in_degrees) > _SMALLEST_TELLING_DEG)
    twentieths = 20 * written  # people write degrees in steps of 0.05
    is_round_as_written = np.abs(twentieths - np.round(twentieths)) < _ROUNDING
    return bool(is_round_in_degrees.all() and not is_round_as_written.any())


def _warning(text: str, file: str, suggestion: str) -> Finding:
    return warning("protocol.unit", file, text, suggestion=suggestion)
