"""A grabbed point of a mechanism that follows a target along straight lines, by minimum motion of the joints.

The line to the target is followed in steps of fixed length, independent of speed. If the last step of a call is
shorter, the next call computes this step again, so that the result does not depend on the number of calls. Each step
slides along the limits that it meets.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import copy

import numpy as np

from twin.core.spatial import Array
from twin.kinematics.closed_loops.dragging import REACHED_DISTANCE, STRIDE, Dragged, Dragger, GrabbedPoint, Stop
from twin.kinematics.closed_loops.linearizer import LinearizedState

_SMALLEST_GOAL_STEP = 1e-3
"""Step length in m along the line to the target."""

_GOAL_STEP_SHARE = 0.05
"""Step length as a fraction of the distance from the point to its intermediate goal, at least `_SMALLEST_GOAL_STEP`."""

_REACHED_TARGET = 1e-10
"""Distance in m below which the target counts as reached."""

_REACHED_GOAL = 1e-7
"""Distance in m below which an intermediate goal counts as reached."""

_SMALLEST_GOAL_DECREASE = 1e-3
"""Minimum relative decrease of the distance to an intermediate goal in one step."""

_SMALLEST_TARGET_DECREASE = 1e-5
"""Minimum relative decrease of the distance to the target in one step.

A motion ends after a step with a smaller decrease. A point that slides along limits at distance d from the target
approaches the target slowly: the last length x of its path reduces the distance by only x²/2d, which is 1 µm over the
last 45 µm at d = 1 mm.
"""

_DAMPINGS = (1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e2)
"""Damping values relative to the squared norm of the Jacobian; a step uses the first value with which it succeeds."""

_SMALLEST_GAIN = 0.05
"""Minimum singular value (motion of the point per motion of the joints); the point is not moved in directions with a
smaller value."""

_MAX_HALVINGS = 7
"""Maximum number of halvings of a step, if the loops do not close or the step reaches another assembly."""

_MAX_GOAL_STEPS = 4
"""Maximum number of steps to an intermediate goal."""

_MAX_TARGET_STEPS = 25
"""Maximum number of steps to the target."""

_GRADIENT_TOLERANCE = 1e-6
"""Difference of two gradients, whose largest entry is 1, below which only the first of two stops is named."""

_BLOCKING_SHARE = 1e-6
"""Part of the pull on the joints that must point beyond a limit, or the limit does not block the point."""

_APPROACH_SHARE = 1e-9
"""Part of a step by which it moves towards a bound by more than a rounding error."""

_SHORTEST_STEP = 1e-15
"""Step in m that stands for 0 in a quotient."""


class DragGrip:
    """A grabbed point. Its final position does not depend on intermediate targets on the line to the last target."""

    def __init__(self, dragger: Dragger, q: Array, u: Array, point: GrabbedPoint) -> None:
        """Grab a point where the active joints are q (n,) and the loop unknowns u (m,) close the loops."""
        state = dragger.linearize(q, u, *point)
        self._motion = _PointMotion(dragger, state, point)
        self._goal = state.p
        self._target = state.p
        self._last_motion = self._motion

    def to(self, target: Array, seconds: float = np.inf) -> Dragged:
        """Move the point towards a target.

        `target` (3,) is in base, in m. After `seconds` of processor time the motion stops; call again with the same
        target to continue.
        """
        until = time.thread_time() + seconds
        walk = self._motion
        if not np.array_equal(target, self._target):
            # The last step to the former target is dropped, because its length depends on that target.
            self._target = np.array(target, float)
            self._last_motion = walk
        while self._last_motion is walk:
            if not walk.advance(until):
                return walk.result(more=True)
            line = self._target - self._goal
            distance = np.linalg.norm(line)
            # If the point lags far behind the goal, a longer step of the goal hardly changes the direction to it.
            lag = float(np.linalg.norm(self._goal - walk.state.p))
            step = max(_SMALLEST_GOAL_STEP, _GOAL_STEP_SHARE * lag)
            if distance <= step:
                self._last_motion = copy(walk)
                self._last_motion.set_goal(self._target, last=True)
            else:
                self._goal = self._goal + line * (step / distance)
                walk.set_goal(self._goal)
        finished = self._last_motion.advance(until)
        return self._last_motion.result(more=not finished)


class _PointMotion:
    """Steps of a point towards a sequence of goals. A copy can continue independently.

    Attributes:
        dragger: the mechanism.
        state: the current state.
        point: the grabbed point.
        singular, open: why the last step was rejected: the matrix that becomes singular or "", or a loop stays open.
    """

    def __init__(self, dragger: Dragger, state: LinearizedState, point: GrabbedPoint) -> None:
        self.dragger = dragger
        self.state = state
        self.point = point
        self.singular = ""
        self.open = False
        self._passes_limit = False  # whether the last step could not be brought back to a limit that it passes
        self._pull = np.zeros(len(state.q))  # (n,) -J^T (goal - p)
        self._stop_gradients, self._stop_slacks = dragger.gradients_and_slacks(state)
        self._step_share = 1.0  # of the last step that was tried
        self._reached_distance = _REACHED_TARGET
        self._smallest_decrease = _SMALLEST_GOAL_DECREASE
        self._steps_left = 0

    def set_goal(self, goal: Array, last: bool = False) -> None:
        """Start moving to a goal (3,); with `last`, the point approaches the goal as closely as possible."""
        self._goal = goal
        self._start_state = self.state
        self._total_motion = np.zeros(len(self.state.q))  # joint motion since then, scaled to m
        if last:
            self._reached_distance = _REACHED_TARGET
            self._smallest_decrease = _SMALLEST_TARGET_DECREASE
            self._steps_left = _MAX_TARGET_STEPS
        else:
            self._reached_distance = _REACHED_GOAL
            self._smallest_decrease = _SMALLEST_GOAL_DECREASE
            self._steps_left = _MAX_GOAL_STEPS

    def advance(self, until: float) -> bool:
        """Move the point as near to the goal as possible; return False if processor time exceeds `until`."""
        while self._steps_left:
            distance = float(np.linalg.norm(self._goal - self.state.p))
            if distance < self._reached_distance:
                break
            if time.thread_time() > until:
                return False
            self._steps_left -= 1
            motion = self._step(self._start_state, self._total_motion, self._goal)
            if motion is None:
                break
            self._total_motion = self._total_motion + motion
            decrease = distance - np.linalg.norm(self._goal - self.state.p)
            if decrease < self._smallest_decrease * min(distance, _SMALLEST_GOAL_STEP):
                break
        self._steps_left = 0
        return True

    def result(self, more: bool) -> Dragged:
        """Return the state and the bounds that block the point."""
        singular = self.singular
        if self.open:
            singular = self.dragger.nearest_loop(self.state)
        return Dragged(self.state.q, self.state.u, self.stops(), singular, more)

    def _step(self, first: LinearizedState, total: Array, goal: Array) -> Array | None:
        """Move one step nearer to the goal; return the joint motion (n,), scaled to m; None if no step is found."""
        dragger = self.dragger
        state = self.state
        miss = goal - state.p
        # The total joint motion from `first` is minimised. With the mean Jacobian of both ends, the error of this
        # minimum is of second order.
        J_mean = 0.5 * (first.J + state.J) * dragger.scale
        J_now = state.J * dragger.scale
        self._stop_gradients, self._stop_slacks = dragger.gradients_and_slacks(state)
        self.singular = ""
        self.open = False
        self._passes_limit = False
        self._pull = -J_now.T @ miss
        size = float(np.sum(J_mean * J_mean))
        if size < _SMALLEST_GAIN**2:  # no joint moves this point noticeably
            return None

        gradients = self._stop_gradients
        is_near = self._stop_slacks < REACHED_DISTANCE
        is_active = is_near & (gradients @ self._pull > 0)
        damping = _DAMPINGS[0] * size
        motion = np.zeros(len(total))
        # The step slides along the bounds that are active; each pass adds the reached bounds that the step would pass.
        # Each pass adds at least one, so that the loop ends.
        while True:
            projection = np.eye(len(total)) - np.linalg.pinv(gradients[is_active]) @ gradients[is_active]
            U, gains, _ = np.linalg.svd(J_now @ projection)
            strong = U[:, : int(np.sum(gains > _SMALLEST_GAIN))]
            if strong.shape[1] < 3:  # try all directions first; accept only if all are strong afterwards
                motion = np.asarray(projection @ _smallest_motion(J_mean @ projection, miss, total, damping), float)
                is_blocked = is_near & ~is_active & _is_approached(gradients, motion)
                if not is_blocked.any() and self._try_motion(motion, goal, all_directions=True):
                    return motion * self._step_share
            J_strong = strong.T @ J_mean @ projection
            motion = np.asarray(projection @ _smallest_motion(J_strong, strong.T @ miss, total, damping), float)
            is_blocked = is_near & ~is_active & _is_approached(gradients, motion)
            if not is_blocked.any():
                break
            is_active |= is_blocked
        if np.linalg.norm(strong.T @ miss) < self._reached_distance:
            return None

        for relative_damping in _DAMPINGS[1:]:
            for _ in range(_MAX_HALVINGS):
                if self._try_motion(motion, goal):
                    return motion * self._step_share
                if not self._is_rejected:
                    break  # the step makes no progress: change its direction, not its length
                motion = motion * self._step_share / 2
            if self._is_rejected:
                return None
            # Without the total motion, a large damping turns the step towards steepest descent.
            J_strong = strong.T @ J_now @ projection
            damping = relative_damping * size
            motion = projection @ _smallest_motion(J_strong, strong.T @ miss, np.zeros(len(total)), damping)
        return None

    @property
    def _is_rejected(self) -> bool:
        """Whether the mechanism could not do the last step: a loop stays open, is singular, or passes a limit."""
        return bool(self.open or self.singular or self._passes_limit)

    def _try_motion(self, motion: Array, goal: Array, all_directions: bool = False) -> bool:
        """Shorten the step `motion` (n,) in m to the limits, and do it if the distance to the goal then decreases.

        Return whether the step was done. With `all_directions`, only states in which the point can move in all
        directions are accepted.
        """
        dragger = self.dragger
        before = self.state
        self._step_share = self._share_within_limits(motion)
        after, cause = dragger.stepped(before, dragger.scale * (self._step_share * motion), self.point)
        if after is None:
            self.singular = cause
            self.open = not cause
            self._passes_limit = False
            return False
        self.singular = ""
        self.open = False
        after = dragger.brought_back(before, after, self.point)
        self._passes_limit = after is None
        if after is None:
            return False
        if np.linalg.norm(goal - after.p) >= np.linalg.norm(goal - before.p):
            return False
        if all_directions:
            gains = np.linalg.svd(after.J * dragger.scale, compute_uv=False)
            if gains[-1] <= _SMALLEST_GAIN:
                return False
        self.state = after
        return True

    def _share_within_limits(self, motion: Array) -> float:
        """Return the part of a step (n,) in m that reaches no limit, and is no longer than a step may be."""
        longest = max(np.abs(motion).max(initial=0.0), _SHORTEST_STEP)
        part = min(1.0, STRIDE / longest)
        is_approached = _is_approached(self._stop_gradients, motion)
        approach = -(self._stop_gradients @ motion)
        return float(np.min(self._stop_slacks[is_approached] / approach[is_approached], initial=part))

    def stops(self) -> tuple[Stop, ...]:
        """Return the bounds and limits that block the point."""
        dragger = self.dragger
        stops: list[Stop] = []
        gradients: list[Array] = []
        threshold = _BLOCKING_SHARE * np.linalg.norm(self._pull)
        G, distances = dragger.gradients_and_slacks(self.state)
        candidates = (*dragger.bounds, *dragger.linearize.limits)
        for stop, gradient, distance in zip(candidates, G, distances, strict=True):
            blocks = distance < REACHED_DISTANCE and gradient @ self._pull > threshold
            # Pins of a parallelogram reach their limits together with the joint that moves them: name that joint only.
            if blocks and not _is_one_of(gradient, gradients):
                stops.append(stop)
                gradients.append(gradient)
        return tuple(stops)


def _is_one_of(gradient: Array, others: Sequence[Array]) -> bool:
    """Return whether a gradient (n,) is nearly one of some others."""
    for known_gradient in others:
        difference = np.abs(gradient - known_gradient)
        if difference.max() < _GRADIENT_TOLERANCE:
            return True
    return False


def _is_approached(G: Array, motion: Array) -> np.ndarray:
    """Return (b,) bool: whether a step `motion` (n,) moves towards a bound, by more than its rounding error.

    G (b, n) contains the gradients of the distances from the bounds.
    """
    return G @ motion < -_APPROACH_SHARE * np.abs(motion).max(initial=0.0)


def _smallest_motion(J: Array, miss: Array, total: Array, damping: float) -> Array:
    """Return the motion y (n,) that minimises |J y - miss|² + damping |total + y|²."""
    H = J.T @ J + damping * np.eye(J.shape[1])
    g = J.T @ miss - damping * total
    return np.asarray(np.linalg.solve(H, g), float)
