"""The audit: silent on a good bundle, whoever asks and however; and what it says of its own reading."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

import twin
from made.bundle import grave, swing, write_good
from made.lanes import contrasting
from twin.cli import main
from twin.core.errors import TwinError
from twin.exchange.audit import audit, key_times
from twin.exchange.audit.chain_poses import ChainStep, chain_end, solve_chain
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.poses import about, angle, from_seven, inverse, pose, quaternion, rotation, rpy, slerp, split
from twin.exchange.audit.report import finished
from twin.exchange.formats import audit_formats, family
from twin.exchange.formats.tracks import audit as tracks
from twin.exchange.formats.unity.audit import kinematics
from twin.exchange.formats.urdf.write import write_urdf

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_good(tmp_path_factory.mktemp("good") / "bars")


# --------------------------------------------------------------------------------------------- a good bundle


def test_a_good_bundle_has_no_findings(good):
    report = audit(good)
    assert grave(report.findings) == []
    assert report.verdict == "agree"
    assert report.exit_code == 0
    assert all(c.verdict == "agree" for c in report.checks)
    formats = {family(f["format"]) for f in report.files}
    assert formats == {format.name for format in audit_formats() if format.variants}


def test_every_reader_places_every_link_at_every_key(good):
    """Each format is compared with the closed form, to well below a micrometre."""
    clip = swing()
    report = audit(good, truth={"swing": (clip.times, clip.links)})
    assert grave(report.findings) == []
    rows = [c for c in report.checks if "position against the mechanism" in c.check]
    assert {c.file for c in rows} == {
        "tracks/swing.json",
        "tracks/swing.csv",
        "bars.glb",
        "usd/bars_swing.usda",
        "bars_ar.usdz",
        "bars.xml",
        "bars.urdf",
    }
    for row in rows:
        assert "4 links x 41 keys" in row.check
        assert row.worst is not None
        assert row.worst < 3e-7
    turned = [c for c in report.checks if "rotation against the mechanism" in c.check]
    assert len(turned) == len(rows)
    assert all(c.worst < 1e-6 for c in turned)


def test_a_wrong_truth_is_seen_in_every_file(good):
    clip = swing()
    moved = {n: T.copy() for n, T in clip.links.items()}
    moved["rocker"][7, 2, 3] += 3e-6
    report = audit(good, truth={"swing": (clip.times, moved)})
    blamed = {f.where for f in report.findings if f.code == "compare.pose"}
    assert {w.partition(":")[0] for w in blamed} >= {"tracks/swing.json", "bars.glb", "bars_ar.usdz", "bars.urdf"}
    (first, *_) = [f for f in report.findings if f.code == "compare.pose"]
    assert first.when == "t = 0.35 s"
    assert first.size == pytest.approx(3.0, abs=0.2)
    assert report.exit_code == 1


def test_conventions_are_reported(good):
    files = {f["format"]: f for f in audit(good).files}
    assert files["usdz"]["up_axis"] == "Y"
    assert files["usda"]["up_axis"] == "Z"
    assert files["glb"]["units"].startswith("m")
    assert files["glb"]["clips"] == [{"name": "swing", "keys": 41, "duration_s": 2.0}]


def test_the_report_is_plain_json(good):
    text = json.dumps(audit(good).as_dict(), allow_nan=False)
    assert json.loads(text)["verdict"] == "agree"


def test_key_times_come_from_the_tracks(good):
    assert key_times(good)["swing"] == pytest.approx(swing().times)


def test_a_single_file_is_audited_alone(good):
    for name in ("bars.glb", "bars_ar.usdz", "usd/bars.usda", "tracks/swing.json", "bars.xml", "bars.urdf"):
        assert grave(audit(good / name).findings) == [], name


@pytest.mark.slow
@pytest.mark.parametrize("robot", contrasting(sorted(p.name for p in (ROOT / "usd").iterdir())))
def test_committed_stages_at_rest_have_no_findings(robot):
    assert grave(audit(ROOT / "usd" / robot / f"{robot}.usda").findings) == []


# ------------------------------------------------------------------------------------------------ command line


def test_command_prints_a_table(good, capsys):
    assert main(["audit", str(good)]) == 0
    out = capsys.readouterr().out
    assert "PASS" in out
    assert "position against" in out
    assert "tolerance of poses: 1 µm" in out


def test_command_prints_json_and_exits_with_1(good, tmp_path, capsys):
    shutil.copytree(good, tmp_path / "bad")
    (tmp_path / "bad/README.txt").write_text("slipped in")
    (tmp_path / "bad/bars.urdf").unlink()
    assert main(["audit", str(tmp_path / "bad"), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"] == "disagree"
    codes = {f["code"] for f in data["findings"] if f["severity"] != "info"}
    assert codes == {"proof.missing", "proof.unlisted"}


def test_command_exits_with_2_where_nothing_can_be_read(tmp_path, capsys):
    (tmp_path / "x.glb").write_bytes(b"garbage")
    assert main(["audit", str(tmp_path / "x.glb")]) == 2
    assert main(["audit", str(tmp_path / "none")]) == 2
    assert "the file or folder does not exist" in capsys.readouterr().err
    (tmp_path / "x.usda").write_text("#usda 1.0\nhello")
    assert main(["audit", str(tmp_path / "x.usda")]) == 2
    said = capsys.readouterr().out
    assert "x.usda:2:1: syntax error at 'hello'" in said
    assert "pxr" not in said


def test_a_robot_that_the_files_do_not_show_is_refused(good, capsys):
    assert main(["audit", str(good), "--robot", "pa10"]) == 2
    assert "no clip has the name of a protocol of the robot" in capsys.readouterr().err


@pytest.mark.slow
def test_a_file_without_motion_is_compared_with_the_robot(tmp_path, capsys):
    """A URDF has no clips; its links, joints and masses are compared with the mechanism."""
    path = write_urdf(twin.load("hibou").weighed().mechanism, tmp_path)
    assert main(["audit", str(path), "--robot", "hibou"]) == 0
    text = path.read_text()
    lower = re.search(r'lower="([^"]+)"', text)
    assert lower
    path.write_text(text.replace(lower[0], f'lower="{float(lower[1]) - 0.01}"', 1))
    capsys.readouterr()
    assert main(["audit", str(path), "--robot", "hibou"]) == 1
    said = capsys.readouterr().out
    assert "in the mechanism they are" in said or "in the mechanism it is" in said
    assert "export the file again; if its value is the right one, correct the robot" in said


@pytest.mark.parametrize("name", ["x.step", "notes.txt"])
def test_other_files_are_refused(name, tmp_path):
    (tmp_path / name).write_text("?")
    with pytest.raises(TwinError, match="cannot be audited"):
        audit(tmp_path / name)
    with pytest.raises(TwinError, match="the folder has no file that can be audited"):
        audit(tmp_path)


# ------------------------------------------------------------------------------------------------- own maths


def test_quaternions_agree_with_usd(rng):
    """The audit's own maths against a library that it does not use for maths."""
    q = rng.normal(size=(50, 4))
    for row, R in zip(q, rotation(q), strict=True):
        unit = row / np.linalg.norm(row)
        gf = np.array(Gf.Matrix3d(Gf.Quatd(unit[3], *unit[:3]))).T
        assert np.abs(R - gf).max() < 1e-14


def test_quaternion_and_rotation_are_inverse(rng):
    q = rng.normal(size=(200, 4))
    q[:4] = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    back = quaternion(rotation(q))
    assert np.abs(np.abs(np.sum(back * q, axis=1)) - 1).max() < 1e-14


def test_angle_is_exact_for_small_and_large_turns():
    a = np.array([0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi])
    R = about([0.6, 0, 0.8], a)
    assert angle(R, np.eye(3)) == pytest.approx(a, rel=1e-7, abs=1e-15)


def test_poses_invert_and_split(rng):
    T = from_seven(rng.normal(size=(5, 7)))
    assert np.abs(T @ inverse(T) - np.eye(4)).max() < 1e-14
    rigid, size = split(T @ np.diag([2.0, 3.0, 4.0, 1.0]))
    assert np.abs(rigid - T).max() < 1e-14
    assert size == pytest.approx(np.tile([2.0, 3.0, 4.0], (5, 1)))
    assert split(np.diag([1.0, -1.0, 1.0, 1.0]))[1][0] == -1


def test_slerp_goes_the_short_way_at_constant_speed():
    q = np.array([[0, 0, np.sin(a / 2), np.cos(a / 2)] for a in (0.0, 1.0)])
    for sign in (1, -1):
        R = rotation(slerp(q[:1], sign * q[1:], np.array([0.25])))
        assert angle(R[0], about([0, 0, 1], np.array(0.25))) < 1e-15


def test_rpy_turns_about_fixed_axes():
    assert np.abs(rpy([0.1, 0.2, 0.3]) @ [0, 0, 1] - np.array(_fixed_axes(0.1, 0.2, 0.3))[:, 2]).max() < 1e-15


def _fixed_axes(r, p, y):
    stage = Usd.Stage.CreateInMemory()
    op = UsdGeom.Xform.Define(stage, "/a").AddRotateXYZOp(UsdGeom.XformOp.PrecisionDouble)
    op.Set(Gf.Vec3d(*np.degrees([r, p, y])))
    return np.array(UsdGeom.Xformable(stage.GetPrimAtPath("/a")).GetLocalTransformation())[:3, :3].T


def test_values_of_a_ball_are_found_from_its_poses(rng):
    chain = [ChainStep(pose(about([1, 0, 0], 0.3), [0.1, 0.2, 0.3]), "turn", axis) for axis in np.eye(3)]
    q = rng.uniform(-1.2, 1.2, size=(3, 40))
    goal = chain_end(chain, list(q), 40)
    found = solve_chain(chain, [None, None, None], goal)
    assert np.abs(chain_end(chain, found, 40) - goal).max() < 1e-9


@pytest.mark.slow
def test_the_audit_loads_no_writer():
    load = "[format.module('audit') for format in audit_formats()]"
    code = f"import sys; from twin.exchange.formats import audit_formats; {load}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = set(done.stdout.split())
    wrong = ("twin.exchange.write", "twin.usd.write", "twin.reference", "twin.planning", "casadi", "pinocchio")
    assert not {m for m in loaded if m.startswith(wrong)}
    parts = [m.split(".") for m in loaded if m.startswith("twin.exchange.formats.")]
    assert not {".".join(p) for p in parts if len(p) > 4 and p[4] in ("write", "read")}


@pytest.mark.parametrize("extensions", ["", ', "extensionsUsed": ["X_strange"]'])  # which is a warning
def test_a_file_with_nothing_in_it_is_not_passed(tmp_path, extensions):
    path = tmp_path / "bare.gltf"
    path.write_text(f'{{"asset": {{"version": "2.0"}}{extensions}}}')
    report = audit(path)
    assert (report.verdict, report.exit_code) == ("unchecked", 2)
    assert report.findings[0].code == "audit.no_checks"


def _track_of_two_keys(**changes) -> dict:
    track = {
        "schema": "twin-track",
        "version": 1,
        **tracks._CONVENTIONS,
        "links": ["arm"],
        "joints": ["q"],
        "times": [0, 1],
    }
    track |= {"joint_types": ["revolute"], "poses": [0, 0, 0, 0, 0, 0, 1] * 2, "positions": [0, 0]}
    return track | {"joint_lower": [-1], "joint_upper": [1]} | changes


def test_a_limit_that_is_not_finite_is_reported_once(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(_track_of_two_keys(joint_upper=[float("inf")])))
    ledger = Ledger("a.json")
    content = tracks.read_json(path, ledger)
    assert content.extra["upper"] == {"q": float("inf")}
    messages = [f.message for f in ledger.found if "finite" in f.message]
    assert messages == ["joint_upper contains numbers that are not finite."]


@pytest.mark.parametrize(
    ("key", "value", "fault"),
    [
        ("joint_lower", ["-1 deg"], "entry 0 is '-1 deg', expected a number"),
        ("joint_lower", ["-1"], "entry 0 is '-1', expected a number"),
        ("joint_upper", "none", "is 'none', expected a flat list of numbers"),
        ("tool_frame", [0, 0, 0, 0, 0, 0, {}], "entry 6 is '{}', expected a number"),
        ("poses", [0, 0, 0, 0, 0, "x", 1] * 2, "entry 5 is 'x', expected a number"),
        ("times", [[0], [1, 2]], "is not a flat list"),
        ("times", [[0], [1]], "is not a flat list"),
        ("times", 5, "is '5', expected a flat list of numbers"),
        ("joint_lower", [None], "entry 0 is 'null', expected a number"),
        ("joint_lower", [True], "entry 0 is 'true', expected a number"),
        ("tool_frame", ["0.5", None], "entry 0 is '0.5', expected a number"),
    ],
)
def test_what_is_no_number_in_a_track_is_named(tmp_path, key, value, fault):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(_track_of_two_keys(**{key: value})))
    with pytest.raises(ReadError) as raised:
        tracks.read_json(path, Ledger("a.json"))
    assert f"'{key}'" in str(raised.value)
    assert fault in str(raised.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("tool_frame", [float("nan"), 0, 0, 0, 0, 0, 1]),
        ("phase_rcm", [float("inf")]),
        ("phase_has_rcm", [float("nan")]),
    ],
)
def test_a_pose_of_the_tool_and_an_rcm_that_are_not_finite_are_reported(tmp_path, key, value):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(_track_of_two_keys(**{key: value})))
    ledger = Ledger("a.json")
    tracks.read_json(path, ledger)
    assert f"{key} contains numbers that are not finite." in [finding.message for finding in ledger.found]


@pytest.mark.parametrize(
    ("frame", "axis", "hand"),
    [("z-up right-handed", "Z", "right"), ("y-up left-handed", "Y", "left"), ("sideways", "?", "?")],
)
def test_the_frame_of_a_track_is_the_one_that_it_states(tmp_path, frame, axis, hand):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(_track_of_two_keys(frame=frame)))
    content = tracks.read_json(path, Ledger("a.json"))
    assert (content.facts["up_axis"], content.facts["handedness"]) == (axis, hand)


def test_a_package_of_two_classes_has_no_robot_even_if_one_is_unreadable(tmp_path, monkeypatch):
    (tmp_path / kinematics.ROBOTS).mkdir(parents=True)
    for name in ("A", "B"):
        (tmp_path / kinematics.ROBOTS / f"{name}.cs").write_text(name)

    def content_of(text, ledger):
        if text == "B":
            raise KeyError("links")
        return text

    monkeypatch.setattr(kinematics, "_content", content_of)
    ledger = Ledger("unity")
    assert kinematics.read_classes(tmp_path, ledger) is None
    assert any("the tables of Runtime/Robots/B.cs cannot be read" in f.message for f in ledger.found)
    (tmp_path / kinematics.ROBOTS / "B.cs").unlink()
    assert kinematics.read_classes(tmp_path, ledger) == "A"


def test_warnings_alone_do_not_pass():
    ledger = Ledger("a")
    ledger.add("name", "warning", "a name.")
    assert finished("a", [], [ledger]).verdict == "unchecked"


def test_a_file_without_anything_to_check_is_not_passed(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text('<robot name="bare"><link name="base"/></robot>')
    report = audit(path)
    assert (report.verdict, report.checks) == ("unchecked", [])
    assert report.exit_code == 2
    assert "nothing that can be checked" in report.findings[0].message
    assert "--robot NAME" in report.findings[0].suggestion
