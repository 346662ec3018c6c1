"""The document `path` of the stream, and the entries of its document `state`: trocars, readings, ghost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonMapping, JsonObject
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.ui.headset.stream_frames import pose_of
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.readings import RobotReading
from twin.ui.session.timeline import Playback
from twin.ui.session.trocars import in_trocars, rcm_at

PATH_POINTS = 600
"""Maximum number of points in a sent tip path."""


@dataclass(frozen=True, eq=False)
class DisplayedState:
    """A displayed state of the robot, in double precision.

    Attributes:
        poses: link poses (links, 7): x y z in m, quaternion x y z w.
        q: active joint values (joints,) in m or rad.
        ghost: the ghost's tool pose (7,); None without a ghost.
        reason: why the last request was refused; "" if it was not.
    """

    poses: Array
    q: Array
    ghost: Array | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class StreamedPlayback:
    """A playback, with its link poses (k, links, 7) in the format of the stream."""

    playback: Playback
    poses: Array


def path_document(track: StreamedPlayback | None) -> JsonObject:
    """Return the document `path`: the protocol's name and its tip path; without a protocol, no points.

    The points are x y z in m, in base, one after another in a flat list.
    """
    if track is None:
        return {"type": "path", "protocol": None, "points": []}
    tip = track.playback.tip
    rows = spread(len(tip), PATH_POINTS)
    points = np.round(tip[rows], 6)  # to 0.001 mm, which is finer than any display shows
    return {"type": "path", "protocol": track.playback.protocol, "points": points.ravel().tolist()}


def json_number(value: float | None) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{value:.9g}")


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
                "at": [json_number(coordinate) for coordinate in trocar.place],
                "error_m": json_number(trocar.error),
                "depth_m": json_number(trocar.depth),
            }
        )
    return entries


def ghost_to_tool_distance(shown: DisplayedState, links: tuple[str, ...], tool: JsonMapping) -> float | None:
    """Return the distance in m between the ghost's origin and the tool's origin; None without a ghost."""
    if shown.ghost is None:
        return None
    T = pose_of(shown.poses[links.index(tool["link"])]) @ pose_of(tool["T_link_tool"])
    return float(np.linalg.norm(T[:3, 3] - shown.ghost[:3]))


def reading_entries(reading: RobotReading | None, ghost_distance: float | None) -> JsonObject:
    """Return the readings for the document `state`; `ghost_distance` is that of `ghost_to_tool_distance`.

    With a ghost, the residual in the document is `ghost_distance`. Without a ghost, the residual is the largest
    difference, a length or an angle, between equations and mechanism.
    """
    content: JsonObject = {
        "gap_m": None,
        "residual_m": json_number(ghost_distance),
        "residual_rad": None,
        "scope": None,
        "rcm_error_m": None,
        "depth_m": None,
    }
    if reading is None:
        return content
    content["gap_m"] = json_number(reading.gap)
    content["rcm_error_m"] = json_number(reading.rcm_error)
    content["depth_m"] = json_number(reading.depth)
    if ghost_distance is not None:
        return content
    content["scope"] = reading.incomparable or None
    residual = reading.residual
    if residual is not None:
        content["residual_rad" if residual.is_angle else "residual_m"] = json_number(residual.size)
    return content
