"""The entries of the document `state` of the stream about a robot's trocars and readings; see docs/stream.md."""

from __future__ import annotations

import numpy as np

from twin.core.json_types import JsonObject
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.readings import RobotReading
from twin.ui.session.timeline import Playback
from twin.ui.session.trocars import in_trocars, rcm_at


def trocar_entries(movable: MovableRobot, playback: Playback | None, time: float) -> list[JsonObject]:
    """Return the entry `trocars` of the document `state`: for each trocar, its name, position, error and depth (in m).

    The position is in base. The error is the distance from the trocar to the shaft axis. The depth is the insertion
    depth of the tip.
    """
    if playback is None:
        return []
    entries = []
    for trocar in in_trocars(movable, rcm_at(playback, time)):
        entries.append(
            {
                "name": trocar.name,
                "at": [_json_number(coordinate) for coordinate in trocar.place],
                "error_m": _json_number(trocar.error),
                "depth_m": _json_number(trocar.depth),
            }
        )
    return entries


def reading_entries(reading: RobotReading | None, ghost_distance: float | None) -> JsonObject:
    """Return the readings for the document `state`.

    Args:
        reading: gap, residual, RCM error and depth of the robot; None: not read yet.
        ghost_distance: `DisplayedState.ghost_to_tool_distance` in m. With a ghost, it is the residual in the document;
            without one, the residual is the largest difference, a length or an angle, between equations and mechanism.
    """
    content: JsonObject = {
        "gap_m": None,
        "residual_m": _json_number(ghost_distance),
        "residual_rad": None,
        "scope": None,
        "rcm_error_m": None,
        "depth_m": None,
    }
    if reading is None:
        return content
    content["gap_m"] = _json_number(reading.gap)
    content["rcm_error_m"] = _json_number(reading.rcm_error)
    content["depth_m"] = _json_number(reading.depth)
    if ghost_distance is not None:
        return content
    content["scope"] = reading.incomparable or None
    residual = reading.residual
    if residual is not None:
        content["residual_rad" if residual.is_angle else "residual_m"] = _json_number(residual.size)
    return content


def _json_number(value: float | None) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{value:.9g}")
