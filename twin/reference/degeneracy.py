"""Degenerate states of a mechanism, at which it can move with its driven joints or its tool at rest.

The mechanism moves along the null space of the loop Jacobian. Driven and passive joints are treated equally, so that
the motion passes singularities as smoothly as other states. At a degenerate state, some motion leaves the driven joints
(type II) or the tool (type I) at rest, or the null space has additional dimensions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.spatial import Array
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise

_RANK = 1e-6
"""Relative size above which a singular value counts for the rank at regular states."""

_PATIENCE = 8
"""Maximum number of iterations to close the loops after a step; a step that needs more iterations is too long."""

KINDS = ("loops", "drives", "tool")
"""Kinds of degeneracy, in the order of the columns of `Degeneracy.of`."""


class Degeneracy:
    """Possible motions of a mechanism, and the distance of its states from degeneracy.

    A redundant mechanism can always move with its tool at rest. Such a motion therefore counts as degenerate only if
    the named points of the bodies are also at rest.

    The position of the tool alone may have as many degrees of freedom as the mechanism (a planar arm with two links, or
    three joints that position a point). A motion then counts as degenerate if the tool's position is at rest, even if
    the tool rotates. For example, a stretched planar arm can still rotate its tool at the limit of its reach.

    Attributes:
        freedom: degrees of freedom of the mechanism at regular states.
        positional: whether the tool's position has as many degrees of freedom as the mechanism.
        length: length in m that is equivalent to a rotation by 1 rad.
        scale: (nv,) step of each velocity coordinate that is equivalent to 1 rad: 1 rad, or `LENGTH_SCALE` in m.
    """

    def __init__(self, model: ReferenceModel, states: Array) -> None:
        """Determine the regular rank of each Jacobian of the model: the largest rank at the given states (k, nq)."""
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
        """Return the distances (k, 3) from degeneracy: about 1 at usual states, 0 at a degenerate state.

        Columns: additional dimensions of the null space, driven joints at rest (type II), tool at rest (type I).
        """
        values = self._raw(states)[1]
        columns = [
            v[:, i] / u if v.size else np.ones(len(states))
            for v, i, u in zip(values, self._at, self._usual, strict=True)
        ]
        return np.stack(columns, axis=1)

    def motions(self, states: Array) -> Array:
        """Return tangent steps (k, nv, freedom) in rad and m that keep the loops closed.

        Divided by `scale`, the steps of a state are orthonormal.
        """
        return self._raw(states, motions_only=True)[0]

    def tool(self, states: Array) -> Array:
        """Return tool twists (k, 6, freedom) in base for `motions`: linear in `LENGTH_SCALE`, then angular in rad."""
        return self._jacobians(states)[1][:, :6] @ (self.motions(states) / self.scale[:, None])

    def moved(self, states: Array, steps: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) after tangent steps (k, nv), (k,) bool: whether the loops could be closed again)."""
        tree, loops_only = self.model.tree, self.model.loops_only
        there, closed = minimise(tree, tree.integrate(states, steps), loops_only, np.arange(tree.model.nv), _PATIENCE)
        return there, np.asarray(closed, bool)

    def _jacobians(self, states: Array) -> tuple[Array, Array, Array]:
        """Return (scaled loop Jacobians (k, m, nv), scaled Jacobians (k, n, nv) of tool and points, joint poses)."""
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
