"""Frames whose rotations are rounded: what is proved of them holds for the nearest rotation, others are refused."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.errors import TwinError
from twin.model.mechanism import Mechanism
from twin.proof import intervals
from twin.proof.frame_motion import ToolBox
from twin.proof.interval_pose import IntervalPose
from twin.proof.loops import ClosingConditions
from twin.proof.motion.linkage import Linkage
from twin.proof.motion.taylor import TaylorModel, constant
from twin.proof.rigid_frame import rigid_frame


def changed(mechanism: Mechanism, name: str, shift: np.ndarray) -> Mechanism:
    """Return a mechanism in which the frame of a joint on its child is multiplied by `shift` (4, 4)."""
    joints = []
    for joint in mechanism.joints:
        joints.append(replace(joint, T_child_joint=joint.T_child_joint @ shift) if joint.name == name else joint)
    return replace(mechanism, joints=tuple(joints))


def at_rest(mechanism: Mechanism, loops: ClosingConditions) -> tuple[intervals.Intervals, ToolBox]:
    """Return joint values (1, k) and tool pose of a mechanism as it is in the CAD."""
    values = []
    for name in loops.names:
        joint = mechanism.joint(name)
        values.append(joint.coordinate(mechanism.rest[joint.parent], mechanism.rest[joint.child]))
    tool = mechanism.frame(mechanism.tool)
    T = mechanism.rest[tool.body] @ tool.T_body_frame
    pose = IntervalPose(intervals.exactly(T[None, :3, :3]), intervals.exactly(T[None, :3, 3]))
    return intervals.exactly(np.array([values], float)), ToolBox(pose)


def test_an_inverse_contains_the_exact_one() -> None:
    """The position of the inverse, in fractions, is within its radius for a long lever and an awkward rotation."""
    T = np.eye(4)
    T[:3, :3] = spatial.exp_so3([0.3, -1.1, 0.7])
    T[:3, 3] = 123.4, -77.7, 1e-3
    found = rigid_frame(T, "frame").inverse()
    for i in range(3):
        exact = -sum(Fraction(T[j, i]) * Fraction(T[j, 3]) for j in range(3))
        assert abs(Fraction(found.T[i, 3]) - exact) <= Fraction(found.p_radius[i])
    assert (found.p_radius < 1e-12).all()
    assert rigid_frame(np.eye(4), "frame").R_radius == 0.0


def test_a_rotation_that_is_not_orthogonal_is_refused_by_name() -> None:
    """The loader accepts 1e-6; derivatives that assume an orthogonal rotation would be wrong by as much."""
    mechanism = twin.load("sils").mechanism
    skew = np.eye(4)
    skew[0, 1] = 5e-7
    bad = changed(mechanism, mechanism.joints[0].name, skew)
    for made in (Linkage, ClosingConditions):
        with pytest.raises(TwinError, match=rf"joint {bad.joints[0].name}, frame on its child: .* 5.0e-07 only"):
            made(bad)


def test_a_loop_that_is_turned_over_is_not_closed() -> None:
    """A half turn about x leaves all conditions of a revolute joint zero; its z axes are opposite."""
    mechanism = twin.load("sils").mechanism
    loop = next(joint for joint in mechanism.loops if joint.type == "revolute")
    half = np.diag([1.0, -1.0, -1.0, 1.0])
    over = changed(mechanism, loop.name, half)
    for one, expected in ((mechanism, True), (over, False)):
        loops = ClosingConditions(one)
        x, tool = at_rest(one, loops)
        assert loops.aligned(x, tool).tolist() == [expected]
        assert loops.residual(loops.closures, x, tool).largest.max() < 1e-9


def test_a_turned_loop_joint_is_not_closed_along_a_path() -> None:
    """The same for the motion: with the wrong side of the joint, gaps are zero and nothing is aligned."""
    mechanism = twin.load("sils").mechanism
    loop = next(joint for joint in mechanism.loops if joint.type == "revolute")
    poses = {name: T[None] for name, T in mechanism.rest.items()}
    for one, expected in ((mechanism, True), (changed(mechanism, loop.name, np.diag([1.0, -1.0, -1.0, 1.0])), False)):
        linkage = Linkage(one)
        values, balls = linkage.coordinates_at(poses)
        coordinates = constant(values, 1)
        models: dict[str, TaylorModel] = {name: constant(R, 1) for name, R in balls.items()}
        placed = linkage.place(coordinates, models)
        assert linkage.aligned(placed).tolist() == [expected]
        assert linkage.gaps(placed, coordinates).sizes().max() < 1e-9
