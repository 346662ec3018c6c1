"""The coordinate of a joint, as its frames give it, against its limits, state, drive and largest speed.

Angles are degrees here, as on the stage; lengths are metres.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdPhysics

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.usd.check.timeline import Timeline
from twin.usd.scan import RawJoint

STATE_TOL = 0.01
"""Deviation of a joint state from the authored pose: degrees, or hundredths of a millimetre."""

LIMIT_TOL = 1e-3
"""Breach of a limit that is still rounding: degrees, or thousandths of a millimetre."""

RADIAN_LOOKS = tuple(np.pi * f for f in (2, 1, 1 / 2, 1 / 3, 1 / 4, 1 / 6, 2 / 3, 3 / 4, 5 / 6))
"""Limits that people write in radians: in a field of degrees they would be odd."""

RADIAN_SPEED = 4 * np.pi
"""Largest speed that may be meant as rad/s; as degrees per second it would hardly move."""

SPEED_MARGIN = 1.01
"""Factor on the largest speed for the finite difference between samples."""


def coordinate(joint: RawJoint, A: Array) -> Array:
    """Return the coordinate (k,) of a joint in degrees (first in -180..180, then unwrapped) or metres."""
    if joint.type == "prismatic":
        return A[:, 2, 3]
    return np.unwrap(spatial.angle_about_z(A)) / DEG


def check_coordinate(joint: RawJoint, line: Timeline, q: Array, ordered: bool) -> Iterator[Finding]:
    """Yield findings on a revolute or prismatic joint.

    Args:
        joint: the joint.
        line: where the bodies are.
        q: its coordinate (k + 1,) along that line, in degrees or metres.
        ordered: whether its limits can be used.

    """
    if joint.limits and ordered:
        yield from _check_limits(joint, line, q)
    yield from _check_state(joint, line, q)
    yield from _check_drive(joint, float(q[0]))
    yield from _check_speed(joint, line, q)


def _unit(joint: RawJoint) -> tuple[str, float]:
    """Return the unit a size is shown in, and the factor from the units of `coordinate`."""
    return ("deg", 1.0) if joint.is_angle else ("mm", 1 / MM)


def _radians(joint: RawJoint, text: str, size: float) -> Finding:
    return Finding(
        "stage.radians",
        "disagreement",
        f"joint {joint.path}: {text}; UsdPhysics counts angles in degrees.",
        where=joint.path,
        size=size,
        unit="deg",
        suggestion="multiply by 180/pi",
    )


def _breach(q: Array, low: float, high: float, wraps: bool) -> Array:
    """Return how far q (k,) lies outside low..high; an angle may be off by whole turns, the same for all."""
    turns = 360.0 * np.arange(-3, 4) if wraps else np.zeros(1)
    each = [np.maximum(np.maximum(low - (q + t), q + t - high), 0) for t in turns]
    return min(each, key=lambda b: float(np.max(b)))


def _check_limits(joint: RawJoint, line: Timeline, q: Array) -> Iterator[Finding]:
    low, high = (v * joint.unit for v in joint.limits or (-np.inf, np.inf))
    if joint.is_angle and max(abs(low), abs(high)) <= 2 * np.pi + 1e-3:
        typical = [v for v in (abs(low), abs(high)) if any(abs(v - r) < 2e-3 for r in RADIAN_LOOKS)]
        inside = np.max(_breach(q, low / DEG, high / DEG, True)) <= LIMIT_TOL
        outside = np.max(_breach(q, low, high, True)) > LIMIT_TOL
        if inside and (typical or outside):
            yield _radians(joint, f"limits {low:.5g} .. {high:.5g} look like radians", high)
            return
    unit, shown = _unit(joint)
    breach = _breach(q, low, high, joint.is_angle) * shown
    worst = int(np.argmax(breach))
    if breach[worst] > LIMIT_TOL:
        yield Finding(
            "stage.beyond_limits",
            "disagreement",
            f"joint {joint.path} stands {breach[worst]:.4g} {unit} beyond its limits {low * shown:.5g} .. "
            f"{high * shown:.5g} {unit} {line.labels[worst]}.",
            where=joint.path,
            when=line.labels[worst],
            size=float(breach[worst]),
            unit=unit,
            limit=LIMIT_TOL,
            suggestion="check the limits (degrees for angles) and the zero of the joint",
        )


def _difference(joint: RawJoint, a: Array, b: Array) -> Array:
    """Return |a - b|, for angles in degrees up to whole turns, for lengths in mm."""
    if not joint.is_angle:
        return np.abs(a - b) / MM
    return np.abs((a - b + 180.0) % 360.0 - 180.0)


def _check_state(joint: RawJoint, line: Timeline, q: Array) -> Iterator[Finding]:
    """Hold the joint state against the poses: simulators start at the state."""
    unit, shown = _unit(joint)
    factor = joint.unit
    attribute = joint.prim.GetAttribute(f"state:{joint.instance}:physics:position")
    rest = attribute.Get() if attribute else None
    if rest is None:
        if not joint.excluded and float(_difference(joint, q[:1], np.zeros(1))[0]) > STATE_TOL:
            yield Finding(
                "stage.state_missing",
                "warning",
                f"joint {joint.path} stands at {q[0] * shown:.4g} {unit} but has no joint state: PhysX and "
                "Newton start at zero, not at the authored pose.",
                where=joint.path,
                size=float(q[0] * shown),
                unit=unit,
                limit=STATE_TOL,
                suggestion=f"apply PhysicsJointStateAPI:{joint.instance} and author its position",
            )
        return
    sampled = attribute.GetNumTimeSamples() > 0 and len(line.codes)
    query = Usd.AttributeQuery(attribute)
    codes = line.codes.tolist() if sampled else []
    state = [float(rest), *(float(query.Get(Usd.TimeCode(c))) for c in codes)]
    states, actual = np.array(state) * factor, q[: len(state)]
    off = _difference(joint, states, actual)
    worst = int(np.argmax(off))
    if off[worst] <= STATE_TOL:
        return
    if joint.is_angle and np.max(_difference(joint, states / DEG, actual)) < 10 * STATE_TOL:
        text = f"joint state {states[worst]:.5g} is the radians of its pose, {actual[worst]:.5g} deg"
        yield _radians(joint, text, float(states[worst]))
        return
    yield Finding(
        "stage.state",
        "disagreement",
        f"joint {joint.path}: its state says {states[worst] * shown:.5g} {unit}, the poses "
        f"{actual[worst] * shown:.5g} {unit}, {line.labels[worst]} (tolerance {STATE_TOL:g} {unit}).",
        where=joint.path,
        when=line.labels[worst],
        size=float(off[worst]),
        unit=unit,
        limit=STATE_TOL,
        suggestion="author the coordinate of the authored pose: simulators start there",
    )


def _check_drive(joint: RawJoint, q: float) -> Iterator[Finding]:
    kinds = [k for k in joint.prim.GetAppliedSchemas() if k.startswith("PhysicsDriveAPI:")]
    wrong = [k.partition(":")[2] for k in kinds if k.partition(":")[2] != joint.instance]
    if wrong:
        yield Finding(
            "stage.drive_axis",
            "disagreement",
            f"joint {joint.path} ({joint.type}) has a drive '{wrong[0]}', which moves nothing; its own is "
            f"'{joint.instance}'.",
            where=joint.path,
            suggestion=f"apply PhysicsDriveAPI:{joint.instance}",
        )
    drive = UsdPhysics.DriveAPI(joint.prim, joint.instance) if len(kinds) > len(wrong) else None
    gains = 0.0 if drive is None else drive.GetStiffnessAttr().Get() + drive.GetDampingAttr().Get()
    active = joint.prim.GetAttribute("twin:active")
    if active and active.Get() and not gains > 0:
        yield Finding(
            "stage.drive_missing",
            "warning",
            f"joint {joint.path} is active, but {'its drive has no gains' if drive else 'has no drive'}: it "
            "swings freely in a simulator.",
            where=joint.path,
            suggestion=f"apply PhysicsDriveAPI:{joint.instance} with stiffness and damping",
        )
    if drive is None:
        return
    target = drive.GetTargetPositionAttr().Get() * joint.unit
    low, high = joint.limits or (-np.inf, np.inf)
    low, high = (v * joint.unit for v in (low, high))
    if joint.is_angle and abs(target) > 1e-3 and abs(target / DEG - q) < 0.05 and abs(target - q) > 0.5:
        yield _radians(joint, f"drive target {target:.5g} is the radians of its pose, {q:.5g} deg", target)
    elif low <= high and not low - LIMIT_TOL <= target <= high + LIMIT_TOL:
        unit, shown = _unit(joint)
        yield Finding(
            "stage.drive_target",
            "disagreement",
            f"joint {joint.path}: drive target {target * shown:.5g} {unit} lies outside its limits "
            f"{low * shown:.5g} .. {high * shown:.5g} {unit}.",
            where=joint.path,
            size=float(target * shown),
            unit=unit,
            limit=float((high if target > high else low) * shown),
            suggestion="author a target within the limits, in degrees for angles",
        )


def _check_speed(joint: RawJoint, line: Timeline, q: Array) -> Iterator[Finding]:
    attribute = joint.prim.GetAttribute("physxJoint:maxJointVelocity")
    limit = attribute.Get() if attribute else None
    if limit is None or not np.isfinite(limit) or len(line.times_s) < 2:
        return
    unit, shown = _unit(joint)
    limit *= joint.unit * shown
    speed = np.abs(np.diff(q[1:]) / np.diff(line.times_s)) * shown
    worst = int(np.argmax(speed))
    if speed[worst] <= limit * SPEED_MARGIN:
        return
    if joint.is_angle and limit <= RADIAN_SPEED and speed[worst] <= limit / DEG * SPEED_MARGIN:
        yield _radians(joint, f"largest speed {limit:.5g} holds for the motion only as rad/s", limit)
        return
    yield Finding(
        "stage.speed",
        "disagreement",
        f"joint {joint.path} moves at {speed[worst]:.4g} {unit}/s after {line.labels[worst + 1]}; its "
        f"largest speed is {limit:.4g} {unit}/s.",
        where=joint.path,
        when=line.labels[worst + 1],
        size=float(speed[worst]),
        unit=f"{unit}/s",
        limit=float(limit),
        suggestion="slow the motion down, or correct physxJoint:maxJointVelocity (degrees per second)",
    )
