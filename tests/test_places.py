"""Patient, table and robot: who is sunk in whom, before the insertion and after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import twin
from twin import api, assets
from twin.live.patient import Patient, floor_of, patient_of
from twin.mechanism import Mechanism, Mesh
from twin.reference.clearance import _distance, _Shape

SAMPLES = 16
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
    # In from the moment that the tip touches the port; a mechanism with a trocar is in from start to end.
    among = (np.searchsorted(trajectory.t, t - 1e-6) - 1, np.searchsorted(trajectory.t, t + 1e-6))
    known = np.isfinite(trajectory.depth) | bool(bound.mechanism.trocar)
    entered = np.array([known[max(a, 0) : b + 1].any() for a, b in zip(*among, strict=True)])
    home = model.solve(bound.mechanism.posture("home")).link_poses
    floor = floor_of(bound.mechanism, home)
    patient = patient_of(bound, chosen, floor)
    assert patient is not None
    return Played(bound.mechanism, patient, floor, links, entered)


def holed(mesh: Mesh, port: np.ndarray, radius: float) -> Mesh:
    """Return a mesh with a hole of a radius about the port: its triangles there, made small, are left out."""
    fine = 0.05 * radius
    corners = mesh.vertices[mesh.triangles]
    kept = []
    while len(corners):
        middle = corners.mean(axis=1)
        reach = np.linalg.norm(corners - middle[:, None], axis=-1).max(axis=1)
        away = np.linalg.norm(middle - port, axis=1)
        kept.append(corners[away - reach > radius])
        corners, reach, away = (x[away - reach <= radius] for x in (corners, reach, away))
        kept.append(corners[(reach <= fine) & (away > radius)])
        a, b, c = np.moveaxis(corners[reach > fine], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    left = np.concatenate(kept)
    return Mesh(mesh.name, left.reshape(-1, 3), np.arange(3 * len(left)).reshape(-1, 3))


def inside(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) are in a convex mesh."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    return np.all(np.einsum("fi,nfi->nf", np.cross(b - a, c - a), points[:, None] - a) < 0, axis=1)


def faults(p: Played) -> list[str]:
    """Return what is sunk in what, and where; empty if patient and robot are well placed."""
    out = []
    parts = {b.name: b.meshes[0] for b in p.patient.mechanism.bodies}
    whole = {name: _Shape(name, name, [mesh]) for name, mesh in parts.items()}
    opened = {
        name: _Shape(name, name, [holed(parts[name], p.patient.port, p.patient.port_radius)])
        for name in p.patient.opens | p.patient.access
    }
    for body in p.mechanism.bodies:
        if not body.meshes or body.name in p.patient.replaces:
            continue
        shape = _Shape(body.name, body.name, body.meshes)
        # Where the surfaces do not meet, a connected mesh is all inside or all outside: one vertex tells.
        firsts = np.array([m.vertices[0] for m in body.meshes])
        Ts = p.links[body.name]
        Ts = Ts[:1] if np.abs(Ts - Ts[0]).max() < 1e-12 else Ts
        boxes = shape.corners_in(Ts)
        for name, mesh in parts.items():
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            near = np.all((boxes.max(axis=1) > low) & (boxes.min(axis=1) < high), axis=1)
            for k in np.flatnonzero(near):
                is_open = name in p.patient.access or (name in p.patient.opens and p.inside[k])
                if _distance(shape, (opened if is_open else whole)[name], Ts[k], np.eye(4)) <= 0:
                    out.append(f"{body.name} runs through {name} at sample {k}")
                elif not is_open and inside(mesh, firsts @ Ts[k][:3, :3].T + Ts[k][:3, 3]).any():
                    out.append(f"{body.name} is inside {name} at sample {k}")
    return out


@pytest.fixture(scope="module", params=CASES, ids=lambda c: f"{c[0]}-{c[1]}")
def played(request) -> Played:
    return play(*request.param)


def test_nothing_is_sunk(played):
    """Before the insertion nothing is in the patient; after it only what goes through the port, and never the table."""
    assert not faults(played)
