"""Organs in a scene file: what is drawn and declared, and messages about what cannot be."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from made import organs as made
from twin.cad.build import read_props
from twin.core.errors import DescriptionError, TwinError
from twin.core.units import MM
from twin.model.scene import load_scene
from twin.reference import ReferenceModel
from twin.simulation import tissue_scene

SCENE = made.ROOT / "cad/vsrs/scene.toml"
ORGANS = made.ROOT / "cad/organs"


def changed(folder: Path, *pairs):
    """Return the scene file with replaced text, in a folder of its own; its organs stay where they are."""
    body = SCENE.read_text(encoding="utf-8").replace("../organs/", f"{ORGANS.as_posix()}/")
    for old, new in pairs:
        assert old in body
        body = body.replace(old, new, 1)
    shutil.copy(SCENE.with_name("theatre.toml"), folder)
    (folder / "scene.toml").write_text(body, encoding="utf-8")
    return folder / "scene.toml"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("anatomy.toml", "anatomi.toml", r"scene.toml:\d+: anatomy.file: there is no file .*anatomi.toml"),
        ('"lapbot/jaw"', '"lapbt/jaw"', "there is no robot 'lapbt'. Did you mean 'lapbot'"),
        ('"lapbot/jaw"', '"instrument"', """'instrument' is no link; write "robot/body\""""),
        (
            "cells = [3, 2, 2]",
            "cells = [3, 2, 5]",
            r"tissue.gallbladder.cells = \[3, 2, 5\]: \[3, 2, 5\] cells; .* must be 1 to 4",
        ),
        ("poisson = 0.4", "poisson = 0.5", "tissue.liver.poisson"),
        ("young_kpa = 5", "young_kpa = -5", "tissue.liver.young_kpa"),
        ("friction = 0.1", "friction = -0.1", "tissue.liver.friction"),
        ("low_mm = [-160, -20, 780]", "low_mm = [-160, -20, 880]", r"is not below high_mm .* in every direction"),
    ],
)
def test_wrong_table_is_named_with_its_line(tmp_path, old, new, message):
    with pytest.raises(DescriptionError, match=message):
        load_scene(changed(tmp_path, (old, new)))


def test_organs_need_an_anatomy_and_an_anatomy_needs_organs(tmp_path):
    body = SCENE.read_text(encoding="utf-8")
    start, first = body.index("[anatomy]"), body.index("[tissue.liver]")
    for cut in (body[start:first], body[first:]):
        path = changed(tmp_path)
        path.write_text(body.replace(cut, ""), encoding="utf-8")
        with pytest.raises(DescriptionError, match=r"organs need both the table \[anatomy\] and one table \[tissue"):
            load_scene(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[tissue.stomach]", "[tissue.spleen]", "there is no body of the anatomy 'spleen'"),
        ("edge_mm = 10", "edge_mm = 1", "surface 'liver' is too fine: more than 6000 vertices; allow longer edges"),
    ],
)
def test_organ_that_cannot_be_built_is_named_with_the_scene(tmp_path, old, new, message):
    scene = load_scene(changed(tmp_path, (old, new)))
    with pytest.raises(TwinError, match=f"scene.toml: .*{message}"):
        tissue_scene.tissues(scene, read_props(ORGANS / "anatomy.toml"))


def test_organs_are_assumed_apart_and_in_the_abdomen():
    scene = load_scene(SCENE)
    numbers = [p for p in scene.parameters if p.name.startswith("tissue ")]
    assert len(numbers) > 40
    assert {p.provenance for p in numbers} == {"ASSUMED"}
    assert all(p.note for p in numbers)
    theatre = read_props(scene.file.parent / "theatre.toml")
    T = ReferenceModel(theatre).home().link_poses["patient"]
    skin = next(m for m in theatre.body("patient").meshes if m.name == "patient_abdomen").vertices
    faces = ConvexHull(skin @ T[:3, :3].T + T[:3, 3]).equations
    for t in made.abdomen():
        outside = (t.surface.vertices @ faces[:, :3].T + faces[:, 3]).max()
        assert outside < 0, f"{t.name} is {outside / MM:.1f} mm outside the skin"
        assert len(t.held) >= 3
    liver, gallbladder, stomach = (t.surface.vertices for t in made.abdomen())
    for a, b in ((liver, stomach), (gallbladder, stomach)):
        assert min(np.linalg.norm(b - p, axis=1).min() for p in a[::7]) > 5 * MM
