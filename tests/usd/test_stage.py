"""Mechanism -> USD -> mechanism, baked motion, and stages that nobody here wrote."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from made import mechanisms as made
from twin.core import spatial
from twin.core.errors import StageError
from twin.core.spatial import continuous_signs
from twin.core.units import DEG, MM
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.usd.check import check_stage, run_usd_validators
from twin.usd.read import inspect_stage, read_motion, read_stage
from twin.usd.write import BakedMotion, write_motion, write_stage
from twin.usd.write.geometry import corner_normals
from twin.usd.write.spanning import spanning

FRAME_TOL = 6e-8
"""Joint frames are single precision: half a unit in the last place at 1 m."""


def swing(k: int = 31, factor: float = 0.45) -> BakedMotion:
    """Return a smooth motion of the four-bar at 60 Hz."""
    times = np.arange(k) / 60
    states = [made.four_bar_state(made.CRANK_AT_REST + factor * np.sin(3 * t)) for t in times]
    return BakedMotion(
        "swing",
        times,
        {b: np.stack([s[0][b] for s in states]) for b in states[0][0]},
        {j: np.array([s[1][j] for s in states]) for j in states[0][1]},
    )


def write_four_bar(folder: Path, mechanism=None, motion=None, **more):
    mechanism = mechanism or made.four_bar()
    files = write_stage(mechanism, folder, *made.four_bar_state(made.CRANK_AT_REST), **more)
    return SimpleNamespace(**vars(files), motion=motion and write_motion(mechanism, folder, motion))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_four_bar(tmp_path_factory.mktemp("bars"), motion=swing())


@pytest.fixture(scope="module")
def slider_files(tmp_path_factory):
    return write_stage(made.slider(), tmp_path_factory.mktemp("slider"), *made.slider_state(30 * MM, 0.7))


# --- round trip -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["four_bar", "slider"])
def test_joints_survive(name, written, slider_files):
    before = getattr(made, name)()
    after, notes = inspect_stage((written if name == "four_bar" else slider_files).root)
    assert notes == []
    assert [j.name for j in after.joints] == [j.name for j in before.joints]
    assert [j.name for j in after.loops] == [j.name for j in before.loops]
    assert [j.name for j in after.tree] == [j.name for j in before.tree]
    outwards = {j.name: j for j in spanning(before).tree}  # as the stage has them
    for a, b in zip((outwards.get(j.name, j) for j in before.joints), after.joints, strict=True):
        assert (a.type, a.parent, a.child, a.active, a.mating) == (
            b.type,
            b.parent,
            b.child,
            b.active,
            b.mating,
        )
        assert np.allclose(a.T_parent_joint, b.T_parent_joint, rtol=0, atol=FRAME_TOL)
        assert np.allclose(a.T_child_joint, b.T_child_joint, rtol=0, atol=FRAME_TOL)
        for field in ("limits", "cone", "max_speed"):
            x, y = getattr(a, field), getattr(b, field)
            assert (x is None) == (y is None)
            assert x is None or np.allclose(x, y, rtol=1e-7)
        assert (a.soft_limits, a.max_acceleration, a.max_jerk) == (b.soft_limits, b.max_acceleration, b.max_jerk)
        assert (a.drive is None) == (b.drive is None)
        if a.drive:
            assert np.allclose(
                [a.drive.stiffness, a.drive.damping, a.drive.max_effort],
                [b.drive.stiffness, b.drive.damping, b.drive.max_effort],
                rtol=1e-7,
            )


def test_bodies_survive(written):
    before, after = made.four_bar(), read_stage(written.root)
    assert [b.name for b in after.bodies] == [b.name for b in before.bodies]
    for a, b in zip(before.bodies, after.bodies, strict=True):
        assert b.inertia.mass == pytest.approx(a.inertia.mass, rel=1e-7)
        assert np.allclose(b.inertia.p_body_com, a.inertia.p_body_com, rtol=0, atol=FRAME_TOL)
        assert np.allclose(b.inertia.I_com, a.inertia.I_com, rtol=0, atol=2e-7 * np.max(a.inertia.I_com))
        for m, n in zip(a.meshes, b.meshes, strict=True):
            assert m.name == n.name
            assert np.array_equal(m.triangles, n.triangles)
            assert np.array_equal(m.vertices.astype(np.float32), n.vertices)
            assert np.allclose(m.color_rgba, n.color_rgba)


def test_rest_positions_are_exact_and_rotations_single(written):
    before, after = made.four_bar(), read_stage(written.root)
    for name, T in before.rest.items():
        assert np.array_equal(after.rest[name][:3, 3], T[:3, 3])
        assert spatial.rotation_angle(after.rest[name][:3, :3].T @ T[:3, :3]) < 2e-7


def test_frames_and_points_are_double_and_may_share_a_name(written):
    before, after = made.four_bar(), read_stage(written.root)
    assert np.allclose(after.frame("tool").T_body_frame, before.frame("tool").T_body_frame, rtol=0, atol=1e-15)
    assert after.frame("tool").body == "coupler"
    for point in before.points:
        assert np.array_equal(after.point(point.name).p_body, point.p_body)
        assert after.point(point.name).body == point.body


def test_model_data_survives(written):
    before, after = made.four_bar(), read_stage(written.root)
    assert (after.name, after.base, after.tool) == (before.name, before.base, before.tool)
    assert after.postures == before.postures
    assert after.parameters == before.parameters
    assert after.source == str(written.root)


def test_loops_close_in_the_frames_read_back(written):
    """What single precision costs: no gap above a tenth of a micrometre at the exact poses."""
    after = read_stage(written.root)
    poses, _ = made.four_bar_state(1.0)
    assert max(made.gaps(after, poses).values()) < 1e-7


def test_a_moved_base(tmp_path):
    poses, q = made.four_bar_state(made.CRANK_AT_REST)
    T_world_base = spatial.pose(spatial.exp_so3([0.1, 0.2, 0.9]), [1.0, -2.0, 0.5])
    files = write_stage(made.four_bar(), tmp_path, {k: T_world_base @ T for k, T in poses.items()}, q)
    after = read_stage(files.root)
    assert after.base == "world"
    for name, T in poses.items():
        assert np.allclose(after.rest[name], T_world_base @ T, rtol=0, atol=5e-7)
    mount = after.joint("root_joint")
    assert (mount.type, mount.parent, mount.child) == ("fixed", "world", "base")
    assert check_stage(files.root) == []


def test_a_body_without_inertia_or_mesh(tmp_path):
    before = made.four_bar()
    bodies = (*before.bodies[:3], replace(before.bodies[3], meshes=(), inertia=None))
    files = write_four_bar(tmp_path, replace(before, bodies=bodies))
    after, notes = inspect_stage(files.root)
    assert after.body("rocker").inertia is None
    assert after.body("rocker").meshes == ()
    assert [(n.code, n.where) for n in notes] == [("stage.read.inertia", "/bars/rocker")]


def test_a_mesh_named_like_its_body(tmp_path):
    before = made.four_bar()
    crank = before.bodies[1]
    named = replace(crank, meshes=(replace(crank.meshes[0], name="crank"),))
    files = write_four_bar(tmp_path, replace(before, bodies=(before.bodies[0], named, *before.bodies[2:])))
    assert read_stage(files.root).body("crank").meshes[0].name == "crank"
    assert check_stage(files.root) == []


# --- layers ---------------------------------------------------------------------------------------


def test_layers_are_the_ones_promised(written):
    folder = written.root.parent
    assert {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()} == {
        "bars.usda",
        "physics.usda",
        "geometry.usdc",
        "motion/swing.usdc",
        "bars_swing.usda",
    }
    physics = written.physics.read_text()
    assert "xformOp" not in physics
    assert "points" not in physics
    assert "someone" not in physics
    for layer in (written.root, written.physics, written.geometry, written.motion.layer, written.motion.root):
        stage = Usd.Stage.Open(str(layer))
        assert stage.GetDefaultPrim().GetName() == "bars"
        assert UsdGeom.GetStageUpAxis(stage) == "Z"
        assert UsdGeom.GetStageMetersPerUnit(stage) == 1
        assert UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage)
        assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 60


def test_writing_twice_gives_the_same_bytes(written, tmp_path):
    write_four_bar(tmp_path, motion=swing())
    write_four_bar(tmp_path, motion=swing())
    for file in (p for p in written.root.parent.rglob("*") if p.is_file()):
        assert (tmp_path / file.relative_to(written.root.parent)).read_bytes() == file.read_bytes(), file


def test_moving_the_folder_changes_nothing(written, tmp_path):
    shutil.copytree(written.root.parent, tmp_path / "elsewhere")
    assert read_stage(tmp_path / "elsewhere" / "bars.usda").joints[0].name == "crank_joint"


def test_physics_says_what_simulators_need(written):
    stage = Usd.Stage.Open(str(written.root))
    root = stage.GetPrimAtPath("/bars")
    assert root.HasAPI(UsdPhysics.ArticulationRootAPI)
    assert root.GetAttribute("physxArticulation:enabledSelfCollisions").Get() is False
    closing = UsdPhysics.Joint(stage.GetPrimAtPath("/bars/joints/closing"))
    assert closing.GetExcludeFromArticulationAttr().Get() is True
    crank = stage.GetPrimAtPath("/bars/joints/crank_joint")
    assert crank.GetAttribute("state:angular:physics:position").Get() == pytest.approx(70)
    assert UsdPhysics.DriveAPI(crank, "angular").GetTargetPositionAttr().Get() == pytest.approx(70)
    assert UsdPhysics.DriveAPI(crank, "angular").GetStiffnessAttr().Get() == pytest.approx(200 * DEG)
    assert UsdPhysics.RevoluteJoint(crank).GetUpperLimitAttr().Get() == pytest.approx(175)
    assert crank.GetAttribute("physxJoint:maxJointVelocity").Get() == pytest.approx(90)


def test_meshes_are_ready_to_show(written):
    stage = Usd.Stage.Open(str(written.root))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/crank/crank_visual"))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    normals = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    assert normals.GetInterpolation() == "faceVarying"
    assert len(normals.ComputeFlattened()) == 36
    assert len(normals.Get()) == 6  # one a face of the box
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    assert material.GetPath().HasPrefix("/bars/materials")
    frame = UsdGeom.Imageable(stage.GetPrimAtPath("/bars/coupler/tool"))
    assert frame.GetPurposeAttr().Get() == "guide"


def test_equal_colours_share_a_material(slider_files):
    stage = Usd.Stage.Open(str(slider_files.root))
    assert len(stage.GetPrimAtPath("/slider/materials").GetChildren()) == 1


@pytest.mark.parametrize("which", ["written", "slider_files", "motion"])
def test_public_validators_are_silent(which, written, slider_files):
    path = {"written": written.root, "slider_files": slider_files.root, "motion": written.motion.root}[which]
    assert run_usd_validators(path) == []
    assert check_stage(path) == []


def parse_with_usdphysics(path: Path) -> dict[str, list[str]]:
    """Return the prim paths that the physics parser of OpenUSD finds, by kind of object."""
    stage = Usd.Stage.Open(str(path))
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/"])
    return {str(kind).rpartition(".")[2]: [str(p) for p in paths] for kind, (paths, _) in found.items()}


def test_the_parser_of_openusd_counts_the_same(written, slider_files):
    found = parse_with_usdphysics(written.root)
    assert found["RigidBody"] == [f"/bars/{b}" for b in ("base", "crank", "coupler", "rocker")]
    assert len(found["RevoluteJoint"]) == 4
    assert found["FixedJoint"] == ["/bars/joints/root_joint"]
    assert found["Articulation"] == ["/bars"]
    assert parse_with_usdphysics(slider_files.root)["D6Joint"] == ["/slider/joints/sleeve"]


def test_openusd_takes_the_base_for_fixed_wherever_the_robot_is_referenced(written, tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    robot = UsdGeom.Xform.Define(stage, "/scene/robot")
    robot.AddTranslateOp().Set((1, 2, 3))
    robot.GetPrim().GetReferences().AddReference(str(written.root))
    stage.GetRootLayer().Save()
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/"])
    (joint,) = found[UsdPhysics.ObjectType.FixedJoint][1]
    assert joint.body0.isEmpty
    assert joint.localPose0Position == Gf.Vec3f(1, 2, 3)
    after = read_stage(tmp_path / "scene.usda", root="/scene/robot")
    assert after.base == "world"
    assert np.allclose(after.rest["base"], spatial.pose(p=[1, 2, 3]), rtol=0, atol=1e-12)
    assert after.postures == made.four_bar().postures


# --- what the writer refuses ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (
            {"type": "cylindrical", "limits": (0.0, 1.0), "active": False, "drive": None},
            "cylindrical .* limits",
        ),
        ({"cone": 0.3}, "a cone"),
    ],
)
def test_what_usd_cannot_hold_is_refused(change, match, tmp_path):
    before = made.four_bar()
    bare = {"soft_limits": None, "max_speed": None, "max_acceleration": None, "max_jerk": None}
    joint = replace(before.joints[0], **{**bare, **change})
    changed = replace(before, joints=(joint, *before.joints[1:]), postures={})
    with pytest.raises(StageError, match=match):
        write_four_bar(tmp_path, changed)


def test_missing_and_unknown_input_is_refused(tmp_path):
    mechanism = made.four_bar()
    poses, q = made.four_bar_state(1.0)
    with pytest.raises(StageError, match="lacks body 'rocker'"):
        write_stage(mechanism, tmp_path, {k: v for k, v in poses.items() if k != "rocker"}, q)
    with pytest.raises(StageError, match="'crank' is not rigid"):
        write_stage(mechanism, tmp_path, {**poses, "crank": 2 * np.eye(4)}, q)
    with pytest.raises(StageError, match="lacks joint 'elbow'"):
        write_stage(mechanism, tmp_path, poses, {"crank_joint": 1.0})
    with pytest.raises(StageError, match="Did you mean 'elbow'"):
        write_stage(mechanism, tmp_path, poses, {**q, "elbo": 1.0})
    renamed = replace(mechanism.bodies[0], name="joints")
    joints = tuple(replace(j, parent="joints") if j.parent == "base" else j for j in mechanism.joints)
    clash = replace(
        mechanism, base="joints", bodies=(renamed, *mechanism.bodies[1:]), joints=joints, points=(), rest={}
    )
    with pytest.raises(StageError, match="cannot have the name 'joints'"):
        write_stage(clash, tmp_path, {**poses, "joints": np.eye(4)}, q)


# --- motion ---------------------------------------------------------------------------------------


def test_motion_survives_at_its_own_time_codes(written):
    motion = swing()
    times, poses = read_motion(written.motion.root)
    assert np.allclose(times, motion.times_s, rtol=0, atol=1e-15)
    assert set(poses) == set(motion.link_poses)
    for body, Ts in motion.link_poses.items():
        assert np.array_equal(poses[body][:, :3, 3], Ts[:, :3, 3])
        assert np.max(spatial.rotation_angle(np.swapaxes(poses[body][:, :3, :3], 1, 2) @ Ts[:, :3, :3])) < 3e-7


def test_motion_plays_over_the_robot(written):
    stage = Usd.Stage.Open(str(written.motion.root))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 30)
    state = stage.GetAttributeAtPath("/bars/joints/crank_joint.state:angular:physics:position")
    assert state.Get(30) == pytest.approx(swing().joint_values["crank_joint"][-1] / DEG)
    assert read_stage(written.motion.root).rest.keys() == made.four_bar().rest.keys()


def test_signs_are_continuous_through_a_full_turn(tmp_path):
    times = np.arange(241) / 60
    turning = [made.four_bar_state(made.CRANK_AT_REST + 3.2 * np.pi * t / 4) for t in times]
    poses = {b: np.stack([s[0][b] for s in turning]) for b in turning[0][0]}
    free = tuple(replace(j, limits=None, soft_limits=None) for j in made.four_bar().joints)
    files = write_four_bar(tmp_path, replace(made.four_bar(), joints=free), motion=BakedMotion("turn", times, poses))
    assert "stage.quaternion_sign" not in {f.code for f in check_stage(files.motion.root)}
    _, read_back = read_motion(files.motion.root)
    assert np.allclose(read_back["crank"], poses["crank"], atol=3e-7)


def test_continuous_signs():
    q = np.array([[1, 0, 0, 0], [-0.9, -0.1, 0, 0], [-0.8, -0.2, 0, 0], [0.7, 0.3, 0, 0]])
    fixed = continuous_signs(q)
    assert np.all(np.sum(fixed[1:] * fixed[:-1], axis=1) > 0)
    assert np.array_equal(np.abs(fixed), np.abs(q))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"times_s": np.zeros(31)}, "must increase"),
        ({"times_s": np.arange(31) - 1.0}, "the first must not be negative"),
        ({"link_poses": {"krank": np.zeros((31, 4, 4))}}, "Did you mean 'crank'"),
        ({"link_poses": {"crank": np.zeros((3, 4, 4))}}, r"expected \(k, 4, 4\)"),
        (
            {
                "times_s": np.arange(2.0),
                "joint_values": {},
                "link_poses": {"crank": spatial.pose(spatial.rotation_z([0.0, 1.7]))},
            },
            r"rotates by 97\.4 deg .* Sample the motion more often",
        ),
        ({"joint_values": {"elbow": np.zeros(3)}}, "one coordinate for each sample"),
        ({"times_s": np.append(np.arange(30.0), np.inf)}, "times are not finite at sample 30 of 31"),
        ({"link_poses": {"crank": np.full((31, 4, 4), np.nan)}}, "poses of body 'crank' are not finite at sample 0 of"),
        ({"joint_values": {"elbow": np.append(np.zeros(30), np.nan)}}, "values of joint 'elbow' are not finite at"),
    ],
)
def test_a_bad_motion_is_refused(change, match, tmp_path):
    with pytest.raises(StageError, match=match):
        write_motion(made.four_bar(), tmp_path, replace(swing(), **change))


def test_a_stage_without_motion_says_so(written):
    with pytest.raises(StageError, match="time samples"):
        read_motion(written.root)


# --- stages that nobody here wrote ----------------------------------------------------------------


class Foreign:
    """A hand-made stage in the habits of other tools."""

    def __init__(self, path: Path, up="Z", meters=1.0, root="/World"):
        self.path, self.root = path, root
        self.stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(self.stage, up)
        UsdGeom.SetStageMetersPerUnit(self.stage, meters)
        self.stage.SetDefaultPrim(UsdGeom.Xform.Define(self.stage, root).GetPrim())

    def body(self, path, p=(0, 0, 0), euler=(0, 0, 0), scale=None):
        xform = UsdGeom.Xform.Define(self.stage, f"{self.root}/{path}")
        xform.AddTranslateOp().Set(Gf.Vec3d(*map(float, p)))
        xform.AddRotateXYZOp().Set(Gf.Vec3f(*map(float, euler)))
        if scale:
            xform.AddScaleOp().Set(Gf.Vec3f(*scale))
        UsdPhysics.RigidBodyAPI.Apply(xform.GetPrim())
        return xform

    def joint(self, schema, name, body0, body1, p0=(0, 0, 0), p1=(0, 0, 0), axis=None, turn=None):
        joint = schema.Define(self.stage, f"{self.root}/{name}")
        if body0:
            joint.CreateBody0Rel().SetTargets([f"{self.root}/{body0}"])
        if body1:
            joint.CreateBody1Rel().SetTargets([f"{self.root}/{body1}"])
        joint.CreateLocalPos0Attr(Gf.Vec3f(*map(float, p0)))
        joint.CreateLocalPos1Attr(Gf.Vec3f(*map(float, p1)))
        if turn is not None:
            joint.CreateLocalRot0Attr(turn)
        if axis:
            joint.CreateAxisAttr(axis)
        return joint

    def save(self) -> Path:
        self.stage.GetRootLayer().Save()
        return self.path


R, P, F = UsdPhysics.RevoluteJoint, UsdPhysics.PrismaticJoint, UsdPhysics.FixedJoint


@pytest.mark.parametrize(("axis", "euler"), [("X", (40, 0, 0)), ("Y", (0, 40, 0)), ("Z", (0, 0, 40))])
def test_any_axis_is_turned_to_z(axis, euler, tmp_path):
    foreign = Foreign(tmp_path / "a.usda")
    foreign.body("Base Link".replace(" ", ""), (1, 2, 3))
    foreign.body("Arm", (1.5, 2, 3), euler)
    foreign.joint(F, "fix", None, "BaseLink", (1, 2, 3))
    hinge = foreign.joint(R, "Hinge", "BaseLink", "Arm", (0.5, 0, 0), axis=axis)
    hinge.CreateLowerLimitAttr(-90.0)
    hinge.CreateUpperLimitAttr(45.0)
    after, notes = inspect_stage(foreign.save())
    mount, joint = after.joints
    assert (after.base, mount.type, mount.parent, mount.child, mount.name) == (
        "world",
        "fixed",
        "world",
        "base_link",
        "fix",
    )
    assert np.allclose(after.rest["base_link"], spatial.pose(p=[1, 2, 3]), rtol=0, atol=1e-12)
    assert (joint.parent, joint.child, joint.name) == ("base_link", "arm", "hinge")
    A = joint.relative(after.rest["base_link"], after.rest["arm"])
    assert np.allclose(A, spatial.pose(spatial.rotation_z(40 * DEG)), atol=1e-6)
    assert np.allclose(joint.T_parent_joint[:3, 2], np.eye(3)["XYZ".index(axis)])
    assert joint.limits == pytest.approx((-90 * DEG, 45 * DEG))
    assert {n.code for n in notes} == {"stage.read.renamed", "stage.read.inertia"}


def test_millimetres_and_y_up_become_metres_and_z_up(tmp_path):
    foreign = Foreign(tmp_path / "mm.usda", up="Y", meters=0.001)
    arm = foreign.body("arm", (0, 500, 0))
    foreign.joint(P, "lift", None, "arm", (0, 200, 0), axis="Y").CreateUpperLimitAttr(400.0)
    mass = UsdPhysics.MassAPI.Apply(arm.GetPrim())
    mass.CreateMassAttr(2.0)
    mass.CreateCenterOfMassAttr(Gf.Vec3f(0, 10, 0))
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(1e4, 2e4, 3e4 - 1))
    drive = UsdPhysics.DriveAPI.Apply(foreign.stage.GetPrimAtPath("/World/lift"), "linear")
    drive.CreateStiffnessAttr(1000.0)
    drive.CreateMaxForceAttr(1000.0)
    after = read_stage(foreign.save())
    (joint,) = after.joints
    assert after.base == "world"
    assert np.allclose(after.rest["arm"][:3, 3], [0, 0, 0.5])
    assert np.allclose(joint.T_parent_joint[:3, 3], [0, 0, 0.2])
    assert np.allclose(joint.T_parent_joint[:3, 2], [0, 0, 1])
    assert np.allclose(joint.relative(np.eye(4), after.rest["arm"])[:3, 3], [0, 0, 0.3])
    assert joint.limits[1] == pytest.approx(0.4)
    assert joint.active
    assert joint.drive.stiffness == pytest.approx(1000.0)
    assert joint.drive.max_effort == pytest.approx(1.0)
    inertia = after.body("arm").inertia
    assert np.allclose(inertia.p_body_com, [0, 0.01, 0])
    assert np.allclose(np.diag(inertia.I_com), [0.01, 0.02, 0.03], atol=1e-5)


def test_joints_below_a_root_that_hold_bodies_beside_it_are_no_robot(tmp_path):
    foreign = Foreign(tmp_path / "beside.usda")
    UsdGeom.Xform.Define(foreign.stage, "/World/robot")
    for path in ("base", "arm", "robot/prop"):
        foreign.body(path)
    foreign.joint(R, "robot/hinge", "base", "arm", axis="Z")
    with pytest.raises(StageError, match=r"below /World/robot: no joint holds a rigid body"):
        read_stage(foreign.save(), root="/World/robot")


def test_the_base_may_stand_in_body1_or_nowhere(tmp_path):
    swapped = Foreign(tmp_path / "swapped.usda")
    swapped.body("a")
    swapped.body("b")
    swapped.joint(F, "fix", "a", None)
    swapped.joint(R, "hinge", "b", "a", axis="Z")
    assert read_stage(swapped.save()).base == "a"

    floating = Foreign(tmp_path / "floating.usda")
    floating.body("b")
    floating.body("a")
    floating.joint(R, "hinge", "a", "b", axis="Z")
    after = read_stage(floating.save())
    assert after.base == "world"
    assert [(j.name, j.type, j.parent, j.child) for j in after.joints] == [
        ("a_free", "free", "world", "a"),
        ("hinge", "revolute", "a", "b"),
    ]

    unclear = Foreign(tmp_path / "unclear.usda")
    for name in "abc":
        unclear.body(name)
    unclear.joint(R, "one", "a", "c", axis="Z")
    unclear.joint(R, "two", "b", "c", axis="Z")
    assert read_stage(unclear.save()).joint("a_free").child == "a"  # each body can be the base of a floating robot
    UsdPhysics.ArticulationRootAPI.Apply(unclear.stage.GetPrimAtPath("/World/b"))
    assert read_stage(unclear.save()).joint("b_free").child == "b"


def test_loop_joints_come_last_whatever_their_order(tmp_path):
    foreign = Foreign(tmp_path / "loop.usda")
    for name in ("base", "a", "b"):
        foreign.body(name)
    foreign.joint(F, "fix", None, "base")
    foreign.joint(R, "j0", "base", "a", axis="Z").CreateExcludeFromArticulationAttr(True)
    foreign.joint(R, "j1", "base", "b", axis="Z")
    foreign.joint(R, "j2", "b", "a", axis="Z")
    after = read_stage(foreign.save())
    assert [j.name for j in after.loops] == ["j0"]
    assert [j.name for j in after.joints] == ["j1", "j2", "j0"]


def test_nested_transforms_and_joints_to_a_child_prim(tmp_path):
    foreign = Foreign(tmp_path / "nested.usda")
    UsdGeom.Xform.Define(foreign.stage, "/World/group").AddTranslateOp().Set((0, 0, 1))
    foreign.body("group/base", (1, 0, 0))
    foreign.body("group/arm", (2, 0, 0))
    UsdGeom.Xform.Define(foreign.stage, "/World/group/base/port").AddTranslateOp().Set((1, 0, 0))
    foreign.joint(F, "fix", None, "group/base", (1, 0, 1))
    foreign.joint(R, "hinge", "group/base/port", "group/arm", axis="Z")
    after = read_stage(foreign.save())
    _, joint = after.joints
    assert np.allclose(joint.T_parent_joint[:3, 3], [1, 0, 0])
    assert np.allclose(after.rest["base"][:3, 3], [1, 0, 1])
    assert np.allclose(after.rest["arm"][:3, 3], [2, 0, 1])


def test_polygons_left_hands_and_equal_names(tmp_path):
    foreign = Foreign(tmp_path / "mesh.usda", meters=0.01)
    foreign.body("A/link")
    foreign.body("B/link", (10, 0, 0))
    foreign.joint(F, "fix", None, "A/link")
    foreign.joint(R, "hinge", "A/link", "B/link", (10, 0, 0), axis="Z")
    for side, place in (("rightHanded", "A"), ("leftHanded", "B")):
        UsdGeom.Xform.Define(foreign.stage, f"/World/{place}/link/holder").AddScaleOp().Set((2, 2, 2))
        mesh = UsdGeom.Mesh.Define(foreign.stage, f"/World/{place}/link/holder/Shape-1".replace("-", "_"))
        mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)])
        mesh.CreateFaceVertexCountsAttr([4, 3])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 0, 1, 4])
        mesh.CreateOrientationAttr(side)
        mesh.CreateDisplayColorAttr([(0.1, 0.2, 0.3)])
    UsdGeom.Cube.Define(foreign.stage, "/World/A/link/cube")
    after, notes = inspect_stage(foreign.save())
    assert [b.name for b in after.bodies] == ["link", "link_2"]
    right, left = (b.meshes[0] for b in after.bodies)
    assert right.name == "shape_1"
    assert left.name == "shape_1_2"
    assert right.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 4]]
    assert left.triangles.tolist() == [[2, 1, 0], [3, 2, 0], [4, 1, 0]]
    assert np.allclose(right.vertices[2], [0.02, 0.02, 0])
    assert right.color_rgba == pytest.approx((0.1, 0.2, 0.3, 1.0))
    assert [n.where for n in notes if n.code == "stage.read.shape"] == ["/World/A/link/cube"]


@pytest.mark.parametrize(
    ("free", "kind"),
    [
        ((), "fixed"),
        (("rotX",), "revolute"),
        (("transY",), "prismatic"),
        (("transX", "rotX"), "cylindrical"),
        (("rotX", "rotY", "rotZ"), "spherical"),
        (("transX", "transY", "transZ", "rotX", "rotY", "rotZ"), "free"),
        (("transX", "transY"), None),
    ],
)
def test_generic_joints_are_known_by_their_locked_axes(free, kind, tmp_path):
    foreign = Foreign(tmp_path / "d6.usda")
    foreign.body("a")
    foreign.body("b")
    foreign.joint(F, "fix", None, "a")
    prim = foreign.joint(UsdPhysics.Joint, "six", "a", "b").GetPrim()
    for direction in ("transX", "transY", "transZ", "rotX", "rotY", "rotZ"):
        limit = UsdPhysics.LimitAPI.Apply(prim, direction) if direction not in free or kind == "revolute" else None
        if limit:
            limit.CreateLowAttr(-30.0 if direction in free else 1.0)
            limit.CreateHighAttr(60.0 if direction in free else -1.0)
    path = foreign.save()
    if kind is None:
        with pytest.raises(StageError, match="/World/six: a joint that is free in transX, transY"):
            read_stage(path)
        return
    (joint,) = read_stage(path).joints
    assert joint.type == kind
    if kind == "revolute":
        assert joint.limits == pytest.approx((-30 * DEG, 60 * DEG))
    if kind in ("revolute", "cylindrical"):
        assert np.allclose(joint.T_parent_joint[:3, 2], [1, 0, 0])
    if kind == "prismatic":
        assert np.allclose(joint.T_child_joint[:3, 2], [0, 1, 0])


def test_disabled_joints_props_and_odd_drives_are_noted(tmp_path):
    foreign = Foreign(tmp_path / "odd.usda")
    for name in ("base", "arm", "hand", "table"):
        foreign.body(name)
    foreign.joint(F, "fix", None, "base")
    foreign.joint(F, "table_fix", None, "table")
    first = foreign.joint(R, "one", "base", "arm", axis="Z").GetPrim()
    second = foreign.joint(R, "two", "arm", "hand", axis="Z").GetPrim()
    foreign.joint(R, "off", "base", "hand", axis="Z").CreateJointEnabledAttr(False)
    drive = UsdPhysics.DriveAPI.Apply(first, "angular")
    drive.CreateTypeAttr("acceleration")
    drive.CreateStiffnessAttr(5.0)
    UsdPhysics.DriveAPI.Apply(second, "angular").CreateStiffnessAttr(0.0)
    after, notes = inspect_stage(foreign.save())
    assert [(j.name, j.active, j.drive) for j in after.joints] == [("one", True, None), ("two", False, None)]
    told = {(n.code, n.where) for n in notes if n.code != "stage.read.inertia"}
    assert told == {
        ("stage.read.disabled", "/World/off"),
        ("stage.read.prop", "/World/table"),
        ("stage.read.drive", "/World/one"),
    }


def test_a_speed_or_a_centre_of_mass_that_cannot_be_is_told(tmp_path):
    foreign = Foreign(tmp_path / "odd.usda")
    foreign.body("base")
    foreign.body("arm")
    foreign.joint(F, "fix", None, "base")
    joint = foreign.joint(R, "one", "base", "arm", axis="Z").GetPrim()
    joint.CreateAttribute("physxJoint:maxJointVelocity", Sdf.ValueTypeNames.Float).Set(-5.0)
    after, notes = inspect_stage(foreign.save())
    assert after.joint("one").max_speed is None
    assert [n.where for n in notes if n.code == "stage.read.speed"] == ["/World/one"]
    mass = UsdPhysics.MassAPI.Apply(foreign.stage.GetPrimAtPath("/World/arm"))
    mass.CreateMassAttr(1.0)
    mass.CreateDiagonalInertiaAttr((1.0, 1.0, 1.0))
    mass.CreateCenterOfMassAttr((1.0, float("nan"), 0.0))
    with pytest.raises(StageError, match="/World/arm: a number of its centre of mass is not finite"):
        read_stage(foreign.save())


@pytest.mark.parametrize(
    ("gains", "driven"),
    [((0.0, 3.0), True), ((float("nan"), 1.0), True), ((2.0, -1.0), True), ((0.0, 0.0), False), ((-1.0, 0.0), False)],
)
def test_a_drive_that_controls_no_position_has_no_gains(gains, driven, tmp_path):
    """A robot folder cannot state such gains; wheels have drives without stiffness."""
    foreign = Foreign(tmp_path / "wheel.usda")
    foreign.body("base")
    foreign.body("wheel")
    foreign.joint(F, "fix", None, "base")
    joint = foreign.joint(R, "turn", "base", "wheel", axis="Z").GetPrim()
    drive = UsdPhysics.DriveAPI.Apply(joint, "angular")
    drive.CreateStiffnessAttr(gains[0])
    drive.CreateDampingAttr(gains[1])
    after, notes = inspect_stage(foreign.save())
    assert (after.joint("turn").active, after.joint("turn").drive) == (driven, None)
    assert [n.where for n in notes if n.code == "stage.read.drive"] == ["/World/turn"] * any(gains)


def test_a_direction_that_is_locked_beside_zero_is_refused(tmp_path):
    foreign = Foreign(tmp_path / "d6.usda")
    foreign.body("a")
    foreign.body("b")
    foreign.joint(F, "fix", None, "a")
    prim = foreign.joint(UsdPhysics.Joint, "six", "a", "b").GetPrim()
    for direction in ("transX", "transY", "transZ", "rotY", "rotZ"):
        limit = UsdPhysics.LimitAPI.Apply(prim, direction)
        limit.CreateLowAttr(0.0 if direction != "transX" else 0.2)
        limit.CreateHighAttr(0.0 if direction != "transX" else 0.2)
    with pytest.raises(StageError, match=r"/World/six: transX is locked at 0\.2"):
        read_stage(foreign.save())


def with_cone(path: Path, first_deg: float, second_deg: float) -> Path:
    """Return the stage of two bodies and a ball joint with a cone of two half angles."""
    foreign = Foreign(path)
    foreign.body("a")
    foreign.body("b")
    ball = foreign.joint(UsdPhysics.SphericalJoint, "ball", "a", "b", axis="X")
    ball.CreateConeAngle0LimitAttr(first_deg)
    ball.CreateConeAngle1LimitAttr(second_deg)
    return foreign.save()


def test_a_cone_takes_its_narrow_side(tmp_path):
    joint = read_stage(with_cone(tmp_path / "cone.usda", 20.0, 50.0)).joint("ball")
    assert joint.cone == pytest.approx(20 * DEG)
    assert np.allclose(joint.T_parent_joint[:3, 2], [1, 0, 0])


def test_a_cone_of_no_angle_is_refused(tmp_path):
    """It lets a ball only turn about its axis; the limits of the joint would be divided by the sine of 0."""
    path = with_cone(tmp_path / "cone.usda", 0.0, 50.0)
    with pytest.raises(StageError, match="ball: its cone has the half angle 0"):
        read_stage(path)


# --- what the reader refuses ----------------------------------------------------------------------


def two_bodies(path: Path) -> Foreign:
    foreign = Foreign(path)
    foreign.body("a")
    foreign.body("b", scale=None)
    foreign.joint(F, "fix", None, "a")
    return foreign


def _scaled(f):
    f.body("c", scale=(1, 1, -2))
    f.joint(R, "hinge", "a", "c", axis="Z")


def _distance(f):
    f.joint(UsdPhysics.DistanceJoint, "rope", "a", "b")


def _unknown_type(f):
    f.stage.DefinePrim("/World/gear", "PhysxPhysicsGearJoint")


def _dangling(f):
    f.joint(R, "hinge", "a", "nowhere", axis="Z")


def _same(f):
    f.joint(R, "hinge", "a", "a", axis="Z")


def _zero_quaternion(f):
    f.joint(R, "hinge", "a", "b", axis="Z", turn=Gf.Quatf(0, 0, 0, 0))


def _swapped_limits(f):
    joint = f.joint(R, "hinge", "a", "b", axis="Z")
    joint.CreateLowerLimitAttr(10.0)
    joint.CreateUpperLimitAttr(-10.0)


def _two_fixed(f):
    f.joint(F, "fix2", None, "b")
    f.joint(R, "hinge", "a", "b", axis="Z")


def _two_robots(f):
    for name in "cd":
        f.body(name)
    f.joint(R, "hinge", "a", "b", axis="Z")
    f.joint(R, "hinge2", "c", "d", axis="Z")


def _bad_index(f):
    f.joint(R, "hinge", "a", "b", axis="Z")
    mesh = UsdGeom.Mesh.Define(f.stage, "/World/a/mesh")
    mesh.CreatePointsAttr([(0, 0, 0)] * 3)
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 7])


def _negative_index(f):
    _bad_index(f)
    UsdGeom.Mesh(f.stage.GetPrimAtPath("/World/a/mesh")).GetFaceVertexIndicesAttr().Set([0, 1, -1])


@pytest.mark.parametrize(
    ("spoil", "match"),
    [
        (_scaled, r"/World/c is scaled by \(1, 1, 2\), mirrored"),
        (_distance, "/World/rope: joints of type PhysicsDistanceJoint"),
        (_unknown_type, "/World/gear: joints of type PhysxPhysicsGearJoint"),
        (_dangling, "/World/hinge: physics:body1 points to /World/nowhere"),
        (_same, "/World/hinge: both sides of the joint are on /World/a"),
        (_zero_quaternion, "/World/hinge: physics:localRot0: quaternion"),
        (_swapped_limits, "limits .* are not ordered"),
        (_two_fixed, r"fixed to the world \(/World/a, /World/b\)"),
        (_two_robots, "2 robots, with the first bodies /World/a, /World/c"),
        (_bad_index, "/World/a/mesh: an index refers to vertex 7, but the mesh has 3"),
        (_negative_index, "/World/a/mesh: an index refers to vertex -1, but the mesh has 3"),
    ],
    ids=lambda v: v.__name__.strip("_") if callable(v) else "",
)
def test_the_reader_names_what_it_refuses(spoil, match, tmp_path):
    foreign = two_bodies(tmp_path / "bad.usda")
    spoil(foreign)
    with pytest.raises(StageError, match=match):
        read_stage(foreign.save())


def test_files_that_hold_no_mechanism(tmp_path):
    with pytest.raises(StageError, match="there is no file"):
        read_stage(tmp_path / "nothing.usda")
    (tmp_path / "garbage.usda").write_text("hello")
    with pytest.raises(StageError, match=r"not a readable USD file: (?!.*pxr)"):
        read_stage(tmp_path / "garbage.usda")
    (tmp_path / "robot.txt").write_text("hello")
    with pytest.raises(StageError, match="not a readable USD file"):
        read_stage(tmp_path / "robot.txt")
    empty = Foreign(tmp_path / "empty.usda")
    with pytest.raises(StageError, match="no rigid bodies"):
        read_stage(empty.save())
    empty.body("a")
    with pytest.raises(StageError, match="no joints"):
        read_stage(empty.save())


def test_a_missing_layer_is_refused(written, tmp_path):
    shutil.copy(written.root, tmp_path / "bars.usda")
    with pytest.raises(StageError, match=r"physics\.usda"):
        read_stage(tmp_path / "bars.usda")


# --- small parts ----------------------------------------------------------------------------------


def test_principal_axes_stay_near_identity():
    rng = np.random.default_rng(3)
    for _ in range(50):
        R_near = spatial.exp_so3(0.1 * rng.standard_normal(3))
        moments = rng.uniform(1, 1.5, 3)
        tensor = R_near @ np.diag(moments) @ R_near.T
        found, axes = Inertia(1.0, np.zeros(3), tensor).principal()
        assert np.linalg.det(axes) == pytest.approx(1)
        assert np.allclose(axes @ np.diag(found) @ axes.T, tensor)
    found, axes = Inertia(1.0, np.zeros(3), np.diag([3.0, 1.0, 2.0])).principal()
    assert np.array_equal(axes, np.eye(3))
    assert np.array_equal(found, [3, 1, 2])


def test_corner_normals_keep_edges_and_round_bores():
    mesh = made.box("box", [0, 0, 0], [1, 1, 1])
    normals = corner_normals(mesh.vertices, mesh.triangles)
    assert np.allclose(np.sort(np.abs(normals), axis=1), [0, 0, 1])
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([np.column_stack([ring, np.full(36, z)]) for z in (0, 1)])
    i = np.arange(36)
    j = (i + 1) % 36
    triangles = np.vstack([np.column_stack([i, j, j + 36]), np.column_stack([i, j + 36, i + 36])])
    smooth = corner_normals(vertices, triangles)
    # within the angle of one facet: its two triangles weigh unequally at a corner
    assert np.min(np.sum(smooth * vertices[triangles.ravel()] * [1, 1, 0], axis=1)) > np.cos(5 * DEG)


def test_a_degenerate_triangle_has_a_finite_normal():
    assert np.all(np.isfinite(corner_normals(np.zeros((3, 3)), np.array([[0, 1, 2]]))))


def test_impossible_inertia_is_written_as_it_is(tmp_path):
    """The writer does not judge: the checker and the CAD room do."""
    before = made.four_bar()
    odd = replace(before.bodies[1], inertia=Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 9.0]) * 1e-4))
    files = write_four_bar(tmp_path, replace(before, bodies=(before.bodies[0], odd, *before.bodies[2:])))
    assert [f.code for f in check_stage(files.root)] == ["stage.inertia"]


def test_a_free_joint_survives(tmp_path):
    before = made.four_bar()
    loose = Joint("loose", "free", "base", "coupler")
    files = write_four_bar(tmp_path, replace(before, joints=(*before.joints, loose)))
    assert read_stage(files.root).joint("loose").type == "free"
