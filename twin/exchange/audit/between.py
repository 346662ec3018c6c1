"""Estimate the interpolation error between keys by removing every second key.

If accelerations change slowly, linear interpolation over two intervals has four times the error of linear interpolation
over one interval. Therefore the error stated in a file is compared with a quarter of the error that is measured with
every second key removed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.motion import Clip, Shape
from twin.exchange.audit.physics import Joint
from twin.exchange.audit.poses import Array


def halved(clip: Clip, shapes: Mapping[str, Shape], joints: Sequence[Joint]) -> tuple[float, float, float] | None:
    """Remove every second key, and return the maximum interpolation errors at the removed keys.

    The result is (position error of a link's points in m, rotation error of a link in rad, gap of a joint in m). If
    fewer than three keys can be removed, the result is None.

    Position errors are measured at the corners of the link's bounding box. If `shapes` does not contain the link, they
    are measured at the link's origin.
    """
    t = clip.times
    inner = np.arange(1, len(t) - 1, 2)
    inner = inner[np.abs(t[inner + 1] + t[inner - 1] - 2 * t[inner]) < 1e-6] if len(inner) else inner
    if len(inner) < 3:
        return None
    drawn = {n: midway(T[inner - 1], T[inner + 1]) for n, T in clip.links.items()}
    meant = {n: T[inner] for n, T in clip.links.items()}
    position = rotation = 0.0
    for name, T in meant.items():
        shape = shapes.get(name)
        ends = (
            [np.zeros(3)] if shape is None else [np.array(c) for c in product(*zip(shape.low, shape.high, strict=True))]
        )
        D = drawn[name] - T
        position = max(position, *(float(np.linalg.norm(D[:, :3, :3] @ c + D[:, :3, 3], axis=1).max()) for c in ends))
        rotation = max(rotation, float(poses.angle(drawn[name][:, :3, :3], T[:, :3, :3]).max()))
    gap = max((gap_of(j, drawn) for j in joints), default=0.0)
    return position, rotation, gap


def midway(A: Array, B: Array) -> Array:
    """Return the poses (k, 4, 4) halfway between A and B: mean of the positions, half of the relative rotation."""
    a, b = poses.quaternion(A[:, :3, :3]), poses.quaternion(B[:, :3, :3])
    half = poses.slerp(a, b, np.full(len(a), 0.5))
    return poses.pose(poses.rotation(half), (A[:, :3, 3] + B[:, :3, 3]) / 2)


def gap_of(joint: Joint, links: Mapping[str, Array]) -> float:
    """Return the maximum gap in m between a joint's two frames, in the locked directions of the joint; 0 if unknown.

    `links` maps each link to T_world_link (k, 4, 4).
    """
    if joint.parent not in links or joint.child not in links:
        return 0.0
    here, there = joint.end(joint.parent), joint.end(joint.child)
    if here is None or there is None:
        return 0.0
    (p, d), (q, _) = here, there
    A, B = links[joint.parent], links[joint.child]
    off = (B[:, :3, :3] @ q + B[:, :3, 3]) - (A[:, :3, :3] @ p + A[:, :3, 3])
    if joint.kind in ("prismatic", "cylindrical") and d is not None:
        along = A[:, :3, :3] @ d
        off = off - np.sum(off * along, axis=1, keepdims=True) * along
    elif joint.kind.startswith(("chain", "free")):
        return 0.0
    return float(np.linalg.norm(off, axis=1).max())
