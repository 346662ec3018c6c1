"""Joints in a row: poses from joint values, and joint values that reach given poses where nobody wrote them down.

A ball, for one, has no single coordinate that a table could hold; its turn is taken from the poses of the two links,
so that its centre and everything behind it are still checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.audit import poses
from twin.audit.poses import Array

_STEP = 1e-6
_GOOD = 1e-9


@dataclass(frozen=True)
class Link:
    """A fixed pose (4, 4), then one joint: "turn" or "slide" along an axis (3,), or "fixed"."""

    fixed: Array
    kind: str = "fixed"
    axis: Array | None = None
    name: str = ""

    def poses(self, q: Array | None) -> Array:
        """Return poses (k, 4, 4) for joint values (k,), or (4, 4) of a fixed one."""
        if self.kind == "fixed" or q is None or self.axis is None:
            return self.fixed
        if self.kind == "turn":
            return self.fixed @ poses.pose(poses.about(self.axis, q))
        return self.fixed @ poses.pose(None, np.asarray(q)[:, None] * (self.axis / np.linalg.norm(self.axis)))


def along(links: Sequence[Link], q: Sequence[Array | None], count: int) -> Array:
    """Return poses (k, 4, 4) of the end of a chain seen from its start."""
    T = np.broadcast_to(np.eye(4), (count, 4, 4))
    for link, value in zip(links, q, strict=True):
        T = T @ link.poses(value)
    return T


def fit(links: Sequence[Link], given: Sequence[Array | None], goal: Array) -> list[Array | None]:
    """Return values (k,) of all joints of a chain, those that are None found so that it ends at goal (k, 4, 4).

    Gauss-Newton, all frames at once; frames that end elsewhere start again from their neighbour's solution. What
    cannot be reached is left at its best: the comparison that follows shows how far off that is.
    """
    count = len(goal)
    free = [i for i, (link, g) in enumerate(zip(links, given, strict=True)) if g is None and link.kind != "fixed"]
    if not free:
        return list(given)
    q = np.zeros((len(free), count))
    q, off = _descend(links, given, free, q, goal)
    for _ in range(8):
        bad = off > _GOOD
        if not bad.any() or bad.all():
            break
        good = np.flatnonzero(~bad)
        near = good[np.clip(np.searchsorted(good, np.arange(count)), 0, len(good) - 1)]
        tried, new = _descend(links, given, free, np.where(bad, q[:, near], q), goal)
        better = new < off
        q, off = np.where(better, tried, q), np.where(better, new, off)
        if not better.any():
            break
    out = list(given)
    for row, i in enumerate(free):
        out[i] = q[row]
    return out


def _descend(links, given, free: list[int], q: Array, goal: Array) -> tuple[Array, Array]:
    values = list(given)

    def residual(x: Array) -> Array:
        for row, i in enumerate(free):
            values[i] = x[row]
        T = along(links, values, x.shape[1])
        E = np.swapaxes(goal[:, :3, :3], 1, 2) @ T[:, :3, :3]
        skew = E - np.swapaxes(E, 1, 2)
        turn = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        # Half a turn away the skew part vanishes as well: the trace tells the two apart.
        turn = turn + np.where(np.trace(E, axis1=1, axis2=2)[:, None] < -0.5, 1.0, 0.0)
        return np.concatenate([T[:, :3, 3] - goal[:, :3, 3], turn], axis=1)

    r = residual(q)
    for _ in range(30):
        J = np.stack(
            [(residual(q + _STEP * np.eye(len(free))[:, j, None]) - r) / _STEP for j in range(len(free))], axis=2
        )
        A = np.swapaxes(J, 1, 2) @ J + 1e-12 * np.eye(len(free))
        step = np.linalg.solve(A, np.swapaxes(J, 1, 2) @ r[..., None])[..., 0]
        size = np.abs(step).max(axis=1, keepdims=True)
        q = q - (step * np.minimum(1.0, 0.5 / np.maximum(size, 1e-30))).T
        r = residual(q)
        if size.max() < 1e-12:
            break
    return q, np.linalg.norm(r, axis=1)
