"""Residual of loop closures and tool pose, for the full pose or for some directions."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.reference.loops import LENGTH_SCALE, sine_of_rotation
from twin.reference.newton import Residual
from twin.reference.tree import Tree

ALL = np.ones(6, bool)
"""All six directions."""


def posed(tree: Tree, Ts: Array, directions: np.ndarray = ALL, p_tool: Array | None = None) -> Residual:
    """Return the residual function of the loops and of the tool's deviation from its target poses.

    Ts (k, 4, 4) are the target poses. `directions` (6,) marks the directions that must agree: first along, then about
    the axes of base. `p_tool` (3,) in m is the compared point in the tool frame; None: the origin of the tool.
    """
    Rt = np.swapaxes(Ts[:, :3, :3], 1, 2)
    lever = np.zeros(3) if p_tool is None else p_tool
    goal = Ts[:, :3, 3] + Ts[:, :3, :3] @ lever

    def residual(X: Array, rows: Index) -> tuple[Array, Array]:
        poses, J = tree.update(X, closing_only=True)
        r, A = tree.loops.evaluate(X, poses, J)
        T, J_tool = tree.tool(poses), tree.tool_jacobian(poses, J)
        sine, turn = sine_of_rotation(T[:, :3, :3] @ Rt[rows])
        arm = T[:, :3, :3] @ lever
        J_point = J_tool[:, :3] - spatial.hat(arm) @ J_tool[:, 3:]
        off = np.concatenate([T[:, :3, 3] + arm - goal[rows], LENGTH_SCALE * sine], axis=1)
        rate = np.concatenate([J_point, LENGTH_SCALE * turn @ J_tool[:, 3:]], axis=1)
        return np.concatenate([r, off[:, directions]], axis=1), np.concatenate([A, rate[:, directions]], axis=1)

    return residual
