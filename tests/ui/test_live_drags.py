"""Random drags of random links: the end does not depend on the speed of the hand, and the assembly stays.

`TWIN_DRAGS=2000` leads so many, over all robots; `TWIN_PARALLEL_ROBOTS`, a checkout of example-parallel-robots, adds
two of them. What was found is printed (`-s`). Times are the processor's.
"""

from __future__ import annotations

import os
import re
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from made.lanes import contrasting, one_of_a_kind
from twin.cli import main
from twin.core.units import MM
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.readings import read

DRAGS = int(os.environ.get("TWIN_DRAGS", "20"))
SPEEDS = (50 * MM, 5 * MM, 1 * MM, 0.2 * MM)
"""Lengths of the way between two positions of the hand."""

STRANGERS = ("robot_delta", "disney_like")
PASSES = 60
"""Calls for one position of the hand that only time may ask for."""


def robots():
    folder = os.environ.get("TWIN_PARALLEL_ROBOTS")
    return [*one_of_a_kind(), *(STRANGERS if folder else ())]


@pytest.fixture(scope="module", params=robots())
def robot(request, tmp_path_factory):
    if request.param not in STRANGERS:
        return twin.load(request.param)
    out = tmp_path_factory.mktemp("robots") / request.param
    source = Path(os.environ["TWIN_PARALLEL_ROBOTS"]) / request.param / "robot.urdf"
    assert main(["new", request.param, "--from", str(source), "--out", str(out), "--quiet"]) == 0
    return twin.load(out)


def size_of(mechanism):
    corners = np.array([T[:3, 3] for T in mechanism.rest.values()])
    return float(np.linalg.norm(np.ptp(corners, axis=0)))


def drags(movable, rng, count):
    """Yield a body, a point on it and a way, up to 50 mm and a tenth of the robot."""
    mechanism = movable.mechanism
    bodies = [b for b in mechanism.bodies if b.name != mechanism.base]
    longest = min(50 * MM, 0.1 * size_of(mechanism))
    for _ in range(count):
        body = bodies[rng.integers(len(bodies))]
        meshes = [m.vertices for m in body.meshes]
        if meshes:
            vertices = meshes[rng.integers(len(meshes))]
            p = vertices[rng.integers(len(vertices))]
        else:
            p = rng.uniform(-50, 50, 3) * MM
        way = rng.normal(size=3)
        yield body.name, p, way / np.linalg.norm(way) * rng.uniform(0.2, 1.0) * longest


def led(movable, body, p, way, step):
    """Lead from home in steps of the hand; return the states passed, the end, its reason and times of refusals."""
    movable.go_to_posture("home")
    start = point(movable, body, p)
    count = max(1, round(np.linalg.norm(way) / step))
    passed, refused, solved, moved = [movable.assembly], [], [], None
    for k in range(1, count + 1):
        for _ in range(PASSES):
            begin = time.thread_time()
            moved = movable.move_point(body, p, start + way * (k / count))
            took = time.thread_time() - begin
            (solved if moved.good and not moved.more else refused).append(took)
            if not moved.more:
                break
        passed.append(movable.assembly)
    return SimpleNamespace(passed=passed, end=movable.assembly, p=point(movable, body, p), reason=stated(moved.reason),
                           text=moved.reason, refused=refused, solved=solved)  # fmt: skip


def stated(reason):
    """Return what a reason says, without its numbers."""
    return re.sub(r"[-\d.]+", "#", reason.partition("] mm: ")[2])


def point(movable, body, p):
    return (movable.assembly.link_poses[body] @ np.append(p, 1.0))[:3]


def flips(model, states):
    """Return how often an assembly ends between states, by Pinocchio's Jacobians alone: of loops, and of the tool."""
    tree, length = model.tree, 0.1
    X = np.array([s.x for s in states])
    poses, J = tree.update(X, closing_only=True)
    A = tree.loops.evaluate(X, poses, J)[1][:, :, tree.passive]
    slides = np.where([j.is_angle for j in model.mechanism.active], 1.0, length)
    tool = tree.tool_jacobian(poses, J) @ model.gains(X) * slides
    tool = np.concatenate([tool[:, :3] / length, tool[:, 3:]], axis=1)
    found = {"loops": 0, "tool": 0}
    for name, M in (("loops", A), ("tool", tool)):
        if 0 in M.shape[1:] or (name == "tool" and M.shape[2] > 6):
            continue
        for before, after in pairwise(M):
            U, s, Vt = np.linalg.svd(before)
            r = int(np.sum(s > 1e-7 * s[0]))
            found[name] += np.linalg.det(U[:, :r].T @ after @ Vt[:r].T) < 0
    return found


def judged(movable, robot, drags, speeds):
    """Lead every drag at every speed; return counts, and what was wrong."""
    out = SimpleNamespace(
        drags=0, apart=[], flips=[], disagreeing=[], opened=[], refused=[], solved=[], stopped=0, worst=0.0
    )
    for body, p, way in drags:
        ends = [led(movable, body, p, way, speed) for speed in speeds]
        where = f"{robot.name} {body} {np.round(p / MM, 3).tolist()} by {np.round(way / MM, 3).tolist()} mm"
        out.drags += 1
        out.stopped += bool(ends[-1].text)
        apart = max(float(np.linalg.norm(e.p - ends[0].p)) for e in ends)
        if apart > 0.1 * MM and len({e.reason for e in ends}) > 1:
            out.apart.append(f"{where}: {apart / MM:.3f} mm apart: {[e.text for e in ends]}")
        if len({e.reason for e in ends}) == 1:
            out.worst = max(out.worst, apart if not ends[0].reason else 0.0)
        for e in ends:
            out.refused += e.refused
            out.solved += e.solved
            if e.end.worst_gap > 1e-9:
                out.opened.append(where)
        for e in ends[-2:]:
            if any(flips(movable.model, e.passed).values()):
                out.flips.append(f"{where}: {flips(movable.model, e.passed)}")
            movable.show(e.end)
            reading = read(movable)
            if not reading.agrees or not reading.comparable:
                out.disagreeing.append(f"{where}: {reading.residual}")
    return out


def test_a_drag_ends_where_it_ends_in_one_step_and_in_many(robot, rng):
    movable = MovableRobot(robot)
    found = judged(movable, robot, drags(movable, rng, 1), SPEEDS[:2])
    assert not found.flips + found.disagreeing + found.opened + found.apart


@pytest.mark.slow
def test_a_point_that_slides_along_two_limits_ends_in_one_place():
    """Where one way is hard and a limit stands in the other, a step of no length was taken for the last one."""
    movable = MovableRobot(twin.load("sils"))
    p, way = np.array([22.0, -2.8, -8.0]) * MM, np.array([-5.158, 5.119, 19.595]) * MM
    ends = [led(movable, "strut1", p, way, step) for step in (1 * MM, 50 * MM)]
    assert {e.reason for e in ends} == {"q# is at its limit of # mm"}
    np.testing.assert_allclose(ends[0].p, ends[1].p, atol=1e-6 * MM)


@pytest.mark.slow
@pytest.mark.parametrize("robot", contrasting(robots()), indirect=True, scope="module")
def test_the_speed_of_the_hand_does_not_matter_and_the_assembly_stays(robot, rng):
    movable = MovableRobot(robot)
    movable.solver.prepare()
    found = judged(movable, robot, drags(movable, rng, max(1, DRAGS // len(robots()))), SPEEDS)
    times = np.array(found.refused or [0.0]) * 1e3
    good = np.array(found.solved or [0.0]) * 1e3
    print(
        f"\n{robot.name}: {found.drags} drags, {found.stopped} stopped; ends apart {len(found.apart)}, assemblies left "
        f"{len(found.flips)}, disagreeing {len(found.disagreeing)}, open {len(found.opened)}; same ends within "
        f"{found.worst / MM:.2g} mm; refused p50 {np.median(times):.1f} p95 {np.quantile(times, 0.95):.1f} max "
        f"{times.max():.1f} ms of {len(found.refused)}, solved p95 {np.quantile(good, 0.95):.1f} ms"
    )
    for what in (found.flips, found.disagreeing, found.opened, found.apart):
        print("\n".join(what))
    assert not found.flips
    assert not found.disagreeing
    assert not found.opened
    assert not found.apart
    assert np.quantile(times, 0.95) < 20.0
