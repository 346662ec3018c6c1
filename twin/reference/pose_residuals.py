"""Residuals of loop closures, alone or with the tool pose: of the full pose, or of some directions."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.reference.loops import LENGTH_SCALE, sine_of_rotation
from twin.reference.newton import Residual
from twin.reference.tree import Tree

ALL = np.ones(6, bool)
"""All six directions."""


def loops_only(tree: Tree) -> Residual:
    """Return the residual function of the loops alone, for any pose of the tool."""

    def residual(X: Array, _: Index) -> tuple[Array, Array]:
        poses, J = tree.update(X, closing_only=True)
        return tree.loops.evaluate(X, poses, J)

    return residual


def posed(tree: Tree, Ts: Array, directions: np.ndarray = ALL, p_tool: Array | None = None) -> Residual:
    """Return the residual function of the loops and of the tool's deviation from its target poses.

    Ts (k, 4, 4) are the target poses. `directions` (6,) marks the directions that must agree: first along, then about
    the axes of base. `p_tool` (3,) in m is the compared point in the tool frame; None: the origin of the tool.
    """
    Rt = np.swapaxes(Ts[:, :3, :3], 1, 2)
    lever = p_tool
    if lever is None:
        lever = np.zeros(3)
    goal = Ts[:, :3, 3] + Ts[:, :3, :3] @ lever

    def residual(X: Array, rows: Index) -> tuple[Array, Array]:
        poses, J = tree.update(X, closing_only=True)
        r, A = tree.loops.evaluate(X, poses, J)
        T = tree.tool(poses)
        R = T[:, :3, :3]
        J_tool = tree.tool_jacobian(poses, J)
        angular = J_tool[:, 3:]
        sine, turn = sine_of_rotation(R @ Rt[rows])
        arm = R @ lever
        shift = T[:, :3, 3] + arm - goal[rows]
        J_point = J_tool[:, :3] - spatial.hat(arm) @ angular
        deviation = np.concatenate([shift, LENGTH_SCALE * sine], axis=1)
        rate = np.concatenate([J_point, LENGTH_SCALE * turn @ angular], axis=1)
        r = np.concatenate([r, deviation[:, directions]], axis=1)
        A = np.concatenate([A, rate[:, directions]], axis=1)
        return r, A

    return residual
