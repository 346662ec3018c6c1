"""The motion of a linkage by one driven joint: its loops are closed by Newton steps on their closing points."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from twin.comparison.coupled_motion import RATIO_TOLERANCE, followers_of
from twin.comparison.side import RobotSide
from twin.core.spatial import Array

_MAX_NEWTON_STEPS = 30
"""Maximum number of Newton steps that close the loops at one state."""

_CLOSED_GAP = 1e-9
"""Gap in m up to which a loop is closed."""

_LARGEST_DRIVER_STEP = 0.05
"""Largest step of the driver on the way from its drawn state to zero, in rad: the driver is a hinge."""

_DIFFERENCE_STEP = 1e-7
"""Step of a free joint for derivatives by differences, in rad, or in m for a slide."""


class LinkageMotion:
    """The states of a linkage with closed loops at values of its driver.

    Attributes:
        linkage: the side with loops.
        driver: the joint of its tree that is driven.
        held: joints of its tree that do not move.
    """

    def __init__(self, linkage: RobotSide, driver: int, held: Collection[int] = ()) -> None:
        self.linkage = linkage
        self.driver = driver
        self.held = held
        self._drawn = np.array([axis.drawn for axis in linkage.axes])
        self._followers = followers_of(linkage)
        self._free = self._free_joints()

    def _free_joints(self) -> list[int]:
        """Return the joints of the tree whose values close the loops: neither driven nor held, and in no coupling."""
        free = []
        for i in range(len(self.linkage.tree)):
            is_coupled = i in self._followers or self._is_coupled(i)
            if i != self.driver and i not in self.held and not is_coupled:
                free.append(i)
        return free

    def _is_coupled(self, i: int) -> bool:
        """Return whether a coupling contains a joint."""
        name = self.linkage.axes[i].name
        return any(name in coupling.ratios for coupling in self.linkage.couplings)

    def displacements(self, value: float, x: Array) -> Array:
        """Return the displacements (joints of the tree,) in m or rad at a coordinate of the driver.

        `x` are the values of the free joints. If the driver follows other joints, the one of the largest ratio is moved
        so that the driver has this coordinate; the others stay as drawn.
        """
        q = self._drawn.copy()
        q[self.driver] = value
        q[self._free] = x
        if self.driver in self._followers:  # the driver follows in the file: move its leader
            ratios, offset = self._followers[self.driver]
            leader = int(np.argmax(np.abs(ratios)))
            q[leader] = 0.0
            from_others = ratios @ q
            q[leader] = (value - offset - from_others) / ratios[leader]
        for i, (ratios, offset) in self._followers.items():
            if i != self.driver:
                q[i] = ratios @ q + offset
        return (q - self._drawn)[: len(self.linkage.tree)]

    def _gaps(self, displacements: Array) -> Array:
        """Return the gaps of the loops (k, rows) in m for displacements (k, joints of the tree)."""
        motions = self.linkage.group_motions(displacements)
        rows = []
        for axis in self.linkage.axes:
            if not axis.closes_loop:
                continue
            on_parent = motions[:, axis.parent, :3, :3] @ axis.point + motions[:, axis.parent, :3, 3]
            on_child = motions[:, axis.child, :3, :3] @ axis.point + motions[:, axis.child, :3, 3]
            rows.append(on_parent - on_child)
        return np.concatenate(rows, axis=1)

    def closing_values(self, value: float, x: Array) -> Array | None:
        """Return the values of the free joints that close the loops, near `x`; None if they do not close."""
        for _ in range(_MAX_NEWTON_STEPS):
            states = [self.displacements(value, x)]
            for step in _DIFFERENCE_STEP * np.eye(len(x)):
                states.append(self.displacements(value, x + step))
            gaps = self._gaps(np.array(states))
            r = gaps[0]
            if np.abs(r).max() < _CLOSED_GAP:
                return x
            J = (gaps[1:] - r).T / _DIFFERENCE_STEP
            x = x - np.linalg.lstsq(J, r, rcond=1e-9)[0]
        return None

    def values_at_zero(self) -> Array | None:
        """Return the values of the free joints at the state zero of the driver.

        None: a loop opens on the way, or couplings hold the driver at one value.
        """
        follower = self._followers.get(self.driver)
        if follower is not None and np.abs(follower.ratios).max() < RATIO_TOLERANCE:
            return None
        x = self._drawn[self._free]
        drawn = float(self._drawn[self.driver])
        steps = 1 + int(np.ceil(abs(drawn) / _LARGEST_DRIVER_STEP))
        for value in np.linspace(drawn, 0.0, steps + 1)[1:]:
            closing = self.closing_values(float(value), x)
            if closing is None:
                return None
            x = closing
        return x

    def displacements_along(self, values: Array, x_zero: Array) -> Array | None:
        """Return the displacements (k, joints of the tree) along values (k,) of the driver; None if a loop opens.

        From the value nearest to zero, where the free joints have the values `x_zero`, each state begins at its
        neighbour: the loops then stay in one assembly mode.
        """
        start = int(np.argmin(np.abs(values)))
        upward = range(start, len(values))
        downward = range(start - 1, -1, -1)
        displacements = np.zeros((len(values), len(self.linkage.tree)))
        for order in (upward, downward):
            if not self._fill_displacements(order, values, x_zero, displacements):
                return None
        return displacements

    def _fill_displacements(self, order: Sequence[int], values: Array, x: Array, displacements: Array) -> bool:
        """Fill displacements for one state after another, beginning at x; return whether all loops close."""
        for k in order:
            closing = self.closing_values(float(values[k]), x)
            if closing is None:
                return False
            x = closing
            displacements[k] = self.displacements(float(values[k]), x)
        return True
