"""The loops of a mechanism along a path: a motion of the passive joints that certainly exists, and is the only one.

On each piece, the passive coordinates are predicted by polynomials through solved states. Around the prediction, a box
is sought that Krawczyk's operator maps into its own inside: with A, the pseudo-inverse of the loops' Jacobian in the
middle of the piece, and J, that Jacobian over the whole box, the image is -A F(prediction) + (1 - A J) box. By the
theorem of Brouwer the box then has one motion of the passive joints with A F = 0, at every moment of the piece, and no
second one.

A mechanism with redundant loops (a planar linkage in space) has more gaps F than passive coordinates. A F = 0 then
means that the passive joints cannot close the loops better near this state; what remains of F is bounded as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.proof.motion.linkage import Linkage, PlacedLinkage, rotation_of
from twin.proof.motion.pieces import OVERLAP
from twin.proof.motion.taylor import TaylorModel, constant, stacked

_ITERATIONS = 6
"""Largest number of Newton steps at the states through which a prediction passes."""

_SOLVED = 1e-13
"""Step in m or rad below which a state is solved."""

_UNIT = 2.0**-53
"""Largest relative rounding error of one operation."""

_BOXES = 4
"""Number of boxes that are tried on a piece."""

_FIRST_BOX = 1e-12
"""Half of the smallest box that is tried, in m or rad."""

_FIRST_FACTOR = 8.0
"""Half of the first box as a multiple of the move from the prediction towards the motion."""

_GROWTH = 3.0
"""Half of the next box as a multiple of the image of the one before, which was not inside it."""

_LARGEST_BOX = 0.1
"""Half of the largest box that is grown to, in m or rad."""

_UNKNOWN_BOX = 1.0
"""Half of a box, in m or rad, on a piece where no finite one is known: it only keeps the arithmetic finite."""

_RATE_STEPS = 8
"""Number of steps in which the bound of the rates' errors approaches one that is mapped into itself."""

_RATE_FACTOR = 1.5
"""Factor by which this bound is increased, so that it certainly is mapped into itself."""

_SMALLEST_RATE = 1e-15
"""Smallest bound of the error of a rate, in m or rad per unit of s."""

_RELATIVE_ZERO = 1e-9
"""Singular values of the loops' Jacobian below this fraction of the largest one count as zero."""

_SMALLEST_DIAGONAL = 1e-12
"""Smallest entry of the diagonal of a triangular matrix that is inverted, in m per m or rad."""

_LARGEST_NORM = 0.9
"""Largest norm |E| with which a determinant is bounded: at 1, its bound is infinite."""

_MARGIN = 1.0 + 1e-12
"""Factor by which bounds are increased, because sums and products of bounds are rounded."""

_ROTATION_ERROR = 64 * _UNIT
"""Bound of the rounding error of a product of two rotations, 1 less, and of its norm."""

_VALUE_ERROR = 64 * _UNIT
"""Relative bound of the rounding of values of the polynomials, and of the full turns that are subtracted."""

Poses = Mapping[str, Array]
"""{body: T_base_body (k, 4, 4)}."""


@dataclass(frozen=True)
class ClosedLinkage:
    """The mechanism on N pieces, with closed loops.

    Attributes:
        placed: the bodies, for all states of the boxes.
        coordinates: (N, m) all coordinates, with their boxes.
        jacobian: (N, rows, passive) Jacobian of the loops over the boxes; None without loops.
        full_jacobian: (N, rows, m) with the driven coordinates; None without loops.
        inverse: (N, passive, rows) the matrices A; None without loops.
        contraction: (N,) bounds of the norm of 1 - A J; 0 without loops. Below 1, the motion is the only one.
        gap: (N,) bounds in m of what remains of the gaps.
        prediction: (N, m) the predicted coordinates.
        balls: {ball joint: its predicted rotation (N, 3, 3)}.
        image: (N, passive) half widths of boxes that contain the motion, in m or rad.
        box: (N, passive) half widths of larger boxes that contain no second motion.
        closed: (N,) whether the motion is proved.
    """

    placed: PlacedLinkage
    coordinates: TaylorModel
    jacobian: TaylorModel | None
    full_jacobian: TaylorModel | None
    inverse: Array | None
    contraction: Array
    gap: Array
    prediction: TaylorModel
    balls: Mapping[str, TaylorModel]
    image: Array
    box: Array
    closed: np.ndarray


def nodes(order: int) -> Array:
    """Return the places (order + 1,) in [-1, 1] of the states through which predictions pass."""
    k = np.arange(order + 1)
    return np.sort(np.cos((k + 0.5) * np.pi / (order + 1)))


def closed_linkage(linkage: Linkage, q: TaylorModel, poses: Poses) -> ClosedLinkage:
    """Return the mechanism on N pieces, at driven coordinates q (N, n).

    Args:
        linkage: the mechanism.
        q: the driven coordinates.
        poses: body poses ((order + 1) N, 4, 4) near those at the nodes, piece by piece; nothing rests on them.
    """
    order = q.order
    count = q.shape[0]
    initial_values, balls = linkage.coordinates_at(poses)
    places = nodes(order)
    powers = places[:, None] ** np.arange(order + 1)
    # the driven coordinates at the nodes, (N, order + 1, n)
    driven = np.einsum("ik,kaj->aij", powers, q.c).reshape(count * len(places), -1)
    values = initial_values.copy()
    values[:, linkage.driven] = driven
    if linkage.closes:
        values, balls = solved(linkage, values, balls)
    to_powers = np.asarray(np.linalg.inv(powers), np.float64)
    values = values.reshape(count, len(places), -1)
    values = _continued(linkage, values)
    c = np.einsum("ki,aij->kaj", to_powers, values)
    c[:, :, linkage.driven] = q.c
    r = np.zeros((count, len(linkage.coordinates)))
    r[:, linkage.driven] = q.r
    prediction = TaylorModel(c, r)
    rotations = {}
    for name, R in balls.items():
        rotations[name] = _ball(R.reshape(count, len(places), 3, 3), to_powers)
    if not linkage.closes:
        placed = linkage.place(prediction, rotations)
        has_no_passive = len(linkage.passive) == 0
        zero = np.zeros(count)
        no_passive = np.zeros((count, len(linkage.passive)))
        return ClosedLinkage(
            placed=placed,
            coordinates=prediction,
            jacobian=None,
            full_jacobian=None,
            inverse=None,
            contraction=zero,
            gap=zero,
            prediction=prediction,
            balls=rotations,
            image=no_passive,
            box=no_passive,
            closed=np.full(count, has_no_passive),
        )
    return enclosed(linkage, prediction, rotations)


def _continued(linkage: Linkage, values: Array) -> Array:
    """Return coordinates (N, nodes, m) whose angles do not jump by full turns from node to node."""
    for i, coordinate in enumerate(linkage.coordinates):
        if coordinate.part == "turn" and not coordinate.active:
            values[:, :, i] = np.unwrap(values[:, :, i], axis=1)
    return values


def _ball(R: Array, to_powers: Array) -> TaylorModel:
    """Return rotations (N, 3, 3) through rotations (N, nodes, 3, 3) at the nodes."""
    quaternions = spatial.quat_from_matrix_wxyz(R.reshape(-1, 3, 3)).reshape(*R.shape[:2], 4)
    # a quaternion and its negative are the same rotation: all on the side of that in the middle
    middle = quaternions[:, R.shape[1] // 2, None]
    signs = np.where((quaternions * middle).sum(axis=2, keepdims=True) < 0, -1.0, 1.0)
    c = np.einsum("ki,aij->kaj", to_powers, quaternions * signs)
    return rotation_of(TaylorModel(c, np.zeros((len(R), 4))))


def solved(
    linkage: Linkage,
    values: Array,
    balls: Mapping[str, Array],
    iterations: int = _ITERATIONS,
    longest: float = np.inf,
) -> tuple[Array, dict[str, Array]]:
    """Return coordinates (k, m) and rotations of balls (k, 3, 3) with closed loops, by Newton's method.

    Args:
        linkage: the mechanism.
        values: coordinates (k, m) to start from; the passive ones are changed in place.
        balls: rotations {ball joint: (k, 3, 3)} to start from.
        iterations: largest number of steps.
        longest: largest change of a coordinate in a step, in m or rad.
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
        steps = -(np.linalg.pinv(jacobian, rcond=_RELATIVE_ZERO) @ gaps[..., None])[..., 0]
        steps = np.clip(steps, -longest, longest)
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
        if np.abs(steps).max(initial=0.0) < _SOLVED:
            break
    return values, rotations


def enclosed(linkage: Linkage, prediction: TaylorModel, balls: Mapping[str, TaylorModel]) -> ClosedLinkage:
    """Return the mechanism with boxes around the predicted coordinates that contain the motion."""
    passive = linkage.passive
    count = prediction.shape[0]
    placed = linkage.place(prediction, balls)
    gaps = linkage.gaps(placed, prediction)
    centre = linkage.jacobian(placed).c[0][:, :, passive]
    is_finite = np.isfinite(centre).all(axis=(1, 2))
    inverse = np.linalg.pinv(np.where(is_finite[:, None, None], centre, 0.0), rcond=_RELATIVE_ZERO)
    move = gaps[..., None].before(inverse)[..., 0].sizes()
    radius = _FIRST_FACTOR * move + _FIRST_BOX
    box = np.zeros((count, len(linkage.coordinates)))
    closed = np.zeros(count, bool)
    image = radius
    contraction = np.full(count, np.inf)
    full = linkage.jacobian(placed)
    for _ in range(_BOXES):
        box[:, passive] = np.where(np.isfinite(radius), radius, _UNKNOWN_BOX)
        inside = prediction.widened(box)
        placed_box = linkage.place(inside, balls)
        full = linkage.jacobian(placed_box)
        product = full[:, :, passive].before(inverse)
        defect = (product - np.eye(len(passive))).sizes()
        spread = (defect @ radius[..., None])[..., 0]
        image = (move + spread) * _MARGIN
        with np.errstate(invalid="ignore", divide="ignore"):
            scaled = spread / radius
        contraction = np.where(np.isfinite(scaled), scaled, np.inf).max(axis=1) * _MARGIN
        closed = is_finite & (image < radius).all(axis=1) & (contraction < 1)
        if closed.all():
            break
        grown = np.where(np.isfinite(image), np.minimum(_GROWTH * image, _LARGEST_BOX), _LARGEST_BOX)
        radius = np.where(closed[:, None], radius, np.maximum(grown, radius))
    # the motion is in the image, which is inside the box
    box[:, passive] = np.where(closed[:, None], np.minimum(image, radius), 0.0)
    coordinates = prediction.widened(box)
    placed = linkage.place(coordinates, balls)
    closed = closed & linkage.aligned(placed)
    full = linkage.jacobian(placed)
    image_gaps = (full[:, :, passive].sizes() @ np.where(closed[:, None], image, 0.0)[..., None])[..., 0]
    gap = np.where(closed, (gaps.sizes() + image_gaps).max(axis=1) * _MARGIN, np.inf)
    return ClosedLinkage(
        placed=placed,
        coordinates=coordinates,
        jacobian=full[:, :, passive],
        full_jacobian=full,
        inverse=inverse,
        contraction=contraction,
        gap=gap,
        prediction=prediction,
        balls=balls,
        image=box[:, passive],
        box=radius,
        closed=closed,
    )


def connected(closed: ClosedLinkage, linkage: Linkage, before: Array, after: Array) -> np.ndarray:
    """Return (N - 1,) whether the motion on each piece goes on in that of the next.

    At the border, the box that contains one motion must be in the box in which the other motion is the only one.

    Args:
        closed: the pieces, in the order of time.
        linkage: the mechanism.
        before: (N,) place of the border with the next piece in each piece, near 1.
        after: (N,) place of the border with the piece before, near -1.
    """
    order = closed.prediction.order
    powers_after = before[:, None] ** np.arange(order + 1)
    powers_before = after[:, None] ** np.arange(order + 1)
    ends = np.einsum("ak,kai->ai", powers_after, closed.prediction.c)[:-1]
    starts = np.einsum("ak,kai->ai", powers_before, closed.prediction.c)[1:]
    difference = ends - starts
    for i, coordinate in enumerate(linkage.coordinates):
        if coordinate.part == "turn":
            # each piece was unwrapped by itself: the same angle may be full turns apart
            turns = np.round(difference[:, i] / (2 * np.pi))
            difference[:, i] -= 2 * np.pi * turns
    distance = np.abs(difference)
    distance = distance[:, linkage.passive]
    for name, R in closed.balls.items():
        R_end = np.einsum("ak,kaij->aij", powers_after, R.c)[:-1]
        R_start = np.einsum("ak,kaij->aij", powers_before, R.c)[1:]
        turn = np.linalg.norm(np.swapaxes(R_start, 1, 2) @ R_end - np.eye(3), axis=(1, 2))
        # a power of x, its product with a coefficient and the sum are rounded at most 2 order + 1 times
        entries = R.r + 2 * (order + 1) * _UNIT * np.abs(R.c).sum(axis=0)
        errors = 1.01 * np.linalg.norm(entries, axis=(1, 2))
        turn = turn + errors[:-1] + errors[1:] + _ROTATION_ERROR
        for column, i in enumerate(linkage.passive):
            if linkage.coordinates[i].joint == name:
                distance[:, column] = 1.1 * turn
    sizes = np.abs(closed.prediction.c).sum(axis=0)[:, linkage.passive]
    distance = distance + _VALUE_ERROR * (sizes[:-1] + sizes[1:])
    # each box that contains a motion, seen from the middle of the other piece's box
    distance_in_piece = distance + 2.0 * closed.image[:-1]
    distance_in_next = distance + 2.0 * closed.image[1:]
    is_inside_next = (distance_in_piece <= closed.box[1:]).all(axis=1)
    is_inside_piece = (distance_in_next <= closed.box[:-1]).all(axis=1)
    is_connected = is_inside_next | is_inside_piece
    return is_connected & closed.closed[:-1] & closed.closed[1:]


def rates(closed: ClosedLinkage, linkage: Linkage, driven: TaylorModel) -> TaylorModel:
    """Return the rates (N, m) of all coordinates, for rates (N, n) of the driven ones; infinite where not closed.

    The passive rates y solve A J y = -A J_driven driven. Around an approximate solution with the remainder e, they lie
    within |A e| / (1 - contraction), in the norm in which 1 - A J contracts.
    """
    count = driven.shape[0]
    order = driven.order
    c = np.zeros((order + 1, count, len(linkage.coordinates)))
    r = np.zeros((count, len(linkage.coordinates)))
    c[:, :, linkage.driven] = driven.c
    r[:, linkage.driven] = driven.r
    if closed.full_jacobian is None or closed.inverse is None or closed.jacobian is None:
        return TaylorModel(c, r)
    right = (closed.full_jacobian[:, :, linkage.driven] @ driven[..., None]).before(closed.inverse)[..., 0]
    product = closed.jacobian.before(closed.inverse)
    # y = -right + (1 - A J) y, repeated: each step is more accurate by a factor, up to the order of the models
    y = -right
    for _ in range(order + 1):
        y = TaylorModel(y.c, np.zeros(y.shape))
        remainder = (product @ y[..., None])[..., 0] + right
        y = TaylorModel((y - remainder).c, np.zeros(y.shape))
    remainder = ((product @ y[..., None])[..., 0] + right).sizes()
    defect = (product - np.eye(len(linkage.passive))).sizes()
    # |error| <= remainder + defect |error|: a vector that this maps into itself is a bound
    bound = remainder
    for _ in range(_RATE_STEPS):
        bound = remainder + (defect @ bound[..., None])[..., 0]
    bound = _RATE_FACTOR * bound + _SMALLEST_RATE
    mapped = (remainder + (defect @ bound[..., None])[..., 0]) * _MARGIN
    proven = np.all(mapped <= bound, axis=1) & closed.closed
    bound = np.where(proven[:, None], bound, np.inf)
    c[:, :, linkage.passive] = y.c
    r[:, linkage.passive] = bound
    return TaylorModel(c, r)


def determinant(closed: ClosedLinkage) -> tuple[TaylorModel, Array] | None:
    """Return the logarithm of the determinant of the loops' Jacobian J: (Taylor models (N,), further error (N,)).

    The determinant is the root of det(J^T J), for square J the absolute value of det J. With a triangular matrix U such
    that J U^-1 is nearly orthogonal, det(J^T J) = det(1 + E) det(U)^2, and |log det(1 + E) - tr E| is at most
    |E|^2 / (2 (1 - |E|)) for the Frobenius norm |E| < 1. None without loops.
    """
    if closed.jacobian is None:
        return None
    J = closed.jacobian
    size = J.shape[-1]
    middle = np.where(np.isfinite(J.c[0]), J.c[0], 0.0)
    upper = np.linalg.qr(middle, mode="r")
    diagonal = np.abs(np.diagonal(upper, axis1=1, axis2=2))
    regular = diagonal.min(axis=1) > _SMALLEST_DIAGONAL
    upper = np.where(regular[:, None, None], upper, np.eye(size))
    inverse = np.triu(np.linalg.inv(upper))
    scaled = J @ inverse
    E = scaled.swapped() @ scaled - np.eye(size)
    norm = np.sqrt((E.sizes() ** 2).sum(axis=(1, 2))) * (1.0 + 1e-12)
    small = regular & closed.closed & (norm < _LARGEST_NORM)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(small, 0.25 * norm**2 / (1.0 - norm) * (1.0 + 1e-9) + 1e-13 * size, np.inf)
    trace = stacked_trace(E) * 0.5
    logs = -np.log(np.abs(np.diagonal(inverse, axis1=1, axis2=2))).sum(axis=1)
    return trace + logs, error


def start_determinant(logs: TaylorModel, error: Array) -> tuple[float, float]:
    """Return bounds of the logarithm of `determinant` at the start, -1 / (1 + OVERLAP) on the first piece."""
    low, high = logs.on_parts(np.asarray(-1.0 + OVERLAP), np.asarray(0.9 * OVERLAP))[0].range()
    if not (np.isfinite(low) and np.isfinite(high) and np.isfinite(error[0])):
        return -np.inf, np.inf
    return float(low - error[0]), float(high + error[0])


def stacked_trace(E: TaylorModel) -> TaylorModel:
    """Return the traces (N,) of matrices (N, n, n)."""
    diagonal = [E[:, i, i] for i in range(E.shape[-1])]
    return stacked(diagonal).total(-1)
