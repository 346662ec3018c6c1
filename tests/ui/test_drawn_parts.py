"""What is drawn and not measured: its shapes, its files, and that nothing which judges or exports reads it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.ui.session.drawn_parts import SCENERY_FILE, drawn_parts, hanging, person, read_drawn
from twin.ui.session.drawn_solids import SolidTable, check_solid, placed_surface

FILES = sorted((assets.data_folder() / "cad").glob(f"*/{SCENERY_FILE}"))


def solid(**more):
    return SolidTable(name="it", color=(1.0, 0.0, 0.0), **more)


SOLIDS = {
    "ellipsoid": (solid(shape="ellipsoid", size_mm=(20, 40, 60), centre_mm=(5, 0, 0)), np.pi / 6 * 20 * 40 * 60),
    "dome": (solid(shape="dome", size_mm=(20, 40, 60), centre_mm=(0, 0, 0)), np.pi / 12 * 20 * 40 * 60),
    "box": (solid(shape="box", size_mm=(20, 40, 60), centre_mm=(0, 9, 0), angles_deg=(30, 0, 0)), 20 * 40 * 60),
    "cylinder": (solid(shape="cylinder", size_mm=(20, 20, 60), centre_mm=(0, 0, 0)), np.pi / 4 * 20**2 * 60),
    "limb": (
        solid(shape="limb", line_mm=[(0, 0, 0), (0, 0, 30), (0, 0, 60)], width_mm=[20.0, 20.0, 20.0]),
        np.pi / 4 * 20**2 * 60 + np.pi / 6 * 20**3,
    ),
}
"""Solid, and its volume in mm³."""


@pytest.mark.parametrize("shape", SOLIDS)
def test_a_solid_is_closed_and_has_the_volume_of_its_shape(shape):
    table, volume = SOLIDS[shape]
    points, triangles = placed_surface(table)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    found = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 / MM**3
    # facets are inside the round shape; a negative volume would be a surface that is seen from inside
    assert 0.94 * volume < found < 1.005 * volume
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()


@pytest.mark.parametrize("shape", ["bed", "drape"])
def test_a_cloth_and_a_bed_stay_in_their_size(shape):
    points, triangles = placed_surface(solid(shape=shape, size_mm=(400, 600, 100), centre_mm=(0, 0, 7)))
    low = points.min(axis=0) / MM
    high = points.max(axis=0) / MM
    assert low[2] >= 7 - 1e-9
    assert high[2] <= 107 + 1e-9
    assert (np.abs([*low[:2], *high[:2]]) <= [213, 300 + 1e-9, 213, 300 + 1e-9]).all()
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > -1e-9).mean() > 0.5


def test_a_cable_hangs_as_low_as_its_length_allows():
    a = np.array([0.0, 0.0, 1.0])
    b = np.array([0.3, 0.0, 1.0])
    straight = hanging(a, b, 0.2)
    np.testing.assert_allclose(straight[:, 2], 1.0)
    previous = 1.0
    for length in (0.31, 0.35, 0.5, 0.9):
        line = hanging(a, b, length)
        np.testing.assert_allclose(line[[0, -1]], [a, b])
        lowest = line[:, 2].min()
        assert lowest < previous
        assert lowest >= 1.0 - 0.5 * length
        drawn = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert drawn == pytest.approx(length, rel=0.2)
        previous = lowest


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.parent.name)
def test_every_scenery_file_names_bodies_that_exist_and_adds_none(file: Path):
    scene = file.with_name("scene.toml")
    if scene.is_file():
        props = tomllib.loads((file.parent / tomllib.loads(scene.read_text("utf-8"))["props"]).read_text("utf-8"))
        found = drawn_parts(scene, (), props["body"])
        assert found is not None
    else:
        robot = twin.load(file.parent.name)
        assert robot.files is not None
        found = drawn_parts(robot.files.description, [body.name for body in robot.mechanism.bodies])
        assert found is not None
        # the mechanism, which is judged and exported, has none of it
        drawn = {mesh.name for meshes in found.meshes.values() for mesh in meshes}
        assert not drawn & {mesh.name for body in robot.mechanism.bodies for mesh in body.meshes}
        assert drawn
    assert "drawn and not measured (ASSUMED)" in found.note


def test_a_person_is_as_tall_as_the_page_says():
    points = np.concatenate([mesh.vertices for meshes in person().meshes.values() for mesh in meshes])
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.002)
    assert points[:, 2].max() == pytest.approx(1.75, abs=0.005)


WRONG = {
    "a body that does not exist": (
        '[[part]]\nname = "a"\nlink = "liver"\nshape = "box"\nsize_mm = [1, 1, 1]\ncentre_mm = [0, 0, 0]\n'
        "color = [0, 0, 0]",
        "there is no body 'liver'",
    ),
    "a part without a body": (
        '[[part]]\nname = "a"\nshape = "box"\nsize_mm = [1, 1, 1]\ncentre_mm = [0, 0, 0]\ncolor = [0, 0, 0]',
        "needs the key link",
    ),
    "a limb with one point": (
        '[[part]]\nname = "a"\nlink = "arm"\nshape = "limb"\nline_mm = [[0, 0, 0]]\nwidth_mm = [1]\ncolor = [0, 0, 0]',
        "it has 1 points and 1 numbers",
    ),
    "a box without a size": (
        '[[part]]\nname = "a"\nlink = "arm"\nshape = "box"\ncentre_mm = [0, 0, 0]\ncolor = [0, 0, 0]',
        "a box needs size_mm and centre_mm",
    ),
    "an oblique pulley": (
        '[[belt]]\nname = "a"\nlink = "arm"\nfrom_mm = [0, 0, 0]\nto_mm = [0, 0, 90]\naxis = [1, 0, 1]\nradius_mm = 5\n'
        "width_mm = 6",
        "is not at right angles to the belt",
    ),
    "pulleys in each other": (
        '[[belt]]\nname = "a"\nlink = "arm"\nfrom_mm = [0, 0, 0]\nto_mm = [0, 0, 9]\naxis = [1, 0, 0]\nradius_mm = 5\n'
        "width_mm = 6",
        "are closer than their diameter",
    ),
    "a cable to nowhere": (
        '[[cable]]\nname = "a"\nends = [{ link = "arm", at_mm = [0, 0, 0] }, { link = "leg", at_mm = [0, 0, 0] }]\n'
        "length_mm = 9\ndiameter_mm = 2\ncolor = [0, 0, 0]",
        "there is no body 'leg'",
    ),
    "a colour of nothing": ('[[finish]]\nbody = "dome"\ncolor = [0, 0, 0]', "there is no body of the props 'dome'"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_scenery_file_says_where(what, tmp_path):
    text, message = WRONG[what]
    file = tmp_path / SCENERY_FILE
    file.write_text(f'title = "t"\nprovenance = "ASSUMED"\nnote = "n"\n\n{text}\n', "utf-8")
    with pytest.raises(TwinError, match=rf"scenery\.toml:[0-9]+: .*{message}"):
        read_drawn(file, ["arm"])


def test_a_solid_with_the_lengths_of_another_shape_is_refused(tmp_path):
    file = tmp_path / SCENERY_FILE
    file.write_text("a = 1\n", "utf-8")
    table = solid(shape="box", size_mm=(1, 1, 1), centre_mm=(0, 0, 0), width_mm=[1.0])
    with pytest.raises(TwinError, match="a box has no line_mm"):
        check_solid(file, ("a",), table)
