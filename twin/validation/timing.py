"""Check the timing from sampled times, joint values and tool poses alone, not from the stated speeds.

A first difference of samples is a mean speed, a second difference is a mean acceleration. If the motion respects a
limit, each mean value also respects this limit, for any time step. Therefore, a mean value above the limit proves a
violation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding, disagreement
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.model.mechanism import Mechanism
from twin.planning.check import AGAIN
from twin.planning.protocol import Protocol
from twin.planning.trajectory import PhaseSpan, Trajectory

OVER = 2e-3
"""Accepted relative excess of a mean value over its limit: 1e-3 for the planner's tolerance and 1e-3 for rounding."""

_CLOCK = 1e-9
"""Tolerance in s of sample times."""

_ROUNDING = 8 * np.finfo(float).eps
"""Relative rounding error of a sample; in a difference quotient, the error is divided by the time step."""


@dataclass(frozen=True)
class Load:
    """Maximum of one quantity (speed, acceleration, ...), and the limit of this quantity.

    Attributes:
        code: code of the finding if the limit is exceeded.
        what: name of the quantity, for messages.
        where: the joint, frame or place with the maximum.
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
    """Compare speeds and accelerations with their limits; return (maximum of each quantity as text, findings).

    The stated speeds (`qd`, tip) of the trajectory are also checked. Joint limits come from the mechanism, limits of
    the tip from the protocol.
    """
    findings = [*_clock(trajectory)]
    if findings:  # without valid times no rates can be computed
        return {}, findings
    joints = _joints(trajectory, mechanism)
    frames = [_frames(trajectory, protocol, span) for span in trajectory.phases]
    moving = [*joints, *(m for pair in frames for m in pair)]
    loads = [load for m in moving for load in _loads(trajectory, m)]
    findings += [_excess(load) for load in loads if load.size > load.limit * (1 + OVER)]
    for span, pair in zip(trajectory.phases, frames, strict=True):
        findings += _rest(trajectory, span, [*pair, *joints])
    findings += [f for m in moving for f in _claims(trajectory, m)]
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
        yield disagreement("timing.clock", "t", "the sample times must be finite and increase strictly")
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
            "the phases must cover all samples without gaps, and begin and end at the stated times",
        )


@dataclass(frozen=True)
class _Moving:
    """Sampled motion of one joint, or of the moved frame in one phase (either its position or its rotation).

    Attributes:
        what: name of the moving quantity, for messages on its stated speed.
        subject: name of the moving joint or frame, for other messages.
        where: place of the findings.
        codes, names: finding codes and names of the speed, acceleration and jerk of this motion.
        unit, factor: display unit of a displacement, and size of this unit in m or rad.
        first: index of the first sample.
        steps: (k, d) displacements from sample to sample, in SI.
        stated: (k + 1, d) stated speeds at the samples, in SI.
        limits: limits of speed, acceleration and jerk, in SI; infinite without a limit.
        size: largest absolute value of a sample, which determines the rounding error; 0 for exact samples.
    """

    what: str
    subject: str
    where: str
    codes: Sequence[str]
    names: Sequence[str]
    unit: str
    factor: float
    first: int
    steps: Array
    stated: Array
    limits: tuple[float, ...]
    size: float = 0.0


_RATES = ("speed", "acceleration", "jerk")


def _joints(trajectory: Trajectory, mechanism: Mechanism) -> list[_Moving]:
    out = []
    for j, joint in enumerate(mechanism.active):
        q, qd = trajectory.q[:, j : j + 1], trajectory.qd[:, j : j + 1]
        unit, factor = display_unit(joint.is_angle)
        limits = tuple(np.inf if x is None else x for x in (joint.max_speed, joint.max_acceleration, joint.max_jerk))
        what, steps = f"joint {joint.name}", np.diff(q, axis=0)
        names = [what] * 3
        size = float(np.abs(q).max())
        out.append(_Moving(what, what, joint.name, _RATES, names, unit, factor, 0, steps, qd, limits, size))
    return out


def _frames(trajectory: Trajectory, protocol: Protocol, span: PhaseSpan) -> list[_Moving]:
    """Return position and rotation of the moved frame in one phase."""
    name, limits = trajectory.frame, protocol.limits[span.type]
    rows = slice(span.start, span.stop + 1)
    p, R = trajectory.Ts_base_frame[rows, :3, 3], trajectory.Ts_base_frame[rows, :3, :3]
    turns = spatial.log_so3(R[1:] @ np.swapaxes(R[:-1], 1, 2))
    out = []
    for kind, subject, unit, factor, steps, stated in (
        ("tip", name, "mm", MM, np.diff(p, axis=0), trajectory.tip_velocity[rows]),
        ("rotation", f"{name} (rotation)", "deg", DEG, turns, trajectory.angular_velocity[rows]),
    ):
        codes = [f"{kind}_{rate}" for rate in _RATES]
        names = [f"{kind} {rate} of {name} in phase '{span.name}'" for rate in _RATES]
        most = tuple(getattr(limits, code) for code in codes)
        out.append(
            _Moving(f"{kind} of {name}", subject, name, codes, names, unit, factor, span.start, steps, stated, most)
        )
    return out


def _phase(trajectory: Trajectory, sample: int) -> str:
    return next(s.name for s in trajectory.phases if sample <= s.stop)


def _loads(trajectory: Trajectory, m: _Moving) -> Iterator[Load]:
    """Yield the largest speed, acceleration and jerk; the jerk only of joints, and of frames with a jerk limit."""
    dt = trajectory.step
    for order, (code, name, limit) in enumerate(zip(m.codes, m.names, m.limits, strict=True), 1):
        if len(m.steps) < order or (code.endswith("_jerk") and not np.isfinite(limit)):
            return
        rates = np.linalg.norm(np.diff(m.steps, n=order - 1, axis=0), axis=1) / dt**order
        k = int(np.argmax(rates))
        noise = _ROUNDING * 2**order * m.size / dt**order
        unit = f"{m.unit}/s" if order == 1 else f"{m.unit}/s{order}"
        size = max(0.0, float(rates[k]) - noise) / m.factor
        t, phase = float(trajectory.t[m.first + k] + order * dt / 2), _phase(trajectory, m.first + k + order)
        yield Load(f"timing.{code}", name, m.where, unit, size, limit / m.factor, t, phase)


def _rest(trajectory: Trajectory, span: PhaseSpan, moving: list[_Moving]) -> Iterator[Finding]:
    """Yield a finding if a phase cannot begin or end at rest: a step is larger than the acceleration limit allows."""
    dt = trajectory.step
    for sample, step, verb in ((span.start, span.start, "begin"), (span.stop, span.stop - 1, "end")):
        for m in moving:
            way = float(np.linalg.norm(m.steps[step - m.first]))
            reach = 0.5 * m.limits[1] * dt**2 * (1 + OVER) + 1e-12
            if way > reach:
                yield disagreement(
                    "timing.rest",
                    m.where,
                    f"phase '{span.name}' does not {verb} at rest: {m.subject} moves too far in one step of {dt:g} s",
                    Quantity(way / m.factor, m.unit),
                    reach / m.factor,
                    AGAIN,
                    when=f"phase '{span.name}', t = {trajectory.t[sample]:.3f} s",
                )
                break


def _claims(trajectory: Trajectory, m: _Moving) -> Iterator[Finding]:
    """Compare the stated speeds with the difference quotients of the positions.

    The average of the stated speeds at both ends of a step equals the mean speed in the step if the acceleration is
    constant. With an acceleration limit a, the difference is at most a dt/4. The first step of a phase is skipped if
    the first sample of the step belongs to the previous phase.
    """
    dt, skip = trajectory.step, 1 if m.first else 0
    off = np.linalg.norm(m.steps / dt - 0.5 * (m.stated[1:] + m.stated[:-1]), axis=1)[skip:]
    limit = dt * m.limits[1] * (1 + OVER) / 4
    if not len(off) or off.max() <= limit:
        return
    sample = m.first + skip + int(np.argmax(off))
    yield disagreement(
        "timing.claimed",
        m.where,
        f"the stated speed of {m.what} differs from the difference quotient of the positions",
        Quantity(float(off.max()) / m.factor, f"{m.unit}/s"),
        limit / m.factor,
        AGAIN,
        when=f"phase '{_phase(trajectory, sample)}', t = {trajectory.t[sample]:.3f} s",
        word="tolerance",
    )


def _facts(loads: list[Load], trajectory: Trajectory) -> dict[str, str]:
    """Return a text with the maximum for each kind of quantity, such as speed or jerk."""
    out = {"computed from": f"{len(trajectory.t)} samples, {1e3 * trajectory.step:g} ms apart, without stated speeds"}
    for code in dict.fromkeys(x.code for x in loads):
        alike = [x for x in loads if x.code == code]
        most = max(alike, key=lambda x: x.size / x.limit if np.isfinite(x.limit) else 0.0)
        if not np.isfinite(most.limit):  # without a limit: the maximum per unit
            for unit in dict.fromkeys(x.unit for x in alike):
                most = max((x for x in alike if x.unit == unit), key=lambda x: x.size)
                note = " (no limit is given; the jerk is not continuous)" if "jerk" in code else ""
                out[f"{code.removeprefix('timing.')}, maximum in {unit}"] = f"{most.what}: {most.text}{note}"
            continue
        out[code.removeprefix("timing.").replace("_", " ")] = f"{most.what}: {most.text}"
    return out
