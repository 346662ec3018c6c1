"""A complete export of a small robot, with every format that an audit checks."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path

import numpy as np

from made import mechanisms as made
from twin.core.findings import Finding
from twin.exchange.audit.poses import angle, pose, quaternion, rotation, slerp
from twin.exchange.write.model_hash import model_hash

rotation_matrix = rotation


OTHER_VERSION = "0.0.1"
"""Version of twin in proof.json: the audit repeats the checks of its own version only, and the proof has few."""

PACKAGE = {
    "package.json": '{"name": "com.twin.small", "version": "0.1.0", "displayName": "Small", "unity": "2022.3"}',
    "Runtime/Small.asmdef": '{"name": "Small"}',
    "Runtime/Player.cs": "public class Player : UnityEngine.MonoBehaviour { }",
    "Editor/Small.Editor.asmdef": '{"name": "Small.Editor", "references": ["Small"], "includePlatforms": ["Editor"]}',
    "Editor/Menu.cs": "using UnityEditor; public static class Menu { }",
    "Documentation~/index.md": "No .meta here.",
}


def states_at(times):
    """Return (poses (4, 4) by body, values by joint) of the swing at each time in s, in closed form."""
    return [made.four_bar_state(made.CRANK_AT_REST + 0.45 * np.sin(np.pi * t)) for t in times]


def between(times):
    """Return the errors of linear interpolation in the middle between keys, computed from the closed form."""
    from twin.exchange.write.clip import InterpolationErrors

    robot, keys, halfway = made.four_bar(), states_at(times), states_at((times[1:] + times[:-1]) / 2)
    position = rotation = gap = 0.0
    for a, b, (meant, _) in zip(keys[:-1], keys[1:], halfway, strict=True):
        drawn = {}
        for body in robot.bodies:
            A, B, T = a[0][body.name], b[0][body.name], meant[body.name]
            q = slerp(quaternion(A[:3, :3])[None], quaternion(B[:3, :3])[None], np.array([0.5]))[0]
            drawn[body.name] = D = pose(rotation_matrix(q), (A[:3, 3] + B[:3, 3]) / 2)
            rotation = max(rotation, float(angle(D[:3, :3], T[:3, :3])))
            for mesh in body.meshes:
                off = mesh.vertices @ (D - T)[:3, :3].T + (D - T)[:3, 3]
                position = max(position, float(np.linalg.norm(off, axis=1).max()))
        gap = max(
            gap, *(float(np.linalg.norm(j.relative(drawn[j.parent], drawn[j.child])[:3, 3])) for j in robot.joints)
        )
    return InterpolationErrors(position, rotation, gap)


def swing():
    """Return a clip of the four-bar linkage, 2 s at 20 Hz, from its closed form."""
    from twin.exchange.write.clip import Clip

    times = np.arange(41) / 20
    states = states_at(times)
    return Clip(
        "swing",
        "a swing",
        times,
        {b: np.stack([s[0][b] for s in states]) for b in states[0][0]},
        {j: np.array([s[1][j] for s in states]) for j in states[0][1]},
        ("crank_joint",),
        (("out", 0.0, 1.0), ("back", 1.0, 2.0)),
        20.0,
        between(times),
        frame="tool",
        phase_rcm=(None, None),
    )


def write_good(folder: Path) -> Path:
    """Write the four-bar linkage with its swing in every format, a Unity package and proof.json; return the folder."""
    from twin.exchange.formats import export_formats
    from twin.exchange.write.bundle import write_format
    from twin.exchange.write.order import ExportedScene, Order

    robot, clip = made.four_bar(), swing()
    folder.mkdir(parents=True, exist_ok=True)
    assumed = tuple(f"{p.name} = {p.shown:g} {p.unit}: {p.note}" for p in robot.parameters if p.provenance == "ASSUMED")
    order = Order(robot, (ExportedScene(clip, robot, clip.links),), (clip.name,), (), assumed, robot.name, "a test", ())
    for format in export_formats():
        if not format.marker:  # PACKAGE is a smaller folder than the Unity package
            write_format(format.name, order, folder)
    for name, text in PACKAGE.items():
        file = folder / "unity" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    for asset in sorted((folder / "unity").rglob("*")):
        name = asset.relative_to(folder / "unity").as_posix()
        if "~" not in name:
            guid = hashlib.md5(name.encode()).hexdigest()
            asset.with_name(asset.name + ".meta").write_text(f"fileFormatVersion: 2\nguid: {guid}\n")
    write_proof(folder)
    return folder


def write_proof(folder: Path) -> None:
    """Write proof.json with the hashes of all files of a folder, and what it states of robot and motion."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "proof.json")
    rows = []
    for file in files:
        data = file.read_bytes()
        name = file.relative_to(folder).as_posix()
        rows.append({"file": name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)})
    clip, checks = proof_of_swing()
    proof = {
        "schema": "twin-proof",
        "version": 1,
        "robot": "bars",
        "model_hash": model_hash(made.four_bar()),
        "made_by": f"twin {OTHER_VERSION}",
        "inputs": [{"file": "cad/bars.toml", "sha256": "0" * 64}],
        "files": rows,
        "clips": [clip],
        "checks": checks,
        "findings": [],
        "verdict": "agree",
    }
    (folder / "proof.json").write_text(json.dumps(proof))


@cache
def proof_of_swing():
    """Return (clip, checks) as proof.json states them."""
    clip = swing()
    entry = {"protocol": "swing", "rate": clip.rate, "keys": len(clip.times), "duration_s": float(clip.times[-1])}
    checks = []
    for key, name, value, unit in (
        ("between_position_m", "any point of a link, between keys", clip.between.position, "m"),
        ("between_rotation_rad", "rotation of a link, between keys", clip.between.rotation, "rad"),
        ("joint_gap_m", "gap of a joint, between keys", clip.between.joint_gap, "m"),
    ):
        entry[key] = value
        checks.append(
            {
                "check": name,
                "file": "clip swing",
                "tool": "twin.exchange.write",
                "version": OTHER_VERSION,
                "worst": value,
                "unit": unit,
                "tolerance": None,
                "verdict": "agree",
                "where": "",
                "when": "",
            }
        )
    return entry, checks


def grave(findings: list[Finding]) -> list[Finding]:
    """Return the findings more severe than info."""
    return [f for f in findings if f.severity != "info"]
