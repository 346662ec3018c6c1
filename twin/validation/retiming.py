"""Judge the timing of each phase by a second solver: its duration, and its limits at the grid points of that solver.

The judge takes from the plan its samples, the number of grid points, and the path of each phase (`PhaseCurve`: q(s) and
the motion of the moved frame, with derivatives). It takes the limits from mechanism and protocol. Everything else is
its own: the limited coordinates, their scales, the problem on the grid, the speed of the samples along the path, and
the slowdown. It imports none of the modules that time a plan (contract in pyproject.toml); the solver is an argument.

The shortest duration on the grid is slowed down by max(1, v, sqrt(a)), where v and a are its largest speed and
acceleration, divided by their limits, at five points of each grid interval: coordinates are limited one by one by the
solver, but velocity and acceleration of the moved frame are limited as vectors. The plan must then last this duration,
rounded up to a multiple of its sampling time. What a jerk limit adds, an averaging window and a slowdown, is
taken as the plan states it: the solvers know no jerk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf, nan

import numpy as np

from twin.core.errors import TimingError
from twin.core.findings import Finding, disagreement, error
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Auxiliary, Free, Limits, Protocol, Solver
from twin.planning.trajectory import PhaseCurve, PhaseSpan, Trajectory
from twin.validation.residual_rows import SampleClock, row
from twin.validation.result import PhaseSummary, Residual

DURATION_TOLERANCE = 1e-5
"""Accepted relative deviation of a duration: of the optimum that the plan states from that of the other solver, and of
the sampled duration from this optimum, slowed down and rounded up."""

LIMIT_TOLERANCE = 2e-3
"""Accepted relative excess over a limit: 1e-3 is the planner's tolerance, 1e-3 that of rates taken from samples."""

PATH_TOLERANCE = 1e-6
"""Largest accepted distance of a sample from the path of its phase, as a fraction of the way of the joints."""

Fastest = Callable[[Array, Array, Array, Array], Array]
"""Function of grid (k,), first and second derivatives (m, k) in units of the acceleration limits, and speed limits (m,)
that returns ds/dt (k,) at the grid points."""

_POINTS_PER_INTERVAL = 5
"""Number of points of each grid interval, both ends included, at which the optimum is compared with the limits."""

_FEWEST_STEPS = 2
"""Smallest number of samples after the first one in a phase."""

_MISSING_LIMIT_FACTOR = 1e6
"""A missing limit is replaced by this factor times a typical rate, so that it is never reached."""

_PROJECTION_STEPS = 2
"""Number of Newton steps that project a sample on the path; each doubles the number of correct digits."""

_REST_SQUARED_SPEED = 1e-12
"""Squared speed of a path, relative to its maximum, below which a projection does not divide by it."""

_PLAN_AGAIN_ADVICE = "plan the protocol again; if the phase still deviates, compare both solvers (--timing)"


@dataclass(frozen=True)
class _Limits:
    """Limits in SI; infinite without a limit.

    Attributes:
        speed, acceleration: (n,) of the driven joints.
        motors: (j, n) matrix from joint values to the values of the motors with a speed limit.
        motor_speed: (j,) of these motors.
        frame: limits of the moved frame.
    """

    speed: Array
    acceleration: Array
    motors: Array
    motor_speed: Array
    frame: Limits


@dataclass(frozen=True)
class _Curve:
    """First and second derivatives (k, m) of m coordinates with respect to s, at k points."""

    first: Array
    second: Array

    def every(self, step: int) -> _Curve:
        """Return the derivatives at every `step`-th point, from the first one."""
        return _Curve(self.first[::step], self.second[::step])

    def velocity(self, sd: Array) -> Array:
        """Return the velocities (k, m) at ds/dt (k,)."""
        return self.first * sd[:, None]

    def acceleration(self, sd: Array, sdd: Array) -> Array:
        """Return the accelerations (k, m) at ds/dt (k,) and d2s/dt2 (k,)."""
        return self.first * sdd[:, None] + self.second * sd[:, None] ** 2

    def arc(self) -> _Curve:
        """Return the derivatives (k, 1) of the arc length."""
        speed = np.sqrt(np.sum(self.first**2, axis=1))
        along = np.sum(self.first * self.second, axis=1)
        # Where the curve is at rest, the acceleration along it is 0, not 0/0.
        return _Curve(speed[:, None], (along / np.maximum(speed, np.finfo(float).tiny))[:, None])


@dataclass(frozen=True)
class _Derivatives:
    """The motion of joints (k, n), and of position and rotation (k, 3) of the moved frame, at k points of a path."""

    joints: _Curve
    tip: _Curve
    turn: _Curve

    def every(self, step: int) -> _Derivatives:
        """Return the derivatives at every `step`-th point, from the first one."""
        return _Derivatives(self.joints.every(step), self.tip.every(step), self.turn.every(step))


@dataclass(frozen=True)
class _RetimedPhase:
    """A phase, timed by the other solver.

    Attributes:
        shortest: shortest duration in s on the grid.
        slowdown: factor by which this motion must be slowed down.
        duration_error: relative deviation of the plan's duration; negative if it is too short.
        speed, acceleration: largest speed and acceleration of the plan at the grid points, divided by their limits.
        path_error: largest distance of a sample from the path, as a fraction of the way of the joints.
    """

    shortest: float
    slowdown: float
    duration_error: float
    speed: float
    acceleration: float
    path_error: float


def judge_durations(
    trajectory: Trajectory,
    mechanism: Mechanism,
    protocol: Protocol,
    others: Mapping[Solver, tuple[Solver, Fastest]],
) -> tuple[list[Residual], dict[str, str], list[Finding]]:
    """Judge the timing of each phase; return (rows, {phase: durations as text}, findings).

    Phases whose timing is given by samples have no optimum and are not judged. A phase that the other solver cannot
    time is reported as unchecked, with the reason.

    Args:
        trajectory: the plan.
        mechanism: source of the limits of joints and motors.
        protocol: source of the limits of the moved frame.
        others: {solver that timed a phase: (name of the solver that judges it, this solver)}.
    """
    facts: dict[str, str] = {}
    findings: list[Finding] = []
    judged: list[tuple[PhaseSpan, _RetimedPhase]] = []
    failed: list[str] = []
    for span in trajectory.phases:
        if span.solver is None or span.curve is None:
            facts[span.name] = "given by samples: not judged"
            continue
        name, fastest = others[span.solver]
        try:
            timed = _retimed_phase(trajectory, span, span.curve, _limits(mechanism, protocol, span), fastest)
        except TimingError as reason:
            failed.append(span.name)
            facts[span.name] = f"unchecked: {name}: {reason}"
            text = f"the timing of phase '{span.name}' is unchecked, because {name} found none: {reason}"
            findings.append(error("timing.unchecked", span.name, text, when=f"phase '{span.name}'"))
            continue
        judged.append((span, timed))
        facts[span.name] = _phase_text(span, timed, name)
        findings += _phase_findings(span, timed, name)
    return _timing_rows(judged, failed, others), facts, findings


def _limits(mechanism: Mechanism, protocol: Protocol, span: PhaseSpan) -> _Limits:
    """Return the limits of a phase.

    In a phase in joint space, a joint without a limit has that of the moved frame: if only a jaw moves, nothing else
    limits it.
    """
    frame = protocol.limits[span.type]
    in_joints = _is_in_joints(protocol, span)
    speed = []
    acceleration = []
    for joint in mechanism.active:
        missing_speed = inf
        missing_acceleration = inf
        if in_joints and joint.is_angle:
            missing_speed = frame.rotation_speed
            missing_acceleration = frame.rotation_acceleration
        elif in_joints:
            missing_speed = frame.tip_speed
            missing_acceleration = frame.tip_acceleration
        speed.append(joint.max_speed or missing_speed)
        acceleration.append(joint.max_acceleration or missing_acceleration)
    # motors have no acceleration limits of their own in a description
    rows, motor_speed = _motor_limits(mechanism)
    return _Limits(
        speed=np.array(speed), acceleration=np.array(acceleration), motors=rows, motor_speed=motor_speed, frame=frame
    )


def _is_in_joints(protocol: Protocol, span: PhaseSpan) -> bool:
    """Return whether a phase is a motion of the joints, whose frame follows."""
    for phase in protocol.phases:
        if phase.name != span.name:
            continue
        if isinstance(phase, (Auxiliary, Free)):
            return True
        waypoint = protocol.waypoints.get(span.waypoint or "")
        return phase.by_joints and waypoint is not None and waypoint.joints is not None
    return False


def _motor_limits(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return `motors` and `motor_speed` of `_Limits`."""
    speeds = {actuator.name: actuator.max_speed for actuator in mechanism.actuators}
    limited = []
    motor_speed = []
    for i, name in enumerate(mechanism.motor_names):
        speed = speeds.get(name)
        if speed:
            limited.append(i)
            motor_speed.append(speed)
    # the motor rates are linear in the joint rates: row i has those of motor i
    from_joints = mechanism.motors(np.eye(len(mechanism.active))).T
    return from_joints[limited], np.array(motor_speed)


def _derivatives(curve: PhaseCurve, s: Array) -> _Derivatives:
    """Return the derivatives of joints and moved frame at path parameters s (k,)."""
    joints = _Curve(curve.joints(s, 1), curve.joints(s, 2))
    motion = curve.motion(s)
    return _Derivatives(joints, _Curve(motion.p1, motion.p2), _Curve(motion.w1, motion.w2))


def _retimed_phase(
    trajectory: Trajectory, span: PhaseSpan, curve: PhaseCurve, limits: _Limits, fastest: Fastest
) -> _RetimedPhase:
    """Return a phase, timed by the solver `fastest`.

    Raises:
        TimingError: the solver found no timing.
    """
    dt = trajectory.step
    steps = span.stop - span.start
    parts = _POINTS_PER_INTERVAL - 1
    dense = np.linspace(0.0, 1.0, parts * (span.knots - 1) + 1)
    grid = dense[::parts]
    at_dense = _derivatives(curve, dense)
    at_grid = at_dense.every(parts)

    # The optimum of the other solver.
    rates = _fastest_rates(grid, at_grid, limits, steps * dt, fastest)
    mean_rates = (rates[1:] + rates[:-1]) / 2
    shortest = float(np.sum(np.diff(grid) / mean_rates))
    speed, acceleration = _largest_loads(dense, at_dense, grid, rates, limits)
    # a motion that is slowed down by a factor has accelerations that are lower by its square
    slowdown = max(1.0, speed, float(np.sqrt(acceleration))) * span.for_jerk

    # The sampled duration, without averaging, is the needed duration, rounded up to a multiple of dt.
    needed_steps = shortest * slowdown / dt
    planned_steps = steps - round(span.smoothing / dt)
    missing = min(0.0, planned_steps - needed_steps)
    excess = max(0.0, planned_steps - max(needed_steps + 1, _FEWEST_STEPS))
    sampled_deviation = (missing + excess) / needed_steps
    # a plan may state a right optimum and last another time, or the reverse: the worse of both counts
    stated_deviation = span.optimal / shortest - 1
    deviation = max(stated_deviation, sampled_deviation, key=abs)

    # The samples of the plan.
    q = trajectory.q[span.start : span.stop + 1]
    s, path_error = _project_on_path(q, curve, dense)
    sd, sdd = _rates_of_samples(grid, s, dt)
    speeds, accelerations = _loads(at_grid, sd, sdd, limits)
    return _RetimedPhase(
        shortest=shortest,
        slowdown=slowdown,
        duration_error=deviation,
        speed=float(np.max(speeds)),
        acceleration=float(np.max(accelerations)),
        path_error=path_error,
    )


def _fastest_rates(
    grid: Array, derivatives: _Derivatives, limits: _Limits, time_unit: float, fastest: Fastest
) -> Array:
    """Return the largest ds/dt (k,) at the grid points, from rest to rest.

    Times are in units of `time_unit` s (the duration of the plan), and each coordinate is in units of its acceleration
    limit times `time_unit` squared: solvers have absolute tolerances, with which they would fail for short paths.
    """
    joints = derivatives.joints
    tip = derivatives.tip.arc()
    turn = derivatives.turn.arc()
    first = np.column_stack([joints.first, tip.first, turn.first, joints.first @ limits.motors.T])
    second = np.column_stack([joints.second, tip.second, turn.second, joints.second @ limits.motors.T])
    if not (np.all(np.isfinite(first)) and np.all(np.isfinite(second))):
        raise TimingError("the path has no finite derivatives")

    frame = limits.frame
    no_limit = np.full(len(limits.motor_speed), inf)
    frame_speed = [frame.tip_speed, frame.rotation_speed]
    frame_acceleration = [frame.tip_acceleration, frame.rotation_acceleration]
    speed = np.concatenate([limits.speed, frame_speed, limits.motor_speed])
    acceleration = np.concatenate([limits.acceleration, frame_acceleration, no_limit])

    # The solvers need finite limits: a missing one is so high that it is never reached.
    typical = np.max(np.abs(first), axis=0)
    typical[typical == 0] = 1.0
    speed = np.where(np.isfinite(speed), speed, _MISSING_LIMIT_FACTOR * typical / time_unit)
    acceleration = np.where(np.isfinite(acceleration), acceleration, _MISSING_LIMIT_FACTOR * typical / time_unit**2)

    scale = acceleration * time_unit**2
    scaled_first = np.ascontiguousarray((first / scale).T)
    scaled_second = np.ascontiguousarray((second / scale).T)
    rates = fastest(grid, scaled_first, scaled_second, speed * time_unit / scale)
    # an interval that is at rest at both ends would take an infinite time
    if not np.all(rates[1:] + rates[:-1] > 0):
        raise TimingError("the speed is zero between start and end of the path")
    return rates / time_unit


def _largest_loads(
    dense: Array, at_dense: _Derivatives, grid: Array, rates: Array, limits: _Limits
) -> tuple[float, float]:
    """Return the largest speed and acceleration, divided by their limits, of a motion with given rates at grid points.

    d2s/dt2 is constant in each grid interval, so that it has two values at a grid point.
    """
    # If d2s/dt2 is constant, the square of ds/dt is linear in s.
    sd = np.sqrt(np.interp(dense, grid, rates**2))
    constant = np.diff(rates**2) / (2 * np.diff(grid))
    in_intervals = np.repeat(constant, _POINTS_PER_INTERVAL - 1)
    after = np.append(in_intervals, in_intervals[-1])
    before = np.insert(in_intervals, 0, in_intervals[0])
    speeds, accelerations_after = _loads(at_dense, sd, after, limits)
    _, accelerations_before = _loads(at_dense, sd, before, limits)
    return float(np.max(speeds)), float(np.max([accelerations_after, accelerations_before]))


def _loads(derivatives: _Derivatives, sd: Array, sdd: Array, limits: _Limits) -> tuple[Array, Array]:
    """Return the largest speed and acceleration (k,), each divided by its limit, of joints, motors and moved frame."""
    qd = derivatives.joints.velocity(sd)
    qdd = derivatives.joints.acceleration(sd, sdd)
    speeds = [np.max(np.abs(qd) / limits.speed, axis=1)]
    accelerations = [np.max(np.abs(qdd) / limits.acceleration, axis=1)]
    if len(limits.motors):
        motor_speeds = qd @ limits.motors.T
        speeds.append(np.max(np.abs(motor_speeds) / limits.motor_speed, axis=1))
    frame = limits.frame
    speeds.append(np.linalg.norm(derivatives.tip.velocity(sd), axis=1) / frame.tip_speed)
    speeds.append(np.linalg.norm(derivatives.turn.velocity(sd), axis=1) / frame.rotation_speed)
    accelerations.append(np.linalg.norm(derivatives.tip.acceleration(sd, sdd), axis=1) / frame.tip_acceleration)
    accelerations.append(np.linalg.norm(derivatives.turn.acceleration(sd, sdd), axis=1) / frame.rotation_acceleration)
    return np.max(speeds, axis=0), np.max(accelerations, axis=0)


def _project_on_path(q: Array, curve: PhaseCurve, dense: Array) -> tuple[Array, float]:
    """Return (s (k,) at which the path has the joint values q (k, n), largest distance of q from the path).

    The distance is a fraction of the way of the joints. The first estimate of s is by the length of the way: it also
    holds for a path that returns to earlier joint values. Newton steps then project each sample on the path.
    """
    on_path = curve.joints(dense)
    path_length = _path_lengths(on_path)
    sample_length = _path_lengths(q)
    if not (path_length[-1] > 0 and sample_length[-1] > 0):
        raise TimingError("no joint moves")
    path_parameters = np.interp(sample_length / sample_length[-1], path_length / path_length[-1], dense)
    for _ in range(_PROJECTION_STEPS):
        first = curve.joints(path_parameters, 1)
        ahead = np.sum(first * (q - curve.joints(path_parameters)), axis=1)
        slope = np.sum(first**2, axis=1)
        slope = np.maximum(slope, _REST_SQUARED_SPEED * np.max(slope))  # the path may be at rest, as at its ends
        path_parameters = np.clip(path_parameters + ahead / slope, 0.0, 1.0)
    path_parameters = np.maximum.accumulate(path_parameters)  # a motion does not go back; rounding at its ends may
    travel = np.max(np.sum(np.abs(np.diff(on_path, axis=0)), axis=0))
    distance = np.max(np.abs(q - curve.joints(path_parameters)))
    return path_parameters, float(distance / travel)


def _path_lengths(q: Array) -> Array:
    """Return the length (k,) of the way along rows q (k, n), from the first row."""
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _rates_of_samples(grid: Array, s: Array, dt: float) -> tuple[Array, Array]:
    """Return ds/dt and d2s/dt2 at the grid points, from samples s (k,) of a motion from rest to rest."""
    extended = np.concatenate([s[1:2], s, s[-2:-1]])  # continued by its mirror image in time
    before = extended[:-2]
    at = extended[1:-1]
    after = extended[2:]
    rate = (after - before) / (2 * dt)
    second_rate = (after - 2 * at + before) / dt**2
    # the square of ds/dt is nearly linear in s, ds/dt itself is not: near rest it has a vertical tangent
    rate_at_grid = np.sqrt(np.interp(grid, s, rate**2))
    second_rate_at_grid = np.interp(grid, s, second_rate)
    return rate_at_grid, second_rate_at_grid


def _phase_text(span: PhaseSpan, timed: _RetimedPhase, name: str) -> str:
    """Return the durations of a phase by both solvers as text; `name` is the solver that judges."""
    slowed_down = ""
    if timed.slowdown > 1 + DURATION_TOLERANCE:
        slowed_down = f", slowed down by {100 * (timed.slowdown - 1):.2g} % between grid points"
    averaged = ""
    if span.smoothing:
        averaged = f", averaged over {span.smoothing:.3g} s"
    return (
        f"{span.solver} {span.optimal:.6f} s, {name} {timed.shortest:.6f} s{slowed_down}{averaged}; planned: "
        f"{span.t1 - span.t0:.3f} s, at most {100 * timed.speed:.1f} % of a speed limit and "
        f"{100 * timed.acceleration:.1f} % of an acceleration limit"
    )


def _phase_findings(span: PhaseSpan, timed: _RetimedPhase, name: str) -> Iterator[Finding]:
    """Yield findings on the path, the duration and the limits of a phase; `name` is the solver that judges."""
    when = f"phase '{span.name}'"
    if timed.path_error > PATH_TOLERANCE:
        what = f"samples of phase '{span.name}' leave its path, as a fraction of its length"
        yield disagreement(
            "timing.path",
            span.name,
            what,
            size=Quantity(timed.path_error),
            limit=PATH_TOLERANCE,
            suggestion=_PLAN_AGAIN_ADVICE,
            when=when,
        )
    if abs(timed.duration_error) > DURATION_TOLERANCE:
        lasts = span.t1 - span.t0 - span.smoothing
        needed = timed.shortest * timed.slowdown
        word = "short" if timed.duration_error < 0 else "long"
        what = (
            f"phase '{span.name}' is too {word}: it lasts {lasts:.6g} s, and its optimum is stated as "
            f"{span.optimal:.7g} s; by {name}, the optimum is {timed.shortest:.7g} s, and the phase needs {needed:.7g} "
            "s; relative deviation"
        )
        yield disagreement(
            "timing.duration",
            span.name,
            what,
            size=Quantity(abs(timed.duration_error)),
            limit=DURATION_TOLERANCE,
            suggestion=_PLAN_AGAIN_ADVICE,
            when=when,
        )
    for rate, load in (("speed", timed.speed), ("acceleration", timed.acceleration)):
        if load > 1 + LIMIT_TOLERANCE:
            what = f"phase '{span.name}' exceeds a limit of {rate} at the grid points of {name}, relative to the limit"
            yield disagreement(
                f"timing.grid_{rate}",
                span.name,
                what,
                size=Quantity(load),
                limit=1 + LIMIT_TOLERANCE,
                suggestion=_PLAN_AGAIN_ADVICE,
                when=when,
            )


def _timing_rows(
    judged: list[tuple[PhaseSpan, _RetimedPhase]],
    failed: list[str],
    others: Mapping[Solver, tuple[Solver, Fastest]],
) -> list[Residual]:
    """Return three rows over all phases: durations, and the excess of speed and acceleration over their limits."""
    unchecked = "; ".join(f"unchecked: {name}" for name in failed)
    if not judged:
        note = unchecked or "given by samples"
        return [
            Residual(
                "P-T", "duration", "phases", unit="", worst=nan, rms=nan, tolerance=None, t=0.0, phase="", note=note
            )
        ]
    judges: list[str] = []
    phases: list[PhaseSummary] = []
    deviations = np.zeros(len(judged))
    speeds = np.zeros(len(judged))
    accelerations = np.zeros(len(judged))
    for i, (span, timed) in enumerate(judged):
        phases.append(PhaseSummary(span.name, span.type, span.t0, span.t1))
        if span.solver is not None:
            judge, _ = others[span.solver]
            if judge not in judges:
                judges.append(judge)
        deviations[i] = timed.duration_error
        speeds[i] = timed.speed
        accelerations[i] = timed.acceleration
    # a row of the residual matrix belongs to a time: each phase has the time of its end
    ends = np.array([phase.t1 for phase in phases])
    clock = SampleClock(ends, tuple(phases))
    addition = f"; {unchecked}" if unchecked else ""

    solvers = " and ".join(judges)
    note = f"relative deviation from the shortest duration by {solvers}, slowed down and rounded up{addition}"
    rows = [
        row(
            "P-T",
            "duration",
            "phases",
            unit="",
            differences=deviations,
            tolerance=DURATION_TOLERANCE,
            clock=clock,
            note=note,
        )
    ]
    for rate, loads in (("speed", speeds), ("acceleration", accelerations)):
        excess = np.maximum(loads - 1, 0.0)
        note = f"relative excess at the grid points; at most {100 * np.max(loads):.1f} % of a limit{addition}"
        rows.append(
            row("P-T", "limit", rate, unit="", differences=excess, tolerance=LIMIT_TOLERANCE, clock=clock, note=note)
        )
    return rows
