"""Distance of the shaft from the RCM between the samples of a trajectory: measured maximum and estimated bound.

Between samples, the joints follow cubics through sampled positions and speeds, as in a controller, and the mechanism
moves the shaft. The vector from the shaft to the RCM is then a smooth function of time. The distance is measured on the
driven mechanism in the intervals where this vector is longest, and in those where its second derivative is largest; in
short phases, in all intervals.

In every interval, also in those that are not measured, the distance is estimated to be at most d + h^2 a / 8, with the
larger distance d at the two ends of the interval, the time step h, and the second derivative a of the vector. The
second derivative is estimated as twice the second difference quotient of the samples. It is not a proven bound.
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

_INNER_POSITIONS = np.linspace(0.0, 1.0, 9)[1:-1]
"""Positions (0 to 1) within an interval at which the distance is measured; a parabola refines the maximum."""

_SAFETY_FACTOR = 2.0
"""Factor of second differences: between two samples, the vector may bend more than at them."""

_DISTANCE_ROUNDING = 1e-12
"""Distance in m below which a bound says nothing: it is a rounding error."""

_RCM_MISSED_BETWEEN = Kind(
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


def shaft_to_rcm(Ts: Array, axis: Array, rcm: Array) -> Array:
    """Return the vector (k, 3) in m from the nearest point of the shaft axis to the RCM (3,).

    `axis` (3,) is the shaft direction in the moved frame; Ts (k, 4, 4) are poses of this frame.
    """
    u = Ts[:, :3, :3] @ (axis / np.linalg.norm(axis))
    w = rcm - Ts[:, :3, 3]
    return w - np.sum(w * u, axis=1)[:, None] * u


def passages(model: ReferenceModel, trajectory: Trajectory) -> list[Passage]:
    """Return the distances of the shaft from the RCM, for each phase with an RCM."""
    spans: list[PhaseSpan] = []
    intervals_of_phases: list[Index] = []
    indices_of_phases: list[Array] = []  # fractional: 7.25 is a quarter of a step after sample 7
    for span in trajectory.phases:
        if span.rcm is None or span.stop <= span.start:
            continue
        intervals = _intervals_to_measure(trajectory, span)
        spans.append(span)
        intervals_of_phases.append(intervals)
        indices_of_phases.append(np.add.outer(intervals, _INNER_POSITIONS).ravel())
    if not spans:
        return []
    # All phases in one run of the mechanism, which takes less time than one for each.
    indices = np.concatenate(indices_of_phases)
    Ts = _poses_between(model, trajectory, indices) @ model.mechanism.frame_in_tool(trajectory.frame)
    passages_of_phases: list[Passage] = []
    first = 0
    for span, intervals in zip(spans, intervals_of_phases, strict=True):
        count = len(intervals) * len(_INNER_POSITIONS)
        Ts_inside = Ts[first : first + count].reshape(len(intervals), len(_INNER_POSITIONS), 4, 4)
        first += count
        passages_of_phases.append(_passage_of_phase(trajectory, span, intervals, Ts_inside))
    return passages_of_phases


def _intervals_to_measure(trajectory: Trajectory, span: PhaseSpan) -> Index:
    """Return the index of the first sample of each interval to measure.

    In a long phase, these are the intervals with the largest distances and those with the largest curvature.
    """
    assert span.rcm is not None
    rows = np.arange(span.start, span.stop + 1)
    if len(rows) <= ALL_MEASURED:
        return rows[:-1]
    # where the vector from shaft to RCM may be longest, by a cubic through the samples
    e = shaft_to_rcm(trajectory.Ts_base_frame[rows], trajectory.shaft_axis, span.rcm)
    rate = np.gradient(e, axis=0)
    inside = spatial.cubic(_INNER_POSITIONS[:, None, None], e[:-1], e[1:], rate[:-1], rate[1:])
    longest = np.linalg.norm(inside, axis=2).max(axis=0)
    bend = _bend_of_intervals(e)
    # The cubic is least accurate where the vector bends most.
    half = MEASURED_INTERVALS // 2
    chosen = {*np.argsort(longest)[-half:].tolist(), *np.argsort(bend)[-half:].tolist()}
    return span.start + np.array(sorted(chosen))


def _bend_of_intervals(e: Array) -> Array:
    """Return the larger second difference (k - 1,) in m of vectors e (k, 3) at the two ends of each interval."""
    bend = np.zeros(len(e))
    if len(e) > 2:
        bend[1:-1] = np.linalg.norm(np.diff(e, n=2, axis=0), axis=1)
        # at the first and the last sample, as at their neighbours
        bend[0] = bend[1]
        bend[-1] = bend[-2]
    return np.maximum(bend[:-1], bend[1:])


def _poses_between(model: ReferenceModel, trajectory: Trajectory, indices: Array) -> Array:
    """Return T_base_tool (k, 4, 4) of the driven mechanism at fractional sample indices (k,)."""
    i = np.minimum(indices.astype(int), len(trajectory.t) - 2)
    fraction = (indices - i)[:, None]
    rate = trajectory.step * trajectory.qd
    q = spatial.cubic(fraction, trajectory.q[i], trajectory.q[i + 1], rate[i], rate[i + 1])
    return model.run(q).Ts_base_tool


def _passage_of_phase(trajectory: Trajectory, span: PhaseSpan, intervals: Index, Ts_inside: Array) -> Passage:
    """Return the distances of one phase.

    Args:
        trajectory: the motion.
        span: its phase.
        intervals: index of the first sample of each measured interval.
        Ts_inside: poses (interval, position, 4, 4) of the moved frame at `_INNER_POSITIONS` of these intervals.
    """
    assert span.rcm is not None
    rows = slice(span.start, span.stop + 1)
    e = shaft_to_rcm(trajectory.Ts_base_frame[rows], trajectory.shaft_axis, span.rcm)
    at_samples = np.linalg.norm(e, axis=1)
    e_inside = shaft_to_rcm(Ts_inside.reshape(-1, 4, 4), trajectory.shaft_axis, span.rcm)
    inside = np.linalg.norm(e_inside, axis=1).reshape(Ts_inside.shape[:2])
    measured, position_index = np.unravel_index(int(np.argmax(inside)), inside.shape)
    between, position = _parabola_maximum(inside[measured], int(position_index))
    # |e| <= larger end value + h^2/8 |e''|, with h^2 |e''| as the larger second difference at the ends, and a factor
    bend = _SAFETY_FACTOR * _bend_of_intervals(e)
    bound = np.maximum(at_samples[:-1], at_samples[1:]) + bend / 8
    return Passage(
        phase=span.name,
        enforced=span.rcm_mode != "monitored",
        at_samples=float(at_samples.max()),
        between=between,
        t=float(trajectory.t[intervals[measured]] + position * trajectory.step),
        bound=float(max(bound.max(), between, _DISTANCE_ROUNDING)),
        measured=len(intervals),
        intervals=len(at_samples) - 1,
    )


def _parabola_maximum(values: Array, j: int) -> tuple[float, float]:
    """Return (maximum, its position 0..1 in the interval) of the parabola through value j and its two neighbours."""
    if not 0 < j < len(values) - 1:
        return float(values[j]), float(_INNER_POSITIONS[j])
    before, middle, after = values[j - 1 : j + 2]
    bend = before - 2 * middle + after
    if bend >= 0:  # no parabola with a maximum
        return float(middle), float(_INNER_POSITIONS[j])
    shift = 0.5 * (before - after) / bend  # in steps between the positions
    maximum = middle - 0.25 * (before - after) * shift
    position = _INNER_POSITIONS[j] + shift * (_INNER_POSITIONS[1] - _INNER_POSITIONS[0])
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
        next_sample = np.searchsorted(trajectory.t, passage.t)  # the row has a sample for the time of its maximum
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
            clock=clock.at(np.array([next_sample])),
            note=(
                f"measured in {passage.measured} of {passage.intervals} intervals; estimated bound in all of them "
                f"{display_text(passage.bound, 'm')}"
            ),
        )
        what = f"between samples the shaft misses the RCM (largest distance at the samples: {mm(passage.at_samples)})"
        comparison.judge(
            residual, _RCM_MISSED_BETWEEN, what, "RCM", when=f"phase '{passage.phase}', t = {passage.t:.3f} s"
        )
