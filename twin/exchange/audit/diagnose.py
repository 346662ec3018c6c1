"""Find out why two files disagree: apply common mistakes to the expected poses, and compare the results with a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.motion import largest
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import quantity

_FACTORS = {
    1e3: "lengths look like millimetres read as metres",
    1e-3: "lengths look like metres read as millimetres",
    1e2: "lengths look like centimetres read as metres",
    1e-2: "lengths look like metres read as centimetres",
    1 / 0.0254: "lengths look like inches read as metres",
}
_LOOKS = 20
"""Number of evenly distributed keys at which a mistake is tested, in addition to the keys with the largest errors."""


def why(found: Mapping[str, Array], meant: Mapping[str, Array]) -> str:
    """Return a description of the mistake that causes wrong poses; "" if no known mistake explains the poses.

    `found` contains the poses (k, 4, 4) of each link in the file, `meant` the expected poses.
    """
    names = [name for name in found if name in meant]
    if not names:
        return ""
    looks = _looks(found, meant, names)
    found_poses = []
    meant_poses = []
    for name in names:
        found_poses.append(found[name][looks])
        meant_poses.append(meant[name][looks])
    F = np.stack(found_poses)
    M = np.stack(meant_poses)
    if not (np.all(np.isfinite(F)) and np.all(np.isfinite(M))):
        return ""
    wrong = [i for i in range(len(names)) if not _same(F[i], M[i])]
    if not wrong:
        return ""
    for text, mistake in _mistakes():
        if _same(F[wrong], mistake(M[wrong])):  # other links (a base at the origin) may agree by chance
            return text
    for i, j in combinations(wrong, 2):
        if _same(F[i], M[j]) and _same(F[j], M[i]):
            return f"links '{names[i]}' and '{names[j]}' are swapped"
    whole = F[:, :1] @ poses.inverse(M[:, :1])  # displacement of each link at the first key
    displacement = whole[:1]
    if _same(F, displacement @ M):
        T = displacement[0, 0]
        distance = float(np.linalg.norm(T[:3, 3]))
        turn = np.degrees(float(poses.angle(T[:3, :3], np.eye(3))))
        return f"the whole robot is moved by {quantity(distance, 'm')} and rotated by {turn:.4g} deg"
    if len(wrong) == 1:
        name = names[wrong[0]]
        return _at_few_keys(found[name], meant[name], looks)
    return ""


def _looks(found: Mapping[str, Array], meant: Mapping[str, Array], names: Sequence[str]) -> Array:
    """Return the keys at which mistakes are tested: evenly distributed ones, and those with the largest errors."""
    last = len(found[names[0]]) - 1
    keys = set(np.linspace(0, last, _LOOKS).astype(int).tolist())
    for name in names:  # because only one key may be wrong
        difference = largest(found[name], meant[name])
        keys |= {difference.distance_key, difference.angle_key}
    return np.array(sorted(keys))


def _at_few_keys(found: Array, meant: Array, looks: Array) -> str:
    """Return that only this link differs, if it does so at few of its keys; else ""."""
    if not _count_wrong(found[looks], meant[looks]) < len(looks) / 2:
        return ""
    count = len(found)
    wrong = _count_wrong(found, meant)
    if wrong > max(2, count // 10):
        return ""
    keys = "one key" if wrong == 1 else f"{wrong} keys"
    return f"only this link differs, at {keys} of {count}"


def _count_wrong(found: Array, meant: Array) -> int:
    """Return at how many keys the poses (k, 4, 4) differ."""
    wrong = 0
    for k in range(len(found)):
        if not _same(found[[k]], meant[[k]]):
            wrong += 1
    return wrong


def _mistakes() -> list[tuple[str, Callable[[Array], Array]]]:
    up = poses.pose(poses.R_Z_UP_Y_UP)
    down = poses.inverse(up)
    out: list[tuple[str, Callable[[Array], Array]]] = [
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
        out.append((text, _mirrored(flip)))
    for factor, text in _FACTORS.items():
        out.append((text, _scaled(factor)))
    return out


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


def _same(A: Array, B: Array) -> bool:
    """Return whether poses are equal but for rounding to single precision, relative to the size of the positions."""
    size = float(np.abs(B[..., :3, 3]).max(initial=0.0))
    distance = float(np.linalg.norm(A[..., :3, 3] - B[..., :3, 3], axis=-1).max())
    if not distance < 1e-5 * max(1.0, size):
        return False
    angle = float(poses.angle(A[..., :3, :3], B[..., :3, :3]).max())
    return angle < 1e-3
