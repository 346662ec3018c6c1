"""Audit a certificate of `twin prove --workspace`: Newton's method closes the loops at random points of its boxes.

The certificate is a JSON object with these entries, lengths in m and angles in rad:

    joints        names of the joints, in the order of joint values
    active        for each joint, whether it is driven
    orientation   R_base_tool (3, 3), the same at all points
    boxes         [lower corner (3,), upper corner (3,), joint values near the middle] of each box of tool positions
    closures      the joints that close loops: {type, cone: half angle or null, paths: [path, path]}
      path        {from_tool: whether it begins at the tool, else at the base; steps: [step, ...]}
      step        ["frame" or "inverse", first three rows of a pose], or ["turn" or "slide", number of the joint, sign]
    limits        {weights: {joint: weight}, least: minimum of the sum of weight * joint value}
    tolerance_m   by how much each coordinate of each frame may be off; 0: the lengths are those of the CAD alone

That the points hold is no proof of the boxes; `docs/check_workspace.py` proves points again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.core.json_types import JsonMapping
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.stated_closures import AxisCosine, Numbers, Reals, StatedClosures, stated_closures

SCHEMA = "twin/workspace-certificate/1"

POINTS = 1000
"""Number of random points."""

CLOSED = 1e-9
"""Largest gap of a loop in m, or as a sine; also the part in m or rad by which a limit may be exceeded."""

_MIN_SINGULAR_VALUE = 1e-9
"""Smallest singular value, in m or without unit, of derivatives that are regular."""

_NEWTON_STEPS = 10
"""Number of Newton steps, each of which doubles the number of right digits."""

_MAX_PREDICTION_ERROR = 1.0
"""Largest distance in m or rad of joint values from those of the certificate, which only predict them."""


def audit_workspace(data: JsonMapping, ledger: Ledger) -> None:
    """Add a row for each kind of condition, and a finding for each that does not hold at a point.

    Raises:
        ValueError, KeyError, TypeError, IndexError: the certificate was changed.
    """
    generator = np.random.default_rng()  # no point that the author of a certificate could foresee
    points, predicted = _random_points(data, generator)
    tolerance = float(data["tolerance_m"])
    if not 0 <= tolerance < math.inf:
        raise ValueError(f"the tolerance of lengths is {tolerance} m")
    closures = stated_closures(data)
    _audit_points(data, closures, ledger, points, predicted)
    if tolerance:
        independent = _independent_conditions(data, closures, points, predicted)
        displaced = closures.displaced(tolerance, POINTS, generator)
        gap = closures.largest_redundant_gap(tolerance)
        _audit_points(data, displaced, ledger, points, predicted, independent, gap)


def _random_points(data: JsonMapping, generator: np.random.Generator) -> tuple[Reals, Reals]:
    """Return random points (k, 3) of the volume of the boxes, and the joint values (k, n) that their boxes predict."""
    boxes = data["boxes"]
    lows, highs, predictions = zip(*boxes, strict=True)
    low = np.array(lows, float)
    high = np.array(highs, float)
    predicted = np.array(predictions, float)
    if low.shape != (len(boxes), 3) or high.shape != low.shape or predicted.shape != (len(boxes), len(data["joints"])):
        raise ValueError("a box has no lower and upper corner, or not the values of all joints")
    if not (np.isfinite([low, high]).all() and np.isfinite(predicted).all() and (low < high).all()):
        raise ValueError("a number of a box is not finite, or its lower corner is not below its upper one")
    volumes = np.prod(high - low, axis=1)
    chosen = generator.choice(len(boxes), POINTS, p=volumes / volumes.sum())
    points = generator.uniform(low[chosen], high[chosen])
    # boxes that overlap count twice: what is proved would hide what is not
    for point in points:
        if np.count_nonzero(((low <= point) & (point < high)).all(axis=1)) > 1:
            raise ValueError("boxes overlap")
    return points, predicted[chosen]


def _independent_conditions(data: JsonMapping, closures: StatedClosures, points: Reals, predicted: Reals) -> list[int]:
    """Return the numbers of conditions that determine the joints, as many as there are joints.

    The others follow from them with the lengths of the CAD. They are chosen at the first point, each with the largest
    part of its derivatives that those before it do not have.
    """
    x: Numbers = predicted[:1].astype(np.complex128)
    tool = _tool_poses(data["orientation"], points[:1])
    J = closures.by_joints(x, tool, range(closures.joint_count))[0]
    if len(J) < J.shape[1]:
        raise ValueError(f"{len(J)} conditions cannot determine {J.shape[1]} joints")
    chosen: list[int] = []
    remaining = J.copy()
    for _ in range(J.shape[1]):
        sizes = np.linalg.norm(remaining, axis=1)
        largest = int(np.argmax(sizes))
        if sizes[largest] < _MIN_SINGULAR_VALUE:
            raise ValueError("the conditions do not determine the joints")
        chosen.append(largest)
        direction = remaining[largest] / sizes[largest]
        remaining = remaining - np.outer(remaining @ direction, direction)
    return sorted(chosen)


def _audit_points(
    data: JsonMapping,
    closures: StatedClosures,
    ledger: Ledger,
    points: Reals,
    predicted: Reals,
    independent: list[int] | None = None,
    redundant_gap: float = 0.0,
) -> None:
    """Add the rows and findings of points (k, 3), from joint values (k, n) that are predicted there.

    The joint values close the conditions with the numbers `independent` exactly; None: all of them. With other lengths
    than those of the CAD, the conditions that follow from others may have a gap of `redundant_gap` m.
    """
    tool = _tool_poses(data["orientation"], points)
    x = _closed(closures, predicted, tool, independent)
    with np.errstate(all="ignore"):
        conditions, cosines = closures.conditions(x, tool)
    if independent is None:
        independent = list(range(conditions.shape[1]))
    gaps = np.abs(conditions.real[:, independent]).max(axis=1)
    _add_largest(ledger, "loops", "m or 1", gaps, CLOSED, "a loop does not close", points)
    if redundant_gap:
        gaps = np.abs(conditions.real).max(axis=1)
        text = "a loop that follows from others does not close"
        _add_largest(ledger, "loops", "m or 1", gaps, CLOSED + redundant_gap, text, points)
    distance = np.abs(x.real - predicted).max(axis=1)
    text = "the joint values are far from those predicted"
    _add_largest(ledger, "predictions", "m or rad", distance, _MAX_PREDICTION_ERROR, text, points)
    _audit_limits(data, ledger, points, x, cosines)
    passive = np.flatnonzero(~np.array(data["active"], bool)).tolist()
    J = np.concatenate([closures.by_joints(x, tool, passive), closures.by_tool(x, tool)], axis=2)[:, independent]
    smallest = np.zeros(POINTS)
    if J.shape[1] >= J.shape[2]:  # fewer conditions than unknowns leave a motion in any case
        smallest = np.linalg.svd(J, compute_uv=False)[:, -1]
    with np.errstate(divide="ignore"):
        quotient = np.asarray(_MIN_SINGULAR_VALUE / smallest, np.float64)  # below 1 is regular
    text = "the tool can move while the joints are at rest"
    _add_largest(ledger, "derivatives", "", quotient, 1.0, text, points)


def _closed(closures: StatedClosures, predicted: Reals, tool: Numbers, independent: list[int] | None) -> Numbers:
    """Return joint values (k, n) near the predicted ones that close the loops, by Newton's method.

    Only the conditions with the numbers `independent` are closed; None: all of them.
    """
    x: Numbers = predicted.astype(np.complex128)
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            conditions, _ = closures.conditions(x, tool)
            J = closures.by_joints(x, tool, range(closures.joint_count))
            if independent is not None:
                conditions = conditions[:, independent]
                J = J[:, independent]
            newton_step = (np.linalg.pinv(J) @ conditions.real[..., None])[..., 0]
            x = x - np.asarray(newton_step, np.complex128)
    return x


def _audit_limits(data: JsonMapping, ledger: Ledger, points: Reals, x: Numbers, cosines: Sequence[AxisCosine]) -> None:
    """Add the rows and findings of limits of joints and of cones."""
    names = data["joints"]
    excess = [np.zeros(POINTS)]
    for limit in data["limits"]:
        total = np.zeros(POINTS)
        for name, weight in limit["weights"].items():
            total += weight * x.real[:, names.index(name)]
        excess.append(limit["least"] - total)
    text = "a limit of joints is exceeded"
    _add_largest(ledger, "limits", "m or rad", np.max(excess, axis=0), CLOSED, text, points)
    missing = [np.zeros(POINTS)]
    for cosine, minimum in cosines:
        missing.append(minimum - cosine.real)
    text = "a joint is turned over, or beyond its cone"
    _add_largest(ledger, "cones", "", np.max(missing, axis=0), CLOSED, text, points)


def _add_largest(ledger: Ledger, what: str, unit: str, values: Reals, limit: float, text: str, points: Reals) -> None:
    """Add the row of the largest value (k,) and, if it is above the limit or no number, a finding with its point."""
    values = np.where(np.isfinite(values), values, np.inf)
    worst = int(np.argmax(values))
    ledger.row("workspace", float(values[worst]), unit, limit, where=what)
    if not values[worst] <= limit:
        place = ", ".join(map("{:.6g}".format, 1e3 * points[worst]))
        ledger.wrong("certificate.wrong", f"{text} at {place} mm: {values[worst]:.3g}, at most {limit:g}", what)


def _tool_poses(orientation: Sequence[Sequence[float]], points: Reals) -> Numbers:
    """Return poses (k, 4, 4) of the tool at positions (k, 3) in m."""
    T = np.zeros((len(points), 4, 4), complex)
    T[:, :3, :3] = np.array(orientation, float)
    T[:, :3, 3] = points
    T[:, 3, 3] = 1
    return T
