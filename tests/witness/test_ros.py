"""Programs of ROS systems, without ROS: roslibpy moves `twin serve --ros`, rosbags reads what `twin session` writes."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.units import MM
from twin.exchange.formats.mcap.ros_definitions import DEFINITIONS
from twin.exchange.formats.mcap.write_ros2 import HandTrack, write_ros2_mcap

pytestmark = pytest.mark.witness("roslibpy")


@pytest.fixture
def port():
    """The port of rosbridge of a console that runs as a user starts it."""
    command = [sys.executable, "-m", "twin", "serve", "davinci", "--port", "0", "--ros", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            for line in process.stdout:
                if found := re.search(r"rosbridge for ROS clients: ws://127\.0\.0\.1:(\d+)", line):
                    yield int(found[1])
                    break
            else:
                pytest.fail("the server has ended")
        finally:
            process.terminate()


def test_a_hand_of_roslibpy_moves_the_instrument(port, foreign):
    found = foreign.read("roslibpy", "move_roslibpy.py", port)
    way = np.array(found["after"]) - np.array(found["before"])
    assert np.linalg.norm(way) == pytest.approx(5 * MM, abs=1e-9)
    assert found["topics"]["/PSM1/servo_cp"] == "geometry_msgs/msg/PoseStamped"
    assert found["topics"]["/PSM1/operating_state"] == "crtk_msgs/msg/OperatingState"
    assert found["states"] == ["ENABLED", "PAUSED"]
    assert found["frames"] > 10
    kin = twin.load("davinci_psm").kinematics()
    names = [name for name, jaw in zip(kin.joints, kin.auxiliary, strict=True) if not jaw]
    assert found["joints"]["name"] == names


def test_a_recording_for_ros_is_read_by_rosbags(foreign, tmp_path):
    robot = twin.load("davinci_psm")
    mechanism = robot.mechanism
    rng = np.random.default_rng(3)
    t = np.arange(20) * 0.02
    q = robot.loops.q + 0.01 * np.cumsum(rng.normal(size=(20, len(robot.loops.q))), axis=0)
    links = robot.loops.link_poses(q, robot.loops.forward_many(q).states)
    poses = spatial.pose(spatial.exp_so3(rng.normal(size=(20, 3))), rng.normal(size=(20, 3)))
    hands = {"MTMR": HandTrack(poses, rng.uniform(0, 0.5, 20))}
    clutch = (t > 0.2).astype(float)
    joints = {joint.name: q[:, k] for k, joint in enumerate(mechanism.active)}
    path = tmp_path / "session-ros2.mcap"
    named = {f"psm1/{name}": T for name, T in links.items()}
    write_ros2_mcap(path, t, named, {"psm1": joints}, hands, {"clutch": clutch}, np.full(20, 0.5))
    again = tmp_path / "again.mcap"
    write_ros2_mcap(again, t, named, {"psm1": joints}, hands, {"clutch": clutch}, np.full(20, 0.5))
    assert again.read_bytes() == path.read_bytes()

    found = foreign.read("roslibpy", "read_rosbags.py", path)
    assert {kind.replace("/msg/", "/") for kind in found["types"].values()} <= set(DEFINITIONS)
    messages = found["messages"]
    assert [time for time, _ in messages["/tf"]] == [round(1e9 * seconds) for seconds in t]
    np.testing.assert_array_equal([told["position"] for _, told in messages["/PSM1/measured_js"]], q)
    assert messages["/PSM1/measured_js"][3][1]["header"]["stamp"]["nanosec"] == 60_000_000
    for k, (_, told) in enumerate(messages["/MTMR/measured_cp"]):
        p = told["pose"]["position"]
        Q = told["pose"]["orientation"]
        assert [p["x"], p["y"], p["z"]] == poses[k][:3, 3].tolist()
        R = spatial.matrix_from_quat_wxyz([Q["w"], Q["x"], Q["y"], Q["z"]])
        np.testing.assert_allclose(R, poses[k][:3, :3], atol=1e-12)
    assert [told["buttons"] for _, told in messages["/footpedals/clutch"]] == [[int(pressed)] for pressed in clutch]
    frames = {entry["child_frame_id"]: entry["transform"] for entry in messages["/tf"][7][1]["transforms"]}
    for name, T in named.items():
        shift = frames[name]["translation"]
        assert [shift["x"], shift["y"], shift["z"]] == T[7][:3, 3].tolist()
    assert {told["data"] for _, told in messages["/console/teleop/scale"]} == {0.5}
