"""Texts that state why a robot stops short of a target: a limit, a gap between carriages, or a singularity."""

from __future__ import annotations

from collections.abc import Sequence

from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics.closed_loops.bounds import Bound
from twin.kinematics.closed_loops.dragging import Dragged, Stop
from twin.kinematics.closed_loops.passive_limits import PassiveLimit
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

_GAP_ROUNDING = 1e-9
"""Violation of a gap in m that counts as rounding."""


def of_point(mechanism: Mechanism, dragged: Dragged) -> str:
    """Return why a dragged point stopped, as text."""
    reasons = [_stop_text(mechanism, stop) for stop in dragged.stops]
    if dragged.singular:
        reasons.append(_singularity_text(dragged.singular))
    return ", ".join(reasons) or "no joint motion brings the point nearer"


def of_joint(
    mechanism: Mechanism, bounds: Sequence[Bound], q_reached: Array, number: int, value: float, dragged: Dragged
) -> str:
    """Return why an active joint did not reach a value, as text.

    Args:
        mechanism: the robot.
        bounds: limits of joints, of motors, and of the distances of joints on a common rail.
        q_reached: (n,) joint values in m or rad that were reached.
        number: index of the joint in q.
        value: requested value in m or rad.
        dragged: result of the motion.
    """
    joint = mechanism.active[number]
    low, high = mechanism.limits[number]
    within_limits = low <= value <= high
    q_requested = q_reached.copy()
    q_requested[number] = value
    reasons = []
    if not within_limits:
        reasons.append(beyond(joint, value, low, high))
    reasons += _violated_gaps(mechanism, bounds, q_requested, joint)
    for stop in dragged.stops:
        if isinstance(stop, PassiveLimit) or stop.kind == "motor":
            reasons.append(_stop_text(mechanism, stop))
    stopped = f"{joint.name} stops at {shown(joint, float(q_reached[number]))}"
    if dragged.singular:
        reasons.append(f"{stopped}: {_singularity_text(dragged.singular)}")
    elif len(reasons) != 1 or within_limits:
        # a single reason that names the joint's own limit also says where it stops
        reasons.append(stopped)
    return "; ".join(reasons)


def _violated_gaps(mechanism: Mechanism, bounds: Sequence[Bound], q: Array, joint: Joint) -> list[str]:
    """Return a text for each gap between a joint and its neighbour on a rail that is too small at q (n,)."""
    names = [active.name for active in mechanism.active]
    texts = []
    for bound in bounds:
        if bound.kind != "gap" or bound.slack(q) >= -_GAP_ROUNDING:
            continue
        lower, upper = bound.name.split()
        if joint.name == lower:
            opposite = upper
            side = "below"
        elif joint.name == upper:
            opposite = lower
            side = "above"
        else:
            continue
        value = shown(joint, float(q[names.index(joint.name)]))
        position = shown(joint, float(q[names.index(opposite)]))
        rail = _rail(mechanism, lower, upper)
        least = f"at least {bound.least / MM:.3f} mm {side} {opposite} = {position} ({rail})"
        texts.append(f"{joint.name} = {value} must stay {least}")
    return texts


def _stop_text(mechanism: Mechanism, stop: Stop) -> str:
    """Return a text on a limit at which a motion has stopped."""
    if isinstance(stop, PassiveLimit):
        joint = stop.joint
        low, high = joint.limits or (0.0, 0.0)
        limit = limit_range(joint)
        if stop.kind == "lower":
            limit = shown(joint, low)
        elif stop.kind == "upper":
            limit = shown(joint, high)
        return f"{joint.name} is at a limit ({limit})"
    if stop.kind == "gap":
        lower, upper = stop.name.split()
        rail = _rail(mechanism, lower, upper)
        return f"{upper} - {lower} is at its minimum of {stop.least / MM:.3f} mm ({rail})"
    if stop.kind == "motor":
        return f"motor {stop.name} is at a limit ({motor_limits(mechanism, stop)})"
    joint = mechanism.joint(stop.name)
    # the slack of an upper bound is limit - q, so its least value is the negative limit
    limit = stop.least if stop.kind == "lower" else -stop.least
    return f"{joint.name} is at its limit of {shown(joint, limit)}"


def _singularity_text(singular: str) -> str:
    """Return a text on what became singular and so stopped the motion: "tool", or a loop such as "loop r13"."""
    if singular == "tool":
        return "the robot is at a singularity; the target is in another assembly mode"
    return f"{singular} is at a singularity and cannot move further in this assembly mode"


def _rail(mechanism: Mechanism, lower: str, upper: str) -> str:
    return f"{mechanism.joint(lower).child} and {mechanism.joint(upper).child} share a rail"


def motor_limits(mechanism: Mechanism, bound: Bound) -> str:
    """Return the limits of a bound's motor as text, with their unit."""
    limits = mechanism.actuator(bound.name).limits or ()
    span = " .. ".join(f"{value:.3g}" for value in limits)
    return f"{span} {motor_unit(mechanism, bound)}"


def motor_unit(mechanism: Mechanism, bound: Bound) -> str:
    """Return the unit of a bound's motor, "rad" or "m"."""
    return "rad" if mechanism.actuator(bound.name).is_angle else "m"


def beyond(joint: Joint, value: float, low: float, high: float) -> str:
    """Return a text on a value of a joint beyond its limits `low` and `high`, all in m or rad."""
    limit = low if value < low else high
    return f"{joint.name} = {shown(joint, value)} is beyond its limit of {shown(joint, limit)}"


def limit_range(joint: Joint) -> str:
    """Return the limits of a joint as text; of a joint with a cone, its half angle."""
    if joint.cone is not None:
        return f"a cone of {shown(joint, joint.cone)}"
    return " .. ".join(shown(joint, value) for value in joint.limits or ())


def shown(joint: Joint, value: float) -> str:
    """Return a joint value in m or rad as text, in mm or degrees."""
    if joint.is_angle or joint.cone is not None:
        return f"{value / DEG:.3f}°"
    return f"{value / MM:.3f} mm"
