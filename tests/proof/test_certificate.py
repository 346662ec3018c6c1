"""Certificates are checked by a program without twin, which refuses what was changed."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

import twin
from made.certificates import audited, digest, require_refusal, require_short
from made.scripts import script
from twin.exchange.audit import decimal_rows
from twin.exchange.audit.certificate import audit_certificate

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "docs/check_certificate.py"


@pytest.fixture(scope="module")
def checker():
    return script("docs/check_certificate.py")


@pytest.fixture(scope="module")
def found():
    return twin.prove("sils", states=1024)


@pytest.fixture
def certificate(found):
    return json.loads(json.dumps(found.certificate()))


def checked(checker, path, data, *more):
    path.write_text(json.dumps(data))
    return checker.main([str(path), *more])


def test_the_script_is_short_and_needs_the_standard_library_alone(checker):
    require_short(checker)


def test_every_claim_of_sils_holds_for_the_script_in_a_process_of_its_own(tmp_path, found):
    found.write(tmp_path)
    line = [sys.executable, "-I", str(SCRIPT), str(tmp_path / "certificate.json")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("holds: ") == len(found.proof.claims) == 15


def test_the_files_are_those_that_were_proved(tmp_path, checker, certificate):
    files = twin.load("sils").files
    for path in (files.formula, files.description, *files.cad.glob("*.step")):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert set(certificate["files"]) == {path.name for path in tmp_path.iterdir()}
    path = tmp_path / "c.json"
    assert checked(checker, path, certificate, str(tmp_path)) == 0
    changed = tmp_path / "sils.py"
    changed.write_bytes(changed.read_bytes() + b"\n")
    assert checked(checker, path, certificate, str(tmp_path)) == 2


@pytest.mark.parametrize("seed", range(50))
def test_what_was_changed_is_refused(tmp_path, checker, certificate, capsys, seed):
    require_refusal(checker, certificate, tmp_path / "c.json", capsys, seed)


def test_a_wrong_number_with_a_new_hash_fails(tmp_path, checker, certificate, capsys):
    (row,) = [row for row in certificate["rows"] if row[0] == "number" and row[1].startswith("27/200")][:1]
    row[1] = row[1].replace("27/200", "27001/200000")
    certificate["sha256"] = digest(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 1
    assert "FAILS" in capsys.readouterr().out


def test_a_claim_without_proof_fails(tmp_path, checker, certificate):
    (place,) = [i for i, row in enumerate(certificate["rows"]) if row == ["input", "X_E"]]
    certificate["claims"][0]["zero"] = [place]
    certificate["sha256"] = digest(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 1


@pytest.mark.parametrize("low", [0.2, 0.3])
def test_an_empty_range_is_refused(tmp_path, checker, certificate, low):
    certificate["ranges"]["X_E"] = [False, low, 0.2]
    certificate["sha256"] = digest(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 2


def test_a_value_that_is_no_number_hides_nothing(tmp_path, checker, certificate):
    rows = certificate["rows"]
    rows += [["real", "inf"], ["negative", len(rows)], ["add", len(rows), len(rows) + 1]]
    certificate["claims"][0]["zero"].append(len(rows) - 1)
    certificate["sha256"] = digest(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 1


@pytest.mark.parametrize("zero", [[10**6], [-1], []])
def test_rows_that_are_not_there_are_refused(tmp_path, checker, certificate, zero):
    certificate["claims"][0]["zero"] = zero
    certificate["sha256"] = digest(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 2


def test_the_audit_agrees_with_decimals_of_60_digits(tmp_path, certificate, capsys):
    code, report = audited(tmp_path / "c.json", certificate, capsys, "--robot", "sils")
    assert code == 0
    assert len(report["checks"]) == 15
    assert all(check["worst"] < 1e-40 for check in report["checks"])
    headline = audit_certificate(tmp_path / "c.json").headline
    assert headline == "VALID: what the certificate claims holds wherever it was tried"


def test_the_audit_refuses_what_was_cut_or_changed_or_is_of_other_files(tmp_path, certificate, capsys):
    text = json.dumps(certificate)
    path = tmp_path / "c.json"
    assert audited(path, text[: len(text) // 2], capsys)[0] == 2
    assert audited(path, text.replace("27/200", "27/201"), capsys)[0] == 2
    certificate["files"]["sils.py"] = "0" * 64
    certificate["sha256"] = digest(certificate)
    code, report = audited(path, certificate, capsys, "--robot", "sils")
    assert code == 2
    assert "sils.py is not the file that was proved" in str(report["findings"])


def test_the_audit_finds_a_wrong_number_with_a_new_hash(tmp_path, certificate, capsys):
    (row,) = [row for row in certificate["rows"] if row[0] == "number" and row[1].startswith("27/200")][:1]
    row[1] = row[1].replace("27/200", "27000000000001/200000000000000")
    certificate["sha256"] = digest(certificate)
    code, report = audited(tmp_path / "c.json", certificate, capsys)
    assert code == 1
    assert "does not hold" in str(report["findings"])


def made(rows, zero, ranges):
    """Return a certificate with one claim: that a row is zero."""
    claim = {"name": "a", "claim": "it is zero", "zero": [zero], "reach": []}
    data = {"schema": "twin/certificate/1", "files": {}, "ranges": ranges, "rows": rows, "claims": [claim]}
    return {**data, "sha256": digest(data)}


LENGTH = {"x": [False, 0.1, 0.2]}
SIGNED = {"x": [False, -0.2, 0.2]}
NEGATIVE = [["input", "x"], ["number", "0*sqrt(1)"], ["less", 0, 1]]


def test_an_error_below_rounding_on_one_side_of_a_condition_fails(tmp_path, checker, certificate, capsys):
    """Without roots, one exact value that is not zero is enough; with them, zeros are needed on both sides."""
    rows = [*NEGATIVE, ["number", "1/10000000*sqrt(1)"], ["choose", 2, 3, 1]]
    assert checked(checker, tmp_path / "c.json", made(rows, 4, SIGNED)) == 1
    assert "an exact number is not zero at x = " in capsys.readouterr().out
    rooted = [["input", "x"], ["multiply", 0, 0], ["root", 1], ["negative", 2], ["add", 2, 3]]
    n = len(rooted)
    more = [["number", "0*sqrt(1)"], ["less", 0, n], ["number", "1/10000000*sqrt(1)"], ["choose", n + 1, n + 2, n]]
    rows = [*rooted, *more, ["add", 4, n + 3]]
    assert checked(checker, tmp_path / "c.json", made(rows, len(rows) - 1, SIGNED)) == 1
    assert "one of its answers" in capsys.readouterr().out
    assert checked(checker, tmp_path / "c.json", made(rooted, 4, SIGNED)) == 0


def test_a_value_that_is_undefined_where_it_is_not_chosen_hides_no_states(tmp_path, checker):
    rows = [*NEGATIVE, ["root", 0], ["negative", 3], ["add", 3, 4], ["number", "1/100*sqrt(1)"], ["choose", 2, 6, 5]]
    assert checked(checker, tmp_path / "c.json", made(rows, 7, SIGNED)) == 1


@pytest.mark.parametrize("number", ["1/0*sqrt(1)", f"1/{2**61 - 465}*sqrt(1)"])
def test_a_division_by_zero_is_refused(tmp_path, checker, number):
    assert checked(checker, tmp_path / "c.json", made([["input", "x"], ["number", number]], 0, LENGTH)) == 2


def test_bounds_along_protocols_are_named_as_not_checked(tmp_path, checker, certificate, capsys):
    certificate["motions"] = [{"protocol": "a", "proved": [{"value": "gap"}, {"value": "speed"}]}]
    certificate["sha256"] = digest(certificate)
    assert checked(checker, tmp_path / "c.json", certificate) == 0
    assert "not checked: 2 bounds along protocols" in capsys.readouterr().out
    code, report = audited(tmp_path / "c.json", certificate, capsys)
    assert code == 0
    assert "2 bounds along protocols are not checked" in str(report["findings"])


def test_the_audit_draws_angles_from_their_whole_range(tmp_path, capsys):
    """The sine is zero or above only in the first half of the range; the audit must meet the second."""
    rows = [["sine", "x"], ["number", "0*sqrt(1)"], ["less", 0, 1], ["number", "1/1000*sqrt(1)"], ["choose", 2, 3, 1]]
    assert audited(tmp_path / "c.json", made(rows, 4, {"x": [True, 0.0, 6.2]}), capsys)[0] == 1
    assert audited(tmp_path / "c.json", made(rows, 4, {"x": [True, 0.1, 3.1]}), capsys)[0] == 0


@pytest.mark.parametrize("middle", range(-6, 7))
def test_the_audit_turns_by_multiples_of_30_degrees(middle):
    for angle in (middle * math.pi / 6 + 0.4, middle * math.pi / 6 - 3.0):
        (cosine, _), (sine, _) = decimal_rows._cosine_and_sine(angle, middle)
        assert float(cosine) == pytest.approx(math.cos(angle), abs=1e-12)
        assert float(sine) == pytest.approx(math.sin(angle), abs=1e-12)


def test_the_audit_finds_a_number_that_is_small_but_not_zero(tmp_path, capsys):
    rows = [["input", "x"], ["number", f"1/{10**30}*sqrt(1)"], ["multiply", 0, 1]]
    assert audited(tmp_path / "c.json", made(rows, 2, LENGTH), capsys)[0] == 1
    rows += [["negative", 2], ["add", 2, 3]]
    assert audited(tmp_path / "c.json", made(rows, 4, LENGTH), capsys)[0] == 0


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in twin.names() if name != "sils"])
def test_certificates_of_all_robots_hold(tmp_path, checker, name):
    found = twin.prove(name)
    assert checked(checker, tmp_path / "c.json", found.certificate()) == 0
    assert twin.audit(tmp_path / "c.json").exit_code == 0
