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
from twin.validation.result import PhaseSummary, Residual
from twin.validation.rows import Clock, row

DURATION = 1e-5
"""Accepted relative deviation of a duration: of the optimum that the plan states from that of the other solver, and of
the sampled duration from this optimum, slowed down and rounded up."""

OVER = 2e-3
"""Accepted relative excess over a limit: 1e-3 is the planner's tolerance, 1e-3 that of rates taken from samples."""

OFF = 1e-6
"""Largest accepted distance of a sample from the path of its phase, as a fraction of the way of the joints."""

Fastest = Callable[[Array, Array, Array, Array], Array]
"""Function of grid (k,), first and second derivatives (m, k) in units of the acceleration limits, and speed limits (m,)
that returns ds/dt (k,) at the grid points."""

_POINTS = 5
"""Number of points of each grid interval, both ends included, at which the optimum is compared with the limits."""

_FEWEST = 2
"""Smallest number of samples after the first one in a phase."""

_NEVER = 1e6
"""A missing limit is replaced by this factor times a typical rate, so that it is never reached."""

_AGAIN = "plan the protocol again; if the phase still deviates, compare both solvers (--timing)"


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
class _Derivatives:
    """First and second derivatives with respect to s at k points: joints (k, n), position and rotation (k, 3)."""

    joints: tuple[Array, Array]
    tip: tuple[Array, Array]
    turn: tuple[Array, Array]


@dataclass(frozen=True)
class _Timed:
    """A phase, timed by the other solver.

    Attributes:
        shortest: shortest duration in s on the grid.
        slower: factor by which this motion must be slowed down.
        duration: relative deviation of the plan's duration; negative if it is too short.
        speed, acceleration: largest speed and acceleration of the plan at the grid points, divided by their limits.
        off: largest distance of a sample from the path, as a fraction of the way of the joints.
    """

    shortest: float
    slower: float
    duration: float
    speed: float
    acceleration: float
    off: float


def durations(
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
    judged: list[tuple[PhaseSpan, _Timed]] = []
    failed: list[str] = []
    for span in trajectory.phases:
        if span.solver is None or span.curve is None:
            facts[span.name] = "given by samples: not judged"
            continue
        name, fastest = others[span.solver]
        try:
            timed = _timed(trajectory, span, span.curve, _limits(mechanism, protocol, span), fastest)
        except TimingError as reason:
            failed.append(span.name)
            facts[span.name] = f"unchecked: {name}: {reason}"
            text = f"the timing of phase '{span.name}' is unchecked, because {name} found none: {reason}"
            findings.append(error("timing.unchecked", span.name, text, when=f"phase '{span.name}'"))
            continue
        judged.append((span, timed))
        facts[span.name] = _fact(span, timed, name)
        findings += _findings(span, timed, name)
    return _rows(judged, failed, others), facts, findings


def _limits(mechanism: Mechanism, protocol: Protocol, span: PhaseSpan) -> _Limits:
    """Return the limits of a phase.

    In a phase in joint space, a joint without a limit has that of the moved frame: if only a jaw moves, nothing else
    limits it.
    """
    frame = protocol.limits[span.type]
    phase = next((p for p in protocol.phases if p.name == span.name), None)
    waypoint = protocol.waypoints.get(span.waypoint or "")
    in_joints = isinstance(phase, (Auxiliary, Free))
    if phase is not None and phase.by_joints and waypoint is not None and waypoint.joints is not None:
        in_joints = True
    speed, acceleration = [], []
    for joint in mechanism.active:
        usual_speed = frame.rotation_speed if joint.is_angle else frame.tip_speed
        usual_acceleration = frame.rotation_acceleration if joint.is_angle else frame.tip_acceleration
        speed.append(joint.max_speed or (usual_speed if in_joints else inf))
        acceleration.append(joint.max_acceleration or (usual_acceleration if in_joints else inf))
    most = {a.name: a.max_speed for a in mechanism.actuators if a.max_speed}
    limited = [i for i, name in enumerate(mechanism.motor_names) if name in most]
    rows = mechanism.motors(np.eye(len(mechanism.active))).T[limited]
    motor_speed = np.array([most[mechanism.motor_names[i]] for i in limited])
    return _Limits(np.array(speed), np.array(acceleration), rows, motor_speed, frame)


def _derivatives(curve: PhaseCurve, s: Array) -> _Derivatives:
    m = curve.motion(s)
    return _Derivatives((curve.joints(s, 1), curve.joints(s, 2)), (m.p1, m.p2), (m.w1, m.w2))


def _timed(trajectory: Trajectory, span: PhaseSpan, curve: PhaseCurve, limits: _Limits, fastest: Fastest) -> _Timed:
    """Return a phase, timed by the solver `fastest`.

    Raises:
        TimingError: the solver found no timing.
    """
    dt, steps = trajectory.step, span.stop - span.start
    part = _POINTS - 1
    dense = np.linspace(0.0, 1.0, part * (span.knots - 1) + 1)
    every = _derivatives(curve, dense)
    grid = dense[::part]
    at_grid = _Derivatives(*((d1[::part], d2[::part]) for d1, d2 in (every.joints, every.tip, every.turn)))
    rates = _rates(grid, at_grid, limits, steps * dt, fastest)
    shortest = float(np.sum(2 * np.diff(grid) / (rates[1:] + rates[:-1])))
    speed, acceleration = _between(dense, every, grid, rates, limits)
    slower = max(1.0, speed, float(np.sqrt(acceleration))) * span.for_jerk
    # The sampled duration, without averaging, is the needed duration, rounded up to a multiple of dt.
    lasts = steps - round(span.smoothing / dt)
    needed = shortest * slower / dt
    sampled = min(0.0, lasts - needed) + max(0.0, lasts - max(needed + 1, _FEWEST))
    stated = span.optimal / shortest - 1
    s, off = _progress(trajectory.q[span.start : span.stop + 1], curve, dense)
    v, a = _loads(at_grid, *_at(grid, s, dt), limits)
    deviation = max(stated, sampled / needed, key=abs)
    return _Timed(shortest, slower, deviation, float(np.max(v)), float(np.max(a)), off)


def _rates(grid: Array, d: _Derivatives, limits: _Limits, unit: float, fastest: Fastest) -> Array:
    """Return the largest ds/dt (k,) at the grid points, from rest to rest.

    Times are in units of `unit` s (the duration of the plan), and each coordinate is in units of its acceleration limit
    times `unit` squared: solvers have absolute tolerances, with which they would fail for short paths.
    """
    ways = [_arc(*d.tip), _arc(*d.turn)]
    first = np.column_stack([d.joints[0], *(w[0] for w in ways), d.joints[0] @ limits.motors.T])
    second = np.column_stack([d.joints[1], *(w[1] for w in ways), d.joints[1] @ limits.motors.T])
    f = limits.frame
    speed = np.concatenate([limits.speed, [f.tip_speed, f.rotation_speed], limits.motor_speed])
    none = np.full(len(limits.motor_speed), inf)
    acceleration = np.concatenate([limits.acceleration, [f.tip_acceleration, f.rotation_acceleration], none])
    moves = np.max(np.abs(first), axis=0)
    moves[moves == 0] = 1.0
    speed = np.where(np.isfinite(speed), speed, _NEVER * moves / unit)
    acceleration = np.where(np.isfinite(acceleration), acceleration, _NEVER * moves / unit**2)
    if not (np.all(np.isfinite(first)) and np.all(np.isfinite(second))):
        raise TimingError("the path has no finite derivatives")
    size = acceleration * unit**2
    first, second = (np.ascontiguousarray((d / size).T) for d in (first, second))
    rates = fastest(grid, first, second, speed * unit / size)
    if not np.all(rates[1:] + rates[:-1] > 0):
        raise TimingError("the speed is zero between start and end of the path")
    return rates / unit


def _arc(first: Array, second: Array) -> tuple[Array, Array]:
    """Return first and second derivative (k,) of the arc length of a curve with these derivatives (k, 3)."""
    length = np.sqrt(np.sum(first**2, axis=1))
    return length, np.sum(first * second, axis=1) / np.maximum(length, np.finfo(float).tiny)


def _between(dense: Array, every: _Derivatives, grid: Array, rates: Array, limits: _Limits) -> tuple[float, float]:
    """Return the largest speed and acceleration, divided by their limits, of a motion with given rates at grid points.

    d2s/dt2 is constant in each grid interval, so that it has two values at a grid point.
    """
    squares = np.interp(dense, grid, rates**2)
    constant = np.diff(rates**2) / (2 * np.diff(grid))
    before = np.repeat(constant, _POINTS - 1)
    most = [
        _loads(every, np.sqrt(squares), sdd, limits)
        for sdd in (np.append(before, before[-1]), np.insert(before, 0, before[0]))
    ]
    speed, acceleration = (np.max([found[i] for found in most]) for i in (0, 1))
    return float(speed), float(acceleration)


def _loads(d: _Derivatives, sd: Array, sdd: Array, limits: _Limits) -> tuple[Array, Array]:
    """Return the largest speed and acceleration (k,), each divided by its limit, of joints, motors and moved frame."""
    sd, sdd = sd[:, None], sdd[:, None]
    qd = d.joints[0] * sd
    qdd = d.joints[0] * sdd + d.joints[1] * sd**2
    speeds = [np.max(np.abs(qd) / limits.speed, axis=1)]
    accelerations = [np.max(np.abs(qdd) / limits.acceleration, axis=1)]
    if len(limits.motors):
        speeds.append(np.max(np.abs(qd @ limits.motors.T) / limits.motor_speed, axis=1))
    f = limits.frame
    for (first, second), most_speed, most_acceleration in (
        (d.tip, f.tip_speed, f.tip_acceleration),
        (d.turn, f.rotation_speed, f.rotation_acceleration),
    ):
        speeds.append(np.linalg.norm(first * sd, axis=1) / most_speed)
        accelerations.append(np.linalg.norm(first * sdd + second * sd**2, axis=1) / most_acceleration)
    return np.max(speeds, axis=0), np.max(accelerations, axis=0)


def _progress(q: Array, curve: PhaseCurve, dense: Array) -> tuple[Array, float]:
    """Return (s (k,) at which the path has the joint values q (k, n), largest distance of q from the path).

    The distance is a fraction of the way of the joints. The first estimate of s is by the length of the way: it also
    holds for a path that returns to earlier joint values. Newton steps then project each sample on the path.
    """
    table = curve.joints(dense)
    size = np.max(np.sum(np.abs(np.diff(table, axis=0)), axis=0))
    way = _length(table)
    gone = _length(q)
    if not (way[-1] > 0 and gone[-1] > 0):
        raise TimingError("no joint moves")
    s = np.interp(gone / gone[-1], way / way[-1], dense)
    for _ in range(2):
        first = curve.joints(s, 1)
        steep = np.sum(first**2, axis=1)
        ahead = np.sum(first * (q - curve.joints(s)), axis=1)
        s = np.clip(s + ahead / np.maximum(steep, 1e-12 * np.max(steep)), 0.0, 1.0)
    s = np.maximum.accumulate(s)
    return s, float(np.max(np.abs(q - curve.joints(s))) / size)


def _length(q: Array) -> Array:
    """Return the length (k,) of the way along rows q (k, n), from the first row."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])


def _at(grid: Array, s: Array, dt: float) -> tuple[Array, Array]:
    """Return ds/dt and d2s/dt2 at the grid points, from samples s (k,) of a motion from rest to rest."""
    whole = np.concatenate([s[1:2], s, s[-2:-1]])  # continued by its mirror image in time
    slope = (whole[2:] - whole[:-2]) / (2 * dt)
    bend = (whole[2:] - 2 * whole[1:-1] + whole[:-2]) / dt**2
    return np.sqrt(np.interp(grid, s, slope**2)), np.interp(grid, s, bend)


def _fact(span: PhaseSpan, timed: _Timed, name: str) -> str:
    slower = (
        f", slowed down by {100 * (timed.slower - 1):.2g} % between grid points" if timed.slower > 1 + DURATION else ""
    )
    averaged = f", averaged over {span.smoothing:.3g} s" if span.smoothing else ""
    return (
        f"{span.solver} {span.optimal:.6f} s, {name} {timed.shortest:.6f} s{slower}{averaged}; planned: "
        f"{span.t1 - span.t0:.3f} s, at most {100 * timed.speed:.1f} % of a speed limit and "
        f"{100 * timed.acceleration:.1f} % of an acceleration limit"
    )


def _findings(span: PhaseSpan, timed: _Timed, name: str) -> Iterator[Finding]:
    when = f"phase '{span.name}'"
    if timed.off > OFF:
        what = f"samples of phase '{span.name}' leave its path, as a fraction of its length"
        yield disagreement("timing.path", span.name, what, Quantity(timed.off), OFF, _AGAIN, when=when)
    if abs(timed.duration) > DURATION:
        lasts = span.t1 - span.t0 - span.smoothing
        needed = timed.shortest * timed.slower
        word = "short" if timed.duration < 0 else "long"
        what = (
            f"phase '{span.name}' is too {word}: it lasts {lasts:.6g} s, and its optimum is stated as "
            f"{span.optimal:.7g} s; by {name}, the optimum is {timed.shortest:.7g} s, and the phase needs {needed:.7g} "
            "s; relative deviation"
        )
        yield disagreement(
            "timing.duration", span.name, what, Quantity(abs(timed.duration)), DURATION, _AGAIN, when=when
        )
    for rate, load in (("speed", timed.speed), ("acceleration", timed.acceleration)):
        if load > 1 + OVER:
            what = f"phase '{span.name}' exceeds a limit of {rate} at the grid points of {name}, relative to the limit"
            yield disagreement(f"timing.grid_{rate}", span.name, what, Quantity(load), 1 + OVER, _AGAIN, when=when)


def _rows(
    judged: list[tuple[PhaseSpan, _Timed]],
    failed: list[str],
    others: Mapping[Solver, tuple[Solver, Fastest]],
) -> list[Residual]:
    """Return three rows over all phases: durations, and the excess of speed and acceleration over their limits."""
    note = "; ".join(f"unchecked: {name}" for name in failed)
    if not judged:
        blank = Residual("P-T", "duration", "phases", "", nan, nan, None, 0.0, "", note=note or "given by samples")
        return [blank]
    by = dict.fromkeys(others[span.solver][0] for span, _ in judged if span.solver is not None)
    ends = np.array([span.t1 for span, _ in judged])
    clock = Clock(ends, tuple(PhaseSummary(span.name, span.type, span.t0, span.t1) for span, _ in judged))
    unchecked = f"; {note}" if note else ""
    off = np.array([t.duration for _, t in judged])
    said = f"relative deviation from the shortest duration by {' and '.join(by)}, slowed down and rounded up{unchecked}"
    rows = [row("P-T", "duration", "phases", "", off, DURATION, clock, note=said)]
    for rate, loads in (("speed", [t.speed for _, t in judged]), ("acceleration", [t.acceleration for _, t in judged])):
        over = np.maximum(np.array(loads) - 1, 0.0)
        said = f"relative excess at the grid points; at most {100 * max(loads):.1f} % of a limit{unchecked}"
        rows.append(row("P-T", "limit", rate, "", over, OVER, clock, note=said))
    return rows
