"""Write .mcap: link poses and joint values over time, as Foxglove messages in JSON, with their JSON Schemas.

The pose of every link is relative to the frame "world", so that a viewer needs no kinematics. The topic /tf contains
messages foxglove.FrameTransforms, and /joint_states contains foxglove.JointStates, as documented by Foxglove
(docs.foxglove.dev/docs/sdk/schemas). /console contains numbers of the surgeon's console. Time 0 is the start of the
session.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin.core.extras import require
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.version import __version__
from twin.exchange.write.player_interpolation import quaternions_xyzw

WORLD = "world"
"""Name of the frame to which the poses are relative."""

_NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""


def _object(title: str, **properties: object) -> JsonObject:
    return {"title": title, "type": "object", "properties": properties}


_NUMBER = {"type": "number"}
_TIME = _object("time", sec={"type": "integer", "minimum": 0}, nsec={"type": "integer", "minimum": 0})
_TRANSFORM = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id={"type": "string"},
    child_frame_id={"type": "string"},
    translation=_object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER),
    rotation=_object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
)
_JOINT = _object("foxglove.JointState", name={"type": "string"}, position=_NUMBER)


def write_mcap(
    path: Path,
    t: Array,
    links: Mapping[str, Array],
    joints: Mapping[str, Array],
    console: Mapping[str, Array],
) -> Path:
    """Write a recorded session as .mcap and return the path; the same input gives the same bytes.

    `t` (k,) are the times in s, from 0. `links` maps each link to T_world_link (k, 4, 4). `joints` maps each joint,
    such as "psm1/yaw", to its values (k,) in m or rad. `console` maps each name in /console to its numbers (k,).

    Raises:
        TwinError: the package `mcap` is not installed.
    """
    require("mcap", "writing MCAP")
    from mcap.writer import Writer

    schemas = {
        "/tf": _object("foxglove.FrameTransforms", transforms={"type": "array", "items": _TRANSFORM}),
        "/joint_states": _object("foxglove.JointStates", timestamp=_TIME, joints={"type": "array", "items": _JOINT}),
        "/console": _object("twin.Console", timestamp=_TIME, **dict.fromkeys(console, _NUMBER)),
    }
    nanoseconds = np.round(np.asarray(t) * _NANOSECONDS).astype(int).tolist()
    # Lists of Python numbers are much faster to read one by one than arrays.
    link_poses = {}
    for link, T_world_link in links.items():
        link_poses[link] = (T_world_link[:, :3, 3].tolist(), quaternions_xyzw(T_world_link).tolist())
    values = _lists(joints)
    numbers = _lists(console)
    with Path(path).open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library=f"twin {__version__}")
        channels = {}
        for topic, schema in schemas.items():
            schema_id = writer.register_schema(schema["title"], "jsonschema", json.dumps(schema).encode())
            channels[topic] = writer.register_channel(topic, "json", schema_id)
        for sample, time in enumerate(nanoseconds):
            # From the rounded time: rounded by themselves, the nanoseconds could become a full second.
            sec, nsec = divmod(time, _NANOSECONDS)
            stamp = {"sec": sec, "nsec": nsec}
            transforms = []
            for link, (positions, quaternions) in link_poses.items():
                transforms.append(_transform(stamp, link, positions[sample], quaternions[sample]))
            states = []
            for joint, coordinates in values.items():
                states.append({"name": joint, "position": coordinates[sample]})
            row: JsonObject = {"timestamp": stamp}
            for name, column in numbers.items():
                row[name] = column[sample]
            messages = {
                "/tf": {"transforms": transforms},
                "/joint_states": {"timestamp": stamp, "joints": states},
                "/console": row,
            }
            for topic, message in messages.items():
                # allow_nan=False: viewers cannot read NaN, which is not JSON.
                data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
                channel = channels[topic]
                writer.add_message(channel, log_time=time, publish_time=time, data=data, sequence=sample)
        writer.finish()
    return Path(path)


def _lists(arrays: Mapping[str, Array]) -> dict[str, list[float]]:
    return {name: values.tolist() for name, values in arrays.items()}


def _transform(stamp: Mapping[str, int], name: str, p: list[float], q: list[float]) -> JsonObject:
    return {
        "timestamp": stamp,
        "parent_frame_id": WORLD,
        "child_frame_id": name,
        "translation": dict(zip("xyz", p, strict=True)),
        "rotation": dict(zip("xyzw", q, strict=True)),
    }
