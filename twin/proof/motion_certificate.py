"""The certificate of a motion: path, mechanism, predictions, bounds, for programs without code of the prover.

Whoever reads it has all that the bounds are about: the series and the timing of each phase, the joints of the CAD, and
for each piece of the path a prediction of the passive joints and the matrix of Krawczyk's operator. These two need no
trust: they are where a proof begins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.core import spatial
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof.certificate import digest
from twin.proof.motion import value_groups as groups
from twin.proof.motion.enclosure import SPEED_EXCESS, TOUCHING
from twin.proof.motion.linkage import Linkage
from twin.proof.motion.loop_gaps import ARM
from twin.proof.motion.motion_claims import MotionClaim, MotionProof, PredictedPieces
from twin.proof.motion.path import TimedPath, TimedPhase
from twin.proof.motion.prediction import chebyshev_nodes

SCHEMA = "twin/motion-certificate/1"

NOT_IN_IT = (
    "distances between bodies, which planning alone proves",
    "how far the determinant of the loops is from 0: only that it is not 0",
)
"""What is proved along a protocol, and not in the certificate."""

_SLACK = 1e-6
"""Part by which bounds of the certificate are wider than those proved, so that another arithmetic reaches them."""

_TOOL_SLACK = 6e-4
"""The same of the speeds of the tool: they rest on rates of the passive joints, whose bounds are wider."""

_SMALLEST_TOOL_CHANGE = 1e-6
"""Smallest change of a speed of the tool, as a part of its limit: a tool that does not turn has one that is 0."""

_SMALLEST_CHANGE = 1e-9
"""Smallest change of a bound, in m, rad, m/s or rad/s."""

_GAP_FACTOR = 30.0
"""Factor of the bounds of gaps: they are near rounding, where arithmetics differ."""

_STEEPEST = 1.3
"""Largest middle turn of a ball joint in rad: at half of pi, the three turns do not determine the rotation."""

_DIGITS = 7
"""Digits of the matrices, of which nothing but the size of a contraction depends."""

_NOISE = 1e-9
"""Part of the largest entry of a matrix below which an entry is written as 0."""

_RELATIVE_ZERO = 1e-9
"""Singular values below this fraction of the largest one count as zero in the matrix of Krawczyk's operator."""

_DECIMALS = 16
"""Decimals of the predictions in m or rad: rounding of a float near 1."""


def motion_certificate(
    mechanism: Mechanism, path: TimedPath, proof: MotionProof, about: Mapping[str, Any]
) -> JsonObject | None:
    """Return the certificate of the proved bounds along a path; None if nothing is proved.

    Args:
        mechanism: the mechanism of the CAD.
        path: the timed path.
        proof: the proof.
        about: robot, protocol and hashes of their files, as plain data.
    """
    predicted = proof.predicted
    if predicted is None:
        return None
    linkage = Linkage(mechanism)
    pieces = _pieces(predicted, linkage)
    _, _, _, predictions, _ = pieces[0]
    bounds = []
    for claim in proof.claims:
        # without predictions, the certificate says nothing of the bodies
        has_base = predictions is not None or claim.group in groups.DRIVEN
        if claim.status == "proved" and has_base:
            bounds.append(_bound(claim, linkage, path))
    if not bounds:
        return None
    data: JsonObject = {
        "schema": SCHEMA,
        **about,
        "not_in_it": list(NOT_IN_IT),
        "mechanism": _mechanism(mechanism, linkage),
        "path": {
            "frame_in_tool": path.T_tool_frame[:3].tolist(),
            "shaft": path.shaft_axis.tolist(),
            "phases": list(map(_phase, path.phases)),
        },
        "pieces": pieces,
        "bounds": bounds,
    }
    return {**data, "sha256": digest(data)}


def _bound(claim: MotionClaim, linkage: Linkage, path: TimedPath) -> JsonObject:
    """Return a bound, a little wider than it is proved but not beyond its limit, and what it is about."""
    row: JsonObject = {"kind": claim.group, "value": claim.name, "unit": claim.unit}
    row |= _about(claim, linkage, path)
    if claim.group == groups.DETERMINANT:
        return {**row, "not": 0.0}
    part = _SLACK
    smallest_change = _SMALLEST_CHANGE
    if claim.group == groups.TOOL_SPEED:
        part = _TOOL_SLACK
        smallest_change = _SMALLEST_TOOL_CHANGE
    change = max(smallest_change, part * abs(claim.bound))
    if claim.group == groups.LOOP_GAP:
        change += (_GAP_FACTOR - 1.0) * claim.bound
    limit = claim.limit
    if claim.smallest:
        if claim.group in groups.MARGINS:
            limit -= TOUCHING
        row["at least"] = max(claim.bound - change, limit)
    else:
        if claim.group in groups.SPEEDS:
            limit *= 1.0 + SPEED_EXCESS
        row["at most"] = min(claim.bound + change, limit)
    if np.isfinite(claim.limit):
        row["limit"] = claim.limit
    return row


def _about(claim: MotionClaim, linkage: Linkage, path: TimedPath) -> JsonObject:
    """Return what a bound is about: weights of coordinates, and limits; or a joint; nothing if its name says it."""
    mechanism = linkage.mechanism
    if claim.group == groups.JOINT_SPEED:
        return _one_coordinate(linkage, claim.name)
    if claim.group == groups.JOINT_LIMIT:
        limits = _limits(mechanism.joint(claim.name).limits)
        return {**_one_coordinate(linkage, claim.name), "limits": limits}
    if claim.group in (groups.MOTOR_LIMIT, groups.MOTOR_SPEED):
        return _about_motor(claim, linkage)
    if claim.group == groups.GAP:
        return _about_gap(claim.name, linkage, path)
    if claim.group == groups.PASSIVE_LIMIT:
        return _about_passive_limit(mechanism.joint(claim.name), linkage)
    return {}


def _one_coordinate(linkage: Linkage, joint: str) -> JsonObject:
    """Return the coordinate of a joint, as a sum with one weight."""
    return {"coordinates": [linkage.index(joint)], "weights": [1.0]}


def _about_motor(claim: MotionClaim, linkage: Linkage) -> JsonObject:
    """Return a motor's position as a sum of driven coordinates, with its limits if the bound is one of them."""
    mechanism = linkage.mechanism
    actuators = {actuator.name: actuator for actuator in mechanism.actuators}
    # positions of the motors are linear: row i of this matrix has the weights of motor i
    matrix = mechanism.motors(np.eye(len(mechanism.active))).T
    weights = matrix[mechanism.motor_names.index(claim.name)]
    row: JsonObject = {"coordinates": list(linkage.driven), "weights": weights.tolist()}
    if claim.group == groups.MOTOR_LIMIT:
        row["limits"] = _limits(actuators[claim.name].limits)
    return row


def _about_gap(name: str, linkage: Linkage, path: TimedPath) -> JsonObject:
    """Return the distance of two carriages on one rail as a difference of driven coordinates."""
    gaps = {gap.name: gap for gap in path.gaps}
    gap = gaps[name]
    # carriages do not pass one another: the sign of the distance is that at the start
    start = np.asarray(np.polynomial.chebyshev.chebval(-1.0, path.phases[0].coefficients))
    sign = -1.0
    if start[gap.first] > start[gap.second]:
        sign = 1.0
    coordinates = [linkage.driven[gap.first], linkage.driven[gap.second]]
    return {"coordinates": coordinates, "weights": [sign, -sign], "limits": [0.0, None]}


def _about_passive_limit(joint: Joint, linkage: Linkage) -> JsonObject:
    """Return a passive joint with its limits, as a coordinate or as an angle whose cosine is a sum of entries.

    The entries are those of the rotation R of the joint: R00, R11, R10, R01 and R22, with the weights "cosine"; the
    sum is the cosine of the angle from the middle of the limits, or of that of the cone.
    """
    spanning = [tree_joint.name for tree_joint in linkage.mechanism.tree]
    if joint.cone is None and joint.name in spanning:
        return {**_one_coordinate(linkage, joint.name), "limits": _limits(joint.limits)}
    row: JsonObject = {"joint": _joint(joint)}
    if joint.cone is not None:
        return {**row, "cosine": [0.0, 0.0, 0.0, 0.0, 1.0], "angle": joint.cone}
    if joint.type == "prismatic":
        return {**row, "limits": _limits(joint.limits)}
    assert joint.limits is not None  # a joint without limits has no bound
    low, high = joint.limits
    middle = 0.5 * (low + high)
    c = 0.5 * math.cos(middle)
    s = 0.5 * math.sin(middle)
    return {**row, "cosine": [c, c, s, -s, 0.0], "angle": 0.5 * (high - low)}


def _mechanism(mechanism: Mechanism, linkage: Linkage) -> JsonObject:
    """Return the joints of the CAD."""
    tool = mechanism.frame(mechanism.tool)
    couplings = []
    for coupling in mechanism.couplings:
        scale = 1.0
        if mechanism.joint(coupling.joints[0]).is_angle:
            scale = ARM
        coordinates = list(map(linkage.index, coupling.joints))
        ratios = [scale * ratio for ratio in coupling.ratios]
        couplings.append({"coordinates": coordinates, "ratios": ratios, "total": scale * coupling.total})
    return {
        "base": mechanism.base,
        "tool": {"body": tool.body, "frame": tool.T_body_frame[:3].tolist()},
        "driven": list(linkage.driven),
        "tree": list(map(_joint, mechanism.tree)),
        "loops": list(map(_joint, mechanism.loops)),
        "couplings": couplings,
    }


def _joint(joint: Joint) -> JsonObject:
    """Return a joint."""
    return {
        "name": joint.name,
        "type": joint.type,
        "parent": joint.parent,
        "child": joint.child,
        "on_parent": joint.T_parent_joint[:3].tolist(),
        "on_child": joint.T_child_joint[:3].tolist(),
        "child_in_joint": spatial.inverse(joint.T_child_joint)[:3].tolist(),
    }


def _limits(limits: tuple[float, float] | None) -> list[float | None] | None:
    """Return limits, None for an infinite one."""
    if limits is None:
        return None
    row: list[float | None] = []
    for limit in limits:
        if np.isfinite(limit):
            row.append(float(limit))
        else:
            row.append(None)
    return row


def _phase(phase: TimedPhase) -> JsonObject:
    """Return one phase of the path."""
    rcm = None
    if phase.rcm is not None:
        rcm = phase.rcm.tolist()
    return {
        "name": phase.name,
        "series": phase.coefficients.T.tolist(),
        "grid": phase.grid.tolist(),
        "rates": phase.rates.tolist(),
        "averaged_s": phase.smoothing,
        "rcm": rcm,
        "enforced": phase.enforced,
        "tip_speed": phase.tip_speed,
        "rotation_speed": phase.rotation_speed,
    }


def _pieces(predicted: PredictedPieces, linkage: Linkage) -> list[Any]:
    """Return (phase, ends in s, predictions of the passive coordinates, matrix of Krawczyk's operator) of each piece.

    Predictions and matrices are None if no motion of the bodies is proved, or three turns do not determine a rotation.
    """
    passive = linkage.passive
    coordinates = predicted.coordinates.copy()
    jacobian = np.zeros((len(predicted.phase), 0, len(passive)))
    if predicted.jacobian is not None:
        jacobian = predicted.jacobian.copy()
    is_known = predicted.proved
    for name, c in predicted.balls.items():
        ball_indices = linkage.indices(name)
        turns = _turns(c)
        middle_turns = turns[0, :, 1]
        is_known = is_known and bool(np.abs(middle_turns).max() < _STEEPEST)
        coordinates[:, :, ball_indices] = turns
        columns = list(map(passive.index, ball_indices))
        jacobian[:, :, columns] = jacobian[:, :, columns] @ _turning(turns[0])
    _remove_full_turns(coordinates, linkage)
    inverses = jacobian
    if is_known:
        inverses = np.linalg.pinv(jacobian, rcond=_RELATIVE_ZERO)
    pieces = []
    for i in range(len(predicted.phase)):
        series = None
        matrix = None
        if is_known:
            # adding 0 makes -0 to 0
            series = (np.round(coordinates[:, i, passive], _DECIMALS).T + 0.0).tolist()
            matrix = _rounded(inverses[i])
        phase = int(predicted.phase[i])
        first = float(predicted.first[i])
        last = float(predicted.last[i])
        pieces.append([phase, first, last, series, matrix])
    return pieces


def _rounded(matrix: Array) -> list[list[float]]:
    """Return a matrix in few digits, without the noise of rounding instead of zeros."""
    noise = _NOISE * float(np.abs(matrix).max(initial=0.0))
    without_noise = np.where(np.abs(matrix) > noise, matrix, 0.0)
    rows = []
    for row in without_noise.tolist():
        rows.append([_shortened(entry) for entry in row])
    return rows


def _shortened(number: float) -> float:
    """Return a number rounded to `_DIGITS` significant digits."""
    return float(f"{number:.{_DIGITS - 1}e}")


def _turns(c: Array) -> Array:
    """Return coefficients (order + 1, N, 3) of the turns about z, y and x that make rotations.

    Args:
        c: (order + 1, N, 3, 3) coefficients of the rotations.
    """
    nodes = chebyshev_nodes(len(c) - 1)
    powers = nodes[:, None] ** np.arange(len(c))
    R = np.einsum("ik,kaxy->iaxy", powers, c)
    turns = np.stack(
        [
            np.unwrap(np.arctan2(R[..., 1, 0], R[..., 0, 0]), axis=0),
            -np.arcsin(np.clip(R[..., 2, 0], -1.0, 1.0)),
            np.unwrap(np.arctan2(R[..., 2, 1], R[..., 2, 2]), axis=0),
        ],
        axis=-1,
    )
    return np.einsum("ki,iaj->kaj", np.linalg.inv(powers), turns)


def _turning(turns: Array) -> Array:
    """Return matrices (N, 3, 3) from rates of turns (N, 3) about z, y, x to those about the last z, y and x axes."""
    _, b, c = turns.T
    zero = np.zeros_like(b)
    rows = [
        [np.cos(b) * np.cos(c), -np.sin(c), zero],
        [np.cos(b) * np.sin(c), np.cos(c), zero],
        [-np.sin(b), zero, np.ones_like(b)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _remove_full_turns(coordinates: Array, linkage: Linkage) -> None:
    """Subtract full turns from passive angles (order + 1, N, m), so that they do not jump from piece to piece."""
    for i in linkage.passive:
        if linkage.coordinates[i].slides:
            continue
        starts = np.asarray(np.polynomial.polynomial.polyval(-1.0, coordinates[:, :, i]))
        ends = np.asarray(np.polynomial.polynomial.polyval(1.0, coordinates[:, :, i]))
        jumps = np.round((starts[1:] - ends[:-1]) / (2 * np.pi))
        coordinates[0, 1:, i] -= 2 * np.pi * np.cumsum(jumps)
