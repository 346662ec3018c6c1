"""What other engines get: USDZ, MJCF and URDF, read here by MuJoCo, Pinocchio and USD's own validators."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pxr import Usd, UsdGeom, UsdPhysics, UsdUtils, UsdValidation

import twin
from twin.core import spatial
from twin.exchange.formats.mjcf.write import mjcf_findings, write_mjcf
from twin.exchange.formats.urdf.write import urdf_findings, write_urdf
from twin.exchange.formats.usd.write import write_usd
from twin.exchange.formats.usdz.write import HOLD, write_usdz
from twin.exchange.write.clip import Clip
from twin.reference import ReferenceModel
from twin.usd.write.spanning import spanning

ROBOTS = ("sils", "lapbot")
FRAMES = 21


@pytest.fixture(scope="module", params=ROBOTS)
def case(request, sils_cad):
    """A weighed mechanism, one mesh a body, and a motion of it: all driven joints there and back, not in step."""
    from twin.cad.build import read_mechanism

    cad = sils_cad if request.param == "sils" else read_mechanism(twin.load(request.param).files.description)
    bodies = tuple(replace(b, meshes=b.meshes[:1]) for b in cad.mechanism.bodies)
    mechanism = replace(cad.mechanism, bodies=bodies, joints=tuple(replace(j, mating=()) for j in cad.mechanism.joints))
    return mechanism, swing(mechanism)


def swing(mechanism) -> Clip:
    model = ReferenceModel(mechanism)
    home = model.home()
    times = np.arange(FRAMES) / 20
    size = np.array([0.1 if j.is_angle else 0.01 for j in mechanism.active])
    phase = np.linspace(0.0, 1.0, len(size))
    q = home.q + size * np.sin(np.pi * times[:, None] / times[-1]) * np.cos(phase)
    run = model.run(q, home)
    joints = {j.name: run.q[:, i] for i, j in enumerate(mechanism.active)} | run.q_passive
    active = tuple(j.name for j in mechanism.active)
    return Clip("swing", "", times, model.link_poses(run.x), joints, active, (), 20.0, between=None)


def relative(joint, clip, k):
    return joint.relative(clip.links[joint.parent][k], clip.links[joint.child][k])


# -- MJCF -------------------------------------------------------------------------------------------------


def place_mujoco(model, data, mechanism, clip, k):
    home = ReferenceModel(mechanism).home().link_poses
    for joint in spanning(mechanism).tree:
        if joint.type == "fixed":
            continue
        at = model.joint(joint.name).qposadr[0]
        if joint.type == "spherical":  # its quaternion counts from home
            then = home[joint.parent][:3, :3].T @ home[joint.child][:3, :3]
            now = clip.links[joint.parent][k, :3, :3].T @ clip.links[joint.child][k, :3, :3]
            data.qpos[at : at + 4] = spatial.quat_from_matrix_wxyz(then.T @ now)
        else:
            data.qpos[at] = clip.joints[joint.name][k]
    mujoco.mj_fwdPosition(model, data)


@pytest.mark.slow
def test_mujoco_puts_every_link_where_it_is_and_finds_the_loops_closed(case, tmp_path):
    mechanism, clip = case
    model = mujoco.MjModel.from_xml_path(str(write_mjcf(mechanism, tmp_path)))
    data = mujoco.MjData(model)
    for k in range(FRAMES):
        place_mujoco(model, data, mechanism, clip, k)
        assert data.ne >= 3
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-10
        for name, Ts in clip.links.items():
            own = data.body(name)
            assert np.abs(own.xpos - Ts[k, :3, 3]).max() < 1e-9
            assert np.abs(own.xmat.reshape(3, 3) - Ts[k, :3, :3]).max() < 1e-9
    assert model.body_mass.sum() == pytest.approx(sum(b.inertia.mass for b in mechanism.bodies))
    # A loop that is open shows in these rows: one driven joint 1 mm (or 1 mrad) on, all others left.
    data.qpos[model.joint(mechanism.active[1].name).qposadr[0]] += 1e-3
    mujoco.mj_fwdPosition(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() > 1e-4


def test_mujoco_holds_the_loops_as_it_loads_the_file(case, tmp_path):
    """Nothing is set up: no keyframe, no control, the time step and the integrator of the file."""
    mechanism, _ = case
    model = mujoco.MjModel.from_xml_path(str(write_mjcf(mechanism, tmp_path)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.opt.timestep == 1e-3
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-10
    home = ReferenceModel(mechanism).home()
    assert all(
        model.qpos0[model.joint(n).qposadr[0]] == pytest.approx(q) for n, q in home.q_full.items() if n in loaded(model)
    )
    before = {b.name: data.body(b.name).xpos.copy() for b in mechanism.bodies}
    assert all(np.abs(p - home.link_poses[n][:3, 3]).max() < 1e-9 for n, p in before.items())
    for _ in range(1000):
        mujoco.mj_step(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-6
    assert max(np.abs(data.body(n).xpos - p).max() for n, p in before.items()) < 10e-6
    assert np.abs(data.qvel).max() < 1e-3
    # A control is how far the joint is to go from home.
    data.ctrl[:] = [
        1e-3 if j.limits is None or j.limits[1] > home.q_full[j.name] + 1e-3 else -1e-3 for j in mechanism.active
    ]
    wanted = [home.q_full[j.name] + c for j, c in zip(mechanism.active, data.ctrl, strict=True)]
    for _ in range(1000):
        mujoco.mj_step(model, data)
    got = [data.qpos[model.joint(j.name).qposadr[0]] for j in mechanism.active]
    assert np.abs(np.subtract(got, wanted)).max() < 2e-4
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-6


def loaded(model) -> set[str]:
    return {model.joint(j).name for j in range(model.njnt)}


# -- URDF -------------------------------------------------------------------------------------------------


def urdf_values(mechanism, clip, k):
    """Return the value of each joint of the URDF: a ball is three turns about x, y and z, zero at home."""
    home, out = ReferenceModel(mechanism).home().link_poses, {}
    for joint in spanning(mechanism).tree:
        if joint.type == "spherical":
            R = joint.relative(home[joint.parent], home[joint.child])[:3, :3].T @ relative(joint, clip, k)[:3, :3]
            x, y, z = np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0])
            out |= {f"{joint.name}_x": x, f"{joint.name}_y": y, f"{joint.name}_z": z}
        elif joint.type != "fixed":
            out[joint.name] = clip.joints[joint.name][k]
    return out


def test_pinocchio_puts_every_link_of_the_urdf_where_it_is(case, tmp_path):
    mechanism, clip = case
    model = pin.buildModelFromUrdf(str(write_urdf(mechanism, tmp_path)))
    data = model.createData()
    for k in range(FRAMES):
        q = pin.neutral(model)
        for name, value in urdf_values(mechanism, clip, k).items():
            joint = model.joints[model.getJointId(name)]
            q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
        pin.framesForwardKinematics(model, data, q)
        for name, Ts in clip.links.items():
            assert model.existFrame(name)
            assert np.abs(data.oMf[model.getFrameId(name)].homogeneous - Ts[k]).max() < 1e-9


def test_the_urdf_says_which_joints_it_leaves_out(case, tmp_path):
    mechanism, _ = case
    path = write_urdf(mechanism, tmp_path)
    text, codes = path.read_text(), {f.code for f in urdf_findings(mechanism)}
    assert "export.urdf_loops" in codes
    for joint in spanning(mechanism).cut:
        assert f"{joint.name} ({joint.type}" in text
    assert ("export.urdf_coupling" in codes) == bool(mechanism.couplings)
    for mesh in ET.parse(path).getroot().iter("mesh"):
        assert (tmp_path / mesh.get("filename")).is_file()
        assert mesh.get("scale") == "0.001 0.001 0.001"


def test_comments_name_the_files_that_they_speak_of(case, tmp_path):
    mechanism, _ = case
    light = replace(mechanism, bodies=tuple(replace(b, inertia=None) for b in mechanism.bodies))
    for write, suffix in ((write_mjcf, "xml"), (write_urdf, "urdf")):
        text = write(light, tmp_path, f"{mechanism.name}_clip").read_text()
        assert f"{mechanism.name}_clip.{suffix}" in text
        assert f"{mechanism.name}.{suffix}" not in text
        assert f"{mechanism.name}.yaml" not in text


def test_a_mass_that_nobody_knows_is_said(case, tmp_path):
    mechanism, _ = case
    light = replace(mechanism, bodies=tuple(replace(b, inertia=None) for b in mechanism.bodies))
    for write, findings in ((write_mjcf, mjcf_findings), (write_urdf, urdf_findings)):
        assert "export.mass_unknown" in {f.code for f in findings(light)}
        assert "export.mass_unknown" not in {f.code for f in findings(mechanism)}
        assert "is unknown, but the format requires one" in write(light, tmp_path).read_text()
    mujoco.MjModel.from_xml_path(str(tmp_path / f"{mechanism.name}.xml"))


# -- USD --------------------------------------------------------------------------------------------------


def validated(path):
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    return [e.GetMessage() for e in UsdValidation.ValidationContext(validators).Validate(stage)]


def test_the_stage_for_simulators_passes_usds_validators(case, tmp_path):
    mechanism, clip = case
    files = write_usd(mechanism, [clip], tmp_path)
    assert {f.relative_to(tmp_path).as_posix() for f in files} == {
        p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()
    }
    for root in (files[0], tmp_path / f"{mechanism.name}_sim.usda", tmp_path / f"{mechanism.name}_swing.usda"):
        assert validated(root) == []


def test_simulators_start_where_the_bodies_are(case, tmp_path):
    """Balls have no joint state: their two frames must coincide as written, whatever the axis is."""
    mechanism, _ = case
    stage = Usd.Stage.Open(str(write_usd(mechanism, [], tmp_path)[0]))
    cache = UsdGeom.XformCache()
    balls = [j for j in spanning(mechanism).tree if j.type == "spherical"]
    assert bool(balls) == (mechanism.name == "sils")  # of LAPBOT the ball is cut, a slide is kept
    for ball in balls:
        joint = UsdPhysics.SphericalJoint(stage.GetPrimAtPath(f"/{mechanism.name}/joints/{ball.name}"))
        turned = []
        for rel, rot in (
            (joint.GetBody0Rel(), joint.GetLocalRot0Attr()),
            (joint.GetBody1Rel(), joint.GetLocalRot1Attr()),
        ):
            body = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(rel.GetTargets()[0])).ExtractRotationMatrix()
            local = rot.Get()
            turned.append(np.array(body).T @ spatial.matrix_from_quat_wxyz([local.GetReal(), *local.GetImaginary()]))
        assert spatial.rotation_angle(turned[0].T @ turned[1]) < 1e-6
        assert ball.cone is None or joint.GetPrim().GetAttribute("twin:cone").Get() == pytest.approx(ball.cone)


def test_every_engine_finds_the_state_and_joints_that_lead_outwards(case, tmp_path):
    """Newton asks for other attributes than PhysX, and refuses a tree with a joint whose parent is the outer body."""
    mechanism, _ = case
    stage = Usd.Stage.Open(str(write_usd(mechanism, [], tmp_path)[0]))
    root = stage.GetPrimAtPath(f"/{mechanism.name}")
    assert root.GetAttribute("newton:selfCollisionEnabled").Get() is False
    reached, states = {mechanism.base}, 0
    pending = [
        j
        for j in (UsdPhysics.Joint(p) for p in stage.Traverse())
        if j and j.GetBody0Rel().GetTargets()[0] != root.GetPath()
    ]
    inside = [j for j in pending if not j.GetExcludeFromArticulationAttr().Get()]
    for joint in inside:
        prim, kind = joint.GetPrim(), "angular" if joint.GetPrim().IsA(UsdPhysics.RevoluteJoint) else "linear"
        if prim.IsA(UsdPhysics.RevoluteJoint) or prim.IsA(UsdPhysics.PrismaticJoint):
            state = prim.GetAttribute(f"state:{kind}:physics:position").Get()
            assert prim.GetAttribute(f"newton:{kind}:position").Get() == state
            states += state != 0
    assert states
    ends = [(j.GetBody0Rel().GetTargets()[0].name, j.GetBody1Rel().GetTargets()[0].name) for j in inside]
    while ends:
        now = [e for e in ends if e[0] in reached]
        assert now, f"nothing leads from {reached} to {ends}"
        reached |= {child for _, child in now}
        ends = [e for e in ends if e not in now]
    assert reached == {b.name for b in mechanism.bodies}


def test_drives_bear_the_weight(case, tmp_path):
    mechanism, _ = case
    stage = Usd.Stage.Open(str(write_usd(mechanism, [], tmp_path)[0]))
    weight = sum(b.inertia.mass for b in mechanism.bodies) * 9.81
    ahead = 0.0
    for joint in mechanism.active:
        prim = stage.GetPrimAtPath(f"/{mechanism.name}/joints/{joint.name}")
        kind = "angular" if joint.is_angle else "linear"
        drive = UsdPhysics.DriveAPI(prim, kind)
        state = prim.GetAttribute(f"state:{kind}:physics:position").Get()
        if not joint.is_angle:
            ahead += abs(drive.GetTargetPositionAttr().Get() - state) * drive.GetStiffnessAttr().Get()
    assert 0.02 * weight < ahead < weight


# -- USDZ -------------------------------------------------------------------------------------------------


def test_the_usdz_is_one_layer_y_up_that_plays(case, tmp_path):
    mechanism, clip = case
    path = write_usdz(mechanism, clip, tmp_path / "robot.usdz")
    assert validated(path) == []
    with zipfile.ZipFile(path) as archive:
        (entry,) = archive.infolist()
        assert entry.filename == f"{mechanism.name}.usdc"
        assert entry.compress_type == zipfile.ZIP_STORED
        assert entry.date_time == (1980, 1, 1, 0, 0, 0)
    raw = path.read_bytes()
    assert (30 + int.from_bytes(raw[26:28], "little") + int.from_bytes(raw[28:30], "little")) % 64 == 0
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (60.0, 60.0)
    assert stage.GetEndTimeCode() in (60 * clip.times[-1], 60 * (clip.times[-1] + HOLD))
    assert not [p for p in stage.Traverse() if p.IsA(UsdPhysics.Joint) or p.HasAPI(UsdPhysics.RigidBodyAPI)]
    assert not UsdUtils.ComputeAllDependencies(str(path))[2]
    z_up = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    for k in range(FRAMES):
        cache = UsdGeom.XformCache(60 * float(clip.times[k]))
        for name, Ts in clip.links.items():
            prim = stage.GetPrimAtPath(f"/{mechanism.name}/{name}")
            assert np.abs(z_up @ np.array(cache.GetLocalToWorldTransform(prim)).T - Ts[k]).max() < 1e-6
    still = stage.GetPrimAtPath(f"/{mechanism.name}/{mechanism.base}")
    assert not any(a.GetNumTimeSamples() for a in still.GetAttributes())


@pytest.mark.slow
def test_the_same_robot_gives_the_same_bytes(case, tmp_path):
    mechanism, clip = case
    for run in ("a", "b"):
        folder = tmp_path / run
        write_usd(mechanism, [clip], folder / "usd")
        write_usdz(mechanism, clip, folder / "robot.usdz")
        write_mjcf(mechanism, folder)
        write_urdf(mechanism, folder)
    first = {p.relative_to(tmp_path / "a"): p.read_bytes() for p in (tmp_path / "a").rglob("*") if p.is_file()}
    second = {p.relative_to(tmp_path / "b"): p.read_bytes() for p in (tmp_path / "b").rglob("*") if p.is_file()}
    assert first == second
