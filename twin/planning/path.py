"""Task-space paths of the phases: exact poses and exact derivatives in the path parameter s in [0, 1].

Three shapes are enough. A line: position and angles linear in s. About the RCM P: angles and depth l
linear in s, and the tip derived from them, tip(s) = P + l(s) R(s) n with the shaft n fixed in the
tool, so that the shaft passes through P at every s by construction, not by correction. A circle of the tip:
the shaft turned from its direction at the start to that from P to the tip, by the smallest rotation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol as Interface
from typing import assert_never

import numpy as np

from twin.core import spatial
from twin.core.errors import ProtocolError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol import (
    Auxiliary,
    Circle,
    Home,
    Insertion,
    Joints,
    Phase,
    Pivot,
    Positioning,
    Protocol,
    RcmMode,
    Retraction,
    RotationOrder,
    trocar_of,
)
from twin.planning.trajectory import PathKinematics

_AXES = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0]), "z": np.array([0.0, 0.0, 1.0])}

_NO_LENGTH = 1e-9
"""Metres and rad below which a phase has no length."""


@dataclass(frozen=True)
class Motion:
    """A phase at k values of s; all in base, derivatives with respect to s.

    Attributes:
        Ts_base_tool: (k, 4, 4).
        p: (k, 3) origin of the moved frame ("tip") in m; `p1`, `p2` its derivatives.
        w1: (k, 3) rotation rate in rad per unit of s; `w2` its derivative.
        twists: (k, 6) rate of the tool frame, linear rows first.
    """

    Ts_base_tool: Array
    p: Array
    p1: Array
    p2: Array
    w1: Array
    w2: Array
    twists: Array


@dataclass(frozen=True)
class PhasePath:
    """One phase as a path.

    Attributes:
        phase: what it was built from.
        T_tool_frame: (4, 4) pose of the moved frame in the tool.
        n_tool_shaft: (3,) unit vector along the shaft towards the tip, in the tool.
        order: axes of the angles.
        angles0, angles1: (3,) in rad at both ends, about the axes of `order`.
        tip0, tip1: (3,) origin of the moved frame at both ends, in base.
        waypoint: name of the waypoint it should end at, if any.
        rcm: (3,) RCM in base while it is registered, else None.
        rcm_mode: "enforced" or "monitored" while it is registered, else None.
        depth0, depth1: depth at both ends in m (NaN without RCM).
        beside: auxiliary joints: place in q, value in m or rad at both ends.
    """

    phase: Phase
    T_tool_frame: Array
    n_tool_shaft: Array
    order: RotationOrder
    angles0: Array
    angles1: Array
    tip0: Array
    tip1: Array
    waypoint: str | None
    rcm: Array | None
    rcm_mode: RcmMode | None
    depth0: float
    depth1: float
    beside: tuple[tuple[int, float, float], ...]

    def joints(self, s: Array, kinematics: PathKinematics) -> Array:
        """Return the driven joints (k, n) at s (k,), NaN where there are none."""
        q = kinematics.inverse(self.motion(s).Ts_base_tool)
        for i, start, end in self.beside:
            q[:, i] = start + s * (end - start)
        return q

    @property
    def about_rcm(self) -> bool:
        """Whether the tip is derived from the RCM."""
        return isinstance(self.phase, Pivot) and self.rcm_mode == "enforced"

    def motion(self, s: Array) -> Motion:
        """Return the motion at s (k,)."""
        s = np.asarray(s, float)
        if isinstance(self.phase, Circle):
            return self._circle(self.phase, s)
        R, w1, w2 = _rotation(self.angles0, self.angles1 - self.angles0, s, self.order)
        if self.about_rcm and self.rcm is not None:
            n = R @ self.n_tool_shaft
            n1 = np.cross(w1, n)
            n2 = np.cross(w2, n) + np.cross(w1, n1)
            rate = self.depth1 - self.depth0
            depth = (self.depth0 + rate * s)[:, None]
            p, p1, p2 = self.rcm + depth * n, rate * n + depth * n1, 2 * rate * n1 + depth * n2
        else:
            step = self.tip1 - self.tip0
            p, p1 = self.tip0 + s[:, None] * step, np.broadcast_to(step, (len(s), 3))
            p2 = np.zeros((len(s), 3))
        return self._motion(R, p, p1, p2, w1, w2)

    def _motion(self, R: Array, p: Array, p1: Array, p2: Array, w1: Array, w2: Array) -> Motion:
        arm = R @ self.T_tool_frame[:3, 3]  # from the tool to the moved frame
        twists = np.concatenate([p1 - np.cross(w1, arm), w1], axis=1)
        return Motion(spatial.pose(R, p - arm), p, p1, p2, w1, w2, twists)

    def _circle(self, circle: Circle, s: Array) -> Motion:
        R0 = rotation(self.angles0, self.order)
        out = self.tip0 - circle.centre
        out, along = out - (out @ circle.normal) * circle.normal, (out @ circle.normal) * circle.normal
        across = np.cross(circle.normal, out)
        full = 2 * np.pi * circle.turns
        c, sn = np.cos(full * s)[:, None], np.sin(full * s)[:, None]
        p = circle.centre + along + c * out + sn * across
        p1, p2 = full * (c * across - sn * out), -(full**2) * (c * out + sn * across)
        if self.rcm is None:
            still = np.zeros((len(s), 3))
            return self._motion(np.tile(R0, (len(s), 1, 1)), p, p1, p2, still, still)
        # Direction n of the shaft from the RCM to the tip, and the smallest rotation from n0 to n.
        w = p - self.rcm
        l = np.linalg.norm(w, axis=1)[:, None]  # noqa: E741
        n = w / l
        l1 = np.sum(n * p1, axis=1)[:, None]
        n1 = (p1 - l1 * n) / l
        l2 = (np.sum(n1 * p1, axis=1) + np.sum(n * p2, axis=1))[:, None]
        n2 = (p2 - l2 * n - 2 * l1 * n1) / l
        n0 = R0 @ self.n_tool_shaft
        v, share = np.cross(n0, n), 1 / (1 + n @ n0)
        hat = spatial.hat(v)
        R = (np.eye(3) + hat + share[:, None, None] * (hat @ hat)) @ R0
        share = share[:, None]
        w1 = np.cross(n0 + n, n1) * share
        w2 = np.cross(n0 + n, n2) * share - w1 * (n1 @ n0)[:, None] * share
        return self._motion(R, p, p1, p2, w1, w2)

    def angles(self, s: float) -> Array:
        """Return the angles (3,) in rad at s, about the axes of `order`."""
        return self.angles0 + s * (self.angles1 - self.angles0)

    def depth(self, s: float) -> float:
        """Return the depth in m at s (NaN without RCM)."""
        if isinstance(self.phase, Circle) and self.rcm is not None:
            return float(np.linalg.norm(self.motion(np.array([s])).p[0] - self.rcm))
        return self.depth0 + s * (self.depth1 - self.depth0)


def rotation(angles: Array, order: RotationOrder) -> Array:
    """Return R (..., 3, 3) of angles (..., 3) in rad about the axes of `order`: "zyx" is Rz Ry Rx."""
    angles = np.asarray(angles)
    first, second, third = (spatial.exp_so3(angles[..., i, None] * _AXES[axis]) for i, axis in enumerate(order))
    return first @ second @ third


def angles_of(R: Array, order: RotationOrder, near: Array) -> Array:
    """Return the angles (3,) in rad of R (3, 3) about the axes of `order` that are nearest to `near` (3,).

    A phase is linear in the angles: far ones for the same rotation would turn the tool round on its way.
    Where the middle angle is a right angle, the first one is that of `near`.
    """
    a, b, c = spatial.euler_angles(R, order, near[0])
    found = np.array([[a, b, c], [a + np.pi, np.pi - b, c + np.pi]])
    found -= 2 * np.pi * np.round((found - near) / (2 * np.pi))
    return min(found, key=lambda angles: float(np.linalg.norm(angles - near)))


def _rotation(start: Array, rate: Array, s: Array, order: RotationOrder) -> tuple[Array, Array, Array]:
    """Return R (k, 3, 3), its rate (k, 3) and the derivative of the rate, all in base, angles linear in s."""
    angles = start + s[:, None] * rate
    e0, e1, e2 = (_AXES[axis] for axis in order)
    R = spatial.exp_so3(angles[:, :1] * e0)
    axis1 = R @ e1
    R = R @ spatial.exp_so3(angles[:, 1:2] * e1)
    axis2 = R @ e2
    R = R @ spatial.exp_so3(angles[:, 2:] * e2)
    turn0 = np.broadcast_to(rate[0] * e0, axis1.shape)
    turn1 = turn0 + rate[1] * axis1
    return R, turn1 + rate[2] * axis2, rate[1] * np.cross(turn0, axis1) + rate[2] * np.cross(turn1, axis2)


class Guide(Interface):
    """What takes paths to where a mechanism really goes; see `following.Follower`."""

    def start(self, T_tool_frame: Array) -> tuple[Array, Array]:
        """Return angles (3,) and place (3,) of the moved frame where the protocol starts."""
        ...

    def along(self, path: PhasePath) -> PhasePath:
        """Return a phase as the mechanism takes it."""
        ...


def build(protocol: Protocol, T_tool_frame: Array, guide: Guide | None = None) -> tuple[PhasePath, ...]:
    """Return the phases of a protocol as paths, each beginning where the last one ended.

    Args:
        protocol: what to do.
        T_tool_frame: (4, 4) pose of `protocol.frame` in the tool.
        guide: leads the mechanism along each; None: every phase is followed in all directions, as it is written.

    Raises:
        ProtocolError: a phase has no length, retracts to more than its depth, or goes by joints without a guide.
    """
    n_tool = T_tool_frame[:3, :3] @ protocol.shaft_axis
    angles, tip = _pose(protocol, protocol.start) if guide is None else guide.start(T_tool_frame)
    rcm = protocol.rcm
    if rcm is not None:
        missed = spatial.point_to_line(rcm, tip, rotation(angles, protocol.rotation) @ n_tool)
        if missed > protocol.tolerances.rcm:
            raise ProtocolError(
                f"{protocol.name}: rcm_mm is registered from the start, but the shaft of '{protocol.start}' passes it "
                f"at {missed / MM:.3f} mm (allowed: {protocol.tolerances.rcm / MM:g} mm)"
            )
    paths: list[PhasePath] = []
    for phase in protocol.phases:
        shaft = rotation(angles, protocol.rotation) @ n_tool
        rcm = _in_trocar(protocol, phase, rcm, tip, shaft)
        depth0 = float((tip - rcm) @ shaft) if rcm is not None else np.nan
        goal, waypoint, mode, depth1 = angles, None, None, np.nan
        match phase:
            case Positioning() | Joints() | Home():
                waypoint = phase.to
                by_joints = guide is not None and protocol.waypoints[waypoint].joints is not None
                goal, end = (angles, tip) if by_joints else _pose(protocol, waypoint)
            case Auxiliary():
                end, depth1, mode = tip, depth0, paths[-1].rcm_mode if paths and rcm is not None else None
            case Insertion():
                waypoint, mode, rcm = phase.to, "enforced", tip
                depth0, depth1 = 0.0, phase.depth
                end = tip + phase.depth * shaft
            case Pivot():
                waypoint, mode = phase.to, phase.rcm
                if rcm is None:
                    raise _refuse(protocol, phase, "no RCM is registered yet")
                if mode == "enforced":
                    goal, depth1 = protocol.waypoints[waypoint].angles, protocol.waypoints[waypoint].depth
                    if depth1 is None:
                        raise _refuse(protocol, phase, f"waypoint '{waypoint}' has no depth")
                    end = rcm + depth1 * (rotation(goal, protocol.rotation) @ n_tool)
                else:
                    goal, end = _pose(protocol, waypoint)
                    depth1 = float((end - rcm) @ rotation(goal, protocol.rotation) @ n_tool)
            case Circle():
                end = tip
                if np.linalg.norm(np.cross(tip - phase.centre, phase.normal)) < _NO_LENGTH:
                    raise _refuse(protocol, phase, "it begins on its own axis: its radius is 0")
                if rcm is not None:
                    mode, depth1 = "enforced", depth0
                    missed = spatial.point_to_line(rcm, tip, shaft)
                    if missed > protocol.tolerances.rcm:
                        raise _refuse(protocol, phase, f"the shaft begins {missed / MM:.3f} mm beside the RCM")
            case Retraction():
                if rcm is None:
                    raise _refuse(protocol, phase, "no RCM is registered yet")
                # Along the shaft: after a pivot that missed the RCM it is missed until the end, and watched.
                kept = spatial.point_to_line(rcm, tip, shaft) <= protocol.tolerances.rcm
                mode, depth1 = "enforced" if kept else "monitored", phase.depth
                if depth1 > depth0 + _NO_LENGTH:
                    text = f"it should end at depth {depth1 / MM:.3f} mm, but begins at {depth0 / MM:.3f} mm"
                    raise _refuse(protocol, phase, f"{text}: that is an insertion")
                end = tip + (depth1 - depth0) * shaft
            case _:
                assert_never(phase)
        elsewhere = waypoint is not None and protocol.waypoints[waypoint].joints is not None
        still = not (isinstance(phase, Circle | Auxiliary) or elsewhere) and np.linalg.norm(end - tip) < _NO_LENGTH
        if still and np.linalg.norm(goal - angles) < _NO_LENGTH:
            at = ", ".join(f"{x / MM:.3f}" for x in tip)
            turn = ", ".join(f"{x / DEG:.3f}" for x in angles)
            raise _refuse(
                protocol, phase, f"it has no length: it begins and ends at ({at}) mm, ({turn}) deg; remove it"
            )
        if mode == "enforced" and paths and paths[-1].rcm_mode == "monitored" and isinstance(phase, Pivot):
            text = "it keeps the RCM, but begins where a monitored pivot has missed it"
            if rcm is not None and spatial.point_to_line(rcm, tip, shaft) > protocol.tolerances.rcm:
                raise _refuse(protocol, phase, text)
        path = PhasePath(
            phase,
            np.asarray(T_tool_frame, float),
            n_tool,
            protocol.rotation,
            angles,
            goal,
            tip,
            end,
            waypoint,
            rcm,
            mode,
            depth0,
            depth1,
            (),
        )
        paths.append(path if guide is None else guide.along(path))
        angles, tip = paths[-1].angles1, paths[-1].tip1
        if isinstance(phase, Retraction) and phase.depth == 0:
            rcm = None
    return tuple(paths)


def _in_trocar(protocol: Protocol, phase: Phase, rcm: Array | None, tip: Array, shaft: Array) -> Array | None:
    """Return the RCM (3,) that a phase begins with: that of the phases before, or the trocar that it names.

    An insertion goes in where the tip is, so that its shaft keeps the RCM exactly; that has to be at the trocar.
    """
    if not (name := trocar_of(phase)):
        return rcm
    place, allowed = protocol.trocars[name], protocol.tolerances.rcm
    inserts = isinstance(phase, Insertion)
    missed = float(np.linalg.norm(place - tip) if inserts else spatial.point_to_line(place, tip, shaft))
    if missed > allowed:
        what = f"begins {missed / MM:.3f} mm from" if inserts else f"begins with its shaft {missed / MM:.3f} mm beside"
        raise _refuse(protocol, phase, f"it {what} trocar '{name}' (allowed: {allowed / MM:g} mm)")
    return rcm if rcm is not None and np.linalg.norm(rcm - place) <= allowed else place


def _pose(protocol: Protocol, name: str) -> tuple[Array, Array]:
    waypoint = protocol.waypoints[name]
    if waypoint.position is None:
        text = "joint values, which the mechanism has to be asked for" if waypoint.joints is not None else "no position"
        raise ProtocolError(f"{protocol.name}: waypoint '{name}' has {text}")
    return waypoint.angles, waypoint.position


def _refuse(protocol: Protocol, phase: Phase, text: str) -> ProtocolError:
    return ProtocolError(f"{protocol.name}: phase '{phase.name}' ({phase.type}): {text}")
