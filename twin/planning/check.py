"""Judges a finished trajectory from its samples alone, whatever planned it."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol import Protocol, RotationOrder, Waypoint, trocar_of
from twin.planning.trajectory import PathKinematics, PhaseSpan, Trajectory

OVER = 1e-3
"""Fraction by which a sample may exceed a speed or acceleration limit."""

AGAIN = "plan the protocol again: these samples are not what was planned within the limits"
"""The way out where samples are not those of a plan."""


def check(trajectory: Trajectory, protocol: Protocol, kinematics: PathKinematics) -> list[Finding]:
    """Return what is wrong with a trajectory, and its smallest margins as infos.

    Args:
        trajectory: the samples; its per-sample margins and RCM errors are not trusted but computed again.
        protocol: limits of the phases and tolerances.
        kinematics: limits of the joints, singularities, branches.
    """
    return [
        *_positions(trajectory, kinematics),
        *_motors(trajectory, kinematics),
        *_gaps(trajectory, kinematics),
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
    """Return the distance (k,) in m from the RCM (3,) to the shaft of the moved frame (k, 4, 4)."""
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
        for code, low, high in (
            ("limit.hard", kinematics.lower[j], kinematics.upper[j]),
            ("limit.soft", kinematics.soft_lower[j], kinematics.soft_upper[j]),
        ):
            inside = np.minimum(trajectory.q[:, j] - low, high - trajectory.q[:, j])
            k = int(np.argmin(inside))
            if inside[k] < -1e-12:
                value = trajectory.q[k, j] / factor
                kind = "hard" if code == "limit.hard" else "soft"
                out.append(
                    Finding(
                        code,
                        "error" if kind == "hard" else "warning",
                        f"joint {name} reaches {value:.2f} {unit}, {-inside[k] / factor:.2f} {unit} beyond "
                        f"its {kind} limits {low / factor:.2f}..{high / factor:.2f} {unit}",
                        where=name,
                        when=_when(trajectory, k),
                        size=float(-inside[k] / factor),
                        unit=unit,
                        limit=0.0,
                    )
                )
                break  # beyond the hard limits says beyond the soft ones too
    margin = np.minimum(trajectory.q - kinematics.lower, kinematics.upper - trajectory.q)
    if not np.isfinite(margin).any():  # no joint has limits
        return out
    k, j = np.unravel_index(int(np.argmin(margin)), margin.shape)
    unit, factor = kinematics.unit(int(j))
    size = float(margin[k, j] / factor)
    text = f"the joint closest to a hard limit is {kinematics.joint_names[j]}, {size:.2f} {unit} away"
    when = _when(trajectory, int(k))
    out.append(Finding("margin.limit", "info", text, kinematics.joint_names[j], when, size, unit, 0.0))
    return out


def _motors(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Hold the actuators of transmissions against their limits: joints within theirs may ask too much of a motor."""
    out, motors = [], kinematics.motors
    for i, name in enumerate(motors.names):
        unit, factor = motors.unit(i)
        m, rate = trajectory.q @ motors.rows[i], np.abs(trajectory.qd @ motors.rows[i])
        low, high = motors.lower[i], motors.upper[i]
        inside = np.minimum(m - low, high - m)
        k = int(np.argmin(inside))
        size, when = float(inside[k] / factor), _when(trajectory, k)
        limits = f"limits {low / factor:.2f}..{high / factor:.2f} {unit}"
        if inside[k] < -1e-12 * max(1.0, abs(m[k])):
            text = f"motor {name} reaches {m[k] / factor:.2f} {unit}, {-size:.2f} {unit} beyond its {limits}"
            out.append(Finding("limit.motor", "error", text, name, when, -size, unit, 0.0))
        elif np.isfinite(size):
            text = f"motor {name} stays {size:.2f} {unit} within its {limits}"
            out.append(Finding("margin.motor", "info", text, name, when, size, unit, 0.0))
        k = int(np.argmax(rate))
        peak, limit = float(rate[k]), motors.max_speed[i]
        out += _over(trajectory, "limit.motor_speed", f"motor {name}", name, k, peak, limit, f"{unit}/s", factor)
    return out


def _gaps(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for gap in kinematics.gaps:
        between = np.abs(trajectory.q[:, gap.i] - trajectory.q[:, gap.j])
        k = int(np.argmin(between))
        unit, factor = kinematics.unit(gap.i)
        size, need = float(between[k] / factor), gap.smallest / factor
        bad = between[k] < gap.smallest - 1e-12
        text = f"gap {gap.name} falls to {size:.2f} {unit}; it needs {need:g} {unit}"
        code = "limit.gap" if bad else "margin.gap"
        when = _when(trajectory, k)
        out.append(Finding(code, "error" if bad else "info", text, gap.name, when, size, unit, need))
    return out


def _joint_rates(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for code, values, limits, per in (
        ("limit.speed", trajectory.qd, kinematics.max_speed, "/s"),
        ("limit.acceleration", trajectory.qdd, kinematics.max_acceleration, "/s2"),
    ):
        for j, name in enumerate(kinematics.joint_names):
            unit, factor = kinematics.unit(j)
            k = int(np.argmax(np.abs(values[:, j])))
            size = float(abs(values[k, j]))
            out += _over(trajectory, code, f"joint {name}", name, k, size, limits[j], unit + per, factor)
    return out


def _tip_rates(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    out = []
    for i, span in enumerate(trajectory.phases):
        limits = protocol.limits[span.type]
        rows = slice(span.start + min(i, 1), span.stop + 1)  # the sample between phases is the earlier one's
        a, dw = trajectory.tip_acceleration[rows], trajectory.angular_acceleration[rows]
        for code, values, limit, unit, factor in (
            ("limit.tip_speed", trajectory.tip_velocity[rows], limits.tip_speed, "mm/s", MM),
            ("limit.tip_acceleration", a, limits.tip_acceleration, "mm/s2", MM),
            ("limit.tip_jerk", np.diff(a, axis=0) / trajectory.step, limits.tip_jerk, "mm/s3", MM),
            ("limit.rotation_speed", trajectory.angular_velocity[rows], limits.rotation_speed, "deg/s", DEG),
            ("limit.rotation_acceleration", dw, limits.rotation_acceleration, "deg/s2", DEG),
            ("limit.rotation_jerk", np.diff(dw, axis=0) / trajectory.step, limits.rotation_jerk, "deg/s3", DEG),
        ):
            norms = np.linalg.norm(values, axis=1)
            k = int(np.argmax(norms))
            size = float(norms[k])
            what = f"{trajectory.frame} in phase '{span.name}'"
            out += _over(trajectory, code, what, trajectory.frame, rows.start + k, size, limit, unit, factor)
    return out


def _over(
    trajectory: Trajectory,
    code: str,
    what: str,
    where: str,
    sample: int,
    size: float,
    limit: float,
    unit: str,
    factor: float,
) -> list[Finding]:
    if size <= limit * (1 + OVER):
        return []
    text = f"{what} reaches {size / factor:.4g} {unit}, above its limit of {limit / factor:.4g} {unit}"
    when = _when(trajectory, sample)
    way = "give the phase a lower limit or more time, or the robot a higher limit"
    return [Finding(code, "disagreement", text, where, when, size / factor, unit, limit / factor, way)]


def _consistent(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    """Speeds and positions belong together: differences of q stay within what the accelerations allow."""
    dt = float(trajectory.t[1] - trajectory.t[0])
    slope = (trajectory.q[2:] - trajectory.q[:-2]) / (2 * dt)
    error = np.abs(slope - trajectory.qd[1:-1]) / (dt * kinematics.max_acceleration * (1 + OVER))
    k, j = np.unravel_index(int(np.argmax(error)), error.shape) if error.size else (0, 0)
    if not error.size or error[k, j] <= 1:
        return []
    unit, factor = kinematics.unit(int(j))
    size = float(abs(slope[k, j] - trajectory.qd[k + 1, j]) / factor)
    name = kinematics.joint_names[j]
    text = f"joint {name}: its speed differs from the slope of its positions by {size:.3g} {unit}/s"
    when = _when(trajectory, int(k) + 1)
    return [Finding("trajectory.inconsistent", "disagreement", text, name, when, size, unit + "/s", suggestion=AGAIN)]


def _rcm(trajectory: Trajectory, protocol: Protocol) -> list[Finding]:
    """Return one finding for each registered RCM, over all phases until it is given up."""
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
        size, at = float(errors[k]), ", ".join(f"{x / MM:.2f}" for x in rcm)
        trocar = next((t for p in protocol.phases for s in spans if p.name == s.name and (t := trocar_of(p))), "")
        missed = size > tolerance
        text = f"the shaft passes the RCM at up to {size / MM:.4g} mm; {tolerance / MM:g} mm is allowed"
        if size > alarm:
            text += f", and {alarm / MM:g} mm is the clinical alarm"
        out.append(
            Finding(
                "rcm.missed" if missed else "rcm.kept",
                "disagreement" if missed else "info",
                text,
                where=f"trocar {trocar}, RCM at ({at}) mm" if trocar else f"RCM at ({at}) mm",
                when=_when(trajectory, first + k),
                size=size / MM,
                unit="mm",
                limit=tolerance / MM,
                suggestion='pivot with rcm = "enforced" to a waypoint with depth_mm' if missed else "",
            )
        )
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
        bent = errors[k] > tolerance
        text = f"{trajectory.frame} leaves the line of the insertion by up to {errors[k] / MM:.3g} mm; "
        out.append(
            Finding(
                "insertion.bent" if bent else "insertion.straight",
                "disagreement" if bent else "info",
                text + f"{tolerance / MM:g} mm is allowed",
                where=trajectory.frame,
                when=_when(trajectory, span.start + k, span),
                size=float(errors[k] / MM),
                unit="mm",
                limit=tolerance / MM,
                suggestion=AGAIN if bent else "",
            )
        )
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
            text = f"the phase ends {off / MM:.3f} mm and {turn / DEG:.3f} deg beside waypoint '{name}'; "
            text += f"{t.waypoint / MM:g} mm and {t.waypoint_angle / DEG:g} deg are allowed"
            far = off > t.waypoint
            size, unit = (off / MM, "mm") if far else (turn / DEG, "deg")
            limit = t.waypoint / MM if far else t.waypoint_angle / DEG
            when = _when(trajectory, k)
            where = f"waypoint '{name}'"
            out.append(Finding("waypoint.missed", "disagreement", text, where, when, size, unit, limit, AGAIN))
    return out


def _values(trajectory: Trajectory, waypoint: Waypoint, rows: tuple[int, ...]) -> list[Finding]:
    """Return the joints that are not at the values of their waypoint."""
    out = []
    for joint, value in (waypoint.joints or {}).items():
        unit, factor = ("deg", DEG) if joint in waypoint.angle_joints else ("mm", MM)
        q = trajectory.q[list(rows), trajectory.joint_names.index(joint)]
        i = int(np.argmax(np.abs(q - value)))
        off = float(abs(q[i] - value))
        if off > 1e-9:
            text = f"joint {joint} is {off / factor:.4g} {unit} beside its value at waypoint '{waypoint.name}'"
            when = _when(trajectory, rows[i])
            out.append(Finding("waypoint.missed", "disagreement", text, joint, when, off / factor, unit, 0.0))
    return out


def _depth(trajectory: Trajectory, sample: int) -> float:
    span = next(p for p in trajectory.phases if p.stop == sample)
    T = trajectory.Ts_base_frame[sample]
    return np.nan if span.rcm is None else float((T[:3, 3] - span.rcm) @ T[:3, :3] @ trajectory.shaft_axis)


def _rotation(angles: Array, order: RotationOrder) -> Array:
    """Return R (3, 3) written out, so that the check shares nothing with the path that it judges."""
    if order == "xyz":  # Rx(a) Ry(b) Rz(c) undoes Rz(-c) Ry(-b) Rx(-a)
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
            text = f"the singularity measure {name} changes its sign: the motion crosses a singularity"
            out.append(
                Finding(
                    "singularity.crossed",
                    "error",
                    text,
                    name,
                    _when(trajectory, k),
                    float(values[k]),
                    "",
                    alarm,
                )
            )
            continue
        near = size < alarm
        text = f"the singularity measure {name} falls to {size:.4f}" + (f"; alarm {alarm:g}" if alarm else "")
        code = "singularity.near" if near else "margin.singularity"
        when = _when(trajectory, k)
        out.append(Finding(code, "warning" if near else "info", text, name, when, size, "", alarm))
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
    return [Finding("branch.changed", "error", text, when=_when(trajectory, k))]


def _reach(trajectory: Trajectory, kinematics: PathKinematics) -> list[Finding]:
    out = []
    for name, margin in kinematics.reach(trajectory.Ts_base_tool).items():
        k = int(np.argmin(margin))
        size, when = float(margin[k] / MM), _when(trajectory, k)
        text = f"{name} has {size:.2f} mm of reach left where it has least"
        out.append(Finding("margin.reach", "info" if size >= 0 else "error", text, name, when, size, "mm", 0.0))
    return out
