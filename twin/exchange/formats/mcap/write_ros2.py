"""Write .mcap with the messages of ROS 2 (CDR), which `ros2 bag`, Foxglove and PlotJuggler read.

The topics have names as those of `twin serve --ros`: /tf, /<ROBOT>/measured_js (with the jaw), and of the
console /MTMR/measured_cp, /MTML/measured_cp, their gripper/angle, /footpedals/clutch, /footpedals/camera,
/console/teleop/scale. Time 0 is the start of the session.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.extras import require
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.exchange.formats.mcap import ros_messages as ros
from twin.exchange.formats.mcap.ros_definitions import full_name, full_text

_NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""


@dataclass(frozen=True)
class HandTrack:
    """Motion of a hand: poses (k, 4, 4) in {H}, the axes of the endoscope's picture, and the gripper (k,) in rad."""

    poses: Array
    grip: Array


def write_ros2_mcap(
    path: Path,
    t: Array,
    links: Mapping[str, Array],
    joints: Mapping[str, Mapping[str, Array]],
    hands: Mapping[str, HandTrack],
    pedals: Mapping[str, Array],
    scale: Array,
) -> Path:
    """Write a recorded session as .mcap and return the path; the same input gives the same bytes.

    Args:
        path: the file.
        t: (k,) times in s, from 0.
        links: {link: T_world_link (k, 4, 4)}.
        joints: {robot: {joint: values (k,) in m or rad}}.
        hands: {name of the hand's controller, such as MTMR: its motion}.
        pedals: {pedal: (k,) 1 where it is pressed, else 0}.
        scale: (k,) motion scale.

    Raises:
        TwinError: the package `mcap-ros2-support` is not installed.
    """
    writer_module = require("mcap_ros2.writer", "writing MCAP for ROS 2")
    topics = _topics(t, links, joints, hands, pedals, scale)
    with Path(path).open("wb") as file:
        writer = writer_module.Writer(file)
        schemas = {}
        for kind, _ in topics.values():
            # Several topics have one kind of message; its definition stands in the file once.
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(full_name(kind), full_text(kind))
        for sample, seconds in enumerate(np.asarray(t).tolist()):
            time = round(seconds * _NANOSECONDS)
            for topic, (kind, message_of) in topics.items():
                writer.write_message(topic, schemas[kind], message_of(sample), time, time, sample)
        writer.finish()
    return Path(path)


def _topics(
    t: Array,
    links: Mapping[str, Array],
    joints: Mapping[str, Mapping[str, Array]],
    hands: Mapping[str, HandTrack],
    pedals: Mapping[str, Array],
    scale: Array,
) -> dict[str, tuple[str, Callable[[int], JsonObject]]]:
    """Return {topic: (message type, function of the number of a sample that returns its message)}."""
    topics: dict[str, tuple[str, Callable[[int], JsonObject]]] = {}

    def transforms(sample: int) -> JsonObject:
        poses_of_sample = {name: poses[sample] for name, poses in links.items()}
        return ros.transforms(t[sample], poses_of_sample)

    topics["/tf"] = ("tf2_msgs/TFMessage", transforms)
    for robot, values in joints.items():
        # In capitals, as the da Vinci Research Kit names its arms (PSM1, MTMR): its programs find these topics.
        topics[f"/{robot.upper()}/measured_js"] = ("sensor_msgs/JointState", _joint_states(t, values))
    for name, hand in hands.items():
        topics[f"/{name}/measured_cp"] = ("geometry_msgs/PoseStamped", _poses(t, hand.poses))
        topics[f"/{name}/gripper/angle"] = ("std_msgs/Float64", _numbers(hand.grip))
    for pedal, pressed in pedals.items():
        topics[f"/footpedals/{pedal}"] = ("sensor_msgs/Joy", _joys(t, pressed))
    topics["/console/teleop/scale"] = ("std_msgs/Float64", _numbers(scale))
    return topics


def _joint_states(t: Array, values: Mapping[str, Array]) -> Callable[[int], JsonObject]:
    table = np.stack(list(values.values()), axis=1)
    return lambda k: ros.joint_state(t[k], list(values), table[k])


def _poses(t: Array, poses: Array) -> Callable[[int], JsonObject]:
    return lambda k: ros.pose_stamped(t[k], "picture", poses[k])


def _joys(t: Array, pressed: Array) -> Callable[[int], JsonObject]:
    return lambda k: {"header": ros.header(t[k]), "axes": [], "buttons": [int(pressed[k])]}


def _numbers(values: Array) -> Callable[[int], JsonObject]:
    return lambda k: {"data": float(values[k])}
