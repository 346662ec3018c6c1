"""Forward kinematics of a mechanism with loops: compiled Newton's method from active joints to the tool pose.

Blocks of equations are solved in sequence (see `structure`): planar loops first, then the blocks that depend on these
loops. Every solution is checked: the loops are closed, no joint is inverted, and the determinant of each block has the
same sign as in the CAD's rest poses. If a check fails, the state is solved again in small steps from the rest poses.

In array shapes, n is the number of active joints and m is the number of loop unknowns: the state values of all passive
joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core.errors import AssemblyError, MechanismError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics.closed_loops import linear
from twin.kinematics.closed_loops.equations import LENGTH_SCALE, LoopEquations, stepped
from twin.kinematics.closed_loops.structure import EquationBlock, blocks
from twin.model.mechanism import Mechanism

GAP = 1e-9
"""Maximum gap in m of a closed loop; most remaining values are mere rounding errors."""

TILT = 1e-8
"""Maximum misalignment in rad of a closed loop."""

_CONVERGED_STEP = 1e-8
"""Step size (m, rad) below which the iteration ends."""

_LARGEST_STEP = 0.6
"""Maximum change (m, rad) of an unknown in one step."""

_MAX_NEWTON_STEPS = 30
"""Maximum number of Newton's steps for a block."""

_CONVERGED_SEED_STEP = 1e-5
"""Step size (m, rad) below which the iteration for seeds ends, see `LoopSolver.seeds_at`; they need not be exact."""

_PATH_STEP_COUNTS = (8, 64)
"""Numbers of steps from the rest poses to a state that Newton's method does not find directly, tried in this order."""

_SINGULAR_CONDITION = 1e8
"""Condition number of a block in the rest poses above which the block is solved by least squares."""

_LARGEST_REST_GAP = 1e-3
"""Gap in m in the rest poses from which the loops do not close: the CAD is wrong there."""

_LARGEST_REST_TILT = 0.1
"""Misalignment in rad in the rest poses from which the loops do not close."""

_REST_GAP_FACTOR = 10
"""Factor of the gap in the rest poses up to which a loop counts as closed elsewhere."""

_RESULT_NAMES = ("pose", "gaps", "states")
"""Names of the results of a kernel, see `LoopSolver.stages`."""

# Places of the results of a kernel for a single state: one after another, in the order of `_RESULT_NAMES`.

_POSE_ENTRIES = slice(0, 12)
"""First three rows of T_base_tool, row by row."""

_OFFSET_ENTRY = 12
"""Gap of the loops in m."""

_TILT_ENTRY = 13
"""Misalignment of the loops in rad."""

_MARGIN_ENTRY = 14
"""Margin, see `ClosedStates`."""

_UNKNOWN_ENTRIES = slice(15, None)
"""Loop unknowns (m,)."""


@dataclass(frozen=True)
class ClosedStates:
    """k states of the mechanism with closed loops.

    Attributes:
        Ts_base_tool: (k, 4, 4); NaN where the loops cannot be closed.
        states: (k, m) values of all loop unknowns; usable as seeds of the next call.
        offset, tilt: (k,) norm of the gaps of all loops in m; (k,) norm of the misalignments of all loops in rad.
        margin: (k,) minimum over the blocks of (determinant / determinant in the rest poses), at most 1; 0 at a
            singularity of the loops, negative in another assembly mode.
    """

    Ts_base_tool: Array
    states: Array
    offset: Array
    tilt: Array
    margin: Array


class LoopSolver:
    """Closed-loop forward kinematics of a mechanism; shares no code with the reference model that checks it.

    Attributes:
        equations: loop equations of the mechanism.
        blocks: blocks of equations, in the order of solution.
        q, home: active joints (n,), and state of each passive joint, in the rest poses after loop closure.
        samples: Jacobian of each block as drawn.
        signs: determinant of each square block in the rest poses, by its name in the stages.
        gap, tilt: maximum gap in m and misalignment in rad of closed loops.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Find the blocks of equations and close the loops in the rest poses; kernels are compiled when first used.

        Raises:
            AssemblyError: the loops do not close in the rest poses.
        """
        self.mechanism = mechanism
        self.equations = LoopEquations(mechanism)
        self.blocks = blocks(self.equations)
        self.q, start = self.equations.rest()
        self._newton: list[Stage] = []
        self.samples: list[Array] = []
        for number, block in enumerate(self.blocks):
            self._newton.append(self._block_stage(number, block, start))

        values = {"q": self.q}
        for passive, state in zip(self.equations.passive, start, strict=True):
            values[passive.key] = state
        for stage in self._newton:
            self._solve_once(stage, values)
        self.home = [values[passive.key] for passive in self.equations.passive]
        self.signs: dict[str, float] = {}
        for name, value in values.items():
            if name.startswith("det "):
                self.signs[name] = float(value[0])

        e = self.equations
        function = ca.Function("gaps", [e.q, e.states], [e.offset, e.tilt])
        gaps = function(self.q, np.concatenate([*self.home, []]))
        offset = float(gaps[0])
        tilt = float(gaps[1])
        if not (offset < _LARGEST_REST_GAP and tilt < _LARGEST_REST_TILT):  # true also for NaN
            text = f"the loops do not close in the rest poses: {offset / MM:.3g} mm and {tilt:.3g} rad remain"
            raise AssemblyError(f"{mechanism.name}: {text}", gap=offset)
        # If a loop does not close exactly in the CAD, a gap remains in every state; this is a finding, not an error.
        self.gap = max(GAP, _REST_GAP_FACTOR * offset)
        self.tilt = max(TILT, _REST_GAP_FACTOR * tilt)

    def _solve_once(self, stage: Stage, values: dict[str, Array]) -> None:
        """Solve one block by Newton's method without a kernel; `values` holds its inputs and takes its results."""
        for _ in range(_MAX_NEWTON_STEPS):
            arguments = [values[name] for name in stage.takes]
            results = stage.function(*arguments)
            for name, result in zip(stage.gives, results, strict=True):
                values[name] = result.full().ravel()
            if not values["error"][0] > _CONVERGED_STEP:
                return

    def forward(self, q: Array, seed: Array | None = None) -> Array:
        """Return T_base_tool (4, 4) at active joints q (n,).

        `seed` (m,) contains the loop unknowns to start from, a row of `ClosedStates.states`; default: those of the rest
        poses.

        Raises:
            AssemblyError: the loops cannot be closed at q.
            MechanismError: q has the wrong length or is not finite.
        """
        single = self._kernel_of_one_state
        if np.shape(q) != (len(self.q),):
            raise MechanismError(f"q has shape {np.shape(q)}; expected ({len(self.q)},)")
        if seed is None:
            seed = self._rest_unknowns
        results = single(q, seed)
        if self._is_closed(results, 0.0):
            T = np.eye(4)
            T[:3] = results[_POSE_ENTRIES].reshape(3, 4)
            return T
        closed = self.forward_many(np.asarray(q, float)[None])
        if np.isfinite(closed.Ts_base_tool).all():
            return closed.Ts_base_tool[0]
        if not np.isfinite(q).all():
            raise MechanismError(f"q is not finite: {np.asarray(q).tolist()}")
        raise AssemblyError(
            f"{self.mechanism.name}: the loops cannot be closed at q = {np.round(q, 6).tolist()}: the "
            f"smallest gap is {closed.offset[0] / MM:.3g} mm",
            best=closed,
            gap=float(closed.offset[0]),
        )

    def close(self, q: Array, seed: Array, margin: float = -np.inf) -> Array | None:
        """Return the loop unknowns (m,) that close the loops at q (n,), by Newton's method from `seed` (m,).

        The solution may be in any assembly; usually, it is in the assembly of the seed. None: the method does not
        converge, or the margin of the solution (see `ClosedStates`) is not above `margin`.
        """
        results = self._kernel_of_one_state(q, seed)
        if self._is_closed(results, margin):
            return results[_UNKNOWN_ENTRIES]
        return None

    def _is_closed(self, results: Array, margin: float) -> bool:
        """Return whether the results of a single state close the loops, with a margin above `margin`."""
        return bool(
            results[_OFFSET_ENTRY] <= self.gap and results[_TILT_ENTRY] <= self.tilt and results[_MARGIN_ENTRY] > margin
        )

    def pose(self, q: Array, states: Array) -> Array:
        """Return T_base_tool (4, 4) at q (n,) and loop unknowns (m,) that close the loops."""
        rows = self._kernel_of_one_state(q, states)[_POSE_ENTRIES].reshape(3, 4)
        return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])

    def forward_many(self, qs: Array, seeds: Array | None = None, threads: int | None = None) -> ClosedStates:
        """Return the states at active joints qs (k, n), each solved independently; poses without a solution are NaN.

        `seeds` (k, m) contains the loop unknowns to start from; default: those of the rest poses. `threads` is the
        maximum number of threads; default: the number of processors.
        """
        qs = np.asarray(qs, float)
        if qs.ndim != 2 or qs.shape[1] != len(self.q):
            raise MechanismError(f"q has shape {qs.shape}; expected (k, {len(self.q)})")
        q_columns = np.ascontiguousarray(qs.T)
        if seeds is None:
            poses, gaps, states = self._kernel_from_rest(q_columns, threads=threads)
        else:
            seed_columns = np.ascontiguousarray(self._checked_unknowns(seeds, len(qs)).T)
            poses, gaps, states = self._kernel_from_seeds(q_columns, seed_columns, threads=threads)

        finite = np.isfinite(q_columns).all(axis=0)
        for stations in _PATH_STEP_COUNTS:
            failed = np.flatnonzero(~self._are_closed(gaps) & finite)
            if not len(failed) or not self.blocks:
                break
            new_poses, new_gaps, new_states = self._solved_along_path(q_columns[:, failed], stations, threads)
            better = self._are_closed(new_gaps)  # if a state cannot be closed, its first result remains
            repaired = failed[better]
            poses[:, repaired] = new_poses[:, better]
            gaps[:, repaired] = new_gaps[:, better]
            states[:, repaired] = new_states[:, better]

        Ts = np.zeros((len(qs), 4, 4))
        Ts[:, 3, 3] = 1
        Ts[:, :3] = poses.T.reshape(-1, 3, 4)
        Ts[~(self._are_closed(gaps) & finite)] = np.nan
        return ClosedStates(Ts, np.ascontiguousarray(states.T), *gaps)

    def seeds_at(self, qs: Array, Ts: Array) -> Array:
        """Return loop unknowns (k, m) near those at active joints qs (k, n) and tool poses Ts (k, 4, 4).

        Joint values can belong to several tool poses: from the rest poses, Newton's method may close the loops at
        another one, although the determinants of the blocks have the signs of the rest poses there, too. Here the tool
        is held at the pose, by least squares: the limbs do not depend on each other, and the rest poses are far less
        often too far away. The results close the loops only approximately, and may be in another assembly mode: they
        are seeds of `forward_many`, which checks its results.
        """
        rows = Ts[:, :3].reshape(-1, 12)
        (states,) = self._kernel_with_held_tool(np.ascontiguousarray(qs.T), np.ascontiguousarray(rows.T))
        return np.ascontiguousarray(states.T)

    def _checked_unknowns(self, states: Array, count: int) -> Array:
        """Return loop unknowns (k, m) as an array.

        Raises:
            MechanismError: there is not one row of m unknowns for each of `count` states.
        """
        rows = np.asarray(states, float)
        expected = (count, len(self._rest_unknowns))
        if rows.shape != expected:
            raise MechanismError(
                f"the loop unknowns have shape {rows.shape}; expected {expected}, a row for each state"
            )
        return rows

    def _solved_along_path(self, Q: Array, stations: int, threads: int | None) -> tuple[Array, Array, Array]:
        """Return poses, gaps and states at active joints Q (n, k), approached in equal steps from the rest poses."""
        q_rest = self.q[:, None]
        states = np.repeat(self._rest_unknowns[:, None], Q.shape[1], axis=1)
        for fraction in np.arange(1, stations) / stations:
            _, _, states = self._kernel_from_seeds(q_rest + fraction * (Q - q_rest), states, threads=threads)
        poses, gaps, states = self._kernel_from_seeds(q_rest + (Q - q_rest), states, threads=threads)
        return poses, gaps, states

    def link_poses(self, qs: Array, states: Array) -> dict[str, Array]:
        """Return {body: T_base_body (k, 4, 4)} at active joints qs (k, n) and loop unknowns `states` (k, m)."""
        Q = np.ascontiguousarray(np.asarray(qs, float).T)
        unknowns = self._checked_unknowns(states, Q.shape[1])
        (rows,) = self._kernel_of_links(Q, np.ascontiguousarray(unknowns.T))
        rows = rows.T
        shape = (len(rows), len(self.mechanism.bodies))
        Ts = np.zeros((*shape, 4, 4))
        Ts[..., 3, 3] = 1
        Ts[..., :3, :] = rows.reshape(*shape, 3, 4)
        poses = {}
        for i, body in enumerate(self.mechanism.bodies):
            poses[body.name] = Ts[:, i]
        return poses

    @cached_property
    def links_at(self) -> Callable[..., Array]:
        """Function of q (n,) and loop unknowns (m,) that returns T_base_body (3, 4) of all bodies as one vector."""
        return self._links_kernel(single=True).single()

    @cached_property
    def _kernel_of_links(self) -> Kernel:
        return self._links_kernel()

    def _links_kernel(self, single: bool = False) -> Kernel:
        e = self.equations
        inputs = {"q": len(self.q), "states": len(self._rest_unknowns)}
        stage = links_stage(e, {"q": e.q, "states": e.states})
        return Kernel([stage], inputs, ["links"], single=single)

    def _are_closed(self, gaps: Array) -> np.ndarray:
        """Return (k,) bool: whether the loops are closed in the assembly of the rest poses, for gaps (3, k)."""
        return (gaps[0] <= self.gap) & (gaps[1] <= self.tilt) & (gaps[2] > 0)

    @cached_property
    def _rest_unknowns(self) -> Array:
        return np.concatenate([*self.home, []])

    @cached_property
    def stages(self) -> list[Stage]:
        """The functions of the kernel, in the order of their calls: Newton's method, then the outputs.

        Inputs are q and the unknowns of the loops. Outputs are "pose" (12,), the first three rows of T_base_tool;
        "gaps" (3,), which are offset, tilt and margin (see `ClosedStates`); and "states", the values of the unknowns.
        """
        arguments = dict(zip(["q", *self._keys], self._arguments, strict=True))
        return [*self._newton, end_stage(self.equations, self.signs, arguments)]

    @cached_property
    def _kernel_from_rest(self) -> Kernel:
        return Kernel([self._home_stage, *self.stages], {"q": len(self.q)}, _RESULT_NAMES)

    @cached_property
    def _kernel_with_held_tool(self) -> Kernel:
        states = [passive.state for passive in self.equations.passive]
        stacked = ca.densify(self.equations.states)
        end = Stage(ca.Function("stacked", states, [stacked]), tuple(self._keys), ("states",))
        stages = [self._home_stage, held_tool_stage(self.equations), end]
        return Kernel(stages, {"q": len(self.q), "tool": 12}, ["states"])

    @property
    def _home_stage(self) -> Stage:
        home = [ca.SX(state) for state in self.home]
        return Stage(ca.Function("drawn", [], home), (), tuple(self._keys))

    @cached_property
    def _kernel_from_seeds(self) -> Kernel:
        return Kernel([self._split, *self.stages], self._input_sizes, _RESULT_NAMES)

    @cached_property
    def _kernel_of_one_state(self):
        return Kernel([self._split, *self.stages], self._input_sizes, _RESULT_NAMES, single=True).single()

    @property
    def _input_sizes(self) -> dict[str, int]:
        return {"q": len(self.q), "seed": len(self._rest_unknowns)}

    @property
    def _keys(self) -> list[str]:
        return [passive.key for passive in self.equations.passive]

    @property
    def _arguments(self) -> list[ca.SX]:
        """Symbols of q and of the state of each passive joint, named "q" and as in `_keys` in kernels."""
        symbols = [self.equations.q]
        for passive in self.equations.passive:
            symbols.append(passive.state)
        return symbols

    @property
    def _split(self) -> Stage:
        return Stage(self.equations.split(), ("seed",), tuple(self._keys))

    def _block_stage(self, number: int, block: EquationBlock, start: list[Array]) -> Stage:
        """Return the stage that solves a block by Newton's method."""
        e = self.equations
        J = masked_jacobian(e.jacobian, block)
        jacobian = ca.Function("J", [e.q, e.states], [ca.densify(J)])
        sample = jacobian(self.q, np.concatenate(start)).full()
        self.samples.append(sample)
        return newton_stage(e, number, block, sample, dict(zip(["q", *self._keys], self._arguments, strict=True)))


def masked_jacobian(jacobian: ca.SX, block: EquationBlock) -> ca.SX:
    """Return the Jacobian of a block with respect to the steps of its unknowns, from that of all equations."""
    rows = list(block.rows)
    columns = list(block.columns)
    # Entries outside the pattern are 0 in every state, but CasADi does not see it.
    J = ca.SX(len(rows), len(columns))
    full = jacobian[rows, columns]
    for i, j in np.argwhere(block.pattern).tolist():
        J[i, j] = full[i, j]
    return J


def block_solution(jacobian: ca.SX, block: EquationBlock, sample: Array, right_side: ca.SX) -> ca.SX:
    """Return the steps x of the unknowns of a block with J x = b; J is the part of `jacobian` for the block.

    `sample` is J in one state. The steps of a block without a unique solution are those of least squares.
    """
    J = masked_jacobian(jacobian, block)
    if block.is_square and np.linalg.cond(sample) < _SINGULAR_CONDITION:
        step, _ = linear.solve_square(J, right_side, block.pattern, sample)
        return step
    return linear.solve_least_squares(J, right_side, block.pattern)


def newton_stage(
    equations: LoopEquations, number: int, block: EquationBlock, sample: Array, arguments: Mapping[str, ca.SX]
) -> Stage:
    """Return the stage that solves a block by Newton's method.

    Args:
        equations: the loop equations.
        number: number of the block; the determinant of the block is named "det <number>".
        block: the equations and unknowns of the block.
        sample: Jacobian of the block in one state, by which the pivots are chosen.
        arguments: {name: symbol} of the arguments: q, the state of each passive joint, and further symbols.
    """
    J = masked_jacobian(equations.jacobian, block)
    residual = equations.residual[list(block.rows)]
    determinant: dict[str, ca.SX] = {}
    if block.is_square and np.linalg.cond(sample) < _SINGULAR_CONDITION:
        step, determinant[f"det {number}"] = linear.solve_square(J, -residual, block.pattern, sample)
    else:
        step = linear.solve_least_squares(J, -residual, block.pattern)
    size = linear.largest(step)
    unknowns = [equations.passive[k] for k in block.unknowns]
    states = stepped(unknowns, step * ca.fmin(1, _LARGEST_STEP / size))

    results = {**states, "error": size, **determinant}
    outputs = [ca.densify(result) for result in results.values()]
    function = ca.Function(f"block{number}", list(arguments.values()), outputs, {"cse": True})
    return Stage(function, tuple(arguments), tuple(results), _MAX_NEWTON_STEPS, _CONVERGED_STEP, reciprocals=True)


def held_tool_stage(e: LoopEquations) -> Stage:
    """Return the stage that closes the loops with the tool held at a pose, by Gauss-Newton steps.

    Its input "tool" (12,) holds the first three rows of T_base_tool, row by row.
    """
    rows = ca.SX.sym("tool", 12)
    T_goal = ca.reshape(rows, 4, 3).T  # CasADi stacks columns
    frame = e.mechanism.frame(e.mechanism.tool)
    T_stepping = e.pose(frame.body, frame.T_body_frame, stepping=True)
    residual = ca.vertcat(e.residual, _pose_misfit(e.T_base_tool, T_goal))
    derivative = ca.jacobian(_pose_misfit(T_stepping, T_goal), e.steps)
    J = ca.vertcat(e.jacobian, ca.substitute(derivative, e.steps, 0))
    pattern = np.array(ca.DM(J.sparsity(), 1).full(), bool)
    step = linear.solve_least_squares(J, -residual, pattern)
    size = linear.largest(step)
    states = stepped(e.passive, step * ca.fmin(1, _LARGEST_STEP / size))

    results = {**states, "error": size}
    outputs = [ca.densify(result) for result in results.values()]
    arguments = [e.q, rows, *(passive.state for passive in e.passive)]
    function = ca.Function("held", arguments, outputs, {"cse": True})
    return Stage(function, ("q", "tool", *states), tuple(results), _MAX_NEWTON_STEPS, _CONVERGED_SEED_STEP)


def _pose_misfit(T: ca.SX, T_goal: ca.SX) -> ca.SX:
    """Return the difference (12,) of two poses in m, that of rotations times `LENGTH_SCALE`."""
    shift = T[:3, 3] - T_goal[:3, 3]
    turn = ca.vec(T[:3, :3] - T_goal[:3, :3])
    return ca.vertcat(shift, LENGTH_SCALE * turn)


def end_stage(equations: LoopEquations, signs: Mapping[str, float], arguments: Mapping[str, ca.SX]) -> Stage:
    """Return the stage that computes tool pose, gaps and states after the blocks.

    Args:
        equations: the loop equations.
        signs: {name of a determinant: its value in the rest poses}.
        arguments: see `newton_stage`.
    """
    determinants = [ca.SX.sym(name) for name in signs]
    margin = ca.SX(1)
    for determinant, at_rest in zip(determinants, signs.values(), strict=True):
        margin = ca.fmin(margin, determinant / at_rest)
    pose = ca.vec(equations.T_base_tool[:3, :].T)
    gaps = ca.vertcat(equations.offset, equations.tilt, margin)
    outputs = [ca.densify(pose), ca.densify(gaps), ca.densify(equations.states)]
    function = ca.Function("end", [*arguments.values(), *determinants], outputs, {"cse": True})
    return Stage(function, (*arguments, *signs), _RESULT_NAMES)


def links_stage(e: LoopEquations, arguments: Mapping[str, ca.SX]) -> Stage:
    """Return the stage that computes T_base_body (3, 4), row by row, of all bodies from `arguments` {name: symbol}."""
    rows = []
    for T in e.links().values():
        rows.append(ca.vec(T.T))  # CasADi stacks columns
    stacked = ca.densify(ca.vertcat(*rows))
    function = ca.Function("links", list(arguments.values()), [stacked], {"cse": True})
    return Stage(function, tuple(arguments), ("links",))
