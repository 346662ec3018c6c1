"""Certificates of bounds over all joint values: a script and the audit check them without the prover."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import twin
from made.certificates import audited, digest, require_refusal, require_short
from made.scripts import script
from twin.api.chain_bounds import chain_bounds, mechanism_bounds

SCRIPT = Path(__file__).parents[2] / "docs/check_bounds.py"
CHAINS = ("davinci_psm", "davinci_psm_si", "pa10", "raven_left", "raven_right")


@pytest.fixture(scope="module")
def checker():
    return script("docs/check_bounds.py")


@pytest.fixture(scope="module")
def found():
    return chain_bounds(twin.load("davinci_ecm"), tolerance=1e-5)


@pytest.fixture
def certificate(found):
    return json.loads(json.dumps(found.certificate()))


def checked(checker, path, data):
    data["sha256"] = digest(data)
    path.write_text(json.dumps(data))
    return checker.main([str(path)])


def test_the_script_is_short_and_needs_the_standard_library_alone(checker):
    require_short(checker)


@pytest.mark.parametrize("name", ["davinci_ecm", *(pytest.param(name, marks=pytest.mark.slow) for name in CHAINS)])
@pytest.mark.parametrize("tolerance", [0.0, 1e-5])
def test_the_bounds_of_all_chains_hold(tmp_path, checker, capsys, name, tolerance):
    data = chain_bounds(twin.load(name), tolerance=tolerance).certificate()
    assert checked(checker, tmp_path / "c.json", data) == 0
    code, report = audited(tmp_path / "c.json", data, capsys, "--robot", name)
    assert code == 0
    assert [check["where"] for check in report["checks"]] == ["origins of the tool", "orientations of the tool"]
    assert all(check["worst"] <= check["tolerance"] + 1e-12 for check in report["checks"])
    (note,) = report["findings"]
    assert (note["code"], note["severity"]) == ("certificate.samples", "info")
    assert "4096 random states were compared, which proves no bound" in note["message"]


def test_the_script_holds_in_a_process_of_its_own(tmp_path, found):
    found.write(tmp_path)
    line = [sys.executable, "-I", str(SCRIPT), str(tmp_path / "certificate.json")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("holds: ") == 2


@pytest.mark.slow
def test_two_mechanisms_of_different_numbers(tmp_path, checker, capsys):
    data = mechanism_bounds(twin.load("raven_left"), twin.load("raven_left")).certificate()
    assert checked(checker, tmp_path / "c.json", data) == 0
    frame = next(value for kind, value in data["sides"][1]["chain"] if kind == "frame")
    frame[0][3] += 1e-4
    assert checked(checker, tmp_path / "c.json", data) == 1
    assert "found 0.0001" in capsys.readouterr().out
    assert audited(tmp_path / "c.json", data, capsys)[0] == 1


@pytest.mark.parametrize("seed", range(50))
def test_what_was_changed_is_refused(tmp_path, checker, certificate, capsys, seed):
    require_refusal(checker, certificate, tmp_path / "c.json", capsys, seed)


def bound(data):
    data["position_m"] *= 0.9


def number(data):
    row = next(row for row in data["sides"][0]["rows"] if row[0] == "number" and abs(float(row[1])) > 0.1)
    row[1] = repr(float(row[1]) + 1e-4)


def operation(data):
    row = next(row for row in data["sides"][0]["rows"] if row[0] == "sine")
    row[0] = "cosine"


def result(data):
    pose = data["sides"][0]["pose"]
    pose[0][3], pose[1][3] = pose[1][3], pose[0][3]


def width(data):
    """A wider range of a length than that of the bound."""
    length = next(v for v in data["variables"] if not v["angle"] and v["high"] - v["low"] < 1e-4)
    length["high"] += 1e-4


def frame(data):
    entry = data["sides"][1]["chain"][0][1]
    entry[0][3] += 1e-4


@pytest.mark.parametrize("change", [bound, number, operation, result, frame])
def test_what_was_changed_with_a_new_hash_fails(tmp_path, checker, certificate, capsys, change):
    change(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 1
    certificate["sha256"] = digest(certificate)
    if change is not bound:  # no random state need reach a bound that is a tenth too small
        assert audited(tmp_path / "c.json", certificate, capsys)[0] == 1


def missing(data):
    data["sides"][0]["rows"].pop()


def reversed_range(data):
    length = next(v for v in data["variables"] if not v["angle"])
    length["low"], length["high"] = length["high"], length["low"]


def skewed(data):
    data["sides"][1]["chain"][0][1][0][0] += 1e-9


@pytest.mark.parametrize("change", [missing, reversed_range, skewed])
def test_what_makes_no_sense_is_refused(tmp_path, checker, certificate, capsys, change):
    change(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 2
    if change is not skewed:  # at random states, a frame that is no rotation shows as a difference
        assert audited(tmp_path / "c.json", certificate, capsys)[0] == 2


def turning(angle, joints, variables, chain):
    """A certificate that a rotation by rows of equations is that of a mechanism."""
    rows = [*angle, ["cosine", 2], ["sine", 2], ["negative", 4], ["number", "0"], ["number", "1"]]
    pose = [[3, 5, 6, 6], [4, 3, 6, 6], [6, 6, 7, 6]]
    equations = {"name": "equations", "rows": rows, "pose": pose, "joints": joints}
    return {
        "schema": "twin/bounds-certificate/1",
        "files": {},
        "variables": variables,
        "sides": [equations, {"name": "mechanism", "chain": chain}],
        "position_m": 0.0,
        "rotation_rad": 0.0,
    }


def multiple(factor):
    return [["variable", "a"], ["number", str(factor)], ["multiply", 1, 0]]


ANGLES = [{"name": "a", "angle": True}, {"name": "b", "angle": True}]


def test_a_rotation_holds(tmp_path, checker):
    assert checked(checker, tmp_path / "c.json", turning(multiple(1), {}, ANGLES, [["turn", "a"]])) == 0
    assert checked(checker, tmp_path / "c.json", turning(multiple(1), {}, ANGLES, [["turn", "b"]])) == 1


def test_a_side_that_gives_another_value_to_a_variable_is_refused(tmp_path, checker, capsys):
    data = turning(multiple(2), {"a": 2}, ANGLES, [["turn", "a"]])
    assert checked(checker, tmp_path / "c.json", data) == 2
    assert "a joint that is a variable" in capsys.readouterr().err
    assert audited(tmp_path / "c.json", data, capsys)[0] == 2
    passive = turning(multiple(2), {"c": 2}, ANGLES, [["turn", "c"]])
    assert checked(checker, tmp_path / "c.json", passive) == 0
    assert audited(tmp_path / "c.json", passive, capsys)[0] == 0


def test_variables_of_one_name_and_a_third_side_are_refused(tmp_path, checker, capsys):
    twice = turning(multiple(1), {}, [ANGLES[0], ANGLES[0]], [["turn", "a"]])
    third = turning(multiple(1), {}, ANGLES, [["turn", "a"]])
    third["sides"].append({"name": "mechanism", "chain": [["turn", "b"]]})
    for data in (twice, third):
        assert checked(checker, tmp_path / "c.json", data) == 2
        assert audited(tmp_path / "c.json", data, capsys)[0] == 2


@pytest.mark.parametrize(("factor", "code"), [(15, 1), (16, 2), (2**20, 2)])
def test_large_multiples_of_an_angle_are_refused(tmp_path, checker, factor, code):
    """The exponent 2^20 of one angle would be taken for the exponent 1 of the next."""
    assert checked(checker, tmp_path / "c.json", turning(multiple(factor), {}, ANGLES, [["turn", "b"]])) == code


def test_large_powers_of_a_length_are_refused(tmp_path, checker, capsys):
    lengths = [{"name": name, "angle": False, "low": -1.0, "high": 1.0} for name in "ab"]
    rows = [["variable", "a"], *(["multiply", i, i] for i in range(20)), ["number", "0"], ["number", "1"]]
    data = turning(multiple(1), {}, lengths, [["slide", "b"]])
    data["sides"][0] |= {"rows": rows, "pose": [[22, 21, 21, 21], [21, 22, 21, 21], [21, 21, 22, 20]]}
    assert checked(checker, tmp_path / "c.json", data) == 2
    assert "to the power of" in capsys.readouterr().err


def test_certificates_of_other_files_are_refused(tmp_path, checker, certificate, capsys):
    path = tmp_path / "c.json"
    certificate["files"]["davinci_ecm.py"] = "0" * 64
    assert checked(checker, path, certificate) == 0
    assert audited(path, certificate, capsys, "--robot", "davinci_ecm")[0] == 2
    assert checker.main([str(path), str(tmp_path)]) == 2
