"""Stages of others: scaled ancestors, no tool, joints that are authored open, several robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from twin import api, cli
from twin.core.errors import TwinError
from twin.exchange.read import read
from twin.exchange.read.closing import close
from twin.ui.session.desk import Desk
from twin.usd.read import inspect_stage

HERE = Path(__file__).parent
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


def test_a_stage_without_a_tool_is_shown_exported_and_told(tmp_path, capsys):
    source = MODELS / "slider.usda"
    robot = api.load(source)
    tool = robot.mechanism.frame(robot.mechanism.tool)
    assert "the file names no tool" in robot.tool_note
    depth = {robot.mechanism.base: 0}
    for joint in robot.mechanism.tree:
        depth[joint.child] = depth[joint.parent] + 1
    assert depth[tool.body] == max(depth.values())
    desk = Desk(robot)
    assert np.isfinite(desk.model.home().T_base_tool).all()
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
    assert "the tool is set in the robot's description" in capsys.readouterr().err


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
