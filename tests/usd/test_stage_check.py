"""The stage checker: silent on a clean stage; each seeded defect is named, with its prim."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from made import mechanisms as made
from made.stage_faults import CLOSING, CRANK, ELBOW, MORE, PRINTED, _op_type, put
from twin.core.errors import StageError
from twin.core.findings import verdict
from twin.core.units import DEG, MM
from twin.usd.check import check_stage, run_usd_validators
from twin.usd.read import read_stage
from twin.usd.write import BakedMotion, write_motion, write_stage


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A folder with the four-bar, its motion, and the slider in a folder of its own."""
    folder = tmp_path_factory.mktemp("clean")
    times = np.arange(31) / 60
    states = [made.four_bar_state(made.CRANK_AT_REST + 0.45 * np.sin(3 * t)) for t in times]
    motion = BakedMotion(
        "swing",
        times,
        {b: np.stack([s[0][b] for s in states]) for b in states[0][0]},
        {j: np.array([s[1][j] for s in states]) for j in states[0][1]},
    )
    write_stage(made.four_bar(), folder, *made.four_bar_state(made.CRANK_AT_REST))
    write_motion(made.four_bar(), folder, motion)
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


def prim_of(name):
    return lambda stage: stage.GetPrimAtPath(f"/bars/{name}")


@pytest.mark.parametrize("root", ["bars.usda", "bars_swing.usda", "slider/slider.usda"])
def test_a_clean_stage_has_no_findings(root, clean):
    assert check_stage(clean / root) == []


@pytest.mark.parametrize("name", [*PRINTED, *MORE])
def test_each_defect_is_named_with_its_prim(name, clean, tmp_path):
    spoil, code, where = {**PRINTED, **MORE}[name]
    findings = check_stage(seeded(clean, tmp_path, spoil))
    assert (code, where) in {(f.code, f.where) for f in findings}
    named = next(f for f in findings if (f.code, f.where) == (code, where))
    assert named.message
    assert not named.message.endswith(".")
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


@pytest.mark.parametrize("name", ["drive_missing", "no_drive_at_all", "drive_gains"])
def test_a_missing_drive_is_said_once(name, clean, tmp_path):
    found = [f for f in check_stage(seeded(clean, tmp_path, MORE[name][0])) if f.code == "stage.drive_missing"]
    assert [f.where for f in found] == [MORE[name][2]]
    assert CRANK in found[0].message


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


def test_two_time_codes_of_one_key_are_no_speed(clean, tmp_path):
    def keys_twice(stage):
        motion = Path(stage.GetRootLayer().realPath).parent / "motion" / "swing.usdc"
        stage.SetEditTarget(Sdf.Layer.Find(str(motion)))
        orient = stage.GetAttributeAtPath(f"{ROCKER}.xformOp:orient")
        for time in orient.GetTimeSamples()[1:]:
            orient.Set(orient.Get(time), np.nextafter(time, 0.0))

    findings = check_stage(seeded(clean, tmp_path, keys_twice, "bars_swing.usda"))
    assert "stage.speed" not in {f.code for f in findings}


def test_layers_are_reported_in_the_order_of_their_names(tmp_path):
    names = [f"layer_{k:02}.usda" for k in range(20)]
    for name in names:
        layer = Sdf.Layer.CreateNew(str(tmp_path / name))
        layer.pseudoRoot.SetInfo("metersPerUnit", 0.01)
        layer.Save()
    root = Sdf.Layer.CreateNew(str(tmp_path / "root.usda"))
    root.pseudoRoot.SetInfo("metersPerUnit", 1.0)
    root.subLayerPaths = [f"./{name}" for name in reversed(names)]
    root.Save()
    findings = check_stage(tmp_path / "root.usda")
    assert [f.where for f in findings if f.code == "stage.layer_units"] == names


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
        (put(f"{SLIDE}.drive:linear:physics:targetPosition", 0.0905), "stage.drive_target", SLIDE),
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


def test_a_body_without_a_finite_place_is_named_once_with_its_joints(clean, tmp_path):
    """A body on a ball joint alone, which has neither state nor limits, was found by nothing: NaN exceeds no limit."""
    nan = float("nan")

    def spoil(stage):
        stage.GetPrimAtPath("/bars/rocker").GetAttribute("xformOp:translate").Set(Gf.Vec3d(nan, 0, 0))

    path = seeded(clean, tmp_path, spoil)
    found = [finding for finding in check_stage(path) if finding.code == "stage.not_finite"]
    places = [finding.where for finding in found]
    assert "/bars/rocker" in places
    assert all(place == "/bars/rocker" or place.startswith("/bars/joints/") for place in places)
    assert len(places) == len(set(places)) >= 2
    with pytest.raises(StageError, match="/bars/rocker: a number of its transform is not finite"):
        read_stage(path)


def test_a_joint_frame_that_is_not_finite_is_named(clean, tmp_path):
    def spoil(stage):
        stage.GetPrimAtPath(ELBOW).GetAttribute("physics:localPos0").Set(Gf.Vec3f(float("nan"), 0, 0))

    found = check_stage(seeded(clean, tmp_path, spoil))
    assert [finding.where for finding in found if finding.code == "stage.not_finite"] == [ELBOW]


def test_a_scaled_body_is_measured_at_its_scaled_size(clean, tmp_path):
    """Bodies in mm with a scale of 0.001, as converters write them, were too large for their unit and their inertia."""

    def spoil(stage):
        body = UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker"))
        body.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(1e-3, 1e-3, 1e-3))
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual"))
        mesh.GetPointsAttr().Set([point * 1000 for point in mesh.GetPointsAttr().Get()])
        mesh.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
        center = UsdPhysics.MassAPI(body.GetPrim()).GetCenterOfMassAttr()
        center.Set(center.Get() * 1000)

    codes = {finding.code for finding in check_stage(seeded(clean, tmp_path, spoil)) if finding.where == "/bars/rocker"}
    assert codes == {"stage.scale"}
