"""The stage checker: silent on a clean stage; each seeded defect is named, with its prim."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from twin.core.errors import StageError
from twin.core.findings import verdict
from twin.core.units import DEG, MM
from twin.usd.check import check_stage, run_usd_validators
from twin.usd.read import read_stage
from twin.usd.write import Motion, write_stage

made = SimpleNamespace(**runpy.run_path(str(Path(__file__).with_name("test_stage_mechanisms.py"))))

CRANK, ELBOW, CLOSING = (f"/bars/joints/{n}" for n in ("crank_joint", "elbow", "closing"))


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A folder with the four-bar, its motion, and the slider in a folder of its own."""
    folder = tmp_path_factory.mktemp("clean")
    times = np.arange(31) / 60
    states = [made.four_bar_state(made.CRANK_AT_REST + 0.45 * np.sin(3 * t)) for t in times]
    motion = Motion(
        "swing",
        times,
        {b: np.stack([s[0][b] for s in states]) for b in states[0][0]},
        {j: np.array([s[1][j] for s in states]) for j in states[0][1]},
    )
    write_stage(made.four_bar(), folder, *made.four_bar_state(made.CRANK_AT_REST), motion=motion)
    write_stage(made.slider(), folder / "slider", *made.slider_state(30 * MM, 0.7))
    return folder


def seeded(clean: Path, folder: Path, spoil, root: str = "bars.usda") -> Path:
    """Copy the clean files, let `spoil` edit the stage, and return the spoilt root layer."""
    shutil.copytree(clean, folder, dirs_exist_ok=True)
    stage = Usd.Stage.Open(str(folder / root))
    spoil(stage)
    for layer in stage.GetUsedLayers():
        if layer.dirty and not layer.anonymous:
            layer.Save()
    return folder / root


def put(path: str, value):
    """Return an edit that sets the default of an existing attribute."""

    def edit(stage):
        assert stage.GetAttributeAtPath(path).Set(value)

    return edit


def forget(field: str):
    """Return an edit that clears a field of the root layer."""

    def edit(stage):
        stage.GetRootLayer().pseudoRoot.ClearInfo(field)

    return edit


def metadata(field: str, value):
    def edit(stage):
        stage.GetRootLayer().pseudoRoot.SetInfo(field, value)

    return edit


def prim_of(name):
    return lambda stage: stage.GetPrimAtPath(f"/bars/{name}")


def _no_root(stage):
    stage.GetPrimAtPath("/bars").RemoveAPI(UsdPhysics.ArticulationRootAPI)


def _second_root(stage):
    UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath("/bars/base"))


def _nested(stage):
    inner = UsdGeom.Xform.Define(stage, "/bars/crank/inner").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(inner)
    UsdPhysics.MassAPI.Apply(inner).CreateMassAttr(1.0)
    joint = UsdPhysics.FixedJoint.Define(stage, "/bars/joints/inner_joint")
    joint.CreateBody0Rel().SetTargets(["/bars/crank"])
    joint.CreateBody1Rel().SetTargets(["/bars/crank/inner"])
    joint.CreateCollisionEnabledAttr(False)


def _mirrored(stage):
    prim = stage.GetPrimAtPath("/bars/rocker")
    xform = UsdGeom.Xformable(prim)
    xform.AddScaleOp().Set((1, 1, -1))


def _stretched(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).AddScaleOp().Set((1, 1, 2))


def _mirrored_mesh(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker/rocker_visual")).AddScaleOp().Set((-1, 1, 1))


def _no_mass(stage):
    stage.GetPrimAtPath("/bars/rocker").RemoveAPI(UsdPhysics.MassAPI)


def _op_type(stage):
    prim = stage.GetPrimAtPath("/bars/rocker")
    prim.CreateAttribute("xformOp:scale", Sdf.ValueTypeNames.String).Set("1 1 1")
    order = UsdGeom.Xformable(prim).GetXformOpOrderAttr()
    order.Set([*order.Get(), "xformOp:scale"])


def _op_unlisted(stage):
    prim = stage.GetPrimAtPath("/bars/rocker")
    prim.CreateAttribute("xformOp:rotateZ", Sdf.ValueTypeNames.Float).Set(10.0)


def _op_missing(stage):
    order = UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).GetXformOpOrderAttr()
    order.Set([*order.Get(), "xformOp:rotateX"])


def _op_order(stage):
    order = UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).GetXformOpOrderAttr()
    order.Set(list(order.Get())[::-1])


def _reset_stack(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars")).AddTranslateOp().Set((0, 0, 1))
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).SetResetXformStack(True)


def _no_drive(stage):
    stage.GetPrimAtPath(CRANK).RemoveAPI(UsdPhysics.DriveAPI, "angular")


def _wrong_drive(stage):
    UsdPhysics.DriveAPI.Apply(stage.GetPrimAtPath(CRANK), "linear").CreateStiffnessAttr(1.0)


def _no_gains(stage):
    drive = UsdPhysics.DriveAPI(stage.GetPrimAtPath(CRANK), "angular")
    drive.GetStiffnessAttr().Set(0.0)
    drive.GetDampingAttr().Set(0.0)


def _no_state(stage):
    layer = Sdf.Layer.Find(str(Path(stage.GetRootLayer().realPath).with_name("physics.usda")))
    prim = layer.GetPrimAtPath(ELBOW)
    prim.RemoveProperty(prim.properties["state:angular:physics:position"])


def _dangling(stage):
    UsdPhysics.Joint(stage.GetPrimAtPath(ELBOW)).GetBody1Rel().SetTargets(["/bars/nothing"])


def _same_body(stage):
    UsdPhysics.Joint(stage.GetPrimAtPath(ELBOW)).GetBody1Rel().SetTargets(["/bars/crank"])


def _duplicate(stage):
    UsdGeom.Mesh.Define(stage, "/bars/rocker/crank_visual").CreateSubdivisionSchemeAttr("none")


def _excluded_too_much(stage):
    for name in ("rocker_joint", "closing"):
        joint = UsdPhysics.Joint(stage.GetPrimAtPath(f"/bars/joints/{name}"))
        joint.CreateExcludeFromArticulationAttr(True)


def _floating(stage):
    stage.GetPrimAtPath("/bars/joints/root_joint").SetActive(False)


def _sublayer_unit(stage):
    geometry = Path(stage.GetRootLayer().realPath).with_name("geometry.usdc")
    Sdf.Layer.Find(str(geometry)).pseudoRoot.SetInfo("metersPerUnit", 0.001)


def _inside_out(stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual"))
    triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    mesh.GetFaceVertexIndicesAttr().Set(triangles[:, ::-1].ravel().tolist())


def _bad_index(stage):
    attribute = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual")).GetFaceVertexIndicesAttr()
    attribute.Set([99, *list(attribute.Get())[1:]])


def _millimetres(stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual"))
    points = [p * 1000 for p in mesh.GetPointsAttr().Get()]
    mesh.GetPointsAttr().Set(points)
    mesh.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))


HALF = Gf.Quatf(0.5, 0, 0, 0)

PRINTED = {
    # the 15 defects of our survey that no public validator names
    "loop": (put(f"{CLOSING}.physics:excludeFromArticulation", False), "stage.loop", CLOSING),
    "anchor": (put(f"{ELBOW}.physics:localPos0", Gf.Vec3f(0.102, 0, 0)), "stage.anchor", ELBOW),
    "axis": (put(f"{ELBOW}.physics:axis", "X"), "stage.axis", ELBOW),
    "inertia": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(1e-4, 1e-4, 9e-4)),
        "stage.inertia",
        "/bars/rocker",
    ),
    "com_in_mm": (put("/bars/rocker.physics:centerOfMass", Gf.Vec3f(110, 0, 0)), "stage.com", "/bars/rocker"),
    "limits": (put(f"{CRANK}.physics:lowerLimit", 180.0), "stage.limits", CRANK),
    "articulation_root": (_no_root, "stage.articulation_root", "/bars"),
    "nested": (_nested, "stage.nested", "/bars/crank/inner"),
    "radians": (put(f"{ELBOW}.state:angular:physics:position", -0.75702), "stage.radians", ELBOW),
    "quaternion": (put(f"{ELBOW}.physics:localRot0", HALF), "stage.quaternion", ELBOW),
    "kilograms": (forget("kilogramsPerUnit"), "stage.kilograms_per_unit", "/"),
    "mirrored": (_mirrored, "stage.mirrored", "/bars/rocker"),
    "mass_missing": (_no_mass, "stage.mass_missing", "/bars/rocker"),
    "op_type": (_op_type, "stage.xform_type", "/bars/rocker"),
}

MORE = {
    "default_prim": (forget("defaultPrim"), "stage.default_prim", "/"),
    "up_axis_missing": (forget("upAxis"), "stage.up_axis", "/"),
    "up_axis": (metadata("upAxis", "Y"), "stage.up_axis", "/"),
    "meters_missing": (forget("metersPerUnit"), "stage.meters_per_unit", "/"),
    "meters": (metadata("metersPerUnit", 0.01), "stage.meters_per_unit", "/"),
    "layer_units": (_sublayer_unit, "stage.layer_units", "geometry.usdc"),
    "frame_rate": (metadata("framesPerSecond", 24.0), "stage.frame_rate", "/"),
    "scale": (_stretched, "stage.scale", "/bars/rocker"),
    "mirrored_mesh": (_mirrored_mesh, "stage.mirrored", "/bars/rocker/rocker_visual"),
    "mass": (put("/bars/rocker.physics:mass", -1.0), "stage.mass", "/bars/rocker"),
    "inertia_negative": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(-1e-5, 1e-3, 1e-3)),
        "stage.inertia",
        "/bars/rocker",
    ),
    "inertia_unit": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(8.3, 961, 966)),
        "stage.inertia_size",
        "/bars/rocker",
    ),
    "principal_axes": (put("/bars/rocker.physics:principalAxes", HALF), "stage.quaternion", "/bars/rocker"),
    "orient": (put("/bars/rocker.xformOp:orient", Gf.Quatd(0.5, 0, 0, 0)), "stage.quaternion", "/bars/rocker"),
    "dangling": (_dangling, "stage.joint", ELBOW),
    "same_body": (_same_body, "stage.joint", ELBOW),
    "second_root": (_second_root, "stage.articulation_root", "/bars/base"),
    "excluded_too_much": (_excluded_too_much, "stage.disconnected", "/bars/rocker"),
    "floating": (_floating, "stage.floating", "/"),
    "self_collision": (
        put("/bars.physxArticulation:enabledSelfCollisions", True),
        "stage.self_collision",
        "/bars",
    ),
    "joint_collision": (put(f"{ELBOW}.physics:collisionEnabled", True), "stage.joint_collision", ELBOW),
    "state": (put(f"{ELBOW}.state:angular:physics:position", 5.0), "stage.state", ELBOW),
    "state_missing": (_no_state, "stage.state_missing", ELBOW),
    "beyond_limits": (put(f"{CRANK}.physics:upperLimit", 60.0), "stage.beyond_limits", CRANK),
    "radian_target": (
        put(f"{CRANK}.drive:angular:physics:targetPosition", 1.2217),
        "stage.radians",
        CRANK,
    ),
    "drive_target": (
        put(f"{CRANK}.drive:angular:physics:targetPosition", 720.0),
        "stage.drive_target",
        CRANK,
    ),
    "drive_missing": (_no_drive, "stage.drive_missing", CRANK),
    "no_drive_at_all": (_no_drive, "stage.drive_missing", "/"),
    "drive_gains": (_no_gains, "stage.drive_missing", CRANK),
    "drive_axis": (_wrong_drive, "stage.drive_axis", CRANK),
    "op_unlisted": (_op_unlisted, "stage.xform_order", "/bars/rocker"),
    "op_missing": (_op_missing, "stage.xform_order", "/bars/rocker"),
    "op_order": (_op_order, "stage.xform_order", "/bars/rocker"),
    "reset_stack": (_reset_stack, "stage.xform_reset", "/bars/rocker"),
    "duplicate_name": (_duplicate, "stage.duplicate_name", "/bars/rocker/crank_visual"),
    "winding": (_inside_out, "stage.winding", "/bars/rocker/rocker_visual"),
    "point_index": (_bad_index, "stage.point_index", "/bars/rocker/rocker_visual"),
    "extent": (
        put("/bars/rocker/rocker_visual.extent", [Gf.Vec3f(0), Gf.Vec3f(1)]),
        "stage.extent",
        "/bars/rocker/rocker_visual",
    ),
    "subdivision": (
        put("/bars/rocker/rocker_visual.subdivisionScheme", "catmullClark"),
        "stage.subdivision",
        "/bars/rocker/rocker_visual",
    ),
    "millimetres": (_millimetres, "stage.size", "/bars/rocker"),
}


@pytest.mark.parametrize("root", ["bars.usda", "bars_swing.usda", "slider/slider.usda"])
def test_a_clean_stage_has_no_findings(root, clean):
    assert check_stage(clean / root) == []


@pytest.mark.parametrize("name", [*PRINTED, *MORE])
def test_each_defect_is_named_with_its_prim(name, clean, tmp_path):
    spoil, code, where = {**PRINTED, **MORE}[name]
    findings = check_stage(seeded(clean, tmp_path, spoil))
    assert (code, where) in {(f.code, f.where) for f in findings}
    named = next(f for f in findings if (f.code, f.where) == (code, where))
    assert named.message.endswith(".")
    assert named.suggestion
    assert (named.size is None) or np.isfinite(named.size)


@pytest.mark.parametrize("name", [n for n in PRINTED if n != "op_type"])
def test_public_validators_miss_it(name, clean, tmp_path):
    """What the table in our survey says; a release of OpenUSD that learns one turns this red: good news."""
    assert run_usd_validators(seeded(clean, tmp_path, PRINTED[name][0])) == []


def test_an_op_that_cannot_be_evaluated_stops_everyone(clean, tmp_path):
    """OpenUSD raises on evaluating it; the checker names the op and says what it could not check."""
    path = seeded(clean, tmp_path, _op_type)
    assert [f.code for f in check_stage(path)] == ["stage.unchecked", "stage.xform_type"]
    assert [f.code for f in run_usd_validators(path)] == ["usd.failed"]
    with pytest.raises(StageError, match="cannot be evaluated"):
        read_stage(path)


def test_public_findings_are_passed_on(clean, tmp_path):
    path = seeded(clean, tmp_path, put("/bars/rocker.physics:mass", -1.0))
    (finding,) = run_usd_validators(path)
    assert finding.code.startswith("usd.")
    assert finding.where.startswith("/bars/rocker")
    assert finding.severity == "disagreement"
    assert finding.message


def test_one_defect_does_not_hide_behind_others(clean, tmp_path):
    """Findings name the cause, not everything that follows from it."""
    codes = {
        name: {f.code for f in check_stage(seeded(clean, tmp_path / name, PRINTED[name][0]))}
        for name in ("loop", "anchor", "inertia", "com_in_mm", "limits", "radians", "mass_missing")
    }
    assert all(len(found) == 1 for found in codes.values()), codes


def test_a_gap_is_measured_in_mm(clean, tmp_path):
    (finding,) = check_stage(seeded(clean, tmp_path, PRINTED["anchor"][0]))
    assert finding.size == pytest.approx(2.0, abs=1e-4)
    assert finding.limit == pytest.approx(0.01)
    assert (finding.unit, finding.when) == ("mm", "at rest")


# --- time samples ------------------------------------------------------------------------------


def sample(path: str, code: float, change):
    """Return an edit that replaces one time sample by a function of it."""

    def edit(stage):
        attribute = stage.GetAttributeAtPath(path)
        assert attribute.Set(change(attribute.Get(code)), code)

    def in_layer(stage):
        motion = Path(stage.GetRootLayer().realPath).parent / "motion" / "swing.usdc"
        stage.SetEditTarget(Sdf.Layer.Find(str(motion)))
        edit(stage)

    return in_layer


def _sampled_out_of_range(stage):
    stage.SetEndTimeCode(20)


def _no_range(stage):
    for field in ("startTimeCode", "endTimeCode"):
        stage.GetRootLayer().pseudoRoot.ClearInfo(field)


def _layer_rate(stage):
    motion = Path(stage.GetRootLayer().realPath).parent / "motion" / "swing.usdc"
    Sdf.Layer.Find(str(motion)).pseudoRoot.SetInfo("timeCodesPerSecond", 24.0)


ROCKER = "/bars/rocker"
SAMPLED = {
    "time_range": (_sampled_out_of_range, "stage.time_range", f"{ROCKER}.xformOp:orient"),
    "no_range": (_no_range, "stage.time_range", "/bars/base.xformOp:orient"),
    "layer_rate": (_layer_rate, "stage.frame_rate", "swing.usdc"),
    "sign": (sample(f"{ROCKER}.xformOp:orient", 7, lambda q: -q), "stage.quaternion_sign", ROCKER),
    "quaternion": (sample(f"{ROCKER}.xformOp:orient", 7, lambda q: q * 0.9), "stage.quaternion", ROCKER),
    "step": (
        sample(f"{ROCKER}.xformOp:orient", 7, lambda q: q * Gf.Quatf(0.6, 0, 0, 0.8)),
        "stage.sample_step",
        ROCKER,
    ),
    "anchor": (
        sample(f"{ROCKER}.xformOp:translate", 7, lambda p: p + Gf.Vec3d(0, 0, 5e-5)),
        "stage.anchor",
        "/bars/joints/rocker_joint",
    ),
    "axis": (
        sample(f"{ROCKER}.xformOp:orient", 7, lambda q: q * Gf.Quatf(0.99999, 0.00447, 0, 0)),
        "stage.axis",
        CLOSING,
    ),
    "state": (
        sample(f"{ELBOW}.state:angular:physics:position", 7, lambda a: a + 1),
        "stage.state",
        ELBOW,
    ),
    "limits": (put(f"{CRANK}.physics:upperLimit", 80.0), "stage.beyond_limits", CRANK),
    "speed": (put(f"{CRANK}.physxJoint:maxJointVelocity", 60.0), "stage.speed", CRANK),
    "radian_speed": (put(f"{CRANK}.physxJoint:maxJointVelocity", 90 * DEG), "stage.radians", CRANK),
}


@pytest.mark.parametrize("name", SAMPLED)
def test_each_defect_of_a_motion_is_named(name, clean, tmp_path):
    spoil, code, where = SAMPLED[name]
    findings = check_stage(seeded(clean, tmp_path, spoil, "bars_swing.usda"))
    named = {(f.code, f.where): f for f in findings}
    assert (code, where) in named
    if name in ("anchor", "axis", "state"):
        assert named[code, where].when == "time code 7 (0.1167 s)"


@pytest.mark.parametrize("name", ["time_range", "sign", "quaternion", "anchor", "state"])
def test_public_validators_miss_it_in_a_motion(name, clean, tmp_path):
    assert run_usd_validators(seeded(clean, tmp_path, SAMPLED[name][0], "bars_swing.usda")) == []


# --- other joint types -----------------------------------------------------------------------------

SLIDE, BALL, SLEEVE, WELD = (f"/slider/joints/{n}" for n in ("slide", "ball_joint", "sleeve", "weld"))


def turned(joint, side=0):
    """Return an edit that turns a joint frame by 1.15 deg about x."""

    def edit(stage):
        attribute = stage.GetAttributeAtPath(f"{joint}.physics:localRot{side}")
        attribute.Set(attribute.Get() * Gf.Quatf(0.99995, 0.01, 0, 0))

    return edit


def moved(joint, by, side=0):
    def edit(stage):
        attribute = stage.GetAttributeAtPath(f"{joint}.physics:localPos{side}")
        attribute.Set(attribute.Get() + Gf.Vec3f(*by))

    return edit


@pytest.mark.parametrize(
    ("spoil", "code", "where"),
    [
        (turned(SLIDE), "stage.axis", SLIDE),
        (moved(SLIDE, (1e-3, 0, 0), 1), "stage.anchor", SLIDE),
        (moved(SLIDE, (0, 0, 1e-3), 1), "stage.state", SLIDE),
        (moved(BALL, (0, 0, 1e-3)), "stage.anchor", BALL),
        (turned(SLEEVE), "stage.axis", SLEEVE),
        (moved(SLEEVE, (0, 1e-3, 0)), "stage.anchor", SLEEVE),
        (turned(WELD), "stage.axis", WELD),
        (moved(WELD, (0, 0, 1e-3)), "stage.anchor", WELD),
        (put(f"{SLIDE}.state:linear:physics:position", 30.0), "stage.state", SLIDE),
        (put(f"{SLIDE}.physics:upperLimit", 0.02), "stage.beyond_limits", SLIDE),
    ],
    ids=lambda v: v.rpartition("/")[2] if isinstance(v, str) else "",
)
def test_frames_of_other_joint_types(spoil, code, where, clean, tmp_path):
    findings = check_stage(seeded(clean, tmp_path, spoil, "slider/slider.usda"))
    assert (code, where) in {(f.code, f.where) for f in findings}


@pytest.mark.parametrize(
    "spoil",
    [turned(BALL), moved(SLEEVE, (0, 0, 1e-3))],
    ids=["ball turns", "sleeve slides"],
)
def test_free_directions_are_free(spoil, clean, tmp_path):
    assert check_stage(seeded(clean, tmp_path, spoil, "slider/slider.usda")) == []


def test_limits_in_radians(clean, tmp_path):
    def spoil(stage):
        joint = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath(CRANK))
        joint.GetLowerLimitAttr().Set(-float(np.pi) / 2)
        joint.GetUpperLimitAttr().Set(float(np.pi) / 2)
        UsdPhysics.DriveAPI(joint.GetPrim(), "angular").GetTargetPositionAttr().Set(0.0)

    findings = check_stage(seeded(clean, tmp_path, spoil))
    assert [(f.code, f.where) for f in findings] == [("stage.radians", CRANK)]


def test_small_limits_in_degrees_are_no_radians(clean, tmp_path):
    """A flexure of +-1.5 deg is legitimate."""

    def spoil(stage):
        for name in ("lowerLimit", "upperLimit"):
            attribute = stage.GetAttributeAtPath(f"{CRANK}.physics:{name}")
            attribute.Set(70.0 + (1.5 if name == "upperLimit" else -1.5))

    assert check_stage(seeded(clean, tmp_path, spoil)) == []


def test_whole_turns_do_not_matter(clean, tmp_path):
    path = seeded(clean, tmp_path, put(f"{ELBOW}.state:angular:physics:position", 360 - 43.374336))
    assert check_stage(path) == []


def test_a_stage_without_mechanism_could_not_be_checked(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "empty.usda"))
    stage.GetRootLayer().Save()
    findings = check_stage(tmp_path / "empty.usda")
    assert findings[0].code == "stage.empty"
    assert verdict(findings) == "unchecked"


def test_a_missing_file_raises(tmp_path):
    with pytest.raises(StageError, match="there is no file"):
        check_stage(tmp_path / "nothing.usda")


def test_loops_without_exclusion_name_the_others(clean, tmp_path):
    (finding,) = check_stage(seeded(clean, tmp_path, PRINTED["loop"][0]))
    for name in ("rocker_joint", "crank_joint", "elbow"):
        assert name in finding.message
