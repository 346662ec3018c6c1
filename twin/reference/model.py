"""The independent model of a mechanism: joint values to poses, tool poses to joint values, and their rates.

Loops are closed by Gauss-Newton in the least-squares sense. Redundant constraints cause no problem; inconsistent
constraints leave a gap, which is reported per joint. Distant targets are reached by continuation in small steps, so
that the mechanism remains in the assembly mode of the rest poses (the state drawn in the CAD).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.errors import AssemblyError, MechanismError
from twin.core.progress import StepProgress
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.reference import loop_rates, mobility
from twin.reference.loops import LENGTH_SCALE
from twin.reference.mobility import Mobility
from twin.reference.newton import minimise
from twin.reference.pose_residuals import loops_only
from twin.reference.sample_continuation import BLOCK, solved_along
from twin.reference.states import Assembly, SolvedSamples, assembly_at, link_poses_at, samples_at
from twin.reference.target_continuation import GAP_TOLERANCE, MODE_JUMP, TargetContinuation
from twin.reference.tree import Tree

_RIGID = 1e-6
"""Largest deviation of the entries of a tool pose from a rigid pose."""

_RANK = 1e-6
"""Relative singular value of the tool Jacobian below which the tool cannot move in a direction."""

_NEARBY_STATES = 4
"""Number of random states near home at which the rank of the tool Jacobian is counted besides."""

_NEARBY_SLIDE = 2e-3
"""Largest displacement in m of a slide in these states."""

_NEARBY_TURN = 0.05
"""Largest displacement in rad of a rotation in these states."""

_INDEPENDENT_SLIDE = 0.01
"""Largest change in m of a slide per step if independent states are solved together."""

_INDEPENDENT_TURN = 0.1
"""Largest change in rad of a rotation per step if independent states are solved together."""


class ReferenceModel:
    """Independent model of a mechanism, solved with its loops; see `solve`, `solve_pose`, `run` and `run_poses`."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.tree = Tree(mechanism)
        self._continuation = TargetContinuation(self.tree)

    # -- one state ------------------------------------------------------------------------------------

    def solve(self, q: Array, seed: Assembly | None = None) -> Assembly:
        """Return the assembly at active joint values q.

        q (n,) is in m or rad, in the order of `mechanism.active`. The solution continues from `seed`; None: from the
        rest poses (as drawn in the CAD).

        Raises:
            AssemblyError: the loops cannot be closed at q; the error contains the best assembly.
            MechanismError: q has the wrong length or is not finite.
        """
        q = checked_joint_values(self.mechanism, q)
        x = self._continuation.driven(self._start(seed), q)
        return self.state(x)

    def solve_pose(self, T_base_tool: Array, seed: Assembly | None = None) -> Assembly:
        """Return the assembly with the tool at T_base_tool (4, 4); the active joints are also solved for.

        Raises:
            AssemblyError: no assembly has its tool at this pose; the error contains the best assembly.
            MechanismError: the pose is not rigid.
        """
        if np.ndim(T_base_tool) != 2 or not spatial.is_pose(T_base_tool, _RIGID):
            raise MechanismError("the tool pose is not a rigid (4, 4) pose")
        T = np.asarray(T_base_tool, float)
        x = self._continuation.reached(self._start(seed), T)
        return self.state(x)

    def near_pose(self, X: Array, T_base_tool: Array) -> Array:
        """Return configurations (j, nq) with the tool at T_base_tool (4, 4), by Newton's method from rows of X (k, nq).

        Rows that lead to no such configuration are left out. Unlike `solve_pose`, the tool need not follow a straight
        line to the pose, which a mechanism with fewer than six degrees of freedom cannot; the result may be in another
        assembly mode than its start.
        """
        Ts = np.tile(np.asarray(T_base_tool, float), (len(X), 1, 1))
        configurations, converged = self._continuation.move(X, Ts)
        rows = np.flatnonzero(converged)
        at_pose = self._continuation.misfits(configurations[rows], Ts[rows]) < GAP_TOLERANCE
        return configurations[rows[at_pose]]

    def home(self) -> Assembly:
        """Return the assembly at the rest poses, with the loops closed."""
        return self.state(self._start(None))

    def state(self, x: Array) -> Assembly:
        """Return the assembly at configuration x (nq,), even if its loops are open."""
        return assembly_at(self.tree, x)

    # -- along samples --------------------------------------------------------------------------------

    def run(self, q: Array, seed: Assembly | None = None, progress: StepProgress | None = None) -> SolvedSamples:
        """Return the states at active joint values q (k, n), solved along a motion.

        Raises:
            AssemblyError: the loops cannot be closed at a sample; the message names the sample.
            MechanismError: q has another shape, no samples, or a value that is not finite.
        """
        q = checked_joint_motion(self.mechanism, q)
        states = solved_along(self._continuation, q, self._start(seed), progress)
        return self._closed(self.collect(states))

    def follow(self, X: Array, q: Array) -> Array:
        """Return configurations (k, nq) at active joint values q (k, n), each continued from a row of X (k, nq).

        The rows are independent, and solved at once; a row that is far from its target is solved as by `solve`.

        Raises:
            AssemblyError: the loops of a row cannot be closed at its target.
        """
        continuation = self._continuation
        start = continuation.unwound(X, q)
        new, converged = continuation.move(start, q)
        steady = continuation.jumps(start, new) < MODE_JUMP
        closed = continuation.misfits(new, q) < GAP_TOLERANCE
        is_reached = np.logical_and.reduce([converged, steady, closed])
        for i in np.flatnonzero(~is_reached):
            new[i] = continuation.driven(X[i], q[i])
        return new

    def solve_many(self, q: Array, seed: Assembly | None = None) -> SolvedSamples:
        """Return the states at active joint values q (k, n); each row is solved separately, not as part of a motion.

        Every row starts from `seed`, by default from the rest poses.

        Raises:
            AssemblyError: the loops cannot be closed at a row; the message names the row.
            MechanismError: q has another shape, no rows, or a value that is not finite.
        """
        q = checked_joint_motion(self.mechanism, q, "row")
        start = self._start(seed)
        stride = np.where(self.tree.are_angles, _INDEPENDENT_TURN, _INDEPENDENT_SLIDE)
        blocks = []
        for first in range(0, len(q), BLOCK):
            goal = q[first : first + BLOCK]
            X, is_reached = self._in_steps(start, goal, stride)
            # alone, a state can be reached in smaller steps than the others need
            for i in np.flatnonzero(~is_reached):
                try:
                    X[i] = self._continuation.driven(start, goal[i])
                except AssemblyError as error:
                    raise AssemblyError(f"at row {first + i}: {error}", error.best, error.gap) from error
            blocks.append(X)
        states = np.concatenate(blocks)
        return self._closed(self.collect(states), item="row")

    def _in_steps(self, start: Array, goal: Array, stride: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return (states (k, nq) at active joint values `goal` (k, n), (k,) bool: whether each was reached).

        All states start from `start` (nq,), and take the same number of equal steps of at most `stride` (n,).
        """
        X = self._continuation.unwound(np.tile(start, (len(goal), 1)), goal)
        origin = X[:, self.tree.active_places]
        change = goal - origin
        steps = max(1, int(np.ceil(np.max(np.abs(change) / stride))))
        is_reached = np.ones(len(goal), bool)
        for s in np.linspace(0, 1, steps + 1)[1:]:
            target = origin + s * change
            if s == 1:
                target = goal  # without rounding errors
            new, converged = self._continuation.move(X, target)
            steady = self._continuation.jumps(X, new) < MODE_JUMP
            is_reached &= np.logical_and(converged, steady)
            X = new
        closed = self._continuation.misfits(X, goal) < GAP_TOLERANCE
        return X, np.logical_and(is_reached, closed)

    def run_poses(
        self,
        Ts_base_tool: Array,
        progress: StepProgress | None = None,
        near: Array | None = None,
    ) -> SolvedSamples:
        """Return the states with the tool at the given poses (k, 4, 4), solved along a motion; see `run`.

        If the mechanism is `redundant` or has auxiliary joints, a pose has many solutions. If `near` (k, n) is given,
        the solution with the smallest motion from these active joint values is returned.

        Raises:
            AssemblyError: no assembly has its tool at one of the poses; the message names the sample.
            MechanismError: the poses have another shape, are none, or are not rigid.
        """
        Ts = np.asarray(Ts_base_tool, float)
        if Ts.ndim != 3 or not len(Ts) or not spatial.is_pose(Ts, _RIGID):
            raise MechanismError(f"the tool poses, of shape {Ts.shape}, are not rigid (k, 4, 4) poses")
        unique = not (self.redundant or self.mechanism.auxiliary)
        if near is None or unique:
            states = solved_along(self._continuation, Ts, self._home, progress)
            return self._closed(self.collect(states), Ts)
        # `near` selects the solutions: its states are solved first, and the tool moves from them to its targets
        states = solved_along(self._continuation, np.asarray(near, float), self._home, progress)
        samples = np.arange(len(Ts))
        for block in np.array_split(samples, max(1, len(Ts) // BLOCK)):
            states[block], _ = self._continuation.move(states[block], Ts[block])
        return self._closed(self.collect(states), Ts)

    @cached_property
    def freedoms(self) -> int:
        """Number of independent directions in which the active joints move the tool.

        The number is the largest rank of the tool Jacobian at home and at nearby states, because home may be singular.
        """
        count = len(self.mechanism.active)
        if not count:
            return 0
        size = np.where(self.tree.are_angles, _NEARBY_TURN, _NEARBY_SLIDE)
        displacements = np.random.default_rng(0).uniform(-1, 1, (_NEARBY_STATES, count))
        steps = np.vstack([np.zeros(count), size * displacements])
        home = np.tile(self._home, (len(steps), 1))
        tangents = np.einsum("kij,kj->ki", self.gains(home), steps)
        starts = self.tree.integrate(home, tangents)
        X, _ = minimise(self.tree, starts, self.loops_only, self.tree.passive)
        twists = self.tool_jacobians(X)
        # linear rates in units of `LENGTH_SCALE`, so that they weigh about as much as angular ones
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
        return samples_at(self.tree, states)

    def link_poses(self, states: Array) -> dict[str, Array]:
        """Return {name: T_base_body (k, 4, 4)} of all bodies at configurations (k, nq)."""
        return link_poses_at(self.tree, states)

    def jumps(self, X0: Array, X1: Array) -> Array:
        """Return the largest change (k,) in m or rad of any coordinate between configurations (k, nq)."""
        return self._continuation.jumps(X0, X1)

    # -- rates ----------------------------------------------------------------------------------------

    def motion(self, states: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """Return (V, dV/dt, G): velocities and accelerations of the tree (k, nv) with closed loops, gains G (k, nv, n).

        V = G qd and dV/dt = G qdd - A_p^+ (dA/dt V). A is the loop Jacobian, A_p its columns for the passive joints.
        The equations of the passive joints are solved in the least-squares sense. `states` are configurations (k, nq);
        qd and qdd (k, n) are rates and accelerations of the active joints.
        """
        return loop_rates.motion(self.tree, states, qd, qdd)

    def rates(self, states: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Return tool twists and accelerations in base at the tool's origin, both (k, 6), linear part first."""
        return loop_rates.tool_motion(self.tree, states, qd, qdd)

    def tool_jacobians(self, states: Array) -> Array:
        """Return the Jacobians (k, 6, n) from rates of the active joints to the tool twist in base, linear rows first.

        `states` (k, nq) are configurations with closed loops.
        """
        return loop_rates.tool_jacobians(self.tree, states)

    def gains(self, states: Array) -> Array:
        """Return the rates (k, nv, n) of tree joints per rate of each active joint; passive rates by least squares."""
        return loop_rates.gains(self.tree, states)

    def loop_jacobian(self, x: Array) -> Array:
        """Return the Jacobian (m, nv) of the loop residuals at configuration x (nq,)."""
        A, _ = loop_rates.jacobians(self.tree, x[None])
        return A[0]

    def mobility(self, x: Array) -> Mobility:
        """Return degrees of freedom and redundant constraints at configuration x (nq,)."""
        A = self.loop_jacobian(x)
        return mobility.count(A, self.tree.loops, self.tree.passive)

    # -- what the solutions above share ---------------------------------------------------------------

    def _closed(self, run: SolvedSamples, Ts: Array | None = None, item: str = "sample") -> SolvedSamples:
        """Return the run; raise `AssemblyError` at the first sample whose misfit is above `GAP_TOLERANCE`.

        The misfit of a sample is the largest of its loop gaps in m; with poses Ts (k, 4, 4), also of the shift in m and
        the rotation in rad of the tool from its pose. `item` is the word for a sample in the message.
        """
        misfit = run.gaps[..., 0].max(axis=1, initial=0.0)
        shifts = np.zeros(len(misfit))
        turns = np.zeros(len(misfit))
        if Ts is not None:
            shifts = np.linalg.norm(run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3], axis=1)
            R_target = np.swapaxes(run.Ts_base_tool[:, :3, :3], 1, 2) @ Ts[:, :3, :3]
            turns = spatial.rotation_angle(R_target)
        is_closed = np.maximum.reduce([misfit, shifts, turns]) < GAP_TOLERANCE
        if is_closed.all():
            return run
        k = int(np.argmin(is_closed))
        best = self.state(run.x[k])
        deviation = f"largest loop gap {best.worst_gap / MM:.3g} mm"
        if Ts is not None:
            deviation += f", tool {shifts[k] / MM:.3g} mm"
            if turns[k] >= GAP_TOLERANCE:
                deviation += f" and {turns[k] / DEG:.3g} deg"
            deviation += " from its target"
        text = f"at {item} {k}: {self.mechanism.name}: out of reach, {deviation}"
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

    def loops_only(self, X: Array, rows: Index) -> tuple[Array, Array]:
        """Return the loop residuals (k, m) at configurations (k, nq), and their Jacobians (k, m, nv)."""
        return loops_only(self.tree)(X, rows)


def checked_joint_values(mechanism: Mechanism, q: Array) -> Array:
    """Check active joint values q in m or rad, and return them as an array (n,).

    Raises:
        MechanismError: q has the wrong length or is not finite.
    """
    q = np.asarray(q, float)
    names = [joint.name for joint in mechanism.active]
    if q.shape != (len(names),):
        raise MechanismError(f"q has shape {q.shape}; expected ({len(names)},) for {', '.join(names)}")
    if not np.all(np.isfinite(q)):
        values = dict(zip(names, q.tolist(), strict=True))
        raise MechanismError(f"q is not finite: {values}")
    return q


def checked_joint_motion(mechanism: Mechanism, q: Array, item: str = "sample") -> Array:
    """Check active joint values q in m or rad along a motion, and return them as an array (k, n).

    Raises:
        MechanismError: q has the wrong shape, no samples, or is not finite; the message names the sample, by `item`.
    """
    q = np.asarray(q, float)
    names = [joint.name for joint in mechanism.active]
    if q.ndim != 2 or q.shape[1] != len(names):
        raise MechanismError(f"q has shape {q.shape}; expected (k, {len(names)}) for {', '.join(names)}")
    if not len(q):
        raise MechanismError(f"q has no {item}s")
    finite = np.isfinite(q).all(axis=1)
    if not finite.all():
        k = int(np.argmin(finite))
        values = dict(zip(names, q[k].tolist(), strict=True))
        raise MechanismError(f"q is not finite at {item} {k}: {values}")
    return q
