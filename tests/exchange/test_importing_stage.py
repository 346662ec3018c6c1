"""Stages of others: scaled ancestors, no tool, joints that are authored open, several robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from twin import api, cli
from twin.core.errors import TwinError
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.ui.session.movable_robot import MovableRobot
from twin.usd.read import inspect_stage

HERE = Path(__file__).parents[1]
MODELS = HERE / "data/importing/models"
from made import importing_same as same


def edited(source, target, change):
    stage = Usd.Stage.Open(str(source))
    change(stage)
    stage.GetRootLayer().Export(str(target))
    return target


def scaled(root, size, bodies_too=False):
    """Return an edit that shrinks every length below a prim by its size, and scales the prim to make up for it."""

    def change(stage):
        top = stage.GetPrimAtPath(root)
        for prim in Usd.PrimRange(top):
            for name in (
                "xformOp:translate",
                "physics:localPos0",
                "physics:localPos1",
                "physics:centerOfMass",
                "points",
            ):
                attribute = prim.GetAttribute(name)
                # a side that holds to the world is in units of the stage
                side = prim.GetRelationship(f"physics:body{name[-1]}") if name[-1] in "01" else None
                if attribute and attribute.HasAuthoredValue() and (side is None or side.GetTargets()):
                    value = attribute.Get()
                    shrunk = [Gf.Vec3f(v) / size for v in value] if name == "points" else value / size
                    attribute.Set(shrunk)
        prims = [p for p in top.GetChildren() if p.HasAPI(UsdPhysics.RigidBodyAPI)] if bodies_too else [top]
        for prim in prims:
            if bodies_too:  # then a place is not scaled by its own prim
                place = prim.GetAttribute("xformOp:translate")
                if place:
                    place.Set(place.Get() * size)
            UsdGeom.Xformable(prim).AddScaleOp().Set(Gf.Vec3f(size))

    return change


@pytest.mark.parametrize("bodies_too", [False, True], ids=["ancestor", "bodies"])
@pytest.mark.parametrize("size", [0.001, 2.5])
@pytest.mark.parametrize("name", ["fourbar", "slider"])
def test_an_even_scale_is_read_in_true_size(name, size, bodies_too, tmp_path):
    source = MODELS / f"{name}.usda"
    path = edited(source, tmp_path / f"{name}.usda", scaled(f"/{name}", size, bodies_too))
    ours, notes = inspect_stage(path)
    same.assert_same(ours, inspect_stage(source)[0], 1e-6)
    for a, b in zip(ours.bodies, inspect_stage(source)[0].bodies, strict=True):
        for mesh, other in zip(a.meshes, b.meshes, strict=True):
            np.testing.assert_allclose(mesh.vertices, other.vertices, atol=1e-6)
    assert "stage.read.scaled" in {f.code for f in notes}


@pytest.mark.parametrize(
    ("scale", "shown"),
    [((1, 2, 1), r"\(1, 2, 1\)"), ((2, 2, -2), r"\(2, 2, 2\), mirrored")],
    ids=["uneven", "mirrored"],
)
@pytest.mark.parametrize("turned", [0, 45])
def test_any_other_scale_is_refused_with_the_prim_that_has_it(scale, shown, turned, tmp_path):
    def change(stage):
        UsdGeom.Xformable(stage.GetPrimAtPath("/fourbar")).AddScaleOp().Set(Gf.Vec3f(*scale))
        for prim in stage.GetPrimAtPath("/fourbar").GetChildren():
            if turned and prim.HasAPI(UsdPhysics.RigidBodyAPI):
                UsdGeom.Xformable(prim).AddRotateZOp().Set(turned)

    path = edited(MODELS / "fourbar.usda", tmp_path / "uneven.usda", change)
    with pytest.raises(TwinError, match=rf"/fourbar/\w+ is scaled by {shown}, because .* its ancestor /fourbar"):
        inspect_stage(path)


def uneven(path, rng):
    """Write a stage with a pendulum whose three bodies have drawn poses and drawn scales along their axes."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.Xform.Define(stage, "/World").AddScaleOp().Set(Gf.Vec3f(2.0))
    for name in "abc":
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}")
        prim.AddTranslateOp().Set(Gf.Vec3d(*rng.uniform(-1, 1, 3)))
        prim.AddRotateXYZOp().Set(Gf.Vec3f(*rng.uniform(-90, 90, 3)))
        prim.AddScaleOp().Set(Gf.Vec3f(*rng.uniform(0.1, 3, 3)))
        UsdPhysics.RigidBodyAPI.Apply(prim.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(prim.GetPrim())
        mass.CreateMassAttr(1.0)
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(100.0))
        mass.CreateCenterOfMassAttr(Gf.Vec3f(*rng.uniform(-1, 1, 3)))
        shape = UsdGeom.Mesh.Define(stage, f"/World/{name}/shape")
        shape.AddRotateXYZOp().Set(Gf.Vec3f(*rng.uniform(-90, 90, 3)))
        shape.CreatePointsAttr([Gf.Vec3f(*p) for p in rng.uniform(-1, 1, (4, 3))])
        shape.CreateFaceVertexCountsAttr([3] * 4)
        shape.CreateFaceVertexIndicesAttr([0, 1, 2, 0, 3, 1, 1, 3, 2, 0, 2, 3])
    UsdPhysics.FixedJoint.Define(stage, "/World/fix").CreateBody1Rel().SetTargets(["/World/a"])
    for parent, child in ("ab", "bc"):
        joint = UsdPhysics.RevoluteJoint.Define(stage, f"/World/{parent}{child}")
        joint.CreateAxisAttr("Z")
        joint.CreateBody0Rel().SetTargets([f"/World/{parent}"])
        joint.CreateBody1Rel().SetTargets([f"/World/{child}"])
        joint.CreateLocalPos0Attr(Gf.Vec3f(*rng.uniform(-1, 1, 3)))
        joint.CreateLocalPos1Attr(Gf.Vec3f(*rng.uniform(-1, 1, 3)))
    stage.Save()
    return stage


def test_a_body_with_an_uneven_scale_is_read_as_openusd_reads_it(tmp_path):
    rng = np.random.default_rng(4)
    for i in range(6):
        stage = uneven(tmp_path / f"{i}.usda", rng)
        m, notes = inspect_stage(tmp_path / f"{i}.usda")
        assert [n.code for n in notes].count("stage.read.scaled") == 3
        told = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/World"])
        places = {d.primPath.name: d for d in told[UsdPhysics.ObjectType.RevoluteJoint][1]}
        for name, place in places.items():
            joint = m.joint(name)
            np.testing.assert_allclose(
                joint.T_parent_joint[:3, 3], 0.01 * np.array(place.localPose0Position), atol=1e-8
            )
            np.testing.assert_allclose(joint.T_child_joint[:3, 3], 0.01 * np.array(place.localPose1Position), atol=1e-8)
        for body in (b for b in m.bodies if b.meshes):
            shape = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{body.name}/shape"))
            T_stage_shape = UsdGeom.XformCache().GetLocalToWorldTransform(shape.GetPrim())
            right = [0.01 * np.array(T_stage_shape.Transform(Gf.Vec3d(p))) for p in shape.GetPointsAttr().Get()]
            T_base_body = m.rest[body.name]
            drawn = body.meshes[0].vertices @ T_base_body[:3, :3].T + T_base_body[:3, 3]
            np.testing.assert_allclose(drawn, right, atol=1e-8)
            prim = stage.GetPrimAtPath(f"/World/{body.name}")
            center = Gf.Vec3d(UsdPhysics.MassAPI(prim).GetCenterOfMassAttr().Get())
            right = 0.01 * np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim).Transform(center))
            T = T_base_body[:3, :3] @ body.inertia.p_body_com + T_base_body[:3, 3]
            np.testing.assert_allclose(T, right, atol=1e-8)
            np.testing.assert_allclose(body.inertia.I_com, 0.01 * np.eye(3), atol=1e-9)


def test_a_sheared_body_is_refused(tmp_path):
    def change(stage):
        prim = UsdGeom.Xformable(stage.GetPrimAtPath("/fourbar/coupler"))
        place = prim.GetOrderedXformOps()
        turn = prim.AddRotateZOp(opSuffix="after")
        turn.Set(30)
        scale = prim.AddScaleOp()
        scale.Set(Gf.Vec3f(1, 2, 1))
        prim.SetXformOpOrder([*place, scale, turn])

    path = edited(MODELS / "fourbar.usda", tmp_path / "sheared.usda", change)
    with pytest.raises(TwinError, match=r"rigid body /fourbar/coupler is scaled by .*Scale the meshes below the body"):
        inspect_stage(path)


def test_a_floating_loop_starts_at_its_first_body(tmp_path):
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    steps = [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]
    stage = Usd.Stage.CreateNew(str(tmp_path / "loop.usda"))
    for i in range(4):
        prim = UsdGeom.Xform.Define(stage, f"/loop/b{i}")
        prim.AddTranslateOp().Set(Gf.Vec3d(corners[i]))
        UsdPhysics.RigidBodyAPI.Apply(prim.GetPrim())
        joint = UsdPhysics.RevoluteJoint.Define(stage, f"/loop/j{i}")
        joint.CreateAxisAttr("Z")
        joint.CreateBody0Rel().SetTargets([f"/loop/b{i}"])
        joint.CreateBody1Rel().SetTargets([f"/loop/b{(i + 1) % 4}"])
        joint.CreateLocalPos0Attr(Gf.Vec3f(steps[i]))
    stage.Save()
    m, notes = inspect_stage(tmp_path / "loop.usda")
    assert [(j.name, j.parent, j.child) for j in m.joints] == [
        ("b0_free", "world", "b0"),
        ("j0", "b0", "b1"),
        ("j1", "b1", "b2"),
        ("j2", "b2", "b3"),
        ("j3", "b3", "b0"),
    ]
    assert [j.name for j in m.loops] == ["j3"]
    told = [n.message for n in notes if n.code == "stage.read.base"]
    assert len(told) == 1
    assert "/loop/b0 becomes the base of the floating robot, which each of 4 bodies could be" in told[0]


def test_a_stage_without_a_tool_is_shown_exported_and_told(tmp_path, capsys):
    source = MODELS / "slider.usda"
    robot = api.load(source)
    tool = robot.mechanism.frame(robot.mechanism.tool)
    assert "the file names no tool" in robot.tool_note
    depth = {robot.mechanism.base: 0}
    for joint in robot.mechanism.tree:
        depth[joint.child] = depth[joint.parent] + 1
    assert depth[tool.body] == max(depth.values())
    movable = MovableRobot(robot)
    assert np.isfinite(movable.model.home().T_base_tool).all()
    assert cli.main(["export", str(source), "--to", "glb", "--out", str(tmp_path / "e"), "--quiet"]) in (0, 1)
    assert cli.main(["audit", str(tmp_path / "e"), "--quiet"]) in (0, 1)
    capsys.readouterr()
    assert cli.main(["info", str(source)]) == 0
    assert "Choose another with --tool" in capsys.readouterr().err
    assert cli.main(["info", str(source), "--tool", "crank", "--json"]) == 0
    assert "names no tool" not in capsys.readouterr().err
    assert cli.main(["info", str(source), "--tool", "krank"]) == 2
    assert "there is no frame or body 'krank'. Did you mean 'crank'?" in capsys.readouterr().err
    assert cli.main(["info", "sils", "--tool", "tool"]) == 2
    assert "its tool is set in its description" in capsys.readouterr().err


@pytest.mark.parametrize(("shift", "turn"), [(0.05, 0.0), (0.0, 0.1), (12.0, 3.0)])
def test_a_loop_that_is_authored_open_is_told_with_its_size(shift, turn, tmp_path):
    def change(stage):
        joint = UsdPhysics.Joint(stage.GetPrimAtPath("/fourbar/wrist"))
        position, rotation = joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()
        position.Set(position.Get() + Gf.Vec3f(shift / 10, 0, 0))  # the stage is in centimetres
        q = Gf.Rotation(Gf.Vec3d(1, 0, 0), turn).GetQuat()
        rotation.Set(Gf.Quatf(Gf.Quatf(q.GetReal(), Gf.Vec3f(q.GetImaginary())) * rotation.Get()))

    path = edited(MODELS / "fourbar.usda", tmp_path / "open.usda", change)
    found = {f.where: f for f in close(read(path, guarded=False)).findings if f.code == "import.open"}
    assert set(found) == {"wrist"}
    assert found["wrist"].size * 1e3 == pytest.approx(shift, abs=1e-4)
    assert f"{turn:.3g}"[:3] in found["wrist"].message
    assert not [f for f in close(read(MODELS / "fourbar.usda", guarded=False)).findings if f.code == "import.open"]
