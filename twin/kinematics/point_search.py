"""Levenberg-Marquardt on points of the arm, for tip and trocar of an instrument (`formula.contract.PointSearch`).

The unknowns x are the points. A step dx solves (J^T J + mu D) dx = -J^T r, where D has the diagonal of J^T J (D. W.
Marquardt, J. SIAM 11(2), 431-441, 1963). After a step that reduces |r|, mu is divided by 10, otherwise the step is
rejected and mu is multiplied by 10. Many problems are solved at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.kinematics.compiled import Compiled
from twin.kinematics.point_functions import PointFunctions
from twin.kinematics.solve import Solution, random_range
from twin.kinematics.tasks import Task

TOLERANCE = 1e-12
"""Norm of the rows in m below which a search counts as solved."""

MAX_ITERATIONS = 100
"""Maximum number of steps of one search."""

_SOLVED_ROWS = 1e-15
"""Norm of the rows in m at which an iteration ends: a few roundings of 1 m."""

_AXIS_TOLERANCE = 1e-12
"""Difference of a component of two unit vectors that are the same."""

_PARALLEL_SINE = 1e-12
"""Sine of the angle of two unit vectors below which they are parallel."""

_FIRST_DAMPING = 1e-3
"""First value of mu, that of Marquardt."""

_DAMPING_FACTOR = 10.0
"""Factor by which mu is changed after each step, that of Marquardt."""

_SMALLEST_DAMPING = 1e-11
"""Minimum of mu: below it, rounding would move the points along the redundant direction."""

_LARGEST_DAMPING = 1e10
"""Value of mu at which a search ends: no step helps, however short."""

_SMALLEST_DIAGONAL = 1e-12
"""Minimum of an entry of D, relative to its largest entry: a column of J may be zero at a starting state."""

_LIMIT_TOL = 1e-9
"""Excess over a joint limit in m or rad that is ignored as a rounding error."""


@dataclass(frozen=True)
class Descents:
    """Results of k searches.

    Attributes:
        points: (k, m, 3) the m points in m.
        residual: (k,) norm of the rows in m.
        iterations: (k,) number of steps tried.
        between: (k,) distance in m of the trocar from tip and arm along the shaft; negative if it is not between them.
        history: (k, s) norm of the rows in m at the start and after each step; NaN after the end.
    """

    points: Array
    residual: Array
    iterations: np.ndarray
    between: Array
    history: Array

    @property
    def converged(self) -> np.ndarray:
        """Whether each search (k,) fulfils the rows, on whichever side of the tip the arm is."""
        return self.residual <= TOLERANCE

    @property
    def solved(self) -> np.ndarray:
        """Whether each search (k,) fulfils the rows, with the trocar between arm and tip."""
        return self.converged & (self.between > 0)


@dataclass(frozen=True)
class PointSolutions:
    """Solutions of k problems.

    Attributes:
        q: (k, n) joints in m or rad; NaN where no search is solved.
        points: (k, m, 3) the points in m.
        excess: (k,) largest excess of a joint over its limit in m or rad; infinite where no search is solved.
        iterations: (k,) number of steps tried in all starts.
    """

    q: Array
    points: Array
    excess: Array
    iterations: np.ndarray

    @classmethod
    def none(cls, problems: int, joints: int, points: int) -> PointSolutions:
        """Return the results before the first search."""
        q = np.full((problems, joints), np.nan)
        places = np.full((problems, points, 3), np.nan)
        return cls(q, places, np.full(problems, np.inf), np.zeros(problems, int))


class PointSolver(PointFunctions):
    """The search of a robot whose formula has a `PointSearch`."""

    def descend(self, starts: Array, tips: Array, trocars: Array, redundant: bool = False) -> Descents:
        """Run one search from each start, also if it does not converge.

        Args:
            starts: (k, m, 3) points in m.
            tips: (k, 3) positions of the tip in m.
            trocars: (k, 3) positions of the trocar in m.
            redundant: whether the redundant joint shall be as in the inverse equations; otherwise it is free.
        """
        rows = self.rows(redundant=redundant)
        tips_and_trocars = np.hstack([tips, trocars])
        x = starts.reshape(len(starts), 3 * self.count).astype(float)
        r, J, between = self.rows_at(rows, x, tips_and_trocars)
        norm = np.linalg.norm(r, axis=1)
        damping = np.full(len(x), _FIRST_DAMPING)
        iterations = np.zeros(len(x), int)
        history = [norm.copy()]
        for _ in range(MAX_ITERATIONS):
            running = np.flatnonzero((norm > _SOLVED_ROWS) & (damping < _LARGEST_DAMPING))
            if not len(running):
                break
            x_new = x[running] + _marquardt_steps(J[running], r[running], damping[running])
            r_new, J_new, between_new = self.rows_at(rows, x_new, tips_and_trocars[running])
            norm_new = np.linalg.norm(r_new, axis=1)
            is_better = norm_new < norm[running]
            accepted = running[is_better]
            x[accepted] = x_new[is_better]
            r[accepted] = r_new[is_better]
            J[accepted] = J_new[is_better]
            norm[accepted] = norm_new[is_better]
            between[accepted] = between_new[is_better]
            damping[accepted] = np.maximum(damping[accepted] / _DAMPING_FACTOR, _SMALLEST_DAMPING)
            damping[running[~is_better]] *= _DAMPING_FACTOR
            iterations[running] += 1
            norms = np.full(len(x), np.nan)
            norms[running] = norm[running]
            history.append(norms)
            at_rounding = (norm <= TOLERANCE) & (damping > _FIRST_DAMPING)
            damping[at_rounding] = _LARGEST_DAMPING  # steps no longer reduce the rows, which are zero but for rounding
        points = x.reshape(-1, self.count, 3)
        return Descents(points, norm, iterations, between, np.stack(history, axis=1))

    def starts(self, count: int, limits: Array | None = None, rng: int = 0) -> Iterator[Array]:
        """Yield joints q (n,) to start from: those of the formula's seeds, then random ones within the limits."""
        lowest, highest = random_range(self.kin, limits)
        seeds = self.kin.formula.seeds[:count]
        for seed in seeds:
            T = self.kin.program.pose_of_coordinates.one(np.asarray(seed, float))
            yield self.kin.inverse(T)
        generator = np.random.default_rng(rng)
        for _ in range(len(seeds), count):
            yield generator.uniform(lowest, highest)

    def inverse_many(self, Ts_base_tool: ArrayLike, starts: int = 48) -> Array:
        """Return q (k, n) at poses of the tool (k, 4, 4), with the redundant joint as in the equations; NaN: not found.

        The trocar is taken on the shaft, halfway between the tip and the points that the equations give for a start:
        any trocar on the shaft has the same solution.
        """
        Ts = np.ascontiguousarray(Ts_base_tool, float)
        tips = Ts[:, :3, 3]
        axes = Ts[:, :3, :3] @ np.asarray(self.search.axis)
        points = np.full((len(Ts), self.count, 3), np.nan)
        unsolved = np.flatnonzero(np.isfinite(Ts).all(axis=(1, 2)))
        for q in self.starts(starts):
            if not len(unsolved):
                break
            start = self.places(q[None])
            tip_of_start = self.kin.program.forward.one(q)[:3, 3]
            length = float(np.linalg.norm(start[0, -1] - tip_of_start))
            trocars = tips[unsolved] - 0.5 * length * axes[unsolved]
            start_points = self.starts_outside(np.repeat(start, len(unsolved), axis=0), tips[unsolved], trocars)
            descents = self.descend(start_points, tips[unsolved], trocars, redundant=True)
            # The rows do not contain the sign of the redundant joint; the other sign is another solution.
            solved = descents.solved & (self.redundant_signs(descents.points) > 0)
            points[unsolved[solved]] = descents.points[solved]
            unsolved = unsolved[~solved]
        return self.joints(points, Ts)

    def starts_outside(self, points: Array, tips: Array, trocars: Array) -> Array:
        """Return starting points (k, m, 3) with the last point moved to the shaft, outside the trocar.

        Its distance from the tip remains. From such starts, a search hardly ever ends with the arm beyond the tip.
        """
        shafts = trocars - tips
        directions = shafts / np.linalg.norm(shafts, axis=1)[:, None]
        lengths = np.linalg.norm(points[:, -1] - tips, axis=1)
        starts = points.copy()
        starts[:, -1] = tips + lengths[:, None] * directions
        return starts

    def solve_many(
        self, tips: Array, trocars: Array, limits: Array | None = None, *, starts: int = 48, rng: int = 0
    ) -> PointSolutions:
        """Solve k problems of tip and trocar, (k, 3) each in m, from several starts: see `solve`."""
        best = PointSolutions.none(len(tips), len(self.kin.joints), self.count)
        unsolved = np.arange(len(tips))
        for q in self.starts(starts, limits, rng):
            if not len(unsolved):
                break
            start = np.repeat(self.places(q[None]), len(unsolved), axis=0)
            start_points = self.starts_outside(start, tips[unsolved], trocars[unsolved])
            descents = self.descend(start_points, tips[unsolved], trocars[unsolved])
            self._keep_nearer_to_limits(best, unsolved, descents, q, tips[unsolved], limits)
            unsolved = np.flatnonzero(best.excess > _LIMIT_TOL)
        return best

    def solve(
        self,
        task: Task,
        seed: ArrayLike | None = None,
        limits: Array | None = None,
        *,
        starts: int = 48,
        rng: int = 0,
    ) -> Solution:
        """Solve tip and trocar from several starting states; the first solution within the limits is returned.

        The joints are those that the inverse equations give at the found points.

        Args:
            task: `Tip(p) + Trocar(c, axis)`, with the axis of the shaft and the tip in the origin of the tool frame.
            seed: q (n,) to start from first; the rotation about the shaft remains as near as possible to that at q.
            limits: (n, 2) lower and upper limit of each joint, in m or rad.
            starts: number of further starting states: the formula's seeds, then random states; see `starts_outside`.
            rng: seed of the random states.

        Raises:
            KinematicsError: the task is another one, or no solution is found; if a search found points beyond a joint
                limit, `best` is the `Solution` with the smallest excess.
        """
        name = self.kin.formula.name
        tip, trocar = self._tip_and_trocar(task)
        if not np.linalg.norm(trocar - tip) > TOLERANCE:
            raise KinematicsError(f"{name}: tip and trocar are the same point: they give no shaft.")
        best = None
        if seed is not None:
            best = self._from_seed(np.asarray(seed, float), tip, trocar, limits)
        if best is None or best.excess[0] > _LIMIT_TOL:
            best = self.solve_many(tip, trocar, limits, starts=starts, rng=rng)
        points = " and ".join(self.search.unknowns)
        if not np.isfinite(best.excess[0]):
            raise KinematicsError(
                f"{name}: no {points} with the trocar between arm and tip in {starts} starts. The target may be out of "
                "reach; method='joints' states by how much."
            )
        solution = self._solution(best, tip[0], trocar[0])
        if best.excess[0] > _LIMIT_TOL:
            raise KinematicsError(
                f"{name}: the {points} found in {starts} starts exceed a joint limit, at best by {best.excess[0]:.3g} "
                "(rad or m); give a seed, or use method='joints', which keeps the limits during the search.",
                best=solution,
                residual=solution.residual,
            )
        return solution

    def _from_seed(self, q: Array, tip: Array, trocar: Array, limits: Array | None) -> PointSolutions:
        """Return the result of one search from q (n,), for a tip and a trocar (1, 3) in m."""
        n = len(self.kin.joints)
        if q.shape != (n,):
            raise KinematicsError(f"{self.kin.formula.name}: a seed must be q ({n},)")
        best = PointSolutions.none(1, n, self.count)
        descents = self.descend(self.places(q[None]), tip, trocar)
        self._keep_nearer_to_limits(best, np.arange(1), descents, q, tip, limits)
        return best

    def _solution(self, solutions: PointSolutions, tip: Array, trocar: Array) -> Solution:
        """Return the first of some solutions; its residual from tip and trocar (3,) is by the forward equations."""
        q = solutions.q[0]
        T = self.kin.program.forward.one(q)
        p_tip = T[:3, 3]
        shaft = T[:3, :3] @ np.asarray(self.search.axis)
        errors = np.concatenate([p_tip - tip, np.cross(trocar - p_tip, shaft)])
        residual = float(np.linalg.norm(errors)) / self.kin.characteristic_length
        branch = str(self.kin.branch(Ts=T[None], qs=solutions.q)[0])
        return Solution(q, T, residual, branch, int(solutions.iterations[0]))

    def _keep_nearer_to_limits(
        self,
        best: PointSolutions,
        rows: np.ndarray,
        descents: Descents,
        q: Array,
        tips: Array,
        limits: Array | None,
    ) -> None:
        """Keep in `best`, for the problems `rows`, results that are nearer to the joint limits; q (n,) is the start."""
        best.iterations[rows] += descents.iterations
        solved = descents.solved
        points = descents.points[solved]
        joints = self.joints(points, self.pose(tips[solved], points, q))
        excess = np.zeros(len(points))
        if limits is not None:
            low, high = limits.T
            excess = np.maximum(low - joints, joints - high).max(axis=1, initial=0.0)
        nearer = excess < best.excess[rows[solved]]
        nearer_rows = rows[solved][nearer]
        best.q[nearer_rows] = joints[nearer]
        best.points[nearer_rows] = points[nearer]
        best.excess[nearer_rows] = excess[nearer]

    def pose(self, tips: Array, points: Array, q: Array) -> Array:
        """Return poses (k, 4, 4) with the tip at `tips` (k, 3) and the shaft from the last of the points (k, m, 3).

        The rotation about the shaft is that of the tool at q (n,), turned by the smallest angle to the shaft.
        """
        shafts = tips - points[:, -1]
        shafts /= np.linalg.norm(shafts, axis=1)[:, None]
        T = self.kin.program.forward.one(q)
        shaft_of_q = T[:3, :3] @ np.asarray(self.search.axis)
        R = _smallest_rotations(shaft_of_q, shafts) @ T[:3, :3]
        return spatial.pose(R, tips)

    def _tip_and_trocar(self, task: Task) -> tuple[Array, Array]:
        """Return tip and trocar (1, 3) of a task in m."""
        terms = {term.kind: term.numbers for term in task.terms}
        if len(task.terms) == 2 and terms.keys() == {"tip", "trocar"}:
            tip = terms["tip"]
            trocar = terms["trocar"]
            in_origin = not tip[3:6].any() and not trocar[6:9].any()
            along_axis = np.allclose(trocar[3:6], self.search.axis, rtol=0, atol=_AXIS_TOLERANCE)
            if in_origin and along_axis:
                return tip[None, :3], trocar[None, :3]
        axis = ", ".join(map("{:g}".format, self.search.axis))
        raise KinematicsError(
            f"{self.kin.formula.name}: method='points' solves only Tip(p) + Trocar(c, axis=({axis})), with the tip in "
            "the origin of the tool frame and a free depth; use method='joints' for other tasks."
        )


_SOLVERS: WeakKeyDictionary[Compiled, PointSolver] = WeakKeyDictionary()


def point_solver(kin: Compiled) -> PointSolver:
    """Return the `PointSolver` of a robot; it is compiled when first requested.

    Raises:
        KinematicsError: the formula has no optimisation of points.
    """
    search = kin.formula.point_search
    if search is None:
        raise KinematicsError(
            f"{kin.formula.name}: the formula has no optimisation of points (point_search); use method='joints' to "
            "solve a task, and the equations as inverse"
        )
    if kin not in _SOLVERS:
        _SOLVERS[kin] = PointSolver(kin, search)
    return _SOLVERS[kin]


def _marquardt_steps(J: Array, r: Array, damping: Array) -> Array:
    """Return the steps (k, n) of Marquardt's normal equations, J (k, r, n), rows (k, r), damping (k,)."""
    H = np.swapaxes(J, 1, 2) @ J
    g = np.einsum("kri,kr->ki", J, r)
    diagonal = np.einsum("kii->ki", H).copy()
    least = _SMALLEST_DIAGONAL * diagonal.max(axis=1, keepdims=True)
    diagonal = np.maximum(diagonal, least)
    i = np.arange(H.shape[1])
    H[:, i, i] += damping[:, None] * diagonal
    return -np.linalg.solve(H, g[..., None])[..., 0]


def _smallest_rotations(direction: Array, directions: Array) -> Array:
    """Return the smallest rotations (k, 3, 3) that turn the unit vector a (3,) into the unit vectors b (k, 3)."""
    axes = np.cross(direction, directions)
    sine = np.linalg.norm(axes, axis=1)
    cosine = directions @ direction
    unit = spatial.unit_across(direction)
    across = np.cross(direction, unit)
    axes[sine < _PARALLEL_SINE] = across  # parallel: no rotation, or half a turn about any axis across
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angle = np.arctan2(sine, cosine)
    return spatial.exp_so3(angle[:, None] * axes)
