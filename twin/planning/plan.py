"""Plan a protocol: paths, feasibility, timing, samples, and a check of every sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twin.core import spatial
from twin.core.errors import ProtocolError, TimingError
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.planning.check import check, rcm_error
from twin.planning.demands import demands, timed
from twin.planning.feasibility import pose_margins, require_feasible
from twin.planning.free_phase import PhaseProgress, Searched
from twin.planning.long_turns import hint, long_turns
from twin.planning.mechanism_follower import MechanismFollower
from twin.planning.mechanism_path import with_auxiliary, with_free_paths
from twin.planning.path import Path
from twin.planning.path_kinematics import PathKinematics
from twin.planning.phase_path import PhasePath, build
from twin.planning.plan_result import clearance_findings
from twin.planning.protocol import Free, Protocol, Samples
from twin.planning.protocol.course import Motion
from twin.planning.rounds import SearchRounds
from twin.planning.sampled_phase import SampledPhase
from twin.planning.timing import Timing
from twin.planning.trajectory import PhaseCurve, PhaseSpan, Trajectory

_PROBED_POSES = 9
"""Number of poses per phase for which `plan` tests whether the robot has enough degrees of freedom."""


@dataclass(frozen=True)
class PlannedPhase:
    """A planned phase, sampled at every dt including both ends; see `Trajectory` for q, qd, qdd.

    `curve` is the path that was timed; None if the samples were given.
    """

    path: PhasePath
    timing: Timing
    motion: Motion
    q: Array
    qd: Array
    qdd: Array
    curve: PhaseCurve | None = None


def plan(
    protocol: Protocol,
    kinematics: PathKinematics,
    *,
    T_tool_frame: Array,
    dt: float = 1e-3,
    progress: PhaseProgress | None = None,
) -> Trajectory:
    """Plan the timed trajectory of a protocol; each phase begins and ends at rest.

    Args:
        protocol: the protocol.
        kinematics: the robot's planning data.
        T_tool_frame: (4, 4) pose of `protocol.frame` in the tool frame.
        dt: sampling time in s; the duration of every phase is a multiple of dt.
        progress: called with the name of each phase before it is planned, and with a text for each step of free phases.

    Raises:
        ProtocolError: a phase cannot be carried out; the message names the point of the phase where a limit is
            exceeded, the excess, and what is reachable.
        TimingError: no timing within the limits was found.
    """
    T_tool_frame = np.asarray(T_tool_frame, float)
    if T_tool_frame.shape != (4, 4) or not spatial.is_pose(T_tool_frame):
        raise ProtocolError(f"{protocol.name}: T_tool_frame of '{protocol.frame}' is not a pose")
    planned: list[PlannedPhase] = []
    findings = list(protocol.findings)
    say = progress or (lambda label: None)
    rounds: dict[str, SearchRounds] = {}
    guide = _guide(protocol, kinematics, T_tool_frame, say, rounds.__setitem__)
    paths = build(protocol, T_tool_frame, guide)
    for path in paths:
        if path.waypoint is not None:
            findings += long_turns(path, path.phase.name, protocol.waypoints[path.waypoint])
    if guide is None:
        paths = with_auxiliary(paths, kinematics, protocol.name)
        paths = with_free_paths(paths, kinematics, protocol.name, say, rounds.__setitem__)
    for path in paths:
        say(path.phase.name)
        phase, certified = _planned_phase(path, protocol, kinematics, dt)
        planned.append(phase)
        findings += certified
    trajectory = assemble(protocol, kinematics, T_tool_frame, planned, dt)
    phases = []
    for span in trajectory.phases:
        phases.append(replace(span, rounds=rounds.get(span.name)))
    trajectory = replace(trajectory, phases=tuple(phases), followed=guide is not None)
    findings += check(trajectory, protocol, kinematics)
    return replace(trajectory, findings=tuple(findings))


def _guide(
    protocol: Protocol, kinematics: PathKinematics, T_tool_frame: Array, progress: PhaseProgress, searched: Searched
) -> MechanismFollower | None:
    """Return a follower if the mechanism determines the path of the protocol; None if the equations determine it."""
    has_joint_waypoints = any(waypoint.joints is not None for waypoint in protocol.waypoints.values())
    has_samples = any(isinstance(phase, Samples) for phase in protocol.phases)
    if not has_joint_waypoints and not has_samples and protocol.free is None:
        if kinematics.can_assume is None:
            return None
        s = np.linspace(0.0, 1.0, _PROBED_POSES)
        Ts = []
        for path in build(protocol, T_tool_frame):
            Ts.append(path.motion(s).Ts_base_tool)
        if kinematics.can_assume(np.concatenate(Ts)):
            return None
    if kinematics.mechanism is None:
        raise ProtocolError(f"{protocol.name}: joint values and free directions require a mechanism, but there is none")
    return MechanismFollower(protocol, kinematics, kinematics.mechanism, progress, searched)


def _proven_clearance(phase: Free, kinematics: PathKinematics, joints: Path) -> list[Finding]:
    """Return a finding with the proven clearance along a free phase."""
    if kinematics.space is None:
        return []

    def keep(Ts: Array, q: Array) -> np.ndarray:
        """Accept every state: the limits of the path are checked elsewhere."""
        return np.ones(len(q), bool)

    certificate = kinematics.space(phase.scene, phase.clearance, keep).certify(joints)
    return clearance_findings(certificate, phase.name, scene=phase.scene)


def _planned_phase(
    path: PhasePath, protocol: Protocol, kinematics: PathKinematics, dt: float
) -> tuple[PlannedPhase, list[Finding]]:
    """Return a phase with its timing and samples, and a finding with the clearance of a free phase."""
    if isinstance(path, SampledPhase):
        return PlannedPhase(path, *path.sampled(dt)), []
    where = f"{protocol.name}: phase '{path.phase.name}' ({path.phase.type})"
    try:
        require_feasible(path, kinematics, protocol.frame, protocol.name)
    except ProtocolError as error:
        turn_hint = hint(path, path.phase.name, protocol.waypoints.get(path.waypoint or ""))
        # An angle copied with the wrong full turn is a frequent reason why a phase cannot be carried out.
        if turn_hint:
            raise ProtocolError(f"{error}{turn_hint}") from error
        raise
    joints = path.driven(kinematics, where)
    certified = []
    if isinstance(path.phase, Free):
        certified = _proven_clearance(path.phase, kinematics, joints)
    try:
        timing = timed([demands(path, joints, protocol, kinematics, dt)], dt, protocol.timing)
    except TimingError as error:
        raise TimingError(f"{where}: {error}") from error
    return sampled(path, joints, timing, kinematics), certified


def sampled(path: PhasePath, joints: Path, timing: Timing, kinematics: PathKinematics) -> PlannedPhase:
    """Return a phase with its samples; `joints` is the path of the driven joints in this phase."""
    first = joints(timing.s, 1)
    second = joints(timing.s, 2)
    assert timing.grid is not None
    assert timing.rates is not None
    sd = timing.sd[:, None]
    sdd = timing.sdd[:, None]
    return PlannedPhase(
        path=path,
        timing=timing,
        motion=path.motion(timing.s),
        q=path.joints(timing.s, kinematics),
        qd=first * sd,
        qdd=first * sdd + second * sd**2,
        curve=PhaseCurve(joints, path.motion, timing.grid, timing.rates),
    )


def assemble(
    protocol: Protocol, kinematics: PathKinematics, T_tool_frame: Array, planned: list[PlannedPhase], dt: float
) -> Trajectory:
    """Join the planned phases; the sample at the border of two phases is that of the earlier phase."""
    spans: list[PhaseSpan] = []
    waypoints: dict[str, list[int]] = {protocol.start: [0]}
    start = 0
    for phase in planned:
        stop = start + len(phase.timing.t) - 1
        path = phase.path
        spans.append(
            PhaseSpan(
                name=path.phase.name,
                type=path.phase.type,
                start=start,
                stop=stop,
                t0=start * dt,
                t1=stop * dt,
                waypoint=path.waypoint,
                rcm=path.rcm,
                rcm_mode=path.rcm_mode,
                depth0=path.depth0,
                depth1=path.depth1,
                optimal=phase.timing.optimal,
                overshoot=phase.timing.overshoot,
                solver=phase.timing.solver,
                knots=phase.timing.knots,
                smoothing=phase.timing.smoothing,
                for_jerk=phase.timing.for_jerk,
                curve=phase.curve,
            )
        )
        if path.waypoint is not None:
            waypoints.setdefault(path.waypoint, []).append(stop)
        start = stop

    def joined(of: Callable[[PlannedPhase], Array]) -> Array:
        """Return the samples of all phases; the first sample of each phase but the first is left out."""
        parts = [of(planned[0])]
        for phase in planned[1:]:
            parts.append(of(phase)[1:])
        return np.concatenate(parts)

    Ts = joined(lambda phase: phase.motion.Ts_base_tool)
    Ts_frame = Ts @ T_tool_frame
    q = joined(lambda phase: phase.q)
    rcm = np.full(len(q), np.nan)
    depth = np.full(len(q), np.nan)
    for span in spans:
        if span.rcm is None:
            continue
        rows = slice(span.start, span.stop + 1)
        rcm[rows] = rcm_error(Ts_frame[rows], protocol.shaft_axis, span.rcm)
        shaft = Ts_frame[rows, :3, :3] @ protocol.shaft_axis
        depth[rows] = np.einsum("ij,ij->i", Ts_frame[rows, :3, 3] - span.rcm, shaft)
    reach = {}
    for (cause, name), margin in pose_margins(kinematics, Ts, q).items():
        if cause == "reach":
            reach[name] = margin
    return Trajectory(
        protocol=protocol.name,
        robot=protocol.robot,
        joint_names=kinematics.joint_names,
        t=np.arange(len(q), dtype=np.float64) * dt,
        q=q,
        qd=joined(lambda phase: phase.qd),
        qdd=joined(lambda phase: phase.qdd),
        Ts_base_tool=Ts,
        frame=protocol.frame,
        Ts_base_frame=Ts_frame,
        shaft_axis=protocol.shaft_axis,
        tip_velocity=joined(lambda phase: phase.motion.p1 * phase.timing.sd[:, None]),
        tip_acceleration=joined(lambda phase: _second_time_derivative(phase, phase.motion.p1, phase.motion.p2)),
        angular_velocity=joined(lambda phase: phase.motion.w1 * phase.timing.sd[:, None]),
        angular_acceleration=joined(lambda phase: _second_time_derivative(phase, phase.motion.w1, phase.motion.w2)),
        phases=tuple(spans),
        waypoints=dict(zip(waypoints, map(tuple, waypoints.values()), strict=True)),
        rcm_error=rcm,
        depth=depth,
        limit_margin=np.minimum(q - kinematics.lower, kinematics.upper - q),
        reach=reach,
        singularity=dict(kinematics.singularity(Ts, q)),
        revolute=tuple(kinematics.revolute),
    )


def _second_time_derivative(phase: PlannedPhase, first: Array, second: Array) -> Array:
    """Return the second time derivative (k, 3) from the derivatives (k, 3) with respect to the path parameter."""
    return first * phase.timing.sdd[:, None] + second * phase.timing.sd[:, None] ** 2
