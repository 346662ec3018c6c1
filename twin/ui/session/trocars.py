"""Compute the position of each trocar, and trocar error and insertion depth of the instrument in the trocar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.timeline import Playback


@dataclass(frozen=True, eq=False)
class InTrocar:
    """An instrument in its trocar.

    Attributes:
        name: name of the trocar; "" for a mechanism without trocars, where `place` is the RCM of a protocol.
        place: position (3,) of the trocar in m in the base frame.
        error: trocar error: distance in m from the trocar to the shaft axis.
        axis: unit vector (3,) along the shaft in the base frame; towards the tip, if `tip` is not None.
        tip: the protocol's tip (3,) in m in the base frame; None if the tip belongs to another instrument.
        depth: insertion depth: distance in m from the trocar to the tip (for an RCM, along the shaft); None without a
            tip.
    """

    name: str
    place: Array
    error: float
    axis: Array
    tip: Array | None = None
    depth: float | None = None


def in_trocars(movable: MovableRobot, rcm: Array | None = None) -> tuple[InTrocar, ...]:
    """Return the instruments in their trocars.

    For a mechanism without trocars, return the instrument at `rcm`, the RCM (3,) in m in the base frame; None: no RCM.
    """
    tip, axis = movable.shaft()
    mechanism = movable.mechanism
    assembly = movable.assembly
    if not mechanism.trocars:
        if rcm is None or not np.isfinite(rcm).all():
            return ()
        tip_to_rcm = rcm - tip
        along_axis = (tip_to_rcm @ axis) * axis
        error = float(np.linalg.norm(tip_to_rcm - along_axis))
        depth = float(-tip_to_rcm @ axis)
        return (InTrocar("", rcm, error, axis, tip, depth),)
    instruments = []
    carries_tip = {joint.child for joint in mechanism.path(movable.tip_body)}
    for name, place in mechanism.trocar_places.items():
        error = assembly.worst_gap  # if the trocar closes a loop, its error is the loop gap
        shaft = axis
        is_held = mechanism.shaft_through(name)
        if is_held is not None:
            T = assembly.link_poses[is_held.body] @ is_held.T_body_frame
            shaft = T[:3, 2]
            error = float(spatial.point_to_line(place, T[:3, 3], shaft))
        has_tip = is_held is not None and is_held.body in carries_tip
        if has_tip or len(mechanism.trocars) == 1:
            depth = float(np.linalg.norm(place - tip))
            instruments.append(InTrocar(name, place, error, axis, tip, depth))
        else:
            instruments.append(InTrocar(name, place, error, shaft))
    return tuple(instruments)


def rcm_at(playback: Playback | None, time: float) -> Array | None:
    """Return the RCM (3,) in m in the base frame at a protocol time in s; None if no RCM is registered at this time."""
    if playback is None:
        return None
    next_sample = np.searchsorted(playback.t, time)
    sample = int(np.clip(next_sample, 0, len(playback.t) - 1))
    rcm = playback.rcm[sample]
    if not np.isfinite(rcm).all():
        return None
    return rcm
