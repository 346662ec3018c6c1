"""Limits that a robot declares bind in workspace and drag: every state is checked again by code of this file alone."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

import twin
from made.lanes import contrasting, robots
from twin.analysis import grid_workspace as reach
from twin.analysis import joint_samples, workspace
from twin.analysis.declared_limits import beyond_limits
from twin.analysis.pose_grid import PoseGrid
from twin.core import spatial
from twin.core.errors import AssemblyError
from twin.kinematics.closed_loops import LoopSolver
from twin.kinematics.closed_loops.passive_limits import PassiveCheck
from twin.planning.check import check
from twin.ui.session.movable_robot import MovableRobot

POSES = int(os.environ.get("TWIN_LIMIT_POSES", "20000"))
DRAGS = int(os.environ.get("TWIN_LIMIT_DRAGS", "2"))

ROUNDED = 2e-9
"""Excess in m or rad that counts as rounding."""


def bound(name):
    robot = twin.load(name)
    return robot.bound(robot.protocol()) if robot.mechanism.trocars else robot


def frames(joint, links):
    """Return the frames (k, 4, 4) of a joint on its parent and on its child, in base."""
    return links[joint.parent] @ joint.T_parent_joint, links[joint.child] @ joint.T_child_joint


def coordinate(joint, A, B):
    """Return the coordinate (k,) of a joint with one, in m or rad."""
    if joint.type == "prismatic":
        return np.sum(A[:, :3, 2] * (B[:, :3, 3] - A[:, :3, 3]), axis=1)
    return np.arctan2(np.sum(A[:, :3, 1] * B[:, :3, 0], axis=1), np.sum(A[:, :3, 0] * B[:, :3, 0], axis=1))


def open_by(mechanism, links):
    """Return by how much in m or rad (times 0.1 m) any joint is apart in the directions that it locks."""
    worst = 0.0
    for joint in mechanism.joints:
        A, B = frames(joint, links)
        shift = np.einsum("kji,kj->ki", A[:, :3, :3], B[:, :3, 3] - A[:, :3, 3])
        turned = np.swapaxes(A[:, :3, :3], 1, 2) @ B[:, :3, :3]
        free = {"prismatic": (2,), "cylindrical": (2,), "free": (0, 1, 2)}.get(joint.type, ())
        worst = max(worst, *(np.abs(shift[:, i]).max() for i in range(3) if i not in free), 0.0)
        if joint.type in ("fixed", "prismatic"):
            worst = max(worst, 0.1 * np.abs(turned - np.eye(3)).max())
        elif joint.type in ("revolute", "cylindrical"):
            worst = max(worst, 0.1 * np.abs(turned[:, :2, 2]).max())
    return worst


def excess(mechanism, links, q):
    """Return (largest excess in m or rad over any declared limit, its name) at poses (k, 4, 4) of all bodies."""
    found = {"none": -np.inf}
    values = {}
    for joint in mechanism.joints:
        A, B = frames(joint, links)
        if joint.cone is not None:
            across = np.linalg.norm(np.cross(A[:, :3, 2], B[:, :3, 2]), axis=1)
            found[joint.name] = (np.arctan2(across, np.sum(A[:, :3, 2] * B[:, :3, 2], axis=1)) - joint.cone).max()
        if joint.type in ("prismatic", "revolute"):
            values[joint.name] = coordinate(joint, A, B)
        if joint.limits is None or joint.name not in values:
            continue
        low, high = joint.limits
        turns = 2 * np.pi * np.arange(-2, 3) if joint.type == "revolute" else np.zeros(1)
        x = values[joint.name][:, None] + turns
        found[joint.name] = np.maximum(low - x, x - high).min(axis=1).max()
    for i, joint in enumerate(mechanism.active):
        if joint.limits is not None:
            found[f"motion of {joint.name}"] = np.maximum(joint.limits[0] - q[:, i], q[:, i] - joint.limits[1]).max()
    column = {joint.name: q[:, i] for i, joint in enumerate(mechanism.active)}
    for transmission in mechanism.transmissions:
        motors = np.linalg.solve(transmission.matrix, np.array([column[n] for n in transmission.joints]))
        for name, m in zip(transmission.actuators, motors, strict=True):
            limits = mechanism.actuator(name).limits
            if limits is not None:
                found[name] = np.maximum(limits[0] - m, m - limits[1]).max()
    for coupling in mechanism.couplings:
        terms = [ratio * values[n] for n, ratio in zip(coupling.joints, coupling.ratios, strict=True)]
        found[coupling.name] = np.abs(sum(terms) - coupling.total).max() - 1e-7
    name = max(found, key=lambda n: found[n])
    return found[name], name


def test_a_cone_of_no_width_has_finite_slacks():
    mechanism = twin.load("sils").mechanism
    joints = []
    for joint in mechanism.joints:
        cone = None if joint.cone is None else 0.0
        joints.append(replace(joint, cone=cone))
    solver = LoopSolver(replace(mechanism, joints=tuple(joints)))
    check = PassiveCheck(solver)
    assert "cone" in {limit.kind for limit in check.limits}
    states = solver.forward_many(solver.q[None]).states
    assert np.isfinite(check.slacks(solver.q[None], states)).all()


# -- SILS ----------------------------------------------------------------------------------------------

L0, L1, L2, LP, LH, LV = (
    0.05,
    0.182,
    0.392,
    0.135,
    0.612,
    0.657,
)  # Ro. J. Techn. Sci. - Appl. Mech. 68(1), 2023, eq. (3)
BALLS = LP * np.array([[np.sqrt(3) / 6, -0.5, 0], [-np.sqrt(3) / 3, 0, 0], [np.sqrt(3) / 6, 0.5, 0]])
CONE = np.deg2rad(85.0)
LOW, HIGH = np.array([20, 20, -10, -10, 20, 20]) / 1e3, np.array([580, 580, 600, 600, 580, 580]) / 1e3
GAP = 0.04


def sils_reaches(P, R, home):
    """Return (k,) bool: whether SILS reaches positions P (k, 3) with the rotation R (3, 3), from plain geometry.

    Each ball is on a bar of length L1 + L2, whose other end is at the distance L0 from the rail. The carriages follow
    from the distance of the ball from its rail. `home` (3,) is a position in the drawn assembly mode.
    """
    ok = P[:, 0] > 0
    ok &= np.sign(platform(P, R)) == np.sign(platform(home[None], R))
    q = []
    S = [P + R @ a for a in BALLS]
    zero = np.zeros(len(P))
    limbs = (
        (S[0][:, 0], S[0][:, 1], S[0][:, 2], 1, np.array([0, 0, 1.0])),
        (S[1][:, 0], LV - S[1][:, 2], S[1][:, 1], -1, np.array([0, 1.0, 0])),
        (S[2][:, 0], LH - S[2][:, 1], S[2][:, 2], 1, np.array([0, 0, 1.0])),
    )
    for number, (x, y, along, sign, rail) in enumerate(limbs):
        rho = np.hypot(x, y)
        radial = [(x, y, zero), (x, zero, -y), (x, -y, zero)][number]
        square = (L1 + L2) ** 2 - (rho - L0) ** 2
        ok &= square >= 0
        h = np.sqrt(np.maximum(square, 0))
        q += [along + sign * h - 2 * sign * L1 * h / (L1 + L2), along + sign * h]
        bar = ((rho - L0) / (L1 + L2) / rho)[:, None] * np.stack(radial, axis=1) - sign * (h / (L1 + L2))[
            :, None
        ] * rail
        ok &= bar @ -R[:, 2] >= np.cos(CONE)
    q = np.stack(q, axis=1)
    ok &= ((q >= LOW) & (q <= HIGH)).all(axis=1)
    for lower, upper in ((0, 1), (3, 2), (4, 5)):
        ok &= q[:, upper] - q[:, lower] >= GAP
    return ok


def platform(P, R):
    """Return the determinant (k,) of the rates of the three sides of the platform per rate of the limbs' rotations."""
    S = [P + R @ a for a in BALLS]
    zero = np.zeros(len(P))
    ways = (
        np.stack([-S[0][:, 1], S[0][:, 0], zero], axis=1),
        np.stack([S[1][:, 2] - LV, zero, -S[1][:, 0]], axis=1),
        np.stack([LH - S[2][:, 1], S[2][:, 0], zero], axis=1),
    )
    M = np.zeros((len(P), 3, 3))
    for row, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        side = S[i] - S[j]
        M[:, row, i] = np.sum(side * ways[i], axis=1)
        M[:, row, j] = -np.sum(side * ways[j], axis=1)
    return np.linalg.det(M)


def _drawn_near(rng, T, count, shift, turn):
    """Return poses (count, 4, 4) whose positions differ from T by up to `shift` (3,) in m, and rotations by `turn`."""
    Ts = np.repeat(T[None], count, axis=0)
    Ts[:, :3, 3] += rng.uniform(-1, 1, (count, 3)) * shift
    turns = Rotation.from_rotvec(rng.uniform(-turn, turn, (count, 3))).as_matrix()
    Ts[:, :3, :3] = turns @ Ts[:, :3, :3]
    return Ts


def _ambiguous_pose(robot):
    """Return a pose whose joint values belong to a second pose, at which Newton's method closes the loops first."""
    T = reach.centre(robot).copy()
    T[:3, 3] = 0.1183, 0.1412, 0.0301
    return T


def _inside_by_reference(robot, T, q):
    """Return whether the reference model assumes pose T (4, 4) at q (n,) within all limits, as SILS is assembled."""
    reference = robot.reference()
    assembly = reference.solve(q, seed=reference.solve_pose(T))
    assert np.abs(assembly.T_base_tool - T).max() < 1e-8
    links = {name: pose[None] for name, pose in assembly.link_poses.items()}
    over, _ = excess(robot.mechanism, links, q[None])
    home = reach.centre(robot)
    side = np.sign(platform(T[None, :3, 3], T[:3, :3])[0])
    side_at_home = np.sign(platform(home[None, :3, 3], home[:3, :3])[0])
    return over <= ROUNDED and side == side_at_home


def _closes_elsewhere(robot, T, q):
    """Return whether the loops close at another pose than T (4, 4) from the rest poses."""
    found = robot.loops.forward_many(q[None]).Ts_base_tool[0]
    return not np.abs(found - T).max() < 1e-6


def test_a_pose_alone_is_judged_in_its_own_assembly():
    robot = twin.load("sils")
    T = _ambiguous_pose(robot)
    q = robot.inverse(T)
    assert _closes_elsewhere(robot, T, q)
    assert _inside_by_reference(robot, T, q)
    assert robot.passive_check.keeps_limits_at_poses(q[None], T[None])[0]
    grid = PoseGrid(T[:3, 3], 1e-3, (1, 1, 1), T[:3, :3])
    assert reach.over_grid(robot, grid).reached.all()
    margins = robot.passive_check.margins(q[None], T[None])
    for distance, _ in margins.values():
        assert distance[0] > 0


@pytest.mark.slow
def test_poses_one_by_one_are_judged_as_by_the_reference_model():
    robot = twin.load("sils")
    rng = np.random.default_rng(5)
    near = _drawn_near(rng, _ambiguous_pose(robot), 1000, np.full(3, 0.04), 0.1)
    far = _drawn_near(rng, reach.centre(robot), 4000, np.array([0.3, 0.3, 0.15]), 0.5)
    elsewhere = 0
    inside = 0
    for drawn in (near, far):
        q = robot.kinematics().inverse_many(drawn)
        reached = (np.isfinite(q) & (q >= LOW) & (q <= HIGH)).all(axis=1) & (drawn[:, 0, 3] > 0)
        rows = np.flatnonzero(reached)[:100]
        assert len(rows) == 100
        for row in rows:
            expected = _inside_by_reference(robot, drawn[row], q[row])
            kept = robot.passive_check.keeps_limits_at_poses(q[row : row + 1], drawn[row : row + 1])[0]
            assert kept == expected, drawn[row]
            if expected:
                inside += 1
                elsewhere += _closes_elsewhere(robot, drawn[row], q[row])
    assert elsewhere > 10
    assert 20 < inside < 180


def test_the_workspace_of_sils_is_that_of_plain_geometry():
    """Pose by pose, and in volume by random positions; without the cones of its ball joints, 7.06 dm³ were stated."""
    robot = twin.load("sils")
    T = reach.centre(robot)
    found = workspace.workspace(robot, 600_000)
    p = found.grid.position(np.arange(found.grid.positions))
    assert np.array_equal(found.reached, sils_reaches(p, T[:3, :3], T[:3, 3]))
    low, high = np.array([0, 0.04, 0]), np.array([0.56, 0.68, 0.37])
    drawn = low + (high - low) * qmc.Sobol(3, rng=0).random(2**19)
    share = sils_reaches(drawn, T[:3, :3], T[:3, 3]).mean()
    volume = share * np.prod(10 * (high - low))
    assert volume == pytest.approx(6.19, rel=0.02)
    said = found.content()
    assert said["volume_dm3"] == pytest.approx(volume, rel=0.02)
    text = "\n".join(map(str, found.text()))
    assert "limits of s1, s2, s3 are kept" in text
    assert "soft limits of q3, q4" in text


# -- all robots ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting())
def test_every_state_of_a_workspace_keeps_all_limits(name):
    """Joints that are together and limits that are kept are both judged by the code above."""
    robot = bound(name)
    mechanism = robot.mechanism
    kin = robot.kinematics()
    found = workspace.workspace(robot, POSES)
    assert found.reached.any()
    if "sampled" in found.facts:
        ranges = joint_samples._ranges(robot)
        values, _ = joint_samples._sampler(robot, ranges, reach.passive_check(robot))(0, POSES)
        rows = np.flatnonzero(values[:, 0] > 0)
        steps = joint_samples._root(len(ranges)) ** -np.arange(1, len(ranges) + 1)
        q = ranges[:, 0] + np.ptp(ranges, axis=1) * ((0.5 + rows[:, None] * steps) % 1)
        Ts = kin.forward_many(q)
    else:
        rows = np.flatnonzero(found.reached)
        Ts = spatial.pose(found.grid.R_base_tool, found.grid.position(rows))
        q = kin.inverse_many(Ts)
    states, placed = robot.passive_check.unknowns_at_poses(q, Ts)
    assert placed.all()
    links = robot.loops.link_poses(q, states)
    tool = mechanism.frame(mechanism.tool)
    assert np.abs(links[tool.body] @ tool.T_body_frame - Ts).max() < 1e-5
    assert open_by(mechanism, links) < 1e-7
    beyond, where = excess(mechanism, links, q)
    assert beyond < ROUNDED, where


@pytest.mark.parametrize("name", robots(["sils"], slow=["sher", "davinci_psm"]))
def test_no_drag_passes_a_limit(name):
    robot = bound(name)
    mechanism = robot.mechanism
    movable = MovableRobot(robot)
    rng = np.random.default_rng(1)
    body = mechanism.frame(mechanism.tool).body
    for _ in range(DRAGS):
        target = movable.assembly.link_poses[body][:3, 3] + rng.normal(size=3) * 0.3
        for _ in range(25):
            moved = movable.move_point(body, np.zeros(3), target)
            links = {n: T[None] for n, T in movable.assembly.link_poses.items()}
            beyond, where = excess(mechanism, links, movable.assembly.q[None])
            assert beyond < ROUNDED, where
            if "still moving" not in moved.reason:
                break


@pytest.mark.parametrize("name", robots(["sils"], slow=["hibou"]))
def test_every_sample_of_a_plan_keeps_all_limits_or_the_plan_says_so(name):
    """With the declared limits, then with limits that the same motion exceeds by a tenth of what it uses."""
    robot = bound(name)
    trajectory = twin.plan(robot)
    mechanism = robot.bound(robot.protocol()).mechanism
    rows = np.arange(0, len(trajectory.t), 20)
    q, Ts = trajectory.q[rows], trajectory.Ts_base_tool[rows]
    states, placed = robot.passive_check.unknowns_at_poses(q, Ts)
    assert placed.all()
    links = robot.loops.link_poses(q, states)
    assert open_by(mechanism, links) < 1e-6
    beyond, where = excess(mechanism, links, q)
    said = {f.where for f in trajectory.findings if f.code in ("limit.passive", "limit.hard", "limit.motor")}
    assert (beyond > ROUNDED) == bool(said), where
    kinematics = robot.path_kinematics()
    limits = {limit.joint.name: limit.joint for limit in robot.passive_check.limits}
    for joint in list(limits.values())[:2]:
        A, B = frames(joint, links)
        if joint.cone is not None:
            across = np.linalg.norm(np.cross(A[:, :3, 2], B[:, :3, 2]), axis=1)
            used = np.arctan2(across, np.sum(A[:, :3, 2] * B[:, :3, 2], axis=1))
            narrow = replace(joint, cone=0.9 * used.max())
        else:
            used = coordinate(joint, A, B)
            if np.ptp(used) < 1e-3:
                continue
            narrow = replace(joint, limits=(used.min() - 0.1, used.max() - 0.1 * np.ptp(used)))
        changed = replace(mechanism, joints=tuple(narrow if j.name == joint.name else j for j in mechanism.joints))
        judged = replace(kinematics, passive=lambda Ts, q, m=changed: PassiveCheck(LoopSolver(m)).margins(q, Ts))
        found = check(trajectory, robot.protocol(), judged)
        assert joint.name in {f.where for f in found if f.code == "limit.passive" and f.severity == "error"}


@pytest.mark.parametrize("name", ["sils", "davinci_psm", "hibou"])
def test_a_tolerance_budget_names_the_limits_that_a_state_exceeds(name):
    """Of driven joints, motors, gaps and passive joints; the excess is measured here from the link poses."""
    robot = bound(name)
    mechanism = robot.mechanism
    solver = LoopSolver(mechanism)
    rng = np.random.default_rng(3)
    low, high = mechanism.limits.T
    span = np.where(np.isfinite(high - low), high - low, 1.0)
    home = robot.loops.q
    states = [(str(k), home + 0.3 * (k / 40) ** 2 * span * rng.normal(size=len(home))) for k in range(40)]
    found = solver.forward_many(np.array([q for _, q in states]))
    solved = np.isfinite(found.Ts_base_tool).all(axis=(1, 2))
    states = [states[k] for k in np.flatnonzero(solved)]
    told = {f.when for f in beyond_limits(robot, solver, states) if not f.message.startswith("the gap")}
    inside = 0
    for when, q in states:
        links = solver.link_poses(q[None], solver.forward_many(q[None]).states)
        over, _ = excess(mechanism, links, q[None])
        assert (over > ROUNDED) == (when in told), (when, over)
        inside += over <= ROUNDED
    assert 0 < inside < len(states)


def test_a_state_whose_loops_stay_open_is_refused_by_name():
    robot = bound("sils")
    solver = LoopSolver(robot.mechanism)
    home = robot.mechanism.posture("insertion")
    states = [("home", home), ("torn", home + np.eye(len(home))[0])]
    with pytest.raises(AssemblyError, match="state torn: the loops cannot be closed"):
        list(beyond_limits(robot, solver, states))
