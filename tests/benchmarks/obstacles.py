"""Paths out of the dome: our FMT* against OMPL's with the same space, samples and collision function.

OMPL is not in the environment: `uv pip install --no-deps --target DIR ompl` puts it into a folder of its own. All times
are times of the processor.

    PYTHONPATH=DIR python tests/benchmarks/obstacles.py [--full]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import twin
from twin.api.scene_obstacles import obstacles_in_base
from twin.planning.fmt import FmtSearch
from twin.planning.obstacle_avoidance import shortcuts
from twin.reference.follower import Follower
from twin.reference.joint_space import JointSpace

ROOT = Path(__file__).resolve().parents[2]
CLEARANCE = 2e-3
SECONDS = 30.0  # of processor time, for one run of OMPL
JOINTS = 6  # the jaw stays where it is, as in the paper


def problem(clearance=CLEARANCE):
    """Return (space, start, goal, box) of phase `out` of the protocol dome; `clearance`: required distance in m."""
    robot = twin.load("raven_left")
    protocol, follower = robot.protocol(ROOT / "trajectories/raven_left/around/dome.toml"), Follower(robot.reference)
    space = JointSpace(
        lambda: follower.model, clearance, around=lambda: obstacles_in_base("dome", "raven_left", twin.load)
    )
    home = follower.model.home()
    ends = []
    for name in ("below", "above"):
        q = home.q.copy()
        for joint, value in (protocol.waypoints[name].joints or {}).items():
            i = [j.name for j in follower.model.mechanism.active].index(joint)
            q[i] = value
        ends.append(q)
    start, goal = ends
    wider = 0.15 * np.ptp(space.limits, axis=1)
    box = np.column_stack([np.minimum(start, goal) - wider, np.maximum(start, goal) + wider])
    box = np.clip(box, space.limits[:, :1], space.limits[:, 1:])
    box[JOINTS:] = start[JOINTS:, None]
    return space, start, goal, box


def length(space, corners):
    """Return the length in m of a path along corners (k, n)."""
    return float(np.linalg.norm(np.diff(corners, axis=0) * space.weights, axis=1).sum())


def ours(space, start, goal, box, samples, seed):
    """Return (seconds, length in m; nan if there is no path) of our search."""
    began = time.process_time()
    corners = FmtSearch(space, start, goal, box, np.random.default_rng(seed)).path(samples)
    return time.process_time() - began, np.nan if corners is None else length(space, corners)


def ours_to(space, start, goal, box, seed, goal_length):
    """Return seconds until our search, with shortcuts, has a path that is not longer than `goal_length`."""
    rng, samples, began = np.random.default_rng(seed), 100, time.process_time()
    search = FmtSearch(space, start, goal, box, rng)
    while time.process_time() - began < 60:
        corners = search.path(samples)
        if corners is not None and length(space, [corners, *shortcuts(space, corners, rng)][-1]) <= goal_length:
            return time.process_time() - began
        samples = int(1.5 * samples)
    return np.nan


def by_bounds(space):
    """Return our test of states: the bounds of distances that our search uses, for one state at a time."""
    return lambda q: bool(space.free(q[None], exact=False)[0])


def by_coal(space):
    """Return a test of states in C++: Pinocchio with coal, for the pairs and required distances of the space."""
    import coal
    import pinocchio as pin

    pairs, model = space._pairs, space._model.tree.model
    geometry, ids = pin.GeometryModel(), []
    for shape, number, T in zip(pairs.shapes, pairs._joint_numbers, pairs._Ts_joint_shape, strict=True):
        place = pin.SE3(T[:3, :3], T[:3, 3])
        ids.append(geometry.addGeometryObject(pin.GeometryObject(shape.name, int(number), 0, place, shape.model)))
    for a, b in pairs.rows:
        geometry.addCollisionPair(pin.CollisionPair(ids[a], ids[b]))
    data, found = model.createData(), pin.GeometryData(geometry)
    for request, required in zip(found.collisionRequests, pairs.required, strict=True):
        request.security_margin = required
    assert isinstance(found.collisionRequests[0], coal.CollisionRequest)
    return lambda q: not pin.computeCollisions(model, data, geometry, found, space._placed(q[None])[0], True)


def ompls(space, start, goal, box, samples, seed, free, *, planner="FMT", seconds=SECONDS):
    """Return (seconds, length in m; nan if there is no path) of an OMPL planner with the test of states `free`.

    `seconds` is a limit of processor time, so that other work on the machine does not shorten the search.
    OMPL asks for one state at a time. Its space holds the weighted coordinates, so that it measures the same length.
    It tests states on a connection at 1 % of its extent, our search every interval of a connection, until two bodies
    move by less than 6 mm from a tested state.
    """
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)
    weights, n = space.weights, JOINTS
    state_space = base.RealVectorStateSpace(n)
    bounds = base.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, box[i, 0] * weights[i])
        bounds.setHigh(i, box[i, 1] * weights[i])
    state_space.setBounds(bounds)
    info = base.SpaceInformation(state_space)
    rest, asked = start[n:], [0]

    def valid(state):
        asked[0] += 1
        return free(np.concatenate([[state[i] / weights[i] for i in range(n)], rest]))

    info.setStateValidityChecker(valid)
    info.setStateValidityCheckingResolution(0.01)
    info.setup()
    task = base.ProblemDefinition(info)
    first, last = info.allocState(), info.allocState()
    for i in range(n):
        first[i], last[i] = start[i] * weights[i], goal[i] * weights[i]
    task.setStartAndGoalStates(first, last)
    task.setOptimizationObjective(base.PathLengthOptimizationObjective(info))
    solver = getattr(geometric, planner)(info)
    if planner == "FMT":
        solver.setNumSamples(samples)
    solver.setProblemDefinition(task)
    solver.setup()
    began = time.process_time()
    solved = solver.solve(base.PlannerTerminationCondition(lambda: time.process_time() - began > seconds))
    took = time.process_time() - began
    path = task.getSolutionPath() if solved and task.hasExactSolution() else None
    return took, np.nan if path is None else float(path.length())


def main(counts: tuple[int, ...], seeds: int) -> None:
    """Print times and lengths, contenders in turns."""
    space, start, goal, box = problem()
    ours(space, start, goal, box, 100, 99)  # loads grids, which a space keeps
    tests = {"bounds": by_bounds(space), "coal in C++": by_coal(space)}
    for samples in counts:
        rows = []
        for seed in range(seeds):
            row = [*ours(space, start, goal, box, samples, seed)]
            for free in tests.values():
                took, cost = ompls(space, start, goal, box, samples, seed, free)
                row += [took, cost, ours_to(space, start, goal, box, seed, cost) if cost > 0 else np.nan]
            rows.append(row)
            print(samples, seed, np.round(row, 3), flush=True)
        a = np.array(rows)
        print(f"{samples} samples: ours {np.median(a[:, 0]):.3f} s, length {np.nanmean(a[:, 1]):.4f} m")
        for k, name in enumerate(tests):
            took, cost, same = a[:, 2 + 3 * k : 5 + 3 * k].T
            if np.isnan(cost).all():
                print(f"  OMPL's FMT with {name}: no path in {SECONDS:.0f} s")
                continue
            print(
                f"  OMPL's FMT with {name}: {np.median(took):.3f} s, {np.nanmean(cost):.4f} m; "
                f"{np.median(took / a[:, 0]):.1f} times the time of our search; {np.nanmedian(took / same):.1f} times "
                "that to the same length with shortcuts"
            )


if __name__ == "__main__":
    main((500, 1000, 2000) if "--full" in sys.argv else (200, 500), 3 if "--full" in sys.argv else 1)
