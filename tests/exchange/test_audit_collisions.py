"""Collision meshes of a URDF: those that are missing, and those that are others than the visual meshes of an export."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from twin.core.findings import Finding
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.urdf.audit import Urdf

LINKS = ("base", "arm", "hand", "finger")

TETRAHEDRON = "v 0 0 0\nv {s} 0 0\nv 0 {s} 0\nv 0 0 {s}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"

SHAPE = '<{use} name="{link}_{use}">{origin}<geometry><mesh filename="{file}" scale="{scale}"/></geometry></{use}>'


def shape(link: str, use: str, **changed: str) -> str:
    given = {"origin": "", "file": f"meshes/{link}.obj", "scale": "0.001 0.001 0.001", **changed}
    return SHAPE.format(link=link, use=use, **given)


def told(folder: Path, collisions: dict[str, str]) -> list[tuple[str, str]]:
    """Return (code, place) of the faults of a robot whose links collide by their meshes, or as in `collisions`."""
    found = [f for f in audited(folder, collisions) if f.code in ("urdf.collision", "urdf.mesh")]
    return [(f.code, f.where.rpartition(": ")[2]) for f in found]


def audited(folder: Path, collisions: dict[str, str]) -> list[Finding]:
    """Write the robot of `told` and return all findings on it."""
    (folder / "meshes").mkdir(exist_ok=True)
    lines = ['<robot name="made">']
    for k, link in enumerate(LINKS):
        (folder / "meshes" / f"{link}.obj").write_text(TETRAHEDRON.format(s=10 + k), encoding="utf-8")
        shapes = shape(link, "visual") + collisions.get(link, shape(link, "collision"))
        lines.append(f'<link name="{link}">{shapes}</link>')
    for parent, child in pairwise(LINKS):
        ends = f'<parent link="{parent}"/><child link="{child}"/>'
        lines.append(f'<joint name="{child}_joint" type="fixed">{ends}</joint>')
    file = folder / "made.urdf"
    file.write_text("\n".join([*lines, "</robot>"]), encoding="utf-8")
    ledger = Ledger(file.name)
    Urdf(file, ledger)
    return ledger.found


@pytest.mark.parametrize(
    ("changed", "code", "place"),
    [
        ({"file": "meshes/hand.obj"}, "urdf.collision", "arm"),
        ({"scale": "0.001 0.001 0.00101"}, "urdf.collision", "arm"),
        ({"scale": "-0.001 0.001 0.001"}, "urdf.collision", "arm"),
        ({"origin": '<origin xyz="0 0 0.0001"/>'}, "urdf.collision", "arm"),
        ({"origin": '<origin rpy="0 0 3.14159"/>'}, "urdf.collision", "arm"),
    ],
)
def test_a_collision_that_differs_from_its_visual_is_reported(
    changed: dict[str, str], code: str, place: str, tmp_path: Path
) -> None:
    assert told(tmp_path, {"arm": shape("arm", "collision", **changed)}) == [(code, place)]


def test_an_export_is_not_reported_also_with_other_words_for_the_same(tmp_path: Path) -> None:
    same = {"origin": '<origin xyz="0 0 0" rpy="0 0 0"/>', "scale": "1e-3 1e-3 1e-3"}
    assert told(tmp_path, {}) == []
    assert told(tmp_path, {"arm": shape("arm", "collision", **same)}) == []


def test_a_missing_collision_and_a_missing_file_are_reported(tmp_path: Path) -> None:
    assert told(tmp_path, {"hand": ""}) == [("urdf.collision", "hand")]
    lost = shape("hand", "collision", file="meshes/lost.obj")
    assert told(tmp_path, {"hand": lost}) == [("urdf.mesh", "meshes/lost.obj"), ("urdf.collision", "hand")]


def test_simpler_collisions_of_another_author_are_no_fault(tmp_path: Path) -> None:
    hull = {link: shape(link, "collision", file="meshes/base.obj") for link in LINKS}
    assert told(tmp_path, hull) == []
    unnamed = {link: shape(link, "collision").replace(f' name="{link}_collision"', "") for link in LINKS}
    assert told(tmp_path, unnamed) == []
    # three equal pairs of four, but the meshes lie elsewhere than those of an export
    file = "meshes/arm_hull.obj"
    (tmp_path / file).write_text(TETRAHEDRON.format(s=5), encoding="utf-8")
    assert told(tmp_path, {"arm": shape("arm", "collision", file=file)}) == [("urdf.collision", "arm")]
    for mesh in (tmp_path / "meshes").iterdir():
        mesh.rename(tmp_path / mesh.name)
    elsewhere = (tmp_path / "made.urdf").read_text(encoding="utf-8").replace("meshes/", "")
    (tmp_path / "made.urdf").write_text(elsewhere, encoding="utf-8")
    ledger = Ledger("made.urdf")
    Urdf(tmp_path / "made.urdf", ledger)
    assert not [f for f in ledger.found if f.code == "urdf.collision"]


def test_differences_that_are_not_judged_are_counted(tmp_path: Path) -> None:
    hull = {link: shape(link, "collision", file="meshes/base.obj") for link in LINKS}
    (note,) = [f for f in audited(tmp_path, hull) if f.code == "urdf.collision_unjudged"]
    assert note.severity == "info"
    assert note.message.startswith("3 differences between collision and visual meshes not judged: with only 1 equal")
    assert "'arm_collision' differs from 'arm_visual': file 'meshes/base.obj'" in note.message
    assert not [f for f in audited(tmp_path, {}) if f.code == "urdf.collision_unjudged"]
    assert not [f for f in audited(tmp_path, {"arm": ""}) if f.code == "urdf.collision_unjudged"]
