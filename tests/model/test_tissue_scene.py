"""Organs in a scene file: what is drawn and declared, and messages about what cannot be."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from made import organs as made
from twin.cad.build import read_props
from twin.core.errors import DescriptionError, TwinError
from twin.core.units import MM
from twin.model import anatomy
from twin.model.anatomy import AnatomyTable
from twin.model.scene import load_scene
from twin.reference import ReferenceModel
from twin.simulation import tissue_scene

SCENE = made.ROOT / "cad/vsrs/scene.toml"
ORGANS = made.ROOT / "cad/organs"


LINK = '"pa10/instrument", "lapbot/shaft"'
"""The first links of [anatomy]."""


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
        ('"lapbot/jaw"', '"instrument"', """'instrument' is not a link; write "robot/body\""""),
        ("touching = [" + LINK, 'axes = ["y", "x", "z"]\ntouching = [' + LINK, "not the axes of a right-handed frame"),
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
        with pytest.raises(DescriptionError, match=r"organs need both a section \[anatomy\] and a section \[tissue"):
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


@pytest.mark.slow
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
        assert outside < 1e-9, f"{t.name} is {outside / MM:.1f} mm outside the skin"
        assert len(t.pinned_nodes) >= 3
    liver, gallbladder, stomach, _ = (t.surface.vertices for t in made.abdomen())
    for a, b in ((liver, stomach), (gallbladder, stomach)):
        assert min(np.linalg.norm(b - p, axis=1).min() for p in a[::7]) > 5 * MM


def test_frame_of_the_drawing_is_mapped_as_in_the_paper():
    """Section 4.2, figures 13 to 15: the origin of Blender is at (0.32, 0.48, 0) m of the simulator.

    The y axis of the simulator is opposite to the x axis of Blender, its x axis is the y axis of Blender. The scale is
    not printed; here it is 0.1.
    """
    table = AnatomyTable(
        file="organs.toml", axes=("-y", "x", "z"), origin_mm=(320, 480, 0), scale=0.1, touching=["pa10/instrument"],
        provenance="PUBLISHED", note="paper",
    )  # fmt: skip
    assert np.allclose(table.to_drawing(np.array([[0.32, 0.48, 0.0]])), 0)
    y = np.array([[0.32, 0.48 + d, 0.0] for d in (-0.1, 0.0, 0.1)])
    assert np.allclose(table.to_drawing(y), [[1, 0, 0], [0, 0, 0], [-1, 0, 0]])  # y largest: x of Blender smallest
    x = np.array([[0.32 + d, 0.48, 0.0] for d in (-0.1, 0.1)])
    assert np.allclose(table.to_drawing(x), [[0, -1, 0], [0, 1, 0]])
    assert np.allclose(table.to_drawing(np.array([[0.32, 0.48, 0.05]])), [[0, 0, 0.5]])
    p = np.random.default_rng(0).normal(size=(50, 3))
    assert np.allclose(table.to_world(table.to_drawing(p)), p, atol=1e-14)


def test_organ_drawn_in_another_frame_is_the_same_in_the_world(tmp_path):
    drawn = read_props(ORGANS / "anatomy.toml")
    frame = (
        'axes = ["-y", "x", "z"]\norigin_mm = [320, 480, 0]\nscale = 0.5\ntouching = ["pa10/instrument", "lapbot/shaft"'
    )
    scene = load_scene(changed(tmp_path, ("touching = [" + LINK, frame)))
    table = scene.anatomy
    assert table is not None
    poses = ReferenceModel(drawn).home().link_poses

    def moved(body):
        T = poses[body.name]
        (mesh,) = body.meshes
        world = mesh.vertices @ T[:3, :3].T + T[:3, 3]
        return replace(body, meshes=(replace(mesh, vertices=table.to_drawing(world)),))

    other = replace(drawn, bodies=tuple(moved(b) for b in drawn.bodies))
    still = dict.fromkeys(poses, np.eye(4))
    found = anatomy.tissues(scene.file, table, scene.tissues, other, still)
    for a, b in zip(found, made.abdomen(), strict=True):
        assert abs(a.surface.volume / b.surface.volume - 1) < 1e-6
        assert np.abs(np.sort(a.surface.vertices, axis=0) - np.sort(b.surface.vertices, axis=0)).max() < 1e-6
