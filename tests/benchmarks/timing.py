"""Time-optimal rates along splines of 10 waypoints: our two passes against toppra and Drake's Toppra, the same grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from race import Contender, Effort, Fact, Table, installed, race, show
from scipy.interpolate import CubicSpline

from twin.core.errors import TimingError
from twin.planning import timing, topp, toppra_solver

PATHS = 3
WAYPOINTS = np.linspace(0, 1, 10)


def topic(effort: Effort) -> list[Table]:
    """Race all at every number of grid points, then try paths of micrometres."""
    tables = [at(effort, 6, points) for points in ((200, 1000) if effort.short else (200, 1000, 5000))]
    if not effort.short:
        tables.append(at(effort, 8, 1000))
    small = Table(
        "tiny", "Paths of 1 and 10 µm between 10 waypoints, 10 mm/s, 100 mm/s²", facts=tiny(effort.of(200, 10))
    )
    show(small)
    return [*tables, small]


def at(effort: Effort, m: int, points: int) -> Table:
    """Race all on splines of m coordinates."""
    title = f"Time-optimal rate along {PATHS} random splines, {m} coordinates, {points} grid points: time of one path"
    judge = "largest relative difference of a duration to toppra's"
    table = Table(f"{m}x{points}", title, judge=judge, limit=1e-4)
    rng = np.random.default_rng(points)
    grid, problems, splines = np.linspace(0, 1, points), [], []
    for _ in range(PATHS):
        waypoints = rng.normal(size=(10, m))
        path = CubicSpline(WAYPOINTS, waypoints)
        size = 0.02 * np.max(np.abs(path(grid, 2)))
        first, second = (np.ascontiguousarray(path(grid, order).T) / size for order in (1, 2))
        problems.append((grid, first, second, rng.uniform(0.5, 2, m)))
        splines.append(waypoints / size)
    durations = [_duration(grid, toppra_solver.fastest(*p)) for p in problems]

    def off(found: list[float]) -> float:
        return float(np.max(np.abs(np.array(found) / durations - 1)))

    mine = off([_duration(grid, topp.fastest(*p)) for p in problems])
    rows = [Contender("twin: two passes", lambda: [topp.fastest(*p) for p in problems], PATHS, mine)]
    rows.append(Contender("toppra, seidel", lambda: [toppra_solver.fastest(*p) for p in problems], PATHS, 0.0))
    if installed(table, "pydrake", "Drake Toppra"):
        for name, scheme in (("interpolation", "kInterpolation"), ("collocation", "kCollocation")):
            run = drake(grid, splines, [p[3] for p in problems], scheme)
            found = [d for d in run() if d is not None]
            if len(found) < PATHS:
                table.notes.append(f"Drake Toppra by {name} fails on {PATHS - len(found)} of {PATHS} paths.")
            if len(found) == PATHS:
                rows.append(Contender(f"Drake Toppra, {name}", run, PATHS, off(found), bar=3.0))
    return race(table, rows, effort)


def _duration(grid: np.ndarray, rates: np.ndarray) -> float:
    return float(np.sum(2 * np.diff(grid) / (rates[1:] + rates[:-1])))


def drake(grid: np.ndarray, splines: list, speeds: list, scheme: str) -> Callable[[], list[float | None]]:
    """Return the durations by Drake; None where it gives up."""
    from pydrake.multibody.optimization import Toppra, ToppraDiscretization
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
    from pydrake.trajectories import PiecewisePolynomial

    plant = MultibodyPlant(0.0)
    m = len(speeds[0])
    parent = plant.world_frame()
    for j in range(m):
        body = plant.AddRigidBody(f"b{j}", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        plant.AddJoint(PrismaticJoint(f"q{j}", parent, body.body_frame(), np.array([1.0, 0, 0])))
        parent = body.body_frame()
    plant.Finalize()
    how = getattr(ToppraDiscretization, scheme)
    paths = [PiecewisePolynomial.CubicWithContinuousSecondDerivatives(WAYPOINTS, w.T, False) for w in splines]

    def run() -> list[float | None]:
        out: list[float | None] = []
        for path, speed in zip(paths, speeds, strict=True):
            solver = Toppra(path, plant, grid)
            solver.AddJointVelocityLimit(-speed, speed)
            solver.AddJointAccelerationLimit(-np.ones(m), np.ones(m), how)
            found = solver.SolvePathParameterization(0.0, 0.0)
            out.append(None if found is None else found.end_time())
        return out

    return run


def tiny(count: int) -> list[Fact]:
    """Return how many paths of micrometres each cannot time: ours, and toppra as its users call it."""
    import toppra
    import toppra.algorithm as algorithm
    import toppra.constraint as constraint

    toppra.setup_logging("ERROR")
    rng = np.random.default_rng(7)
    failed = {"twin": 0, "toppra": 0}
    speed, acceleration = np.full(6, 0.01), np.full(6, 0.1)

    for k in range(count):
        waypoints = rng.normal(size=(10, 6)) * (1e-6 if k % 2 else 1e-5)
        try:
            timing.time_path(CubicSpline(WAYPOINTS, waypoints), speed, acceleration)
        except TimingError:
            failed["twin"] += 1
        limits = [
            constraint.JointVelocityConstraint(np.stack([-speed, speed], axis=1)),
            constraint.JointAccelerationConstraint(np.stack([-acceleration, acceleration], axis=1)),
        ]
        spline = toppra.SplineInterpolator(WAYPOINTS, waypoints)
        plain = algorithm.TOPPRA(
            limits, spline, gridpoints=np.linspace(0, 1, 200), parametrizer="ParametrizeConstAccel"
        )
        failed["toppra"] += plain.compute_trajectory(0, 0) is None
    return [
        Fact(f"twin: not timed, of {count}", failed["twin"], bar=0),
        Fact(f"toppra as it comes: not timed, of {count}", failed["toppra"]),
    ]
