"""Find out why two files disagree: apply common mistakes to the expected poses, and compare the results with a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping

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
    names = [n for n in found if n in meant]
    if not names:
        return ""
    every = len(found[names[0]])
    rows = set(np.linspace(0, every - 1, _LOOKS).astype(int).tolist())
    rows |= {k for n in names for k in (largest(found[n], meant[n])[1::2])}  # because only one key may be wrong
    looks = np.array(sorted(rows))
    F = np.stack([found[n][looks] for n in names])
    M = np.stack([meant[n][looks] for n in names])
    if not (np.all(np.isfinite(F)) and np.all(np.isfinite(M))):
        return ""
    off = [i for i in range(len(names)) if not _same(F[i], M[i])]
    if not off:
        return ""
    for text, mistake in _mistakes():
        if off and _same(F[off], mistake(M[off])):  # other links (a base at the origin) may agree by chance
            return text
    for i in off:
        for j in off:
            if i < j and _same(F[i], M[j]) and _same(F[j], M[i]):
                return f"links '{names[i]}' and '{names[j]}' are swapped"
    first = F[:, :1] @ poses.inverse(M[:, :1])  # displacement of the whole robot
    if _same(F, first[:1] @ M):
        move = float(np.linalg.norm(first[0, 0, :3, 3]))
        turn = np.degrees(float(poses.angle(first[0, 0, :3, :3], np.eye(3))))
        return f"the whole robot is moved by {quantity(move, 'm')} and rotated by {turn:.4g} deg"
    wrong = [k for k in looks.tolist() if not all(_same(found[n][[k]], meant[n][[k]]) for n in names)]
    if len(off) == 1 and len(wrong) < len(looks) / 2:
        keys = [k for k in range(every) if not _same(found[names[off[0]]][[k]], meant[names[off[0]]][[k]])]
        if len(keys) <= max(2, every // 10):
            return f"only this link differs, at {'one key' if len(keys) == 1 else f'{len(keys)} keys'} of {every}"
    return ""


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
        out.append((text, lambda M, flip=flip: flip @ M @ flip))
    for factor, text in _FACTORS.items():
        out.append((text, lambda M, f=factor: poses.pose(M[..., :3, :3], f * M[..., :3, 3])))
    return out


def _reordered(order: list[int]) -> Callable[[Array], Array]:
    def mistake(M: Array) -> Array:
        return poses.pose(poses.rotation(poses.quaternion(M[..., :3, :3])[..., order]), M[..., :3, 3])

    return mistake


def _same(A: Array, B: Array) -> bool:
    scale = 1e-5 * max(1.0, float(np.abs(B[..., :3, 3]).max(initial=0.0)))
    apart = float(np.linalg.norm(A[..., :3, 3] - B[..., :3, 3], axis=-1).max())
    return apart < scale and float(poses.angle(A[..., :3, :3], B[..., :3, :3]).max()) < 1e-3
