"""A side of a comparison in another base frame."""

from __future__ import annotations

from dataclasses import replace

from twin.comparison.side import RobotSide
from twin.core.spatial import Array


def moved(side: RobotSide, T: Array) -> RobotSide:
    """Return a side with another base frame."""
    axes = []
    for axis in side.axes:
        point = T[:3, :3] @ axis.point + T[:3, 3]
        axes.append(replace(axis, point=point, direction=T[:3, :3] @ axis.direction))
    frames = {name: (group, T @ frame) for name, (group, frame) in side.frames.items()}
    return replace(side, axes=tuple(axes), frames=frames)
