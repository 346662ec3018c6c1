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
from twin.planning.plan import plan
from twin.planning.protocol import Pivot, Protocol, Waypoint
from twin.planning.protocol.course import angles_of, rotation
from twin.planning.trajectory import PathKinematics, PhaseSpan, Trajectory

STEP = 0.02
"""Time step in s of a planned fix."""

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
        size = [str(mm(self.moved))] if self.moved > 0 else []
        size += [str(deg(self.turned))] if self.turned > 0 else []
        by = f", by {' and '.join(size)}" if size else ""
        reach = f"the robot can do the protocol ({self.why})" if self.reachable else f"out of reach: {self.why}"
        drift = (
            f"; on the straight path, the shaft would still miss the RCM by {self.straight / MM:.2f} mm at a point "
            "between the ends of the path"
        )
        drifts = drift if self.straight > 1e-5 else ""
        return f"{self.name}{by}: {self.value}; {reach}{drifts}"


def fixes(
    protocol: Protocol, trajectory: Trajectory, paths: PathKinematics, T_tool_frame: Array
) -> tuple[dict[str, str], list[Finding]]:
    """Return (facts as text, findings) on fixes of the phases in which the shaft misses a monitored RCM.

    `paths` is the robot's planning data; `T_tool_frame` (4, 4) is the pose of the protocol's frame in the tool frame.
    """

    def planner(changed: Protocol) -> Trajectory:
        return plan(changed, paths, T_tool_frame=T_tool_frame, dt=STEP)

    facts: dict[str, str] = {}
    findings: list[Finding] = []
    for span in trajectory.phases:
        if span.rcm is None or span.rcm_mode != "monitored" or span.waypoint is None:
            continue
        rows = slice(span.start, span.stop + 1)
        missed = rcm_error(trajectory.Ts_base_frame[rows], trajectory.shaft_axis, span.rcm)
        if missed.max() <= protocol.tolerances.rcm:
            continue
        for fix in [*_poses(protocol, trajectory, span, planner), *_rcm(trajectory, span)]:
            facts[f"{span.name}: {fix.name}"] = fix.text
            if fix.reachable:
                findings.append(
                    info(
                        "rcm.fix",
                        f"waypoint '{span.waypoint}'",
                        f"with this change, the shaft passes through the RCM at '{span.waypoint}': {fix.text}",
                        mm(fix.moved) if fix.moved > 0 else deg(fix.turned),
                        when=f"phase '{span.name}'",
                        word="",
                    )
                )
        facts[f"{span.name}: other interpretations of the angles"] = _readings(protocol, trajectory, span)
    return facts, findings


def nearest(T: Array, axis: Array, rcm: Array, lever: float) -> Array:
    """Return the pose (4, 4) at which the shaft passes through the RCM, with the minimum motion from T.

    T is the pose (4, 4) of the moved frame, `axis` the shaft direction (3,) in this frame, `rcm` the RCM (3,) in m in
    the parent frame of T. The motion is a translation and a rotation; `lever` is the weight of the rotation in m/rad.
    """
    from scipy.optimize import minimize

    u = T[:3, :3] @ (axis / np.linalg.norm(axis))
    side = np.linalg.svd(np.eye(3) - np.outer(u, u))[0][:, :2]

    def turned(w: Array) -> tuple[Array, Array]:
        R = spatial.exp_so3(side @ w) @ T[:3, :3]
        shaft = R @ (axis / np.linalg.norm(axis))
        e = rcm - T[:3, 3]
        return R, e - (e @ shaft) * shaft

    def cost(w: Array) -> float:
        e = turned(w)[1]
        return float((e @ e + lever**2 * (w @ w)) / lever**2)

    R, e = turned(minimize(cost, np.zeros(2), method="BFGS", options={"gtol": 1e-12}).x)
    return spatial.pose(R, T[:3, 3] + e)


def _poses(protocol: Protocol, trajectory: Trajectory, span: PhaseSpan, planner: Planner) -> list[Fix]:
    assert span.rcm is not None
    assert span.waypoint is not None
    T, axis = trajectory.Ts_base_frame[span.stop], trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    u, w = T[:3, :3] @ axis, span.rcm - T[:3, 3]
    beside = spatial.pose(T[:3, :3], T[:3, 3] + w - (w @ u) * u)
    out = [("move the tip, keep the angles", beside)]
    length = float(np.linalg.norm(w))
    if length > 1e-6:
        goal = -w / length if w @ u <= 0 else w / length
        turn = np.cross(u, goal)
        angle = np.arctan2(np.linalg.norm(turn), u @ goal)
        if 1e-12 < angle < np.pi - 1e-6:
            R = spatial.exp_so3(turn / np.linalg.norm(turn) * angle) @ T[:3, :3]
            out.append(("turn the shaft, keep the tip", spatial.pose(R, T[:3, 3])))
        out.append(("the smallest move and turn of the tool", nearest(T, axis, span.rcm, max(length, 10 * MM))))
    return [_tried(protocol, trajectory, span, name, new, planner) for name, new in out]


def _tried(
    protocol: Protocol, trajectory: Trajectory, span: PhaseSpan, name: str, T_new: Array, planner: Planner
) -> Fix:
    assert span.rcm is not None
    assert span.waypoint is not None
    T, axis = trajectory.Ts_base_frame[span.stop], trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    moved = float(np.linalg.norm(T_new[:3, 3] - T[:3, 3]))
    turned = float(spatial.rotation_angle(T[:3, :3].T @ T_new[:3, :3]))
    depth = float((T_new[:3, 3] - span.rcm) @ T_new[:3, :3] @ axis)
    old = protocol.waypoints[span.waypoint]
    angles = angles_of(T_new[:3, :3], protocol.rotation, old.angles)
    about = replace(old, angles=angles, position=None, depth=depth)
    straight = replace(old, angles=angles, position=T_new[:3, 3], depth=None)
    at, turn = (", ".join(f"{x:.3f}" for x in v) for v in (T_new[:3, 3] / MM, angles / DEG))
    value = f"({at}) mm, ({turn}) deg, depth {depth / MM:.3f} mm"
    tell = {"waypoint": old.name, "moved": moved if moved > 1e-9 else 0.0, "turned": turned if turned > 1e-9 else 0.0}
    drift = float("nan")
    try:
        drift = _missed(planner(_with(protocol, span, straight, None)), span.name)
        done = planner(_with(protocol, span, about, "enforced"))
    except (ProtocolError, TimingError) as error:
        return Fix(name, value=value, reachable=False, why=str(error), straight=drift, **tell)
    worst = next((f for f in done.findings if f.severity in ("error", "disagreement")), None)
    left = next((f.message for f in done.findings if f.code == "margin.limit"), "no joint has limits")
    why = left if worst is None else worst.message
    return Fix(name, value=value, reachable=worst is None, why=why, straight=drift, **tell)


def _with(protocol: Protocol, span: PhaseSpan, waypoint: Waypoint, mode: str | None) -> Protocol:
    """Return the protocol with a changed waypoint and, if `mode` is given, an enforced pivot to this waypoint."""
    phases = protocol.phases
    if mode is not None:
        phases = tuple(
            replace(p, rcm="enforced") if isinstance(p, Pivot) and p.name == span.name else p for p in phases
        )
    return replace(protocol, waypoints={**protocol.waypoints, waypoint.name: waypoint}, phases=phases, findings=())


def _missed(trajectory: Trajectory, phase: str) -> float:
    span = trajectory.phase(phase)
    return float(np.nanmax(trajectory.rcm_error[span.start : span.stop + 1]))


def _rcm(trajectory: Trajectory, span: PhaseSpan) -> list[Fix]:
    """Return the fix that moves the RCM to the point nearest to two shaft axes; an empty list if the axes are parallel.

    One axis is the shaft axis at the first use of the RCM, the other is the shaft axis at the end of the phase.
    """
    assert span.rcm is not None
    first = min(s.start for s in trajectory.phases if s.rcm is not None and np.array_equal(s.rcm, span.rcm))
    Ts, axis = (
        trajectory.Ts_base_frame[[first, span.stop]],
        trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis),
    )
    u = Ts[:, :3, :3] @ axis
    P = np.eye(3) - u[:, :, None] * u[:, None, :]
    A = P.sum(axis=0)
    if np.linalg.eigvalsh(A)[0] < 1e-9:
        return []
    best = np.linalg.solve(A, np.einsum("kij,kj->i", P, Ts[:, :3, 3]))
    left = float(spatial.point_to_line(best, Ts[:, :3, 3], u).max())
    at = ", ".join(f"{x / MM:.2f}" for x in best)
    moved = float(np.linalg.norm(best - span.rcm))
    enough = left <= 1e-4
    why = (
        "both shafts pass through the new RCM"
        if enough
        else f"no RCM fits both shafts (skew axes); the largest distance from the new RCM is {left / MM:.2f} mm"
    )
    return [Fix("move the RCM", "", moved, 0.0, f"({at}) mm", enough, why)]


def _readings(protocol: Protocol, trajectory: Trajectory, span: PhaseSpan) -> str:
    """Return a text on whether the shaft passes through the RCM with another order or sign of the waypoint's angles."""
    assert span.rcm is not None
    assert span.waypoint is not None
    w = protocol.waypoints[span.waypoint]
    if w.position is None:
        return "not needed: the waypoint is given by its depth, so the shaft passes through the RCM"
    found: list[tuple[float, str]] = []
    for order in ("zyx", "xyz"):
        for signs in product((1, -1), repeat=3):
            if order == protocol.rotation and signs == (1, 1, 1):
                continue
            R = rotation(w.angles * np.array(signs), order)
            missed = float(spatial.point_to_line(span.rcm, w.position, R @ trajectory.shaft_axis))
            found.append((missed, f"order {order}, signs {', '.join('+' if s > 0 else '-' for s in signs)}"))
    missed, words = min(found)
    if missed <= protocol.tolerances.rcm:
        return f"{words}: the shaft passes through the RCM ({missed / MM:.3g} mm); these may be the intended angles"
    return f"none: every order and sign misses the RCM, by at least {missed / MM:.2f} mm ({words})"
