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
from twin.reference.states import Assembly, Run
from twin.reference.tree import Tree

_STRIDE = 0.02
"""Largest change (m, rad) of the target in one continuation step."""

_BLOCK = 1000
"""Number of states solved at once: a compromise between speed and memory."""

_JUMP = 0.5
"""Largest change (m, rad) of a coordinate in one step; a larger change means another assembly mode."""

_AT_ONCE = 32
"""Maximum number of knots (see `walk`) that are solved together if the motion is predictable."""

_SURPRISE = 0.2
"""Prediction error, relative to the step, above which samples are solved one by one."""

_DEPARTURES = 2
"""Maximum number of restarts (see `departing`) from states at which the continuation is stuck."""

_THERE = 1e-6
"""Misfit (m, rad) up to which a restart has reached its target."""

_RANK = 1e-6
"""Relative singular value of the tool Jacobian below which the tool cannot move in a direction."""

_FLAT = 1e-9
"""Singular values below this fraction of the largest one count as zero."""

_STRIDES = (0.01, 0.1)
"""Largest change per step (m for slides, rad for rotations) if independent states are solved together."""

GAP_TOLERANCE = 1e-3
"""Loop gap in m above which a target is out of reach."""

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
        coupled = {name for coupling in mechanism.couplings for name in coupling.joints}
        self._turns = np.array([2 * np.pi * (j.is_angle and j.name not in coupled) for j in mechanism.active])

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
        return self.state(self._drive(self._start(seed), q))

    def solve_pose(self, T_base_tool: Array, seed: Assembly | None = None) -> Assembly:
        """Return the assembly with the tool at T_base_tool (4, 4); the active joints are also solved for.

        Raises:
            AssemblyError: no assembly has its tool at this pose; the error contains the best assembly.
            MechanismError: the pose is not rigid.
        """
        if np.ndim(T_base_tool) != 2 or not spatial.is_pose(T_base_tool, 1e-6):
            raise MechanismError("the tool pose is not a rigid (4, 4) pose")
        return self.state(self._reach(self._start(seed), np.asarray(T_base_tool, float), self._move_posed))

    def home(self) -> Assembly:
        """Return the assembly at the rest poses, with the loops closed."""
        return self.state(self._start(None))

    def state(self, x: Array) -> Assembly:
        """Return the assembly at configuration x (nq,), even if its loops are open."""
        run, (poses, _) = self.collect(x[None]), self.tree.update(x[None])
        q_full = {n: float(x[i]) for n, i in self.tree.configuration.items()}
        q_full |= {n: float(v[0]) for n, v in self.tree.loops.coordinates(poses).items()}
        return Assembly(
            run.Ts_base_tool[0],
            run.q[0],
            {j.name: q_full[j.name] for j in self.mechanism.joints if j.name in q_full},
            {b.name: self._link(poses, b.name)[0] for b in self.mechanism.bodies},
            {n: p[0] for n, p in run.points.items()},
            {n: (float(g[0]), float(g[1])) for n, g in zip(run.loop_names, run.gaps[0], strict=True)},
            x,
        )

    # -- along samples --------------------------------------------------------------------------------

    def run(self, q: Array, seed: Assembly | None = None, progress: Progress | None = None) -> Run:
        """Return the states at active joint values q (k, n), solved along a motion.

        Raises:
            AssemblyError: the loops cannot be closed at a sample; the message names the sample.
        """
        q = given.along(self.mechanism, q)
        return self._closed(self.collect(self._along(q, self._move_driven, seed, progress)))

    def solve_many(self, q: Array, seed: Assembly | None = None) -> Run:
        """Return the states at active joint values q (k, n); each row is solved separately, not as part of a motion.

        Every row starts from `seed`, by default from the rest poses.

        Raises:
            AssemblyError: the loops cannot be closed at a row; the message names the row.
        """
        q = np.asarray(q, float)
        start = self._start(seed)
        scale = np.where([j.is_angle for j in self.mechanism.active], _STRIDES[1], _STRIDES[0])
        blocks = []
        for first in range(0, len(q), _BLOCK):
            goal = q[first : first + _BLOCK]
            X = self._unwound(np.tile(start, (len(goal), 1)), goal)
            origin = X[:, self._active_q]
            good = np.ones(len(goal), bool)
            steps = max(1, int(np.ceil(np.max(np.abs(goal - origin) / scale))))
            for s in np.linspace(0, 1, steps + 1)[1:]:
                new, converged = self._move_driven(X, goal if s == 1 else origin + s * (goal - origin))
                good &= np.logical_and(converged, self.jumps(X, new) < _JUMP)
                X = new
            for i in np.flatnonzero(~good):
                try:
                    X[i] = self._drive(start, goal[i])
                except AssemblyError as error:
                    raise AssemblyError(f"at row {first + i}: {error}", error.best, error.gap) from error
            blocks.append(X)
        return self._closed(self.collect(np.concatenate(blocks)))

    def run_poses(
        self,
        Ts_base_tool: Array,
        seed: Assembly | None = None,
        progress: Progress | None = None,
        near: Array | None = None,
    ) -> Run:
        """Return the states with the tool at the given poses (k, 4, 4), solved along a motion; see `run`.

        If the mechanism is `redundant` or has auxiliary joints, a pose has many solutions. If `near` (k, n) is given,
        the solution with the smallest motion from these active joint values is returned.
        """
        Ts = np.asarray(Ts_base_tool, float)
        if Ts.ndim != 3 or not len(Ts) or not spatial.is_pose(Ts, 1e-6):
            raise MechanismError(f"the tool poses, of shape {Ts.shape}, are not rigid (k, 4, 4) poses")
        if near is None or not (self.redundant or self.mechanism.auxiliary):
            return self._closed(self.collect(self._along(Ts, self._move_posed, seed, progress)), Ts)
        states = self._along(np.asarray(near, float), self._move_driven, seed, progress)
        for block in np.array_split(np.arange(len(Ts)), max(1, len(Ts) // _BLOCK)):
            states[block] = self._move_posed(states[block], Ts[block])[0]
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
        steps = np.vstack([np.zeros(len(active)), size * np.random.default_rng(0).uniform(-1, 1, (4, len(active)))])
        home = np.tile(self._home, (len(steps), 1))
        x = self.tree.integrate(home, np.einsum("kij,kj->ki", self.gains(home), steps))
        x, _ = minimise(self.tree, x, self.loops_only, self.tree.passive)
        A, J = self._jacobians(x)
        twists = J @ self.gains(x, A)
        twists[:, :3] /= LENGTH_SCALE
        return int(np.linalg.matrix_rank(twists, rtol=_RANK).max())

    @property
    def redundant(self) -> bool:
        """Whether the number of active joints that move the tool exceeds `freedoms`: a pose has many solutions."""
        return self.freedoms < len(self.mechanism.active) - len(self.mechanism.auxiliary)

    def collect(self, states: Array) -> Run:
        """Return the `Run` for configurations (k, nq)."""
        poses, _ = self.tree.update(states, closing_only=True)
        passive = {}
        loop_values = self.tree.loops.coordinates(poses)
        for joint in self.mechanism.passive:
            i = self.tree.configuration.get(joint.name)
            passive[joint.name] = states[:, i] if i is not None else loop_values[joint.name]
        points = {p.name: (self._link(poses, p.body) @ np.append(p.p_body, 1.0))[:, :3] for p in self.mechanism.points}
        gaps = self.tree.loops.gaps(states, poses)
        return Run(
            states, states[:, self._active_q], self.tree.tool(poses), passive, points, gaps, self.tree.loops.names
        )

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
        gain = self.gains(states, A)
        V, change = (np.einsum("kij,kj->ki", gain, rates) for rates in (qd, qdd))
        if self.tree.loops.names:
            change[:, self.tree.passive] -= np.einsum("kij,kj->ki", self._give(A), self.tree.drift(states, V)[0])
        return V, change, gain

    def rates(self, states: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Return tool twists and accelerations in base at the tool's origin, both (k, 6), linear part first."""
        V, change, _ = self.motion(states, qd, qdd)
        _, J = self._jacobians(states)
        return np.einsum("kij,kj->ki", J, V), np.einsum("kij,kj->ki", J, change) + self.tree.drift(states, V)[1]

    def loop_jacobian(self, x: Array) -> Array:
        """Return the Jacobian (m, nv) of the loop residuals at configuration x (nq,)."""
        return self._jacobians(x[None])[0][0]

    def mobility(self, x: Array) -> Mobility:
        """Return degrees of freedom and redundant constraints at configuration x (nq,)."""
        return mobility.count(self.loop_jacobian(x), self.tree.loops, self.tree.passive)

    # -- internals ---------------------------------------------------------------------------------------

    def _closed(self, run: Run, Ts: Array | None = None) -> Run:
        """Return the run; raise `AssemblyError` at the first sample with an open loop or a missed tool pose."""
        misfit = run.gaps[..., 0].max(axis=1, initial=0.0)
        if Ts is not None:
            misfit = np.maximum(misfit, np.linalg.norm(run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3], axis=1))
            turn = np.swapaxes(run.Ts_base_tool[:, :3, :3], 1, 2) @ Ts[:, :3, :3]
            misfit = np.maximum(misfit, spatial.rotation_angle(turn))
        if not (misfit < GAP_TOLERANCE).all():
            k = int(np.argmin(misfit < GAP_TOLERANCE))
            best = self.state(run.x[k])
            left = f"largest loop gap {best.worst_gap / MM:.3g} mm"
            if Ts is not None:
                left += f", tool {np.linalg.norm(best.T_base_tool[:3, 3] - Ts[k, :3, 3]) / MM:.3g} mm from its target"
            raise AssemblyError(f"at sample {k}: {self.mechanism.name}: out of reach, {left}", best, best.worst_gap)
        return run

    def _start(self, seed: Assembly | None) -> Array:
        """Return the configuration of the seed, or, without a seed, of the rest poses with loops closed."""
        return seed.x if seed is not None else self._home

    @cached_property
    def _home(self) -> Array:
        X = self.tree.start(self.mechanism.rest)[None]
        return minimise(self.tree, X, self.loops_only, self.tree.passive)[0][0]

    def loops_only(self, X: Array, _: Index) -> tuple[Array, Array]:
        """Return the loop residuals (k, m) at configurations (k, nq), and their Jacobians (k, m, nv)."""
        return self.tree.loops.evaluate(X, *self.tree.update(X, closing_only=True))

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
        direct, nearest = self._unwound(start, q), self._unwound(start, q, np.rint)
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
        past = np.divide(q - x[..., self._active_q], self._turns, out=np.zeros(q.shape), where=self._turns > 0)
        x[..., self._active_q] += self._turns * turns(past)
        return x

    def _move_driven(self, X: Array, q: Array) -> tuple[Array, Array]:
        """Return (states near X (k, nq) with active joint values q (k, n), (k,) bool: whether each converged)."""
        X = X.copy()
        X[:, self._active_q] = q
        return minimise(self.tree, X, self.loops_only, self.tree.passive)

    def _move_posed(self, X: Array, Ts: Array) -> tuple[Array, Array]:
        """Return (states near X (k, nq) with the tool at poses Ts (k, 4, 4), (k,) bool: whether each converged)."""
        return minimise(self.tree, X, posed(self.tree, Ts), np.arange(self.tree.model.nv))

    def _reach(self, x: Array, target: Array, move: Move) -> Array:
        """Return the configuration at the target, reached from x in steps of at most `_JUMP` in every coordinate."""
        start = x[self._active_q] if target.ndim == 1 else self.tree.tool(self.tree.update(x[None])[0])[0]
        origin, misfit = x, np.inf
        s, step = 0.0, 1.0 / max(1, int(np.ceil(walk.distance(start, target) / _STRIDE)))
        stride, smallest, left = step, step / 256, 0
        while s < 1:
            ahead = 1.0 if s + step > 1 - 1e-9 else s + step
            there = walk.between(start, target, ahead)[None]
            X, converged = move(x[None], there)
            misfit = self._misfits(X, there)[0] if converged[0] else np.inf
            if misfit < GAP_TOLERANCE and self.jumps(x[None], X)[0] < _JUMP:
                x, s, step = X[0], ahead, 2 * step
                continue
            step /= 2
            if step < smallest:
                ahead = min(1.0, s + stride)
                away = self._depart(x, walk.between(start, target, ahead), move) if left < _DEPARTURES else None
                if away is not None:  # a departure's misfit is below `_THERE`
                    x, s, step, left, misfit = away, ahead, stride, left + 1, 0.0
                    continue
                best = self.state(X[0] if converged[0] else x)
                raise AssemblyError(
                    f"{self.mechanism.name}: the mechanism cannot be assembled at the target: it moves "
                    f"{100 * s:.0f} % of the way, then loops do not close, the tool misses its pose, or the assembly "
                    f"mode changes (largest loop gap {best.worst_gap / MM:.3g} mm)",
                    best,
                    best.worst_gap,
                )
        # `misfit` is that of x at the target. It is large, for example, with collinear links.
        stuck = misfit > _THERE and misfit > 2 * self._misfits(origin[None], start[None])[0] + _THERE
        away = self._depart(x, target, move) if stuck else None
        return x if away is None else away

    def _depart(self, x: Array, target: Array, move: Move) -> Array | None:
        """Return a state at the target, reached by random steps from x (where Newton steps fail); None if not found."""

        def way(new: Array) -> float:
            far = self.jumps(x[None], new[None])[0]
            return far if far < _JUMP and self._misfits(new[None], target[None])[0] < _THERE else np.inf

        return departing.depart(self.tree, x, lambda X: move(X, np.array([target] * len(X)))[0], way)

    def _misfits(self, X: Array, targets: Array) -> Array:
        """Return the misfit (k,): the largest loop gap in m; for tool poses, the maximum of gap and pose error."""
        poses, _ = self.tree.update(X, closing_only=True)
        gap = self.tree.loops.gaps(X, poses)[..., 0].max(axis=1, initial=0.0)
        if targets.ndim == 3:
            gap = np.maximum(gap, [walk.distance(T, t) for T, t in zip(self.tree.tool(poses), targets, strict=True)])
        return gap

    def jumps(self, X0: Array, X1: Array) -> Array:
        """Return the largest change (k,) in m or rad of any coordinate between configurations (k, nq)."""
        moved = [pin.difference(self.tree.model, a, b) for a, b in zip(X0, X1, strict=True)]
        return np.abs(np.array(moved).reshape(len(X0), -1)).max(axis=1, initial=0.0)

    def _along(self, targets: Array, move: Move, seed: Assembly | None, progress: Progress | None) -> Array:
        """Return the states of all samples: first the knots are solved in order, then all samples from guesses.

        The knots determine the assembly mode. The guesses are interpolated between knots, and are so accurate that one
        or two iterations suffice, for all samples at once.
        """
        coarse = walk.knots(targets)
        start, tell = self._start(seed), progress or (lambda fraction: None)

        def solved_from(x: Array) -> Array:
            return self._knots(coarse, targets, move, x, tell)

        knots = self._in_turns(start, targets[0], solved_from) if targets.ndim == 2 else solved_from(start)
        states = self._between(coarse, knots, targets)
        for block in np.array_split(np.arange(len(targets)), max(1, len(targets) // 1000)):
            solved, converged = move(states[block], targets[block])
            if not converged.all():
                k = int(np.argmin(converged))
                best = self.state(solved[k])
                raise AssemblyError(f"at sample {block[k]}: the solver did not converge", best, best.worst_gap)
            states[block] = solved
            if progress is not None:
                progress(0.5 + (block[-1] + 1) / len(targets) / 2)
        return states

    def _knots(self, coarse: Index, targets: Array, move: Move, start: Array, progress: Progress) -> Array:
        """Return the states of the samples `coarse`, solved in order; predictable samples are solved together."""
        knots = np.zeros((len(coarse), self.tree.model.nq))
        x, i, many = start, 0, 1
        while i < len(coarse):
            ks = coarse[i : i + many]
            guess = self._foreseen(x, targets[ks]) if len(ks) > 1 else x[None]
            X, converged = move(guess, targets[ks])
            near = self.jumps(np.concatenate([x[None], X[:-1]]), X) <= _JUMP
            if len(ks) > 1:
                near = np.logical_and(near, self._surprise(x, guess, X) < _SURPRISE)
            good = np.logical_and.reduce([converged, near, self._misfits(X, targets[ks]) <= GAP_TOLERANCE])
            count = len(ks) if good.all() else int(np.argmin(good))
            many = min(2 * many, _AT_ONCE if targets.ndim == 2 else 1) if count == len(ks) else max(1, count)
            if not count and len(ks) == 1:
                for j in range(coarse[i - 1] + 1 if i else 0, ks[0] + 1):
                    try:
                        x = self._reach(x, targets[j], move)
                    except AssemblyError as error:
                        raise AssemblyError(f"at sample {j}: {error}", error.best, error.gap) from error
                X, count = x[None], 1
            if count:
                knots[i : i + count], x, i = X[:count], X[count - 1], i + count
            progress(i / len(coarse) / 2)
        return knots

    def _foreseen(self, x: Array, q: Array) -> Array:
        """Return first guesses (k, nq) for active joint values q (k, n), along the tangent at configuration x."""
        gain = self.gains(x[None])[0]
        return self.tree.integrate(np.tile(x, (len(q), 1)), (q - x[self._active_q]) @ gain.T)

    def _surprise(self, x: Array, guess: Array, X: Array) -> Array:
        """Return the prediction error (k,) of states X (k, nq): distance from the guess, divided by distance from x."""
        off, way = self.jumps(guess, X), self.jumps(np.tile(x, (len(X), 1)), X)
        return off / np.maximum(way, 1e-9)

    def _between(self, at: Index, knots: Array, targets: Array) -> Array:
        """Return first guesses (k, nq) for all samples from the solved states (j, nq) at samples `at`.

        For driven motions, the constraint Jacobian gives the slopes of all joints from the slopes of the active joints.
        Where a bang-bang acceleration switches, the interpolated active joints have an error. This error is removed,
        and the Jacobian corrects the passive joints accordingly. One iteration then suffices for nearly all samples.
        """
        if targets.ndim == 3 or len(at) < 2:
            slopes = np.gradient(knots, at.astype(float), axis=0) if len(at) > 1 else np.zeros_like(knots)
            return self.tree.normalise(walk.interpolate(at, knots, slopes, len(targets)))
        gain = self.gains(knots)
        rate = np.einsum("kij,kj->ki", gain, np.gradient(targets, axis=0)[at])
        tiny = 1e-3
        ahead, behind = self.tree.integrate(knots, tiny * rate), self.tree.integrate(knots, -tiny * rate)
        states = walk.interpolate(at, knots, (ahead - behind) / (2 * tiny), len(targets))
        states = self.tree.normalise(states)
        nearest = np.searchsorted(0.5 * (at[1:] + at[:-1]), np.arange(len(targets)))
        missed = targets - states[:, self._active_q]
        return self.tree.integrate(states, np.einsum("kij,kj->ki", gain[nearest], missed))

    def gains(self, states: Array, A: Array | None = None) -> Array:
        """Return the rates (k, nv, n) of tree joints per rate of each active joint; passive rates by least squares."""
        A = self._jacobians(states)[0] if A is None else A
        active = self.tree.active
        gain = np.zeros((len(A), self.tree.model.nv, len(active)))
        gain[:, active] = np.eye(len(active))
        gain[:, self.tree.passive] = -self._give(A) @ A[:, :, active]
        return gain

    def _give(self, A: Array) -> Array:
        """Return the pseudoinverse (k, np, m): change of the passive joints per change of the loop residual."""
        if not A.shape[1] or not len(self.tree.passive):
            return np.zeros((len(A), len(self.tree.passive), A.shape[1]))
        return np.asarray(np.linalg.pinv(A[:, :, self.tree.passive], rcond=_FLAT), float)

    def _link(self, poses: Array, body: str) -> Array:
        number, T_joint_body = self.tree.body(body)
        return poses[:, number] @ T_joint_body

    def _jacobians(self, X: Array) -> tuple[Array, Array]:
        """Return loop Jacobians (k, m, nv) and tool Jacobians (k, 6, nv)."""
        poses, J = self.tree.update(X, closing_only=True)
        return self.tree.loops.evaluate(X, poses, J)[1], self.tree.tool_jacobian(poses, J)
