"""`twin audit` compares bounds along protocols with samples of the plan and of the reference model."""

from __future__ import annotations

import json
import math

import pytest

import twin
from made.certificates import audited, digest
from twin.exchange.audit.certificate import audit_certificate

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found():
    return twin.prove("sils", states=256, protocols=["table2"], clearance=False)


@pytest.fixture
def certificate(found):
    return json.loads(json.dumps(found.certificate()))


def audit(tmp_path, data, capsys):
    data["sha256"] = digest(data)
    return audited(tmp_path / "c.json", data, capsys, "--robot", "sils")


def test_no_sample_is_beyond_a_bound(tmp_path, certificate, capsys):
    code, report = audit(tmp_path, certificate, capsys)
    assert code == 0
    (row,) = [check for check in report["checks"] if check["where"] == "table2"]
    assert row["worst"] <= 1e-8
    assert not report["findings"]


@pytest.mark.parametrize(
    ("kind", "value"), [("joint limit", "q1"), ("joint speed", "q3"), ("RCM", "enforced"), ("determinant", "loops")]
)
def test_a_bound_that_was_made_sharper_is_refused(tmp_path, certificate, capsys, kind, value):
    (row,) = [r for r in certificate["motions"][0]["proved"] if (r["kind"], r["value"]) == (kind, value)]
    if "at least" in row:
        row["at least"] *= 1.01
    elif kind == "RCM":
        row["at most"] = -1e-6
    else:
        row["at most"] *= 0.99
    code, report = audit(tmp_path, certificate, capsys)
    assert code == 1
    assert f"table2: {kind} {value}: a sample is " in str(report["findings"])


def test_another_file_of_the_protocol_or_none_is_named(tmp_path, certificate, capsys):
    motion = certificate["motions"][0]
    motion["protocol_sha256"] = "0" * 64
    code, report = audit(tmp_path, certificate, capsys)
    assert code == 2
    assert "is not the file of the protocol that was proved" in str(report["findings"])
    motion["protocol"] = "nothing"
    code, report = audit(tmp_path, certificate, capsys)
    assert code == 2
    assert "nothing: its bounds cannot be checked" in str(report["findings"])


@pytest.mark.parametrize(("key", "name"), [("value", "q9"), ("kind", "limit of a joint")])
def test_a_bound_of_another_name_is_an_error(tmp_path, certificate, capsys, key, name):
    certificate["motions"][0]["proved"][0][key] = name
    code, report = audit(tmp_path, certificate, capsys)
    assert code == 2
    assert "table2: there is no " in str(report["findings"])


class Samples:
    """Two samples of one value, of which more can be no numbers."""

    def __init__(self, *known):
        self.known = known

    def extremes(self, entry):
        return {("gap", "rail"): self.known}


@pytest.mark.parametrize(
    ("row", "known", "code"),
    [
        ({"at least": 0.1}, (0.2, 0.3, 0), None),
        ({"at least": 0.1, "limit": 0.05}, (0.2, 0.3, 0), None),
        ({"at least": 0.1, "limit": 0.15}, (0.2, 0.3, 0), "certificate.wrong"),
        ({"at most": 0.4, "limit": 0.35}, (0.2, 0.3, 0), "certificate.wrong"),
        ({"at most": 0.4, "at least": 0.1}, (0.2, 0.3, 0), "certificate.unreadable"),
        ({}, (0.2, 0.3, 0), "certificate.unreadable"),
        ({"at most": 0.25}, (0.2, 0.3, 0), "certificate.wrong"),
        ({"at most": math.nan}, (0.2, 0.3, 0), "certificate.wrong"),
        ({"at most": 0.4}, (0.2, 0.3, 7), "certificate.motion"),
        ({"at most": 0.4}, (math.nan, math.nan, 9), "certificate.motion"),
    ],
)
def test_rows_of_bounds(tmp_path, certificate, row, known, code):
    certificate["motions"] = [{"protocol": "a", "proved": [{"kind": "gap", "value": "rail", **row}]}]
    certificate["sha256"] = digest(certificate)
    path = tmp_path / "c.json"
    path.write_text(json.dumps(certificate))
    report = audit_certificate(path, samples=Samples(*known))
    assert [finding.code for finding in report.findings] == ([code] if code else [])
