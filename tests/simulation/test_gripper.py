"""An instrument in contact: the poses of its links from the joint values, and the frame of its closed jaws."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.units import MM
from twin.simulation.plants.contact import Gripper
from twin.simulation.plants.contact.grip_frame import grip_frame


def test_links_are_where_the_reference_model_has_them():
    robot = twin.load("davinci_psm")
    mechanism = robot.mechanism
    T_world_base = spatial.pose(spatial.rotation_z(0.4), (0.1, -0.2, 0.3))
    gripper = Gripper("psm", mechanism, robot.kinematics(), T_world_base, effort=0.1)
    q = np.array(mechanism.posture("home"), float)
    poses = robot.reference().solve(q).link_poses
    assert len(gripper.links) > 1
    for body, T_world_link in zip(gripper.links, gripper.poses(q), strict=True):
        np.testing.assert_allclose(T_world_link, T_world_base @ poses[body.name], atol=1e-9)


def test_a_jaw_needs_a_torque():
    robot = twin.load("davinci_psm")
    with pytest.raises(WorldError, match="torque of a jaw is 0 N m"):
        Gripper("psm", robot.mechanism, robot.kinematics(), np.eye(4), effort=0.0)


@pytest.mark.parametrize("name", ["raven_left", "davinci_psm"])
def test_the_frame_of_the_closed_jaws_points_along_them(name):
    mechanism = twin.load(name).mechanism
    T = grip_frame(mechanism)
    along = {"raven_left": [1, 0, 0], "davinci_psm": [0, 0, 1]}[name]  # in the tool frame
    assert spatial.is_pose(T, 1e-9)
    np.testing.assert_allclose(T[:3, 2], along, atol=0.15)
    assert T[:3, 3] @ along == pytest.approx(10 * MM, abs=0.5 * MM)
