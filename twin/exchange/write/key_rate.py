"""Make the clip of a planned motion: its key rate is the lowest whose interpolation errors meet the error budget.

The motion is sampled at the lowest sample rate that resolves a key rate. Every n-th sample becomes a key, and the
errors are measured at the samples between the keys:

    for each key rate, from 10 Hz:
        keys = every (sample rate / key rate)-th sample, and the last
        if the interpolation errors between the keys are within the budget: take this key rate
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array, Index
from twin.exchange.write.clip import Clip, ClipAccuracy, InterpolationErrors, rounded
from twin.exchange.write.player_interpolation import (
    extreme_points,
    interpolated_poses,
    interpolation_errors,
    key_rows,
    largest_position_error,
    slerp,
)
from twin.model.mechanism import Mechanism
from twin.planning.link_motion import LinkMotion, link_motion
from twin.planning.trajectory import key_times

if TYPE_CHECKING:
    from twin.planning.trajectory import Trajectory

KEY_RATES = (10, 12, 15, 20, 24, 30, 40, 60, 120)
"""Available key rates in Hz; with each rate, the key times are multiples of 1/120 s."""

_MIN_SAMPLES_PER_KEY = 4
"""Minimum ratio of sample rate to key rate: errors are measured at three or more times between two keys."""

_SAMPLE_RATES = (120, 240, 480)
"""Sample rates in Hz at which interpolation errors are computed.

The sample rate for a key rate is the lowest of these rates that is a multiple of the key rate and at least
`_MIN_SAMPLES_PER_KEY` times as high.
"""


@dataclass(frozen=True)
class _Keys:
    """The keys of a motion at one key rate.

    Attributes:
        rate: key rate in Hz.
        times: (k,) in s.
        links: {body: T_world_body (k, 4, 4)}.
        joints: {joint: coordinates (k,) in m or rad}.
        errors: interpolation errors between the keys.
    """

    rate: int
    times: Array
    links: Mapping[str, Array]
    joints: Mapping[str, Array]
    errors: InterpolationErrors


def make_clip(
    mechanism: Mechanism,
    trajectory: Trajectory,
    title: str = "",
    budget: ClipAccuracy | None = None,
    assumed: tuple[str, ...] = (),
    motion_at: Callable[[Array], LinkMotion] | None = None,
) -> Clip:
    """Return the clip of a planned motion, at the lowest key rate of `KEY_RATES` whose errors are within the budget.

    If the errors exceed the budget at every rate, the highest rate is used. `mechanism` has the trocar positions of the
    protocol. If `title` is "", the title is the name of the protocol. `assumed` contains one text "name: reason" for
    each assumed number of the protocol. `motion_at` returns the motion at times (k,) in s; None: the joint values of
    the trajectory drive the compiled loops of the mechanism.

    Raises:
        AssemblyError: the loops of the mechanism cannot be closed.
    """
    motion_at = motion_at or _motion_without_equations(mechanism, trajectory)
    budget = budget or ClipAccuracy()
    keys = _lowest_rate_within(mechanism, trajectory.duration, budget, motion_at)
    phases = []
    rcms = []
    is_rcm_enforced = []
    for phase in trajectory.phases:
        phases.append((phase.name, float(phase.t0), float(phase.t1)))
        rcm: Array | None = None
        if phase.rcm is not None:
            rcm = np.asarray(phase.rcm, float)
        rcms.append(rcm)
        is_rcm_enforced.append(phase.rcm_mode == "enforced")
    return Clip(
        trajectory.protocol,
        title or trajectory.protocol,
        keys.times,
        keys.links,
        keys.joints,
        tuple(trajectory.joint_names),
        tuple(phases),
        float(keys.rate),
        keys.errors,
        budget,
        trajectory.frame,
        np.asarray(trajectory.shaft_axis, float),
        tuple(rcms),
        tuple(is_rcm_enforced),
        assumed,
        mechanism.trocar_places,
    )


def _motion_without_equations(mechanism: Mechanism, trajectory: Trajectory) -> Callable[[Array], LinkMotion]:
    """Return the function `motion_at` of `make_clip` for a trajectory without equations."""
    from twin.kinematics.closed_loops import LoopSolver

    loops = LoopSolver(mechanism)
    return lambda times: link_motion(loops, trajectory, times, None)


def _lowest_rate_within(
    mechanism: Mechanism, duration: float, budget: ClipAccuracy, motion_at: Callable[[Array], LinkMotion]
) -> _Keys:
    """Return the keys at the lowest rate whose errors are within the budget; at the highest rate if there is none.

    `duration` is that of the motion in s.
    """
    points = extreme_points(mechanism)
    worst_link = ""  # link with the largest error at the previous rate; tested first, as it usually exceeds the budget
    for sample_rate in _SAMPLE_RATES:
        times = key_times(duration, sample_rate)
        motion = motion_at(times)
        links = rounded(motion.links)
        for rate in _key_rates_of(sample_rate):
            rows = key_rows(len(times), sample_rate // rate)
            is_last_rate = rate == KEY_RATES[-1]
            if worst_link and not is_last_rate:
                shown = interpolated_poses(times, links[worst_link], rows, slerp)
                errors_of_link = largest_position_error(shown - links[worst_link], points[worst_link])
                if errors_of_link.max() > budget.position:
                    continue
            errors = interpolation_errors(mechanism, times, links, rows, points)
            if errors.keeps(budget) or is_last_rate:
                joints = rounded(_at_keys(motion.joints, rows))
                return _Keys(rate, times[rows], _at_keys(links, rows), joints, errors)
            worst_link, _ = errors.position_at
    raise AssertionError("no sample rate is suitable for the highest key rate")


def _key_rates_of(sample_rate: int) -> Iterator[int]:
    """Yield the key rates in Hz, from the lowest, whose errors are computed at a sample rate in Hz."""
    for rate in KEY_RATES:
        if _sample_rate_for(rate) == sample_rate:
            yield rate


def _sample_rate_for(key_rate: int) -> int:
    """Return the lowest sample rate in Hz for a key rate in Hz; see `_SAMPLE_RATES`."""
    for sample_rate in _SAMPLE_RATES:
        if sample_rate % key_rate == 0 and sample_rate >= _MIN_SAMPLES_PER_KEY * key_rate:
            return sample_rate
    raise AssertionError(f"no sample rate is suitable for the key rate {key_rate} Hz")


def _at_keys(arrays: Mapping[str, Array], rows: Index) -> dict[str, Array]:
    """Return the rows of each array that are keys."""
    at_keys = {}
    for name, values in arrays.items():
        at_keys[name] = values[rows]
    return at_keys
