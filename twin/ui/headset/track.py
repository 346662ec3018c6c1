"""Samples as they are sent, and what a protocol is to a stream: link poses, the way of the tip, the trocars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.api import Robot
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.ui.headset.protocol import pose_of
from twin.ui.session.desk import Desk
from twin.ui.session.instruments import Reading
from twin.ui.session.timeline import Playback
from twin.ui.session.trocars import in_trocars, rcm_at

PATH_POINTS = 600
"""Points of a tool path that is sent, at most."""


@dataclass(frozen=True, eq=False)
class Shown:
    """One sample: poses (links, 7) and q (joints,) in double, and the ghost (7,) or None."""

    poses: Array
    q: Array
    ghost: Array | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Track:
    """A playback with its link poses (k, links, 7), ready to be sent."""

    playback: Playback
    poses: Array


def path(track: Track | None) -> dict[str, Any]:
    """Return the document with the way of the tip along the protocol; empty if there is none."""
    if track is None:
        return {"type": "path", "protocol": None, "points": []}
    tip = track.playback.tip
    rows = np.unique(np.linspace(0, len(tip) - 1, min(PATH_POINTS, len(tip))).round().astype(int))
    return {"type": "path", "protocol": track.playback.protocol, "points": np.round(tip[rows], 6).ravel().tolist()}


def number(value: float | None) -> float | None:
    """Return a number as JSON has it: none that is not finite."""
    return float(f"{value:.9g}") if value is not None and np.isfinite(value) else None


def trocars(desk: Desk, playback: Playback | None, time: float) -> list[dict[str, Any]]:
    """Return the instruments in their trocars as the state has them: name, place, distance of the shaft, depth."""
    found = () if playback is None else in_trocars(desk, rcm_at(playback, time))
    return [
        {
            "name": t.name,
            "at": [number(v) for v in t.place],
            "error_m": number(t.error),
            "depth_m": number(t.depth),
        }
        for t in found
    ]


def protocols_of(robot: Robot, given: str | None) -> dict[str, str]:
    """Return what `Robot.protocol` takes, by name: the robot's own protocols, and the one that was given by path.

    Raises:
        TwinError: the protocol that was given is not there, or is wrong.
    """
    own = {} if robot.files is None else {n: n for n in robot.files.protocols()}
    if given is None:
        return own
    name = robot.protocol(given).name
    if name in own and given != name:
        raise TwinError(f"{given}: the protocol is named '{name}' as one of the robot's own: give it another name")
    return {**own, name: given}


def apart(shown: Shown, links: tuple[str, ...], tool: Mapping[str, Any]) -> float | None:
    """Return how far the ghost is from the tool, in m; None without a ghost. `tool` is as described."""
    if shown.ghost is None:
        return None
    T = pose_of(shown.poses[links.index(tool["link"])]) @ pose_of(tool["T_link_tool"])
    return float(np.linalg.norm(T[:3, 3] - shown.ghost[:3]))


def measured(reading: Reading | None, ghost: float | None) -> dict[str, Any]:
    """Return what the instruments read as the state has it; `ghost`: how far the ghost is from the tool, in m.

    Of equations and mechanism the largest difference is given, a length or an angle; the ghost's, if there is one.
    """
    residual = None if reading is None or ghost is not None else reading.residual
    length = ghost if residual is None or residual.is_angle else residual.size
    return {
        "gap_m": None if reading is None else number(reading.gap),
        "residual_m": number(length),
        "residual_rad": number(residual.size) if residual is not None and residual.is_angle else None,
        "scope": None if ghost is not None or reading is None else reading.scope or None,
        "rcm_error_m": None if reading is None else number(reading.rcm_error),
        "depth_m": None if reading is None else number(reading.depth),
    }
