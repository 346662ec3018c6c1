"""Write texts of protocols: header, tolerances, limits of each type of phase, waypoints, phases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

Limits = tuple[float, float, float, float]
"""Maximum speed and acceleration of the tip in mm/s and mm/s2, then of the rotation in deg/s and deg/s2."""

_WHY = 'provenance = "ASSUMED"\nnote = "of a test"\n'


def waypoint(name: str, angles_deg: Sequence[float] | None = None, **place: Any) -> str:
    """Return a waypoint; `place` is position_mm or depth_mm, or joint values if `angles_deg` is None."""
    angles = "" if angles_deg is None else f"angles_deg = {[float(a) for a in angles_deg]}\n"
    return f"\n[waypoints.{name}]\n{_lines(place)}{angles}{_WHY}"


def limits(kind: str, values: Limits) -> str:
    """Return the limits of one type of phase."""
    keys = ("tip_speed_mm_s", "tip_acceleration_mm_s2", "rotation_speed_deg_s", "rotation_acceleration_deg_s2")
    return f"\n[limits.{kind}]\n{_lines(dict(zip(keys, values, strict=True)))}{_WHY}"


def phase(**keys: Any) -> str:
    """Return a phase; a value that begins with a brace is written as it is."""
    return f"\n[[phases]]\n{_lines(keys)}"


def text(head: Mapping[str, Any], tables: str, most: Mapping[str, Limits], parts: Iterable[str]) -> str:
    """Return a protocol.

    Args:
        head: name, title, robot, start, and further keys at the top of the file; the default frame is `tool`, with its
            z axis along the shaft.
        tables: text of the tables of trocars and patient.
        most: limits by type of phase.
        parts: waypoints and phases.
    """
    top = {"source": "a test", "frame": "tool", "shaft_axis": [0, 0, 1], "rotation": "zyx", **head}
    tolerances = {"rcm_mm": 0.1, "rcm_alarm_mm": 1, "straightness_mm": 0.1, "waypoint_mm": 0.01, "waypoint_deg": 0.01}
    known = "".join(limits(kind, values) for kind, values in most.items())
    return f"{_lines(top)}{tables}\n[tolerances]\n{_lines(tolerances)}{_WHY}{known}{''.join(parts)}"


def _lines(keys: Mapping[str, Any]) -> str:
    quoted = {k: f'"{v}"' if isinstance(v, str) and not v.startswith("{") else v for k, v in keys.items()}
    return "".join(f"{k} = {v}\n" for k, v in quoted.items())
