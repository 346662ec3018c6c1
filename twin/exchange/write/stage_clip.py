"""Make a clip from a stage with a baked motion: the time samples become the keys."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin.core import spatial
from twin.core.errors import StageError
from twin.core.spatial import Array
from twin.exchange.write.clip import DECIMALS, Clip, rounded
from twin.exchange.write.player_interpolation import extreme_points, interpolation_errors, key_rows
from twin.model.mechanism import Mechanism


def sampled_clip(mechanism: Mechanism, stage: Path) -> Clip | None:
    """Return the motion of a USD stage as a clip; None if no link moves.

    A stage has no data between its samples. Therefore the interpolation errors in the clip are measured with every
    second sample removed, and are larger than the actual errors. `stage` is the path of the root layer from which the
    mechanism was read.
    """
    from twin.usd.read import read_motion

    try:
        times, poses = read_motion(stage)
    except StageError:
        return None
    if len(times) < 2:
        return None
    times = times - times[0]  # players start at 0, a stage at any time code
    T_base_world = spatial.inverse(poses.get(mechanism.base, np.eye(4)[None]))
    links = {}
    for body in mechanism.bodies:
        Ts = mechanism.rest[body.name][None]
        if body.name in poses:
            Ts = T_base_world @ poses[body.name]
        links[body.name] = np.broadcast_to(Ts, (len(times), 4, 4))
    links = rounded(links)
    # Every second sample is left out, and the motion at these is compared with what a player would show.
    every_second = key_rows(len(times), 2)
    between = interpolation_errors(mechanism, times, links, every_second, extreme_points(mechanism))
    name = stage.stem.removeprefix(f"{mechanism.name}_")
    if name == mechanism.name:
        name = "motion"
    # The median, because the last interval may be shorter, as the motion ends between two samples.
    interval = float(np.median(np.diff(times)))
    return Clip(
        name,
        name,
        times,
        links,
        coordinates(mechanism, links),
        tuple(joint.name for joint in mechanism.active),
        (("all", 0.0, float(times[-1])),),
        round(1 / interval, 6),
        between,
        frame=mechanism.tool,
        phase_rcm=(None,),
    )


def coordinates(mechanism: Mechanism, links: Mapping[str, Array]) -> dict[str, Array]:
    """Return {joint: coordinate (k,) in m or rad} for joints with a single coordinate, from link poses (k, 4, 4)."""
    values_by_joint = {}
    for joint in mechanism.joints:
        if len(joint.free_axes) != 1:
            continue
        values = joint.coordinate(links[joint.parent], links[joint.child])
        if joint.is_angle:
            values = np.round(np.unwrap(values), DECIMALS) + 0.0  # adding 0.0 removes negative zeros
        values_by_joint[joint.name] = values
    return values_by_joint
