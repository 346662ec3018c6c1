"""Make the golden vectors of the Unity package from the real robot: SILS along its protocol table2.

What C# computes with quaternions is computed here with 4x4 matrices: a mirror M, the placement of the model and the
pose of a link are multiplied out. No formula of the package is used.

    python tests/unity/make_golden.py           write twin/ui/headset/unity/Runtime/Resources/twin-golden.json
    python tests/unity/make_golden.py --check   exit 1 if it is not what the robot gives now
"""

from __future__ import annotations

import base64
import json
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

FILE = Path(__file__).resolve().parents[2] / "twin/ui/headset/unity/Runtime/Resources/twin-golden.json"

STEP = 2.0
"""Seconds between the keys that are taken of the clip: links turn far between them. Every rate of a clip has them."""

MIRRORS = {
    "gltfast": np.diag([-1.0, 1.0, 1.0]),
    "urdf": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""Unity's local coordinates of a point of the robot: x mirrored; or right-up-forward from forward-left-up."""

ROOTS = {"gltfast": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), "urdf": np.eye(3)}
"""The node that turns z up into y up: y becomes -z, z becomes y."""


def four(R: np.ndarray, p: np.ndarray | None = None) -> np.ndarray:
    """Return the (4, 4) matrix of R (3, 3) and p (3,)."""
    T = np.eye(4)
    T[:3, :3] = R
    if p is not None:
        T[:3, 3] = p
    return T


def seven(T: np.ndarray) -> np.ndarray:
    """Return x y z and a quaternion x y z w, (7,)."""
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()])


def matrix(pose: np.ndarray) -> np.ndarray:
    """Return the (4, 4) matrix of x y z and a quaternion x y z w."""
    return four(Rotation.from_quat(pose[3:]).as_matrix(), np.asarray(pose[:3]))


def robot() -> tuple[Any, Any, Any]:
    """Return the mechanism of SILS, the Clip of its protocol table2, and a track of some of its keys."""
    import twin
    from twin.exchange.formats.tracks.write import track
    from twin.exchange.write.key_rate import make_clip

    loaded = twin.load("sils")
    protocol = loaded.protocol("table2")
    mechanism = loaded.bound(protocol).mechanism
    clip = make_clip(mechanism, twin.plan(loaded, protocol), protocol.title)
    keys = np.unique(np.append(np.arange(0, len(clip.times), round(STEP * clip.rate)), len(clip.times) - 1))
    few = replace(
        clip,
        times=clip.times[keys],
        links={n: T[keys] for n, T in clip.links.items()},
        joints={n: v[keys] for n, v in clip.joints.items()},
        rate=1.0 / STEP,
    )
    return mechanism, few, track(mechanism, few)


def golden() -> dict[str, Any]:
    """Return everything that the package checks itself with."""
    mechanism, clip, track = robot()
    rng = np.random.default_rng(20260429)
    out: dict[str, Any] = {"schema": "twin-golden", "version": 1, "track": track}
    place = four(Rotation.from_rotvec([0.4, -1.1, 0.3]).as_matrix(), np.array([0.1, 0.2, 0.3]))
    scale = 0.5
    out |= {"place": flat(seven(place)), "scale": scale}
    # Unity's world of a point of the robot's world, for both ways of import.
    to_world = {n: place @ np.diag([scale] * 3 + [1.0]) @ four(ROOTS[n]) @ four(M) for n, M in MIRRORS.items()}
    out |= points(mechanism, clip, to_world, rng)
    out |= between(clip, rng)
    out |= turns(rng)
    out |= joints(clip, track)
    out |= stream(track, rng)
    out |= grab(mechanism, clip, to_world, rng)
    return out


def points(mechanism: Any, clip: Any, to_world: dict[str, np.ndarray], rng: Any) -> dict[str, Any]:
    """Return vertices of links, as the importers bring them in, and where they are in Unity's world."""
    names = list(clip.links)
    rows: dict[str, list] = {k: [] for k in ("link", "key", "robot", "gltfast", "urdf")}
    worlds: dict[str, list] = {n: [] for n in MIRRORS}
    for i, name in enumerate(names):
        vertices = np.concatenate([m.vertices for m in mechanism.body(name).meshes])
        for vertex in vertices[rng.integers(len(vertices), size=3)]:
            k = int(rng.integers(len(clip.times)))
            rows["link"].append(i)
            rows["key"].append(k)
            rows["robot"].append(vertex)
            for n, M in MIRRORS.items():
                rows[n].append(M @ vertex)
                worlds[n].append((to_world[n] @ clip.links[name][k] @ np.append(vertex, 1.0))[:3])
    out = {f"point_{k}": rows[k] if k in ("link", "key") else flat(rows[k]) for k in rows}
    return out | {f"world_{n}": flat(w) for n, w in worlds.items()}


def between(clip: Any, rng: Any) -> dict[str, Any]:
    """Return poses between keys: a straight line, and an even turn by the logarithm of the rotation."""
    times, links, poses = [], [], []
    for i, Ts in enumerate(clip.links.values()):
        k, share = int(rng.integers(len(clip.times) - 1)), float(rng.uniform(0.05, 0.95))
        times.append(round(float(clip.times[k] + share * (clip.times[k + 1] - clip.times[k])), 9))
        share = (times[-1] - clip.times[k]) / (clip.times[k + 1] - clip.times[k])
        a, b = Ts[k], Ts[k + 1]
        turn = Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).as_rotvec()
        T = four(a[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix(), (1 - share) * a[:3, 3] + share * b[:3, 3])
        links.append(i)
        poses.append(seven(T))
    return {"between_time": times, "between_link": links, "between_pose": flat(poses)}


def turns(rng: Any) -> dict[str, Any]:
    """Return pairs of rotations, the second with either sign, and the rotation on the short way between them."""
    a = Rotation.random(12, rng=rng)
    by = rng.uniform(0.0, 3.0, 12)
    by[:3] = [0.0, 1e-7, 1e-3]
    axes = rng.normal(size=(12, 3))
    step = axes / np.linalg.norm(axes, axis=1, keepdims=True) * by[:, None]
    share = rng.uniform(0, 1, 12)
    signs = np.where(np.arange(12) % 2, -1.0, 1.0)[:, None]
    return {
        "turn_a": flat(a.as_quat()),
        "turn_b": flat((a * Rotation.from_rotvec(step)).as_quat(canonical=True) * signs),
        "turn_share": np.round(share, 6).tolist(),
        "turn_want": flat((a * Rotation.from_rotvec(np.round(share, 6)[:, None] * step)).as_quat()),
    }


def joints(clip: Any, track: dict[str, Any]) -> dict[str, Any]:
    """Return joint values between keys, drive targets (degrees, metres, held to limits), and phases."""
    chosen = [j for j in track["joints"] if j in clip.active] + [j for j in track["joints"] if j not in clip.active][:4]
    t = round(float(clip.times[3] + 0.3 * (clip.times[4] - clip.times[3])), 9)
    values = [float(np.interp(t, clip.times, clip.joints[j])) for j in chosen]
    drives, signs, pushed, targets = [], [], [], []
    for i, (name, value) in enumerate(zip(chosen, values, strict=True)):
        row = track["joints"].index(name)
        given = round(value + (1.0 if i == 0 else -1.0 if i == 1 else 0.0), 7)  # beyond both limits
        sign = -1.0 if i % 2 else 1.0
        held = min(max(given, track["joint_lower"][row]), track["joint_upper"][row])
        drives.append(name)
        signs.append(sign)
        pushed.append(given)
        targets.append(sign * (held * 180.0 / np.pi if track["joint_types"][row] == "revolute" else held))
    starts = track["phase_start"]
    times = [0.0, *(round(s + 0.01, 6) for s in starts), *starts[1:], track["times"][-1], track["times"][-1] + 5.0]
    names = [[n for n, s in zip(track["phases"], starts, strict=True) if s <= x][-1] for x in times]
    return {
        "joint_time": t,
        "joint_name": chosen,
        "joint_want": flat(values),
        "drive_joint": drives,
        "drive_sign": signs,
        "drive_value": pushed,
        "drive_target": flat(targets),
        "phase_time": times,
        "phase_name": names,
    }


def stream(track: dict[str, Any], rng: Any) -> dict[str, Any]:
    """Return a frame of the stream as bytes, and what is in it."""
    k = 2
    n, m = len(track["links"]), sum(track["joint_active"])
    poses = np.reshape(track["poses"], (-1, n * 7))[k].astype("<f4")
    q = np.round(rng.uniform(-1, 1, m), 6).astype("<f4")
    ghost = np.array([0.125, -0.25, 0.5, 0.0, 0.6, 0.0, 0.8], "<f4")
    sequence, server, shown, flags = 4_000_000_007, 86_412.015625, 5.0625, 1 | 2 | 8
    head = struct.pack("<4sIddHHI", b"TWN1", sequence, server, shown, n, m, flags)
    data = head + poses.tobytes() + q.tobytes() + ghost.tobytes()
    return {
        "stream": base64.b64encode(data).decode(),
        "stream_sequence": str(sequence),
        "stream_server_time": server,
        "stream_clip_time": shown,
        "stream_flags": flags,
        "stream_key": k,
        "stream_joints": flat(q),
        "stream_ghost": flat(ghost),
    }


def grab(mechanism: Any, clip: Any, to_world: dict[str, np.ndarray], rng: Any) -> dict[str, Any]:
    """Return two poses of a hand in Unity's world, and where the tool must go in the robot's when it is held."""
    tool = mechanism.frame("endoscope_tip")  # the robot's own tool frame lies in the origin of its link
    hands = [
        four(Rotation.random(rng=rng).as_matrix(), rng.uniform(0.5, 1.5, 3)),
        four(Rotation.random(rng=rng).as_matrix(), rng.uniform(0.5, 1.5, 3)),
    ]
    moved = hands[1] @ np.linalg.inv(hands[0])
    k = 2
    start = clip.links[tool.body][k] @ tool.T_body_frame
    out = {"grab_key": k, "tool_link": tool.body, "tool_frame": flat(seven(tool.T_body_frame))}
    out |= {"grab_hands": flat([seven(h) for h in hands])}
    for n, W in to_world.items():
        out[f"grab_want_{n}"] = flat(seven(np.linalg.inv(W) @ moved @ W @ start))
    return out


def flat(values: Any) -> list[float]:
    """Return numbers to 1e-8 in one list."""
    return (np.round(np.asarray(values, float).ravel(), 8) + 0.0).tolist()


def text(data: dict[str, Any]) -> str:
    """Return JSON, one entry a line."""
    lines = (f"{json.dumps(k)}:{json.dumps(v, separators=(',', ':'))}" for k, v in data.items())
    return "{" + ",\n".join(lines) + "}\n"


def differences(then: Any, now: Any, where: str = "") -> list[str]:
    """Return where two golden files differ: names and words exactly, numbers by more than 1e-6."""
    if isinstance(then, dict) and isinstance(now, dict) and then.keys() == now.keys():
        return [d for k in then for d in differences(then[k], now[k], f"{where}.{k}")]
    if isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        return [d for i, pair in enumerate(zip(then, now, strict=True)) for d in differences(*pair, f"{where}[{i}]")]
    number = (int, float)
    if isinstance(then, number) and isinstance(now, number) and abs(then - now) < 1e-6:
        return []
    return [] if then == now else [f"{where}: {str(then)[:60]} is now {str(now)[:60]}"]


def main() -> int:
    """Write or check the file; 1 when `--check` finds a difference."""
    now = json.loads(text(golden()))
    if "--check" not in sys.argv[1:]:
        FILE.parent.mkdir(parents=True, exist_ok=True)
        FILE.write_text(text(now), encoding="utf-8")
        print(f"{FILE}: {FILE.stat().st_size} bytes")
        return 0
    found = differences(json.loads(FILE.read_text(encoding="utf-8")), now)
    print("\n".join(found[:20]) or "current")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
