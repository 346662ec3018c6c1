"""Predictions of a mechanism with loops on pieces of a path: polynomials through states solved by Newton's method.

Nothing rests on them: `closure` proves how near the motion is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.proof.motion.linkage import Linkage, rotation_of
from twin.proof.motion.taylor import TaylorModel, constant

RELATIVE_ZERO = 1e-9
"""Singular values of the loops' Jacobian below this fraction of the largest one count as zero."""

_ITERATIONS = 6
"""Largest number of Newton steps at the states through which a prediction passes."""

_LAST_STEP = 1e-13
"""Step in m or rad below which a state is solved."""

Poses = Mapping[str, Array]
"""{body: T_base_body (k, 4, 4)}."""


def chebyshev_nodes(order: int) -> Array:
    """Return the nodes (order + 1,) in [-1, 1] of the states through which predictions pass."""
    k = np.arange(order + 1)
    return np.sort(np.cos((k + 0.5) * np.pi / (order + 1)))


def predicted(linkage: Linkage, q: TaylorModel, poses: Poses) -> tuple[TaylorModel, dict[str, TaylorModel]]:
    """Return (all coordinates (N, m), {ball joint: its rotation (N, 3, 3)}) on N pieces, as polynomials.

    Args:
        linkage: the mechanism.
        q: the driven coordinates (N, n), which are kept with their bounds.
        poses: body poses ((order + 1) N, 4, 4) near those at the nodes, piece by piece.
    """
    order = q.order
    count = q.shape[0]
    values, balls = linkage.coordinates_at(poses)
    nodes = chebyshev_nodes(order)
    powers = nodes[:, None] ** np.arange(order + 1)
    driven_at_nodes = np.einsum("ik,kaj->aij", powers, q.c)  # (N, order + 1, n)
    values[:, linkage.driven] = driven_at_nodes.reshape(count * len(nodes), -1)
    if linkage.closes:
        values, balls = solved(linkage, values, balls)
    to_coefficients = np.asarray(np.linalg.inv(powers), np.float64)
    values = values.reshape(count, len(nodes), -1)
    values = _without_jumps(linkage, values)
    c = np.einsum("ki,aij->kaj", to_coefficients, values)
    c[:, :, linkage.driven] = q.c
    r = np.zeros((count, len(linkage.coordinates)))
    r[:, linkage.driven] = q.r
    rotations = {}
    for name, R in balls.items():
        rotations[name] = _rotation_through(R.reshape(count, len(nodes), 3, 3), to_coefficients)
    return TaylorModel(c, r), rotations


def _without_jumps(linkage: Linkage, values: Array) -> Array:
    """Return coordinates (N, nodes, m) whose passive angles do not jump by full turns from node to node."""
    for i, coordinate in enumerate(linkage.coordinates):
        if coordinate.part == "turn" and not coordinate.active:
            values[:, :, i] = np.unwrap(values[:, :, i], axis=1)
    return values


def _rotation_through(R: Array, to_coefficients: Array) -> TaylorModel:
    """Return rotations (N, 3, 3) through rotations (N, nodes, 3, 3) at the nodes."""
    quaternions = spatial.quat_from_matrix_wxyz(R.reshape(-1, 3, 3)).reshape(*R.shape[:2], 4)
    # a quaternion and its negative are the same rotation: all on the side of that in the middle
    middle = quaternions[:, R.shape[1] // 2, None]
    signs = np.where((quaternions * middle).sum(axis=2, keepdims=True) < 0, -1.0, 1.0)
    c = np.einsum("ki,aij->kaj", to_coefficients, quaternions * signs)
    return rotation_of(TaylorModel(c, np.zeros((len(R), 4))))


def solved(
    linkage: Linkage,
    values: Array,
    balls: Mapping[str, Array],
    iterations: int = _ITERATIONS,
    longest_step: float = np.inf,
) -> tuple[Array, dict[str, Array]]:
    """Return coordinates (k, m) and rotations of balls (k, 3, 3) with closed loops, by Newton's method.

    Args:
        linkage: the mechanism.
        values: coordinates (k, m) to start from; the passive ones are changed in place.
        balls: rotations {ball joint: (k, 3, 3)} to start from.
        iterations: largest number of steps.
        longest_step: largest change of a coordinate in a step, in m or rad.
    """
    rotations = dict(balls)
    passive = linkage.passive
    for _ in range(iterations):
        model = constant(values, 0)
        ball_models = {name: constant(R, 0) for name, R in rotations.items()}
        placed = linkage.place(model, ball_models)
        gaps = linkage.gaps(placed, model).c[0]
        jacobian = linkage.jacobian(placed).c[0][:, :, passive]
        if not (np.isfinite(gaps).all() and np.isfinite(jacobian).all()):
            break
        steps = -(np.linalg.pinv(jacobian, rcond=RELATIVE_ZERO) @ gaps[..., None])[..., 0]
        steps = np.clip(steps, -longest_step, longest_step)
        turns: dict[str, Array] = {}
        for column, i in enumerate(passive):
            coordinate = linkage.coordinates[i]
            if coordinate.part in ("turn", "slide"):
                values[:, i] += steps[:, column]
            else:
                turn = turns.setdefault(coordinate.joint, np.zeros((len(values), 3)))
                turn[:, "xyz".index(coordinate.part)] = steps[:, column]
        for name, turn in turns.items():
            rotations[name] = rotations[name] @ spatial.exp_so3(turn)
        if np.abs(steps).max(initial=0.0) < _LAST_STEP:
            break
    return values, rotations
