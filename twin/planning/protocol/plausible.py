"""Warn about numbers of a protocol that are probably in a wrong unit: metres for millimetres, radians for degrees.

Such numbers are possible, so they cause warnings, not errors.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.findings import Finding, warning
from twin.planning.protocol.phases.insertion import InsertionTable
from twin.planning.protocol.tables import ProtocolTable

_TIP, _TURN = (0.2, 2000.0), (1.0, 720.0)
"""Plausible ranges of tip speed in mm/s and rotation speed in deg/s."""

_RAMP = (2e-3, 30.0)
"""Plausible range in s of the time from rest to full speed.

The range of the time from zero to full acceleration has the same maximum, and a tenth of this minimum.
"""

_DEPTH = 0.5
"""Insertion depth in mm below which the number looks like metres."""

_NEAR, _FAR = 1.0, 100.0
"""Distances in mm from the origin. A position nearer than `_NEAR` is probably in metres if another position is farther
than `_FAR`."""


def plausible(table: ProtocolTable, file: str) -> Iterator[Finding]:
    """Yield a warning for each number that is implausible in its unit but usual in another unit."""
    for name, w in table.waypoints.items():
        if w.angles_deg is not None and _radians(w.angles_deg):
            shown = ", ".join(f"{a:g}" for a in w.angles_deg)
            turned = ", ".join(f"{np.rad2deg(a):.4g}" for a in w.angles_deg)
            text = f"waypoint '{name}': angles ({shown}) deg look like radians: converted, they are ({turned}) deg"
            yield _warning(text, file, "degrees are expected; multiply by 180/pi")
    distances = {}
    depths = {}
    for name, w in table.waypoints.items():
        if w.position_mm is not None:
            distances[name] = np.linalg.norm(w.position_mm)
        if w.depth_mm is not None:
            depths[f"waypoint '{name}'"] = w.depth_mm
    for phase in table.phases:
        if isinstance(phase, InsertionTable):
            depths[f"phase '{phase.name}'"] = phase.depth_mm
    far = max(distances.values(), default=0.0)
    for name, r in distances.items():
        if 0 < r < _NEAR and far > _FAR:
            text = f"waypoint '{name}' is {r:.3g} mm from the origin, another waypoint {far:.4g} mm"
            yield _warning(f"{text}: the position of '{name}' looks like metres", file, "positions are in mm")
    for what, depth in depths.items():
        if 0 < abs(depth) < _DEPTH:
            yield _warning(f"{what}: a depth of {depth:g} mm looks like metres", file, "depths are in mm")
    for kind, l in table.limits.items():  # noqa: E741
        rows = (
            ("tip", l.tip_speed_mm_s, l.tip_acceleration_mm_s2, l.tip_jerk_mm_s3, _TIP, "mm"),
            ("rotation", l.rotation_speed_deg_s, l.rotation_acceleration_deg_s2, l.rotation_jerk_deg_s3, _TURN, "deg"),
        )
        for name, speed, acceleration, jerk, (low, high), unit in rows:
            if not low <= speed <= high:
                other = "m/s" if unit == "mm" else "rad/s"
                text = f"limits.{kind}: a {name} speed of {speed:g} {unit}/s is probably in a wrong unit ({other}?)"
                yield _warning(text, file, f"speeds are in {unit}/s")
            elif not _RAMP[0] <= speed / acceleration <= _RAMP[1]:
                text = (
                    f"limits.{kind}: with {acceleration:g} {unit}/s2, the {name} reaches {speed:g} {unit}/s after "
                    f"{speed / acceleration:.3g} s: one of these values is probably in a wrong unit"
                )
                yield _warning(text, file, f"accelerations are in {unit}/s2")
            if jerk is not None and not _RAMP[0] / 10 <= acceleration / jerk <= _RAMP[1]:
                text = (
                    f"limits.{kind}: with {jerk:g} {unit}/s3, the {name} reaches {acceleration:g} {unit}/s2 after "
                    f"{acceleration / jerk:.3g} s: one of these values is probably in a wrong unit"
                )
                yield _warning(text, file, f"jerks are in {unit}/s3")


def _radians(angles: tuple[float, ...] | list[float]) -> bool:
    """Return whether angles given in degrees look like radians: converted to degrees, they become round numbers."""
    written = np.array(angles, float)
    written = written[written != 0]  # zero is the same in both units
    if not len(written) or np.abs(written).max() > 2 * np.pi + 1e-3:
        return False
    in_degrees = np.rad2deg(written)
    # tolerance of 0.02 deg: rounding of radians with four digits
    round_in_degrees = (np.abs(in_degrees - np.round(in_degrees)) < 0.02) & (np.abs(in_degrees) > 0.9)
    twentieths = 20 * written  # people write degrees in steps of 0.05
    round_as_written = np.abs(twentieths - np.round(twentieths)) < 1e-6
    return bool(round_in_degrees.all() and not round_as_written.any())


def _warning(text: str, file: str, suggestion: str) -> Finding:
    return warning("protocol.unit", file, text, suggestion=suggestion)
