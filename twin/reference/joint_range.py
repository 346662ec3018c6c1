"""States of a mechanism all over the range of its driven joints, for checks that must not depend on one protocol.

Where any joint values within the limits are possible (a serial arm), the states are low-discrepancy draws from the
whole range, and its corners. Otherwise (loops, limits of passive joints), the mechanism moves from the rest poses on
straight lines in joint space towards such draws, as far as its loops close and its limits allow.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.model.mechanism import Mechanism
from twin.reference.loop_closing import Closing
from twin.reference.model import ReferenceModel
from twin.reference.states import SolvedSamples

STATES = 512
"""Number of states in a check of the whole range."""

_MOST_JOINTS_WITH_CORNERS = 6
"""Largest number of joints for which all corners of the range are taken."""

_CORNER_INSET = 1e-3
"""Distance of the corners from the ends of the range, as a fraction of the range."""

_UNLIMITED_HALF_RANGE = {True: np.pi, False: 0.1}
"""Half width of the range of a joint without limits, in rad (angles) and m (lengths), about its rest value."""

_LONGEST_TURN = 0.2
"""Largest step in rad of a driven angle on a line."""

_LONGEST_SLIDE = 0.04
"""Largest step in m of a driven slide on a line."""

_MODE_JUMP = 1.0
"""Largest change (m, rad) of any coordinate in one step; a larger change means another assembly mode."""

_POSSIBLE_SHARE = 0.5
"""Fraction of draws that must be possible; otherwise, the mechanism moves along lines instead."""


@dataclass(frozen=True)
class JointRange:
    """States of a mechanism over the range of its driven joints.

    Attributes:
        run: the states (k); their loops are closed, and all joints are within their limits.
        low, high: (n,) the range of each driven joint in m or rad: its limits or, without limits, a substitute.
    """

    run: SolvedSamples
    low: Array
    high: Array

    @property
    def share(self) -> Array:
        """Fraction (n,) of the range of each driven joint that the states span."""
        return np.ptp(self.run.q, axis=0) / (self.high - self.low)


def joint_range(model: ReferenceModel, count: int = STATES) -> JointRange:
    """Return about `count` states of the mechanism, spread over the range of its driven joints; always the same."""
    mechanism = model.mechanism
    home = model.home()
    low, high = ends(mechanism, home.q)
    closing = Closing(model, np.ones(len(low)))
    targets = _targets(low, high, count)
    states = np.zeros((0, len(home.x)))
    if closing.linear is not None:
        states = closing.placed(targets)
        states = states[within_limits(model, states)]
    if len(states) < _POSSIBLE_SHARE * len(targets):
        states = _along_lines(model, closing, home.x, targets[: count // 2])
    return JointRange(model.collect(states), low, high)


def ends(mechanism: Mechanism, q_rest: Array) -> tuple[Array, Array]:
    """Return the lower and the upper end (n,) of the range of each driven joint."""
    half = np.array([_UNLIMITED_HALF_RANGE[joint.is_angle] for joint in mechanism.active])
    low, high = mechanism.limits.T
    low = np.where(np.isfinite(low), low, q_rest - half)
    high = np.where(np.isfinite(high), high, q_rest + half)
    return low, high


def _targets(low: Array, high: Array, count: int) -> Array:
    """Return joint values (count, n): corners of the range, then low-discrepancy draws."""
    n = len(low)
    corners = np.zeros((0, n))
    if n <= _MOST_JOINTS_WITH_CORNERS:
        corners = np.array(list(product((_CORNER_INSET, 1 - _CORNER_INSET), repeat=n)))
    parts = np.concatenate([corners, draws(1, 1 + count - len(corners), n)])
    # Lines that are cut off after the first part still have draws and corners.
    parts = parts[np.random.default_rng(0).permutation(count)]
    return low + parts * (high - low)


def draws(first: int, last: int, n: int) -> Array:
    """Return the low-discrepancy points (last - first, n) of the unit cube with the numbers `first` to `last` - 1.

    Point 0 is the middle of the cube; each following point is n irrational steps further, modulo 1. The steps are
    powers of 1 / g with g^(n + 1) = g + 1, so that for n = 1, g is the golden ratio (M. Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018). scipy.stats.qmc takes longer to import than the check.

    Begin with point 1: in the middle itself, an arm with symmetric limits is stretched, and has two solutions in one.
    """
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (n + 1))
    steps = g ** -np.arange(1.0, n + 1)
    return (0.5 + np.outer(np.arange(first, last), steps)) % 1.0


def _along_lines(model: ReferenceModel, closing: Closing, home: Array, targets: Array) -> Array:
    """Return configurations on straight lines in joint space from home to targets (k, n).

    From each line, the last possible state and one between are returned.
    """
    q0 = model.collect(home[None]).q[0]
    stride = np.where(model.tree.are_angles, _LONGEST_TURN, _LONGEST_SLIDE)
    change = targets - q0
    steps = max(1, int(np.ceil(np.max(np.abs(change) / stride))))
    ahead = change / steps
    X = np.tile(home, (len(targets), 1))
    sign = closing.signs(home[None])
    moving = np.arange(len(targets))
    states_of_line: list[list[Array]] = [[home] for _ in targets]
    for step in range(1, steps + 1):
        new, possible = closing.near(X[moving], q0 + step * ahead[moving])
        possible &= closing.change(X[moving], new) <= _MODE_JUMP
        possible &= (closing.signs(new) == sign).all(axis=1)
        possible &= within_limits(model, new)
        moving = moving[possible]
        X[moving] = new[possible]
        for line in moving:
            states_of_line[line].append(X[line].copy())
        if not len(moving):
            break
    rng = np.random.default_rng(1)
    last = []
    between = []
    for line in states_of_line:
        last.append(line[-1])
        between.append(line[rng.integers(len(line))])
    return np.array(last + between)


def within_limits(model: ReferenceModel, states: Array) -> np.ndarray:
    """Return (k,) bool: whether all passive joints are within limits and cones at configurations (k, nq)."""
    is_within = np.ones(len(states), bool)
    if not model.mechanism.limited or not len(states):
        return is_within
    links = model.link_poses(states)
    for joint in model.mechanism.limited:
        is_within &= joint.beyond(links[joint.parent], links[joint.child]) <= ROUNDING
    return is_within
