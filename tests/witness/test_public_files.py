"""Published robots of robosuite: all bodies of an import are where Pinocchio (URDF) and MuJoCo (MJCF) have them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from twin.checking.descriptions import walk
from twin.checking.file_verdict import JudgeJob
from twin.checking.file_verdict import judge as judge_file
from twin.core import spatial
from twin.core.errors import SourceError
from twin.core.identifiers import identifier
from twin.exchange.read import read
from twin.exchange.read.imported_robot import rest_poses
from twin.exchange.xacro import XacroSettings

EXACT = 1e-9
"""Maximum difference of poses, in m and 1."""

STATES = 20
"""Drawn states of each robot: each joint in -2 .. 2 rad or m."""

QUICK = {
    *("robots/jaco/robot.xml", "robots/kinova3/robot.xml", "robots/xarm7/robot.xml", "robots/spot_arm/robot.xml"),
    *("grippers/fourier_left_hand.xml", "grippers/panda_gripper.xml", "grippers/robotiq_gripper_s.xml"),
    *("bullet_data/panda_description/urdf/panda_arm.urdf", "bullet_data/panda_description/urdf/panda_arm_hand.urdf"),
}
"""Files that are read in less than 1 s; the nightly lane reads the others."""

REFUSED = {
    "grippers/robotiq_gripper_85.xml": "repeated name 'robotiq_arg2f_base_link'",
    "grippers/xarm7_gripper.xml": "unrecognized attribute: 'group'",
}
"""Files that MuJoCo itself refuses, and what it says."""

HINGE_OR_SLIDE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def by_pinocchio(path, rng, compare):
    """Call `compare` with the joints' coordinates and Pinocchio's poses of all links, at each state."""
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    for _ in range(STATES):
        q = pin.neutral(model)
        coordinates = {}
        for i in range(1, model.njoints):
            joint = model.joints[i]
            value = rng.uniform(-2, 2)
            coordinates[model.names[i]] = value
            if joint.nq == 2:  # a continuous joint has the cosine and the sine
                q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                q[joint.idx_q] = value
        pin.framesForwardKinematics(model, data, q)
        poses = {}
        for i, frame in enumerate(model.frames):
            if frame.type == pin.FrameType.BODY:
                poses[frame.name] = data.oMf[i].homogeneous
        compare(coordinates, poses)


def by_mujoco(path, rng, compare):
    """Call `compare` with the joints' coordinates and MuJoCo's poses of all bodies, at each state."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for _ in range(STATES):
        data.qpos[:] = model.qpos0
        coordinates = {}
        for i in range(model.njnt):
            if model.jnt_type[i] in HINGE_OR_SLIDE:
                value = rng.uniform(-2, 2)
                coordinates[model.joint(i).name or f"joint{i}"] = value  # the name that an import gives
                data.qpos[model.jnt_qposadr[i]] = value
        mujoco.mj_kinematics(model, data)
        poses = {}
        for i in range(1, model.nbody):
            poses[model.body(i).name or f"body{i}"] = spatial.pose(data.xmat[i].reshape(3, 3), data.xpos[i])
        compare(coordinates, poses)


def apart(path, rng):
    """Return the largest difference of any body at any state, and how many bodies are compared."""
    mechanism = read(path, guarded=False).mechanism
    joints = {joint.name for joint in mechanism.joints}
    worst = 0.0
    compared = 0

    def compare(coordinates, poses):
        nonlocal worst, compared
        values = {}
        for name, value in coordinates.items():
            assert identifier(name) in joints
            values[identifier(name)] = value
        found = rest_poses(mechanism, values)
        for frame in mechanism.frames:
            found.setdefault(frame.name, found[frame.body] @ frame.T_body_frame)
        compared = 0
        for name, T in poses.items():
            if identifier(name) in found:
                compared += 1
                worst = max(worst, float(np.abs(found[identifier(name)] - T).max()))
        assert compared == len(poses)

    foreign_poses = by_pinocchio if path.suffix == ".urdf" else by_mujoco
    foreign_poses(path, rng, compare)
    return worst, compared


def assert_told(path: Path, reason: str) -> None:
    """`twin check` says why a file is not imported."""
    tree = walk(path.parent)
    (description,) = [found for found in tree.descriptions if found.path == path.resolve()]
    (finding,) = judge_file(JudgeJob(description, tree, XacroSettings())).findings
    assert finding.rule == "file/malformed"
    assert reason in finding.message


def judge(folder: Path, names, figures, rng) -> None:
    for name in sorted(names):
        if name in REFUSED:
            with pytest.raises(SourceError, match=REFUSED[name]):
                read(folder / name)
            assert_told(folder / name, REFUSED[name])
            continue
        worst, compared = apart(folder / name, rng)
        figures.add("robosuite 1.5.2", name, Path(name).suffix[1:], worst, worst, f"{compared} bodies, {STATES} states")
        assert worst <= EXACT, name


@pytest.fixture
def folder(foreign) -> Path:
    """Return the folder of robosuite's robots."""
    return next(foreign.need("robosuite").folder.glob("lib/python3*/site-packages/robosuite/models/assets"))


@pytest.mark.witness("robosuite")
def test_published_robots_are_where_other_programs_have_them(folder, figures, rng):
    judge(folder, QUICK, figures, rng)


@pytest.mark.nightly
@pytest.mark.witness("robosuite")
def test_all_published_robots_are_where_other_programs_have_them(folder, figures, rng):
    names = set()
    for pattern in ("robots/*/robot.xml", "grippers/*.xml", "bullet_data/*/urdf/*.urdf"):
        names.update(str(path.relative_to(folder)) for path in folder.glob(pattern))
    assert len(names) >= 30
    judge(folder, names - QUICK, figures, rng)
