"""The result of planning: a trajectory, which is a timed protocol with samples at a fixed time step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from twin.core import spatial
from twin.core.errors import ProtocolError, unknown
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.planning.path import Path
from twin.planning.protocol import RcmMode, Solver
from twin.planning.protocol.course import Motion
from twin.planning.rounds import SearchRounds

if TYPE_CHECKING:
    from twin.reference import ReferenceModel
    from twin.reference.states import SolvedSamples


@dataclass(frozen=True)
class PhaseCurve:
    """The path that a phase follows: what an independent solver needs to compute the timing of the phase again.

    Attributes:
        joints: path of the driven joints (n,) over s from 0 to 1, with derivatives.
        motion: function of s (k,) that returns the motion of the moved frame, with derivatives with respect to s.
        grid: (g,) grid points of s, between which d2s/dt2 is constant.
        rates: (g,) ds/dt at the grid points, before an averaging that keeps the jerk limit.
    """

    joints: Path
    motion: Callable[[Array], Motion]
    grid: Array
    rates: Array


@dataclass(frozen=True)
class PhaseSpan:
    """Time span of one phase. Neighbouring phases share the sample between them, which is at rest.

    Attributes:
        name, type: name and type in the protocol.
        start, stop: indices of the first and the last sample, both included.
        t0, t1: times of these samples in s.
        waypoint: name of the waypoint at the end; None if there is none.
        rcm: (3,) registered RCM in m, in base; None if there is none.
        rcm_mode: "enforced", "monitored" or None.
        depth0, depth1: depth in m at both ends; NaN without RCM.
        optimal: optimal duration in s, before slowing down and rounding up.
        overshoot: largest relative excess of the optimal solution over a limit, before slowing down.
        solver: solver of the timing: "passes" (our own) or "toppra" (the package); None if the timing was given.
        knots: number of grid points of the solver, evenly spaced over the path; 0 if the timing was given.
        smoothing: length in s of the averaging window that keeps the jerk limit, a part of the duration.
        for_jerk: factor by which the phase was also slowed down, because no window alone kept the jerk limit.
        curve: the path; None if the timing was given.
        rounds: rounds of the search for the path of a free phase; None without a search.
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
    solver: Solver | None
    knots: int
    smoothing: float
    for_jerk: float
    curve: PhaseCurve | None = field(default=None, repr=False, compare=False)
    rounds: SearchRounds | None = None

    def as_dict(self) -> JsonObject:
        """Return the phase as plain data, without its curve."""
        content = {}
        for name, value in vars(self).items():
            if name != "curve":
                content[name] = _plain(value)
        return content


@dataclass(frozen=True, repr=False)
class Trajectory:
    """A timed protocol: k samples with a fixed time step, in SI, in base unless stated otherwise.

    Attributes:
        protocol, robot: names of the protocol and of the robot.
        joint_names: names of the n active joints, in the order of q.
        t: (k,) times in s.
        q, qd, qdd: (k, n) joint values and their time derivatives; at a sample shared by two phases, qdd is that of the
            earlier phase.
        Ts_base_tool: (k, 4, 4) tool poses.
        frame: name of the moved frame.
        Ts_base_frame: (k, 4, 4) poses of the moved frame.
        shaft_axis: (3,) direction of the shaft in the moved frame.
        tip_velocity, tip_acceleration: (k, 3) of the origin of the moved frame, in m/s and m/s2.
        angular_velocity, angular_acceleration: (k, 3) of the moved frame, in rad/s and rad/s2.
        phases: time spans of the phases, in order.
        waypoints: {name of the waypoint: indices of the samples at which it is reached}.
        rcm_error: (k,) distance in m from the RCM to the shaft axis; NaN without RCM.
        depth: (k,) depth in m; NaN without RCM.
        limit_margin: (k, n) distance to the nearer hard limit; negative if the limit is exceeded.
        reach: reach margins (k,) in m, by limb.
        singularity: singularity measures (k,), by name.
        findings: findings of the check of every sample.
        followed: whether the mechanism, not the equations, determines joint values and poses; see `mechanism_follower`.
        revolute: (n,) whether each joint is in rad; left out: all joints are lengths.
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
    revolute: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        if not self.revolute:
            object.__setattr__(self, "revolute", (False,) * len(self.joint_names))

    def __repr__(self) -> str:
        joints = len(self.joint_names)
        size = f"{self.duration:.2f} s, {len(self.t)} samples, {joints} joints"
        return f"Trajectory({self.protocol!r} of {self.robot!r}, {size})"

    def _repr_html_(self) -> str:
        """Return the trajectory as a notebook shows it."""
        facts = f"{self.duration:.2f} s, {len(self.t)} samples, {len(self.joint_names)} joints"
        # by name: only notebooks need it
        picture = import_module("twin.planning.trajectory_picture")
        title = f"{self.robot}: {self.protocol}"
        return picture.html_of(title, facts, self.joint_names, self.q, self.qd, self.revolute)

    @property
    def step(self) -> float:
        """Time in s between samples."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def duration(self) -> float:
        """Time in s from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    @property
    def tip_speed(self) -> Array:
        """Speed (k,) of the origin of the moved frame in m/s."""
        return np.linalg.norm(self.tip_velocity, axis=1)

    @property
    def rcm(self) -> Array:
        """Registered RCM (k, 3) in m, in base; NaN where there is none."""
        rcm = np.full((len(self.t), 3), np.nan)
        for span in self.phases:
            if span.rcm is not None:
                rcm[span.start : span.stop + 1] = span.rcm
        return rcm

    def phase(self, which: str | float) -> PhaseSpan:
        """Return the phase with a name, or the phase at a time in s.

        Raises:
            ProtocolError: there is no phase with this name, or the time is outside the trajectory.
        """
        if isinstance(which, str):
            for span in self.phases:
                if span.name == which:
                    return span
            raise ProtocolError(unknown("phase", which, [span.name for span in self.phases]))
        for span in self.phases:
            if span.t0 <= which <= span.t1:
                return span
        raise ProtocolError(f"time {which:g} s is outside 0..{self.duration:g} s")

    def sample(self, t: float) -> tuple[Array, Array]:
        """Return q (n,) and T_base_tool (4, 4) at a time in s.

        Before the start, the first sample is returned; after the end, the last sample. Between samples, q is a cubic
        that agrees with q and qd at the samples. The tool's position is interpolated linearly, and its rotation with a
        constant rate.
        """
        times = np.array([t], float)
        return self.joints(times)[0], self.poses(times)[0]

    def poses(self, times: Array) -> Array:
        """Return T_base_tool (k, 4, 4) at times (k,) in s, interpolated as in `sample`."""
        index, fraction = self._between(times)
        before = self.Ts_base_tool[index]
        after = self.Ts_base_tool[index + 1]
        R = before[:, :3, :3]
        turn = spatial.log_so3(np.swapaxes(R, 1, 2) @ after[:, :3, :3])
        position = (1 - fraction) * before[:, :3, 3] + fraction * after[:, :3, 3]
        return spatial.pose(R @ spatial.exp_so3(fraction * turn), position)

    def on(self, model: ReferenceModel, times: Array) -> SolvedSamples:
        """Return the states of a reference model at times (k,) in s, solved for the poses or, if `followed`, for q.

        A robot with fewer than six degrees of freedom may be unable to assume an interpolated pose; it can assume
        interpolated joint values.
        """
        q = self.joints(times)
        if self.followed:
            return model.run(q)
        return model.run_poses(self.poses(times), near=q)

    def joints(self, times: Array) -> Array:
        """Return q (k, n) at times (k,) in s, interpolated as in `sample`."""
        index, fraction = self._between(times)
        slope0 = self.step * self.qd[index]
        slope1 = self.step * self.qd[index + 1]
        return spatial.cubic(fraction, self.q[index], self.q[index + 1], slope0, slope1)

    def _between(self, times: Array) -> tuple[np.ndarray, Array]:
        """Return (index of the sample before each time (k,), fraction (k, 1) of the step after it)."""
        last = len(self.t) - 1
        steps = np.clip((np.asarray(times, float) - self.t[0]) / self.step, 0, last)
        i = np.minimum(steps.astype(int), last - 1)  # the end belongs to the last step
        return i, (steps - i)[:, None]

    def as_dict(self, arrays: bool = True) -> JsonObject:
        """Return the content for JSON: SI units, None instead of NaN, and with `arrays` the values of all samples."""
        content: JsonObject = {
            "protocol": self.protocol,
            "robot": self.robot,
            "joint_names": list(self.joint_names),
            "frame": self.frame,
            "duration": self.duration,
            "samples": len(self.t),
            "phases": [span.as_dict() for span in self.phases],
            "waypoints": {name: list(rows) for name, rows in self.waypoints.items()},
            "findings": [finding.as_dict() for finding in self.findings],
        }
        if arrays:
            names = ("t", "q", "qd", "qdd", "Ts_base_tool", "Ts_base_frame", "rcm_error", "depth")
            for name in names:
                content[name] = _plain(getattr(self, name))
            content["singularity"] = {name: _plain(measure) for name, measure in self.singularity.items()}
            content["reach"] = {name: _plain(margin) for name, margin in self.reach.items()}
        return content


def _plain(value: object) -> object:
    """Return a value of a trajectory for JSON, with None instead of NaN."""
    if isinstance(value, SearchRounds):
        return value.as_dict()
    if isinstance(value, np.ndarray):
        values = value.tolist()
        if np.isnan(value).any():
            return list(map(_plain, values))
        return values
    if isinstance(value, float) and np.isnan(value):
        return None
    return value


_ROUNDING = 1e-9
"""Rounding of a time in s, or of a number of steps."""


def key_times(duration: float, rate: float) -> Array:
    """Return times (k,) in s: multiples of 1 / rate from 0, and the end."""
    count = int(np.floor(duration * rate + _ROUNDING))
    times = np.arange(count + 1) / rate
    if duration - times[-1] < _ROUNDING:  # the end is a multiple
        return times
    return np.append(times, duration)
