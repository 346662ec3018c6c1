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

_RANK_TOLERANCE = 1e-6
"""Relative size above which a singular value counts for the rank at regular states."""

_MOST_CLOSING_STEPS = 8
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
        tree = model.tree
        self.model = model
        self.length = LENGTH_SCALE
        self.scale = np.ones(tree.model.nv)
        for joint in tree.model.joints[1:]:
            kind = joint.shortname()
            if "PZ" in kind:
                self.scale[joint.idx_v] = LENGTH_SCALE
            elif "FreeFlyer" in kind:
                self.scale[joint.idx_v : joint.idx_v + 3] = LENGTH_SCALE
        A, _, _ = self._jacobians(states)
        self.freedom = tree.model.nv - _regular_rank(_values(A), 1e-9)
        tool = self.tool(states)
        positions = tool[:, :3]
        self.positional = _regular_rank(_values(positions), _RANK_TOLERANCE) == self.freedom
        _, values = self._motions_and_values(states)
        # the singular value that vanishes first at a degenerate state: the smallest one that is regularly not 0
        self._critical_column: list[int] = []
        self._usual_value: list[float] = []
        for s in values:
            last = max(_regular_rank(s, _RANK_TOLERANCE) - 1, 0)
            usual = 1.0
            if s.size:
                usual = float(np.median(s[:, last]))
            self._critical_column.append(last)
            self._usual_value.append(usual)

    def of(self, states: Array) -> Array:
        """Return the distances (k, 3) from degeneracy: about 1 at usual states, 0 at a degenerate state.

        Columns: additional dimensions of the null space, driven joints at rest (type II), tool at rest (type I).
        """
        _, values = self._motions_and_values(states)
        columns = []
        for s, last, usual in zip(values, self._critical_column, self._usual_value, strict=True):
            distance = np.ones(len(states))
            if s.size:
                distance = s[:, last] / usual
            columns.append(distance)
        return np.stack(columns, axis=1)

    def motions(self, states: Array) -> Array:
        """Return tangent steps (k, nv, freedom) in rad and m that keep the loops closed.

        Divided by `scale`, the steps of a state are orthonormal.
        """
        steps, _ = self._motions_and_values(states, motions_only=True)
        return steps

    def tool(self, states: Array) -> Array:
        """Return tool twists (k, 6, freedom) in base for `motions`: linear in `LENGTH_SCALE`, then angular in rad."""
        _, output, _ = self._jacobians(states)
        scaled = self.motions(states) / self.scale[:, None]
        return output[:, :6] @ scaled

    def moved(self, states: Array, steps: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) after tangent steps (k, nv), (k,) bool: whether the loops could be closed again)."""
        tree = self.model.tree
        every = np.arange(tree.model.nv)
        starts = tree.integrate(states, steps)
        ends, closed = minimise(tree, starts, self.model.loops_only, every, _MOST_CLOSING_STEPS)
        return ends, np.asarray(closed, bool)

    def _jacobians(self, states: Array) -> tuple[Array, Array, Array]:
        """Return (scaled loop Jacobians (k, m, nv), scaled Jacobians (k, n, nv) of tool and points, joint poses)."""
        tree = self.model.tree
        poses, J = tree.update(states, closing_only=True)
        _, A = tree.loops.evaluate(states, poses, J)
        tool = tree.tool_jacobian(poses, J)
        rows = [tool[:, :3] / LENGTH_SCALE, tool[:, 3:]]
        if self.model.redundant:
            # the tool alone does not show whether a redundant mechanism moves: its named points do
            for point in self.model.mechanism.points:
                number, T_joint_body = tree.body(point.body)
                Ts_base_body = poses[:, number] @ T_joint_body
                p = (Ts_base_body @ np.append(point.p_body, 1.0))[:, :3]
                twist = J * tree.moves(number)
                velocity = twist[:, :3] - spatial.hat(p) @ twist[:, 3:]
                rows.append(velocity / LENGTH_SCALE)
        output = np.concatenate(rows, axis=1)
        return A * self.scale, output * self.scale, poses

    def _motions_and_values(self, states: Array, motions_only: bool = False) -> tuple[Array, list[Array]]:
        """Return the `motions`, and the singular values (k, n) of loops, drives and tool along these motions."""
        A, output, _ = self._jacobians(states)
        nv = A.shape[2]
        rank = nv - self.freedom
        if A.shape[1]:
            _, s, Vt = np.linalg.svd(A)
            N = np.swapaxes(Vt[:, rank:], 1, 2)
            loops = s[:, :rank] / s[:, :1]
        else:
            N = np.tile(np.eye(nv), (len(states), 1, 1))
            loops = np.zeros((len(states), 0))
        steps = self.scale[:, None] * N
        if motions_only:
            return steps, []
        tool = output
        if self.positional:
            tool = output[:, :3]
        drives = N[:, self.model.tree.active]
        return steps, [loops, _values(drives), _values(tool @ N)]


def _values(A: Array) -> Array:
    """Return the singular values (k, n) of matrices A (k, m, nv)."""
    if not A.shape[1]:
        return np.zeros((len(A), 0))
    s = np.linalg.svd(A, compute_uv=False)
    return np.asarray(s, float)


def _regular_rank(s: Array, flat: float) -> int:
    """Return the largest rank at the states, from singular values s (k, n); values below `flat` of the first are 0."""
    if not s.size:
        return 0
    ranks = np.sum(s > flat * s[:, :1], axis=1)
    return int(ranks.max())
