"""Check a finished trajectory from its samples alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind, Severity, disagreement, error, finding, info, warning
from twin.core.quantity import Quantity, deg, mm, moved, si
from twin.core.spatial import Array
from twin.core.units import MM, ROUNDING
from twin.planning.path_kinematics import PathKinematics
from twin.planning.protocol import DIRECTIONS, Protocol, RotationOrder, Waypoint, trocar_of
from twin.planning.trajectory import PhaseSpan, Trajectory

ACCEPTED_EXCESS = 1e-3
"""Fraction by which a sample may exceed a limit of speed, acceleration or jerk."""

_JOINT_VALUE_TOLERANCE = 1e-9
"""Tolerance in m or rad of a waypoint's joint values, which are planned exactly."""

REPLAN_ADVICE = "plan the protocol again: these samples differ from the planned ones"
"""Suggestion for samples that differ from the planned ones."""

_LIMIT_ROUNDING = 1e-12
"""Distance in m or rad by which a sample may exceed a limit: rounding of a motion that ends at its limit."""

_RCM_MISSED = Kind("rcm.missed", "disagreement", 'use rcm = "enforced" and a waypoint with depth_mm', word="tolerance")
_RCM_NOT_HELD = Kind("rcm.missed", "disagreement", "the robot cannot hold the RCM: remove directions from `free`")
_RCM_KEPT = Kind("rcm.kept", "info", word="tolerance")
_INSERTION_BENT = Kind("insertion.bent", "disagreement", REPLAN_ADVICE, word="tolerance")
_INSERTION_STRAIGHT = Kind("insertion.straight", "info", word="tolerance")
_SINGULARITY_NEAR = Kind("singularity.near", "warning", word="alarm")
_SINGULARITY_MARGIN = Kind("margin.singularity", "info", word="alarm")


def check(trajectory: Trajectory, protocol: Protocol, kinematics: PathKinematics) -> list[Finding]:
    """Return the findings on a trajectory; findings of severity "info" report the smallest margins.

    Args:
        trajectory: the samples; its stored margins and RCM errors are recomputed.
        protocol: source of the limits of the phases and of the tolerances.
        kinematics: source of joint limits, singularity measures and working modes.
    """
    return [
        *_positions(trajectory, kinematics),
        *_motors(trajectory, kinematics),
        *_gaps(trajectory, kinematics),
        *_passive(trajectory, kinematics),
        *_joint_rates(trajectory, kinematics),
        *_tip_rates(trajectory, protocol),
        *_speeds_match_slopes(trajectory, kinematics),
        *_rcm(trajectory, protocol),
        *_insertion_straightness(trajectory, protocol),
        *_waypoints(trajectory, protocol),
        *_singularities(trajectory, kinematics),
        *_branches(trajectory, kinematics),
        *_reach(trajectory, kinematics),
    ]


def rcm_error(Ts_base_frame: Array, shaft_axis: Array, rcm: Array) -> Array:
    """Return the distance (k,) in m from the RCM (3,), in base, to the shaft axis.

    The axis passes through the origin of the moved frame, whose poses are `Ts_base_frame` (k, 4, 4). The direction of
    the axis is `shaft_axis` (3,), a unit vector in the moved frame.
    """
    return spatial.point_to_line(rcm, Ts_base_frame[:, :3, 3], Ts_base_frame[:, :3, :3] @ shaft_axis)


def _when(trajectory: Trajectory, sample: int, span: PhaseSpan | None = None) -> str:
    """Return a text with phase, time and, if there is one, waypoint of a sample."""
    if span is None:
        span = _span_at(trajectory, sample)
    text = f"phase '{span.name}', t = {trajectory.t[sample]:.3f} s"
    for name, rows in trajectory.waypoints.items():
        if sample in rows:
            return f"{text}, waypoint '{name}'"
    return text


def _span_at(trajectory: Trajectory, sample: int) -> PhaseSpan:
    """Return the phase of a sample; the end of a phase, where the next one starts, belongs to the earlier phase."""
    for span in trajectory.phases:
        if sample <= span.stop:
            return span
    raise AssertionError(f"sample {sample} is after the last phase")


def _positions(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check the limits of the driven joints, and report the minimum distance to a hard limit."""
    findings = []
    for joint in range(len(kinematics.joint_names)):
        beyond_hard = _joint_beyond(
            trajectory, kinematics, joint, "hard", error, kinematics.lower[joint], kinematics.upper[joint]
        )
        # a joint beyond its hard limits is also beyond its soft limits
        findings += beyond_hard or _joint_beyond(
            trajectory, kinematics, joint, "soft", warning, kinematics.soft_lower[joint], kinematics.soft_upper[joint]
        )
    margin = np.minimum(trajectory.q - kinematics.lower, kinematics.upper - trajectory.q)
    if not np.isfinite(margin).any():  # no joint has limits
        return findings
    k, joint = np.unravel_index(int(np.argmin(margin)), margin.shape)
    unit, factor = kinematics.unit(int(joint))
    name = kinematics.joint_names[joint]
    size = Quantity(margin[k, joint] / factor, unit)
    what = f"the minimum distance to a hard limit is {size}, at joint {name}"
    findings.append(info("margin.limit", name, what, size, 0, when=_when(trajectory, int(k)), word=""))
    return findings


def _joint_beyond(
    trajectory: Trajectory,
    kinematics: PathKinematics,
    joint: int,
    kind: str,
    build: Callable[..., Finding],
    low: float,
    high: float,
) -> list[Finding]:
    """Return a finding, made by `build`, if joint j exceeds its "hard" or "soft" limits low..high (m or rad)."""
    q = trajectory.q[:, joint]
    inside = np.minimum(q - low, high - q)
    worst = int(np.argmin(inside))
    if inside[worst] >= -_LIMIT_ROUNDING:
        return []
    name = kinematics.joint_names[joint]
    unit, factor = kinematics.unit(joint)
    size = Quantity(-inside[worst] / factor, unit)
    limits = f"{low / factor:.2f}..{high / factor:.2f} {unit}"
    what = f"joint {name} exceeds its {kind} limits {limits} by {size}"
    return [build(f"limit.{kind}", name, what, size, 0, when=_when(trajectory, worst), word="")]


def _motors(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check the actuators of transmissions: a motor may exceed its limits although all joints are within theirs."""
    findings = []
    motors = kinematics.motors
    for motor, name in enumerate(motors.names):
        unit, factor = motors.unit(motor)
        position = trajectory.q @ motors.rows[motor]
        speed = np.abs(trajectory.qd @ motors.rows[motor])
        low = motors.lower[motor]
        high = motors.upper[motor]
        inside = np.minimum(position - low, high - position)
        lowest = int(np.argmin(inside))
        when = _when(trajectory, lowest)
        limits = f"{low / factor:.2f}..{high / factor:.2f} {unit}"
        # a motor with a gear makes many turns: the rounding grows with its position
        if inside[lowest] < -_LIMIT_ROUNDING * max(1.0, abs(position[lowest])):
            size = Quantity(-inside[lowest] / factor, unit)
            what = f"motor {name} exceeds its limits {limits} by {size}"
            findings.append(error("limit.motor", name, what, size, 0, when=when, word=""))
        elif np.isfinite(inside[lowest]):
            size = Quantity(inside[lowest] / factor, unit)
            what = f"motor {name}: minimum distance to its limits {limits} is {size}"
            findings.append(info("margin.motor", name, what, size, 0, when=when, word=""))
        fastest = int(np.argmax(speed))
        peak = Quantity(float(speed[fastest]) / factor, f"{unit}/s")
        limit = Quantity(motors.max_speed[motor] / factor, f"{unit}/s")
        findings += _rate_beyond(trajectory, "limit.motor_speed", name, f"motor {name}", fastest, peak, limit)
    return findings


def _gaps(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Report the minimum of each gap between two carriages on one rail."""
    findings = []
    for gap in kinematics.gaps:
        distance = np.abs(trajectory.q[:, gap.i] - trajectory.q[:, gap.j])
        smallest = int(np.argmin(distance))
        unit, factor = kinematics.unit(gap.i)
        build = partial(info, "margin.gap")
        if distance[smallest] < gap.smallest - _LIMIT_ROUNDING:
            build = partial(error, "limit.gap")
        size = Quantity(distance[smallest] / factor, unit)
        required = gap.smallest / factor
        what = f"minimum of gap {gap.name}"
        findings.append(build(gap.name, what, size, required, when=_when(trajectory, smallest), word="required"))
    return findings


def _passive(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check the limits of passive joints, at the samples where the mechanism is at the planned pose."""
    if kinematics.passive is None:
        return []
    findings = []
    for name, (margin, is_angle) in kinematics.passive(trajectory.Ts_base_tool, trajectory.q).items():
        if np.isnan(margin).all():
            continue
        smallest = int(np.nanargmin(margin))
        if margin[smallest] < -ROUNDING:
            size = moved(-margin[smallest], is_angle)
            what = f"passive joint {name} exceeds its limits by {size}"
            findings.append(error("limit.passive", name, what, size, 0, when=_when(trajectory, smallest), word=""))
    return findings


def _joint_rates(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check speed, acceleration and, if it is limited, jerk of the driven joints."""
    findings = []
    rates = [
        ("limit.speed", trajectory.qd, kinematics.max_speed, "/s"),
        ("limit.acceleration", trajectory.qdd, kinematics.max_acceleration, "/s2"),
    ]
    if kinematics.max_jerk is not None and np.isfinite(kinematics.max_jerk).any():
        jerk = np.diff(trajectory.qdd, axis=0) / trajectory.step
        rates.append(("limit.jerk", jerk, kinematics.max_jerk, "/s3"))
    for code, values, limits, per in rates:
        for j, name in enumerate(kinematics.joint_names):
            unit, factor = kinematics.unit(j)
            k = int(np.argmax(np.abs(values[:, j])))
            size = Quantity(abs(values[k, j]) / factor, unit + per)
            limit = Quantity(limits[j] / factor, unit + per)
            findings += _rate_beyond(trajectory, code, name, f"joint {name}", k, size, limit)
    return findings


def _tip_rates(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    """Check speed, acceleration and jerk of the moved frame: of its origin, and of its rotation."""
    findings = []
    for i, span in enumerate(trajectory.phases):
        limits = protocol.limits[span.type]
        # A shared sample is at rest; its accelerations are those of the earlier phase, so it counts for that one.
        rows = slice(span.start + min(i, 1), span.stop + 1)
        acceleration = trajectory.tip_acceleration[rows]
        jerk = np.diff(acceleration, axis=0) / trajectory.step
        turn_acceleration = trajectory.angular_acceleration[rows]
        turn_jerk = np.diff(turn_acceleration, axis=0) / trajectory.step
        what = f"{trajectory.frame} in phase '{span.name}'"
        advice = f"plan the protocol again with the limits of the phase, or raise them in [limits.{span.type}]"
        for code, values, limit, unit in (
            ("limit.tip_speed", trajectory.tip_velocity[rows], limits.tip_speed, "m/s"),
            ("limit.tip_acceleration", acceleration, limits.tip_acceleration, "m/s2"),
            ("limit.tip_jerk", jerk, limits.tip_jerk, "m/s3"),
            ("limit.rotation_speed", trajectory.angular_velocity[rows], limits.rotation_speed, "rad/s"),
            ("limit.rotation_acceleration", turn_acceleration, limits.rotation_acceleration, "rad/s2"),
            ("limit.rotation_jerk", turn_jerk, limits.rotation_jerk, "rad/s3"),
        ):
            norms = np.linalg.norm(values, axis=1)
            k = int(np.argmax(norms))
            size = si(norms[k], unit)
            findings += _rate_beyond(
                trajectory, code, trajectory.frame, what, rows.start + k, size, si(limit, unit), advice
            )
    return findings


def _rate_beyond(
    trajectory: Trajectory,
    code: str,
    where: str,
    what: str,
    sample: int,
    size: Quantity,
    limit: Quantity,
    advice: str = "lower the limits of the phase, or raise the limit of the robot",
) -> list[Finding]:
    """Return a finding if `size` at a sample exceeds `limit` by more than `ACCEPTED_EXCESS`, else an empty list."""
    if size.value <= limit.value * (1 + ACCEPTED_EXCESS):
        return []
    when = _when(trajectory, sample)
    return [disagreement(code, where, f"{what} exceeds its limit", size, limit, advice, when=when)]


def _speeds_match_slopes(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check that joint speeds equal the slopes of the positions; tolerance: maximum acceleration times time step."""
    dt = float(trajectory.t[1] - trajectory.t[0])
    slope = (trajectory.q[2:] - trajectory.q[:-2]) / (2 * dt)
    difference = np.abs(slope - trajectory.qd[1:-1])
    excess = difference / (dt * kinematics.max_acceleration * (1 + ACCEPTED_EXCESS))
    if not excess.size:  # fewer than three samples have no slope
        return []
    k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[k, j] <= 1:
        return []
    unit, factor = kinematics.unit(int(j))
    size = Quantity(difference[k, j] / factor, unit + "/s")
    name = kinematics.joint_names[j]
    when = _when(trajectory, int(k) + 1)
    what = f"the speed of joint {name} differs from the slope of its positions"
    return [disagreement("trajectory.inconsistent", name, what, size, suggestion=REPLAN_ADVICE, when=when)]


def _rcm(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    """Return one finding for each registered RCM; the finding covers all phases until the RCM is released."""
    episodes: list[list[PhaseSpan]] = []
    last_rcm: Array | None = None  # RCM in the previous phase
    for span in trajectory.phases:
        if span.rcm is not None:
            is_same = last_rcm is not None and np.array_equal(last_rcm, span.rcm)
            if not is_same or span.type == "insertion":
                episodes.append([])
            episodes[-1].append(span)
        last_rcm = span.rcm
    findings = []
    for spans in episodes:
        findings.append(_rcm_episode(trajectory, protocol, spans))
    return findings


def _rcm_episode(trajectory: Trajectory, protocol: Protocol, spans: Sequence[PhaseSpan]) -> Finding:
    """Return the finding on one RCM, which is registered during the phases `spans`."""
    tolerance = protocol.tolerances.rcm
    alarm = protocol.tolerances.rcm_alarm
    rcm = spans[0].rcm
    assert rcm is not None
    first = spans[0].start
    Ts = trajectory.Ts_base_frame[first : spans[-1].stop + 1]
    errors = rcm_error(Ts, trajectory.shaft_axis, rcm)
    k = int(np.argmax(errors))
    if errors[k] <= tolerance:
        kind = _RCM_KEPT
    elif {span.rcm_mode for span in spans} == {"enforced"}:
        kind = _RCM_NOT_HELD
    else:
        kind = _RCM_MISSED
    x, y, z = rcm / MM
    where = f"RCM at ({x:.2f}, {y:.2f}, {z:.2f}) mm"
    trocar = _trocar(protocol, spans)
    if trocar:
        where = f"trocar {trocar}, {where}"
    what = "maximum distance of the shaft from the RCM"
    if errors[k] > alarm:
        what += f", beyond the clinical alarm at {mm(alarm)}"
    return kind(where, what, mm(errors[k]), mm(tolerance), when=_when(trajectory, first + k))


def _trocar(protocol: Protocol, spans: Sequence[PhaseSpan]) -> str:
    """Return the name of the trocar that the first of the phases `spans` with a trocar names; "" if there is none."""
    names = [span.name for span in spans]
    for phase in protocol.phases:
        if phase.name in names and trocar_of(phase):
            return trocar_of(phase)
    return ""


def _insertion_straightness(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    """Report the maximum distance of the moved frame from the straight line of each insertion."""
    findings = []
    tolerance = protocol.tolerances.straightness
    for span in trajectory.phases:
        if span.type != "insertion":
            continue
        Ts = trajectory.Ts_base_frame[span.start : span.stop + 1]
        axis = Ts[0, :3, :3] @ trajectory.shaft_axis
        errors = spatial.point_to_line(Ts[:, :3, 3], Ts[0, :3, 3], axis)
        k = int(np.argmax(errors))
        kind = _INSERTION_STRAIGHT
        if errors[k] > tolerance:
            kind = _INSERTION_BENT
        what = f"maximum distance of {trajectory.frame} from the insertion line"
        when = _when(trajectory, span.start + k, span)
        findings.append(kind(trajectory.frame, what, mm(errors[k]), mm(tolerance), when=when))
    return findings


def _waypoints(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    """Return a finding for each sample that misses its waypoint in a direction that the protocol prescribes."""
    findings = []
    for name, rows in trajectory.waypoints.items():
        waypoint = protocol.waypoints[name]
        if waypoint.joints is not None:
            findings += _waypoint_joints(trajectory, waypoint, rows)
            continue
        for k in rows:
            findings += _waypoint_pose(trajectory, protocol, waypoint, k)
    return findings


def _waypoint_pose(trajectory: Trajectory, protocol: Protocol, waypoint: Waypoint, k: int) -> list[Finding]:
    """Return a finding if sample k misses a waypoint that is a pose or an orientation about the RCM."""
    free = protocol.free or ()
    # a deviation counts only in directions that the protocol does not declare free
    is_prescribed = np.array([direction not in free for direction in DIRECTIONS])
    R = _rotation(waypoint.angles, protocol.rotation)
    rotation = spatial.log_so3(trajectory.Ts_base_tool[k, :3, :3] @ R.T)
    turn = float(np.linalg.norm(rotation * is_prescribed[3:]))
    if waypoint.position is not None:
        displacement = trajectory.Ts_base_frame[k, :3, 3] - waypoint.position
        distance = float(np.linalg.norm(displacement * is_prescribed[:3]))
    else:
        distance = abs(_depth(trajectory, k) - (waypoint.depth or 0.0))
    tolerance = protocol.tolerances.waypoint
    turn_tolerance = protocol.tolerances.waypoint_angle
    if distance <= tolerance and turn <= turn_tolerance:
        return []
    where = f"waypoint '{waypoint.name}'"
    what = f"the phase ends {mm(distance)} and {deg(turn)} from {where} "
    what += f"(tolerances {mm(tolerance)} and {deg(turn_tolerance)})"
    size = deg(turn)
    limit = deg(turn_tolerance)
    if distance > tolerance:
        size = mm(distance)
        limit = mm(tolerance)
    return [
        disagreement("waypoint.missed", where, what, size, limit, REPLAN_ADVICE, when=_when(trajectory, k), word="")
    ]


def _waypoint_joints(trajectory: Trajectory, waypoint: Waypoint, rows: tuple[int, ...]) -> list[Finding]:
    """Return a finding for each joint that differs from its value in the waypoint at one of the samples `rows`."""
    findings = []
    for joint, value in (waypoint.joints or {}).items():
        q = trajectory.q[list(rows), trajectory.joint_names.index(joint)]
        i = int(np.argmax(np.abs(q - value)))
        difference = float(abs(q[i] - value))
        if difference > _JOINT_VALUE_TOLERANCE:
            what = f"joint {joint} misses waypoint '{waypoint.name}'"
            size = moved(difference, joint in waypoint.angle_joints)
            findings.append(disagreement("waypoint.missed", joint, what, size, 0, when=_when(trajectory, rows[i])))
    return findings


def _depth(trajectory: Trajectory, sample: int) -> float:
    """Return the insertion depth in m at the last sample of a phase; NaN if no RCM is registered."""
    span = _span_at(trajectory, sample)
    if span.rcm is None:
        return np.nan
    T = trajectory.Ts_base_frame[sample]
    return float((T[:3, 3] - span.rcm) @ T[:3, :3] @ trajectory.shaft_axis)


def _rotation(angles: Array, order: RotationOrder) -> Array:
    """Return R (3, 3) for angles (3,) in rad, computed independently of the code that planned the path."""
    if order == "xyz":  # Rx(a) Ry(b) Rz(c) is the inverse of Rz(-c) Ry(-b) Rx(-a)
        return _rotation(-angles[::-1], "zyx").T
    cz, cy, cx = np.cos(angles)
    sz, sy, sx = np.sin(angles)
    # Rz Ry Rx, multiplied out
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def _singularities(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Report the minimum of each singularity measure, or where it changes its sign."""
    findings = []
    for name, values in kinematics.singularity(trajectory.Ts_base_tool, trajectory.q).items():
        alarm = kinematics.alarm(name)
        has_crossed = values * values[0] <= 0
        if has_crossed.any():
            k = int(np.argmax(has_crossed))
            what = f"the singularity measure {name} changes its sign: the motion crosses a singularity"
            size = Quantity(values[k])
            findings.append(error("singularity.crossed", name, what, size, alarm, when=_when(trajectory, k), word=""))
            continue
        k = int(np.argmin(np.abs(values)))
        size = float(abs(values[k]))
        kind = _SINGULARITY_MARGIN
        if size < alarm:
            kind = _SINGULARITY_NEAR
        what = f"minimum of the singularity measure {name}"
        findings.append(kind(name, what, Quantity(size), alarm, when=_when(trajectory, k)))
    return findings


def _branches(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Return a finding at the first sample with another working mode than the first one."""
    if kinematics.branch is None:
        return []
    labels = kinematics.branch(trajectory.Ts_base_tool, trajectory.q)
    is_other = labels != labels[0]
    if not is_other.any():
        return []
    k = int(np.argmax(is_other))
    text = f"the working mode changes from {labels[0]} to {labels[k]}"
    return [error("branch.changed", "", text, when=_when(trajectory, k))]


def _reach(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Report the minimum remaining reach of each part that limits the workspace."""
    findings = []
    for name, margin in kinematics.reach(trajectory.Ts_base_tool).items():
        k = int(np.argmin(margin))
        what = f"minimum remaining reach of {name}"
        severity: Severity = "error"
        if margin[k] >= 0:
            severity = "info"
        when = _when(trajectory, k)
        findings.append(finding(severity, "margin.reach", name, what, mm(margin[k]), 0, when=when, word="required"))
    return findings
