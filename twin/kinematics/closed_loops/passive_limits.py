"""Limits of passive joints, ranges and cones, as expressions of active joints and loop unknowns.

The slack of a limit is its distance in m or rad, negative beyond the limit. Slacks of angles are smooth functions of
the pose, so that a drag can slide along a limit; they are exact at the limit and in sign, and smaller than the distance
far inside. An angle has no number of turns here, because a pose does not determine it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from scipy.spatial import KDTree

from twin.codegen import Kernel, Stage
from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.kinematics.closed_loops.equations import LENGTH_SCALE, LoopEquations
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

Kind = Literal["range", "lower", "upper", "cone"]

_SAME_POSE_DISTANCE = 5e-3
"""Difference of two tool poses, in m (rad times `LENGTH_SCALE`), below which they are the same.

Equations and mechanism may differ by errors of the CAD; another assembly mode differs by more, except near a
singularity, where the modes have nearly the same joint values.
"""

_NARROWEST_CONE = 1e-6
"""Half angle in rad of the narrowest cone whose slack is an angle at the limit: a cone of 0 has a finite slack, too."""


@dataclass(frozen=True)
class PassiveLimit:
    """A limit of a passive joint.

    Attributes:
        joint: the joint.
        kind: "cone" (ball joint), "range" (both ends of a range of angles), "lower" or "upper" (one end).
    """

    joint: Joint
    kind: Kind


def passive_limits(mechanism: Mechanism) -> tuple[PassiveLimit, ...]:
    """Return the limits of passive joints that poses can violate; ranges of a full turn or more are not among them."""
    limits: list[PassiveLimit] = []
    for joint in mechanism.joints:
        if joint.active:
            continue
        if joint.type == "spherical" and joint.cone is not None and joint.cone < np.pi:
            limits.append(PassiveLimit(joint, "cone"))
        if joint.limits is None or joint.type not in ("revolute", "prismatic"):
            continue
        low, high = joint.limits
        if joint.is_angle and np.isfinite(high - low):
            if high - low < 2 * np.pi:
                limits.append(PassiveLimit(joint, "range"))
            continue
        if np.isfinite(low):
            limits.append(PassiveLimit(joint, "lower"))
        if np.isfinite(high):
            limits.append(PassiveLimit(joint, "upper"))
    return tuple(limits)


def slacks(equations: LoopEquations, limits: tuple[PassiveLimit, ...], stepping: bool = False) -> ca.SX:
    """Return the slacks (c,) of limits in m or rad.

    With `stepping`, these are the slacks after a step of the unknowns, to first order in the step.
    """
    if not limits:
        return ca.SX(0, 1)
    rows = []
    for limit in limits:
        rows.append(_slack(equations, limit, stepping))
    return ca.vertcat(*rows)


def _slack(equations: LoopEquations, limit: PassiveLimit, stepping: bool) -> ca.SX:
    joint = limit.joint
    parent_frame, child_frame = equations.frames(joint, stepping)
    p0, x0, y0, z0 = parent_frame
    p1, x1, _, z1 = child_frame
    if limit.kind == "cone":
        cone = float(joint.cone or 0.0)
        slope = np.sin(max(cone, _NARROWEST_CONE))  # of the cosine, at the limit
        return (ca.dot(z0, z1) - np.cos(cone)) / slope
    low, high = joint.limits or (-np.inf, np.inf)
    if joint.type == "prismatic":
        shift = ca.dot(z0, p1 - p0)
        if limit.kind == "lower":
            return shift - low
        return high - shift
    cosine = ca.dot(x0, x1)
    sine = ca.dot(y0, x1)
    if limit.kind == "range":
        # The cosine of the angle from the middle of the range is smooth also where the angle jumps by a turn.
        middle = (low + high) / 2
        half = (high - low) / 2
        cosine_from_middle = np.cos(middle) * cosine + np.sin(middle) * sine
        return (cosine_from_middle - np.cos(half)) / np.sin(half)
    angle = ca.atan2(sine, cosine)
    if limit.kind == "lower":
        return angle - low
    return high - angle


class PassiveCheck:
    """Checks the limits of passive joints at many tool poses, with all loops of the mechanism closed.

    Attributes:
        limits: the limits that are checked.
    """

    def __init__(self, solver: LoopSolver) -> None:
        """Set up the check of a mechanism; the expressions are compiled when first used."""
        self.limits = passive_limits(solver.mechanism)
        self._solver = solver

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints with limits."""
        return tuple(dict.fromkeys(limit.joint.name for limit in self.limits))

    @cached_property
    def _slacks(self) -> Kernel:
        e = self._solver.equations
        expression = ca.densify(slacks(e, self.limits))
        function = ca.Function("slacks", [e.q, e.states], [expression], {"cse": True})
        inputs = {"q": e.q.numel(), "states": e.states.numel()}
        return Kernel([Stage(function, tuple(inputs), ("slacks",))], inputs, ["slacks"])

    def slacks(self, q: Array, states: Array) -> Array:
        """Return the slacks (k, c) in m or rad at active joints q (k, n) and loop unknowns `states` (k, m)."""
        (slacks,) = self._slacks(np.ascontiguousarray(q.T), np.ascontiguousarray(states.T))
        return slacks.T

    def keeps_limits_at_poses(self, q: Array, Ts: Array) -> np.ndarray:
        """Return (k,) bool: whether the mechanism assumes tool poses Ts (k, 4, 4) at q (k, n) within all limits.

        A pose that the loops do not reach in the assembly mode of the rest poses is not kept.
        """
        states, placed = self.unknowns_at_poses(q, Ts)
        placed[placed] = self.keeps_limits(q[placed], states[placed])
        return placed

    def margins(self, q: Array, Ts: Array) -> dict[str, tuple[Array, bool]]:
        """Return {joint: (distance (k,) from its limits, whether in rad)} at tool poses Ts (k, 4, 4) and q (k, n).

        Distances are negative beyond the limits, and NaN where the mechanism does not assume the pose.
        """
        states, placed = self.unknowns_at_poses(q, Ts)
        links = self._solver.link_poses(q[placed], states[placed])
        joints = {limit.joint.name: limit.joint for limit in self.limits}
        margins: dict[str, tuple[Array, bool]] = {}
        for name, joint in joints.items():
            margin = np.full(len(q), np.nan)
            margin[placed] = -joint.beyond(links[joint.parent], links[joint.child])
            is_angle = joint.is_angle or joint.cone is not None
            margins[name] = (margin, is_angle)
        return margins

    def keeps_limits(self, q: Array, states: Array) -> np.ndarray:
        """Return (k,) bool: whether active joints q (k, n) and loop unknowns `states` (k, m) keep all limits."""
        return np.all(self.slacks(q, states) >= -ROUNDING, axis=1)

    def unknowns_at_poses(self, q: Array, Ts: Array) -> tuple[Array, np.ndarray]:
        """Return (loop unknowns (k, m), (k,) bool: whether the tool is at Ts (k, 4, 4)) at active joints q (k, n).

        Joint values can belong to several tool poses. Where the loops close at another pose than the given one, they
        are closed again from the unknowns of the nearest pose that is placed. If there is none, or if this fails, they
        are closed from the unknowns with the tool held at the pose, which depend on no other pose.
        """
        solved = self._solver.forward_many(q)
        states = solved.states
        placed = _are_same_poses(solved.Ts_base_tool, Ts)
        self._place_from_neighbours(q, Ts, states, placed)
        open_poses = np.flatnonzero(~placed)
        if not len(open_poses) or not states.shape[1]:
            return states, placed

        seeds = self._solver.seeds_at(q[open_poses], Ts[open_poses])
        solved_again = self._solver.forward_many(q[open_poses], seeds)
        is_placed = _are_same_poses(solved_again.Ts_base_tool, Ts[open_poses])
        closed = open_poses[is_placed]
        states[closed] = solved_again.states[is_placed]
        placed[closed] = True
        if len(closed):  # they are neighbours of those still open
            self._place_from_neighbours(q, Ts, states, placed)
        return states, placed

    def _place_from_neighbours(self, q: Array, Ts: Array, states: Array, placed: np.ndarray) -> None:
        """Close the loops at poses that are not placed, from the nearest placed pose, as long as this places a pose.

        The loop unknowns `states` (k, m) and `placed` (k,) are changed; for the arguments see `unknowns_at_poses`.
        """
        places = _pose_points(Ts)
        tried_seeds = np.full(len(q), -1)
        while placed.any() and not placed.all():
            placed_poses = np.flatnonzero(placed)
            open_poses = np.flatnonzero(~placed)
            _, nearest = KDTree(places[placed_poses]).query(places[open_poses])
            seeds = placed_poses[nearest]
            # A seed that has failed before would fail again.
            new = seeds != tried_seeds[open_poses]
            open_poses = open_poses[new]
            seeds = seeds[new]
            if not len(open_poses):
                break
            tried_seeds[open_poses] = seeds
            solved_again = self._solver.forward_many(q[open_poses], states[seeds])
            is_placed = _are_same_poses(solved_again.Ts_base_tool, Ts[open_poses])
            closed = open_poses[is_placed]
            states[closed] = solved_again.states[is_placed]
            placed[closed] = True


def _pose_points(Ts: Array) -> Array:
    """Return poses (k, 4, 4) as points (k, 12), whose distances are in m; rotations are scaled by `LENGTH_SCALE`."""
    positions = Ts[:, :3, 3]
    rotations = Ts[:, :3, :3].reshape(-1, 9)
    return np.concatenate([positions, LENGTH_SCALE * rotations], axis=1)


def _are_same_poses(Ts: Array, others: Array) -> np.ndarray:
    """Return (k,) bool: whether two poses (k, 4, 4) are equal within `_SAME_POSE_DISTANCE`; NaN equals nothing."""
    return np.linalg.norm(_pose_points(Ts) - _pose_points(others), axis=1) < _SAME_POSE_DISTANCE
