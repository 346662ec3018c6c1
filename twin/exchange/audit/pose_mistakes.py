"""Find out why two files disagree: apply common mistakes to the expected poses, and compare the results with a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.pose_deviation import pose_deviation
from twin.exchange.audit.poses import Array
from twin.exchange.audit.value_text import quantity

_LENGTH_MISTAKES = {
    1e3: "lengths look like millimetres read as metres",
    1e-3: "lengths look like metres read as millimetres",
    1e2: "lengths look like centimetres read as metres",
    1e-2: "lengths look like metres read as centimetres",
    1 / 0.0254: "lengths look like inches read as metres",
}
_EVEN_KEYS = 20
"""Number of evenly distributed keys at which a mistake is tested, in addition to the keys with the largest errors."""


_POSITION_TOL = 1e-5
"""Distance in m of positions that are equal; for robots larger than 1 m, as a fraction of their size."""

_ANGLE_TOL = 1e-3
"""Angle in rad of rotations that are equal: mistakes turn links by far more."""

_FEW_KEYS = 2
"""Number of keys that are few in a clip of any length; in longer clips, a tenth of the keys are few."""


def mistake_behind(file_poses: Mapping[str, Array], expected_poses: Mapping[str, Array]) -> str:
    """Return a description of the mistake that causes wrong poses; "" if no known mistake explains the poses.

    `file_poses` contains the poses (k, 4, 4) of each link in the file, `expected_poses` those of the reference.
    """
    names = []
    for name in file_poses:
        if name in expected_poses:
            names.append(name)
    if not names:
        return ""
    tested_keys = _tested_keys(file_poses, expected_poses, names)
    file_samples = []
    expected_samples = []
    for name in names:
        file_samples.append(file_poses[name][tested_keys])
        expected_samples.append(expected_poses[name][tested_keys])
    tested = np.stack(file_samples)
    expected = np.stack(expected_samples)
    if not (np.all(np.isfinite(tested)) and np.all(np.isfinite(expected))):
        return ""
    wrong = []  # numbers of the links that differ
    for i in range(len(names)):
        if not _are_same_poses(tested[i], expected[i]):
            wrong.append(i)
    if not wrong:
        return ""
    for text, mistake in _mistakes():
        # Only of the wrong links: others, such as a base at the origin, may agree by chance.
        if _are_same_poses(tested[wrong], mistake(expected[wrong])):
            return text
    for i, j in combinations(wrong, 2):
        if _are_same_poses(tested[i], expected[j]) and _are_same_poses(tested[j], expected[i]):
            return f"links '{names[i]}' and '{names[j]}' are swapped"
    displacements = tested[:, :1] @ poses.inverse(expected[:, :1])  # displacement of each link at the first key
    displacement = displacements[:1]
    if _are_same_poses(tested, displacement @ expected):
        T = displacement[0, 0]
        distance = float(np.linalg.norm(T[:3, 3]))
        turn = np.degrees(float(poses.angle(T[:3, :3], np.eye(3))))
        return f"the whole robot is moved by {quantity(distance, 'm')} and rotated by {turn:.4g} deg"
    if len(wrong) == 1:
        name = names[wrong[0]]
        return _few_wrong_keys_text(file_poses[name], expected_poses[name], tested_keys)
    return ""


def _tested_keys(file_poses: Mapping[str, Array], expected_poses: Mapping[str, Array], names: Sequence[str]) -> Array:
    """Return the keys at which mistakes are tested: evenly distributed ones, and those with the largest errors."""
    last = len(file_poses[names[0]]) - 1
    keys = set(np.linspace(0, last, _EVEN_KEYS).astype(int).tolist())
    for name in names:  # because only one key may be wrong
        difference = pose_deviation(file_poses[name], expected_poses[name])
        keys |= {difference.distance_key, difference.angle_key}
    return np.array(sorted(keys))


def _few_wrong_keys_text(file_poses: Array, expected_poses: Array, tested_keys: Array) -> str:
    """Return that only this link differs, if it does so at few of its keys; else ""."""
    if not _count_wrong_keys(file_poses[tested_keys], expected_poses[tested_keys]) < len(tested_keys) / 2:
        return ""
    count = len(file_poses)
    wrong = _count_wrong_keys(file_poses, expected_poses)
    if wrong > max(_FEW_KEYS, count // 10):
        return ""
    keys = "one key" if wrong == 1 else f"{wrong} keys"
    return f"only this link differs, at {keys} of {count}"


def _count_wrong_keys(file_poses: Array, expected_poses: Array) -> int:
    """Return at how many keys the poses (k, 4, 4) differ."""
    wrong = 0
    for key in range(len(file_poses)):
        if not _are_same_poses(file_poses[[key]], expected_poses[[key]]):
            wrong += 1
    return wrong


def _mistakes() -> list[tuple[str, Callable[[Array], Array]]]:
    """Return (description, function that turns expected poses (..., 4, 4) into those with the mistake)."""
    up = poses.pose(poses.R_Z_UP_Y_UP)
    down = poses.inverse(up)
    mistakes: list[tuple[str, Callable[[Array], Array]]] = [
        ("the up axis is wrong: z up is read as y up", lambda M: up @ M),
        ("the up axis is wrong: y up is read as z up", lambda M: down @ M),
        ("quaternions are written w, x, y, z and read x, y, z, w", _reordered([3, 0, 1, 2])),
        ("quaternions are written x, y, z, w and read w, x, y, z", _reordered([1, 2, 3, 0])),
        ("rotations are inverted", lambda M: poses.pose(np.swapaxes(M[..., :3, :3], -1, -2), M[..., :3, 3])),
    ]
    for axis, name in enumerate("xyz"):
        flip = np.eye(4)
        flip[axis, axis] = -1
        text = f"the frame is mirrored (left-handed): {name} has the opposite sign"
        mistakes.append((text, _mirrored(flip)))
    for factor, text in _LENGTH_MISTAKES.items():
        mistakes.append((text, _scaled(factor)))
    return mistakes


def _mirrored(flip: Array) -> Callable[[Array], Array]:
    def mistake(M: Array) -> Array:
        return flip @ M @ flip

    return mistake


def _scaled(factor: float) -> Callable[[Array], Array]:
    def mistake(M: Array) -> Array:
        return poses.pose(M[..., :3, :3], factor * M[..., :3, 3])

    return mistake


def _reordered(order: list[int]) -> Callable[[Array], Array]:
    def mistake(M: Array) -> Array:
        components = poses.quaternion(M[..., :3, :3])
        R = poses.rotation(components[..., order])
        return poses.pose(R, M[..., :3, 3])

    return mistake


def _are_same_poses(A: Array, B: Array) -> bool:
    """Return whether poses are equal but for rounding to single precision, relative to the size of the positions."""
    size = float(np.abs(B[..., :3, 3]).max(initial=0.0))
    distance = float(np.linalg.norm(A[..., :3, 3] - B[..., :3, 3], axis=-1).max())
    if not distance < _POSITION_TOL * max(1.0, size):
        return False
    angle = float(poses.angle(A[..., :3, :3], B[..., :3, :3]).max())
    return angle < _ANGLE_TOL
