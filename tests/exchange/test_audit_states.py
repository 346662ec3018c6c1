"""Joints of a file against those of a mechanism, at rest and at drawn states, and poses that are not finite."""

from __future__ import annotations

import json

import numpy as np
import pytest

from twin.exchange.audit import poses
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import JointLine
from twin.exchange.audit.rest_poses import compare_joints
from twin.exchange.audit.sampled_states import SampledStates
from twin.exchange.audit.state_comparison import compare_states

X, Y, Z = np.eye(3)
AT = np.array([0.1, 0.2, 0.3])
TILTED = (X + Y) / np.sqrt(2)

CHAINS = {
    "two turns that do not meet": (JointLine("turn", AT, Z), JointLine("turn", AT + X, Z)),
    "two turns that meet beside their points": (JointLine("turn", AT + Y, Y), JointLine("turn", AT + X, X)),
    "a turn that swings a slide": (JointLine("turn", AT, Z), JointLine("slide", AT, X)),
    "a slide before a turn": (JointLine("slide", AT, X), JointLine("turn", AT, Z)),
    "two slides at 45 degrees": (JointLine("slide", AT, X), JointLine("slide", AT, TILTED)),
    "a cylinder": (JointLine("slide", AT, Z), JointLine("turn", AT, Z)),
}


def at_rest(joint, T):
    """Return the findings of a file whose child is at T (4, 4) from its parent, against a joint."""
    truth = FileMechanism(links=("base", "link"), joints=[joint])
    content = Content(Ledger("robot.glb", "test", "1"), "glb", rest={"base": np.eye(4), "link": T})
    compare_joints(content, truth)
    assert content.ledger.checks
    return [finding.code for finding in content.ledger.findings]


@pytest.mark.parametrize("name", CHAINS)
def test_any_position_that_a_chain_allows_agrees(name):
    T_zero = poses.pose(None, np.array([0.0, 0.0, 0.5]))
    joint = FileJoint(("chain",), "base", "link", T_zero, CHAINS[name])
    first, second = CHAINS[name]
    assert at_rest(joint, first.motion(0.7) @ second.motion(-0.4) @ T_zero) == []


@pytest.mark.parametrize("name", ["two turns that meet beside their points", "a slide before a turn", "a cylinder"])
def test_a_position_beside_a_chain_is_reported(name):
    first, second = CHAINS[name]
    joint = FileJoint(("chain",), "base", "link", np.eye(4), CHAINS[name])
    beside = poses.pose(None, np.array([0.0, 1e-3, 0.0]))
    assert at_rest(joint, beside @ first.motion(0.7) @ second.motion(-0.4)) == ["states.rest"]


def test_a_pose_that_is_no_number_agrees_with_no_joint():
    joint = FileJoint(("hinge",), "base", "link", np.eye(4), (JointLine("turn", AT, Z),))
    assert at_rest(joint, np.full((4, 4), np.nan)) == ["states.rest", "states.rest"]


def arm(prefix, T_second):
    """Return an arm with two hinges; T_second (4, 4) is the pose of its last link in the first one."""
    first = FileJoint(("q1",), f"{prefix} 0", f"{prefix} 1", np.eye(4), (JointLine("turn", AT, Z),))
    lines = (JointLine("turn", T_second[:3, 3], X),)
    second = FileJoint(("q2",), f"{prefix} 1", f"{prefix} 2", T_second, lines)
    links = tuple(f"{prefix} {i}" for i in range(3))
    return FileMechanism(links=links, joints=[first, second])


@pytest.mark.parametrize("is_number", [True, False])
def test_a_joint_line_that_is_no_number_agrees_with_no_joint(is_number):
    T_second = poses.pose(None, X)
    truth = arm("body", T_second)
    q1 = np.array([0.0, 0.5])
    q2 = np.array([0.0, -0.3])
    first, second = truth.joints
    T_0_1 = first.motions[0].motion(q1)
    T_1_2 = second.motions[0].motion(q2) @ T_second
    links = {"body 0": np.broadcast_to(np.eye(4), (2, 4, 4)), "body 1": T_0_1, "body 2": T_0_1 @ T_1_2}
    states = SampledStates({"q1": q1, "q2": q2}, links)
    T_file = T_second.copy()
    if not is_number:
        T_file[0, 3] = np.nan
    content = Content(Ledger("robot.urdf", "test", "1"), "urdf", mechanism=arm("link", T_file))
    compare_states(content, truth, states)
    codes = [finding.code for finding in content.ledger.findings]
    if is_number:
        assert codes == ["states.names"]
        assert content.mechanism.links == truth.links
    else:
        assert codes == ["states.joints"]
        assert "is not finite" in content.ledger.findings[0].message
        json.dumps([finding.as_dict() for finding in content.ledger.findings], allow_nan=False)
