"""Defects that people make in exports by hand, of kinds that the audit once missed, are found by what is broken."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import twin
import twin.api
from made import audit_seeds
from made.audit_seeds_by_hand import BY_HAND
from twin.exchange.write.clip import ClipAccuracy

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def export(tmp_path_factory) -> Path:
    """Return an export of the da Vinci arm with coarse motions, in the formats of the seeds."""
    folder = tmp_path_factory.mktemp("export") / "davinci_psm"
    coarse = ClipAccuracy(2e-3, 0.02, 2e-3)
    twin.api.export("davinci_psm", out=folder, to="urdf,mjcf,unity,tracks", protocols=["reach"], budget=coarse)
    return folder


def test_the_export_is_without_findings(export):
    report = twin.audit(export)
    assert [f for f in report.findings if f.severity != "info"] == []


def test_two_formats_alone_without_the_links_of_a_ball_joint_have_no_findings(tmp_path):
    twin.api.export("sils", out=tmp_path, to="urdf,mjcf")
    assert [f for f in twin.audit(tmp_path).findings if f.severity != "info"] == []


@pytest.mark.parametrize("one", BY_HAND, ids=lambda one: one.name)
def test_a_defect_made_by_hand_is_found(one, export, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(export, copy)
    (copy / "proof.json").unlink()  # its hashes reveal every change, without the cause
    one.edit(copy)
    report = twin.audit(copy)
    told = [f"{f.severity} {f.code} {f.where}: {f.message}" for f in report.findings if f.severity != "info"]
    assert audit_seeds.found(report, one), told
