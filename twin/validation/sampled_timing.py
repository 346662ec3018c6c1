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
from twin.planning.check import REPLAN_ADVICE
from twin.planning.protocol import Protocol
from twin.planning.trajectory import PhaseSpan, Trajectory

ACCEPTED_EXCESS = 2e-3
"""Accepted relative excess of a mean value over its limit: 1e-3 for the planner's tolerance and 1e-3 for rounding."""

_CLOCK_TOLERANCE = 1e-9
"""Tolerance in s of sample times."""

_PHASE_TOLERANCE = 1e-6
"""Tolerance in s of the stated times of phases, which files may round."""

_REST_STEP = 1e-12
"""Step in m or rad that counts as rest, also with a very small acceleration limit."""

_RELATIVE_ROUNDING = 8 * np.finfo(float).eps
"""Relative rounding error of a sample; in a difference quotient, the error is divided by the time step."""


@dataclass(frozen=True)
class LargestRate:
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
        of_limit = ""
        if np.isfinite(self.limit):
            of_limit = f" of {self.limit:.4g} ({100 * self.size / self.limit:.0f} %)"
        return f"{self.size:.4g}{of_limit} {self.unit}, {self.phase}, t = {self.t:.3f} s"


def check_rates(
    trajectory: Trajectory, mechanism: Mechanism, protocol: Protocol
) -> tuple[dict[str, str], list[Finding]]:
    """Compare speeds and accelerations with their limits; return (maximum of each quantity as text, findings).

    The stated speeds (`qd`, tip) of the trajectory are also checked. Joint limits come from the mechanism, limits of
    the tip from the protocol.
    """
    findings = list(_check_clock(trajectory))
    if findings:  # without valid times no rates can be computed
        return {}, findings
    joints = _joint_motions(trajectory, mechanism)
    frames: list[_SampledMotion] = []
    not_at_rest: list[Finding] = []
    for span in trajectory.phases:
        frame = _frame_motions(trajectory, protocol, span)
        frames += frame
        not_at_rest += _not_at_rest(trajectory, span, [*frame, *joints])
    loads: list[LargestRate] = []
    claims: list[Finding] = []
    for moving in [*joints, *frames]:
        loads += _largest_rates(trajectory, moving)
        claims += _false_claims(trajectory, moving)
    for load in loads:
        if load.size > load.limit * (1 + ACCEPTED_EXCESS):
            findings.append(_limit_exceeded(load))
    findings += not_at_rest
    findings += claims
    return _rate_texts(loads, trajectory), findings


def _limit_exceeded(load: LargestRate) -> Finding:
    """Return the finding on a maximum above its limit."""
    return disagreement(
        load.code,
        load.where,
        f"{load.what}, computed from differences of the samples, exceeds its limit",
        size=Quantity(load.size, load.unit),
        limit=load.limit,
        suggestion=REPLAN_ADVICE,
        when=f"phase '{load.phase}', t = {load.t:.3f} s",
    )


def _check_clock(trajectory: Trajectory) -> Iterator[Finding]:
    """Yield findings on the times of samples and phases, without which rates cannot be computed."""
    t = trajectory.t
    steps = np.diff(t)
    if len(t) < 2 or not np.isfinite(t).all() or steps.min() <= 0:
        yield disagreement("timing.clock", "t", "the sample times must be finite and increase strictly")
        return
    even = np.linspace(t[0], t[-1], len(t))
    deviation = float(np.abs(t - even).max())
    if deviation > _CLOCK_TOLERANCE:
        median = np.median(steps)
        worst = int(np.argmax(np.abs(steps - median)))
        step = steps[worst]
        what = f"the samples are not evenly spaced: one step is {step:.6g} s, the median is {median:.6g} s; deviation"
        yield disagreement(
            "timing.clock",
            "t",
            what,
            size=Quantity(deviation, "s"),
            limit=_CLOCK_TOLERANCE,
            when=f"t = {t[worst]:.3f} s",
        )
    if not _phases_cover(trajectory):
        names = ", ".join(span.name for span in trajectory.phases)
        what = "the phases must cover all samples without gaps, and begin and end at the stated times"
        yield disagreement("timing.phases", names, what)


def _phases_cover(trajectory: Trajectory) -> bool:
    """Return whether the phases cover all samples without gaps, and begin and end at their stated times."""
    t = trajectory.t
    last = len(t) - 1
    spans = trajectory.phases
    if not spans or spans[0].start != 0 or spans[-1].stop != last:
        return False
    for before, after in pairwise(spans):
        if before.stop != after.start:
            return False
    for span in spans:
        if max(span.start, span.stop) > last:
            continue  # no such samples: there are no times to compare
        starts_on_time = abs(t[span.start] - span.t0) <= _PHASE_TOLERANCE
        stops_on_time = abs(t[span.stop] - span.t1) <= _PHASE_TOLERANCE
        if not (starts_on_time and stops_on_time):
            return False
    return True


@dataclass(frozen=True)
class _SampledMotion:
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


_RATE_NAMES = ("speed", "acceleration", "jerk")


def _joint_motions(trajectory: Trajectory, mechanism: Mechanism) -> list[_SampledMotion]:
    """Return the sampled motion of each driven joint over the whole trajectory."""
    moving: list[_SampledMotion] = []
    for j, joint in enumerate(mechanism.active):
        q = trajectory.q[:, j : j + 1]
        qd = trajectory.qd[:, j : j + 1]
        steps = np.diff(q, axis=0)
        size = float(np.abs(q).max())
        limits: list[float] = []
        for limit in (joint.max_speed, joint.max_acceleration, joint.max_jerk):
            limits.append(np.inf if limit is None else limit)
        unit, factor = display_unit(joint.is_angle)
        what = f"joint {joint.name}"
        names = [what] * len(_RATE_NAMES)
        motion = _SampledMotion(
            what,
            what,
            where=joint.name,
            codes=_RATE_NAMES,
            names=names,
            unit=unit,
            factor=factor,
            first=0,
            steps=steps,
            stated=qd,
            limits=tuple(limits),
            size=size,
        )
        moving.append(motion)
    return moving


def _frame_motions(trajectory: Trajectory, protocol: Protocol, span: PhaseSpan) -> list[_SampledMotion]:
    """Return position and rotation of the moved frame in one phase."""
    rows = slice(span.start, span.stop + 1)
    p = trajectory.Ts_base_frame[rows, :3, 3]
    R = trajectory.Ts_base_frame[rows, :3, :3]
    moves = np.diff(p, axis=0)
    turns = spatial.log_so3(R[1:] @ np.swapaxes(R[:-1], 1, 2))
    name = trajectory.frame
    limits = protocol.limits[span.type]
    moving: list[_SampledMotion] = []
    for kind, subject, unit, factor, steps, stated in (
        ("tip", name, "mm", MM, moves, trajectory.tip_velocity[rows]),
        ("rotation", f"{name} (rotation)", "deg", DEG, turns, trajectory.angular_velocity[rows]),
    ):
        codes = []
        names = []
        limits_of_rates = []
        for rate in _RATE_NAMES:
            codes.append(f"{kind}_{rate}")
            names.append(f"{kind} {rate} of {name} in phase '{span.name}'")
            limits_of_rates.append(getattr(limits, f"{kind}_{rate}"))
        what = f"{kind} of {name}"
        motion = _SampledMotion(
            what,
            subject,
            where=name,
            codes=codes,
            names=names,
            unit=unit,
            factor=factor,
            first=span.start,
            steps=steps,
            stated=stated,
            limits=tuple(limits_of_rates),
        )
        moving.append(motion)
    return moving


def _phase_of_sample(trajectory: Trajectory, sample: int) -> str:
    """Return the name of the phase of a sample; the last sample of a phase belongs to it."""
    return next(span.name for span in trajectory.phases if sample <= span.stop)


def _largest_rates(trajectory: Trajectory, motion: _SampledMotion) -> Iterator[LargestRate]:
    """Yield the largest speed, acceleration and jerk; the jerk only of joints, and of frames with a jerk limit."""
    dt = trajectory.step
    for order, (code, name, limit) in enumerate(zip(motion.codes, motion.names, motion.limits, strict=True), 1):
        if len(motion.steps) < order or (code.endswith("_jerk") and not np.isfinite(limit)):
            return
        differences = np.diff(motion.steps, n=order - 1, axis=0)
        rates = np.linalg.norm(differences, axis=1) / dt**order
        fastest = int(np.argmax(rates))
        # a difference of this order has 2**order rounded samples; noise must not prove a violation
        noise = _RELATIVE_ROUNDING * 2**order * motion.size / dt**order
        size = max(0.0, float(rates[fastest]) - noise) / motion.factor
        unit = f"{motion.unit}/s"
        if order > 1:
            unit += str(order)
        t = float(trajectory.t[motion.first + fastest] + order * dt / 2)  # the middle of the samples of the difference
        phase = _phase_of_sample(trajectory, motion.first + fastest + order)
        yield LargestRate(
            f"timing.{code}",
            what=name,
            where=motion.where,
            unit=unit,
            size=size,
            limit=limit / motion.factor,
            t=t,
            phase=phase,
        )


def _not_at_rest(trajectory: Trajectory, span: PhaseSpan, moving: list[_SampledMotion]) -> Iterator[Finding]:
    """Yield a finding if a phase cannot begin or end at rest: a step is larger than the acceleration limit allows."""
    dt = trajectory.step
    for sample, step, verb in ((span.start, span.start, "begin"), (span.stop, span.stop - 1, "end")):
        for motion in moving:
            distance = float(np.linalg.norm(motion.steps[step - motion.first]))
            # from rest, the largest acceleration moves by a t^2 / 2 in one step
            reach = 0.5 * motion.limits[1] * dt**2 * (1 + ACCEPTED_EXCESS) + _REST_STEP
            if distance <= reach:
                continue
            what = (
                f"phase '{span.name}' does not {verb} at rest: {motion.subject} moves too far in one step of {dt:g} s"
            )
            size = Quantity(distance / motion.factor, motion.unit)
            when = f"phase '{span.name}', t = {trajectory.t[sample]:.3f} s"
            yield disagreement(
                "timing.rest",
                motion.where,
                what,
                size=size,
                limit=reach / motion.factor,
                suggestion=REPLAN_ADVICE,
                when=when,
            )
            break  # one finding for each end of a phase


def _false_claims(trajectory: Trajectory, motion: _SampledMotion) -> Iterator[Finding]:
    """Compare the stated speeds with the difference quotients of the positions.

    The average of the stated speeds at both ends of a step equals the mean speed in the step if the acceleration is
    constant. With an acceleration limit a, the difference is at most a dt/4. The first step of a phase is skipped if
    the first sample of the step belongs to the previous phase.
    """
    dt = trajectory.step
    skip = 1 if motion.first else 0
    mean_speeds = 0.5 * (motion.stated[1:] + motion.stated[:-1])
    deviation = np.linalg.norm(motion.steps / dt - mean_speeds, axis=1)[skip:]
    limit = dt * motion.limits[1] * (1 + ACCEPTED_EXCESS) / 4
    if not len(deviation) or deviation.max() <= limit:
        return
    sample = motion.first + skip + int(np.argmax(deviation))
    yield disagreement(
        "timing.claimed",
        motion.where,
        f"the stated speed of {motion.what} differs from the difference quotient of the positions",
        size=Quantity(float(deviation.max()) / motion.factor, f"{motion.unit}/s"),
        limit=limit / motion.factor,
        suggestion=REPLAN_ADVICE,
        when=f"phase '{_phase_of_sample(trajectory, sample)}', t = {trajectory.t[sample]:.3f} s",
        word="tolerance",
    )


def _rate_texts(loads: list[LargestRate], trajectory: Trajectory) -> dict[str, str]:
    """Return a text with the maximum for each kind of quantity, such as speed or jerk."""
    facts = {"computed from": f"{len(trajectory.t)} samples, {1e3 * trajectory.step:g} ms apart, without stated speeds"}
    by_code: dict[str, list[LargestRate]] = {}
    for load in loads:
        by_code.setdefault(load.code, []).append(load)
    for code, alike in by_code.items():
        name = code.removeprefix("timing.")
        most_loaded = max(alike, key=_share_of_limit)
        if np.isfinite(most_loaded.limit):
            facts[name.replace("_", " ")] = f"{most_loaded.what}: {most_loaded.text}"
            continue
        # Without a limit, quantities of different units cannot be compared.
        note = " (no limit is given; the jerk is not continuous)" if "jerk" in code else ""
        largest: dict[str, LargestRate] = {}  # by unit
        for load in alike:
            if load.unit not in largest or load.size > largest[load.unit].size:
                largest[load.unit] = load
        for unit, load in largest.items():
            facts[f"{name}, maximum in {unit}"] = f"{load.what}: {load.text}{note}"
    return facts


def _share_of_limit(load: LargestRate) -> float:
    """Return a maximum divided by its limit; 0 without a limit."""
    if not np.isfinite(load.limit):
        return 0.0
    return load.size / load.limit
