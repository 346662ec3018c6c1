"""Solve tip and trocar by three methods, and compare them with each other and with the mechanism.

The methods are: the inverse equations in closed form; Levenberg-Marquardt on points of the arm, where a paper has it
(`PointSearch`); Levenberg-Marquardt on the joints (`kinematics.solve`). The problems are drawn within the joint limits,
so that each has a solution. The wrist of a problem is determined; the elbow is compared at the samples of the protocol,
where the search keeps the redundant joint as in the equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.findings import Kind
from twin.core.format import count, power
from twin.core.result import TextTable
from twin.core.spatial import Array
from twin.kinematics import Kinematics, Tip, Trocar, solve
from twin.kinematics.point_search import PointSolver, point_solver
from twin.kinematics.solve import TOLERANCE as SOLVED
from twin.kinematics.solve import descend
from twin.reference import ReferenceModel
from twin.reference.closing import Closing
from twin.validation.case import Case
from twin.validation.compare import EquationsComparison
from twin.validation.result import Residual

HEADING = "tip and trocar by three methods"

PROBLEMS = 300
"""Number of random problems, and of random postures to start from."""

EXACT = 1e-12
"""Tolerance in m between the methods: rounding errors of an arm of 1 m are a thousandth of it."""

SEARCHES = {
    "search.points": "points, from random postures",
    "search.outside": "points, wrist outside the trocar",
    "search.joints": "joints, from the same postures",
}
"""Title of each kind of search, by the name of its curves in a report."""

OUTCOMES = ("solved", "arm beyond the tip", "not converged")
"""Outcomes of a search; their indices are the values of `Single.outcome`."""

_SEED = 0

_DEPTHS = (0.125, 0.875)
"""Smallest and largest insertion depth of a problem, relative to the distance from wrist to tip."""

_SHARPENED = 100.0
"""Weight of the task of the joint-space method, so that it ends where the wrist is determined within `EXACT`."""

_PHASE = "random problems"

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
class Single:
    """Results of one start for each problem.

    Attributes:
        history: (k, s) residual in m at the start and after each step; NaN after the end.
        outcome: (k,) index in `OUTCOMES`.
        steps: (k,) number of steps tried.
    """

    history: Array
    outcome: np.ndarray
    steps: np.ndarray

    def cells(self) -> tuple[str, ...]:
        """Return the cells of a table: number of each outcome, median number of steps of the solved ones."""
        numbers = np.bincount(self.outcome, minlength=len(OUTCOMES)).tolist()
        solved = self.outcome == 0
        median = ""
        if solved.any():
            median = f"{np.median(self.steps[solved]):.0f}"
        return (*map(str, numbers), median)


def three_methods(case: Case, out: EquationsComparison, number: int = PROBLEMS) -> None:
    """Add rows, findings, a table and curves of the comparison to `out`; skip it if a row of `out` disagrees.

    `number` is the number of random problems.
    """
    kin = case.kinematics
    if kin is None or kin.formula.point_search is None:
        return
    for row in out.residuals:
        if row.pair == "A-B" and not row.agrees:
            out.facts[HEADING] = {"compared": "no, because other rows disagree"}
            return
    try:
        _compare(kin, case.model, case.cad.mechanism.limits, case, out, number)
    except KinematicsError as error:
        out.findings.append(_DIFFERS(kin.formula.name, f"tip and trocar cannot be solved: {error}", None, None))


def problems(kin: Kinematics, solver: PointSolver, limits: Array, number: int) -> Problems:
    """Return random problems, each with a solution within the joint limits (n, 2), and random starts within them."""
    rng = np.random.default_rng(_SEED)
    reach = np.where(kin.revolute, np.pi, 1.0)
    low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -reach)
    high = np.where(np.isfinite(limits[:, 1]), limits[:, 1], reach)
    qs = rng.uniform(low, high, (number, len(low)))
    Ts = kin.forward_many(qs)
    tips = Ts[:, :3, 3]
    length = np.linalg.norm(solver.places(qs)[:, -1] - tips, axis=1)
    depths = rng.uniform(*_DEPTHS, number) * length
    trocars = tips - depths[:, None] * (Ts[:, :3, :3] @ np.asarray(solver.search.axis))
    return Problems(Ts, tips, trocars, rng.uniform(low, high, (number, len(low))))


def by_points(solver: PointSolver, given: Problems, outside: bool = False) -> Single:
    """Run the search for points once for each problem; `outside`: start with the wrist outside the trocar."""
    begin = solver.places(given.starts)
    if outside:
        begin = solver.outside(begin, given.tips, given.trocars)
    found = solver.descend(begin, given.tips, given.trocars)
    outcome = np.where(found.solved, 0, np.where(found.converged, 1, 2))
    return Single(found.history, outcome, found.iterations)


def by_joints(kin: Kinematics, given: Problems, limits: Array, axis: tuple[float, float, float]) -> Single:
    """Run the joint-space search once for each problem, within the limits; the arm is never beyond the tip."""
    histories: list[list[float]] = []
    outcome = np.zeros(len(given.starts), int)
    steps = np.zeros(len(given.starts), int)
    for i, (tip, trocar, q) in enumerate(zip(given.tips, given.trocars, given.starts, strict=True)):
        history: list[float] = []
        found = descend(kin, Tip(tip) + Trocar(trocar, axis), q, limits, history=history)
        histories.append(history)
        if not found.residual <= SOLVED:  # true also for NaN
            outcome[i] = 2
        steps[i] = found.iterations
    longest = max(map(len, histories))
    residuals = np.full((len(histories), longest), np.nan)
    for row, history in zip(residuals, histories, strict=True):
        row[: len(history)] = history
    # the search has lengths in units of the characteristic length
    return Single(residuals * kin.characteristic_length, outcome, steps)


def _compare(
    kin: Kinematics, model: ReferenceModel, limits: Array, case: Case, out: EquationsComparison, number: int
) -> None:
    solver = point_solver(kin)
    axis = solver.search.axis
    given = problems(kin, solver, limits, number)
    closed = solver.closed(given.Ts)
    points = solver.solve_many(given.tips, given.trocars, limits)
    joints = np.full_like(given.starts, np.nan)
    for i, (tip, trocar) in enumerate(zip(given.tips, given.trocars, strict=True)):
        try:
            task = _SHARPENED * (Tip(tip) + Trocar(trocar, axis))
            joints[i] = solve(kin, task, limits=limits, any_branch=True, rng=i).q
        except KinematicsError:
            continue
    by_limits = points.excess <= 1e-9
    all_solved = np.isfinite(closed).all(axis=(1, 2)) & by_limits & np.isfinite(joints).all(axis=1)
    wrist = solver.search.unknowns[-1]
    off_points = np.linalg.norm(points.points[:, -1] - closed[:, -1], axis=1)
    off_joints = np.full(len(joints), np.nan)
    known = np.isfinite(joints).all(axis=1)
    off_joints[known] = np.linalg.norm(solver.places(joints[known])[:, -1] - closed[known, -1], axis=1)
    note = f"against the closed form, at {all_solved.sum()} of {number} random problems, which all methods solve"
    for name, off in ((f"{wrist} by points", off_points), (f"{wrist} by joints", off_joints)):
        _row(out, "A", name, off[all_solved], EXACT, note, "the methods for tip and trocar give different positions")
    _along(solver, case, out)
    _mechanism(model, given, points.q, by_limits, axis, case, out)
    first = by_points(solver, given)
    outside = by_points(solver, given, outside=True)
    alone = by_joints(kin, given, limits, axis)
    names = " and ".join(solver.search.unknowns)
    reached = (f"{by_limits.sum()}", _largest(off_points[all_solved]))
    by_joint = (f"{known.sum()}", _largest(off_joints[all_solved]))
    of_equations = kin.inverse_many(given.Ts)
    inside = ((of_equations >= limits[:, 0]) & (of_equations <= limits[:, 1])).all(axis=1)
    out.tables[HEADING] = TextTable(
        ("method", "solved", "arm beyond tip", "not converged", "steps", "solved in 48 starts", f"{wrist} off by"),
        (
            (f"{names}, from random postures", *first.cells(), "", ""),
            (f"{names}, {wrist} outside the trocar", *outside.cells(), *reached),
            ("joints, from the same postures", *alone.cells(), *by_joint),
            ("closed form, elbow as in the equations", f"{inside.sum()}", "", "", "", "", ""),
        ),
    )
    out.facts[HEADING] = {
        "problems": f"{count(number, 'problem')} drawn within the joint limits, with one random posture each",
        "source": solver.search.source,
        "solved": "from one start; 48 starts: within the joint limits too. Closed form: within the limits at the "
        "elbow of the equations; other elbows are not tried",
    }
    for key, single in zip(SEARCHES, (first, outside, alone), strict=True):
        out.series |= {key: single.history, f"{key}.outcome": single.outcome}


def _largest(off: Array) -> str:
    """Return the largest of some distances in m as text, also below 1 pm."""
    return f"{power(float(off.max(initial=0.0)), 2)} m"


def _along(solver: PointSolver, case: Case, out: EquationsComparison) -> None:
    """Add a row for each point: the search against the closed form at the tool poses of the protocol."""
    Ts = case.trajectory.Ts_base_tool[out.coarse]
    q = solver.inverse_many(Ts)
    distance = np.linalg.norm(solver.places(q) - solver.closed(Ts), axis=2)
    for i, name in enumerate(solver.search.unknowns):
        known = distance[:, i][np.isfinite(distance[:, i])]
        note = f"against the closed form, at {len(known)} of {len(Ts)} poses of the protocol"
        what = "along the protocol, the optimisation and the closed form give different positions"
        _row(out, "A", f"{name} along the protocol", known, EXACT, note, what, "protocol")


def _mechanism(
    model: ReferenceModel,
    given: Problems,
    qs: Array,
    solved: np.ndarray,
    axis: tuple[float, float, float],
    case: Case,
    out: EquationsComparison,
) -> None:
    """Add rows for tip and shaft of the mechanism, driven to the joints of the search for points."""
    states, _ = Closing(model, np.ones(qs.shape[1])).states(qs[solved])
    Ts = model.collect(states).Ts_base_tool
    tips = given.tips[solved]
    trocars = given.trocars[solved]
    shaft = Ts[:, :3, :3] @ np.asarray(axis)
    note = f"mechanism at the joints of the optimisation, {solved.sum()} of {len(qs)} random problems"
    distance = np.linalg.norm(Ts[:, :3, 3] - tips, axis=1)
    missed = np.linalg.norm(np.cross(trocars - Ts[:, :3, 3], shaft), axis=1)
    for name, values in (("tip by points", distance), ("shaft by points", missed)):
        _row(out, "A-B", name, values, case.tolerances.position, note, f"the mechanism misses its target: {name}")


def _row(
    out: EquationsComparison,
    pair: str,
    name: str,
    off: Array,
    tolerance: float,
    note: str,
    what: str,
    phase: str = _PHASE,
) -> None:
    """Add a row for differences (k,) in m and, if it disagrees, a finding."""
    if not len(off):
        return
    r = Residual(
        pair,
        "trocar",
        name,
        "m",
        float(off.max()),
        float(np.sqrt(np.mean(off**2))),
        tolerance,
        0.0,
        phase,
        samples=len(off),
        note=note,
    )
    out.judge(r, _MISSES if pair == "A-B" else _DIFFERS, what, when=phase)
