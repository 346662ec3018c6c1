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
from twin.api.standing import standing
from twin.planning.fmt import Search
from twin.reference.following import Follower
from twin.reference.space import JointSpace

ROOT = Path(__file__).resolve().parents[2]
CLEARANCE = 2e-3
JOINTS = 6  # the jaw stays where it is, as in the paper


def problem():
    """Return (space, start, goal, box) of phase `out` of the protocol dome."""
    robot = twin.load("raven_left")
    protocol, follower = robot.protocol(ROOT / "trajectories/raven_left/around/dome.toml"), Follower(robot.reference)
    space = JointSpace(lambda: follower.model, CLEARANCE, around=lambda: standing("dome", "raven_left", twin.load))
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
    """Return (seconds, length in m; nan if there is no path, path) of our search."""
    began = time.process_time()
    corners = Search(space, start, goal, box, np.random.default_rng(seed)).path(samples)
    return time.process_time() - began, np.nan if corners is None else length(space, corners)


def ompls(space, start, goal, box, samples, seed, *, planner="FMT", seconds=60.0):
    """Return (seconds, length in m; nan if there is no path) of an OMPL planner with the same collision function.

    OMPL asks for one state at a time. Its space holds the weighted coordinates, so that it measures the same length.
    It tests states on a connection at 1 % of its extent, our search where no pair of bodies moves by more than 8 mm.
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
    rest = start[n:]

    def valid(state):
        q = np.concatenate([[state[i] / weights[i] for i in range(n)], rest])
        return not space._pairs.near(space._placed(q[None]))[0]  # the function of `free_each`

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
    solved = solver.solve(base.timedPlannerTerminationCondition(seconds))
    took = time.process_time() - began
    path = task.getSolutionPath() if solved else None
    return took, np.nan if path is None else float(path.length())


def main(full: bool) -> None:
    """Print times and lengths, contenders in turns."""
    space, start, goal, box = problem()
    ours(space, start, goal, box, 100, 99)  # builds grids and cells, which a space keeps
    for samples in (500, 1000, 2000) if full else (200,):
        rows = []
        for seed in range(3 if full else 1):
            rows.append((*ours(space, start, goal, box, samples, seed), *ompls(space, start, goal, box, samples, seed)))
            print(samples, seed, np.round(rows[-1], 4), flush=True)
        a = np.array(rows)
        print(
            f"{samples} samples: ours {np.median(a[:, 0]):.3f} s, length {np.nanmean(a[:, 1]):.4f} m; OMPL FMT "
            f"{np.median(a[:, 2]):.3f} s, {np.nanmean(a[:, 3]):.4f} m; ratio {np.median(a[:, 2] / a[:, 0]):.1f}"
        )


if __name__ == "__main__":
    main("--full" in sys.argv)
