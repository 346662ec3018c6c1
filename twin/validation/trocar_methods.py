"""Solve tip and trocar by three methods, and compare them with each other and with the mechanism.

The methods are: the inverse equations in closed form; Levenberg-Marquardt on points of the arm, where a paper has it
(`PointSearch`); Levenberg-Marquardt on the joints (`kinematics.solve`). The problems are drawn within the joint limits,
so that each has a solution. The wrist of a problem is determined; the elbow is compared at the samples of the protocol,
where the search keeps the redundant joint as in the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.findings import Kind
from twin.core.format import count, power
from twin.core.result import TextTable
from twin.core.spatial import Array
from twin.kinematics import Kinematics, Tip, Trocar, solve
from twin.kinematics.point_search import PointSolutions, PointSolver, point_solver
from twin.kinematics.solve import TOLERANCE as SOLVED
from twin.kinematics.solve import descend
from twin.reference import ReferenceModel
from twin.reference.loop_closing import Closing
from twin.validation.case import Case
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.result import Residual

HEADING = "tip and trocar by three methods"

PROBLEM_COUNT = 300
"""Number of random problems, and of random postures to start from."""

METHODS_TOLERANCE = 1e-12
"""Tolerance in m between the methods: rounding errors of an arm of 1 m are a thousandth of it."""

SEARCHES = {
    "search.points": "points, from random postures",
    "search.outside": "points, wrist outside the trocar",
    "search.joints": "joints, from the same postures",
}
"""Title of each kind of search, by the name of its curves in a report."""


class SearchOutcome(IntEnum):
    """Outcome of a search from one start; the index of its text in `OUTCOMES`."""

    SOLVED = 0
    BEYOND_TIP = 1
    NOT_CONVERGED = 2


OUTCOMES = ("solved", "arm beyond the tip", "not converged")
"""Texts of the outcomes of a search."""

_MOST_STARTS = 48
"""Maximum number of starts of a search for one problem."""

_LIMIT_ROUNDING = 1e-9
"""Excess over a joint limit in m or rad that is a rounding error."""

_SEED = 0
"""Seed of the random problems and postures."""

_DEPTH_RANGE = (0.125, 0.875)
"""Smallest and largest insertion depth of a problem, relative to the distance from wrist to tip."""

_TASK_WEIGHT = 100.0
"""Weight of the task of the joint-space method: it then ends where the wrist is exact to `METHODS_TOLERANCE`."""

_PROBLEMS_PHASE = "random problems"

_DIFFERS = Kind(
    "trocar.differs", "disagreement", "correct the rows of the optimisation or the inverse equations", word="tolerance"
)
_MISSES = Kind(
    "trocar.mechanism",
    "disagreement",
    "correct the rows of the optimisation or the inverse equations",
    word="tolerance",
)


@dataclass(frozen=True)
class Problems:
    """Random problems of tip and trocar.

    Attributes:
        Ts: (k, 4, 4) poses of the tool of one solution.
        tips, trocars: (k, 3) in m.
        starts: (k, n) random joints to start from, in rad or m.
    """

    Ts: Array
    tips: Array
    trocars: Array
    starts: Array


@dataclass(frozen=True)
class OneStartResult:
    """Results of a search from one start for each problem.

    Attributes:
        history: (k, s) residual in m at the start and after each step; NaN after the end.
        outcome: (k,) values of `SearchOutcome`.
        steps: (k,) number of steps tried.
    """

    history: Array
    outcome: np.ndarray
    steps: np.ndarray

    def cells(self) -> tuple[str, ...]:
        """Return the cells of a table: number of each outcome, median number of steps of the solved ones."""
        numbers = np.bincount(self.outcome, minlength=len(OUTCOMES)).tolist()
        solved = self.outcome == SearchOutcome.SOLVED
        median = ""
        if solved.any():
            median = f"{np.median(self.steps[solved]):.0f}"
        return (*map(str, numbers), median)


def compare_three_methods(case: Case, comparison: EquationsComparison, number: int = PROBLEM_COUNT) -> None:
    """Add rows, findings, a table and curves of the comparison to `comparison`; skip it if a row of `out` disagrees.

    `number` is the number of random problems.
    """
    kin = case.kinematics
    if kin is None or kin.formula.point_search is None:
        return
    for row in comparison.residuals:
        if row.pair == "A-B" and not row.agrees:
            comparison.facts[HEADING] = {"compared": "no, because other rows disagree"}
            return
    try:
        _compare_methods(kin, case.model, case.cad.mechanism.limits, case, comparison, number)
    except KinematicsError as error:
        comparison.findings.append(_DIFFERS(kin.formula.name, f"tip and trocar cannot be solved: {error}", None, None))


def random_problems(kin: Kinematics, solver: PointSolver, limits: Array, number: int) -> Problems:
    """Return random problems, each with a solution within the joint limits (n, 2), and random starts within them."""
    rng = np.random.default_rng(_SEED)
    # joints without limits: a full turn, or 1 m to each side
    reach = np.where(kin.revolute, np.pi, 1.0)
    low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -reach)
    high = np.where(np.isfinite(limits[:, 1]), limits[:, 1], reach)
    qs = rng.uniform(low, high, (number, len(low)))
    Ts = kin.forward_many(qs)
    tips = Ts[:, :3, 3]
    length = np.linalg.norm(solver.places(qs)[:, -1] - tips, axis=1)
    depths = rng.uniform(*_DEPTH_RANGE, number) * length
    trocars = tips - depths[:, None] * (Ts[:, :3, :3] @ np.asarray(solver.search.axis))
    return Problems(Ts, tips, trocars, rng.uniform(low, high, (number, len(low))))


def search_by_points(solver: PointSolver, problems: Problems, outside: bool = False) -> OneStartResult:
    """Run the search for points once for each problem; `starts_outside`: start with the wrist outside the trocar."""
    begin = solver.places(problems.starts)
    if outside:
        begin = solver.starts_outside(begin, problems.tips, problems.trocars)
    search = solver.descend(begin, problems.tips, problems.trocars)
    outcome = np.full(len(begin), SearchOutcome.NOT_CONVERGED, int)
    # converged, but with the arm beyond the tip, unless it is solved as well
    outcome[search.converged] = SearchOutcome.BEYOND_TIP
    outcome[search.solved] = SearchOutcome.SOLVED
    return OneStartResult(search.history, outcome, search.iterations)


def search_by_joints(
    kin: Kinematics, problems: Problems, limits: Array, axis: tuple[float, float, float]
) -> OneStartResult:
    """Run the joint-space search once for each problem, within the limits; the arm is never beyond the tip."""
    histories: list[list[float]] = []
    outcome = np.full(len(problems.starts), SearchOutcome.SOLVED, int)
    steps = np.zeros(len(problems.starts), int)
    for i, (tip, trocar, q) in enumerate(zip(problems.tips, problems.trocars, problems.starts, strict=True)):
        history: list[float] = []
        search = descend(kin, Tip(tip) + Trocar(trocar, axis), q, limits, history=history)
        histories.append(history)
        if not search.residual <= SOLVED:  # true also for NaN
            outcome[i] = SearchOutcome.NOT_CONVERGED
        steps[i] = search.iterations
    longest = max(map(len, histories))
    residuals = np.full((len(histories), longest), np.nan)
    for row, history in zip(residuals, histories, strict=True):
        row[: len(history)] = history
    # the search has lengths in units of the characteristic length
    return OneStartResult(residuals * kin.characteristic_length, outcome, steps)


@dataclass(frozen=True)
class _Solutions:
    """Solutions of random problems (k) by the three methods.

    Attributes:
        points: by points, from several starts.
        within_limits: (k,) whether those are within the joint limits.
        by_joints: (k,) whether the joint-space search found a solution.
        off_points, off_joints: (k,) distances of the wrist from that of the closed form, in m; NaN without a solution.
        by_all: (k,) whether all methods solve the problem.
    """

    points: PointSolutions
    within_limits: np.ndarray
    by_joints: np.ndarray
    off_points: Array
    off_joints: Array
    by_all: np.ndarray


def _compare_methods(
    kin: Kinematics, model: ReferenceModel, limits: Array, case: Case, comparison: EquationsComparison, number: int
) -> None:
    """Add rows, table, facts and curves of the comparison; for the arguments see `compare_three_methods`."""
    solver = point_solver(kin)
    problems = random_problems(kin, solver, limits, number)
    solutions = _solutions_of_methods(kin, solver, problems, limits)
    _judge_wrists(solver, solutions, comparison)
    _judge_along_protocol(solver, case, comparison)
    _judge_mechanism(model, problems, solutions, solver.search.axis, case, comparison)
    searches = {
        "search.points": search_by_points(solver, problems),
        "search.outside": search_by_points(solver, problems, outside=True),
        "search.joints": search_by_joints(kin, problems, limits, solver.search.axis),
    }
    q_equations = kin.inverse_many(problems.Ts)
    inside = ((q_equations >= limits[:, 0]) & (q_equations <= limits[:, 1])).all(axis=1)
    comparison.tables[HEADING] = _methods_table(solver, searches, solutions, int(inside.sum()))
    comparison.facts[HEADING] = {
        "problems": f"{count(number, 'problem')} drawn within the joint limits, with one random posture each",
        "source": solver.search.source,
        "solved": f"from one start; {_MOST_STARTS} starts: within the joint limits too. Closed form: within the limits "
        "at the elbow of the equations; other elbows are not tried",
    }
    for key, result in searches.items():
        comparison.series |= {key: result.history, f"{key}.outcome": result.outcome}


def _solutions_of_methods(kin: Kinematics, solver: PointSolver, problems: Problems, limits: Array) -> _Solutions:
    """Solve all problems by each method, the searches from several starts."""
    closed = solver.closed(problems.Ts)
    points = solver.solve_many(problems.tips, problems.trocars, limits, starts=_MOST_STARTS)
    joints = np.full_like(problems.starts, np.nan)
    for i, (tip, trocar) in enumerate(zip(problems.tips, problems.trocars, strict=True)):
        task = _TASK_WEIGHT * (Tip(tip) + Trocar(trocar, solver.search.axis))
        # each problem with a seed of its own, so that it does not depend on the problems before
        try:
            joints[i] = solve(kin, task, limits=limits, starts=_MOST_STARTS, any_branch=True, rng=i).q
        except KinematicsError:
            continue
    within_limits = points.excess <= _LIMIT_ROUNDING
    by_joints_solved = np.asarray(np.isfinite(joints).all(axis=1))
    wrists = closed[:, -1]
    off_points = np.linalg.norm(points.points[:, -1] - wrists, axis=1)
    off_joints = np.full(len(joints), np.nan)
    wrists_by_joints = solver.places(joints[by_joints_solved])[:, -1]
    off_joints[by_joints_solved] = np.linalg.norm(wrists_by_joints - wrists[by_joints_solved], axis=1)
    by_all = np.isfinite(closed).all(axis=(1, 2)) & within_limits & by_joints_solved
    return _Solutions(
        points=points,
        within_limits=within_limits,
        by_joints=by_joints_solved,
        off_points=off_points,
        off_joints=off_joints,
        by_all=by_all,
    )


def _judge_wrists(solver: PointSolver, solutions: _Solutions, comparison: EquationsComparison) -> None:
    """Add a row for each search: the wrist against the closed form, at the problems that all methods solve."""
    wrist = solver.search.unknowns[-1]
    chosen = solutions.by_all
    note = f"against the closed form, at {chosen.sum()} of {len(chosen)} random problems, which all methods solve"
    what = "the methods for tip and trocar give different positions"
    _add_row(
        comparison,
        "A",
        f"{wrist} by points",
        differences=solutions.off_points[chosen],
        tolerance=METHODS_TOLERANCE,
        note=note,
        what=what,
    )
    _add_row(
        comparison,
        "A",
        f"{wrist} by joints",
        differences=solutions.off_joints[chosen],
        tolerance=METHODS_TOLERANCE,
        note=note,
        what=what,
    )


def _methods_table(
    solver: PointSolver, searches: Mapping[str, OneStartResult], solutions: _Solutions, closed_inside: int
) -> TextTable:
    """Return the table of all methods.

    `searches` are the results from one start, as in `SEARCHES`; `closed_inside` is the number of problems at which the
    closed form is within the joint limits.
    """
    names = " and ".join(solver.search.unknowns)
    wrist = solver.search.unknowns[-1]
    chosen = solutions.by_all
    # the search from several starts also begins with the wrist outside the trocar, so that its numbers are in that row
    points_solved = (f"{solutions.within_limits.sum()}", _largest_text(solutions.off_points[chosen]))
    joints_solved = (f"{solutions.by_joints.sum()}", _largest_text(solutions.off_joints[chosen]))
    from_random = searches["search.points"].cells()
    from_outside = searches["search.outside"].cells()
    by_joint_search = searches["search.joints"].cells()
    return TextTable(
        (
            "method",
            "solved",
            "arm beyond tip",
            "not converged",
            "steps",
            f"solved in {_MOST_STARTS} starts",
            f"{wrist} off by",
        ),
        (
            (f"{names}, from random postures", *from_random, "", ""),
            (f"{names}, {wrist} outside the trocar", *from_outside, *points_solved),
            ("joints, from the same postures", *by_joint_search, *joints_solved),
            ("closed form, elbow as in the equations", f"{closed_inside}", "", "", "", "", ""),
        ),
    )


def _largest_text(distances: Array) -> str:
    """Return the largest of some distances in m as text, also below 1 pm."""
    return f"{power(float(distances.max(initial=0.0)), 2)} m"


def _judge_along_protocol(solver: PointSolver, case: Case, comparison: EquationsComparison) -> None:
    """Add a row for each point: the search against the closed form at the tool poses of the protocol."""
    Ts = case.trajectory.Ts_base_tool[comparison.coarse]
    q = solver.inverse_many(Ts)
    distance = np.linalg.norm(solver.places(q) - solver.closed(Ts), axis=2)
    for i, name in enumerate(solver.search.unknowns):
        distances = distance[:, i][np.isfinite(distance[:, i])]
        note = f"against the closed form, at {len(distances)} of {len(Ts)} poses of the protocol"
        what = "along the protocol, the optimisation and the closed form give different positions"
        _add_row(
            comparison,
            "A",
            f"{name} along the protocol",
            differences=distances,
            tolerance=METHODS_TOLERANCE,
            note=note,
            what=what,
            phase="protocol",
        )


def _judge_mechanism(
    model: ReferenceModel,
    problems: Problems,
    solutions: _Solutions,
    axis: tuple[float, float, float],
    case: Case,
    comparison: EquationsComparison,
) -> None:
    """Add rows for tip and shaft of the mechanism, driven to the joints of the search for points."""
    qs = solutions.points.q
    solved = solutions.within_limits
    states, _ = Closing(model, np.ones(qs.shape[1])).states(qs[solved])
    Ts = model.collect(states).Ts_base_tool
    tips = problems.tips[solved]
    trocars = problems.trocars[solved]
    shaft = Ts[:, :3, :3] @ np.asarray(axis)
    note = f"mechanism at the joints of the optimisation, {solved.sum()} of {len(qs)} random problems"
    distance = np.linalg.norm(Ts[:, :3, 3] - tips, axis=1)
    missed = np.linalg.norm(np.cross(trocars - Ts[:, :3, 3], shaft), axis=1)
    for name, values in (("tip by points", distance), ("shaft by points", missed)):
        _add_row(
            comparison,
            "A-B",
            name,
            differences=values,
            tolerance=case.tolerances.position,
            note=note,
            what=f"the mechanism misses its target: {name}",
        )


def _add_row(
    comparison: EquationsComparison,
    pair: str,
    name: str,
    differences: Array,
    tolerance: float,
    note: str,
    what: str,
    phase: str = _PROBLEMS_PHASE,
) -> None:
    """Add a row for differences (k,) in m and, if it disagrees, a finding."""
    if not len(differences):
        return
    residual = Residual(
        pair,
        "trocar",
        name,
        unit="m",
        worst=float(differences.max()),
        rms=float(np.sqrt(np.mean(differences**2))),
        tolerance=tolerance,
        t=0.0,
        phase=phase,
        samples=len(differences),
        note=note,
    )
    comparison.judge(residual, _MISSES if pair == "A-B" else _DIFFERS, what, when=phase)
