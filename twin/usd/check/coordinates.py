"""Compare the coordinate of a joint, computed from its frames, with its limits, state, drive and maximum speed.

Angles are in degrees, as on the stage; lengths are in metres.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdPhysics

from twin.core import spatial
from twin.core.findings import Finding, Kind, disagreement
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.usd.check.timeline import Timeline
from twin.usd.scan import RawJoint

STATE_TOL = 0.01
"""Maximum difference between a joint state and the coordinate of the authored pose, in degrees (lengths: mm)."""

LIMIT_TOL = 1e-3
"""Maximum violation of a joint limit that is taken as a rounding error, in degrees (lengths: mm)."""

TYPICAL_RADIAN_LIMITS = np.pi * np.array([2, 1, 1 / 2, 1 / 3, 1 / 4, 1 / 6, 2 / 3, 3 / 4, 5 / 6])
"""Values of typical limits in radians; such values are unusual for limits in degrees."""

_TYPICAL_LIMIT_TOL = 2e-3
"""Distance in rad up to which a limit is one of `TYPICAL_RADIAN_LIMITS`: limits are written with few digits."""

_RADIAN_TARGET_TOL = 0.05
"""Distance in deg up to which a drive target is the coordinate in radians."""

_MIN_TARGET_DIFFERENCE = 0.5
"""Distance in deg above which a drive target is not the coordinate in degrees."""

_MAX_ZERO_TARGET = 1e-3
"""Drive target in deg up to which it says nothing about its unit."""

RADIAN_SPEED = 4 * np.pi
"""A maximum speed up to this value is probably in rad/s, because this speed in degrees per second is very low."""

SPEED_MARGIN = 1.01
"""Factor by which a speed may exceed the maximum, because finite differences between samples have an error."""

_SAME_SAMPLE_TOL = 1e-6
"""Duration in s, and change in rad or m, up to which two samples are one sample, rounded in two ways."""


_RADIANS = Kind("stage.radians", "disagreement", "multiply by 180/pi", word="")
_STATE = Kind(
    "stage.state",
    "disagreement",
    "author the coordinate given by the body poses as the joint state: simulators start at the joint state",
    word="tolerance",
)
_SPEED = Kind(
    "stage.speed", "disagreement", "slow the motion down, or correct physxJoint:maxJointVelocity (degrees per second)"
)
_BEYOND_LIMITS = Kind(
    "stage.beyond_limits",
    "disagreement",
    "check the limits (degrees for angles) and the zero of the joint",
    word="tolerance",
)
_STATE_MISSING = Kind("stage.state_missing", "warning", word="tolerance")
_NOT_FINITE = Kind("stage.not_finite", "disagreement", "author finite numbers")
_DRIVE_TARGET = Kind("stage.drive_target", "disagreement", "author a target within the limits, in degrees for angles")


def coordinate(joint: RawJoint, T_0_1: Array) -> Array:
    """Return the coordinate (k,) of a joint from the poses (k, 4, 4) of its second frame in its first.

    Lengths are in metres, angles in degrees: the first in -180..180, the others unwrapped.
    """
    if joint.type == "prismatic":
        return T_0_1[:, 2, 3]
    return np.unwrap(spatial.angle_about_z(T_0_1)) / DEG


def check_coordinate(joint: RawJoint, timeline: Timeline, q: Array, ordered: bool) -> Iterator[Finding]:
    """Yield findings on a revolute or prismatic joint.

    `q` (k + 1,) is the joint's coordinate at rest and at the k samples of the timeline, in degrees or metres.
    `ordered` is False if the lower limit exceeds the upper limit; the limits are then not checked.
    """
    if joint.limits and ordered:
        yield from _check_limits(joint, timeline, q)
    yield from _check_state(joint, timeline, q)
    yield from _check_drive(joint, float(q[0]))
    yield from _check_speed(joint, timeline, q)


def _unit(joint: RawJoint) -> tuple[str, float]:
    """Return (unit in messages, factor that converts results of `coordinate` to this unit)."""
    if joint.is_angle:
        return "deg", 1.0
    return "mm", 1 / MM


def _limits(joint: RawJoint) -> tuple[float, float]:
    """Return (lower, upper) limit in degrees or metres; infinite without limits."""
    if joint.limits is None:
        return -np.inf, np.inf
    low, high = joint.limits
    return low * joint.unit, high * joint.unit


def _radians(joint: RawJoint, text: str, size: float) -> Finding:
    return _RADIANS(joint.path, f"joint {joint.path}: {text}; UsdPhysics angles are in degrees", Quantity(size, "deg"))


def _distances_beyond(q: Array, low: float, high: float, wraps: bool) -> Array:
    """Return the distances (k,) of q (k,) from the range low..high.

    If `wraps`, the same number of full turns, -3 to 3, is added to all samples; this number minimises the largest
    distance.
    """
    turns = np.zeros(1)
    if wraps:
        turns = 360.0 * np.arange(-3, 4)
    shifted = q + turns[:, None]
    beyond = np.maximum(low - shifted, shifted - high)
    distances = np.maximum(beyond, 0)
    best = np.argmin(distances.max(axis=1))
    return distances[best]


def _check_limits(joint: RawJoint, timeline: Timeline, q: Array) -> Iterator[Finding]:
    low, high = _limits(joint)
    if _limits_look_like_radians(joint, q, low, high):
        yield _radians(joint, f"the limits {low:.5g} .. {high:.5g} deg look like radians", high)
        return
    unit, display_factor = _unit(joint)
    beyond_limits = _distances_beyond(q, low, high, joint.is_angle) * display_factor
    worst = int(np.argmax(beyond_limits))
    if beyond_limits[worst] > LIMIT_TOL:
        text = f"joint {joint.path} exceeds its limits {low * display_factor:.5g} .. {high * display_factor:.5g} {unit}"
        yield _BEYOND_LIMITS(
            joint.path, text, Quantity(beyond_limits[worst], unit), LIMIT_TOL, when=timeline.labels[worst]
        )


def _limits_look_like_radians(joint: RawJoint, q: Array, low: float, high: float) -> bool:
    """Return whether the motion fits the limits in radians, and the limits are typical in radians or too narrow."""
    if not joint.is_angle or max(abs(low), abs(high)) > 2 * np.pi + 1e-3:
        return False
    fits_radians = np.max(_distances_beyond(q, low / DEG, high / DEG, True)) <= LIMIT_TOL
    if not fits_radians:
        return False
    is_typical = np.abs(np.abs([[low], [high]]) - TYPICAL_RADIAN_LIMITS) < _TYPICAL_LIMIT_TOL
    exceeds_degrees = np.max(_distances_beyond(q, low, high, True)) > LIMIT_TOL
    return bool(is_typical.any() or exceeds_degrees)


def _difference(joint: RawJoint, a: Array, b: Array) -> Array:
    """Return |a - b|: for angles in degrees, modulo 360; for lengths in mm."""
    if not joint.is_angle:
        return np.abs(a - b) / MM
    return np.abs((a - b + 180.0) % 360.0 - 180.0)


def _check_state(joint: RawJoint, timeline: Timeline, q: Array) -> Iterator[Finding]:
    """Compare the joint state, which is the initial state of simulations, with the coordinate from the poses."""
    unit, display_factor = _unit(joint)
    attribute = joint.prim.GetAttribute(f"state:{joint.instance}:physics:position")
    rest_state: float | None = None
    if attribute:
        rest_state = attribute.Get()
    if rest_state is None:
        distance_from_zero = float(_difference(joint, q[:1], np.zeros(1))[0])
        # Joints outside of the articulation have no start state: simulators take theirs from the poses of the bodies.
        if not joint.excluded and distance_from_zero > STATE_TOL:
            yield _STATE_MISSING(
                joint.path,
                f"joint {joint.path} has no joint state, so simulators start the joint at zero instead of at the "
                "coordinate given by the poses of its bodies",
                Quantity(q[0] * display_factor, unit),
                STATE_TOL,
                f"apply PhysicsJointStateAPI:{joint.instance} to the joint and author the position of this state",
            )
        return
    authored = [float(rest_state)]
    if attribute.GetNumTimeSamples() > 0:
        query = Usd.AttributeQuery(attribute)
        for code in timeline.codes.tolist():
            authored.append(float(query.Get(Usd.TimeCode(code))))
    states = np.array(authored) * joint.unit
    actual = q[: len(states)]
    differences = _difference(joint, states, actual)
    worst = int(np.argmax(differences))
    if differences[worst] <= STATE_TOL:
        return
    if joint.is_angle and np.max(_difference(joint, states / DEG, actual)) < 10 * STATE_TOL:
        text = f"the joint state {states[worst]:.5g} deg equals the coordinate {actual[worst]:.5g} deg in radians"
        yield _radians(joint, text, float(states[worst]))
        return
    stated = Quantity(states[worst] * display_factor, unit)
    computed = Quantity(actual[worst] * display_factor, unit)
    text = (
        f"joint {joint.path}: the joint state {stated} differs from the coordinate {computed} computed from the poses "
        "of the joint's bodies"
    )
    yield _STATE(joint.path, text, Quantity(differences[worst], unit), STATE_TOL, when=timeline.labels[worst])


def _check_drive(joint: RawJoint, q: float) -> Iterator[Finding]:
    instances: list[str] = []
    for schema in joint.prim.GetAppliedSchemas():
        if schema.startswith("PhysicsDriveAPI:"):
            instances.append(schema.partition(":")[2])
    wrong = [instance for instance in instances if instance != joint.instance]
    if wrong:
        text = (
            f"joint {joint.path} ({joint.type}) has a drive '{wrong[0]}', which has no effect; expected "
            f"'{joint.instance}'"
        )
        yield disagreement("stage.drive_axis", joint.path, text, suggestion=f"apply PhysicsDriveAPI:{joint.instance}")
    if joint.instance not in instances:
        return
    drive = UsdPhysics.DriveAPI(joint.prim, joint.instance)
    unit, display_factor = _unit(joint)
    numbers = {
        "target": drive.GetTargetPositionAttr().Get(),
        "stiffness": drive.GetStiffnessAttr().Get(),
        "damping": drive.GetDampingAttr().Get(),
    }
    for name, value in numbers.items():
        if value is not None and not np.isfinite(value):
            yield _NOT_FINITE(joint.path, f"joint {joint.path}: the {name} of its drive is not finite: {value}")
            return
    target = drive.GetTargetPositionAttr().Get() * joint.unit
    low, high = _limits(joint)
    if joint.is_angle and _looks_like_radians(target, q):
        text = f"the drive target {target:.5g} deg equals the coordinate {q:.5g} deg in radians"
        yield _radians(joint, text, target)
    elif low <= high and max(low - target, target - high) * display_factor > LIMIT_TOL:
        exceeded = low
        if target > high:
            exceeded = high
        yield _DRIVE_TARGET(
            joint.path,
            f"joint {joint.path}: the drive target is outside the joint limits {low * display_factor:.5g} .. "
            f"{high * display_factor:.5g} {unit}",
            Quantity(target * display_factor, unit),
            Quantity(exceeded * display_factor, unit),
        )


def _looks_like_radians(target: float, q: float) -> bool:
    """Return whether a drive target, taken as rad, is the coordinate q in deg of the authored pose."""
    if abs(target) <= _MAX_ZERO_TARGET or abs(target - q) <= _MIN_TARGET_DIFFERENCE:
        return False
    return abs(target / DEG - q) < _RADIAN_TARGET_TOL


def _check_speed(joint: RawJoint, timeline: Timeline, q: Array) -> Iterator[Finding]:
    attribute = joint.prim.GetAttribute("physxJoint:maxJointVelocity")
    stated: float | None = None
    if attribute:
        stated = attribute.Get()
    if stated is None or not np.isfinite(stated) or len(timeline.times_s) < 2:
        return
    unit, display_factor = _unit(joint)
    limit = stated * (joint.unit * display_factor)
    # q starts with the coordinate at rest, which is no sample
    change = np.abs(np.diff(q[1:]))
    duration = np.diff(timeline.times_s)
    # Two time codes of one key, apart by rounding, are no motion: a quotient of roundings is no speed.
    same_key = (duration <= _SAME_SAMPLE_TOL) & (change <= _SAME_SAMPLE_TOL)
    rate = np.divide(change, duration, out=np.full_like(change, np.inf), where=duration > 0)
    speed = np.where(same_key, 0.0, rate) * display_factor
    worst = int(np.argmax(speed))
    if speed[worst] <= limit * SPEED_MARGIN:
        return
    if joint.is_angle and limit <= RADIAN_SPEED and speed[worst] <= limit / DEG * SPEED_MARGIN:
        text = f"the joint's speed exceeds maxJointVelocity {limit:.5g} deg/s, which looks like a value in rad/s"
        yield _radians(joint, text, limit)
        return
    yield _SPEED(
        joint.path,
        f"joint {joint.path} exceeds its maximum speed",
        Quantity(speed[worst], f"{unit}/s"),
        Quantity(limit, f"{unit}/s"),
        when=timeline.labels[worst + 1],
    )
