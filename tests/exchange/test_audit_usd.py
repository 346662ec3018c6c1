"""Seeded defects in USD: each is one edit of a good stage, and the audit names it."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from made import bundle as base
from made import stage_faults as seeds
from made.lanes import thinned
from twin.exchange.audit import audit

VISUAL = "/bars/rocker/rocker_visual"
PLAYED = "usd/bars_swing.usda"


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    """The stage of the four-bar with its motion, its AR file, and the track to hold them against."""
    whole = base.write_good(tmp_path_factory.mktemp("good") / "bars")
    part = whole.with_name("part")
    for name in ("usd", "tracks"):
        shutil.copytree(whole / name, part / name)
    shutil.copy(whole / "bars_ar.usdz", part)
    return part


# ------------------------------------------------------------------------------- edits of the stage, by layer


def motion(stage) -> Sdf.Layer:
    """Return the layer with the time samples."""
    return Sdf.Layer.Find(str(Path(stage.GetRootLayer().realPath).parent / "motion" / "swing.usdc"))


def sample(path: str, frame: int, change):
    """Return an edit of one time sample."""

    def edit(stage):
        layer = motion(stage)
        code = layer.ListTimeSamplesForPath(path)[frame]
        layer.SetTimeSample(path, code, change(layer.QueryTimeSample(path, code)))

    return edit


def samples(path: str, change):
    """Return an edit of all time samples of an attribute."""

    def edit(stage):
        layer = motion(stage)
        for code in layer.ListTimeSamplesForPath(path):
            layer.SetTimeSample(path, code, change(layer.QueryTimeSample(path, code)))

    return edit


def swap(stage):
    layer = motion(stage)
    a, b = (layer.GetPrimAtPath(f"/bars/{n}") for n in ("crank", "rocker"))
    for name in ("xformOp:translate", "xformOp:orient"):
        pa, pb = a.properties[name].path, b.properties[name].path
        one, two = ({c: layer.QueryTimeSample(p, c) for c in layer.ListTimeSamplesForPath(p)} for p in (pa, pb))
        for c in one:
            layer.SetTimeSample(pa, c, two[c])
            layer.SetTimeSample(pb, c, one[c])


def slower(stage):
    for layer in stage.GetUsedLayers():
        if not layer.anonymous:
            layer.timeCodesPerSecond = layer.framesPerSecond = 24.0


def no_binding_api(stage):
    stage.GetPrimAtPath(VISUAL).RemoveAPI(UsdShade.MaterialBindingAPI)


def dangling_material(stage):
    stage.GetPrimAtPath(VISUAL).GetRelationship("material:binding").SetTargets(["/bars/materials/nothing"])


def missing_reference(stage):
    stage.GetPrimAtPath("/bars/rocker").GetReferences().AddReference("./nothing.usda")


def missing_sublayer(stage):
    stage.GetRootLayer().subLayerPaths.append("./nothing.usda")


def normals_turned(stage):
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(VISUAL)).GetPrimvar("normals")
    primvar.Set([-n for n in primvar.Get()])


def one_face_turned(stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(VISUAL))
    indices = list(mesh.GetFaceVertexIndicesAttr().Get())
    mesh.GetFaceVertexIndicesAttr().Set([indices[0], indices[2], indices[1], *indices[3:]])


def not_finite(stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(VISUAL))
    points = list(mesh.GetPointsAttr().Get())
    mesh.GetPointsAttr().Set([Gf.Vec3f(float("nan"), 0, 0), *points[1:]])


def extra_link(stage):
    body = UsdGeom.Xform.Define(stage, "/bars/spare").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(body)
    UsdPhysics.MassAPI.Apply(body).CreateMassAttr(1.0)


def lost_link(stage):
    stage.GetPrimAtPath("/bars/rocker").SetActive(False)


def half_range(stage):
    stage.SetEndTimeCode(60)


TRANSLATE, ORIENT = (f"/bars/rocker.xformOp:{n}" for n in ("translate", "orient"))
STATE = "/bars/joints/elbow.state:angular:physics:position"
MIRROR = Gf.Vec3d(1, -1, 1)


def of_survey(name: str):
    """Return an edit of the tests of the stage checker."""
    return {**seeds.PRINTED, **seeds.MORE}[name][0]


LISTED = {
    # what a survey of public validators seeded: UsdValidation saw 9 of these 28, the asset validator 13
    "no up axis": (of_survey("up_axis_missing"), "stage.up_axis"),
    "no unit": (of_survey("meters_missing"), "stage.meters_per_unit"),
    "no default prim": (of_survey("default_prim"), "stage.default_prim"),
    "negative mass": (of_survey("mass"), "stage.mass"),
    "no MaterialBindingAPI": (no_binding_api, "usd.material_api"),
    "dangling material": (dangling_material, "usd.material"),
    "missing reference": (missing_reference, "usd.unreadable"),
    "dangling body": (of_survey("dangling"), "stage.joint"),
    "scaled body": (of_survey("scale"), "stage.scale"),
    "extent": (of_survey("extent"), "stage.extent"),
    "winding": (of_survey("winding"), "stage.winding"),
    "point index": (of_survey("point_index"), "stage.point_index"),
    "no subdivision scheme": (of_survey("subdivision"), "stage.subdivision"),
    "loop": (of_survey("loop"), "stage.loop"),
    "anchors apart": (of_survey("anchor"), "usd.joint_gap"),
    "joint axis": (of_survey("axis"), "stage.axis"),
    "inertia": (of_survey("inertia"), "stage.inertia"),
    "centre of mass in mm": (of_survey("com_in_mm"), "stage.com"),
    "limits swapped": (of_survey("limits"), "stage.limits"),
    "no articulation root": (of_survey("articulation_root"), "stage.articulation_root"),
    "nested body": (of_survey("nested"), "stage.nested"),
    "radians in degrees": (of_survey("radians"), "stage.radians"),
    "quaternion not unit": (of_survey("quaternion"), "stage.quaternion"),
    "no kilograms": (of_survey("kilograms"), "stage.kilograms_per_unit"),
    "samples outside": (half_range, "stage.time_range"),
    "mirrored": (of_survey("mirrored"), "stage.mirrored"),
    "no mass": (of_survey("mass_missing"), "stage.mass_missing"),
    "op of a wrong type": (of_survey("op_type"), "usd.unreadable"),
}

MOVED = {
    # what only a comparison with the motion can see, and more
    "one sample off": (sample(TRANSLATE, 9, lambda p: p + Gf.Vec3d(0, 0, 2e-6)), "compare.pose"),
    "one sample turned": (
        sample(ORIENT, 9, lambda q: (q * Gf.Quatd(1, 2e-4, 0, 0)).GetNormalized()),
        "compare.pose",
    ),
    "millimetres": (samples(TRANSLATE, lambda p: p * 1000), "compare.pose"),
    "mirrored frame": (samples(TRANSLATE, lambda p: Gf.Vec3d(p[0], -p[1], p[2])), "compare.pose"),
    "wxyz order": (
        samples(ORIENT, lambda q: Gf.Quatd(q.GetImaginary()[2], q.GetReal(), *list(q.GetImaginary())[:2])),
        "compare.pose",
    ),
    "swapped links": (swap, "compare.pose"),
    "sign flip": (sample(ORIENT, 9, lambda q: -q), "stage.quaternion_sign"),
    "sample not unit": (sample(ORIENT, 9, lambda q: q * 0.5), "stage.quaternion"),
    "sample not finite": (sample(TRANSLATE, 9, lambda p: Gf.Vec3d(float("nan"), 0, 0)), "usd.finite"),
    "frame rate": (slower, "compare.times"),
    "joint state in radians": (samples(STATE, np.radians), "compare.joint"),
    "lost link": (lost_link, "compare.missing_link"),
    "extra link": (extra_link, "compare.extra_link"),
    "missing sublayer": (missing_sublayer, "usd.unreadable"),
    "normals against the winding": (normals_turned, "usd.normals_against"),
    "one face turned": (one_face_turned, "usd.winding_mixed"),
    "points not finite": (not_finite, "usd.finite"),
    "duplicate leaf": (of_survey("duplicate_name"), "stage.duplicate_name"),
}


def spoilt(good: Path, folder: Path, spoil, root: str = PLAYED) -> Path:
    """Copy the good files, edit the stage, and return the folder."""
    shutil.copytree(good, folder, dirs_exist_ok=True)
    stage = Usd.Stage.Open(str(folder / root))
    spoil(stage)
    for layer in [*stage.GetUsedLayers(), motion(stage)]:
        if layer.dirty and not layer.anonymous:
            layer.Save()
    return folder


def test_the_good_stage_has_no_findings(good):
    assert base.grave(audit(good).findings) == []


@pytest.mark.parametrize("name", thinned([*LISTED, *MOVED], every=12))
def test_each_defect_is_named(name, good, tmp_path):
    spoil, code = {**LISTED, **MOVED}[name]
    report = audit(spoilt(good, tmp_path, spoil))
    found = [f for f in base.grave(report.findings) if f.code == code]
    assert found, [(f.code, f.message) for f in report.findings]
    assert report.exit_code > 0 or found[0].severity == "warning"
    assert found[0].message
    assert found[0].where.startswith(("usd/", "bars_ar"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("swapped links", "links 'crank' and 'rocker' are swapped"),
        ("frame rate", "the clip lasts 5 s; in tracks/swing.json it lasts 2 s (ratio 2.5)"),
        ("joint state in radians", "degrees instead of radians"),
    ],
)
def test_the_mistake_is_guessed(name, reason, good, tmp_path):
    report = audit(spoilt(good, tmp_path, MOVED[name][0]))
    assert any(reason in f.message for f in report.findings), [f.message for f in report.findings]


def test_a_sample_that_is_off_is_located(good, tmp_path):
    report = audit(spoilt(good, tmp_path, MOVED["one sample off"][0]))
    (finding,) = [f for f in report.findings if f.code == "compare.pose"]
    assert finding.where == "usd/bars_swing.usda: rocker"
    assert finding.when == "t = 0.45 s"
    assert finding.size == pytest.approx(2.0, abs=0.1)
    assert finding.unit == "um"


# -------------------------------------------------------------------------------------------------- archives


def test_a_compressed_archive_is_refused_by_readers(good, tmp_path):
    with (
        zipfile.ZipFile(good / "bars_ar.usdz") as old,
        zipfile.ZipFile(tmp_path / "x.usdz", "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name in old.namelist():
            new.writestr(name, old.read(name))
    assert "usdz.compressed" in {f.code for f in audit(tmp_path / "x.usdz").findings}


def test_an_archive_out_of_line_is_named(good, tmp_path):
    with zipfile.ZipFile(good / "bars_ar.usdz") as old, zipfile.ZipFile(tmp_path / "x.usdz", "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name))
    assert "usdz.alignment" in {f.code for f in audit(tmp_path / "x.usdz").findings}


def test_layers_in_an_archive_are_a_warning(good, tmp_path):
    from pxr import UsdUtils

    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(good / PLAYED)), str(tmp_path / "x.usdz"))
    codes = {f.code: f.severity for f in audit(tmp_path / "x.usdz").findings}
    assert codes["usdz.layers"] == "warning"
    assert codes["usd.ar_physics"] == "warning"


# -------------------------------------------------------------------------------------- stages of other people


def foreign(path: Path, up: str = "Y", meters: float = 0.01, mechanism: bool = False) -> Path:
    """Write a spinning cube as another program would: centimetres, y up, 24 frames a second."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(49)
    root = UsdGeom.Xform.Define(stage, "/world")
    stage.SetDefaultPrim(root.GetPrim())
    cube = UsdGeom.Xform.Define(stage, "/world/cube")
    move, turn = cube.AddTranslateOp(), cube.AddRotateYOp()
    for code in range(1, 50, 12):
        move.Set(Gf.Vec3d(100, 50, 0), code)
        turn.Set(30.0 * (code - 1) / 12, code)
    UsdGeom.Cube.Define(stage, "/world/cube/body")
    if mechanism:
        UsdPhysics.RigidBodyAPI.Apply(cube.GetPrim())
    stage.GetRootLayer().Save()
    return path


@pytest.mark.parametrize("suffix", ["usd", "usda", "usdc"])
def test_units_and_up_axis_of_a_foreign_stage_are_honoured(suffix, tmp_path):
    from twin.exchange.audit.ledger import Ledger
    from twin.exchange.formats.usd.audit import read_usd

    content = read_usd(foreign(tmp_path / f"x.{suffix}"), Ledger("x"))
    (clip,) = content.clips
    assert clip.times == pytest.approx([0, 0.5, 1, 1.5, 2])
    assert clip.links["cube"][0, :3, 3] == pytest.approx([1.0, 0.0, 0.5])
    turned = clip.links["cube"][0].T @ clip.links["cube"][1]
    assert np.degrees(np.arccos((np.trace(turned[:3, :3]) - 1) / 2)) == pytest.approx(30)


@pytest.mark.slow
def test_a_foreign_stage_is_audited_without_names_to_compare(tmp_path):
    report = audit(foreign(tmp_path / "x.usda"))
    assert report.verdict in ("agree", "disagree")
    assert not [f for f in report.findings if f.severity == "error"]
    assert not [f for f in report.findings if f.code == "stage.up_axis" and f.severity != "info"]
    assert audit(foreign(tmp_path / "y.usda", mechanism=True)).verdict == "disagree"  # a body without a mass


def test_a_joint_without_bodies_is_no_malformed_file(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "x.usda"))
    root = UsdGeom.Xform.Define(stage, "/robot")
    stage.SetDefaultPrim(root.GetPrim())
    for name in ("arm", "hand"):
        UsdGeom.Xform.Define(stage, f"/robot/{name}")
    joint = UsdPhysics.RevoluteJoint.Define(stage, "/robot/wrist")
    joint.CreateBody0Rel().SetTargets(["/robot/arm"])
    joint.CreateBody1Rel().SetTargets(["/robot/hand"])
    stage.Save()
    report = audit(tmp_path / "x.usda")
    assert report.verdict == "disagree"
    assert "JointNoEnabledRigidBody" in " ".join(finding.code for finding in report.findings)


def test_a_mesh_of_lines_with_normals_is_no_malformed_file(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "x.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    root = UsdGeom.Xform.Define(stage, "/robot")
    stage.SetDefaultPrim(root.GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/robot/line")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0)])
    mesh.CreateFaceVertexCountsAttr([2])
    mesh.CreateFaceVertexIndicesAttr([0, 1])
    mesh.CreateNormalsAttr([(0, 0, 1), (0, 0, 1)])
    stage.Save()
    assert not [f for f in audit(tmp_path / "x.usda").findings if f.severity == "error"]
