"""Robots drawn at random are imported and exported: poses, gravity, and the audit of what is written.

The poses of an import are compared with Pinocchio's own URDF parser, MuJoCo's own compiler and OpenUSD's own
transforms, and with those of the drawing (for SDF, which no library here reads, only with these). The files that are
written are read by Pinocchio, MuJoCo and OpenUSD again. TWIN_DRAWN=500 draws that many robots of each format.
"""

from __future__ import annotations

import os
import random

import mujoco
import numpy as np
import pytest
from pxr import Usd, UsdGeom

import twin.exchange.audit
from made import drawn_robots
from made.by_pinocchio import by_pinocchio
from twin.cad.build import read_mechanism
from twin.core import spatial
from twin.core.identifiers import identifier
from twin.exchange.audit import audit
from twin.exchange.formats import audit_formats
from twin.exchange.formats.glb.write import write_glb
from twin.exchange.formats.mjcf.write import write_mjcf
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.formats.usd.write import write_usd
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.reference import ReferenceModel

COUNT = int(os.environ.get("TWIN_DRAWN", "5"))

EXACT = 1e-9
"""Maximum difference of poses, in m and 1, where the format has double precision."""

SINGLE = 2e-6
"""The same where joint frames of a stage, in single precision, lead to the pose: half a unit in the last place of each
of 12 numbers up to 3 m, over up to six joints."""

FILES = ("urdf", "mjcf", "sdf", "usd")


def apart(a, b):
    """Return the largest difference of the poses of links that are in both mappings."""
    names = a.keys() & b.keys()
    assert names
    return max(float(np.abs(a[n] - b[n]).max()) for n in names)


def by_mujoco(path, coordinates):
    """Return {body: T_world_body (4, 4)} of an MJCF at the joints' coordinates; other joints are at `qpos0`."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in coordinates.items():
        data.joint(name).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    out = {}
    for i in range(1, model.nbody):
        out[model.body(i).name] = spatial.pose(data.xmat[i].reshape(3, 3), data.xpos[i])
    return out, np.array(model.opt.gravity)


def by_openusd(path):
    """Return {prim: T_world_prim (4, 4)} of the prims of a stage, in m and with z up."""
    stage = Usd.Stage.Open(str(path))
    cache, meters = UsdGeom.XformCache(), UsdGeom.GetStageMetersPerUnit(stage)
    R_world_stage = drawn_robots.R_STAGE_WORLD[UsdGeom.GetStageUpAxis(stage)].T
    out = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Xform):
            T = np.array(cache.GetLocalToWorldTransform(prim)).T
            T[:3, 3] *= meters
            out[prim.GetName()] = spatial.pose(R_world_stage) @ T
    return out


def name_of(robot, link):
    """Return the name of a link in a mechanism: only the base keeps the name "world"."""
    return "world_2" if link == "world" and robot.links[0].name != "world" else identifier(link)


def posed(model, own):
    """Return {body: T_base_body (4, 4)} of a reference model at the coordinates of its driven joints."""
    q = np.array([own[j.name] for j in model.mechanism.active])
    return model.solve(q).link_poses


def check(robot, seed, folder):
    """Import the robot and export it; fail at the first difference."""
    rng = random.Random(seed)
    path = drawn_robots.write(robot, folder)
    imported = close(read(path, guarded=False))
    m = imported.mechanism
    tolerance = SINGLE if robot.format == "usd" else EXACT

    # what was read
    expected = robot.gravity or (0.0, 0.0, -9.81)
    np.testing.assert_allclose(m.gravity, expected, atol=1e-6)
    free = [j for j in m.joints if j.type == "free"]
    assert len(free) == (robot.stand == "floating")
    assert {j.name for j in m.active} == {identifier(k.joint) for k in robot.driven}
    home = dict(zip([j.name for j in m.active], m.home, strict=True))
    for joint in m.joints:
        if joint.limits is not None and len(joint.free_axes) == 1:
            q = joint.coordinate(m.rest[joint.parent], m.rest[joint.child])
            assert joint.limits[0] - 1e-8 <= q <= joint.limits[1] + 1e-8, f"{joint.name} starts at {q}"
    model = ReferenceModel(m)
    drawn_at = []
    for _ in range(2):
        own = robot.drawn_coordinates(rng)
        at = {identifier(n): v for n, v in own.items()}
        drawn_at.append(at)
        links = posed(model, at)
        drawing = {name_of(robot, n): T for n, T in robot.poses(own).items()}
        assert apart(links, drawing) < tolerance
        if robot.format == "urdf":
            theirs = by_pinocchio(path, robot.coordinates(own))
            assert apart(links, {name_of(robot, n): T for n, T in theirs.items()}) < EXACT
        if robot.format == "mjcf":
            theirs, gravity = by_mujoco(path, robot.coordinates(own))
            assert apart(links, {name_of(robot, n): T for n, T in theirs.items()}) < EXACT
            np.testing.assert_allclose(m.gravity, gravity, atol=1e-12)
    if robot.format == "usd":
        drawn = {identifier(n): T for n, T in by_openusd(path).items()}
        stated = read(path, guarded=False).mechanism.rest
        assert apart(stated, drawn) < EXACT
    shapes = {name_of(robot, k.name): k for k in robot.links if k.shape}
    for body in m.bodies:
        if body.name in shapes:
            (mesh,) = body.meshes
            link = shapes[body.name]
            corners = np.array([link.center - np.divide(link.size, 2), link.center + np.divide(link.size, 2)])
            np.testing.assert_allclose([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)], corners, atol=1e-6)

    # what is written
    write_folder(imported, "drawn", folder / "robot", path)
    again = read_mechanism(folder / "robot/cad/drawn.toml").mechanism
    assert again.gravity == m.gravity
    copy = ReferenceModel(again)
    start, restart = posed(model, home), posed(copy, home)
    for at in drawn_at:
        moved, copied = posed(model, at), posed(copy, at)
        for name in moved:  # body frames of a folder are not those of the file
            shift = moved[name] @ spatial.inverse(start[name])
            assert np.abs(shift - copied[name] @ spatial.inverse(restart[name])).max() < EXACT
    out = folder / "out"
    written = copy.home()
    stage = write_usd(again, (), out)[0]
    assert apart(written.link_poses, by_openusd(stage)) < EXACT
    theirs, gravity = by_mujoco(write_mjcf(again, out), {})
    assert apart(written.link_poses, theirs) < EXACT
    np.testing.assert_allclose(gravity, expected, atol=1e-6)
    assert apart(written.link_poses, by_pinocchio(write_urdf(again, out), written.q_full)) < EXACT
    write_glb(again, (), out / "drawn.glb")
    weightless = {name_of(robot, k.name) for k in robot.links if not k.mass}
    report = audit(out, mechanism=again)
    found = [f for f in report.findings if f.severity != "info" and not says_why(f, weightless)]
    assert [f"{f.code}: {f.message} [{f.where}]" for f in found] == []


def says_why(finding, weightless):
    """Return whether a finding is true: a link of the drawing has no mass, and a stage states none."""
    return finding.code == "stage.mass_missing" and finding.where.rpartition("/")[2] in weightless


@pytest.fixture
def unguarded(monkeypatch):
    """Audit without a process for each file: these files were written here."""
    monkeypatch.setattr(twin.exchange.audit, "admit_together", set)
    for format in audit_formats():
        reader = format.module("audit")
        if hasattr(reader, "admit"):
            monkeypatch.setattr(reader, "admit", lambda path: None)


@pytest.mark.usefixtures("unguarded")
@pytest.mark.parametrize("format", FILES)
def test_drawn_robots_stay_the_same_through_import_and_export(format, tmp_path):
    faults = []
    for seed in range(COUNT):
        robot = drawn_robots.draw(seed, format)
        try:
            check(robot, seed, tmp_path / f"{seed}")
        except Exception as error:  # all faults are listed, not only the first
            if COUNT <= 50:
                raise
            faults.append(f"{format} {seed} {robot.stand}: {type(error).__name__} {' '.join(str(error).split())[:300]}")
    assert not faults, f"{len(faults)} of {COUNT}:\n" + "\n".join(faults)
