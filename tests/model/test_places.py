"""Patient, table and robot: who is sunk in whom, before the insertion and after it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

import twin
from made.lanes import alike
from twin import api
from twin.core import assets, spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.mechanism import Mechanism
from twin.reference.clearance import Shape, distance_between
from twin.ui.session.movable_robot import ENDOSCOPE_FRAME, MovableRobot
from twin.ui.session.patient import Patient, floor_of, none_there, patient_of, read_patient

SAMPLES = 16
"""Places along a protocol that are looked at; its ends and those of its phases besides."""

CLOSE = 1.5 * MM
"""Parts nearer than this lean on each other: facets of round shapes stand off their neighbours by less."""

CASES = {
    name: [p for p, path in assets.files(name).protocols().items() if "\n[patient]" in path.read_text("utf-8")]
    for name in twin.names()
}
"""Protocols with a patient, by robot."""


def cases() -> list:
    """Return the first protocol of one robot of each kind, and the others for the nightly lane."""
    return [
        pytest.param((name, p), id=f"{name}-{p}", marks=[pytest.mark.nightly] if k or name in alike(CASES) else [])
        for name, protocols in CASES.items()
        for k, p in enumerate(protocols)
    ]


@dataclass
class Played:
    """A protocol as the mechanism follows it: link poses (k, 4, 4), instrument in or not (k,), tip (k, 3)."""

    protocol: str
    mechanism: Mechanism
    patient: Patient
    floor: float
    links: dict[str, np.ndarray]
    inside: np.ndarray
    tips: np.ndarray


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
    known = np.isfinite(trajectory.depth) | bool(bound.mechanism.trocars)
    entered = np.array([known[max(a, 0) : b + 1].any() for a, b in zip(*among, strict=True)])
    home = model.solve(bound.mechanism.posture("home")).link_poses
    floor = floor_of(bound.mechanism, home)
    patient = patient_of(bound, chosen, floor)
    assert patient is not None
    frame = bound.mechanism.frame(chosen.frame)
    tips = (links[frame.body] @ frame.T_body_frame)[:, :3, 3]
    return Played(protocol, bound.mechanism, patient, floor, links, entered, tips)


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


def faults(p: Played) -> Iterator[str]:
    """Yield what is sunk in what, and where; nothing if patient and robot are well placed."""
    parts = {b.name: b.meshes[0] for b in p.patient.mechanism.bodies}
    whole = {name: Shape(name, name, [mesh]) for name, mesh in parts.items()}
    opened = {
        name: Shape(name, name, [holed(parts[name], p.patient.port, p.patient.port_radius)])
        for name in p.patient.opens | p.patient.access
    }
    for body in p.mechanism.bodies:
        if not body.meshes or body.name in p.patient.replaces:
            continue
        shape = Shape(body.name, body.name, body.meshes)
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
                if distance_between(shape, (opened if is_open else whole)[name], Ts[k], np.eye(4)) <= 0:
                    yield f"{body.name} runs through {name} at sample {k}"
                elif not is_open and inside(mesh, firsts @ Ts[k][:3, :3].T + Ts[k][:3, 3]).any():
                    yield f"{body.name} is inside {name} at sample {k}"


@pytest.fixture(scope="module", params=cases())
def played(request) -> Played:
    return play(*request.param)


@pytest.mark.slow
def test_nothing_is_sunk(played):
    """Before the insertion nothing is in the patient; after it only what goes through the port, and never the table."""
    assert not list(faults(played))


@pytest.mark.slow
@pytest.mark.parametrize("by_mm", [(0, 0, 120), (40, 0, 0)])
def test_a_patient_elsewhere_is_caught(played, by_mm):
    """Of each played protocol: the same patient beside its port, or above it, is run through."""
    moved = spatial.pose(p=np.array(by_mm) * MM)
    # The robot in the patient's old place is the robot displaced by the opposite.
    links = {n: spatial.inverse(moved) @ T for n, T in played.links.items()}
    assert next(faults(replace(played, links=links)), None)


@pytest.mark.slow
def test_nothing_floats(played):
    """Every part leans, through others, on the floor or on what stands fast of the robot."""
    parts = {b.name: Shape(b.name, b.name, b.meshes) for b in played.patient.mechanism.bodies}
    lowest = {b.name: b.meshes[0].vertices[:, 2].min() for b in played.patient.mechanism.bodies}
    assert min(lowest.values()) > played.floor - 1e-9
    base = played.mechanism.body(played.mechanism.base)
    fast = Shape("base", base.name, base.meshes)
    one = np.eye(4)
    held = {n for n, low in lowest.items() if low < played.floor + 1e-9}
    held |= {n for n, s in parts.items() if distance_between(s, fast, one, played.links[base.name][0]) < CLOSE}
    hull = {b.name: b.meshes[0] for b in played.patient.mechanism.bodies}
    while True:
        more = {
            n
            for n in parts.keys() - held
            for m in held
            if distance_between(parts[n], parts[m], one, one) < CLOSE or inside(hull[m], hull[n].vertices[:1])[0]
        }
        if not more:
            break
        held |= more
    assert parts.keys() == held


def test_the_endoscope_sees_the_inside(played):
    """While the instrument is in, the camera is in a part that the port opens, in front of nothing it touches."""
    name, protocol = played.mechanism.name, played.protocol
    movable = MovableRobot(twin.load(name))
    movable.use_tool_frame_of(movable.robot.protocol(protocol))
    parts = {b.name: b.meshes[0] for b in played.patient.mechanism.bodies}
    deepest = int(np.argmax(np.linalg.norm(played.tips - played.patient.port, axis=1) * played.inside))
    poses = {n: T[deepest] for n, T in played.links.items()}
    movable.assembly = replace(movable.assembly, link_poses=poses)
    eye, ahead, above = movable.camera()
    np.testing.assert_allclose(np.dot(ahead - eye, above - eye), 0, atol=1e-12)
    assert any(inside(parts[n], eye[None])[0] for n in played.patient.opens)
    assert not any(inside(parts[n], eye[None])[0] for n in parts.keys() - played.patient.opens)
    if any(f.name == ENDOSCOPE_FRAME for f in played.mechanism.frames):
        frame = played.mechanism.frame(ENDOSCOPE_FRAME)
        T = poses[frame.body] @ frame.T_body_frame
        np.testing.assert_allclose(eye, T[:3, 3])
        np.testing.assert_allclose((ahead - eye) / np.linalg.norm(ahead - eye), T[:3, 2], atol=1e-12)


def test_an_eye_stands_where_the_phantom_does(played):
    eyes = [b.meshes[0] for b in played.patient.mechanism.bodies if b.name == "eye"]
    frames = [f for f in played.mechanism.frames if f.name == "eye"]
    if not frames:
        assert not eyes
        return
    T = played.links[frames[0].body][0] @ frames[0].T_body_frame
    np.testing.assert_allclose(eyes[0].vertices.mean(axis=0), T[:3, 3], atol=2e-6)


@pytest.mark.parametrize("name", twin.names())
def test_every_protocol_has_a_patient_or_says_why_not(name):
    robot = twin.load(name)
    for protocol in map(robot.protocol, robot.files.protocols()):
        assert (protocol.patient is None) == bool(protocol.no_patient)
        if protocol.patient is None:
            said = none_there(robot, protocol)
            assert protocol.no_patient.rstrip(".") in said
            with_one = [n for n in robot.files.protocols() if robot.protocol(n).patient is not None]
            assert all(n in said for n in with_one)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"body": "abdomne"}, "there is no patient 'abdomne'. Did you mean 'abdomen'?"),
        ({"port": "navle"}, "there is no port 'navle'"),
        ({"replaces": ("phantom",)}, "there is no body 'phantom'"),
    ],
)
def test_a_wrong_patient_is_refused(change, message):
    robot = twin.load("sils")
    protocol = robot.protocol("lowered_patient")
    wrong = replace(protocol, patient=replace(protocol.patient, **change))
    with pytest.raises(TwinError, match=re.escape(message)):
        patient_of(robot, wrong, 0.0)


def test_a_patient_needs_an_rcm():
    robot = twin.load("sils")
    protocol = robot.protocol("lowered_patient")
    with pytest.raises(TwinError, match="no RCM at which to place it"):
        patient_of(robot, replace(protocol, phases=protocol.phases[:1]), 0.0)


def test_a_patient_and_a_reason_for_none_exclude_each_other(tmp_path):
    text = assets.files("sils").protocol("lowered_patient").read_text("utf-8")
    file = tmp_path / "lowered_patient.toml"
    file.write_text(text.replace('start = "ready"', 'start = "ready"\nno_patient = "none"'), "utf-8")
    with pytest.raises(TwinError, match="no_patient"):
        twin.load("sils").protocol(str(file))


@pytest.mark.parametrize("file", sorted((assets.data_folder() / "cad/patients").glob("*.toml")), ids=lambda f: f.stem)
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (r'(?s)(name = "head"\nshape)', r'name = "neck"\nshape', "two parts are named 'neck'"),
        (r"(size_mm = \[)[0-9.]+", r"\g<1>-1.0", "is not above 0"),
        (r"(opens = \[)", r'\1"hat", ', "there is no part 'hat'"),
        (r'(?s)(name = "neck"\n)', r'\1port = "mouth"\n', "there is no port 'mouth'"),
    ],
)
def test_a_wrong_patient_file_says_where(file, old, new, message, tmp_path):
    changed = tmp_path / file.name
    text, count = re.subn(old, new, file.read_text("utf-8"), count=1)
    assert count == 1
    changed.write_text(text, "utf-8")
    with pytest.raises(TwinError, match=rf"{file.stem}\.toml:[0-9]+: .*{message}"):
        read_patient(changed)
