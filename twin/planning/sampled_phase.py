"""A phase whose joint values are given by samples over time; all rates are differences of samples.

Between the given samples, joint values are interpolated by cubic splines. A spline overshoots where the samples change
suddenly, so that a joint would leave the range of its samples; the slopes of such a joint are limited. Rates are
central differences, so that the check of the trajectory tests what the samples contain. A phase begins and ends at
rest: before the first and after the last sample, the motion is continued by its mirror image in time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, ProtocolError
from twin.core.spatial import Array
from twin.core.units import display_unit
from twin.planning.path_kinematics import MovableMechanism
from twin.planning.phase_path import PhasePath
from twin.planning.protocol import Protocol, Samples
from twin.planning.protocol.course import Motion, angles_of
from twin.planning.timing import Timing

_CARRYING_STEP = 0.02
"""Time step in s with which the mechanism is moved from the start to the end of the phase."""

_OVERSHOOT = 0.01
"""Largest overshoot of a joint's spline beyond two successive samples, as a fraction of the joint's largest step."""

_STEP_ROUNDING = 1e-6
"""Part of a time step by which a duration may be longer than a whole number of them: rounding in the file."""

_OVERSHOOT_POINTS = 19
"""Number of points between two samples at which the overshoot is measured."""


@dataclass(frozen=True)
class SampledPhase(PhasePath):
    """A phase with given joint values over time.

    Attributes:
        duration: duration in s.
        values: function of times (k,) in s that returns the values (k, n) of all driven joints.
        carry: function that moves the mechanism from the start of the phase along joint values (k, n) and returns
            T_base_tool (k, 4, 4).
    """

    duration: float
    values: Callable[[Array], Array]
    carry: Callable[[Array], Array]

    def sampled(self, dt: float) -> tuple[Timing, Motion, Array, Array, Array]:
        """Return timing, motion, and q, qd, qdd (k, n) at multiples of dt; the path parameter is the time.

        The last sample is at the first multiple of dt that is not before the end of the given samples.
        """
        count = max(int(np.ceil(self.duration / dt - _STEP_ROUNDING)), 1)
        t = dt * np.arange(count + 1, dtype=np.float64)
        # The last multiple of dt may lie after the given samples: there, the last values hold.
        q = self.values(np.minimum(t, self.duration))
        Ts = self.carry(q)
        Ts_frame = Ts @ self.T_tool_frame
        position = Ts_frame[:, :3, 3]
        R = Ts[:, :3, :3]
        turns = spatial.log_so3(R[1:] @ np.swapaxes(R[:-1], 1, 2))
        p1, p2 = _rates(np.diff(position, axis=0), dt)
        w1, w2 = _rates(turns, dt)
        v, _ = _rates(np.diff(Ts[:, :3, 3], axis=0), dt)
        qd, qdd = _rates(np.diff(q, axis=0), dt)
        motion = Motion(Ts, position, p1, p2, w1, w2, np.concatenate([v, w1], axis=1))
        timing = Timing(
            t=t,
            s=t,
            sd=np.ones(len(t)),
            sdd=np.zeros(len(t)),
            duration=float(t[-1]),
            optimal=self.duration,
            overshoot=0.0,
            knots=0,
            solver=None,
        )
        return timing, motion, q, qd, qdd


def sampled_phase(
    path: PhasePath,
    phase: Samples,
    protocol: Protocol,
    q: Array,
    names: tuple[str, ...],
    mechanism: MovableMechanism,
    state: Array,
    where: str,
) -> tuple[SampledPhase, Array, Array]:
    """Return (the phase, driven joint values (n,) at the end of the phase, state (nq,) at the end of the phase).

    Args:
        path: the phase.
        phase: the samples; joints without samples keep their values.
        protocol: source of the tolerances at the start.
        q: (n,) driven joint values in m or rad at the start of the phase.
        names: (n,) names of the driven joints.
        mechanism: what moves.
        state: (nq,) state of the mechanism at the start of the phase.
        where: names of protocol and phase, for messages.

    Raises:
        ProtocolError: the first sample is not at the start of the phase, or the loops open.
    """
    columns = list(map(names.index, phase.joints))
    for joint, column, first in zip(phase.joints, columns, phase.q[0], strict=True):
        is_angle = joint in phase.angle_joints
        unit, factor = display_unit(is_angle)
        tolerance = protocol.tolerances.waypoint
        if is_angle:
            tolerance = protocol.tolerances.waypoint_angle
        difference = abs(first - q[column])
        if difference > tolerance:
            raise ProtocolError(
                f"{where}: the samples begin with {joint} = {first / factor:.6g} {unit}, but the phase begins at "
                f"{q[column] / factor:.6g} {unit}, a difference of {difference / factor:.3g} {unit} (tolerance "
                f"{tolerance / factor:g} {unit}): change the samples, or where the phase begins"
            )
    curve = curve_through(phase.t, phase.q)

    def values(t: Array) -> Array:
        rows = np.repeat(q[None], len(t), axis=0)
        rows[:, columns] = curve(t)
        return rows

    def carry(rows: Array) -> tuple[Array, Array]:
        try:
            return mechanism.carry(rows, state)
        except AssemblyError as error:
            raise ProtocolError(f"{where} cannot be carried out: {error}") from error

    duration = float(phase.t[-1])
    steps = max(int(duration / _CARRYING_STEP), 1)
    rows = values(np.linspace(0.0, duration, steps + 1))
    states, Ts = carry(rows)
    sampled = SampledPhase(**vars(path), duration=duration, values=values, carry=lambda rows: carry(rows)[1])
    angles1 = angles_of(Ts[-1, :3, :3], path.order, path.angles1)
    T_base_frame = Ts[-1] @ path.T_tool_frame
    sampled = replace(sampled, angles1=angles1, tip1=T_base_frame[:3, 3])
    return sampled, rows[-1], states[-1]


def curve_through(t: Array, q: Array) -> Callable[[Array], Array]:
    """Return a curve, with slope zero at both ends, through samples q (k, n) at times t (k,) in s.

    The curve is a function of times (j,) that returns (j, n): per joint, a cubic spline if it exceeds no two successive
    samples by more than `_OVERSHOOT`; else a cubic Hermite spline with slopes limited as by Hyman (SIAM J. Sci. Stat.
    Comput. 4, 1983), which stays between successive samples.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    spline = CubicSpline(t, q, bc_type="clamped")
    low = np.minimum(q[:-1], q[1:])
    high = np.maximum(q[:-1], q[1:])
    excess = np.zeros(q.shape[1])
    for part in np.linspace(0.0, 1.0, _OVERSHOOT_POINTS + 2)[1:-1]:
        value = spline(t[:-1] + part * np.diff(t))
        beyond = np.maximum(low - value, value - high)
        excess = np.maximum(excess, beyond.max(axis=0))
    steps = np.diff(q, axis=0)
    overshoots = excess > _OVERSHOOT * np.abs(steps).max(axis=0)
    if not overshoots.any():
        return spline
    slopes = spline(t, 1)
    secants = steps / np.diff(t)[:, None]
    before = secants[:-1]
    after = secants[1:]
    # Hyman's condition: a cubic stays monotonic if no slope exceeds three times the smaller of the secants beside it.
    largest_slope = 3 * np.minimum(np.abs(before), np.abs(after))
    inner = np.clip(slopes[1:-1], -largest_slope, largest_slope)
    is_monotonic = (before * after > 0) & (inner * after > 0)
    limited = np.zeros_like(slopes)
    limited[1:-1] = np.where(is_monotonic, inner, 0.0)
    return CubicHermiteSpline(t, q, np.where(overshoots, limited, slopes))


def _rates(steps: Array, dt: float) -> tuple[Array, Array]:
    """Return the first and second time derivative, each (k + 1, n), from the steps (k, n) between samples.

    The motion is at rest at both ends: it is continued by its mirror image before the first and after the last step.
    """
    before = np.concatenate([-steps[:1], steps])
    after = np.concatenate([steps, -steps[-1:]])
    first = (before + after) / (2 * dt)
    second = (after - before) / dt**2
    return first, second
