"""Find fixes for a waypoint at which the shaft misses the RCM, and check whether each fixed protocol is reachable.

Each fix changes one value or one pose of the protocol. The changed protocol is planned with an enforced pivot about the
RCM, so that the shaft passes through the RCM everywhere; the planner reports whether the motion is reachable. For
comparison, the RCM error of a straight path to the same pose is computed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from twin.core import spatial
from twin.core.errors import ProtocolError, TimingError
from twin.core.findings import Finding, info
from twin.core.quantity import deg, mm
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.check import rcm_error
from twin.planning.path_kinematics import PathKinematics
from twin.planning.plan import plan
from twin.planning.protocol import Pivot, Protocol, Waypoint
from twin.planning.protocol.course import angles_of, rotation
from twin.planning.trajectory import PhaseSpan, Trajectory

PLANNED_STEP = 0.02
"""Time step in s of a planned fix."""

_LEAST_REPORTED_ERROR = 1e-5
"""RCM error in m of a straight path above which it is reported."""

_LARGEST_COMMON_DISTANCE = 1e-4
"""Largest distance in m from both shafts of an RCM that fits both."""

_TIP_AT_RCM = 1e-6
"""Distance in m of the tip from the RCM up to which it is at the RCM."""

_SMALLEST_TURN = 1e-12
"""Angle in rad between shaft and direction to the RCM up to which nothing needs to turn."""

_HALF_TURN_MARGIN = 1e-6
"""Difference in rad from half a turn below which the axis of the turn is undefined."""

_SMALLEST_EIGENVALUE = 1e-9
"""Smallest eigenvalue of the sum of two projections below which the axes are parallel."""

_MOTION_ROUNDING = 1e-9
"""Translation in m or rotation in rad up to which a fix does not move or turn the waypoint."""

Planner = Callable[[Protocol], Trajectory]


@dataclass(frozen=True)
class Fix:
    """One change of the protocol, with which the shaft passes through the RCM at a waypoint.

    Attributes:
        name: kind of change.
        waypoint: name of the changed waypoint; "" if the RCM is changed.
        moved, turned: translation in m and rotation in rad by which the change moves the waypoint or the RCM.
        value: the new values, as text.
        reachable: whether the robot can carry out the complete protocol with this change.
        why: if `reachable`, the smallest margin, otherwise the reason.
        straight: largest RCM error in m on a straight path to the new pose; NaN if the path could not be planned.
    """

    name: str
    waypoint: str
    moved: float
    turned: float
    value: str
    reachable: bool
    why: str
    straight: float = float("nan")

    @property
    def text(self) -> str:
        """The fix, its size and reachability in one sentence."""
        sizes = []
        if self.moved > 0:
            sizes.append(str(mm(self.moved)))
        if self.turned > 0:
            sizes.append(str(deg(self.turned)))
        change = self.name
        if sizes:
            change += f", by {' and '.join(sizes)}"
        reach = f"out of reach: {self.why}"
        if self.reachable:
            reach = f"the robot can do the protocol ({self.why})"
        text = f"{change}: {self.value}; {reach}"
        if self.straight > _LEAST_REPORTED_ERROR:
            text += (
                f"; on the straight path, the shaft would still miss the RCM by {self.straight / MM:.2f} mm at a point "
                "between the ends of the path"
            )
        return text


def rcm_fixes(
    protocol: Protocol, trajectory: Trajectory, paths: PathKinematics, T_tool_frame: Array
) -> tuple[dict[str, str], list[Finding]]:
    """Return (facts as text, findings) on fixes of the phases in which the shaft misses a monitored RCM.

    `paths` is the robot's planning data; `T_tool_frame` (4, 4) is the pose of the protocol's frame in the tool frame.
    """

    def planner(changed: Protocol) -> Trajectory:
        return plan(changed, paths, T_tool_frame=T_tool_frame, dt=PLANNED_STEP)

    facts: dict[str, str] = {}
    findings: list[Finding] = []
    for span in trajectory.phases:
        if span.rcm is None or span.rcm_mode != "monitored" or span.waypoint is None:
            continue
        rows = slice(span.start, span.stop + 1)
        errors = rcm_error(trajectory.Ts_base_frame[rows], trajectory.shaft_axis, span.rcm)
        if errors.max() <= protocol.tolerances.rcm:
            continue
        for fix in [*_waypoint_fixes(protocol, trajectory, span, planner), *_moved_rcm_fixes(trajectory, span)]:
            facts[f"{span.name}: {fix.name}"] = fix.text
            if not fix.reachable:
                continue
            size = deg(fix.turned)
            if fix.moved > 0:
                size = mm(fix.moved)
            findings.append(
                info(
                    "rcm.fix",
                    f"waypoint '{span.waypoint}'",
                    f"with this change, the shaft passes through the RCM at '{span.waypoint}': {fix.text}",
                    size,
                    when=f"phase '{span.name}'",
                    word="",
                )
            )
        facts[f"{span.name}: other interpretations of the angles"] = _other_angle_conventions(
            protocol, trajectory, span
        )
    return facts, findings


def nearest_pose_through_rcm(T: Array, axis: Array, rcm: Array, lever: float) -> Array:
    """Return the pose (4, 4) at which the shaft passes through the RCM, with the minimum motion from T.

    T is the pose (4, 4) of the moved frame, `axis` the shaft direction (3,) in this frame, `rcm` the RCM (3,) in m in
    the parent frame of T. The motion is a translation and a rotation; `lever` is the weight of the rotation in m/rad.
    """
    from scipy.optimize import minimize

    R0 = T[:3, :3]
    unit_axis = axis / np.linalg.norm(axis)
    shaft0 = R0 @ unit_axis
    to_rcm = rcm - T[:3, 3]
    # two directions across the shaft: a turn about the shaft changes nothing
    across = np.linalg.svd(np.eye(3) - np.outer(shaft0, shaft0))[0][:, :2]

    def shaft_onto_rcm(turn: Array) -> tuple[Array, Array]:
        """Return (rotation, translation (3,) that then takes the shaft to the RCM) for a turn (2,) in rad."""
        R = spatial.exp_so3(across @ turn) @ R0
        shaft = R @ unit_axis
        return R, to_rcm - (to_rcm @ shaft) * shaft

    def cost(turn: Array) -> float:
        _, translation = shaft_onto_rcm(turn)
        return float((translation @ translation + lever**2 * (turn @ turn)) / lever**2)

    # a turn alone or a translation alone may need far more: the optimum weighs both
    best = minimize(cost, np.zeros(2), method="BFGS", options={"gtol": 1e-12})
    R, translation = shaft_onto_rcm(best.x)
    return spatial.pose(R, T[:3, 3] + translation)


def _waypoint_fixes(protocol: Protocol, trajectory: Trajectory, span: PhaseSpan, planner: Planner) -> list[Fix]:
    """Return the fixes that change the pose of the waypoint: its position, its angles, or both."""
    assert span.rcm is not None
    assert span.waypoint is not None
    T = trajectory.Ts_base_frame[span.stop]
    R = T[:3, :3]
    tip = T[:3, 3]
    axis = trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    shaft = R @ axis
    to_rcm = span.rcm - tip
    poses = {"move the tip, keep the angles": spatial.pose(R, tip + to_rcm - (to_rcm @ shaft) * shaft)}
    length = float(np.linalg.norm(to_rcm))
    if length > _TIP_AT_RCM:  # at the RCM, the shaft has no direction towards it
        direction = to_rcm / length
        if to_rcm @ shaft <= 0:  # the tip is beyond the RCM
            direction = -to_rcm / length
        turn = np.cross(shaft, direction)
        angle = np.arctan2(np.linalg.norm(turn), shaft @ direction)
        if _SMALLEST_TURN < angle < np.pi - _HALF_TURN_MARGIN:
            turned = spatial.exp_so3(turn / np.linalg.norm(turn) * angle) @ R
            poses["turn the shaft, keep the tip"] = spatial.pose(turned, tip)
        smallest = nearest_pose_through_rcm(T, axis, span.rcm, max(length, 10 * MM))
        poses["the smallest move and turn of the tool"] = smallest
    fixes = []
    for name, T_new in poses.items():
        fixes.append(_planned_fix(protocol, trajectory, span, name=name, T_new=T_new, planner=planner))
    return fixes


def _planned_fix(
    protocol: Protocol, trajectory: Trajectory, span: PhaseSpan, name: str, T_new: Array, planner: Planner
) -> Fix:
    """Return the fix that gives the waypoint at the end of a phase the pose T_new (4, 4), planned both ways."""
    assert span.rcm is not None
    assert span.waypoint is not None
    T = trajectory.Ts_base_frame[span.stop]
    axis = trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    R_new = T_new[:3, :3]
    tip = T_new[:3, 3]
    translation = float(np.linalg.norm(tip - T[:3, 3]))
    turned = float(spatial.rotation_angle(T[:3, :3].T @ R_new))
    depth = float((tip - span.rcm) @ R_new @ axis)
    waypoint = protocol.waypoints[span.waypoint]
    angles = angles_of(R_new, protocol.rotation, waypoint.angles)
    position_text = _listed(tip / MM, 3)
    angles_text = _listed(angles / DEG, 3)
    # a rounding error is no motion
    if not translation > _MOTION_ROUNDING:
        translation = 0.0
    if not turned > _MOTION_ROUNDING:
        turned = 0.0
    fix = Fix(
        name,
        waypoint=waypoint.name,
        moved=translation,
        turned=turned,
        value=f"({position_text}) mm, ({angles_text}) deg, depth {depth / MM:.3f} mm",
        reachable=False,
        why="",
    )
    # planned twice: straight, as the protocol asks, and about the pivot, which shows what the robot can do at all
    straight = replace(waypoint, angles=angles, position=tip, depth=None)
    enforced = replace(waypoint, angles=angles, position=None, depth=depth)
    try:
        fix = replace(fix, straight=_largest_error(planner(_changed_protocol(protocol, span, straight)), span.name))
        planned = planner(_changed_protocol(protocol, span, enforced, enforce=True))
    except (ProtocolError, TimingError) as error:
        return replace(fix, why=str(error))
    margin = "no joint has limits"
    for finding in planned.findings:
        if finding.severity in ("error", "disagreement"):
            return replace(fix, why=finding.message)
    for finding in planned.findings:
        if finding.code == "margin.limit":
            margin = finding.message
            break
    return replace(fix, reachable=True, why=margin)


def _listed(values: Array, decimals: int) -> str:
    """Return numbers as text, separated by commas."""
    return ", ".join(f"{value:.{decimals}f}" for value in values)


def _changed_protocol(protocol: Protocol, span: PhaseSpan, waypoint: Waypoint, enforce: bool = False) -> Protocol:
    """Return the protocol with a changed waypoint and, if `enforce` is true, an enforced pivot to this waypoint."""
    phases = []
    for phase in protocol.phases:
        if enforce and isinstance(phase, Pivot) and phase.name == span.name:
            phase = replace(phase, rcm="enforced")
        phases.append(phase)
    waypoints = {**protocol.waypoints, waypoint.name: waypoint}
    # the findings of the original belong to its waypoints
    return replace(protocol, waypoints=waypoints, phases=tuple(phases), findings=())


def _largest_error(trajectory: Trajectory, phase: str) -> float:
    """Return the largest RCM error in m in a phase."""
    span = trajectory.phase(phase)
    return float(np.nanmax(trajectory.rcm_error[span.start : span.stop + 1]))


def _moved_rcm_fixes(trajectory: Trajectory, span: PhaseSpan) -> list[Fix]:
    """Return the fix that moves the RCM to the point nearest to two shaft axes; an empty list if the axes are parallel.

    One axis is the shaft axis at the first use of the RCM, the other is the shaft axis at the end of the phase.
    """
    assert span.rcm is not None
    starts = []
    for phase in trajectory.phases:
        if phase.rcm is not None and np.array_equal(phase.rcm, span.rcm):
            starts.append(phase.start)
    Ts = trajectory.Ts_base_frame[[min(starts), span.stop]]
    axis = trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    shafts = Ts[:, :3, :3] @ axis
    # the sum of squared distances from both axes is smallest where (P1 + P2) x = P1 p1 + P2 p2
    P = np.eye(3) - shafts[:, :, None] * shafts[:, None, :]  # projections across the axes
    A = P.sum(axis=0)
    if np.linalg.eigvalsh(A)[0] < _SMALLEST_EIGENVALUE:
        return []
    nearest_point = np.linalg.solve(A, np.einsum("kij,kj->i", P, Ts[:, :3, 3]))
    distance = float(spatial.point_to_line(nearest_point, Ts[:, :3, 3], shafts).max())
    position = _listed(nearest_point / MM, 2)
    translation = float(np.linalg.norm(nearest_point - span.rcm))
    meets = distance <= _LARGEST_COMMON_DISTANCE
    why = "both shafts pass through the new RCM"
    if not meets:
        why = f"no RCM fits both shafts (skew axes); the largest distance from the new RCM is {distance / MM:.2f} mm"
    return [
        Fix(
            "move the RCM",
            waypoint="",
            moved=translation,
            turned=0.0,
            value=f"({position}) mm",
            reachable=meets,
            why=why,
        )
    ]


def _other_angle_conventions(protocol: Protocol, trajectory: Trajectory, span: PhaseSpan) -> str:
    """Return a text on whether the shaft passes through the RCM with another order or sign of the waypoint's angles."""
    assert span.rcm is not None
    assert span.waypoint is not None
    waypoint = protocol.waypoints[span.waypoint]
    if waypoint.position is None:
        return "not needed: the waypoint is given by its depth, so the shaft passes through the RCM"
    readings: list[tuple[float, str]] = []  # (RCM error in m, text)
    for order in ("zyx", "xyz"):
        for signs in product((1, -1), repeat=3):
            if order == protocol.rotation and signs == (1, 1, 1):
                continue
            R = rotation(waypoint.angles * np.array(signs), order)
            error = float(spatial.point_to_line(span.rcm, waypoint.position, R @ trajectory.shaft_axis))
            marks = ["+" if sign > 0 else "-" for sign in signs]
            readings.append((error, f"order {order}, signs {', '.join(marks)}"))
    error, words = min(readings)
    if error <= protocol.tolerances.rcm:
        return f"{words}: the shaft passes through the RCM ({error / MM:.3g} mm); these may be the intended angles"
    return f"none: every order and sign misses the RCM, by at least {error / MM:.2f} mm ({words})"
