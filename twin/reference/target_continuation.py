"""Solve a mechanism with loops at a target by continuation: in small steps, which stay in one assembly mode.

A target is an array: the values (n,) of the active joints in m or rad, or a pose (4, 4) of the tool in base. Several
targets are stacked along a first axis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.errors import AssemblyError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.reference import singular_departure
from twin.reference.newton import minimise
from twin.reference.pose_residuals import loops_only, posed
from twin.reference.states import Assembly, assembly_at
from twin.reference.tree import Tree

GAP_TOLERANCE = 1e-3
"""Misfit above which a target is out of reach: the largest of loop gaps in m and errors of the tool pose in m and rad.

One number is the limit of all of them: an error of the tool of 1 mrad counts as much as a gap of 1 mm.
"""

MODE_JUMP = 0.5
"""Largest change (m, rad) of a coordinate in one step; a larger change means another assembly mode."""

_TARGET_STEP = 0.02
"""Largest change (m, rad) of the target in the first step of a continuation."""

_SMALLEST_PART = 1 / 256
"""Smallest step of a continuation, as a part of its first one: eight halvings."""

_LAST_PART = 1e-9
"""Part of the whole motion that is no step of its own: it would be as small as rounding errors."""

_DEPARTURES = 2
"""Maximum number of restarts (see `singular_departure`) from states at which a continuation is stuck."""

_DEPARTURE_MISFIT = 1e-6
"""Misfit (m, rad) up to which a restart has reached its target."""


class TargetContinuation:
    """Moves the configurations (nq,) of a mechanism's tree to targets, with the loops closed."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        mechanism = tree.mechanism
        coupled: set[str] = set()
        for coupling in mechanism.couplings:
            coupled.update(coupling.joints)
        # full turn of each active joint in rad; 0: the joint is no angle, or a turn would change a coupling's sum
        self._turns = np.zeros(len(mechanism.active))
        for i, joint in enumerate(mechanism.active):
            if joint.is_angle and joint.name not in coupled:
                self._turns[i] = 2 * np.pi

    # -- many independent states, in one step --------------------------------------------------------------

    def move(self, X: Array, targets: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) near X (k, nq) at k targets, (k,) bool: whether each converged), in one step.

        With joint values as targets, the active joints take them at once, and the others close the loops; with tool
        poses, all joints move.
        """
        tree = self.tree
        if targets.ndim == 2:
            X = X.copy()
            X[:, tree.active_places] = targets
            return minimise(tree, X, loops_only(tree), tree.passive)
        every = np.arange(tree.model.nv)
        return minimise(tree, X, posed(tree, targets), every)

    def misfits(self, X: Array, targets: Array) -> Array:
        """Return the misfit (k,) of X (k, nq): the largest loop gap in m; for tool poses, also the pose error."""
        tree = self.tree
        poses, _ = tree.update(X, closing_only=True)
        misfit = tree.loops.gaps(X, poses)[..., 0].max(axis=1, initial=0.0)
        if targets.ndim == 3:
            Ts = tree.tool(poses)
            errors = [distance(T, target) for T, target in zip(Ts, targets, strict=True)]
            misfit = np.maximum(misfit, errors)
        return misfit

    def jumps(self, X0: Array, X1: Array) -> Array:
        """Return the largest change (k,) in m or rad of any coordinate between configurations (k, nq)."""
        differences = [pin.difference(self.tree.model, a, b) for a, b in zip(X0, X1, strict=True)]
        changes = np.abs(np.array(differences).reshape(len(X0), -1))
        return changes.max(axis=1, initial=0.0)

    def unwound(self, x: Array, q: Array, turns: Callable[[Array], Array] = np.trunc) -> Array:
        """Return configurations (..., nq) at the same poses, with driven joints nearer to q (..., n) by full turns.

        By default, only differences of a full turn or more are reduced: a shorter motion may lead through angles that
        the mechanism cannot reach. Joints of couplings are not changed, because a full turn changes the coupling's sum.
        """
        x = x.copy()
        places = self.tree.active_places
        remainder = q - x[..., places]
        # a joint that may not turn (`_turns` is 0) keeps 0 turns
        past = np.zeros(q.shape)
        np.divide(remainder, self._turns, out=past, where=self._turns > 0)
        x[..., places] += self._turns * turns(past)
        return x

    # -- one state, in as many steps as needed -------------------------------------------------------------

    def driven(self, start: Array, q: Array) -> Array:
        """Return the configuration (nq,) at active joint values q (n,), reached from `start` (nq,).

        Raises:
            AssemblyError: the motion stops before q.
        """
        return self.in_turns(start, q, lambda x: self.reached(x, q))

    def in_turns(self, start: Array, q: Array, reach: Callable[[Array], Array]) -> Array:
        """Return `reach(x)`, where x is `start` with driven joints changed by full turns towards q (n,).

        Full turns change no pose. First, x is the result of `unwound` with its default; if `reach` fails for this x,
        the number of turns is the one that brings x nearest to q.

        Raises:
            AssemblyError: `reach` fails for both x.
        """
        direct = self.unwound(start, q)
        nearest = self.unwound(start, q, np.rint)
        try:
            return reach(direct)
        except AssemblyError:
            if np.array_equal(direct, nearest):
                raise
            return reach(nearest)

    def reached(self, x: Array, target: Array) -> Array:
        """Return the configuration at the target, reached from x in steps of at most `MODE_JUMP` in each coordinate.

        Raises:
            AssemblyError: the motion stops before the target.
        """
        start = self._target_at(x, target)
        end, misfit = self._continued(x, start, target)
        if misfit <= _DEPARTURE_MISFIT:
            return end
        # The misfit is large, for example, with collinear links.
        misfit_at_start = self.misfits(x[None], start[None])[0]
        if misfit > 2 * misfit_at_start + _DEPARTURE_MISFIT:
            departure = self._departure(end, target)
            if departure is not None:
                return departure
        return end

    def _continued(self, x: Array, start: Array, target: Array) -> tuple[Array, float]:
        """Return (configuration at the target, its misfit), continued from configuration x at the target `start`.

        A step that fails is halved, and one that succeeds is followed by one of twice its size. Where even the smallest
        step fails, the motion continues from a departure (see `_departure`), at most `_DEPARTURES` times.

        Raises:
            AssemblyError: the motion stops before the target.
        """
        misfit = np.inf
        count = max(1, int(np.ceil(distance(start, target) / _TARGET_STEP)))
        stride = 1.0 / count
        smallest = stride * _SMALLEST_PART
        step = stride
        departures = 0
        s = 0.0  # part of the motion that lies behind
        while s < 1:
            ahead = s + step
            if ahead > 1 - _LAST_PART:
                ahead = 1.0
            goal = between(start, target, ahead)[None]
            X, converged = self.move(x[None], goal)
            misfit = np.inf
            if converged[0]:
                misfit = float(self.misfits(X, goal)[0])
            if misfit < GAP_TOLERANCE and self.jumps(x[None], X)[0] < MODE_JUMP:
                x = X[0]
                s = ahead
                step = 2 * step
                continue
            step /= 2
            if step >= smallest:
                continue
            # stuck: a departure aims one stride ahead, beyond what stops the motion
            ahead = min(1.0, s + stride)
            departure = None
            if departures < _DEPARTURES:
                departure = self._departure(x, between(start, target, ahead))
            if departure is None:
                best = x
                if converged[0]:
                    best = X[0]
                raise self._unreached(s, assembly_at(self.tree, best))
            departures += 1
            x = departure
            s = ahead
            step = stride
            misfit = 0.0  # a departure's misfit is below `_DEPARTURE_MISFIT`
        return x, misfit

    def _target_at(self, x: Array, target: Array) -> Array:
        """Return the active joint values (n,) or the tool pose (4, 4) at configuration x, like `target`."""
        if target.ndim == 1:
            return x[self.tree.active_places]
        poses, _ = self.tree.update(x[None])
        return self.tree.tool(poses)[0]

    def _unreached(self, s: float, best: Assembly) -> AssemblyError:
        """Return the error of a motion that stops at the fraction s of its way, in the assembly `best`."""
        return AssemblyError(
            f"{self.tree.mechanism.name}: the mechanism cannot be assembled at the target: it moves "
            f"{100 * s:.0f} % of the way, then loops do not close, the tool misses its pose, or the assembly "
            f"mode changes (largest loop gap {best.worst_gap / MM:.3g} mm)",
            best,
            best.worst_gap,
        )

    def _departure(self, x: Array, target: Array) -> Array | None:
        """Return a state at the target, reached by random steps from x (where Newton steps fail); None if not found."""

        def distance_of(new: Array) -> float:
            jump = self.jumps(x[None], new[None])[0]
            if jump < MODE_JUMP and self.misfits(new[None], target[None])[0] < _DEPARTURE_MISFIT:
                return jump
            return np.inf

        def move_all(X: Array) -> Array:
            targets = np.array([target] * len(X))
            states, _ = self.move(X, targets)
            return states

        return singular_departure.depart(self.tree, x, move_all, distance_of)


def distance(a: Array, b: Array) -> float:
    """Return the distance of two targets in m or rad.

    The distance of joint values is the largest difference; the distance of poses is the larger of the translation and
    the rotation angle.
    """
    if a.ndim == 1:
        return float(np.abs(a - b).max(initial=0.0))
    return max(spatial.pose_difference(a, b))


def between(a: Array, b: Array, s: float) -> Array:
    """Return the target at fraction s from a to b; position and rotation of a pose are interpolated separately."""
    if s == 1:
        return b
    if a.ndim == 1:
        return a + s * (b - a)
    R_a = a[:3, :3]
    p_a = a[:3, 3]
    turn = spatial.log_so3(b[:3, :3] @ R_a.T)
    R = spatial.exp_so3(s * turn) @ R_a
    p = p_a + s * (b[:3, 3] - p_a)
    return spatial.pose(R, p)
