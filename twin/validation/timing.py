"""Check the timing from sampled times, joint values and tool poses alone, not from the stated speeds.

A first difference of samples is a mean speed, a second difference is a mean acceleration. If the motion respects a
limit, each mean value also respects the limit, for any time step. Every reported violation is therefore real.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, disagreement
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.planning.check import AGAIN
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory

OVER = 2e-3
"""Accepted relative excess of a mean value: one half for the planner's tolerance, one half for rounding."""

_CLOCK = 1e-9
"""Tolerance in s of sample times."""

_ROUNDING = 8 * np.finfo(float).eps
"""Relative rounding error of a sample; a difference quotient divides it by the time step."""


@dataclass(frozen=True)
class Load:
    """Maximum of one quantity (speed, acceleration, ...) and its limit.

    Attributes:
        code: code of the finding if the limit is exceeded.
        what, where: the quantity, and the joint or place, for messages.
        unit: unit of `size` and `limit`.
        size, limit: maximum of the quantity, and its limit; infinity means that there is no limit.
        t, phase: time in s and phase of the maximum.
    """

    code: str
    what: str
    where: str
    unit: str
    size: float
    limit: float
    t: float
    phase: str

    @property
    def text(self) -> str:
        """Maximum, limit and time, as text."""
        of = f" of {self.limit:.4g} ({100 * self.size / self.limit:.0f} %)" if np.isfinite(self.limit) else ""
        return f"{self.size:.4g}{of} {self.unit}, {self.phase}, t = {self.t:.3f} s"


def timing(trajectory: Trajectory, mechanism: Mechanism, protocol: Protocol) -> tuple[dict[str, str], list[Finding]]:
    """Check speeds and accelerations against their limits: (maximum of each quantity as text, findings).

    The stated speeds (`qd`, tip) of the trajectory are also checked. Joint limits come from the mechanism, limits of
    the tip from the protocol.
    """
    findings = [*_clock(trajectory)]
    if findings:  # without valid times no rates can be computed
        return {}, findings
    loads = [*_joints(trajectory, mechanism), *_tip(trajectory, protocol)]
    findings += [_excess(load) for load in loads if load.size > load.limit * (1 + OVER)]
    findings += [*_rest(trajectory, mechanism, protocol), *_claims(trajectory, mechanism, protocol)]
    return _facts(loads, trajectory), findings


def _excess(load: Load) -> Finding:
    return disagreement(
        load.code,
        load.where,
        f"{load.what}, computed from differences of the samples, exceeds its limit",
        Quantity(load.size, load.unit),
        load.limit,
        AGAIN,
        when=f"phase '{load.phase}', t = {load.t:.3f} s",
    )


def _clock(trajectory: Trajectory) -> Iterator[Finding]:
    t, spans = trajectory.t, trajectory.phases
    step = np.diff(t)
    if len(t) < 2 or not np.isfinite(t).all() or step.min() <= 0:
        yield disagreement("timing.clock", "t", "the times of the samples do not increase")
        return
    off = float(np.abs(t - np.linspace(t[0], t[-1], len(t))).max())
    if off > _CLOCK:
        k = int(np.argmax(np.abs(step - np.median(step))))
        yield disagreement(
            "timing.clock",
            "t",
            f"the samples are not evenly spaced: one step is {step[k]:.6g} s, "
            f"the median is {np.median(step):.6g} s; deviation",
            Quantity(off, "s"),
            _CLOCK,
            when=f"t = {t[k]:.3f} s",
        )
    bounds = [(s.start, s.stop, s.t0, s.t1) for s in spans]
    joined = all(a.stop == b.start for a, b in pairwise(spans))
    whole = bool(spans) and spans[0].start == 0 and spans[-1].stop == len(t) - 1
    timed = all(abs(t[a] - t0) <= 1e-6 and abs(t[b] - t1) <= 1e-6 for a, b, t0, t1 in bounds if max(a, b) < len(t))
    if not (joined and whole and timed):
        yield disagreement(
            "timing.phases",
            ", ".join(s.name for s in spans),
            "the phases do not cover the samples in order at the stated times",
        )


def _phase(trajectory: Trajectory, sample: int) -> str:
    return next(s.name for s in trajectory.phases if sample <= s.stop)


def _joints(trajectory: Trajectory, mechanism: Mechanism) -> Iterator[Load]:
    q, dt = trajectory.q, trajectory.step
    for order, name in ((1, "speed"), (2, "acceleration"), (3, "jerk")):
        if len(q) <= order:
            return
        rates = np.diff(q, n=order, axis=0) / dt**order
        noise = _ROUNDING * 2**order * np.abs(q).max(axis=0) / dt**order
        for j, joint in enumerate(mechanism.active):
            limit = {1: joint.max_speed, 2: joint.max_acceleration}.get(order)
            unit, factor = ("deg", DEG) if joint.is_angle else ("mm", MM)
            per = "/s" if order == 1 else f"/s{order}"
            k = int(np.argmax(np.abs(rates[:, j])))
            size = max(0.0, float(abs(rates[k, j])) - float(noise[j]))
            shown = np.inf if limit is None else limit / factor
            t = float(trajectory.t[k] + order * dt / 2)
            where = _phase(trajectory, min(k + order, len(q) - 1))
            yield Load(f"timing.{name}", f"joint {joint.name}", joint.name, unit + per, size / factor, shown, t, where)


def _tip(trajectory: Trajectory, protocol: Protocol) -> Iterator[Load]:
    dt = trajectory.step
    for span in trajectory.phases:
        limits = protocol.limits[span.type]
        v, w = _tip_speeds(trajectory, slice(span.start, span.stop + 1))
        a, dw = np.diff(v, axis=0) / dt, np.diff(w, axis=0) / dt
        j, ddw = np.diff(a, axis=0) / dt, np.diff(dw, axis=0) / dt
        for code, values, limit, unit, factor in (
            ("timing.tip_speed", v, limits.tip_speed, "mm/s", MM),
            ("timing.tip_acceleration", a, limits.tip_acceleration, "mm/s2", MM),
            ("timing.tip_jerk", j, limits.tip_jerk, "mm/s3", MM),
            ("timing.rotation_speed", w, limits.rotation_speed, "deg/s", DEG),
            ("timing.rotation_acceleration", dw, limits.rotation_acceleration, "deg/s2", DEG),
            ("timing.rotation_jerk", ddw, limits.rotation_jerk, "deg/s3", DEG),
        ):
            if not len(values) or ("jerk" in code and not np.isfinite(limit)):
                continue
            norms = np.linalg.norm(values, axis=1)
            k = int(np.argmax(norms))
            what = f"{code.removeprefix('timing.').replace('_', ' ')} of {trajectory.frame}"
            t = float(trajectory.t[span.start + k] + dt / 2)
            size, name = float(norms[k]) / factor, trajectory.frame
            yield Load(code, f"{what} in phase '{span.name}'", name, unit, size, limit / factor, t, span.name)


def _tip_speeds(trajectory: Trajectory, rows: slice) -> tuple[Array, Array]:
    """Return mean (velocities, angular velocities), each (k - 1, 3), of the moved frame between its k poses."""
    Ts, dt = trajectory.Ts_base_frame[rows], trajectory.step
    R = Ts[:, :3, :3]
    return np.diff(Ts[:, :3, 3], axis=0) / dt, spatial.log_so3(R[1:] @ np.swapaxes(R[:-1], 1, 2)) / dt


def _rest(trajectory: Trajectory, mechanism: Mechanism, protocol: Protocol) -> Iterator[Finding]:
    """Check that each phase begins and ends at rest: the first and last step are short enough for the acceleration."""
    dt = trajectory.step
    for span in trajectory.phases:
        limits = protocol.limits[span.type]
        for here, there, verb in ((span.start, span.start + 1, "begin"), (span.stop, span.stop - 1, "end")):
            T0, T1 = trajectory.Ts_base_frame[[here, there]]
            turn = float(spatial.rotation_angle(T0[:3, :3].T @ T1[:3, :3]))
            name = trajectory.frame
            ways = [
                (name, name, float(np.linalg.norm(T1[:3, 3] - T0[:3, 3])), limits.tip_acceleration, ("mm", MM)),
                (f"{name} (rotation)", name, turn, limits.rotation_acceleration, ("deg", DEG)),
            ]
            for j, joint in enumerate(mechanism.active):
                if joint.max_acceleration is not None:
                    way = abs(float(trajectory.q[there, j] - trajectory.q[here, j]))
                    unit = ("deg", DEG) if joint.is_angle else ("mm", MM)
                    ways.append((f"joint {joint.name}", joint.name, way, joint.max_acceleration, unit))
            for what, where, way, acceleration, (unit, factor) in ways:
                reach = 0.5 * acceleration * dt**2 * (1 + OVER) + 1e-12
                if way > reach:
                    yield disagreement(
                        "timing.rest",
                        where,
                        f"phase '{span.name}' does not {verb} at rest: {what} moves too far in one step of {dt:g} s",
                        Quantity(way / factor, unit),
                        reach / factor,
                        AGAIN,
                        when=f"phase '{span.name}', t = {trajectory.t[here]:.3f} s",
                    )
                    break


def _claims(trajectory: Trajectory, mechanism: Mechanism, protocol: Protocol) -> Iterator[Finding]:
    """Compare the stated speeds of a trajectory with the difference quotients of its positions.

    The average of the stated speeds at both ends of a step equals the mean speed in the step if the acceleration is
    constant. With an acceleration limit a, the difference is at most a dt/4.
    """
    dt = trajectory.step
    for j, joint in enumerate(mechanism.active):
        if joint.max_acceleration is None:
            continue
        mean = np.diff(trajectory.q[:, j]) / dt
        stated = 0.5 * (trajectory.qd[1:, j] + trajectory.qd[:-1, j])
        off, limit = np.abs(mean - stated), dt * joint.max_acceleration * (1 + OVER) / 4
        k = int(np.argmax(off))
        if off[k] > limit:
            unit, factor = ("deg/s", DEG) if joint.is_angle else ("mm/s", MM)
            yield _claim(trajectory, f"joint {joint.name}", joint.name, k, off[k] / factor, limit / factor, unit)
    for span in trajectory.phases:
        limits = protocol.limits[span.type]
        rows = slice(
            span.start + (1 if span.start else 0), span.stop + 1
        )  # a sample shared by two phases counts for the earlier phase
        v, w = _tip_speeds(trajectory, rows)
        for name, mean, given, most, unit, factor in (
            ("tip", v, trajectory.tip_velocity, limits.tip_acceleration, "mm/s", MM),
            ("rotation", w, trajectory.angular_velocity, limits.rotation_acceleration, "deg/s", DEG),
        ):
            if not len(mean):
                continue
            stated = 0.5 * (given[rows][1:] + given[rows][:-1])
            off, limit = np.linalg.norm(mean - stated, axis=1), dt * most * (1 + OVER) / 4
            k = int(np.argmax(off))
            if off[k] > limit:
                where = rows.start + k
                yield _claim(trajectory, f"{name} of {trajectory.frame}", trajectory.frame, where, off[k] / factor,
                             limit / factor, unit)  # fmt: skip


def _claim(trajectory: Trajectory, what: str, where: str, sample: int, size: float, limit: float, unit: str) -> Finding:
    return disagreement(
        "timing.claimed",
        where,
        f"the stated speed of {what} differs from the difference quotient of the positions",
        Quantity(size, unit),
        limit,
        AGAIN,
        when=f"phase '{_phase(trajectory, sample)}', t = {trajectory.t[sample]:.3f} s",
        word="tolerance",
    )


def _facts(loads: list[Load], trajectory: Trajectory) -> dict[str, str]:
    """Return the maximum of each kind of quantity, as text."""
    out = {"computed from": f"{len(trajectory.t)} samples, {1e3 * trajectory.step:g} ms apart, without stated speeds"}
    for code in dict.fromkeys(x.code for x in loads):
        alike = [x for x in loads if x.code == code]
        most = max(alike, key=lambda x: x.size / x.limit if np.isfinite(x.limit) else 0.0)
        if not np.isfinite(most.limit):  # without a limit: the maximum per unit
            for unit in dict.fromkeys(x.unit for x in alike):
                most = max((x for x in alike if x.unit == unit), key=lambda x: x.size)
                note = " (no limit is given; the jerk is not continuous)" if "jerk" in code else ""
                out[f"{code.removeprefix('timing.')}, most in {unit}"] = f"{most.what}: {most.text}{note}"
            continue
        out[code.removeprefix("timing.").replace("_", " ")] = f"{most.what}: {most.text}"
    return out
