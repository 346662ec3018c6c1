"""Definitions of the ROS 2 messages that twin sends and receives, in ROS's own language (.msg files).

They are those of the packages builtin_interfaces, std_msgs, geometry_msgs, sensor_msgs, tf2_msgs (ROS 2) and crtk_msgs
(collaborative-robotics), without their comments and constants.
"""

from __future__ import annotations

from functools import cache

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "crtk_msgs/OperatingState": "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy",
    "crtk_msgs/StringStamped": "std_msgs/Header header\nstring string",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/Joy": "std_msgs/Header header\nfloat32[] axes\nint32[] buttons",
    "std_msgs/Float64": "float64 data",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}
"""{package/name of a message: its fields, one a line}."""

_RULE = "=" * 80
"""Line between the definitions of two messages, as in the files of ros2 bag."""


def full_name(name: str) -> str:
    """Return the name of a message as ROS 2 writes it: package/msg/name."""
    package, _, message = name.partition("/")
    return f"{package}/msg/{message}"


def short_name(name: str) -> str:
    """Return the name of a message without "msg", as ROS 1 writes it and `DEFINITIONS` does."""
    package, _, message = name.partition("/")
    return f"{package}/{message.removeprefix('msg/')}"


@cache
def full_text(name: str) -> str:
    """Return the definition of a message, followed by those of all messages in it, as rosbridge and MCAP expect it.

    `name` is a key of `DEFINITIONS`.
    """
    parts = [DEFINITIONS[name]]
    for inner in _inner_messages(name):
        parts.append(f"{_RULE}\nMSG: {inner}\n{DEFINITIONS[inner]}")
    return "\n".join(parts)


def _inner_messages(name: str) -> list[str]:
    """Return the names of the messages in a message, each once, in the order of their first use."""
    messages: list[str] = []
    waiting = [name]
    while waiting:
        for line in DEFINITIONS[waiting.pop(0)].splitlines():
            # An array needs the definition of its elements, which stands under the name without brackets.
            kind = line.split()[0].removesuffix("[]")
            if kind in DEFINITIONS and kind not in messages:
                messages.append(kind)
                waiting.append(kind)
    return messages
