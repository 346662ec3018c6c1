"""Compute the poses of all bodies, at rest and at every time sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.usd.scan import JointSide, RawJoint, RawStage


@dataclass(frozen=True)
class Timeline:
    """Poses of all bodies at rest and at k time samples.

    Attributes:
        poses: T_world_body (k + 1, 4, 4) by body; the first pose is the pose at rest.
        codes: time codes (k,) of the samples.
        labels: names of the k + 1 poses in findings: "at rest", then the time code and time of each sample.
        times_s: times (k,) of the samples in s.
    """

    poses: dict[str, Array]
    codes: Array
    labels: list[str]
    times_s: Array

    def relative(self, joint: RawJoint) -> Array:
        """Return the pose (k + 1, 4, 4) of a joint's frame on body1 relative to its frame on body0."""
        T_world_joint0 = self._frames(joint.ends[0])
        T_world_joint1 = self._frames(joint.ends[1])
        return spatial.inverse(T_world_joint0) @ T_world_joint1

    def _frames(self, end: JointSide) -> Array:
        """Return the pose (k + 1, 4, 4) of a joint's frame in the world."""
        if end.body:
            return self.poses[end.body] @ end.T_body_joint
        # UsdPhysics attaches a joint to the world where it names no body: that frame is the same at all times.
        return np.broadcast_to(end.T_body_joint, (len(self.labels), 4, 4))


def timeline(scene: RawStage) -> Timeline:
    """Return the poses of all bodies at rest (default time) and at every time sample."""
    prims = list(scene.bodies.values())
    codes = scene.sample_codes
    times = codes / scene.stage.GetTimeCodesPerSecond()
    poses = scene.poses(prims)
    if len(codes):
        poses = np.concatenate([poses, scene.poses(prims, codes)], axis=1)
    labels = ["at rest"]
    for code, time in zip(codes, times, strict=True):
        labels.append(f"time code {code:g} ({time:.4g} s)")
    return Timeline(dict(zip(scene.bodies, poses, strict=True)), codes, labels, times)
