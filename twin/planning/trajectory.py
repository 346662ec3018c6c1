"""Inputs and outputs of planning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal
from typing import Protocol as Interface

import numpy as np

from twin.core import spatial
from twin.core.errors import ProtocolError, unknown
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.planning.protocol import RcmMode
from twin.planning.space import Space


@dataclass(frozen=True)
class Gap:
    """Two carriages on one rail: joints `i` and `j` stay `smallest` (m) apart."""

    i: int
    j: int
    smallest: float
    name: str


class Carrier(Interface):
    """The mechanism as needed to follow a path; states (nq,) are opaque, to continue from.

    Every method raises `AssemblyError` where the mechanism cannot follow.
    """

    def drawn(self) -> tuple[Array, Array]:
        """Return the state as drawn, and the driven joints (n,) there."""
        ...

    def carry(self, q: Array, start: Array) -> tuple[Array, Array]:
        """Return states and T_base_tool (k, 4, 4) for driven joints (k, n) along a motion from a state."""
        ...

    def follow(self, Ts: Array, directions: np.ndarray, p_tool: Array, start: Array) -> tuple[Array, Array, Array]:
        """Return states, joints (k, n) and T_base_tool that follow poses (k, 4, 4) in the chosen directions (6,).

        The directions are along and about the axes of base; `p_tool` (3,) is the point of the tool whose place counts.
        """
        ...

    def jacobians(self, state: Array, p_tool: Array) -> Array:
        """Return (k, 6, n) rates of that point per rate of the joints, at a state and beside it."""
        ...


@dataclass(frozen=True)
class Motors:
    """The k actuators of transmissions, which have limits of their own; joints driven directly are not among them.

    Attributes:
        names: of the actuators.
        rows: (k, n) motor values = rows @ q, in m or rad.
        lower, upper, max_speed: (k,) limits; infinite where there is none.
        revolute: (k,) which are in rad.
    """

    names: tuple[str, ...]
    rows: Array
    lower: Array
    upper: Array
    max_speed: Array
    revolute: tuple[bool, ...]

    def unit(self, motor: int) -> tuple[str, float]:
        """Return the unit that a motor is shown in, and its factor to SI."""
        return ("deg", DEG) if self.revolute[motor] else ("mm", MM)


NO_MOTORS = Motors((), np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0), ())


def motors_of(mechanism: Mechanism) -> Motors:
    """Return the actuators of a mechanism's transmissions."""
    by_name = {a.name: a for a in mechanism.actuators}
    order = [i for i, n in enumerate(mechanism.motor_names) if n in by_name]
    if not order:
        return NO_MOTORS
    found = [by_name[mechanism.motor_names[i]] for i in order]
    limits = np.array([a.limits or (-np.inf, np.inf) for a in found], float)
    return Motors(
        names=tuple(a.name for a in found),
        rows=mechanism.motors(np.eye(len(mechanism.active))).T[order],
        lower=limits[:, 0],
        upper=limits[:, 1],
        max_speed=np.array([a.max_speed or np.inf for a in found]),
        revolute=tuple(a.is_angle for a in found),
    )


Keep = Callable[[Array, Array], np.ndarray]
"""T_base_tool (k, 4, 4), q (k, n) -> which of these are allowed (k,)."""


@dataclass(frozen=True)
class PathKinematics:
    """A robot as far as planning needs it; k poses in, k rows out; no function raises for an unreachable pose.

    Attributes:
        joint_names: n active joints in the order of q.
        inverse: (k, 4, 4) T_base_tool -> (k, n) in m or rad; rows of NaN where there is no answer.
        reach: (k, 4, 4) -> margins (k,) in m by limb, >= 0 where reachable.
        singularity: (k, 4, 4), (k, n) -> measures (k,) by name, each vanishing on a singularity.
        singularity_alarm: smallest harmless absolute measure by the beginning of its name.
        lower, upper: (n,) hard limits; nothing is planned beyond them.
        soft_lower, soft_upper: (n,) limits that give a warning.
        max_speed, max_acceleration: (n,) per second, per second squared.
        branch: (k, 4, 4), (k, n) -> (k,) labels of the working mode; None: not watched.
        gaps: carriages that share a rail.
        motors: actuators of transmissions.
        revolute: (n,) which joints are in rad; empty: none.
        why: pose (4, 4) -> where and why the equations have no value there, or ""; None: they cannot tell.
        carrier: the mechanism, for phases that it decides; None: there are none.
        space: scene ("" for none), clearance in m, what else must hold -> the space of the driven joints in which a
            free phase searches; None: there is none.
        auxiliary: values of the auxiliary joints as drawn, by name; the inverse gives these.
        takes: (k, 4, 4) -> whether all are certainly poses of this robot; None: every pose is. If uncertain (fewer
            than six freedoms, no equations) the mechanism decides, see `following`.
    """

    joint_names: tuple[str, ...]
    inverse: Callable[[Array], Array]
    reach: Callable[[Array], Mapping[str, Array]]
    singularity: Callable[[Array, Array], Mapping[str, Array]]
    singularity_alarm: Mapping[str, float]
    lower: Array
    upper: Array
    soft_lower: Array
    soft_upper: Array
    max_speed: Array
    max_acceleration: Array
    branch: Callable[[Array, Array], np.ndarray] | None = None
    gaps: tuple[Gap, ...] = ()
    motors: Motors = NO_MOTORS
    revolute: tuple[bool, ...] = ()
    why: Callable[[Array], str] | None = None
    carrier: Carrier | None = None
    space: Callable[[str, float, Keep], Space] | None = None
    auxiliary: Mapping[str, float] = field(default_factory=dict)
    takes: Callable[[Array], bool] | None = None

    def unit(self, joint: int) -> tuple[str, float]:
        """Return the unit that a joint is shown in, and its factor to SI."""
        return ("deg", DEG) if self.revolute and self.revolute[joint] else ("mm", MM)

    def alarm(self, measure: str) -> float:
        """Return the alarm of a singularity measure; 0 if none is set."""
        found = [n for n in self.singularity_alarm if measure.startswith(n)]
        return self.singularity_alarm[max(found, key=len)] if found else 0.0


def without_equations(
    mechanism: Mechanism,
    carrier: Carrier,
    gaps: Sequence[tuple[str, str, float]],
    space: Callable[[str, float, Keep], Space] | None = None,
) -> PathKinematics:
    """Return the planning data of a robot without equations: joints, limits and the mechanism itself."""
    active = mechanism.active
    hard = mechanism.limits
    soft = np.array([j.soft_limits or j.limits or (-np.inf, np.inf) for j in active]).reshape(-1, 2)
    order = [j.name for j in active]
    return PathKinematics(
        joint_names=tuple(order),
        inverse=lambda Ts: np.full((len(Ts), len(order)), np.nan),
        reach=lambda Ts: {},
        singularity=lambda Ts, q: {},
        singularity_alarm={},
        lower=hard[:, 0],
        upper=hard[:, 1],
        soft_lower=soft[:, 0],
        soft_upper=soft[:, 1],
        max_speed=np.array([j.max_speed or np.inf for j in active]),
        max_acceleration=np.array([j.max_acceleration or np.inf for j in active]),
        gaps=tuple(Gap(order.index(a), order.index(b), g, f"{a}-{b}") for a, b, g in gaps),
        motors=motors_of(mechanism),
        revolute=tuple(j.is_angle for j in active),
        carrier=carrier,
        space=space,
        auxiliary={name: value for _, name, _, value in mechanism.extra_joints(())},
        takes=lambda Ts: False,
    )


@dataclass(frozen=True)
class PhaseSpan:
    """One phase in time. Neighbouring phases share the sample between them, at rest.

    Attributes:
        name, type: as in the protocol.
        start, stop: first and last sample, both included.
        t0, t1: their times in s.
        waypoint: where it ends, if the protocol names it.
        rcm: (3,) in base in m while one is registered, else None.
        rcm_mode: "enforced", "monitored" or None.
        depth0, depth1: depths at both ends in m; NaN without RCM.
        optimal: s, duration before slowing down for limits between grid points and for whole ms.
        overshoot: of TOPP-RA's own result over the limits, as a fraction; removed by slowing down.
    """

    name: str
    type: str
    start: int
    stop: int
    t0: float
    t1: float
    waypoint: str | None
    rcm: Array | None
    rcm_mode: RcmMode | None
    depth0: float
    depth1: float
    optimal: float
    overshoot: float


@dataclass(frozen=True)
class Trajectory:
    """A timed protocol: k samples at a fixed step, SI, in base unless the name says otherwise.

    Attributes:
        protocol, robot: names.
        joint_names: n active joints in the order of q.
        t: (k,) s. q, qd, qdd: (k, n). Where phases meet, qdd is that of the earlier phase.
        Ts_base_tool: (k, 4, 4).
        frame: name of the moved frame. Ts_base_frame: (k, 4, 4). shaft_axis: (3,) in that frame.
        tip_velocity, tip_acceleration: (k, 3) of the origin of the moved frame.
        angular_velocity, angular_acceleration: (k, 3).
        phases: in order.
        waypoints: samples at which each waypoint is met.
        rcm_error: (k,) m, distance from the RCM to the shaft; NaN where none is registered.
        depth: (k,) m, NaN likewise.
        limit_margin: (k, n) distance to the nearer hard limit, >= 0 inside.
        reach: (k,) margins in m by limb. singularity: (k,) measures by name.
        findings: of the check of every sample.
        followed: whether joints and poses come from the mechanism (see `following`), not from the equations.
    """

    protocol: str
    robot: str
    joint_names: tuple[str, ...]
    t: Array
    q: Array
    qd: Array
    qdd: Array
    Ts_base_tool: Array
    frame: str
    Ts_base_frame: Array
    shaft_axis: Array
    tip_velocity: Array
    tip_acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    phases: tuple[PhaseSpan, ...]
    waypoints: Mapping[str, tuple[int, ...]]
    rcm_error: Array
    depth: Array
    limit_margin: Array
    reach: Mapping[str, Array]
    singularity: Mapping[str, Array]
    findings: tuple[Finding, ...] = field(default=())
    followed: bool = False

    @property
    def step(self) -> float:
        """Seconds between samples."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    @property
    def tip_speed(self) -> Array:
        """Speed (k,) of the origin of the moved frame in m/s."""
        return np.linalg.norm(self.tip_velocity, axis=1)

    @property
    def rcm(self) -> Array:
        """RCM (k, 3) in base in m; NaN where none is registered."""
        out = np.full((len(self.t), 3), np.nan)
        for span in self.phases:
            if span.rcm is not None:
                out[span.start : span.stop + 1] = span.rcm
        return out

    def phase(self, which: str | float) -> PhaseSpan:
        """Return a phase by its name, or the phase at a time in s.

        Raises:
            ProtocolError: there is no phase of that name, or the time is outside.
        """
        if isinstance(which, str):
            for span in self.phases:
                if span.name == which:
                    return span
            raise ProtocolError(unknown("phase", which, (p.name for p in self.phases)))
        for span in self.phases:
            if span.t0 <= which <= span.t1:
                return span
        raise ProtocolError(f"time {which:g} s is outside 0..{self.duration:g} s")

    def sample(self, t: float) -> tuple[Array, Array]:
        """Return q (n,) and T_base_tool (4, 4) at any time in s.

        Before the start and after the end they are those of the first and last sample.

        Between samples q follows a cubic (exact in q and qd at the samples), the pose a screw-free
        blend: line for the position, constant rate for the rotation.
        """
        times = np.array([t], float)
        return self.joints(times)[0], self.poses(times)[0]

    def poses(self, times: Array) -> Array:
        """Return T_base_tool (k, 4, 4) at times (k,) in s, blended between samples as by `sample`."""
        i, f = self._between(times)
        a, b = self.Ts_base_tool[i], self.Ts_base_tool[i + 1]
        turn = spatial.log_so3(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3])
        return spatial.pose(a[:, :3, :3] @ spatial.exp_so3(f * turn), (1 - f) * a[:, :3, 3] + f * b[:, :3, 3])

    def on(self, model: Any, times: Array) -> Any:
        """Return what a `ReferenceModel` does at times (k,) in s: a `Run` at the poses, or by the joints if followed.

        Between samples a blended pose may violate the freedoms of a robot with fewer than six; joint values do not.
        """
        q = self.joints(times)
        return model.run(q) if self.followed else model.run_poses(self.poses(times), near=q)

    def joints(self, times: Array) -> Array:
        """Return q (k, n) at times (k,) in s, between samples as by `sample`."""
        i, f = self._between(times)
        return spatial.cubic(f, self.q[i], self.q[i + 1], self.step * self.qd[i], self.step * self.qd[i + 1])

    def _between(self, times: Array) -> tuple[np.ndarray, Array]:
        """Return the sample before each time (k,), and the part (k, 1) of a step behind it."""
        x = np.clip((np.asarray(times, float) - self.t[0]) / self.step, 0, len(self.t) - 1)
        i = np.minimum(x.astype(int), len(self.t) - 2)
        return i, (x - i)[:, None]

    def as_dict(self, arrays: bool = True) -> dict[str, Any]:
        """Return plain data for JSON, SI; NaN becomes None. `arrays` adds every sample."""
        out: dict[str, Any] = {
            "protocol": self.protocol,
            "robot": self.robot,
            "joint_names": list(self.joint_names),
            "frame": self.frame,
            "duration": self.duration,
            "samples": len(self.t),
            "phases": [{k: _plain(v) for k, v in vars(p).items()} for p in self.phases],
            "waypoints": {name: list(rows) for name, rows in self.waypoints.items()},
            "findings": [f.as_dict() for f in self.findings],
        }
        if arrays:
            names = ("t", "q", "qd", "qdd", "Ts_base_tool", "Ts_base_frame", "rcm_error", "depth")
            out |= {name: _plain(getattr(self, name)) for name in names}
            out["singularity"] = {name: _plain(v) for name, v in self.singularity.items()}
            out["reach"] = {name: _plain(v) for name, v in self.reach.items()}
        return out


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [_plain(v) for v in value.tolist()] if np.isnan(value).any() else value.tolist()
    return None if isinstance(value, float) and np.isnan(value) else value


Cause = Literal["reach", "inverse", "lower", "upper", "motor", "gap", "singularity", "branch"]
"""Why a pose is unreachable."""


def key_times(duration: float, rate: float) -> Array:
    """Return (k,) s: every 1 / rate from 0, and the end."""
    count = int(np.floor(duration * rate + 1e-9))
    times = np.arange(count + 1) / rate
    return times if duration - times[-1] < 1e-9 else np.append(times, duration)
