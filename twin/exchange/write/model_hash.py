"""The hash by which exported files state which model of the robot they show."""

from __future__ import annotations

import hashlib
import json

import numpy as np
from numpy.typing import ArrayLike

from twin.model.mechanism import Mechanism

_DECIMALS = 9
"""Decimals in m, rad and 1 to which numbers are rounded, so that the hash does not depend on the processor."""


def model_hash(mechanism: Mechanism) -> str:
    """Return the hash "sha256:..." of the data that players show: bodies, meshes, joints with limits, frames.

    Two files with the same hash show the same robot. What is hashed, and in which order, must not change: files of
    earlier exports state their hash.
    """
    digest = hashlib.sha256()

    def add(entry: list[object]) -> None:
        digest.update(json.dumps(entry, separators=(",", ":")).encode())

    add([mechanism.name, mechanism.base, mechanism.tool])
    for body in mechanism.bodies:
        add(["body", body.name])
        for mesh in body.meshes:
            add([mesh.name, _numbers(mesh.color_rgba)])
            digest.update(np.ascontiguousarray(_rounded(mesh.vertices), "<f8").tobytes())
            digest.update(np.ascontiguousarray(mesh.triangles, "<i4").tobytes())
    for joint in mechanism.joints:
        limits: list[float] | None = None
        if joint.limits is not None:
            limits = _numbers(joint.limits)
        add([joint.name, joint.type, joint.parent, joint.child, joint.active, limits])
        add([_numbers(joint.T_parent_joint), _numbers(joint.T_child_joint)])
    for frame in mechanism.frames:
        add([frame.name, frame.body, _numbers(frame.T_body_frame)])
    return f"sha256:{digest.hexdigest()}"


def _numbers(values: ArrayLike) -> list[float]:
    """Return the rounded entries of an array of any shape, row by row."""
    return _rounded(values).ravel().tolist()


def _rounded(values: ArrayLike) -> np.ndarray:
    return np.round(np.asarray(values, float), _DECIMALS) + 0.0  # adding 0.0 removes negative zeros
