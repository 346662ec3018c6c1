"""The pose of a robot's first link in the world, and gravity: read from every format, held by the model, written again.

Each mount (upright, on a wall, on a ceiling) is written by hand in all four formats. The arm has one hinge and one
slide, so that the efforts that hold it depend on the mount. MuJoCo computes these efforts from its own reading.
"""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from made.importing_same import made
from twin.cad.build import read_mechanism
from twin.core import spatial
from twin.exchange.audit import audit
from twin.exchange.formats.mjcf.write import write_mjcf
from twin.exchange.formats.urdf.write import urdf_findings, write_urdf
from twin.exchange.formats.usd.write import write_usd
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.reference import ReferenceModel
from twin.reference.dynamics import Dynamics
from twin.reference.holding_efforts import holding_efforts
from twin.usd.read import read_stage

MASS, OFFSET = 2.0, 0.3
"""Mass in kg of the arm, and distance in m of its centre from the hinge, along its x axis."""

RISE = 0.125
"""Height in m of the hinge above the base; single precision holds it exactly."""

MOUNTS = {
    "upright": (0.0, 0.0, 0.0),
    "wall": (0.0, 90.0, 0.0),
    "side wall": (90.0, 0.0, 0.0),
    "ceiling": (180.0, 0.0, 0.0),
    "oblique": (20.0, -35.0, 110.0),
}
"""Roll, pitch and yaw in degrees of the base in the world."""

PLACE = (0.4, -0.2, 1.5)


def mount(name):
    roll, pitch, yaw = np.radians(MOUNTS[name])
    x, y, z = np.eye(3)
    R = spatial.exp_so3(yaw * z) @ spatial.exp_so3(pitch * y) @ spatial.exp_so3(roll * x)
    return spatial.pose(R, PLACE)


def angles(T):
    return spatial.euler_angles(T[:3, :3], "zyx")[::-1]


def text(values):
    return " ".join(f"{v:.17g}" for v in values)


def urdf(T, path):
    inertia = '<inertia ixx=".01" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>'
    link = f'<inertial><origin xyz="{{}} 0 0"/><mass value="{MASS}"/>{inertia}</inertial>'
    joint = f'<origin xyz="0 0 {RISE}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="1"/>'
    path.write_text(
        f'<robot name="m"><link name="world"/><link name="base">{link.format(0)}</link>'
        f'<link name="arm">{link.format(OFFSET)}</link>'
        f'<joint name="stand" type="fixed"><parent link="world"/><child link="base"/>'
        f'<origin xyz="{text(T[:3, 3])}" rpy="{text(angles(T))}"/></joint>'
        f'<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>{joint}</joint></robot>'
    )


def mjcf(T, path, option=""):
    inertial = f'<inertial pos="{{}} 0 0" mass="{MASS}" diaginertia=".01 .02 .02"/>'
    path.write_text(
        f'<mujoco model="m"><compiler angle="radian"/>{option}<worldbody><body name="base" pos="{text(T[:3, 3])}" '
        f'quat="{text(spatial.quat_from_matrix_wxyz(T[:3, :3]))}">{inertial.format(0)}'
        f'<body name="arm" pos="0 0 {RISE}">'
        f'{inertial.format(OFFSET)}<joint name="hinge" axis="0 1 0" range="-2 2"/></body></body></worldbody>'
        '<actuator><motor joint="hinge"/></actuator></mujoco>'
    )


def sdf(T, path):
    inertia = "<inertia><ixx>.01</ixx><iyy>.02</iyy><izz>.02</izz></inertia>"
    path.write_text(
        f'<sdf version="1.9"><model name="m"><static>true</static><pose>{text(T[:3, 3])} {text(angles(T))}</pose>'
        f'<link name="base"><inertial><mass>{MASS}</mass>{inertia}</inertial></link>'
        f'<link name="arm"><pose>0 0 {RISE} 0 0 0</pose><inertial><pose>{OFFSET} 0 0 0 0 0</pose><mass>{MASS}</mass>'
        f'{inertia}</inertial></link><joint name="hinge" type="revolute"><parent>base</parent><child>arm</child><axis>'
        "<xyz>0 1 0</xyz><limit><lower>-2</lower><upper>2</upper></limit></axis></joint></model></sdf>"
    )


def usd(T, path, up="Z", meters=1.0, gravity=None):
    """Write a stage whose base has the pose T (4, 4) in a world with z up, whatever the up axis and unit of the stage.

    `gravity` is (direction, magnitude) of a physics scene in the axes and the unit of the stage.
    """
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/m").GetPrim())
    R_stage_world = np.eye(3) if up == "Z" else np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
    for name, T_base_body, center in (("base", np.eye(4), 0.0), ("arm", spatial.pose(p=[0, 0, RISE]), OFFSET)):
        body = UsdGeom.Xform.Define(stage, f"/m/{name}")
        at = spatial.pose(R_stage_world) @ T @ T_base_body
        body.AddTranslateOp().Set(Gf.Vec3d(*(at[:3, 3] / meters).tolist()))
        w, *xyz = spatial.quat_from_matrix_wxyz(at[:3, :3]).tolist()
        body.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, *xyz))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(body.GetPrim())
        mass.CreateMassAttr(MASS)
        mass.CreateCenterOfMassAttr(Gf.Vec3f(center / meters, 0, 0))
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*(v / meters**2 for v in (0.01, 0.02, 0.02))))
    stand = UsdPhysics.FixedJoint.Define(stage, "/m/stand")
    stand.CreateBody1Rel().SetTargets(["/m/base"])
    at = spatial.pose(R_stage_world) @ T
    stand.CreateLocalPos0Attr(Gf.Vec3f(*(at[:3, 3] / meters).tolist()))
    w, *xyz = spatial.quat_from_matrix_wxyz(at[:3, :3]).tolist()
    stand.CreateLocalRot0Attr(Gf.Quatf(w, *xyz))
    hinge = UsdPhysics.RevoluteJoint.Define(stage, "/m/hinge")
    hinge.CreateBody0Rel().SetTargets(["/m/base"])
    hinge.CreateBody1Rel().SetTargets(["/m/arm"])
    hinge.CreateLocalPos0Attr(Gf.Vec3f(0, 0, RISE / meters))
    hinge.CreateAxisAttr("Y")
    hinge.CreateLowerLimitAttr(-90.0)
    hinge.CreateUpperLimitAttr(90.0)
    if gravity is not None:
        scene = UsdPhysics.Scene.Define(stage, "/scene")
        scene.CreateGravityDirectionAttr(Gf.Vec3f(*gravity[0]))
        scene.CreateGravityMagnitudeAttr(gravity[1])
    stage.GetRootLayer().Save()


WRITERS = {
    "m.urdf": urdf,
    "m.xml": mjcf,
    "m.sdf": sdf,
    "m.usda": usd,
    "y_up.usda": lambda T, path: usd(T, path, up="Y", meters=0.01),
}


def holding(mechanism):
    model = ReferenceModel(mechanism)
    return holding_efforts(model, model.home())["hinge"]


def held_by_mujoco(file):
    """Return the effort in N m that holds the hinge at coordinate 0, from MuJoCo's own reading of a file."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.joint("hinge").qpos[0] = 0.0
    mujoco.mj_forward(model, data)
    return float(data.joint("hinge").qfrc_bias[0])


@pytest.mark.parametrize("name", MOUNTS)
@pytest.mark.parametrize("file", WRITERS)
def test_a_mount_is_read_from_every_format(file, name, tmp_path):
    T = mount(name)
    WRITERS[file](T, tmp_path / file)
    m = close(read(tmp_path / file, guarded=False)).mechanism
    assert m.base == "world"
    np.testing.assert_allclose(m.rest["base"], T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(m.rest["arm"], T @ spatial.pose(p=[0, 0, RISE]), rtol=0, atol=1e-9)
    np.testing.assert_allclose((m.rest["base"] @ m.joint("hinge").T_parent_joint)[:3, 2], T[:3, 1], atol=1e-7)
    # the mass hangs at +x of the arm; a turn about y moves it along -z
    expected = MASS * 9.81 * OFFSET * -T[2, 2]
    assert holding(m) == pytest.approx(expected, abs=2e-6)
    assert Dynamics(m).gravity(np.zeros(1))[0] == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize("name", ["wall", "oblique"])
def test_a_mount_is_written_to_every_format(name, tmp_path):
    T = mount(name)
    usd(T, tmp_path / "m.usda", up="Y")
    imported, folder, stage = made(tmp_path / "m.usda", "m", tmp_path / "m")
    for m in (imported.mechanism, folder, stage):
        np.testing.assert_allclose(m.rest["base"], T, rtol=0, atol=1e-9)
        assert holding(m) == pytest.approx(MASS * 9.81 * OFFSET * -T[2, 2], abs=2e-6)
    written = write_mjcf(folder, tmp_path / "out")
    assert held_by_mujoco(written) == pytest.approx(holding(folder), abs=1e-5)
    T_again = read(written, guarded=False).mechanism.rest["base"]
    np.testing.assert_allclose(T_again, T, rtol=0, atol=1e-9)


Y_DOWN, Z_DOWN, NONE = (0, -1, 0), (0, 0, -1), (0, 0, 0)


@pytest.mark.parametrize(
    ("up", "meters", "scene", "expected"),
    [
        ("Z", 1.0, None, (0, 0, -9.81)),
        ("Y", 1.0, None, (0, 0, -9.81)),
        ("Z", 1.0, (Z_DOWN, 9.81), (0, 0, -9.81)),
        ("Y", 1.0, (Y_DOWN, 9.81), (0, 0, -9.81)),
        ("Y", 0.01, (Y_DOWN, 981.0), (0, 0, -9.81)),
        ("Y", 0.01, (NONE, -np.inf), (0, 0, -9.81)),
        ("Z", 1.0, (NONE, 1.62), (0, 0, -1.62)),
        ("Z", 1.0, (Z_DOWN, 0.0), (0, 0, 0)),
        ("Y", 1.0, (Z_DOWN, 9.81), (0, 9.81, 0)),
        ("Z", 1.0, ((3, 0, -4), 10.0), (6, 0, -8)),
    ],
)
def test_gravity_of_a_stage(up, meters, scene, expected, tmp_path):
    usd(mount("wall"), tmp_path / "m.usda", up, meters, scene)
    imported = read(tmp_path / "m.usda", guarded=False)
    assert imported.mechanism.gravity == pytest.approx(expected, abs=1e-6)
    said = [f for f in imported.findings if f.code == "import.gravity"]
    assert bool(said) == (expected != (0, 0, -9.81))


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("", (0, 0, -9.81)),
        ('<option gravity="0 -9.81 0"/>', (0, -9.81, 0)),
        ('<option gravity="0 0 -1.62"/>', (0, 0, -1.62)),
        ('<option><flag gravity="disable"/></option>', (0, 0, 0)),
    ],
)
def test_gravity_goes_through_every_file(option, expected, tmp_path):
    mjcf(mount("wall"), tmp_path / "m.xml", option)
    imported = close(read(tmp_path / "m.xml", guarded=False))
    assert imported.mechanism.gravity == expected
    assert holding(imported.mechanism) == pytest.approx(held_by_mujoco(tmp_path / "m.xml"), abs=1e-6)
    write_folder(imported, "m", tmp_path / "m", tmp_path / "m.xml")
    m = read_mechanism(tmp_path / "m/cad/m.toml").mechanism
    assert m.gravity == expected
    out = tmp_path / "out"
    stages = write_usd(m, (), out)
    for stage in (stages[0], out / "m_sim.usda"):
        assert read_stage(stage).gravity == pytest.approx(expected, abs=1e-6)
    assert read(write_mjcf(m, out), guarded=False).mechanism.gravity == expected
    assert any("gravity" in f.message for f in urdf_findings(m)) == (expected != (0, 0, -9.81))
    # a robot on a slope is no fault of its files: every format states the same
    for mechanism in (m, None):
        report = audit(out, mechanism=mechanism)
        assert [f.message for f in report.findings if f.severity != "info" and "gravity" in f.code] == []


def test_the_gravity_of_an_sdf_world(tmp_path):
    sdf(mount("wall"), tmp_path / "m.sdf")
    model = (tmp_path / "m.sdf").read_text().removeprefix('<sdf version="1.9">').removesuffix("</sdf>")
    world = f'<sdf version="1.9"><world name="w"><gravity>0 0 -3.7</gravity>{model}</world></sdf>'
    (tmp_path / "mars.sdf").write_text(world)
    m = read(tmp_path / "mars.sdf").mechanism
    assert m.gravity == (0, 0, -3.7)
    np.testing.assert_allclose(m.rest["base"], mount("wall"), rtol=0, atol=1e-12)


def test_a_lift_of_a_stage_with_y_up_rises(tmp_path):
    """The base has no transform of its own: only the up axis of the stage turns it."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "lift.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/r").GetPrim())
    for name, height in (("base", 0.0), ("a", 0.5)):
        body = UsdGeom.Xform.Define(stage, f"/r/{name}")
        body.AddTranslateOp().Set(Gf.Vec3d(0, height, 0))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(body.GetPrim())
        mass.CreateMassAttr(MASS)
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(0.02, 0.02, 0.02))
    UsdPhysics.FixedJoint.Define(stage, "/r/fix").CreateBody1Rel().SetTargets(["/r/base"])
    lift = UsdPhysics.PrismaticJoint.Define(stage, "/r/lift")
    lift.CreateBody0Rel().SetTargets(["/r/base"])
    lift.CreateBody1Rel().SetTargets(["/r/a"])
    lift.CreateAxisAttr("Y")
    lift.CreateLocalPos0Attr(Gf.Vec3f(0, 0.5, 0))
    lift.CreateLowerLimitAttr(-0.1)
    lift.CreateUpperLimitAttr(0.2)
    stage.GetRootLayer().Save()
    m = close(read(tmp_path / "lift.usda", guarded=False)).mechanism
    np.testing.assert_allclose(m.rest["a"][:3, 3], [0, 0, 0.5], atol=1e-12)
    model = ReferenceModel(m)
    raised = model.solve(np.array([0.2])).link_poses["a"]
    np.testing.assert_allclose(raised[:3, 3], [0, 0, 0.7], atol=1e-9)
    assert holding_efforts(model, model.home())["lift"] == pytest.approx(MASS * 9.81)


# --- floating bases ---------------------------------------------------------------------------------


def floating_urdf(T, path):
    urdf(T, path)
    path.write_text(path.read_text().replace('name="stand" type="fixed"', 'name="base_free" type="floating"'))


def floating_mjcf(T, path):
    mjcf(T, path)
    path.write_text(path.read_text().replace('<body name="arm"', '<freejoint name="base_free"/><body name="arm"'))


def floating_sdf(T, path):
    sdf(T, path)
    path.write_text(path.read_text().replace("<static>true</static>", ""))


def floating_usd(T, path):
    usd(T, path, up="Y")
    stage = Usd.Stage.Open(str(path))
    stage.RemovePrim("/m/stand")
    stage.GetRootLayer().Save()


FLOATING = {"m.urdf": floating_urdf, "m.xml": floating_mjcf, "m.sdf": floating_sdf, "m.usda": floating_usd}


@pytest.mark.parametrize("file", FLOATING)
def test_a_floating_base_is_read_from_every_format_and_written_to_every_format(file, tmp_path):
    T = mount("oblique")
    FLOATING[file](T, tmp_path / file)
    imported = close(read(tmp_path / file, guarded=False))
    m = imported.mechanism
    free = m.joint("base_free")
    assert (free.type, free.parent, free.child) == ("free", "world", "base")
    assert "import.free" in {f.code for f in imported.findings}
    np.testing.assert_allclose(m.rest["base"], T, rtol=0, atol=1e-9)
    out = tmp_path / "out"
    write_urdf(m, out)
    write_mjcf(m, out)
    write_usd(m, (), out)
    compiled = mujoco.MjModel.from_xml_path(str(out / "m.xml"))
    assert compiled.joint("base_free").type[0] == mujoco.mjtJoint.mjJNT_FREE
    np.testing.assert_allclose(compiled.joint("base_free").qpos0[:3], T[:3, 3], rtol=0, atol=1e-9)
    tree = pin.buildModelFromUrdf(str(out / "m.urdf"))
    assert tree.nv == 7
    stage = Usd.Stage.Open(str(out / "m.usda"))
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/"])
    assert UsdPhysics.ObjectType.FixedJoint not in found
    enabled = [j.primPath.name for j in found[UsdPhysics.ObjectType.RevoluteJoint][1] if j.jointEnabled]
    assert enabled == ["hinge"]
    assert not UsdPhysics.Joint(stage.GetPrimAtPath("/m/joints/base_free")).GetJointEnabledAttr().Get()
    for again in (read(out / "m.urdf"), read(out / "m.xml", guarded=False), read(out / "m.usda", guarded=False)):
        other = again.mechanism
        assert (other.base, other.joint("base_free").type) == ("world", "free")
        np.testing.assert_allclose(other.rest["base"], T, rtol=0, atol=1e-7)
    report = audit(out, mechanism=m)
    assert [f.message for f in report.findings if f.severity != "info"] == []
