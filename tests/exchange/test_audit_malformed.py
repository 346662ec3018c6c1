"""Names, lists and programs that no correct export has, in the files beside the poses: each is a finding."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from twin.exchange.audit import audit
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.scene_folder import audit_scene
from twin.exchange.formats.urdf.audit import Urdf

LONG = "a" * 300  # longer than the name of any file


def proof(*names: str) -> str:
    return json.dumps({"schema": "twin-proof", "version": 1, "files": [{"file": n} for n in names]})


def unity(**more: object) -> str:
    return json.dumps({"name": "a.b.c", "unity": "2022.3", **more})


@pytest.mark.parametrize(
    ("files", "code"),
    [
        ({"u/package.json": unity(samples=None)}, "file.malformed"),
        ({"u/package.json": unity(samples=[{"path": LONG}])}, "file.unreadable"),
        ({"u/package.json": unity(), "u/a.asmdef": '{"name": "a", "references": 5}'}, "file.malformed"),
        ({"a.usda": "#usda 1.0\n(subLayers=[@a\0b.usda@])\n"}, "usd.unreadable"),
    ],
)
def test_a_malformed_file_of_an_export_is_an_error_in_the_report(files, code, tmp_path):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    report = audit(tmp_path)
    assert report.verdict == "unchecked"
    assert code in {f.code for f in report.findings}


@pytest.mark.parametrize("name", ["a\0b", LONG])
def test_a_name_in_a_proof_that_no_file_can_have_is_named(name, tmp_path):
    (tmp_path / "proof.json").write_text(proof(name))
    report = audit(tmp_path)
    assert report.verdict == "disagree"
    assert "proof.file" in {f.code for f in report.findings}


SCENE = {"name": "a", "protocol": "", "T_world_base": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}


@pytest.mark.parametrize("folder", ["a\0b", LONG])
def test_a_folder_that_cannot_exist_is_reported(folder, tmp_path):
    (tmp_path / "scene.json").write_text(json.dumps({"robots": [{**SCENE, "folder": folder}]}))
    assert [f.code for f in audit(tmp_path).findings] == ["scene.folder"]


def test_a_stage_of_a_scene_is_parsed_in_another_process_first(tmp_path):
    """A stage with more prims than the limit, which the audit of a robot's folder refuses too."""
    (tmp_path / "a").mkdir()
    (tmp_path / "usd").mkdir()
    (tmp_path / "scene.json").write_text(json.dumps({"robots": [{**SCENE, "folder": "a"}]}))
    deep = "".join(f'def "p{i}" {{\n' for i in range(250)) + "}\n" * 250
    (tmp_path / "usd/s.usda").write_text(f"#usda 1.0\n{deep}")
    _, ledgers = audit_scene(tmp_path, lambda folder: ([], []))
    assert [f.code for ledger in ledgers for f in ledger.findings] == ["file.budget"]


def test_a_missing_lower_limit_of_a_urdf_is_zero(tmp_path):
    path: Path = tmp_path / "r.urdf"
    path.write_text(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    assert Urdf(path, Ledger("r.urdf")).tree.joint_above["b"].limits == (0.0, 1.0)
