"""Certificates of a proved workspace: a script and the audit check them without the prover."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import twin
from made.certificates import audited, digest, require_refusal, require_short
from made.scripts import script
from twin import cli
from twin.analysis.proven_workspace import proven_workspace
from twin.core.errors import TwinError

SCRIPT = Path(__file__).parents[2] / "docs/check_workspace.py"
CORNERS = np.array([0.39, 0.30, 0.16]), np.array([0.43, 0.34, 0.20])


@pytest.fixture(scope="module")
def checker():
    return script("docs/check_workspace.py")


@pytest.fixture(scope="module")
def found():
    return proven_workspace(twin.load("sils"), edge=0.01, corners=CORNERS)


@pytest.fixture
def certificate(found):
    return json.loads(json.dumps(found.certificate()))


def checked(checker, path, data, points="40"):
    data["sha256"] = digest(data)
    path.write_text(json.dumps(data))
    return checker.main([str(path), points])


def test_the_script_is_short_and_needs_the_standard_library_alone(checker):
    require_short(checker)


@pytest.mark.slow
def test_the_boxes_hold_for_script_and_audit(tmp_path, found, certificate, capsys):
    found.write(tmp_path)
    line = [sys.executable, "-I", str(SCRIPT), str(tmp_path / "certificate.json"), "100"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("holds: ")
    code, report = audited(tmp_path / "c.json", certificate, capsys, "--robot", "sils")
    assert code == 0
    assert {check["where"] for check in report["checks"]} == {"loops", "predictions", "limits", "cones", "derivatives"}


@pytest.mark.slow
def test_a_run_that_proves_no_box_leaves_no_certificate_of_an_earlier_one(tmp_path, capsys):
    (tmp_path / "certificate.json").write_text("{}")
    box = ["300", "320", "300", "320", "300", "320"]
    line = ["prove", "sils", "--workspace", "--edge-mm", "20", "--box-mm", *box, "--out", str(tmp_path)]
    assert cli.main(line) == 0
    assert "no box is proved free of singularities" in capsys.readouterr().out
    assert (tmp_path / "boxes.json").is_file()
    assert not (tmp_path / "certificate.json").exists()


@pytest.mark.slow
def test_tolerances_of_the_joints_make_fewer_boxes_and_a_gap_of_the_other_conditions(tmp_path, checker, found, capsys):
    wide = proven_workspace(twin.load("sils"), edge=0.01, corners=CORNERS, tolerance=1e-5)
    assert 0.9 * found.proof.volume < wide.proof.volume <= found.proof.volume
    # of the bars, six frames or more are off by 10 um along the axes, which are parallel
    assert 1e-5 < wide.proof.redundant < 2e-4
    assert "within 10 um of the CAD" in "\n".join(map(str, wide.text()))
    data = json.loads(json.dumps(wide.certificate()))
    assert checked(checker, tmp_path / "c.json", data) == 0
    code, report = audited(tmp_path / "c.json", data, capsys)
    assert code == 0
    # the CAD, and a mechanism within the tolerance at each point: loops that follow from others have a gap there
    gaps = [check["worst"] for check in report["checks"] if check["where"] == "loops"]
    assert max(gaps[:2]) < 1e-9 < gaps[2] < wide.proof.redundant
    # limits and cones are judged for both
    for judged in ("limits", "cones"):
        assert len([check for check in report["checks"] if check["where"] == judged]) == 2
    with pytest.raises(TwinError, match="tolerance of lengths is -10 um"):
        proven_workspace(twin.load("sils"), tolerance=-1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_what_was_changed_is_refused(tmp_path, checker, certificate, capsys, seed):
    require_refusal(checker, certificate, tmp_path / "c.json", capsys, seed)


@pytest.mark.slow
def test_a_limit_that_only_other_lengths_exceed_is_found(tmp_path, certificate, capsys):
    """One tiny box, so that a limit can be set 1 um below the value that it has there with the lengths of the CAD."""

    def judged():
        certificate["sha256"] = digest(certificate)
        return audited(tmp_path / "c.json", certificate, capsys)

    low, high, joints = certificate["boxes"][0]
    middle = (np.array(low) + np.array(high)) / 2
    certificate["boxes"] = [[(middle - 1e-9).tolist(), (middle + 1e-9).tolist(), joints]]
    limit = certificate["limits"][0]
    certificate["limits"] = [limit]
    limit["least"] += 1.0
    _, report = judged()
    excess = next(check["worst"] for check in report["checks"] if check["where"] == "limits")
    limit["least"] -= excess + 1e-6
    code, report = judged()
    assert code == 0, report["findings"]
    certificate["tolerance_m"] = 1e-5
    code, report = judged()
    assert code == 1
    assert any("a limit of joints is exceeded" in f["message"] for f in report["findings"]), report["findings"]


def wider(data):
    """Boxes that reach beyond the workspace."""
    for box in data["boxes"]:
        box[1][2] += 0.3


def other_limit(data):
    data["limits"][0]["least"] += 1.0


def other_length(data):
    """A closing joint at another place of its body: the loops close elsewhere, beyond limits, or not at all."""
    step = data["closures"][-1]["paths"][0]["steps"][-1]
    step[1][0][3] += 0.5


def no_motor(data):
    """With a motor less, the tool can move while the others are at rest."""
    data["active"][data["active"].index(True)] = False


@pytest.mark.slow
@pytest.mark.parametrize("change", [wider, other_limit, other_length, no_motor])
def test_what_was_changed_with_a_new_hash_fails(tmp_path, checker, certificate, capsys, change):
    change(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) in (1, 2)
    certificate["sha256"] = digest(certificate)
    assert audited(tmp_path / "c.json", certificate, capsys)[0] in (1, 2)


@pytest.mark.slow
def test_a_turned_frame_that_is_no_rotation_is_refused(tmp_path, checker, certificate):
    certificate["closures"][0]["paths"][0]["steps"][0][1][0][0] += 1e-9
    assert checked(checker, tmp_path / "c.json", certificate) == 2


def not_finite(data):
    """A closing joint somewhere: where a comparison with it is false, its loop would not be judged."""
    data["closures"].append(json.loads(json.dumps(data["closures"][0])))
    for row in data["closures"][-1]["paths"][0]["steps"][-1][1]:
        row[3] = float("nan")


def far_box(data):
    data["boxes"].append([[math.inf] * 3, [math.inf] * 3, data["boxes"][0][2]])


def empty_box(data):
    data["boxes"][-1][1] = data["boxes"][-1][0]


def box_twice(data):
    data["boxes"] *= 2


def negative_tolerance(data):
    data["tolerance_m"] = -1e-6


@pytest.mark.parametrize("change", [not_finite, far_box, empty_box, box_twice, negative_tolerance])
def test_boxes_and_numbers_that_make_no_sense_are_refused(tmp_path, checker, certificate, capsys, change):
    change(certificate)
    assert checked(checker, tmp_path / "c.json", certificate, "5") == 2
    if change is not not_finite:
        assert audited(tmp_path / "c.json", certificate, capsys)[0] == 2


def test_a_large_box_beyond_reach_is_met_among_many_small_ones(tmp_path, checker, certificate, capsys):
    """Points are drawn by volume: one box in a hundred can be nearly all of it."""
    certificate["boxes"].append([[5.0] * 3, [6.0] * 3, certificate["boxes"][0][2]])
    assert checked(checker, tmp_path / "c.json", certificate, "3") == 1
    assert capsys.readouterr().out.startswith("UNDECIDED: 0 points hold, 3 points undecided")


@pytest.mark.parametrize("points", ["0", "-5"])
def test_no_point_is_no_check(tmp_path, checker, certificate, points):
    assert checked(checker, tmp_path / "c.json", certificate, points) == 2


def test_what_was_checked_is_counted_and_files_are_compared(tmp_path, checker, certificate, capsys):
    assert checked(checker, tmp_path / "c.json", certificate, "3") == 0
    closures, limits = len(certificate["closures"]), len(certificate["limits"])
    assert f"checked: {closures} closing joints, {limits} limits of joints" in capsys.readouterr().out
    for name in certificate["files"]:
        (tmp_path / name).write_text("another")
    assert checker.main([str(tmp_path / "c.json"), str(tmp_path), "3"]) == 2
    assert "is not the file that was proved" in capsys.readouterr().err


@pytest.mark.slow
def test_certificates_without_boxes_or_of_other_files_are_refused(tmp_path, checker, certificate, capsys):
    certificate["files"]["sils.py"] = "0" * 64
    certificate["sha256"] = digest(certificate)
    assert audited(tmp_path / "c.json", certificate, capsys, "--robot", "sils")[0] == 2
    certificate["boxes"] = []
    assert checked(checker, tmp_path / "c.json", certificate) == 2
    assert audited(tmp_path / "c.json", certificate, capsys)[0] == 2
