"""Distance of the shaft from the RCM between the samples of a trajectory: measured maximum and estimated bound.

Between samples, the joints follow cubics through sampled positions and speeds, as in a controller, and the mechanism
moves the shaft. The vector from the shaft to the RCM is then a smooth function of time. The distance is measured on the
driven mechanism in the intervals where this vector is longest, and in those where its second derivative is largest; in
short phases, in all intervals.

In the other intervals, the maximum is estimated as d + h^2 a / 8, with the larger distance d at the two ends of the
interval, the time step h, and the second derivative a of the vector. The second derivative is estimated as twice the
second difference quotient of the samples. The estimate is not a proven bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError
from twin.core.findings import Kind
from twin.core.quantity import mm
from twin.core.spatial import Array, Index
from twin.planning.trajectory import PhaseSpan, Trajectory
from twin.reference import ReferenceModel
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import SampleClock, display_text, row

ALL_MEASURED = 64
"""Largest number of samples of a phase that is measured in all intervals."""

MEASURED_INTERVALS = 12
"""Largest number of measured intervals in a longer phase."""

_INSIDE = np.linspace(0.0, 1.0, 9)[1:-1]
"""Positions (0 to 1) within an interval at which the distance is measured; a parabola refines the maximum."""

_ROUNDING = 1e-12
"""Distance in m below which a bound says nothing: it is a rounding error."""

_BETWEEN = Kind(
    "rcm.between",
    "disagreement",
    "use a shorter time step, or a controller that computes joint values between samples from the shaft pose",
    word="tolerance",
)


@dataclass(frozen=True)
class Passage:
    """Distance of the shaft from the RCM in one phase.

    Attributes:
        phase: name of the phase.
        enforced: whether the protocol enforces the RCM.
        at_samples: largest distance at the samples, in m.
        between: largest distance measured between samples, in m.
        t: time of `between`, in s.
        bound: estimated upper bound of the distance anywhere in the phase, in m.
        measured, intervals: number of measured intervals, and of all intervals.
    """

    phase: str
    enforced: bool
    at_samples: float
    between: float
    t: float
    bound: float
    measured: int
    intervals: int


def offset(Ts: Array, axis: Array, rcm: Array) -> Array:
    """Return the vector (k, 3) in m from the nearest point of the shaft axis to the RCM (3,).

    `axis` (3,) is the shaft direction in the moved frame; Ts (k, 4, 4) are poses of this frame.
    """
    u = Ts[:, :3, :3] @ (axis / np.linalg.norm(axis))
    w = rcm - Ts[:, :3, 3]
    return w - np.sum(w * u, axis=1)[:, None] * u


def passages(model: ReferenceModel, trajectory: Trajectory) -> list[Passage]:
    """Return the distances of the shaft from the RCM, for each phase with an RCM."""
    spans: list[PhaseSpan] = []
    suspects: list[Index] = []
    indices: list[Array] = []
    for span in trajectory.phases:
        if span.rcm is None or span.stop <= span.start:
            continue
        intervals = _suspects(trajectory, span)
        spans.append(span)
        suspects.append(intervals)
        indices.append(np.add.outer(intervals, _INSIDE).ravel())
    if not spans:
        return []
    times = np.concatenate(indices)
    Ts = _poses(model, trajectory, times) @ model.mechanism.frame_in_tool(trajectory.frame)
    passages_of_phases: list[Passage] = []
    first = 0
    for span, intervals in zip(spans, suspects, strict=True):
        count = len(intervals) * len(_INSIDE)
        Ts_inside = Ts[first : first + count].reshape(len(intervals), len(_INSIDE), 4, 4)
        first += count
        passages_of_phases.append(_passage(trajectory, span, intervals, Ts_inside))
    return passages_of_phases


def _suspects(trajectory: Trajectory, span: PhaseSpan) -> Index:
    """Return the index of the first sample of each interval to measure.

    In a long phase, these are the intervals with the largest distances and those with the largest curvature.
    """
    assert span.rcm is not None
    rows = np.arange(span.start, span.stop + 1)
    if len(rows) <= ALL_MEASURED:
        return rows[:-1]
    # where the vector from shaft to RCM may be longest, by a cubic through the samples
    e = offset(trajectory.Ts_base_frame[rows], trajectory.shaft_axis, span.rcm)
    rate = np.gradient(e, axis=0)
    inside = spatial.cubic(_INSIDE[:, None, None], e[:-1], e[1:], rate[:-1], rate[1:])
    longest = np.linalg.norm(inside, axis=2).max(axis=0)
    bend = np.zeros(len(longest))
    if len(e) > 2:
        second = np.linalg.norm(np.diff(e, n=2, axis=0), axis=1)
        bend[:-1] = second
        bend[1:] = np.maximum(bend[1:], second)
    # The cubic is least accurate where the vector bends most.
    half = MEASURED_INTERVALS // 2
    chosen = {*np.argsort(longest)[-half:].tolist(), *np.argsort(bend)[-half:].tolist()}
    return span.start + np.array(sorted(chosen))


def _poses(model: ReferenceModel, trajectory: Trajectory, x: Array) -> Array:
    """Return T_base_tool (k, 4, 4) of the driven mechanism at fractional sample indices x (k,)."""
    i = np.minimum(x.astype(int), len(trajectory.t) - 2)
    fraction = (x - i)[:, None]
    rate = trajectory.step * trajectory.qd
    q = spatial.cubic(fraction, trajectory.q[i], trajectory.q[i + 1], rate[i], rate[i + 1])
    return model.run(q).Ts_base_tool


def _passage(trajectory: Trajectory, span: PhaseSpan, at: Index, Ts_inside: Array) -> Passage:
    """Return the distances of one phase.

    Args:
        trajectory: the motion.
        span: its phase.
        at: index of the first sample of each measured interval.
        Ts_inside: poses (interval, place, 4, 4) of the moved frame in these intervals.
    """
    assert span.rcm is not None
    rows = slice(span.start, span.stop + 1)
    e = offset(trajectory.Ts_base_frame[rows], trajectory.shaft_axis, span.rcm)
    ends = np.linalg.norm(e, axis=1)
    e_inside = offset(Ts_inside.reshape(-1, 4, 4), trajectory.shaft_axis, span.rcm)
    inside = np.linalg.norm(e_inside, axis=1).reshape(Ts_inside.shape[:2])
    interval, place = np.unravel_index(int(np.argmax(inside)), inside.shape)
    size, position = _summit(inside[interval], int(place))
    # |e| <= larger end value + h^2/8 |e''|; e'' is twice (safety factor) the larger second difference at the ends
    bend = np.zeros(1)
    if len(e) > 2:
        bend = np.linalg.norm(np.diff(e, n=2, axis=0), axis=1)
    bend = np.pad(bend, 1, mode="edge")[: len(ends)]
    larger_bend = bend
    if len(bend) > 1:
        larger_bend = 2 * np.maximum(bend[:-1], bend[1:])
    bound = np.maximum(ends[:-1], ends[1:]) + larger_bend / 8
    return Passage(
        phase=span.name,
        enforced=span.rcm_mode != "monitored",
        at_samples=float(ends.max()),
        between=float(size),
        t=float(trajectory.t[at[interval]] + position * trajectory.step),
        bound=float(max(bound.max(), size, _ROUNDING)),
        measured=len(at),
        intervals=len(ends) - 1,
    )


def _summit(values: Array, j: int) -> tuple[float, float]:
    """Return (maximum, its position 0..1 in the interval) of the parabola through value j and its two neighbours."""
    if not 0 < j < len(values) - 1:
        return float(values[j]), float(_INSIDE[j])
    a, b, c = values[j - 1 : j + 2]
    bend = a - 2 * b + c
    if bend >= 0:
        return float(b), float(_INSIDE[j])
    shift = 0.5 * (a - c) / bend
    maximum = b - 0.25 * (a - c) * shift
    position = _INSIDE[j] + shift * (_INSIDE[1] - _INSIDE[0])
    return float(maximum), float(position)


def between_samples(
    model: ReferenceModel, trajectory: Trajectory, tolerance: float, comparison: EquationsComparison, clock: SampleClock
) -> None:
    """Add a row for each phase with an RCM to `comparison`, and a finding if the distance between samples is too large.

    `tolerance` is the largest accepted distance in m. If the RCM is monitored and the shaft already misses it at
    the samples, the row is not judged.
    """
    try:
        passages_of_phases = passages(model, trajectory)
    except AssemblyError:  # already reported by the comparison
        return
    for passage in passages_of_phases:
        nearest_sample = np.searchsorted(trajectory.t, passage.t)
        limit = None
        if passage.enforced or passage.at_samples <= tolerance:
            limit = tolerance
        residual = row(
            "B",
            "rcm",
            f"{passage.phase}, between samples",
            unit="m",
            differences=np.array([passage.between]),
            tolerance=limit,
            clock=clock.at(np.array([nearest_sample])),
            note=(
                f"measured in {passage.measured} of {passage.intervals} intervals; estimated bound elsewhere "
                f"{display_text(passage.bound, 'm')}"
            ),
        )
        what = f"between samples the shaft misses the RCM (largest distance at the samples: {mm(passage.at_samples)})"
        comparison.judge(residual, _BETWEEN, what, "RCM", when=f"phase '{passage.phase}', t = {passage.t:.3f} s")
