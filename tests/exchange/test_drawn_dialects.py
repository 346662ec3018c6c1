"""Drawn robots, written as others write them, are imported with the poses, masses and couplings that are meant.

made/dialects.py writes each robot as URDF, xacro, MJCF, SDF and USD with the elements of docs/usd-mapping.md. The poses
of all bodies and frames are compared with those of the drawing, and with Pinocchio (a xacro: with the URDF that it
means), MuJoCo (also of URDF, where it reads it) and OpenUSD. No library reads SDF here. Tables of DH parameters are
drawn in test_importing_dh.py. TWIN_DIALECTS=1000 draws that many robots of each format in the nightly lane.
"""

from __future__ import annotations

import os
import re
import shutil

import numpy as np
import pytest

from exchange.test_drawn_robots import EXACT, SINGLE, apart, by_mujoco, by_openusd
from made import dialects
from made.by_pinocchio import by_pinocchio
from twin.core import spatial
from twin.core.errors import SourceError
from twin.core.identifiers import identifier
from twin.exchange.read import read
from twin.exchange.read.imported_robot import rest_poses
from twin.exchange.xacro import settings

COUNT = 4
"""Robots of each format in the default suite."""

MANY = int(os.environ.get("TWIN_DIALECTS", "400"))
"""Robots of each format in the nightly lane."""


def bodies_and_frames(mechanism, values):
    """Return {name: T_base_x (4, 4)} of all bodies and named frames at {joint: coordinate in m or rad}."""
    poses = rest_poses(mechanism, values)
    for frame in mechanism.frames:
        poses.setdefault(frame.name, poses[frame.body] @ frame.T_body_frame)
    return poses


def by_name(poses, rename):
    """Return poses by the names in the mechanism."""
    out = {}
    for name, T in poses.items():
        out[rename(name)] = T
    return out


def by_mujoco_of_urdf(path, coordinates):
    """Return {body: T_world_body (4, 4)} of a URDF by MuJoCo's own reader; fixed links stay bodies."""
    options = '<mujoco><compiler fusestatic="false" discardvisual="true" balanceinertia="true"/></mujoco>'
    text = re.sub(r"<robot [^>]*>", lambda found: found[0] + options, path.read_text("utf-8"), count=1)
    copy = path.with_name("mujoco.urdf")
    copy.write_text(text, "utf-8")
    return by_mujoco(copy, coordinates)[0]


def check(format, seed, folder):
    """Import a drawn robot; fail at the first difference."""
    robot, rng = dialects.draw(seed, format)
    written = dialects.write(robot, rng, format, folder)
    robot = written.robot
    given = settings(written.arguments, []) if format == "xacro" else None
    mechanism = read(written.path, guarded=False, xacro=given).mechanism
    rename = identifier
    if robot.links[0].name != "world":
        rename = lambda name: "world_2" if name == "world" and mechanism.base != "world" else identifier(name)  # noqa: E731
    names = {joint.name for joint in mechanism.joints}
    driven = {joint.name for joint in mechanism.active}
    assert driven == {identifier(link.joint) for link in robot.driven}
    tolerance = SINGLE if format == "usd" else EXACT
    for _ in range(2):
        own = robot.drawn_coordinates(rng)
        coordinates = robot.coordinates(own)
        values = {}
        for name, value in coordinates.items():
            assert identifier(name) in names
            values[identifier(name)] = value
        for coupling in mechanism.couplings:
            total = np.dot(coupling.ratios, [values[joint] for joint in coupling.joints])
            assert total == pytest.approx(coupling.total, abs=EXACT)
        assert len(mechanism.couplings) == sum(link.follows is not None for link in robot.links)
        for name, (x, y, angle) in written.planar.items():
            stem = identifier(name)
            values |= {f"{stem}_x": x, f"{stem}_y": y, f"{stem}_z": angle}
        found = bodies_and_frames(mechanism, values)
        drawing = by_name(robot.poses(own), rename)
        whole = {rename(link.name) for link in robot.links if link.mass or link.shape}
        assert len(whole - found.keys()) <= stacked(robot, format)
        assert apart(found, drawing) < tolerance
        if format in ("urdf", "xacro"):
            theirs = by_pinocchio(written.plain or written.path, coordinates, written.planar)
            assert apart(found, by_name(theirs, rename)) < EXACT
        if format == "urdf" and not written.planar and all(link.mass for link in robot.links):
            # MuJoCo refuses moving links without mass, and has no planar joints
            assert apart(found, by_name(by_mujoco_of_urdf(written.path, coordinates), rename)) < EXACT
        if format == "mjcf":
            theirs, gravity = by_mujoco(written.path, coordinates)
            assert apart(found, by_name(theirs, rename)) < EXACT
            np.testing.assert_allclose(mechanism.gravity, gravity, atol=1e-12)
    if format == "usd":
        theirs = {}
        for name, T in by_openusd(written.path).items():
            size = np.linalg.norm(T[:3, 0])  # of the parents' scale
            theirs[identifier(name)] = spatial.pose(T[:3, :3] / size, T[:3, 3])
        assert apart(mechanism.rest, theirs) < EXACT
    for joint in mechanism.joints:
        limits = {identifier(link.joint): link.limits for link in robot.links}.get(joint.name)
        if limits is not None:
            assert joint.limits == pytest.approx(limits, abs=1e-6)
    heavy = {identifier(link.name): link for link in robot.links if link.mass}
    shapes = {identifier(link.name): link for link in robot.links if link.shape}
    for body in mechanism.bodies:
        if body.name in heavy and body.inertia is not None:
            link = heavy[body.name]
            mass, center, tensor = written.tensors.get(link.name, (link.mass, link.center, np.diag(link.moments)))
            assert body.inertia.mass == pytest.approx(mass, rel=1e-6)
            np.testing.assert_allclose(body.inertia.p_body_com, center, atol=1e-6)
            np.testing.assert_allclose(body.inertia.I_com, tensor, rtol=1e-5, atol=1e-6)
        if body.name in shapes:
            link = shapes[body.name]
            vertices = np.vstack([mesh.vertices for mesh in body.meshes])
            half = np.divide(link.size, 2)
            np.testing.assert_allclose(vertices.min(axis=0), link.center - half, atol=2e-6)
            np.testing.assert_allclose(vertices.max(axis=0), link.center + half, atol=2e-6)


def stacked(robot, format):
    """Return how many links may have no body: of an MJCF, those whose two joints are in the body of another link."""
    if format != "mjcf":
        return 0
    return sum(bool(np.array_equal(link.T, np.eye(4))) for link in robot.links[1:])


FORMATS = ("urdf", "xacro", "mjcf", "sdf", "usd")


@pytest.mark.parametrize("format", FORMATS)
def test_robots_in_the_spellings_of_others_are_the_robots_that_are_meant(format, tmp_path):
    for seed in range(COUNT):
        check(format, seed, tmp_path / f"{seed}")


@pytest.mark.nightly
@pytest.mark.parametrize("format", FORMATS)
def test_many_robots_in_the_spellings_of_others(format, tmp_path):
    faults = []
    for seed in range(COUNT, COUNT + MANY):
        folder = tmp_path / f"{seed}"
        try:
            check(format, seed, folder)
            shutil.rmtree(folder)
        except Exception as error:  # all faults are listed, not only the first
            words = " ".join(str(error).split())
            faults.append(f"{format} {seed}: {type(error).__name__} {words[:300]}")
    assert not faults, f"{len(faults)} of {MANY}:\n" + "\n".join(faults)


def test_axes_of_old_sdf_are_in_the_frame_of_the_model(tmp_path):
    """All axes of SDF 1.4, and those of 1.5 and 1.6 with use_parent_model_frame (*.convert of sdformat)."""
    joint = (
        '<joint name="j" type="revolute"><parent>a</parent><child>b</child><axis>{}<xyz>0 0 1</xyz>'
        "<limit><lower>-1</lower><upper>1</upper></limit></axis></joint>"
    )
    links = '<static>1</static><link name="a"/><link name="b"><pose>0 0 0 1.5707963267948966 0 0</pose></link>'
    in_joint = np.array([0.0, -1.0, 0.0])  # z of the joint, which is turned about x
    in_model = np.array([0.0, 0.0, 1.0])
    for version, said, direction in (
        ("1.4", "", in_model),
        ("1.5", "", in_joint),
        ("1.6", "<use_parent_model_frame>true</use_parent_model_frame>", in_model),
        ("1.6", "<use_parent_model_frame>0</use_parent_model_frame>", in_joint),
        ("1.7", "", in_joint),
    ):
        path = tmp_path / "old.sdf"
        model = f'<model name="m">{links}{joint.format(said)}</model>'
        path.write_text(f'<sdf version="{version}">{model}</sdf>')
        mechanism = read(path).mechanism
        turned = rest_poses(mechanism, {"j": 0.5})["b"][:3, :3] @ rest_poses(mechanism)["b"][:3, :3].T
        np.testing.assert_allclose(spatial.log_so3(turned), 0.5 * direction, atol=1e-12)


def test_a_pose_of_sdf_may_have_a_quaternion(tmp_path):
    path = tmp_path / "turned.sdf"
    link = '<link name="b"><pose rotation_format="quat_xyzw">1 2 3 {}</pose></link>'
    joint = '<joint name="j" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint>'
    text = f'<sdf version="1.9"><model name="m"><static>1</static><link name="a"/>{link}{joint}</model></sdf>'
    path.write_text(text.format("2 0 0 2"))
    expected = spatial.pose(spatial.exp_so3([np.pi / 2, 0, 0]), [1, 2, 3])
    np.testing.assert_allclose(read(path).mechanism.rest["b"], expected, atol=1e-12)
    path.write_text(text.format("0 0 0 0"))
    with pytest.raises(SourceError, match=r"link 'b': pose: the quaternion 0 0 0 0 has length 0"):
        read(path)
    path.write_text(text.format("0 0 0 1").replace("quat_xyzw", "axis"))
    with pytest.raises(SourceError, match=r"rotation_format 'axis' is unknown: use euler_rpy or quat_xyzw"):
        read(path)
