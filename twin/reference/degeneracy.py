"""Degenerate states of a mechanism: motions that leave the drives or the tool at rest, or additional motions.

A state moves along the null space of the loop Jacobian, drives and passive joints alike, so that singularities are
crossed as smoothly as any other state. At a degenerate state some motion leaves the drives (type 2) or the tool (type
1) at rest, or the null space is larger.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise

_RANK = 1e-6
"""Singular value relative to the largest above which it counts for the rank at regular states."""

_PATIENCE = 8
"""Maximum iterations to close the loops after a step: a step that needs more is too long."""

KINDS = ("loops", "drives", "tool")
"""Kinds of degeneracy; the columns of `Degeneracy.of`."""


class Degeneracy:
    """The motions of a mechanism and their degeneracy.

    A redundant mechanism (more freedoms than a pose takes) always moves with its tool at rest; there the named points
    of its bodies must rest as well.

    Where the position of the tool has as many directions as the mechanism has freedoms (an arm of two bars in a plane,
    three joints that carry a point), the position is what the tool is for: it may not rest, though the tool turns on.
    A planar arm that is stretched can still turn its hand, and is at the end of its reach all the same.

    Attributes:
        freedom: of the mechanism, at regular states.
        positional: whether its positions have as many directions.
        length: what a slide counts as much as a turn by 1 rad, in m.
        scale: (nv,) what counts as much as a turn by 1 rad: that, or a slide by `LENGTH_SCALE`.
    """

    def __init__(self, model: ReferenceModel, states: Array) -> None:
        """Find the regular rank of each Jacobian of the model: its largest rank at the given states (k, nq)."""
        self.model, tree = model, model.tree
        self.length = LENGTH_SCALE
        self.scale = np.ones(tree.model.nv)
        for joint in tree.model.joints[1:]:
            kind = joint.shortname()
            if "PZ" in kind:
                self.scale[joint.idx_v] = LENGTH_SCALE
            elif "FreeFlyer" in kind:
                self.scale[joint.idx_v : joint.idx_v + 3] = LENGTH_SCALE
        A, _, _ = self._jacobians(states)
        rank = int(np.max(_ranks(_values(A), 1e-9), initial=0))
        self.freedom = tree.model.nv - rank
        self.positional = bool(np.max(_ranks(_values(self.tool(states)[:, :3]), _RANK), initial=0) == self.freedom)
        values = self._raw(states)[1]
        self._at = [max(int(np.max(_ranks(v, _RANK), initial=0)) - 1, 0) for v in values]
        self._usual = [float(np.median(v[:, i])) if v.size else 1.0 for v, i in zip(values, self._at, strict=True)]

    def of(self, states: Array) -> Array:
        """Return (k, 3): distance from each kind of degeneracy, 1 at usual states, 0 at a degenerate one."""
        values = self._raw(states)[1]
        columns = [
            v[:, i] / u if v.size else np.ones(len(states))
            for v, i, u in zip(values, self._at, self._usual, strict=True)
        ]
        return np.stack(columns, axis=1)

    def motions(self, states: Array) -> Array:
        """Return (k, nv, freedom): the tangent steps that keep the loops closed, slides in tenths of a metre."""
        return self._raw(states, motions_only=True)[0]

    def tool(self, states: Array) -> Array:
        """Return the tool's twists (k, 6, freedom) in base along the motions, linear first, in tenths of a metre."""
        return self._jacobians(states)[1][:, :6] @ (self.motions(states) / self.scale[:, None])

    def moved(self, states: Array, steps: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) after tangent steps (k, nv) with loops closed again, whether (k,) they closed)."""
        tree = self.model.tree

        def residual(X: Array, _: Index) -> tuple[Array, Array]:
            return tree.loops.evaluate(X, *tree.update(X, closing_only=True))

        there, closed = minimise(tree, tree.integrate(states, steps), residual, np.arange(tree.model.nv), _PATIENCE)
        return there, np.asarray(closed, bool)

    def _jacobians(self, states: Array) -> tuple[Array, Array, Array]:
        """Return scaled Jacobians of the loops (k, m, nv) and of tool and points (k, n, nv), and poses."""
        tree = self.model.tree
        poses, J = tree.update(states, closing_only=True)
        A = tree.loops.evaluate(states, poses, J)[1] * self.scale
        tool = tree.tool_jacobian(poses, J)
        rows = [tool[:, :3] / LENGTH_SCALE, tool[:, 3:]]
        for point in self.model.mechanism.points if self.model.redundant else ():
            number, T = tree.body(point.body)
            p = (poses[:, number] @ T @ np.append(point.p_body, 1.0))[:, :3]
            own = J * tree.moves(number)
            rows.append((own[:, :3] - spatial.hat(p) @ own[:, 3:]) / LENGTH_SCALE)
        return A, np.concatenate(rows, axis=1) * self.scale, poses

    def _raw(self, states: Array, motions_only: bool = False) -> tuple[Array, list[Array]]:
        A, output, _ = self._jacobians(states)
        nv = A.shape[2]
        if A.shape[1]:
            _, s, Vt = np.linalg.svd(A)
            N = np.swapaxes(Vt[:, nv - self.freedom :], 1, 2)
            loops = s[:, : nv - self.freedom] / s[:, :1]
        else:
            N, loops = np.tile(np.eye(nv), (len(states), 1, 1)), np.zeros((len(states), 0))
        steps = self.scale[:, None] * N
        if motions_only:
            return steps, []
        tool = output[:, :3] if self.positional else output
        return steps, [loops, _values(N[:, self.model.tree.active]), _values(tool @ N)]


def _values(A: Array) -> Array:
    return np.asarray(np.linalg.svd(A, compute_uv=False), float) if A.shape[1] else np.zeros((len(A), 0))


def _ranks(s: Array, flat: float) -> Array:
    return np.sum(s > flat * s[:, :1], axis=1) if s.shape[1] else np.zeros(len(s))
