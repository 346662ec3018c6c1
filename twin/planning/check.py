"""Check a finished trajectory from its samples alone."""

from __future__ import annotations

from functools import partial

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, Kind, disagreement, error, finding, info, warning
from twin.core.quantity import Quantity, deg, mm, moved, si
from twin.core.spatial import Array
from twin.core.units import MM, ROUNDING
from twin.planning.protocol import Protocol, RotationOrder, Waypoint, trocar_of
from twin.planning.trajectory import PathKinematics, PhaseSpan, Trajectory

OVER = 1e-3
"""Fraction by which a sample may exceed a limit of speed, acceleration or jerk."""

AGAIN = "plan the protocol again: these samples differ from the planned ones"
"""Suggestion for samples that differ from the planned ones."""


_MISSED = Kind("rcm.missed", "disagreement", 'use rcm = "enforced" and a waypoint with depth_mm', word="tolerance")
_BLOCKED = Kind("rcm.missed", "disagreement", "the robot cannot hold the RCM: remove directions from `free`")
_KEPT = Kind("rcm.kept", "info", word="tolerance")
_BENT = Kind("insertion.bent", "disagreement", AGAIN, word="tolerance")
_STRAIGHT = Kind("insertion.straight", "info", word="tolerance")
_NEAR = Kind("singularity.near", "warning", word="alarm")
_SINGULARITY = Kind("margin.singularity", "info", word="alarm")


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
        *_consistent(trajectory, kinematics),
        *_rcm(trajectory, protocol),
        *_straight(trajectory, protocol),
        *_waypoints(trajectory, protocol),
        *_singular(trajectory, kinematics),
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
    t = float(trajectory.t[sample])
    span = span or next(p for p in trajectory.phases if sample <= p.stop)
    met = [n for n, rows in trajectory.waypoints.items() if sample in rows]
    return f"phase '{span.name}', t = {t:.3f} s" + (f", waypoint '{met[0]}'" if met else "")


def _positions(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for j, name in enumerate(kinematics.joint_names):
        unit, factor = kinematics.unit(j)
        for kind, build, low, high in (
            ("hard", error, kinematics.lower[j], kinematics.upper[j]),
            ("soft", warning, kinematics.soft_lower[j], kinematics.soft_upper[j]),
        ):
            inside = np.minimum(trajectory.q[:, j] - low, high - trajectory.q[:, j])
            k = int(np.argmin(inside))
            if inside[k] < -1e-12:
                size = Quantity(-inside[k] / factor, unit)
                what = (
                    f"joint {name} exceeds its {kind} limits {low / factor:.2f}..{high / factor:.2f} {unit} by {size}"
                )
                out.append(build(f"limit.{kind}", name, what, size, 0, when=_when(trajectory, k), word=""))
                break  # a joint beyond its hard limits is also beyond its soft limits
    margin = np.minimum(trajectory.q - kinematics.lower, kinematics.upper - trajectory.q)
    if not np.isfinite(margin).any():  # no joint has limits
        return out
    k, j = np.unravel_index(int(np.argmin(margin)), margin.shape)
    unit, factor = kinematics.unit(int(j))
    name, size = kinematics.joint_names[j], Quantity(margin[k, j] / factor, unit)
    what = f"the minimum distance to a hard limit is {size}, at joint {name}"
    out.append(info("margin.limit", name, what, size, 0, when=_when(trajectory, int(k)), word=""))
    return out


def _motors(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check the actuators of transmissions: a motor may exceed its limits although all joints are within theirs."""
    out, motors = [], kinematics.motors
    for i, name in enumerate(motors.names):
        unit, factor = motors.unit(i)
        m, rate = trajectory.q @ motors.rows[i], np.abs(trajectory.qd @ motors.rows[i])
        low, high = motors.lower[i], motors.upper[i]
        inside = np.minimum(m - low, high - m)
        k = int(np.argmin(inside))
        when, limits = _when(trajectory, k), f"{low / factor:.2f}..{high / factor:.2f} {unit}"
        if inside[k] < -1e-12 * max(1.0, abs(m[k])):
            size = Quantity(-inside[k] / factor, unit)
            what = f"motor {name} exceeds its limits {limits} by {size}"
            out.append(error("limit.motor", name, what, size, 0, when=when, word=""))
        elif np.isfinite(inside[k]):
            size = Quantity(inside[k] / factor, unit)
            what = f"motor {name}: minimum distance to its limits {limits} is {size}"
            out.append(info("margin.motor", name, what, size, 0, when=when, word=""))
        k = int(np.argmax(rate))
        peak, limit = (Quantity(v / factor, f"{unit}/s") for v in (float(rate[k]), motors.max_speed[i]))
        out += _over(trajectory, "limit.motor_speed", name, f"motor {name}", k, peak, limit)
    return out


def _gaps(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for gap in kinematics.gaps:
        between = np.abs(trajectory.q[:, gap.i] - trajectory.q[:, gap.j])
        k = int(np.argmin(between))
        unit, factor = kinematics.unit(gap.i)
        build = partial(error, "limit.gap") if between[k] < gap.smallest - 1e-12 else partial(info, "margin.gap")
        size, need = Quantity(between[k] / factor, unit), gap.smallest / factor
        what = f"minimum of gap {gap.name}"
        out.append(build(gap.name, what, size, need, when=_when(trajectory, k), word="required"))
    return out


def _passive(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check the limits of passive joints, at the samples where the mechanism is at the planned pose."""
    if kinematics.passive is None:
        return []
    out = []
    for name, (margin, is_angle) in kinematics.passive(trajectory.Ts_base_tool, trajectory.q).items():
        if np.isnan(margin).all():
            continue
        k = int(np.nanargmin(margin))
        if margin[k] < -ROUNDING:
            size = moved(-margin[k], is_angle)
            what = f"passive joint {name} exceeds its limits by {size}"
            out.append(error("limit.passive", name, what, size, 0, when=_when(trajectory, k), word=""))
    return out


def _joint_rates(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    rates = [
        ("limit.speed", trajectory.qd, kinematics.max_speed, "/s"),
        ("limit.acceleration", trajectory.qdd, kinematics.max_acceleration, "/s2"),
    ]
    if kinematics.max_jerk is not None and np.isfinite(kinematics.max_jerk).any():
        rates.append(("limit.jerk", np.diff(trajectory.qdd, axis=0) / trajectory.step, kinematics.max_jerk, "/s3"))
    for code, values, limits, per in rates:
        for j, name in enumerate(kinematics.joint_names):
            unit, factor = kinematics.unit(j)
            k = int(np.argmax(np.abs(values[:, j])))
            size, limit = (Quantity(v / factor, unit + per) for v in (abs(values[k, j]), limits[j]))
            out += _over(trajectory, code, name, f"joint {name}", k, size, limit)
    return out


def _tip_rates(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    out = []
    for i, span in enumerate(trajectory.phases):
        limits = protocol.limits[span.type]
        rows = slice(span.start + min(i, 1), span.stop + 1)  # a shared sample counts for the earlier phase
        a, dw = trajectory.tip_acceleration[rows], trajectory.angular_acceleration[rows]
        for code, values, limit, unit in (
            ("limit.tip_speed", trajectory.tip_velocity[rows], limits.tip_speed, "m/s"),
            ("limit.tip_acceleration", a, limits.tip_acceleration, "m/s2"),
            ("limit.tip_jerk", np.diff(a, axis=0) / trajectory.step, limits.tip_jerk, "m/s3"),
            ("limit.rotation_speed", trajectory.angular_velocity[rows], limits.rotation_speed, "rad/s"),
            ("limit.rotation_acceleration", dw, limits.rotation_acceleration, "rad/s2"),
            ("limit.rotation_jerk", np.diff(dw, axis=0) / trajectory.step, limits.rotation_jerk, "rad/s3"),
        ):
            norms = np.linalg.norm(values, axis=1)
            k = int(np.argmax(norms))
            what, size = f"{trajectory.frame} in phase '{span.name}'", si(norms[k], unit)
            way = f"plan the protocol again with the limits of the phase, or raise them in [limits.{span.type}]"
            out += _over(trajectory, code, trajectory.frame, what, rows.start + k, size, si(limit, unit), way)
    return out


def _over(
    trajectory: Trajectory,
    code: str,
    where: str,
    what: str,
    sample: int,
    size: Quantity,
    limit: Quantity,
    way: str = "lower the limits of the phase, or raise the limit of the robot",
) -> list[Finding]:
    if size.value <= limit.value * (1 + OVER):
        return []
    return [disagreement(code, where, f"{what} exceeds its limit", size, limit, way, when=_when(trajectory, sample))]


def _consistent(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Check that joint speeds equal the slopes of the positions; tolerance: maximum acceleration times time step."""
    dt = float(trajectory.t[1] - trajectory.t[0])
    slope = (trajectory.q[2:] - trajectory.q[:-2]) / (2 * dt)
    error = np.abs(slope - trajectory.qd[1:-1]) / (dt * kinematics.max_acceleration * (1 + OVER))
    k, j = np.unravel_index(int(np.argmax(error)), error.shape) if error.size else (0, 0)
    if not error.size or error[k, j] <= 1:
        return []
    unit, factor = kinematics.unit(int(j))
    size = Quantity(abs(slope[k, j] - trajectory.qd[k + 1, j]) / factor, unit + "/s")
    name, when = kinematics.joint_names[j], _when(trajectory, int(k) + 1)
    what = f"the speed of joint {name} differs from the slope of its positions"
    return [disagreement("trajectory.inconsistent", name, what, size, suggestion=AGAIN, when=when)]


def _rcm(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    """Return one finding for each registered RCM; the finding covers all phases until the RCM is released."""
    episodes: list[list[PhaseSpan]] = []
    for before, span in zip((None, *trajectory.phases), trajectory.phases, strict=False):
        if span.rcm is None:
            continue
        same = before is not None and before.rcm is not None and np.array_equal(before.rcm, span.rcm)
        if not same or span.type == "insertion":
            episodes.append([])
        episodes[-1].append(span)
    out = []
    tolerance, alarm = protocol.tolerances.rcm, protocol.tolerances.rcm_alarm
    for spans in episodes:
        rcm = spans[0].rcm
        assert rcm is not None
        first, last = spans[0].start, spans[-1].stop + 1
        errors = rcm_error(trajectory.Ts_base_frame[first:last], trajectory.shaft_axis, rcm)
        k = int(np.argmax(errors))
        at = ", ".join(f"{x / MM:.2f}" for x in rcm)
        trocar = next((t for p in protocol.phases for s in spans if p.name == s.name and (t := trocar_of(p))), "")
        missed = _BLOCKED if all(s.rcm_mode == "enforced" for s in spans) else _MISSED
        kind = missed if errors[k] > tolerance else _KEPT
        where = f"trocar {trocar}, RCM at ({at}) mm" if trocar else f"RCM at ({at}) mm"
        clinical = f", beyond the clinical alarm at {mm(alarm)}" if errors[k] > alarm else ""
        what = f"maximum distance of the shaft from the RCM{clinical}"
        out.append(kind(where, what, mm(errors[k]), mm(tolerance), when=_when(trajectory, first + k)))
    return out


def _straight(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    out = []
    tolerance = protocol.tolerances.straightness
    for span in trajectory.phases:
        if span.type != "insertion":
            continue
        Ts = trajectory.Ts_base_frame[span.start : span.stop + 1]
        axis = Ts[0, :3, :3] @ trajectory.shaft_axis
        errors = spatial.point_to_line(Ts[:, :3, 3], Ts[0, :3, 3], axis)
        k = int(np.argmax(errors))
        kind = _BENT if errors[k] > tolerance else _STRAIGHT
        what, when = (
            f"maximum distance of {trajectory.frame} from the insertion line",
            _when(trajectory, span.start + k, span),
        )
        out.append(kind(trajectory.frame, what, mm(errors[k]), mm(tolerance), when=when))
    return out


def _waypoints(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    out = []
    t = protocol.tolerances
    for name, rows in trajectory.waypoints.items():
        waypoint = protocol.waypoints[name]
        if waypoint.joints is not None:
            out += _values(trajectory, waypoint, rows)
            continue
        for k in rows:
            R = _rotation(waypoint.angles, protocol.rotation)
            held = np.array([f"{kind}{axis}" not in (protocol.free or ()) for kind in ("", "turn_") for axis in "xyz"])
            turned = spatial.log_so3(trajectory.Ts_base_tool[k, :3, :3] @ R.T)
            turn = float(np.linalg.norm(turned * held[3:]))
            if waypoint.position is not None:
                way = trajectory.Ts_base_frame[k, :3, 3] - waypoint.position
                off = float(np.linalg.norm(way * held[:3]))
            else:
                off = abs(_depth(trajectory, k) - (waypoint.depth or 0.0))
            if off <= t.waypoint and turn <= t.waypoint_angle:
                continue
            what = f"the phase ends {mm(off)} and {deg(turn)} from waypoint '{name}' "
            what += f"(tolerances {mm(t.waypoint)} and {deg(t.waypoint_angle)})"
            sizes = (mm(off), mm(t.waypoint)) if off > t.waypoint else (deg(turn), deg(t.waypoint_angle))
            when = _when(trajectory, k)
            out.append(disagreement("waypoint.missed", f"waypoint '{name}'", what, *sizes, AGAIN, when=when, word=""))
    return out


def _values(trajectory: Trajectory, waypoint: Waypoint, rows: tuple[int, ...]) -> list[Finding]:
    """Return a finding for each joint that differs from its value in the waypoint at one of the samples `rows`."""
    out = []
    for joint, value in (waypoint.joints or {}).items():
        q = trajectory.q[list(rows), trajectory.joint_names.index(joint)]
        i = int(np.argmax(np.abs(q - value)))
        off = float(abs(q[i] - value))
        if off > 1e-9:
            what, size = f"joint {joint} misses waypoint '{waypoint.name}'", moved(off, joint in waypoint.angle_joints)
            out.append(disagreement("waypoint.missed", joint, what, size, 0, when=_when(trajectory, rows[i])))
    return out


def _depth(trajectory: Trajectory, sample: int) -> float:
    span = next(p for p in trajectory.phases if p.stop == sample)
    T = trajectory.Ts_base_frame[sample]
    return np.nan if span.rcm is None else float((T[:3, 3] - span.rcm) @ T[:3, :3] @ trajectory.shaft_axis)


def _rotation(angles: Array, order: RotationOrder) -> Array:
    """Return R (3, 3) for angles (3,) in rad, computed independently of the code that planned the path."""
    if order == "xyz":  # Rx(a) Ry(b) Rz(c) is the inverse of Rz(-c) Ry(-b) Rx(-a)
        return _rotation(-angles[::-1], "zyx").T
    (cz, cy, cx), (sz, sy, sx) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def _singular(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for name, values in kinematics.singularity(trajectory.Ts_base_tool, trajectory.q).items():
        k, alarm = int(np.argmin(np.abs(values))), kinematics.alarm(name)
        size = float(abs(values[k]))
        if np.any(values * values[0] <= 0):
            k = int(np.argmax(values * values[0] <= 0))
            what = f"the singularity measure {name} changes its sign: the motion crosses a singularity"
            size, when = Quantity(values[k]), _when(trajectory, k)
            out.append(error("singularity.crossed", name, what, size, alarm, when=when, word=""))
            continue
        kind = _NEAR if size < alarm else _SINGULARITY
        what = f"minimum of the singularity measure {name}"
        out.append(kind(name, what, Quantity(size), alarm, when=_when(trajectory, k)))
    return out


def _branches(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    if kinematics.branch is None:
        return []
    labels = kinematics.branch(trajectory.Ts_base_tool, trajectory.q)
    other = labels != labels[0]
    if not other.any():
        return []
    k = int(np.argmax(other))
    text = f"the working mode changes from {labels[0]} to {labels[k]}"
    return [error("branch.changed", "", text, when=_when(trajectory, k))]


def _reach(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for name, margin in kinematics.reach(trajectory.Ts_base_tool).items():
        k = int(np.argmin(margin))
        what = f"minimum remaining reach of {name}"
        severity = "info" if margin[k] >= 0 else "error"
        when = _when(trajectory, k)
        out.append(finding(severity, "margin.reach", name, what, mm(margin[k]), 0, when=when, word="required"))
    return out
