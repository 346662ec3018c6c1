"""Audit a certificate of `twin prove --workspace`: Newton's method closes the loops at random points of its boxes.

Neither the prover's intervals nor its derivatives are used: the derivatives here are those of complex steps. That the
points hold is no proof of the boxes; `docs/check_workspace.py` proves points again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.exchange.audit.report import Ledger

SCHEMA = "twin/workspace-certificate/1"

POINTS = 1000
"""Number of random points."""

CLOSED = 1e-9
"""Largest gap of a loop in m, or as a sine."""

_SMALLEST = 1e-9
"""Smallest singular value, in m or without unit, of derivatives that are regular."""

_STEPS = 10
"""Number of Newton steps."""

_STEP = 1e-20
"""Step along the imaginary axis; its square is below any rounding."""

_NEAR = 1.0
"""Largest distance in m or rad of joint values from those of the certificate, which only predict them."""

_FRAME_STEPS = ("frame", "inverse")
"""Kinds of steps of a path with a constant frame; the others are joints."""

Numbers = NDArray[np.complex128]
Reals = NDArray[np.float64]


def audit_workspace(data: Mapping[str, Any], ledger: Ledger) -> None:
    """Add a row for each kind of condition, and a finding for each that does not hold at a point.

    Raises:
        ValueError, KeyError, TypeError, IndexError: the certificate was changed.
    """
    generator = np.random.default_rng()  # no point that the author of a certificate could foresee
    points, joints = _drawn(data, generator)
    tolerance = float(data["tolerance_m"])
    if not 0 <= tolerance < math.inf:
        raise ValueError(f"the tolerance of lengths is {tolerance} m")
    _audit_at(data, ledger, points, joints)
    if tolerance:
        rows = _determining(data, points, joints)
        _audit_at(_displaced(data, tolerance, generator), ledger, points, joints, rows, _play(data, tolerance))


def _drawn(data: Mapping[str, Any], generator: np.random.Generator) -> tuple[Reals, Reals]:
    """Return random points (k, 3) of the volume of the boxes, and the joint values (k, joints) of their boxes."""
    boxes = data["boxes"]
    lows, highs, predictions = zip(*boxes, strict=True)
    low = np.array(lows, float)
    high = np.array(highs, float)
    joints = np.array(predictions, float)
    if low.shape != (len(boxes), 3) or high.shape != low.shape or joints.shape != (len(boxes), len(data["joints"])):
        raise ValueError("a box has no lower and upper corner, or not the values of all joints")
    if not (np.isfinite([low, high]).all() and np.isfinite(joints).all() and (low < high).all()):
        raise ValueError("a number of a box is not finite, or its lower corner is not below its upper one")
    volumes = np.prod(high - low, axis=1)
    chosen = generator.choice(len(boxes), POINTS, p=volumes / volumes.sum())
    p = generator.uniform(low[chosen], high[chosen])
    # boxes that overlap count twice: what is proved would hide what is not
    for point in p:
        if np.count_nonzero(((low <= point) & (point < high)).all(axis=1)) > 1:
            raise ValueError("boxes overlap")
    return p, joints[chosen]


def _displaced(data: Mapping[str, Any], tolerance: float, generator: np.random.Generator) -> dict[str, Any]:
    """Return the data with another mechanism at each point: its frames are off by up to a tolerance in m.

    Equal frames are displaced equally, because one joint can be on several paths; the tool's frame is not displaced.
    """
    displaced_frames: dict[str, Reals] = {}
    closures = []
    for closure in data["closures"]:
        paths = []
        for path in closure["paths"]:
            steps = list(map(list, path["steps"]))
            first_step = 0
            if path["from_tool"]:
                first_step = 1  # the frame of the tool
            for step in steps[first_step:]:
                if step[0] not in _FRAME_STEPS:
                    continue
                key = str(step[1])
                if key not in displaced_frames:
                    frames = np.tile(np.array(step[1], float), (POINTS, 1, 1))
                    frames[:, :, 3] += generator.uniform(-tolerance, tolerance, (POINTS, 3))
                    displaced_frames[key] = frames
                step[1] = displaced_frames[key]
            paths.append({**path, "steps": steps})
        closures.append({**closure, "paths": paths})
    return {**data, "closures": closures}


def _play(data: Mapping[str, Any], tolerance: float) -> float:
    """Return the largest gap in m of loops that follow from others, if each frame of a loop is off by a tolerance."""
    frames = [0]
    for closure in data["closures"]:
        count = 0
        for path in closure["paths"]:
            for step in path["steps"]:
                count += step[0] in _FRAME_STEPS
        frames.append(count)
    # each of the three coordinates of a frame may be off by the tolerance
    return max(frames) * math.sqrt(3) * tolerance


def _determining(data: Mapping[str, Any], points: Reals, joints: Reals) -> list[int]:
    """Return the numbers of conditions that determine the joints, as many as there are joints.

    The others follow from them with the lengths of the CAD. They are chosen at the first point, each with the largest
    part of its derivatives that those before it do not have.
    """
    x: Numbers = joints[:1].astype(np.complex128)
    J = _by_joints(data, x, _tool(data["orientation"], points[:1]), range(len(data["joints"])))[0]
    if len(J) < J.shape[1]:
        raise ValueError(f"{len(J)} conditions cannot determine {J.shape[1]} joints")
    chosen: list[int] = []
    remaining = J.copy()
    for _ in range(J.shape[1]):
        sizes = np.linalg.norm(remaining, axis=1)
        largest = int(np.argmax(sizes))
        if sizes[largest] < _SMALLEST:
            raise ValueError("the conditions do not determine the joints")
        chosen.append(largest)
        direction = remaining[largest] / sizes[largest]
        remaining = remaining - np.outer(remaining @ direction, direction)
    return sorted(chosen)


def _audit_at(
    data: Mapping[str, Any],
    ledger: Ledger,
    points: Reals,
    joints: Reals,
    rows: list[int] | None = None,
    play: float = 0.0,
) -> None:
    """Add the rows and findings of points (k, 3).

    The joint values close the conditions `rows` exactly; None: all of them. With other lengths than those of the CAD,
    the conditions that follow from others may have a gap of `play` m.
    """
    x: Numbers = joints.astype(np.complex128)
    tool = _tool(data["orientation"], points)
    names = data["joints"]
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            residuals, _ = _conditions(data, x, tool)
            J = _by_joints(data, x, tool, range(len(names)))
            if rows is not None:
                residuals = residuals[:, rows]
                J = J[:, rows]
            x = x - np.asarray((np.linalg.pinv(J) @ residuals.real[..., None])[..., 0], np.complex128)
        residuals, cosines = _conditions(data, x, tool)
    if rows is None:
        rows = list(range(residuals.shape[1]))
    _largest(ledger, "loops", "m", np.abs(residuals.real[:, rows]).max(axis=1), CLOSED, "a loop does not close", points)
    if play:
        gaps = np.abs(residuals.real).max(axis=1)
        _largest(ledger, "loops", "m", gaps, CLOSED + play, "a loop that follows from others does not close", points)
    distance = np.abs(x.real - joints).max(axis=1)
    _largest(ledger, "predictions", "rad", distance, _NEAR, "the joint values are far from those predicted", points)
    _audit_limits(data, ledger, points, x, cosines)
    passive = np.flatnonzero(~np.array(data["active"], bool)).tolist()
    J = np.concatenate([_by_joints(data, x, tool, passive), _by_tool(data, x, tool)], axis=2)[:, rows]
    smallest = np.zeros(POINTS)
    if J.shape[1] >= J.shape[2]:  # fewer conditions than unknowns leave a motion in any case
        smallest = np.linalg.svd(J, compute_uv=False)[:, -1]
    # a quotient below 1 is regular
    quotient = np.asarray(_SMALLEST / smallest, np.float64)
    _largest(ledger, "derivatives", "", quotient, 1.0, "the tool can move while the joints are at rest", points)


def _audit_limits(
    data: Mapping[str, Any], ledger: Ledger, points: Reals, x: Numbers, cosines: Sequence[tuple[Numbers, float]]
) -> None:
    """Add the rows and findings of limits of joints and of cones."""
    names = data["joints"]
    excess = [np.zeros(POINTS)]
    for limit in data["limits"]:
        total = np.zeros(POINTS)
        for name, weight in limit["weights"].items():
            total += weight * x.real[:, names.index(name)]
        excess.append(limit["least"] - total)
    _largest(ledger, "limits", "m", np.max(excess, axis=0), CLOSED, "a limit of joints is exceeded", points)
    missing = [np.zeros(POINTS)]
    for cosine, least in cosines:
        missing.append(least - cosine.real)
    _largest(ledger, "cones", "", np.max(missing, axis=0), CLOSED, "a joint is turned over, or beyond its cone", points)


def _largest(ledger: Ledger, what: str, unit: str, values: Reals, limit: float, text: str, points: Reals) -> None:
    """Add the row of the largest value (k,) and, if it is above the limit or no number, a finding with its point."""
    values = np.where(np.isfinite(values), values, np.inf)
    place = int(np.argmax(values))
    ledger.row("workspace", float(values[place]), unit, limit, where=what)
    if not values[place] <= limit:
        at = ", ".join(map("{:.6g}".format, 1e3 * points[place]))
        ledger.wrong("certificate.wrong", f"{text} at {at} mm: {values[place]:.3g}, at most {limit:g}", what)


def _tool(orientation: Sequence[Sequence[float]], points: Reals) -> Numbers:
    """Return poses (k, 4, 4) of the tool at positions (k, 3) in m."""
    T = np.zeros((len(points), 4, 4), complex)
    T[:, :3, :3] = np.array(orientation, float)
    T[:, :3, 3] = points
    T[:, 3, 3] = 1
    return T


def _conditions(data: Mapping[str, Any], x: Numbers, tool: Numbers) -> tuple[Numbers, list[tuple[Numbers, float]]]:
    """Return the closing conditions (k, rows), and (cosine (k,), least one) of axes."""
    rows = []
    cosines = []
    for closure in data["closures"]:
        first_path, second_path = closure["paths"]
        first = _pose_of_path(first_path, x, tool)
        second = _pose_of_path(second_path, x, tool)
        kind = closure["type"]
        R_transposed = np.swapaxes(first[:, :3, :3], 1, 2)
        R_first_second = R_transposed @ second[:, :3, :3]
        shift = (R_transposed @ (second - first)[:, :3, 3:])[..., 0]
        rows += [shift[:, 0], shift[:, 1]]
        if kind in ("spherical", "revolute", "fixed"):
            rows.append(shift[:, 2])
        # The products of two axes vanish at right angles; the cosines tell the axes from their opposites.
        if kind != "spherical":
            rows += [R_first_second[:, 0, 2], R_first_second[:, 1, 2]]
            cosines.append((R_first_second[:, 2, 2], 0.0))
        if kind in ("prismatic", "fixed"):
            rows.append(R_first_second[:, 0, 1])
            cosines.append((R_first_second[:, 1, 1], 0.0))
        if closure["cone"] is not None:
            cosines.append((R_first_second[:, 2, 2], math.cos(closure["cone"])))
    return np.stack(rows, axis=1), cosines


def _pose_of_path(path: Mapping[str, Any], x: Numbers, tool: Numbers) -> Numbers:
    """Return the poses (k, 4, 4) of the frame at the end of a path."""
    T = np.broadcast_to(np.eye(4, dtype=complex), tool.shape)
    if path["from_tool"]:
        T = tool
    for kind, value, *sign in path["steps"]:
        step = np.zeros((len(x), 4, 4), complex)
        step[:] = np.eye(4)
        if kind in _FRAME_STEPS:
            frame = np.tile(np.eye(4), (len(x), 1, 1))
            frame[:, :3] = np.array(value, float)
            if kind == "inverse":
                frame = np.linalg.inv(frame)
            step = frame.astype(complex)
        elif kind == "turn":
            angle = sign[0] * x[:, value]
            step[:, 0, 0] = step[:, 1, 1] = np.cos(angle)
            step[:, 1, 0] = np.sin(angle)
            step[:, 0, 1] = -step[:, 1, 0]
        elif kind == "slide":
            step[:, 2, 3] = sign[0] * x[:, value]
        else:
            raise ValueError(f"a step is {kind!r}")
        T = T @ step
    return T


def _by_joints(data: Mapping[str, Any], x: Numbers, tool: Numbers, numbers: Sequence[int]) -> Reals:
    """Return the derivatives (k, rows, columns) of the conditions by some coordinates."""
    columns = []
    for i in numbers:
        stepped = x.real.astype(np.complex128)
        stepped[:, i] += 1j * _STEP
        columns.append(_conditions(data, stepped, tool)[0].imag / _STEP)
    if not columns:
        return np.zeros((*_conditions(data, x, tool)[0].shape, 0))
    return np.stack(columns, axis=2)


def _by_tool(data: Mapping[str, Any], x: Numbers, tool: Numbers) -> Reals:
    """Return the derivatives (k, rows, 6) by shifts and turns of the tool about its origin, along the axes of base."""
    columns = []
    for axis in range(3):
        stepped_tool = tool.copy()
        stepped_tool[:, axis, 3] += 1j * _STEP
        columns.append(_conditions(data, x.real.astype(np.complex128), stepped_tool)[0].imag / _STEP)
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        stepped_tool = tool.copy()
        # the velocity of each axis of the tool is the cross product of the unit vector with it
        stepped_tool[:, second, :3] -= 1j * _STEP * tool[:, third, :3]
        stepped_tool[:, third, :3] += 1j * _STEP * tool[:, second, :3]
        columns.append(_conditions(data, x.real.astype(np.complex128), stepped_tool)[0].imag / _STEP)
    return np.stack(columns, axis=2)
