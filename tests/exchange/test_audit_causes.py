"""A defect is named by its own place, not only by what follows from it: joints, keyframes, loops, entries, scenes."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from made import bundle as base
from twin.core.findings import Finding
from twin.exchange.audit import audit
from twin.exchange.audit.clip_comparison import compare_clips
from twin.exchange.audit.clip_references import Reference
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.mechanism_comparison import compare_mechanisms
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import motion_lines
from twin.exchange.audit.poses import about, pose
from twin.exchange.audit.scene_folder import audit_scene
from twin.exchange.audit.track_claims import check_claims
from twin.exchange.formats.mjcf.audit import read_mujoco
from twin.exchange.formats.mjcf.audit.claims import counts_from_home
from twin.exchange.formats.mjcf.audit.model_checks import check_model
from twin.exchange.formats.tracks.audit import read_csv
from twin.exchange.formats.unity.audit import check_package
from twin.exchange.formats.unity.audit.kinematics import ROBOTS, read_classes
from twin.exchange.formats.unity.audit.shipped_files import PACKAGE
from twin.exchange.formats.urdf.audit import Urdf
from twin.exchange.formats.usd.audit.listed_numbers import check_cones
from twin.exchange.formats.usd.audit.mechanism import stage_mechanism
from twin.exchange.formats.usd.audit.time_samples import check_time_range


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return base.write_good(tmp_path_factory.mktemp("good") / "bars")


def copied(good: Path, folder: Path, *names: str) -> Path:
    for name in names:
        if (good / name).is_dir():
            shutil.copytree(good / name, folder / name)
        else:
            shutil.copy(good / name, folder / name)
    return folder


def replaced(file: Path, pattern: str, new: str) -> None:
    text, count = re.subn(pattern, new, file.read_text(encoding="utf-8"), count=1)
    assert count == 1
    file.write_text(text, encoding="utf-8")


def told(folder: Path) -> dict[str, str]:
    """Return {code: message} of what an audit of a folder finds."""
    return {finding.code: finding.message for finding in base.grave(audit(folder).findings)}


# ------------------------------------------------------------------------------------------------------- joints


@pytest.mark.parametrize(("form", "expected"), [("urdf", "at joint 'b'."), ("glb", "")])
def test_the_joint_is_named_at_which_a_deviation_begins(form, expected):
    """The poses of a tree of joints carry the deviations of the links before them, those of a GLB do not."""
    joints = []
    for name, parent, child in (("a", "base", "arm"), ("b", "arm", "hand"), ("c", "hand", "tip")):
        joints.append(FileJoint((name,), parent, child, pose(), motion_lines("revolute", pose())))
    times = np.arange(3.0)
    right = {link: np.tile(np.eye(4), (3, 1, 1)) for link in ("base", "arm", "hand", "tip")}
    off = np.tile(pose(p=[0, 0, 0.001]), (3, 1, 1))
    far = np.tile(pose(p=[0, 0, 0.1]), (3, 1, 1))
    wrong = FileClip("swing", times, right | {"hand": off, "tip": far})
    content = Content(Ledger(f"a.{form}"), form, clips=[wrong], mechanism=FileMechanism(tuple(right), joints=joints))
    track = Content(Ledger("t.json"), "tracks", clips=[FileClip("swing", times, right)])
    compare_clips([track, content], {"swing": Reference(track.clips[0], "t.json")})
    found = [f for f in content.ledger.found if f.code == "compare.pose"]
    assert {f.where for f in found} == {f"a.{form}: hand", f"a.{form}: tip"}
    first = found[0]
    assert first.where == (f"a.{form}: hand" if expected else f"a.{form}: tip")
    assert first.message.endswith(expected or "t.json.")


@pytest.mark.parametrize(("joint", "off"), [("q1", 0.0), ("q1", 0.01), ("passive", 0.01)])
def test_coordinates_at_home_are_compared_by_joint(joint, off):
    home = {"q1": 0.2, "passive": -0.4}
    contents = []
    for form, stated in (("mjcf", home), ("urdf", home | {joint: home[joint] + off})):
        mechanism = FileMechanism(("base", "arm"), home=stated)
        contents.append(Content(Ledger(f"a.{form}"), form, mechanism=mechanism))
    compare_mechanisms(contents)
    found = [f for content in contents for f in content.ledger.found]
    assert [f.code for f in found] == (["physics.home"] if off else [])
    assert not off or f"joint '{joint}': coordinate at home" in found[0].message


def test_the_table_of_home_in_a_class_is_the_posture_of_the_stage():
    contents = []
    for form, mechanism in (
        ("usda", FileMechanism(("base",), postures={"home": {"q1": 0.55}, "aside": {"q1": 0.0}})),
        ("unity", FileMechanism(("base",), home_posture={"q1": 0.5})),
    ):
        contents.append(Content(Ledger(f"a.{form}"), form, mechanism=mechanism))
    compare_mechanisms(contents)
    assert {f.code for content in contents for f in content.ledger.found} == {"physics.home_coordinates"}


def test_couplings_of_other_numbers_of_joints_are_compared():
    contents = []
    for form, ratios in (("usda", {"q1": 1.0, "q2": 1.0, "q3": 1.0}), ("mjcf", {"q1": 1.0, "q2": 1.0})):
        mechanism = FileMechanism(("base",), couplings={"belt": (ratios, 0.0)})
        contents.append(Content(Ledger(f"a.{form}"), form, mechanism=mechanism))
    compare_mechanisms(contents)
    assert "physics.links" in {f.code for content in contents for f in content.ledger.found}


# --------------------------------------------------------------------------------------------------- MJCF, URDF


@pytest.mark.parametrize(
    ("pattern", "new", "text"),
    [
        (r'(<key [^>]*ctrl=")0', r"\g<1>0.4", "its control is 0.4, and "),
        (r'biasprm="\S+', 'biasprm="0', "its control is 0, and "),
    ],
)
def test_a_drive_at_its_maximum_effort_at_home_is_told_its_control(pattern, new, text, good, tmp_path):
    folder = copied(good, tmp_path, "meshes", "bars.xml")
    replaced(folder / "bars.xml", r'forcerange="[^"]+"', 'forcerange="-0.5 0.5"')
    replaced(folder / "bars.xml", pattern, new)
    assert text in told(folder / "bars.xml").get("mjcf.keyframe", "")


@pytest.mark.parametrize(("ends", "found"), [(("x_a", "x_b"), True), (("left", "right"), False)])
def test_the_ends_of_a_loop_that_the_yaml_does_not_close_are_named(ends, found, tmp_path):
    """Only where all loops of the YAML have ends of such names: others name their frames as they like."""
    links = "".join(f'<link name="{name}"/>' for name in ("base", "x_a", "x_b", "left", "right", "y_a", "y_b"))
    joints = ""
    for name in ("x_a", "x_b", "left", "right", "y_a", "y_b"):
        joints += f'<joint name="j_{name}" type="fixed"><parent link="base"/><child link="{name}"/></joint>'
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    closed = [["y_a", "y_b"], *([] if found else [["x_a", "x_b"], list(ends)])]
    types = json.dumps(["3d"] * len(closed))
    (tmp_path / "r.yaml").write_text(f"closed_loop: {json.dumps(closed)}\ntype: {types}\nname_mot: []\n")
    ledger = Ledger("r.urdf")
    Urdf(tmp_path / "r.urdf", ledger)
    assert [f.where for f in ledger.found if f.code == "urdf.loop_missing"] == (["r.urdf: x"] if found else [])


# ---------------------------------------------------------------------------------------------------------- USD


def surface_lost(geometry):
    material = next(prim for prim in geometry.TraverseAll() if prim.IsA(UsdShade.Material))
    UsdShade.Material(material).GetSurfaceOutput().ClearSources()


def transforms_reset(geometry):
    UsdGeom.Xformable(geometry.GetPrimAtPath("/bars/rocker")).SetResetXformStack(True)


@pytest.mark.parametrize(("change", "code"), [(surface_lost, "usd.material"), (transforms_reset, "usd.reset")])
def test_lost_surfaces_and_reset_transforms_of_a_stage_are_named(change, code, good, tmp_path):
    folder = copied(good, tmp_path, "usd")
    geometry = Usd.Stage.Open(str(folder / "usd/geometry.usdc"))
    change(geometry)
    geometry.GetRootLayer().Save()
    assert code in told(folder / "usd/bars.usda")


def test_a_mesh_that_ar_viewers_do_not_show_is_named(good, tmp_path):
    stage = Usd.Stage.Open(str(good / "bars_ar.usdz"))
    stage = Usd.Stage.Open(stage.Flatten())
    mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    UsdGeom.Imageable(mesh).CreatePurposeAttr("guide")
    stage.GetRootLayer().Export(str(tmp_path / "bars.usdc"))
    writer = Sdf.ZipFileWriter.CreateNew(str(tmp_path / "bars_ar.usdz"))
    writer.AddFile(str(tmp_path / "bars.usdc"), "bars.usdc")
    writer.Save()
    assert str(mesh.GetPath()) in told(tmp_path / "bars_ar.usdz").get("usdz.purpose", "")


def test_a_cone_is_that_of_a_parameter_of_several_balls():
    stage = Usd.Stage.CreateInMemory()
    root = UsdGeom.Xform.Define(stage, "/arm").GetPrim()
    stage.SetDefaultPrim(root)
    root.SetCustomDataByKey("twin:parameters:s1,s2 cone:value", 1.2)
    bodies = []
    for name in ("base", "hand"):
        bodies.append(UsdGeom.Xform.Define(stage, f"/arm/{name}").GetPrim())
        UsdPhysics.RigidBodyAPI.Apply(bodies[-1])
    for name, cone in (("s1", 1.2), ("s2", 68.8)):
        ball = UsdPhysics.SphericalJoint.Define(stage, f"/arm/{name}")
        ball.CreateBody0Rel().SetTargets([bodies[0].GetPath()])
        ball.CreateBody1Rel().SetTargets([bodies[1].GetPath()])
        ball.GetPrim().CreateAttribute("twin:cone", Sdf.ValueTypeNames.Double).Set(cone)
    ledger = Ledger("arm.usda")
    check_cones(stage, stage_mechanism(stage, bodies, 1.0, "Z"), ledger)
    assert [f.where for f in ledger.found] == ["arm.usda: s2"]


# -------------------------------------------------------------------------------------------------------- Unity


def test_the_entry_is_named_in_which_a_json_file_of_the_package_differs(tmp_path):
    folder = tmp_path / "unity"
    shutil.copytree(PACKAGE, folder)
    manifest = json.loads((folder / "package.json").read_text())
    manifest["dependencies"].pop("com.unity.modules.physics")
    (folder / "package.json").write_text(json.dumps(manifest))
    ledger = Ledger("unity")
    check_package(folder, ledger)
    (message,) = [f.message for f in ledger.found if f.code == "unity.shipped"]
    assert "'dependencies', in 'com.unity.modules.physics'" in message


@pytest.mark.parametrize(("name", "found"), [("Twin.Robots", False), ("Twin.Robot", True)])
def test_a_class_in_another_namespace_is_named(name, found, tmp_path):
    (tmp_path / ROBOTS).mkdir(parents=True)
    (tmp_path / ROBOTS / "Arm.cs").write_text(f"using System;\n\nnamespace {name}\n{{\n}}\n")
    ledger = Ledger("unity")
    read_classes(tmp_path, ledger)
    assert any("namespace" in f.message for f in ledger.found) == found


# ------------------------------------------------------------------------------------------------------- scenes


def audited_scene(
    folder: Path,
    *,
    protocol: str = "swing",
    x: float = 0.5,
    R: np.ndarray | None = None,
    filtered: int = 2,
    hand_x: float = 0.0,
) -> list[Finding]:
    """Return the findings of an audit of a scene of one robot at x = 0.5 m, with a prop of two shapes."""
    (folder / "arm").mkdir()
    (folder / "usd").mkdir()
    base_pose = pose(R, [x, 0, 0]).tolist()
    robot = {"name": "arm", "folder": "arm", "protocol": protocol, "T_world_base": base_pose}
    (folder / "scene.json").write_text(json.dumps({"robots": [robot]}))
    stage = Usd.Stage.CreateNew(str(folder / "usd/scene.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/scene").GetPrim())
    UsdGeom.Xform.Define(stage, "/scene/arm").AddTranslateOp().Set(Gf.Vec3d(0.5, 0, 0))
    hand = UsdGeom.Xform.Define(stage, "/scene/arm/hand").GetPrim()
    UsdGeom.Xform.Define(stage, "/scene/arm/wrist")
    UsdGeom.Xform.Define(stage, "/scene/patient")
    shapes = []
    for name in ("chest", "legs"):
        shapes.append(UsdGeom.Cube.Define(stage, f"/scene/patient/{name}").GetPrim())
        UsdPhysics.CollisionAPI.Apply(shapes[-1])
    pairs = UsdPhysics.FilteredPairsAPI.Apply(hand).CreateFilteredPairsRel()
    pairs.SetTargets([shape.GetPath() for shape in shapes[:filtered]])
    stage.GetRootLayer().Save()
    still = np.tile(np.eye(4), (2, 1, 1))
    hand_poses = still.copy()
    hand_poses[0, 0, 3] = hand_x
    clip = FileClip("swing", np.arange(2.0), {"hand": hand_poses, "wrist": still})
    _, ledgers = audit_scene(folder, lambda _: ([Content(Ledger("t.json"), "tracks", clips=[clip])], []))
    findings = []
    for ledger in ledgers:
        findings += [finding for finding in ledger.found if finding.code.startswith("scene.")]
    return findings


@pytest.mark.parametrize(
    ("change", "codes"),
    [
        ({}, set()),
        ({"protocol": "circle"}, {"scene.protocol", "scene.link"}),
        ({"x": 0.51}, {"scene.base", "scene.link"}),
        ({"filtered": 1}, {"scene.filter"}),
    ],
)
def test_what_a_scene_states_is_compared_with_its_stage_and_its_robots(change, codes, tmp_path):
    assert {finding.code for finding in audited_scene(tmp_path, **change)} == codes


def test_a_pose_that_is_not_a_number_is_found_though_the_next_link_is_right(tmp_path):
    (finding,) = audited_scene(tmp_path, hand_x=np.nan)
    assert finding.code == "scene.link"
    assert finding.where.endswith("arm/hand")
    assert "not finite" in finding.message


def test_a_turned_base_is_measured_by_its_angle(tmp_path):
    findings = {finding.code: finding for finding in audited_scene(tmp_path, R=about([0, 0, 1], 0.5))}
    turned = findings["scene.base"]
    assert turned.unit == "deg"
    assert turned.size == pytest.approx(np.degrees(0.5))


@pytest.mark.parametrize("place", [(2, 2, -1.0), (3, 0, 1.0), (0, 3, float("inf"))])
def test_a_base_that_is_mirrored_projected_or_infinitely_far_is_no_pose(tmp_path, place):
    row, column, value = place
    T = np.eye(4)
    T[row, column] = value
    (tmp_path / "arm").mkdir()
    robot = {"name": "arm", "folder": "arm", "protocol": "", "T_world_base": T.tolist()}
    (tmp_path / "scene.json").write_text(json.dumps({"robots": [robot]}))
    _, (ledger,) = audit_scene(tmp_path, lambda _: ([], []))
    assert [finding.code for finding in ledger.found] == ["scene.pose"]


def test_a_robot_that_is_named_as_the_group_of_objects_is_refused(tmp_path):
    (tmp_path / "arm").mkdir()
    robot = {"name": "objects", "folder": "arm", "protocol": "", "T_world_base": np.eye(4).tolist()}
    ring = {"name": "ring", "T_world_object": np.eye(4).tolist()}
    (tmp_path / "scene.json").write_text(json.dumps({"robots": [robot], "objects": [ring]}))
    _, (ledger,) = audit_scene(tmp_path, lambda _: ([], []))
    assert [finding.code for finding in ledger.found] == ["scene.objects"]
    assert "a robot is named 'objects'" in ledger.found[0].message


# --------------------------------------------------------------------------------------------- tables, names of files


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (",", ";", "semicolons separate the columns"),
        (".", ",", "a number with a decimal comma counts as two"),
        (".", "x", "is not a number"),
    ],
)
def test_a_table_that_a_spreadsheet_saved_is_told_with_its_line(old, new, expected, good, tmp_path):
    lines = (good / "tracks/swing.csv").read_text().split("\n")
    header = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    changed = [line.replace(old, new) for line in lines[header:]]
    if old != ",":
        changed[0] = lines[header]  # names of columns
    (tmp_path / "swing.csv").write_text("\n".join(lines[:header] + changed))
    with pytest.raises(ReadError, match=expected) as error:
        read_csv(tmp_path / "swing.csv", Ledger("swing.csv"))
    assert f"swing.csv, line {header + (1 if old == ',' else 2)}" in str(error.value)


@pytest.mark.parametrize(
    ("protocols", "wrong"),
    [
        ({"t/a.json": "a", "t/b.json": "b"}, []),
        ({"t/a.json": "b", "t/b.json": "a"}, ["t/a.json", "t/b.json"]),
        ({"t/renamed.json": "a", "t/b.json": "b"}, []),
        ({"t/a.json": "b", "u/b.json": "a"}, []),
    ],
)
def test_tracks_with_the_names_of_each_other_are_told(protocols, wrong):
    tracks = []
    for file, protocol in protocols.items():
        tracks.append(Content(Ledger(file), "tracks", extra={"data": {"protocol": protocol}}))
    check_claims(tracks)
    told = []
    for track in tracks:
        told += [finding.where for finding in track.ledger.found if finding.code == "claims.protocol"]
    assert told == [f"{file}: protocol" for file in wrong]


# --------------------------------------------------------------------------------------- controls, couplings, sublayers


@pytest.mark.parametrize(
    ("comment", "range_", "found"),
    [
        (True, "-1.5 0.5", 0),
        (True, "-1 1", 1),  # counts from zero
        (True, "-0.5 0.5", 1),  # too narrow
        (False, "-1 1", 0),
        (False, "-0.5 0.5", 0),
    ],
)
def test_a_control_range_counts_from_home_where_the_file_says_so(comment, range_, found, tmp_path):
    claim = "<!-- A control is the displacement of its joint from home, in m or rad. -->" if comment else ""
    joint = '<joint name="q" type="hinge" ref="0.5" range="-1 1"/>'
    drive = f'<general name="q" joint="q" gainprm="9" biastype="affine" biasprm="0 -9 -1" ctrlrange="{range_}"/>'
    path = tmp_path / "arm.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody><body>{joint}<geom size="0.1"/></body></worldbody>'
        f"<actuator>{claim}{drive}</actuator></mujoco>"
    )
    ledger = Ledger("arm.xml")
    check_model(read_mujoco(path, ledger).model, ledger, counts_from_home(path.read_text()))
    assert len([f for f in ledger.found if f.code == "mjcf.control"]) == found


@pytest.mark.parametrize(("yaml", "excused"), [("closed_loop: []\ntype: []\nname_mot: []\n", False), ("", True)])
def test_only_a_urdf_without_a_closure_yaml_cannot_hold_a_coupling_of_three_joints(yaml, excused, tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text('<robot name="arm"><link name="base"/></robot>')
    if yaml:
        (tmp_path / "arm.yaml").write_text(yaml)
    mechanism = Urdf(file, Ledger("arm.urdf")).content.mechanism
    assert mechanism is not None
    assert mechanism.couples_pairs is excused


@pytest.mark.parametrize(("sublayers", "hidden"), [(("robot", "motion"), True), (("motion", "robot"), False)])
def test_a_layer_of_a_motion_below_that_of_the_robot_is_named(sublayers, hidden, tmp_path):
    for name in ("robot", "motion"):
        stage = Usd.Stage.CreateNew(str(tmp_path / f"{name}.usda"))
        translate = UsdGeom.Xform.Define(stage, "/arm").AddTranslateOp()
        if name == "robot":
            translate.Set(Gf.Vec3d(0, 0, 0))
        else:
            translate.Set(Gf.Vec3d(1, 0, 0), 1.0)
        stage.GetRootLayer().Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "played.usda"))
    stage.GetRootLayer().subLayerPaths = [f"./{name}.usda" for name in sublayers]
    stage.SetEndTimeCode(1.0)
    ledger = Ledger("played.usda")
    check_time_range(stage, np.array([] if hidden else [0.0, 1.0]), ledger)
    told = [finding.message for finding in ledger.found]
    assert len(told) == hidden
    assert not hidden or "motion.usda has time samples of /arm.xformOp:translate" in told[0]
