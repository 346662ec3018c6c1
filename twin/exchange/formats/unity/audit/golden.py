"""Recompute, with matrices, the golden vectors (test inputs and expected outputs) of a Unity package's self-test."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array

MIRRORS = {
    "GltFast": np.diag([-1.0, 1.0, 1.0]),
    "UrdfImporter": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""Matrix (3, 3) from robot coordinates to Unity coordinates, for each importer.

The glTF importer mirrors x; the URDF importer converts forward-left-up (ROS) to right-up-forward.
"""

ROOTS = {"GltFast": poses.R_Z_UP_Y_UP.T, "UrdfImporter": np.eye(3)}
"""Rotation (3, 3) of the root node, for each importer: glTF from z up to y up, URDF none."""

TOL = 1e-5
"""Tolerance in m and in quaternion components. Golden vectors have 8 decimals, streams have single precision."""

_IMPORTERS = {"gltfast": "GltFast", "urdf": "UrdfImporter"}
"""Importers, by the words in the names of the vectors."""

_HEADER = struct.Struct("<4sIddHHI")
"""Mark, sequence number, time of the server and of the clip in s, counts of links and joints, flags."""


def check_golden(path: Path, name: str, ledger: Ledger) -> None:
    """Report golden vectors (test inputs and expected outputs) that are wrong; `name` is the file's name in reports."""
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
        vectors = _Vectors(data)
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, RecursionError) as error:
        text = f"golden vectors in {name} cannot be read: {type(error).__name__}, {str(error)[:80]}."
        ledger.wrong("unity.golden", text, name)
        return
    worst = 0.0
    for check in (
        vectors.points,
        vectors.between,
        vectors.turns,
        vectors.joints,
        vectors.phases,
        vectors.stream,
        vectors.grab,
    ):
        try:
            rows = check()
        except (ValueError, KeyError, TypeError, IndexError, struct.error, np.linalg.LinAlgError) as error:
            text = f"golden vectors in {name}: {check.__name__} are malformed: {str(error)[:80]}."
            ledger.wrong("unity.golden", text, name)
            continue
        for key, error in rows.items():
            worst = max(worst, error)
            # Written with `not`: a difference that is not a number is no agreement.
            if not error <= TOL:
                text = f"golden vectors in {name}: '{key}' is {error:.4g} from the value computed from its inputs."
                ledger.wrong("unity.golden", text, name, size=Measured(error, TOL))
    ledger.row("golden vectors, recomputed", worst, "m or 1", TOL, where=name)


class _Vectors:
    """The golden vectors of a file: each method recomputes some of them, and returns {vector name: error}.

    Attributes:
        data: content of the file.
        track: the track in it.
        times: times (k,) in s of the keys.
        T: poses T_world_link (k, links, 4, 4) at the keys, in coordinates of the robot.
        worlds: {importer: matrix (4, 4) from coordinates of the robot to Unity's world}.
    """

    def __init__(self, data: JsonObject) -> None:
        self.data = data
        self.track = data["track"]
        links = len(self.track["links"])
        self.times = np.array(self.track["times"], float)
        seven = np.array(self.track["poses"], float).reshape(len(self.times), links, 7)
        self.T = poses.from_seven(seven)
        T_world_place = poses.from_seven(np.array(data["place"], float))
        # The robot is scaled about its own place in the room, as the user does: the scale acts before the placement.
        scale = np.diag([data["scale"]] * 3 + [1.0])
        self.worlds = {}
        for short, importer in _IMPORTERS.items():
            root_and_mirror = np.eye(4)
            root_and_mirror[:3, :3] = ROOTS[importer] @ MIRRORS[importer]
            self.worlds[short] = T_world_place @ scale @ root_and_mirror

    def rows(self, key: str, width: int) -> Array:
        """Return the entry `key`, a flat list of k * width numbers, as an array (k, width)."""
        return np.array(self.data[key], float).reshape(-1, width)

    def points(self) -> dict[str, float]:
        """Return {vector name: error in m} for points of links, in imported coordinates and in Unity's world."""
        robot = self.rows("point_robot", 3)
        T = self.T[self.data["point_key"], self.data["point_link"]]
        homogeneous = np.column_stack([robot, np.ones(len(robot))])
        world = np.einsum("kij,kj->ki", T, homogeneous)
        errors = {}
        for short, importer in _IMPORTERS.items():
            imported = robot @ MIRRORS[importer].T
            placed = world @ self.worlds[short].T
            errors[f"point_{short}"] = _difference(self.rows(f"point_{short}", 3), imported)
            errors[f"world_{short}"] = _difference(self.rows(f"world_{short}", 3), placed[:, :3])
        return errors

    def between(self) -> dict[str, float]:
        """Return {vector name: maximum error in m or of a quaternion component} for poses interpolated between keys."""
        t = np.array(self.data["between_time"], float)
        stated = self.rows("between_pose", 7)
        # Of the last key, no pair begins: its time belongs to the last pair.
        key = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        share = (t - self.times[key]) / (self.times[key + 1] - self.times[key])
        T_before = self.T[key, self.data["between_link"]]
        T_after = self.T[key + 1, self.data["between_link"]]
        p = (1 - share)[:, None] * T_before[:, :3, 3] + share[:, None] * T_after[:, :3, 3]
        q = poses.slerp(poses.quaternion(T_before[:, :3, :3]), poses.quaternion(T_after[:, :3, :3]), share)
        return {"between_pose": max(_difference(stated[:, :3], p), _rotation_difference(stated[:, 3:], q))}

    def turns(self) -> dict[str, float]:
        """Return {vector name: maximum error} for quaternions interpolated along the shorter rotation."""
        share = np.array(self.data["turn_share"], float)
        expected = poses.slerp(self.rows("turn_a", 4), self.rows("turn_b", 4), share)
        return {"turn_want": _rotation_difference(self.rows("turn_want", 4), expected)}

    def joints(self) -> dict[str, float]:
        """Return {vector name: maximum error} for joint values between keys, and for drive targets.

        A drive target is clipped to the limits; its sign may be reversed, and angles are in degrees.
        """
        names = self.track["joints"]
        positions = np.array(self.track["positions"], float).reshape(len(self.times), -1)
        values = []
        for name in self.data["joint_name"]:
            key_values = positions[:, names.index(name)]
            values.append(np.interp(self.data["joint_time"], self.times, key_values))
        targets = []
        drives = zip(self.data["drive_joint"], self.data["drive_sign"], self.data["drive_value"], strict=True)
        for name, sign, value in drives:
            column = names.index(name)
            target = min(max(value, self.track["joint_lower"][column]), self.track["joint_upper"][column])
            if self.track["joint_types"][column] == "revolute":
                target = np.degrees(target)
            targets.append(sign * target)
        return {
            "joint_want": _difference(self.data["joint_want"], values),
            "drive_target": _difference(self.data["drive_target"], targets),
        }

    def phases(self) -> dict[str, float]:
        """Return {vector name: error} for the phase names at given times; 0 if all names are correct, else infinity."""
        names = []
        for t in self.data["phase_time"]:
            current = ""
            for name, start in zip(self.track["phases"], self.track["phase_start"], strict=True):
                if start <= t:  # the last phase that has begun
                    current = name
            names.append(current)
        return {"phase_name": 0.0 if names == self.data["phase_name"] else np.inf}

    def stream(self) -> dict[str, float]:
        """Parse a stream frame, and return {vector name: error} for the entries of the frame.

        If the header of the frame is wrong, the error is infinite.
        """
        data = self.data
        frame = base64.b64decode(data["stream"])
        mark, sequence, server, clip, links, joints, flags = _HEADER.unpack_from(frame)
        numbers = np.frombuffer(frame, "<f4", offset=_HEADER.size).astype(float)
        header = (
            b"TWN1",
            int(data["stream_sequence"]),
            data["stream_server_time"],
            data["stream_clip_time"],
            data["stream_flags"],
        )
        # The poses are compared only by their values: the header must state the right count of links.
        agrees = (mark, sequence, server, clip, flags) == header and links == self.T.shape[1]
        T = self.T[data["stream_key"]]
        first_joint = 7 * links
        first_ghost = first_joint + joints
        sevens = numbers[:first_joint].reshape(-1, 7)
        position_error = _difference(sevens[:, :3], T[:, :3, 3])
        rotation_error = _rotation_difference(sevens[:, 3:], poses.quaternion(T[:, :3, :3]))
        return {
            "stream": 0.0 if agrees else np.inf,
            "stream_poses": max(position_error, rotation_error),
            "stream_joints": _difference(data["stream_joints"], numbers[first_joint:first_ghost]),
            "stream_ghost": _difference(data["stream_ghost"], numbers[first_ghost:]),
        }

    def grab(self) -> dict[str, float]:
        """Return {vector name: error} for the target pose of a grabbed tool, relative to the robot's frame."""
        hands = poses.from_seven(self.rows("grab_hands", 7))
        T_hand_motion = hands[1] @ poses.inverse(hands[0])
        link = self.track["links"].index(self.data["tool_link"])
        T_link_tool = poses.from_seven(np.array(self.data["tool_frame"], float))
        start = self.T[self.data["grab_key"], link] @ T_link_tool
        errors = {}
        for short, world_from_robot in self.worlds.items():
            # The motion of the hand in Unity's world, expressed in coordinates of the robot, moves the tool.
            goal = np.linalg.inv(world_from_robot) @ T_hand_motion @ world_from_robot @ start
            stated = np.array(self.data[f"grab_want_{short}"], float)
            rotation_error = _rotation_difference(stated[None, 3:], poses.quaternion(goal[None, :3, :3]))
            errors[f"grab_want_{short}"] = max(_difference(stated[:3], goal[:3, 3]), rotation_error)
        return errors


def _difference(first: ArrayLike, second: ArrayLike) -> float:
    """Return the largest difference of two entries; infinite for other shapes and for entries that are not finite."""
    first = np.asarray(first, float)
    second = np.asarray(second, float)
    if first.shape != second.shape:
        return np.inf
    largest = float(np.abs(first - second).max(initial=0.0))
    return largest if np.isfinite(largest) else np.inf


def _rotation_difference(first: Array, second: Array) -> float:
    """Return the maximum difference between components of quaternions (k, 4); signs of quaternions are ignored."""
    if first.shape != second.shape:
        return np.inf
    # q and -q are one rotation, and each program chooses the sign by itself.
    same_sign = np.abs(first - second).max(axis=1)
    opposite_sign = np.abs(first + second).max(axis=1)
    return float(np.minimum(same_sign, opposite_sign).max(initial=0.0))
