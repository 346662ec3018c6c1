"""Solve the mechanism: poses for joint values, or joint values for a tool pose.

Loops are closed by Gauss-Newton in the least-squares sense. Redundant constraints cause no problem; inconsistent
constraints leave a gap, which is reported per joint. Distant targets are reached by continuation in small steps, so
that the mechanism remains in the assembly mode of the rest poses (the state drawn in the CAD).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.errors import AssemblyError, MechanismError
from twin.core.spatial import Array, Index
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.reference import departing, given, mobility, walk
from twin.reference.loops import LENGTH_SCALE
from twin.reference.mobility import Mobility
from twin.reference.newton import minimise
from twin.reference.posing import posed
from twin.reference.states import Assembly, SolvedSamples
from twin.reference.tree import Tree

_CONTINUATION_STEP = 0.02
"""Largest change (m, rad) of the target in one continuation step."""

_BLOCK = 1000
"""Number of states solved at once: a compromise between speed and memory."""

_MODE_JUMP = 0.5
"""Largest change (m, rad) of a coordinate in one step; a larger change means another assembly mode."""

_AT_ONCE = 32
"""Maximum number of knots (see `walk`) that are solved together if the motion is predictable."""

_PREDICTABLE = 0.2
"""Prediction error, relative to the step, above which samples are solved one by one."""

_DEPARTURES = 2
"""Maximum number of restarts (see `departing`) from states at which the continuation is stuck."""

_THERE = 1e-6
"""Misfit (m, rad) up to which a restart has reached its target."""

_RANK = 1e-6
"""Relative singular value of the tool Jacobian below which the tool cannot move in a direction."""

_FLAT = 1e-9
"""Singular values below this fraction of the largest one count as zero."""

_INDEPENDENT_STEPS = (0.01, 0.1)
"""Largest change per step (m for slides, rad for rotations) if independent states are solved together."""

GAP_TOLERANCE = 1e-3
"""Misfit above which a target is out of reach: the largest of loop gaps in m and errors of the tool pose in m and rad.

One number is the limit of all of them: an error of the tool of 1 mrad counts as much as a gap of 1 mm.
"""

Progress = Callable[[float], None]
"""Progress callback: called with the fraction done."""

Move = Callable[[Array, Array], tuple[Array, Array]]
"""A move: (start (k, nq), targets (k, ...)) -> (states (k, nq), (k,) bool: whether each converged)."""


class ReferenceModel:
    """Independent model of a mechanism, solved with its loops; see `solve`, `solve_pose`, `run` and `run_poses`."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.tree = Tree(mechanism)
        self._active_q = np.array([self.tree.configuration[j.name] for j in mechanism.active], int)
        coupled: set[str] = set()
        for coupling in mechanism.couplings:
            coupled.update(coupling.joints)
        # full turn of each active joint in rad; 0: the joint is no angle, or a turn would change a coupling's sum
        self._turns = np.zeros(len(mechanism.active))
        for i, joint in enumerate(mechanism.active):
            if joint.is_angle and joint.name not in coupled:
                self._turns[i] = 2 * np.pi

    # -- one state ------------------------------------------------------------------------------------

    def solve(self, q: Array, seed: Assembly | None = None) -> Assembly:
        """Return the assembly at active joint values q.

        q (n,) is in m or rad, in the order of `mechanism.active`. The solution continues from `seed`; None: from the
        rest poses (as drawn in the CAD).

        Raises:
            AssemblyError: the loops cannot be closed at q; the error contains the best assembly.
            MechanismError: q has the wrong length or is not finite.
        """
        q = given.one(self.mechanism, q)
        x = self._drive(self._start(seed), q)
        return self.state(x)

    def solve_pose(self, T_base_tool: Array, seed: Assembly | None = None) -> Assembly:
        """Return the assembly with the tool at T_base_tool (4, 4); the active joints are also solved for.

        Raises:
            AssemblyError: no assembly has its tool at this pose; the error contains the best assembly.
            MechanismError: the pose is not rigid.
        """
        if np.ndim(T_base_tool) != 2 or not spatial.is_pose(T_base_tool, 1e-6):
            raise MechanismError("the tool pose is not a rigid (4, 4) pose")
        T = np.asarray(T_base_tool, float)
        x = self._reach(self._start(seed), T, self._move_posed)
        return self.state(x)

    def near_pose(self, X: Array, T_base_tool: Array) -> Array:
        """Return configurations (j, nq) with the tool at T_base_tool (4, 4), by Newton's method from rows of X (k, nq).

        Rows that lead to no such configuration are left out. Unlike `solve_pose`, the tool need not follow a straight
        line to the pose, which a mechanism with fewer than six degrees of freedom cannot; the result may be in another
        assembly mode than its start.
        """
        Ts = np.tile(np.asarray(T_base_tool, float), (len(X), 1, 1))
        configurations, converged = self._move_posed(X, Ts)
        rows = np.flatnonzero(converged)
        at_pose = self._misfits(configurations[rows], Ts[rows]) < GAP_TOLERANCE
        return configurations[rows[at_pose]]

    def home(self) -> Assembly:
        """Return the assembly at the rest poses, with the loops closed."""
        return self.state(self._start(None))

    def state(self, x: Array) -> Assembly:
        """Return the assembly at configuration x (nq,), even if its loops are open."""
        tree = self.tree
        run = self.collect(x[None])
        poses, _ = tree.update(x[None])
        coordinates = {}
        for name, place in tree.configuration.items():
            coordinates[name] = float(x[place])
        for name, values in tree.loops.coordinates(poses).items():
            coordinates[name] = float(values[0])
        q_full = {}
        for joint in self.mechanism.joints:
            if joint.name in coordinates:
                q_full[joint.name] = coordinates[joint.name]
        link_poses = {}
        for body in self.mechanism.bodies:
            link_poses[body.name] = self._link(poses, body.name)[0]
        points = {name: positions[0] for name, positions in run.points.items()}
        gaps = {}
        for name, (offset, tilt) in zip(run.loop_names, run.gaps[0], strict=True):
            gaps[name] = (float(offset), float(tilt))
        return Assembly(run.Ts_base_tool[0], run.q[0], q_full, link_poses, points, gaps, x)

    # -- along samples --------------------------------------------------------------------------------

    def run(self, q: Array, seed: Assembly | None = None, progress: Progress | None = None) -> SolvedSamples:
        """Return the states at active joint values q (k, n), solved along a motion.

        Raises:
            AssemblyError: the loops cannot be closed at a sample; the message names the sample.
        """
        q = given.along(self.mechanism, q)
        states = self._along(q, self._move_driven, seed, progress)
        return self._closed(self.collect(states))

    def follow(self, X: Array, q: Array) -> Array:
        """Return configurations (k, nq) at active joint values q (k, n), each continued from a row of X (k, nq).

        The rows are independent, and solved at once; a row that is far from its target is solved as by `solve`.

        Raises:
            AssemblyError: the loops of a row cannot be closed at its target.
        """
        start = self._unwound(X, q)
        new, converged = self._move_driven(start, q)
        steady = self.jumps(start, new) < _MODE_JUMP
        closed = self._misfits(new, q) < GAP_TOLERANCE
        reached = np.logical_and.reduce([converged, steady, closed])
        for i in np.flatnonzero(~reached):
            new[i] = self._drive(X[i], q[i])
        return new

    def solve_many(self, q: Array, seed: Assembly | None = None) -> SolvedSamples:
        """Return the states at active joint values q (k, n); each row is solved separately, not as part of a motion.

        Every row starts from `seed`, by default from the rest poses.

        Raises:
            AssemblyError: the loops cannot be closed at a row; the message names the row.
        """
        q = np.asarray(q, float)
        start = self._start(seed)
        slide_stride, turn_stride = _INDEPENDENT_STEPS
        stride = np.where([j.is_angle for j in self.mechanism.active], turn_stride, slide_stride)
        blocks = []
        for first in range(0, len(q), _BLOCK):
            goal = q[first : first + _BLOCK]
            X, is_reached = self._in_steps(start, goal, stride)
            # alone, a state can be reached in smaller steps than the others need
            for i in np.flatnonzero(~is_reached):
                try:
                    X[i] = self._drive(start, goal[i])
                except AssemblyError as error:
                    raise AssemblyError(f"at row {first + i}: {error}", error.best, error.gap) from error
            blocks.append(X)
        states = np.concatenate(blocks)
        return self._closed(self.collect(states))

    def _in_steps(self, start: Array, goal: Array, stride: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) at active joint values `goal` (k, n), (k,) bool: whether each was reached).

        All states start from `start` (nq,), and take the same number of equal steps of at most `stride` (n,).
        """
        X = self._unwound(np.tile(start, (len(goal), 1)), goal)
        origin = X[:, self._active_q]
        change = goal - origin
        steps = max(1, int(np.ceil(np.max(np.abs(change) / stride))))
        is_reached = np.ones(len(goal), bool)
        for s in np.linspace(0, 1, steps + 1)[1:]:
            target = origin + s * change
            if s == 1:
                target = goal  # without rounding errors
            new, converged = self._move_driven(X, target)
            steady = self.jumps(X, new) < _MODE_JUMP
            is_reached &= np.logical_and(converged, steady)
            X = new
        return X, is_reached

    def run_poses(
        self,
        Ts_base_tool: Array,
        seed: Assembly | None = None,
        progress: Progress | None = None,
        near: Array | None = None,
    ) -> SolvedSamples:
        """Return the states with the tool at the given poses (k, 4, 4), solved along a motion; see `run`.

        If the mechanism is `redundant` or has auxiliary joints, a pose has many solutions. If `near` (k, n) is given,
        the solution with the smallest motion from these active joint values is returned.
        """
        Ts = np.asarray(Ts_base_tool, float)
        if Ts.ndim != 3 or not len(Ts) or not spatial.is_pose(Ts, 1e-6):
            raise MechanismError(f"the tool poses, of shape {Ts.shape}, are not rigid (k, 4, 4) poses")
        unique = not (self.redundant or self.mechanism.auxiliary)
        if near is None or unique:
            states = self._along(Ts, self._move_posed, seed, progress)
            return self._closed(self.collect(states), Ts)
        states = self._along(np.asarray(near, float), self._move_driven, seed, progress)
        samples = np.arange(len(Ts))
        for block in np.array_split(samples, max(1, len(Ts) // _BLOCK)):
            states[block], _ = self._move_posed(states[block], Ts[block])
        return self._closed(self.collect(states), Ts)

    @cached_property
    def freedoms(self) -> int:
        """Number of independent directions in which the active joints move the tool.

        The number is the largest rank of the tool Jacobian at home and at nearby states, because home may be singular.
        """
        active = self.mechanism.active
        if not active:
            return 0
        size = np.where([j.is_angle for j in active], 0.05, 2e-3)
        displacements = np.random.default_rng(0).uniform(-1, 1, (4, len(active)))
        steps = np.vstack([np.zeros(len(active)), size * displacements])
        home = np.tile(self._home, (len(steps), 1))
        tangents = np.einsum("kij,kj->ki", self.gains(home), steps)
        starts = self.tree.integrate(home, tangents)
        X, _ = minimise(self.tree, starts, self.loops_only, self.tree.passive)
        A, J = self._jacobians(X)
        twists = J @ self.gains(X, A)
        twists[:, :3] /= LENGTH_SCALE
        ranks = np.linalg.matrix_rank(twists, rtol=_RANK)
        return int(ranks.max())

    @property
    def redundant(self) -> bool:
        """Whether the number of active joints that move the tool exceeds `freedoms`: a pose has many solutions."""
        movers = len(self.mechanism.active) - len(self.mechanism.auxiliary)
        return self.freedoms < movers

    def collect(self, states: Array) -> SolvedSamples:
        """Return the `SolvedSamples` for configurations (k, nq)."""
        tree = self.tree
        poses, _ = tree.update(states, closing_only=True)
        loop_values = tree.loops.coordinates(poses)
        passive = {}
        for joint in self.mechanism.passive:
            place = tree.configuration.get(joint.name)
            if place is None:
                passive[joint.name] = loop_values[joint.name]
            else:
                passive[joint.name] = states[:, place]
        points = {}
        for point in self.mechanism.points:
            p_body = np.append(point.p_body, 1.0)
            p_base = self._link(poses, point.body) @ p_body
            points[point.name] = p_base[:, :3]
        gaps = tree.loops.gaps(states, poses)
        q = states[:, self._active_q]
        return SolvedSamples(states, q, tree.tool(poses), passive, points, gaps, tree.loops.names)

    def link_poses(self, states: Array) -> dict[str, Array]:
        """Return {name: T_base_body (k, 4, 4)} of all bodies at configurations (k, nq)."""
        poses, _ = self.tree.update(states)
        return {b.name: self._link(poses, b.name) for b in self.mechanism.bodies}

    def motion(self, states: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """Return (V, dV/dt, G): velocities and accelerations of the tree (k, nv) with closed loops, gains G (k, nv, n).

        V = G qd and dV/dt = G qdd - A_p^+ (dA/dt V). A is the loop Jacobian, A_p its columns for the passive joints.
        The equations of the passive joints are solved in the least-squares sense. `states` are configurations (k, nq);
        qd and qdd (k, n) are rates and accelerations of the active joints.
        """
        A, _ = self._jacobians(states)
        give = self.pseudoinverse_of(A)
        gain = self.gains_of(A, give)
        V = np.einsum("kij,kj->ki", gain, qd)
        change = np.einsum("kij,kj->ki", gain, qdd)
        if self.tree.loops.names:
            drift, _ = self.tree.drift(states, V)
            change[:, self.tree.passive] -= np.einsum("kij,kj->ki", give, drift)
        return V, change, gain

    def rates(self, states: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Return tool twists and accelerations in base at the tool's origin, both (k, 6), linear part first."""
        V, change, _ = self.motion(states, qd, qdd)
        _, J = self._jacobians(states)
        _, drift = self.tree.drift(states, V)
        twists = np.einsum("kij,kj->ki", J, V)
        accelerations = np.einsum("kij,kj->ki", J, change) + drift
        return twists, accelerations

    def loop_jacobian(self, x: Array) -> Array:
        """Return the Jacobian (m, nv) of the loop residuals at configuration x (nq,)."""
        A, _ = self._jacobians(x[None])
        return A[0]

    def mobility(self, x: Array) -> Mobility:
        """Return degrees of freedom and redundant constraints at configuration x (nq,)."""
        A = self.loop_jacobian(x)
        return mobility.count(A, self.tree.loops, self.tree.passive)

    # -- one state or move, for the solutions above ---------------------------------------------------------

    def _closed(self, run: SolvedSamples, Ts: Array | None = None) -> SolvedSamples:
        """Return the run; raise `AssemblyError` at the first sample whose misfit is above `GAP_TOLERANCE`.

        The misfit of a sample is the largest of its loop gaps in m; with poses Ts (k, 4, 4), also of the shift in m and
        the rotation in rad of the tool from its pose.
        """
        misfit = run.gaps[..., 0].max(axis=1, initial=0.0)
        if Ts is not None:
            shift = np.linalg.norm(run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3], axis=1)
            misfit = np.maximum(misfit, shift)
            turn = np.swapaxes(run.Ts_base_tool[:, :3, :3], 1, 2) @ Ts[:, :3, :3]
            misfit = np.maximum(misfit, spatial.rotation_angle(turn))
        is_closed = misfit < GAP_TOLERANCE
        if is_closed.all():
            return run
        k = int(np.argmin(is_closed))
        best = self.state(run.x[k])
        deviation = f"largest loop gap {best.worst_gap / MM:.3g} mm"
        if Ts is not None:
            shift = np.linalg.norm(best.T_base_tool[:3, 3] - Ts[k, :3, 3])
            deviation += f", tool {shift / MM:.3g} mm from its target"
        text = f"at sample {k}: {self.mechanism.name}: out of reach, {deviation}"
        raise AssemblyError(text, best, best.worst_gap)

    def _start(self, seed: Assembly | None) -> Array:
        """Return the configuration of the seed, or, without a seed, of the rest poses with loops closed."""
        if seed is None:
            return self._home
        return seed.x

    @cached_property
    def _home(self) -> Array:
        x = self.tree.start(self.mechanism.rest)
        X, _ = minimise(self.tree, x[None], self.loops_only, self.tree.passive)
        return X[0]

    def loops_only(self, X: Array, _: Index) -> tuple[Array, Array]:
        """Return the loop residuals (k, m) at configurations (k, nq), and their Jacobians (k, m, nv)."""
        poses, J = self.tree.update(X, closing_only=True)
        return self.tree.loops.evaluate(X, poses, J)

    def _drive(self, start: Array, q: Array) -> Array:
        """Return the state at active joint values q (n,), reached from the state `start`."""
        return self._in_turns(start, q, lambda x: self._reach(x, q, self._move_driven))

    def _in_turns(self, start: Array, q: Array, reach: Callable[[Array], Array]) -> Array:
        """Return `reach(x)`, where x is `start` with driven joints changed by full turns towards q (n,).

        Full turns change no pose. First, x is the result of `_unwound` with its default; if `reach` fails for this x,
        the number of turns is the one that brings x nearest to q.

        Raises:
            AssemblyError: `reach` fails for both x.
        """
        direct = self._unwound(start, q)
        nearest = self._unwound(start, q, np.rint)
        try:
            return reach(direct)
        except AssemblyError:
            if np.array_equal(direct, nearest):
                raise
            return reach(nearest)

    def _unwound(self, x: Array, q: Array, turns: Callable[[Array], Array] = np.trunc) -> Array:
        """Return configurations (..., nq) at the same poses, with driven joints nearer to q (..., n) by full turns.

        By default, only differences of a full turn or more are reduced: a shorter motion may lead through angles that
        the mechanism cannot reach. Joints of couplings are not changed, because a full turn changes the coupling's sum.
        """
        x = x.copy()
        remainder = q - x[..., self._active_q]
        # a joint that may not turn (`_turns` is 0) keeps 0 turns
        past = np.zeros(q.shape)
        np.divide(remainder, self._turns, out=past, where=self._turns > 0)
        x[..., self._active_q] += self._turns * turns(past)
        return x

    def _move_driven(self, X: Array, q: Array) -> tuple[Array, Array]:
        """Return (states near X (k, nq) with active joint values q (k, n), (k,) bool: whether each converged)."""
        X = X.copy()
        X[:, self._active_q] = q
        return minimise(self.tree, X, self.loops_only, self.tree.passive)

    def _move_posed(self, X: Array, Ts: Array) -> tuple[Array, Array]:
        """Return (states near X (k, nq) with the tool at poses Ts (k, 4, 4), (k,) bool: whether each converged)."""
        every = np.arange(self.tree.model.nv)
        return minimise(self.tree, X, posed(self.tree, Ts), every)

    def _reach(self, x: Array, target: Array, move: Move) -> Array:
        """Return the configuration at the target, reached from x in steps of at most `_MODE_JUMP` in each coordinate.

        Raises:
            AssemblyError: the motion stops before the target.
        """
        start = self._target_at(x, target)
        reached, misfit = self._continued(x, start, target, move)
        # The misfit is large, for example, with collinear links.
        if misfit > _THERE and misfit > 2 * self._misfits(x[None], start[None])[0] + _THERE:
            departure = self._depart(reached, target, move)
            if departure is not None:
                return departure
        return reached

    def _continued(self, x: Array, start: Array, target: Array, move: Move) -> tuple[Array, float]:
        """Return (configuration at the target, its misfit), continued from configuration x at the target `start`.

        A step that fails is halved, and one that succeeds is followed by one of twice its size. Where even the smallest
        step fails, the motion continues from a departure (see `_depart`), at most `_DEPARTURES` times.

        Raises:
            AssemblyError: the motion stops before the target.
        """
        misfit = np.inf
        count = max(1, int(np.ceil(walk.distance(start, target) / _CONTINUATION_STEP)))
        stride = 1.0 / count
        smallest = stride / 256
        step = stride
        departures = 0
        s = 0.0
        while s < 1:
            ahead = s + step
            if ahead > 1 - 1e-9:  # not a last step of the size of rounding errors
                ahead = 1.0
            goal = walk.between(start, target, ahead)[None]
            X, converged = move(x[None], goal)
            misfit = np.inf
            if converged[0]:
                misfit = float(self._misfits(X, goal)[0])
            if misfit < GAP_TOLERANCE and self.jumps(x[None], X)[0] < _MODE_JUMP:
                x = X[0]
                s = ahead
                step = 2 * step
                continue
            step /= 2
            if step >= smallest:
                continue
            ahead = min(1.0, s + stride)
            departure = None
            if departures < _DEPARTURES:
                departure = self._depart(x, walk.between(start, target, ahead), move)
            if departure is None:
                best = self.state(X[0] if converged[0] else x)
                raise self._unreached(s, best)
            departures += 1
            x = departure
            s = ahead
            step = stride
            misfit = 0.0  # a departure's misfit is below `_THERE`
        return x, misfit

    def _target_at(self, x: Array, target: Array) -> Array:
        """Return the active joint values (n,) or the tool pose (4, 4) at configuration x, like `target`."""
        if target.ndim == 1:
            return x[self._active_q]
        poses, _ = self.tree.update(x[None])
        return self.tree.tool(poses)[0]

    def _unreached(self, s: float, best: Assembly) -> AssemblyError:
        """Return the error of a motion that stops at the fraction s of its way, in the assembly `best`."""
        return AssemblyError(
            f"{self.mechanism.name}: the mechanism cannot be assembled at the target: it moves "
            f"{100 * s:.0f} % of the way, then loops do not close, the tool misses its pose, or the assembly "
            f"mode changes (largest loop gap {best.worst_gap / MM:.3g} mm)",
            best,
            best.worst_gap,
        )

    def _depart(self, x: Array, target: Array, move: Move) -> Array | None:
        """Return a state at the target, reached by random steps from x (where Newton steps fail); None if not found."""

        def distance(new: Array) -> float:
            jump = self.jumps(x[None], new[None])[0]
            if jump < _MODE_JUMP and self._misfits(new[None], target[None])[0] < _THERE:
                return jump
            return np.inf

        def move_all(X: Array) -> Array:
            targets = np.array([target] * len(X))
            states, _ = move(X, targets)
            return states

        return departing.depart(self.tree, x, move_all, distance)

    def _misfits(self, X: Array, targets: Array) -> Array:
        """Return the misfit (k,): the largest loop gap in m; for tool poses, the maximum of gap and pose error."""
        poses, _ = self.tree.update(X, closing_only=True)
        misfit = self.tree.loops.gaps(X, poses)[..., 0].max(axis=1, initial=0.0)
        if targets.ndim == 3:
            Ts = self.tree.tool(poses)
            errors = [walk.distance(T, target) for T, target in zip(Ts, targets, strict=True)]
            misfit = np.maximum(misfit, errors)
        return misfit

    def jumps(self, X0: Array, X1: Array) -> Array:
        """Return the largest change (k,) in m or rad of any coordinate between configurations (k, nq)."""
        moved = [pin.difference(self.tree.model, a, b) for a, b in zip(X0, X1, strict=True)]
        changes = np.abs(np.array(moved).reshape(len(X0), -1))
        return changes.max(axis=1, initial=0.0)

    def _along(self, targets: Array, move: Move, seed: Assembly | None, progress: Progress | None) -> Array:
        """Return the states of all samples: first the knots are solved in order, then all samples from guesses.

        The knots determine the assembly mode. The guesses are interpolated between knots, and are so accurate that one
        or two iterations suffice, for all samples at once.
        """
        coarse = walk.knots(targets)
        start = self._start(seed)

        def solved_from(x: Array) -> Array:
            return self._knots(coarse, targets, move, x, progress)

        if targets.ndim == 2:
            first = targets[0]
            knots = self._in_turns(start, first, solved_from)
        else:
            knots = solved_from(start)
        states = self._between(coarse, knots, targets)
        samples = np.arange(len(targets))
        for block in np.array_split(samples, max(1, len(targets) // _BLOCK)):
            solved, converged = move(states[block], targets[block])
            if not converged.all():
                k = int(np.argmin(converged))
                best = self.state(solved[k])
                raise AssemblyError(f"at sample {block[k]}: the solver did not converge", best, best.worst_gap)
            states[block] = solved
            if progress is not None:
                # the knots are the first half of the work
                progress(0.5 + (block[-1] + 1) / len(targets) / 2)
        return states

    def _knots(self, coarse: Index, targets: Array, move: Move, start: Array, progress: Progress | None) -> Array:
        """Return the states of the samples `coarse`, solved in order; predictable samples are solved together."""
        knots = np.zeros((len(coarse), self.tree.model.nq))
        most = 1
        if targets.ndim == 2:
            most = _AT_ONCE  # only joint values have a tangent for predictions
        x = start
        i = 0  # number of knots already solved
        many = 1
        while i < len(coarse):
            ks = coarse[i : i + many]
            X, is_predictable = self._knots_at(x, targets[ks], move)
            if is_predictable.all():
                count = len(ks)
                many = min(2 * many, most)
            else:
                count = int(np.argmin(is_predictable))
                many = max(1, count)
            if count == 0 and len(ks) == 1:
                first = 0
                if i:
                    first = coarse[i - 1] + 1
                # not even one knot in one step: sample by sample
                for j in range(first, ks[0] + 1):
                    try:
                        x = self._reach(x, targets[j], move)
                    except AssemblyError as error:
                        raise AssemblyError(f"at sample {j}: {error}", error.best, error.gap) from error
                X = x[None]
                count = 1
            if count:
                knots[i : i + count] = X[:count]
                x = X[count - 1]
                i += count
            if progress is not None:
                progress(i / len(coarse) / 2)
        return knots

    def _knots_at(self, x: Array, targets: Array, move: Move) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) at the targets, predicted from configuration x, (k,) bool: whether each is valid)."""
        guess = x[None]
        if len(targets) > 1:
            guess = self._foreseen(x, targets)
        X, converged = move(guess, targets)
        before = np.concatenate([x[None], X[:-1]])
        steady = self.jumps(before, X) <= _MODE_JUMP
        if len(targets) > 1:
            predicted = self._surprise(x, guess, X) < _PREDICTABLE
            steady = np.logical_and(steady, predicted)
        closed = self._misfits(X, targets) <= GAP_TOLERANCE
        return X, np.logical_and.reduce([converged, steady, closed])

    def _foreseen(self, x: Array, q: Array) -> Array:
        """Return first guesses (k, nq) for active joint values q (k, n), along the tangent at configuration x."""
        gain = self.gains(x[None])[0]
        change = q - x[self._active_q]
        starts = np.tile(x, (len(q), 1))
        return self.tree.integrate(starts, change @ gain.T)

    def _surprise(self, x: Array, guess: Array, X: Array) -> Array:
        """Return the prediction error (k,) of states X (k, nq): distance from the guess, divided by distance from x."""
        error = self.jumps(guess, X)
        step = self.jumps(np.tile(x, (len(X), 1)), X)
        return error / np.maximum(step, 1e-9)

    def _between(self, at: Index, knots: Array, targets: Array) -> Array:
        """Return first guesses (k, nq) for all samples from the solved states (j, nq) at samples `at`.

        For driven motions, the constraint Jacobian gives the slopes of all joints from the slopes of the active joints.
        Where a bang-bang acceleration switches, the interpolated active joints have an error. This error is removed,
        and the Jacobian corrects the passive joints accordingly. One iteration then suffices for nearly all samples.
        """
        if targets.ndim == 3 or len(at) < 2:
            slopes = np.zeros_like(knots)
            if len(at) > 1:
                slopes = np.gradient(knots, at.astype(float), axis=0)
            states = walk.interpolate(at, knots, slopes, len(targets))
            return self.tree.normalise(states)
        gain = self.gains(knots)
        driven_rate = np.gradient(targets, axis=0)[at]
        rate = np.einsum("kij,kj->ki", gain, driven_rate)
        # central difference: the slope of a quaternion is not its velocity
        tiny = 1e-3
        ahead = self.tree.integrate(knots, tiny * rate)
        behind = self.tree.integrate(knots, -tiny * rate)
        slopes = (ahead - behind) / (2 * tiny)
        states = walk.interpolate(at, knots, slopes, len(targets))
        states = self.tree.normalise(states)
        midway = 0.5 * (at[1:] + at[:-1])
        nearest = np.searchsorted(midway, np.arange(len(targets)))
        missed = targets - states[:, self._active_q]
        correction = np.einsum("kij,kj->ki", gain[nearest], missed)
        return self.tree.integrate(states, correction)

    def tool_jacobians(self, states: Array) -> Array:
        """Return the Jacobians (k, 6, n) from rates of the active joints to the tool twist in base, linear rows first.

        `states` (k, nq) are configurations with closed loops.
        """
        A, J = self._jacobians(states)
        return J @ self.gains(states, A)

    def gains(self, states: Array, A: Array | None = None) -> Array:
        """Return the rates (k, nv, n) of tree joints per rate of each active joint; passive rates by least squares."""
        if A is None:
            A, _ = self._jacobians(states)
        return self.gains_of(A, self.pseudoinverse_of(A))

    def gains_of(self, A: Array, give: Array) -> Array:
        """Return the rates of `gains` for loop Jacobians A (k, m, nv) and their pseudoinverses (k, np, m)."""
        active = self.tree.active
        passive = self.tree.passive
        gain = np.zeros((len(A), self.tree.model.nv, len(active)))
        gain[:, active] = np.eye(len(active))
        gain[:, passive] = -give @ A[:, :, active]
        return gain

    def pseudoinverse_of(self, A: Array) -> Array:
        """Return the pseudoinverse (k, np, m): change of the passive joints per change of the loop residual."""
        passive = self.tree.passive
        if not A.shape[1] or not len(passive):
            return np.zeros((len(A), len(passive), A.shape[1]))
        inverse = np.linalg.pinv(A[:, :, passive], rcond=_FLAT)
        return np.asarray(inverse, float)

    def _link(self, poses: Array, body: str) -> Array:
        number, T_joint_body = self.tree.body(body)
        return poses[:, number] @ T_joint_body

    def _jacobians(self, X: Array) -> tuple[Array, Array]:
        """Return loop Jacobians (k, m, nv) and tool Jacobians (k, 6, nv)."""
        poses, J = self.tree.update(X, closing_only=True)
        _, A = self.tree.loops.evaluate(X, poses, J)
        return A, self.tree.tool_jacobian(poses, J)
