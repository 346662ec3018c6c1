"""The loops of a mechanism along a path: a motion of the passive joints that certainly exists, and is the only one.

Around the predicted coordinates of each piece, a box is sought that Krawczyk's operator maps into its own inside: with
A, the pseudo-inverse of the loops' Jacobian in the middle of the piece, and J, that Jacobian over the whole box, the
image is -A F(prediction) + (1 - A J) box. By the theorem of Brouwer the box then has one motion of the passive joints
with A F = 0, at every moment of the piece, and no second one.

A mechanism with redundant loops (a planar linkage in space) has more gaps F than passive coordinates. A F = 0 then
means that the passive joints cannot close the loops better near this state; what remains of F is bounded as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.proof.motion.linkage import Linkage, PlacedLinkage
from twin.proof.motion.prediction import RELATIVE_ZERO, Poses, predicted
from twin.proof.motion.taylor import TaylorModel
from twin.proof.rounding import UNIT_ROUNDOFF

MARGIN = 1.0 + 1e-12
"""Factor by which bounds are increased, because sums and products of bounds are rounded."""

_MOST_BOXES = 4
"""Number of boxes that are tried on a piece."""

_SMALLEST_BOX = 1e-12
"""Half of the smallest box that is tried, in m or rad."""

_FIRST_BOX_FACTOR = 8.0
"""Half of the first box as a multiple of the move from the prediction towards the motion."""

_GROWTH = 3.0
"""Half of the next box as a multiple of the image of the one before, which was not inside it."""

_LARGEST_BOX = 0.1
"""Half of the largest box that is grown to, in m or rad."""

_UNKNOWN_BOX = 1.0
"""Half of a box, in m or rad, on a piece where no finite one is known: it only keeps the arithmetic finite."""

_TURN_ERROR = 64 * UNIT_ROUNDOFF
"""Bound of the rounding error of a product of two rotations, 1 less, and of its norm."""

_BORDER_VALUE_ERROR = 64 * UNIT_ROUNDOFF
"""Relative bound of the rounding of values of the polynomials, and of the full turns that are subtracted."""

_ROTATION_NORM = 1.01
"""Factor of the error of a rotation in a product with another one, whose norm is 1 but for its own error."""

_TURN_TO_COORDINATES = 1.1
"""Largest change of a turn z, y or x of a ball by a rotation B before it, as a multiple of the norm |B - 1|.

With the angle b of B, the norm is 2 sqrt(2) sin(b / 2) and the change at most b / cos(y): the factor is large enough
for b up to 1 rad in boxes of y up to 0.8 rad. Such boxes are far larger than those in which loops are proved closed.
"""

_MOTION_FACTOR = 2.0
"""Multiple of the half widths of the motion's box that must fit into the other box: 1, and room for rounding."""


@dataclass(frozen=True)
class ClosedLinkage:
    """The mechanism on N pieces, with closed loops.

    Attributes:
        placed: the bodies, for all states of the boxes.
        coordinates: (N, m) all coordinates, with their boxes.
        jacobian: (N, rows, passive) Jacobian of the loops over the boxes; None without loops.
        full_jacobian: (N, rows, m) with the driven coordinates; None without loops.
        inverse: (N, passive, rows) the matrices A; None without loops.
        gap: (N,) bounds in m of what remains of the gaps.
        prediction: (N, m) the predicted coordinates.
        balls: {ball joint: its predicted rotation (N, 3, 3)}.
        motion_box: (N, passive) half widths of boxes that contain the motion, in m or rad.
        unique_box: (N, passive) half widths of larger boxes that contain no second motion.
        closed: (N,) whether the motion is proved.
    """

    placed: PlacedLinkage
    coordinates: TaylorModel
    jacobian: TaylorModel | None
    full_jacobian: TaylorModel | None
    inverse: Array | None
    gap: Array
    prediction: TaylorModel
    balls: Mapping[str, TaylorModel]
    motion_box: Array
    unique_box: Array
    closed: np.ndarray


def closed_linkage(linkage: Linkage, q: TaylorModel, poses: Poses) -> ClosedLinkage:
    """Return the mechanism on N pieces, at driven coordinates q (N, n).

    Args:
        linkage: the mechanism.
        q: the driven coordinates.
        poses: body poses ((order + 1) N, 4, 4) near those at the nodes, piece by piece; nothing rests on them.
    """
    prediction, balls = predicted(linkage, q, poses)
    if linkage.closes:
        return enclosed(linkage, prediction, balls)
    count = q.shape[0]
    no_box = np.zeros((count, len(linkage.passive)))
    return ClosedLinkage(
        placed=linkage.place(prediction, balls),
        coordinates=prediction,
        jacobian=None,
        full_jacobian=None,
        inverse=None,
        gap=np.zeros(count),
        prediction=prediction,
        balls=balls,
        motion_box=no_box,
        unique_box=no_box,
        closed=np.full(count, len(linkage.passive) == 0),  # a passive joint outside of loops could move in any way
    )


def enclosed(linkage: Linkage, prediction: TaylorModel, balls: Mapping[str, TaylorModel]) -> ClosedLinkage:
    """Return the mechanism with boxes around the predicted coordinates that contain the motion.

    Args:
        linkage: a mechanism with loops or couplings.
        prediction: (N, m) the predicted coordinates.
        balls: {ball joint: its predicted rotation (N, 3, 3)}.
    """
    passive = linkage.passive
    predicted_place = linkage.place(prediction, balls)
    gaps = linkage.gaps(predicted_place, prediction)
    middle = linkage.jacobian(predicted_place).c[0][:, :, passive]
    is_finite = np.isfinite(middle).all(axis=(1, 2))
    inverse = np.linalg.pinv(np.where(is_finite[:, None, None], middle, 0.0), rcond=RELATIVE_ZERO)
    move = gaps[..., None].before(inverse)[..., 0].sizes()  # |A F(prediction)|
    image, box, is_proved = _krawczyk_boxes(linkage, prediction, balls, inverse, move)
    is_proved &= is_finite
    # the motion is in the image, which is inside the box
    motion_box = np.where(is_proved[:, None], image, 0.0)
    coordinates = _widened(linkage, prediction, motion_box)
    placed = linkage.place(coordinates, balls)
    closed = is_proved & linkage.aligned(placed)
    jacobian = linkage.jacobian(placed)
    gap_change = (jacobian[:, :, passive].sizes() @ np.where(closed[:, None], image, 0.0)[..., None])[..., 0]
    gap = np.where(closed, (gaps.sizes() + gap_change).max(axis=1) * MARGIN, np.inf)
    return ClosedLinkage(
        placed=placed,
        coordinates=coordinates,
        jacobian=jacobian[:, :, passive],
        full_jacobian=jacobian,
        inverse=inverse,
        gap=gap,
        prediction=prediction,
        balls=balls,
        motion_box=motion_box,
        unique_box=box,
        closed=closed,
    )


def _krawczyk_boxes(
    linkage: Linkage, prediction: TaylorModel, balls: Mapping[str, TaylorModel], inverse: Array, move: Array
) -> tuple[Array, Array, np.ndarray]:
    """Return (image (N, passive), box (N, passive), whether the image is inside the box (N,)); both as half widths.

    Args:
        linkage: the mechanism.
        prediction: see `enclosed`.
        balls: see `enclosed`.
        inverse: (N, passive, rows) the matrices A.
        move: (N, passive) bounds of A F at the prediction.
    """
    box = _FIRST_BOX_FACTOR * move + _SMALLEST_BOX
    image = box
    is_inside = np.zeros(len(box), bool)
    for _ in range(_MOST_BOXES):
        finite_box = np.where(np.isfinite(box), box, _UNKNOWN_BOX)
        placed = linkage.place(_widened(linkage, prediction, finite_box), balls)
        product = linkage.jacobian(placed)[:, :, linkage.passive].before(inverse)
        defect = (product - np.eye(len(linkage.passive))).sizes()  # |1 - A J|
        spread = (defect @ box[..., None])[..., 0]
        image = (move + spread) * MARGIN
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = spread / box
        # norm of 1 - A J, with lengths measured by the box: below 1, there is no second motion
        contraction = np.where(np.isfinite(ratios), ratios, np.inf).max(axis=1) * MARGIN
        is_inside = (image < box).all(axis=1) & (contraction < 1)
        if is_inside.all():
            break
        grown = np.where(np.isfinite(image), np.minimum(_GROWTH * image, _LARGEST_BOX), _LARGEST_BOX)
        box = np.where(is_inside[:, None], box, np.maximum(grown, box))
    return image, box, is_inside


def _widened(linkage: Linkage, prediction: TaylorModel, box: Array) -> TaylorModel:
    """Return predicted coordinates (N, m) with boxes of half widths (N, passive) around the passive ones."""
    radius = np.zeros(prediction.shape)
    radius[:, linkage.passive] = box
    return prediction.widened(radius)


def connected(closed: ClosedLinkage, linkage: Linkage, ends: Array, starts: Array) -> np.ndarray:
    """Return (N - 1,) whether the motion on each piece goes on in that of the next.

    At the border, the box that contains one motion must be in the box in which the other motion is the only one.

    Args:
        closed: the pieces, in the order of time.
        linkage: the mechanism.
        ends: (N,) place of the border with the next piece in each piece, near 1.
        starts: (N,) place of the border with the piece before, near -1.
    """
    exponents = np.arange(closed.prediction.order + 1)
    powers_at_end = ends[:, None] ** exponents
    powers_at_start = starts[:, None] ** exponents
    at_end = np.einsum("ak,kai->ai", powers_at_end, closed.prediction.c)[:-1]
    at_start = np.einsum("ak,kai->ai", powers_at_start, closed.prediction.c)[1:]
    difference = at_end - at_start
    for i, coordinate in enumerate(linkage.coordinates):
        if coordinate.part == "turn":
            # each piece was unwrapped by itself: the same angle may be full turns apart
            turns = np.round(difference[:, i] / (2 * np.pi))
            difference[:, i] -= 2 * np.pi * turns
    distance = np.abs(difference)[:, linkage.passive]
    for name, R in closed.balls.items():
        turn = _turns_at_borders(R, powers_at_end, powers_at_start)
        for column, i in enumerate(linkage.passive):
            if linkage.coordinates[i].joint == name:
                distance[:, column] = _TURN_TO_COORDINATES * turn
    sizes = np.abs(closed.prediction.c).sum(axis=0)[:, linkage.passive]
    distance = distance + _BORDER_VALUE_ERROR * (sizes[:-1] + sizes[1:])
    # how far from the prediction of the other piece the motion of a piece may be
    reach_in_next = distance + _MOTION_FACTOR * closed.motion_box[:-1]
    reach_in_piece = distance + _MOTION_FACTOR * closed.motion_box[1:]
    is_inside_next = (reach_in_next <= closed.unique_box[1:]).all(axis=1)
    is_inside_piece = (reach_in_piece <= closed.unique_box[:-1]).all(axis=1)
    is_connected = is_inside_next | is_inside_piece
    return is_connected & closed.closed[:-1] & closed.closed[1:]


def _turns_at_borders(R: TaylorModel, powers_at_end: Array, powers_at_start: Array) -> Array:
    """Return bounds (N - 1,) of |B - 1|, in the Frobenius norm, for the rotation B between predictions at a border.

    Args:
        R: (N, 3, 3) predicted rotations of a ball.
        powers_at_end: (N, order + 1) powers of the place of the border with the next piece.
        powers_at_start: (N, order + 1) powers of the place of the border with the piece before.
    """
    R_end = np.einsum("ak,kaij->aij", powers_at_end, R.c)[:-1]
    R_start = np.einsum("ak,kaij->aij", powers_at_start, R.c)[1:]
    turn = np.linalg.norm(np.swapaxes(R_start, 1, 2) @ R_end - np.eye(3), axis=(1, 2))
    # a power of x, its product with a coefficient and the sum are rounded at most 2 order + 1 times
    entries = R.r + 2 * (R.order + 1) * UNIT_ROUNDOFF * np.abs(R.c).sum(axis=0)
    errors = _ROTATION_NORM * np.linalg.norm(entries, axis=(1, 2))
    return turn + errors[:-1] + errors[1:] + _TURN_ERROR
