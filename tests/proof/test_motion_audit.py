"""`twin audit` compares bounds along protocols with samples of the plan and of the reference model."""

from __future__ import annotations

import json

import pytest

import twin
from made.certificates import audited, digest

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


def test_a_value_that_is_not_sampled_is_named(tmp_path, certificate, capsys):
    certificate["motions"][0]["proved"][0]["value"] = "q9"
    code, report = audit(tmp_path, certificate, capsys)
    assert code == 0
    assert "not sampled: joint limit q9" in str(report["findings"])
