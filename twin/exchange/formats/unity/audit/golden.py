"""Recompute, with matrices, the golden vectors (test inputs and expected outputs) of a Unity package's self-test."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured

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

_IMPORTS = {"gltfast": "GltFast", "urdf": "UrdfImporter"}
_HEAD = struct.Struct("<4sIddHHI")


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
        for key, off in rows.items():
            worst = max(worst, off)
            if not off <= TOL:
                text = f"golden vectors in {name}: '{key}' is {off:.4g} from the value computed from its inputs."
                ledger.wrong("unity.golden", text, name, size=Measured(off, TOL))
    ledger.row("golden vectors, recomputed", worst, "m or 1", TOL, where=name)


class _Vectors:
    def __init__(self, data: JsonObject) -> None:
        self.data, self.track = data, data["track"]
        links = len(self.track["links"])
        self.times = np.array(self.track["times"], float)
        seven = np.array(self.track["poses"], float).reshape(len(self.times), links, 7)
        self.T = poses.from_seven(seven)
        place = poses.from_seven(np.array(data["place"], float))
        self.worlds = {}
        for short, convention in _IMPORTS.items():
            W = np.eye(4)
            W[:3, :3] = ROOTS[convention] @ MIRRORS[convention]
            self.worlds[short] = place @ np.diag([data["scale"]] * 3 + [1.0]) @ W

    def rows(self, key: str, width: int) -> Array:
        """Return the entry `key`, a flat list of k * width numbers, as an array (k, width)."""
        return np.array(self.data[key], float).reshape(-1, width)

    def points(self) -> dict[str, float]:
        """Return {vector name: error in m} for points of links, in imported coordinates and in Unity's world."""
        robot, out = self.rows("point_robot", 3), {}
        where = self.T[self.data["point_key"], self.data["point_link"]]
        world = np.einsum("kij,kj->ki", where, np.column_stack([robot, np.ones(len(robot))]))
        for short, convention in _IMPORTS.items():
            out[f"point_{short}"] = _apart(self.rows(f"point_{short}", 3), robot @ MIRRORS[convention].T)
            out[f"world_{short}"] = _apart(self.rows(f"world_{short}", 3), (world @ self.worlds[short].T)[:, :3])
        return out

    def between(self) -> dict[str, float]:
        """Return {vector name: maximum error in m or of a quaternion component} for poses interpolated between keys."""
        t, got = np.array(self.data["between_time"], float), self.rows("between_pose", 7)
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        share = (t - self.times[k]) / (self.times[k + 1] - self.times[k])
        A, B = (self.T[i, self.data["between_link"]] for i in (k, k + 1))
        p = (1 - share)[:, None] * A[:, :3, 3] + share[:, None] * B[:, :3, 3]
        q = poses.slerp(poses.quaternion(A[:, :3, :3]), poses.quaternion(B[:, :3, :3]), share)
        return {"between_pose": max(_apart(got[:, :3], p), _turned(got[:, 3:], q))}

    def turns(self) -> dict[str, float]:
        """Return {vector name: maximum error} for quaternions interpolated along the shorter rotation."""
        a, b = self.rows("turn_a", 4), self.rows("turn_b", 4)
        share = np.array(self.data["turn_share"], float)
        return {"turn_want": _turned(self.rows("turn_want", 4), poses.slerp(a, b, share))}

    def joints(self) -> dict[str, float]:
        """Return {vector name: maximum error} for joint values between keys, and for drive targets.

        A drive target is clipped to the limits; its sign may be reversed, and angles are in degrees.
        """
        names, table = self.track["joints"], np.array(self.track["positions"], float).reshape(len(self.times), -1)
        t = self.data["joint_time"]
        want = [np.interp(t, self.times, table[:, names.index(n)]) for n in self.data["joint_name"]]
        targets = []
        rows = zip(self.data["drive_joint"], self.data["drive_sign"], self.data["drive_value"], strict=True)
        for name, sign, value in rows:
            i = names.index(name)
            held = min(max(value, self.track["joint_lower"][i]), self.track["joint_upper"][i])
            targets.append(sign * (np.degrees(held) if self.track["joint_types"][i] == "revolute" else held))
        return {
            "joint_want": _apart(self.data["joint_want"], want),
            "drive_target": _apart(self.data["drive_target"], targets),
        }

    def phases(self) -> dict[str, float]:
        """Return {vector name: error} for the phase names at given times; 0 if all names are correct, else infinity."""
        starts, names = self.track["phase_start"], self.track["phases"]
        now = [[n for n, s in zip(names, starts, strict=True) if s <= t][-1] for t in self.data["phase_time"]]
        return {"phase_name": 0.0 if now == self.data["phase_name"] else np.inf}

    def stream(self) -> dict[str, float]:
        """Parse a stream frame, and return {vector name: error} for the entries of the frame.

        If the header of the frame is wrong, the error is infinite.
        """
        d, raw = self.data, base64.b64decode(self.data["stream"])
        mark, sequence, server, clip, links, joints, flags = _HEAD.unpack_from(raw)
        numbers = np.frombuffer(raw, "<f4", offset=_HEAD.size).astype(float)
        n = 7 * links
        said = (b"TWN1", int(d["stream_sequence"]), d["stream_server_time"], d["stream_clip_time"], d["stream_flags"])
        same = (mark, sequence, server, clip, flags) == said and links == self.T.shape[1]
        at = self.T[d["stream_key"]]
        ghost = n + joints
        return {
            "stream": 0.0 if same else np.inf,
            "stream_poses": max(
                _apart(numbers[:n].reshape(-1, 7)[:, :3], at[:, :3, 3]),
                _turned(numbers[:n].reshape(-1, 7)[:, 3:], poses.quaternion(at[:, :3, :3])),
            ),
            "stream_joints": _apart(d["stream_joints"], numbers[n:ghost]),
            "stream_ghost": _apart(d["stream_ghost"], numbers[ghost:]),
        }

    def grab(self) -> dict[str, float]:
        """Return {vector name: error} for the target pose of a grabbed tool, relative to the robot's frame."""
        hands = poses.from_seven(self.rows("grab_hands", 7))
        moved = hands[1] @ poses.inverse(hands[0])
        link = self.track["links"].index(self.data["tool_link"])
        start = self.T[self.data["grab_key"], link] @ poses.from_seven(np.array(self.data["tool_frame"], float))
        out = {}
        for short, W in self.worlds.items():
            goal = np.linalg.inv(W) @ moved @ W @ start
            got = np.array(self.data[f"grab_want_{short}"], float)
            off = _turned(got[None, 3:], poses.quaternion(goal[None, :3, :3]))
            out[f"grab_want_{short}"] = max(_apart(got[:3], goal[:3, 3]), off)
        return out


def _apart(a: Any, b: Any) -> float:
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.shape != b.shape:
        return np.inf
    off = np.abs(a - b).max(initial=0.0)
    return float(off) if np.isfinite(off) else np.inf


def _turned(a: Array, b: Array) -> float:
    """Return the maximum difference between components of quaternions (k, 4); signs of quaternions are ignored."""
    if a.shape != b.shape:
        return np.inf
    return float(np.minimum(np.abs(a - b).max(axis=1), np.abs(a + b).max(axis=1)).max(initial=0.0))
