"""Patient, table and robot: who is sunk in whom, before the insertion and after it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import twin
from twin import api, assets
from twin.errors import TwinError
from twin.live.patient import Patient, floor_of, patient_of
from twin.mechanism import Mechanism
from twin.reference.clearance import _distance, _Shape

SAMPLES = 24
"""Places along a protocol that are looked at; its ends and those of its phases besides."""

CASES = [
    (name, protocol)
    for name in twin.names()
    for protocol, path in assets.files(name).protocols().items()
    if "\n[patient]" in path.read_text("utf-8")
]


@dataclass
class Played:
    """A protocol as the mechanism follows it: link poses (k, 4, 4), and whether the instrument is in, (k,)."""

    mechanism: Mechanism
    patient: Patient
    floor: float
    links: dict[str, np.ndarray]
    inside: np.ndarray


def play(name: str, protocol: str) -> Played:
    robot = twin.load(name)
    chosen = robot.protocol(protocol)
    bound = robot.bound(chosen)
    trajectory = api.plan(robot, chosen)
    ends = [t for p in trajectory.phases for t in (p.t0, p.t1)]
    t = np.unique(np.concatenate([np.linspace(0, trajectory.duration, SAMPLES), ends]))
    model = bound.reference()
    links = model.link_poses(model.run_poses(trajectory.poses(t), near=trajectory.joints(t)).x)
    depth = np.interp(t, trajectory.t, np.nan_to_num(trajectory.depth, nan=-1.0))
    if bound.mechanism.trocar:  # it is in the patient from start to end
        depth[:] = 1.0
    home = model.solve(bound.mechanism.posture("home")).link_poses
    floor = floor_of(bound.mechanism, home)
    patient = patient_of(bound, chosen, floor)
    assert patient is not None
    return Played(bound.mechanism, patient, floor, links, depth > 1e-9)


def inside(mesh, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) are in a convex mesh."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    return np.all(np.einsum("fi,nfi->nf", normal, points[:, None] - a) < 0, axis=1)


def crossings(mesh, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return where segments (n, 3) to (n, 3) pass the surface of a convex mesh, (k, 3)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    here = np.einsum("fi,nfi->nf", normal, starts[:, None] - a)
    there = np.einsum("fi,nfi->nf", normal, ends[:, None] - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = here / (here - there)
    enter = np.where((here > 0) & (there <= 0), s, np.where((here > 0) & (there > 0), 2.0, 0.0)).max(axis=1)
    leave = np.where((here <= 0) & (there > 0), s, 1.0).min(axis=1)
    hit = enter < leave
    way = ends - starts
    first = starts[hit & (enter > 0)] + enter[hit & (enter > 0), None] * way[hit & (enter > 0)]
    last = starts[hit & (leave < 1)] + leave[hit & (leave < 1), None] * way[hit & (leave < 1)]
    return np.concatenate([first, last])


def faults(p: Played) -> list[str]:
    """Return what is sunk in what, and where; empty if patient and robot are well placed."""
    out = []
    parts = {b.name: (b.meshes[0], _Shape(b.name, b.name, b.meshes)) for b in p.patient.mechanism.bodies}
    for body in p.mechanism.bodies:
        if not body.meshes or body.name in p.patient.replaces:
            continue
        shape = _Shape(body.name, body.name, body.meshes)
        points = np.concatenate([m.vertices for m in body.meshes])
        starts = np.concatenate([m.vertices[m.triangles].reshape(-1, 3) for m in body.meshes])
        ends = np.concatenate([m.vertices[np.roll(m.triangles, -1, 1)].reshape(-1, 3) for m in body.meshes])
        still = np.abs(p.links[body.name] - p.links[body.name][0]).max() < 1e-12
        for k, T in enumerate(p.links[body.name][:1] if still else p.links[body.name]):
            low, high = (f((points @ T[:3, :3].T + T[:3, 3]), axis=0) for f in (np.min, np.max))
            for name, (mesh, other) in parts.items():
                if np.any(low > mesh.vertices.max(axis=0)) or np.any(high < mesh.vertices.min(axis=0)):
                    continue
                apart = _distance(shape, other, T, np.eye(4))
                sunk = bool(inside(mesh, points @ T[:3, :3].T + T[:3, 3]).any())
                if apart > 0 and not sunk:
                    continue
                passed = crossings(mesh, *(q @ T[:3, :3].T + T[:3, 3] for q in (starts, ends)))
                wide = np.linalg.norm(passed - p.patient.port, axis=1).max(initial=0.0) / p.patient.port_radius
                open_now = name in p.patient.access or (name in p.patient.opens and p.inside[k])
                if not open_now or wide > 1 or (apart == 0 and not len(passed)):
                    out.append(f"{body.name} in {name} at sample {k}, {wide:.1f} port radii from the port")
    return out


@pytest.fixture(scope="module", params=CASES, ids=lambda c: f"{c[0]}-{c[1]}")
def played(request) -> Played:
    return play(*request.param)


def test_nothing_is_sunk(played):
    """Before the insertion nothing is in the patient; after it only what goes through the port, and never the table."""
    assert not faults(played)
