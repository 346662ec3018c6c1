"""Mesh files with a declared unit, and what solids weigh, against closed forms."""

from __future__ import annotations

import zipfile
from functools import reduce
from operator import add

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.cad import mesh
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.units import LENGTH
from twin.model.inertia import Inertia

SIZE = np.array([40.0, 30.0, 20.0])


def brick():
    """Return a box of 40 x 30 x 20 units with one corner at the origin."""
    return trimesh.creation.box(SIZE, trimesh.transformations.translation_matrix(SIZE / 2))


MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>
<object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object>
<object id="2"><components><component objectid="1" transform="{inner}"/></components></object>
</resources><build><item objectid="{item}" transform="{outer}"/></build></model>"""

STAY = "1 0 0 0 1 0 0 0 1 0 0 0"


def write_3mf(path, solid, unit="millimeter", item=1, inner=STAY, outer=STAY):
    vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in solid.vertices.tolist())
    triangles = "".join(f'<triangle v1="{i}" v2="{j}" v3="{k}"/>' for i, j, k in solid.faces.tolist())
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "3D/3dmodel.model",
            MODEL.format(unit=unit, vertices=vertices, triangles=triangles, item=item, inner=inner, outer=outer),
        )


@pytest.mark.parametrize("suffix", ["stl", "obj", "glb", "3mf", "ply"])
@pytest.mark.parametrize("unit", ["mm", "in"])
def test_every_format_is_read_in_its_declared_unit(tmp_path, suffix, unit):
    path = tmp_path / f"brick.{suffix}"
    if suffix == "3mf":
        write_3mf(path, brick(), {"mm": "millimeter", "in": "inch"}[unit])
    else:
        brick().export(path)
    loaded, findings = mesh.load_mesh(path, unit, color=(0.1, 0.2, 0.3))
    assert findings == []
    assert (loaded.name, loaded.color_rgba) == ("brick", (0.1, 0.2, 0.3, 1.0))
    assert len(loaded.vertices) == 8
    assert len(loaded.triangles) == 12
    assert np.abs(loaded.vertices.min(axis=0)).max() < 1e-9
    assert np.allclose(loaded.vertices.max(axis=0), SIZE * LENGTH[unit], rtol=1e-6, atol=0)
    weight = mesh.inertia(loaded.vertices, loaded.triangles, 1.0)
    assert weight is not None
    assert weight.mass == pytest.approx(np.prod(SIZE) * LENGTH[unit] ** 3, rel=1e-5)


def test_a_3mf_that_states_another_unit_is_refused(tmp_path):
    write_3mf(tmp_path / "brick.3mf", brick(), "inch")
    with pytest.raises(CadError) as caught:
        mesh.load_mesh(tmp_path / "brick.3mf", "mm")
    told = "unit 'mm' is declared, but the file states inch; declare the unit of the file"
    assert str(caught.value) == f"{tmp_path / 'brick.3mf'}: {told}"


def test_a_3mf_places_components_and_items(tmp_path):
    """Row vectors: a component turned a quarter about z, then mirrored in x and moved."""
    quarter, mirror = "0 1 0 -1 0 0 0 0 1 100 0 0", "-1 0 0 0 1 0 0 0 1 0 7 0"
    write_3mf(tmp_path / "brick.3mf", brick(), item=2, inner=quarter, outer=mirror)
    loaded, findings = mesh.load_mesh(tmp_path / "brick.3mf", "mm")
    assert findings == []
    assert np.abs(loaded.vertices.min(axis=0) - np.array([-100, 7, 0]) * 1e-3).max() < 1e-15
    assert np.abs(loaded.vertices.max(axis=0) - np.array([-70, 47, 20]) * 1e-3).max() < 1e-15
    weight = mesh.inertia(loaded.vertices, loaded.triangles, 1.0)
    assert weight is not None
    assert weight.mass == pytest.approx(24e-6, rel=1e-12)  # positive: wound outward


@pytest.mark.parametrize("item", [3, "x"])
def test_a_3mf_whose_object_is_missing_is_damaged(tmp_path, item):
    write_3mf(tmp_path / "brick.3mf", brick(), item=item)
    with pytest.raises(CadError, match=rf"cannot be read as 3MF \(object {item} is missing or contains itself\)"):
        mesh.load_mesh(tmp_path / "brick.3mf", "mm")


@pytest.mark.parametrize("unit", LENGTH)
def test_units(tmp_path, unit):
    path = tmp_path / "brick.stl"
    brick().export(path)
    loaded, _ = mesh.load_mesh(path, unit)
    assert np.allclose(np.ptp(loaded.vertices, axis=0), SIZE * LENGTH[unit], rtol=1e-12, atol=0)


def test_a_file_with_y_up_is_turned_to_z_up_and_stays_outward(tmp_path):
    path = tmp_path / "brick.ply"
    brick().export(path)
    loaded, _ = mesh.load_mesh(path, "mm", up="y")
    # What was (x, y, z) is (x, -z, y): y up becomes z up, right-handed.
    assert np.abs(loaded.vertices.min(axis=0) - [0, -0.020, 0]).max() < 1e-12
    assert np.abs(loaded.vertices.max(axis=0) - [0.040, 0, 0.030]).max() < 1e-12
    weight = mesh.inertia(loaded.vertices, loaded.triangles, 1.0)
    assert weight is not None
    assert weight.mass == pytest.approx(24e-6, rel=1e-12)


def test_scenes_with_placed_nodes_are_flattened(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box([1, 1, 1]), transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.add_geometry(trimesh.creation.box([1, 1, 1]))
    scene.export(tmp_path / "two.glb")
    loaded, _ = mesh.load_mesh(tmp_path / "two.glb", "m")
    assert np.allclose(np.ptp(loaded.vertices, axis=0), [6, 1, 1])


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("brick.stl", None, "a mesh file does not state its unit; give unit = 'mm' (or m, cm, mm, um, in)"),
        ("brick.stl", "inch", "unit 'inch' is not known; use one of m, cm, mm, um, in"),
        (
            "brick.x3d",
            "mm",
            "suffix '.x3d' is not supported; use STEP or one of .stl, .obj, .glb, .gltf, .3mf, .ply",
        ),
        ("brick", "mm", "suffix '' is not supported; use STEP or one of"),
        ("none.stl", "mm", "the mesh file does not exist"),
        ("empty.obj", "mm", "the file has no triangles"),
        ("noise.glb", "mm", "cannot be read as GLB"),
        ("noise.3mf", "mm", "cannot be read as 3MF"),
        ("noise.ply", "mm", "cannot be read as PLY"),
    ],
)
def test_what_cannot_be_read_says_why(tmp_path, name, unit, message):
    brick().export(tmp_path / "brick.stl")
    (tmp_path / "empty.obj").write_text("v 0 0 0\nv 1 0 0\n")
    for suffix in ("glb", "3mf", "ply"):
        (tmp_path / f"noise.{suffix}").write_bytes(bytes(range(256)))
    with pytest.raises(CadError) as caught:
        mesh.load_mesh(tmp_path / name, unit)
    assert str(caught.value).startswith(f"{tmp_path / name}: {message}")


def test_a_buffer_whose_name_no_file_can_have_says_which_file_is_wrong(tmp_path):
    (tmp_path / "a.gltf").write_text('{"asset": {"version": "2.0"}, "buffers": [{"uri": "' + "a" * 300 + '"}]}')
    with pytest.raises(CadError, match=r"a\.gltf: cannot be read as GLTF"):
        mesh.load_mesh(tmp_path / "a.gltf", "m")


@pytest.mark.parametrize(("unit", "extent"), [("m", 40.0), ("um", 4e-5)])
def test_an_implausible_size_is_a_warning(tmp_path, unit, extent):
    brick().export(tmp_path / "brick.stl")
    _, (finding,) = mesh.load_mesh(tmp_path / "brick.stl", unit)
    assert (finding.code, finding.severity, finding.unit) == ("cad.implausible_size", "warning", "m")
    assert finding.size == pytest.approx(extent, rel=1e-9)
    assert finding.message.startswith(f"brick.stl has an implausible size when read in {unit}: ")
    assert finding.suggestion == "check the declared unit"


def test_an_open_mesh_is_a_warning_and_weighs_nothing(tmp_path):
    solid = brick()
    solid.update_faces(np.arange(len(solid.faces)) != 3)
    solid.export(tmp_path / "open.stl")
    loaded, (finding,) = mesh.load_mesh(tmp_path / "open.stl", "mm")
    assert (finding.code, finding.severity, finding.where) == ("cad.open_mesh", "warning", "open")
    assert len(loaded.triangles) == 11
    assert mesh.inertia(loaded.vertices, loaded.triangles, 1000.0) is None


def test_a_mesh_with_a_face_turned_round_weighs_nothing():
    solid = brick()
    faces = solid.faces.copy()
    faces[2] = faces[2][::-1]
    assert mesh.inertia(np.asarray(solid.vertices), faces, 1000.0) is None


def test_welding_closes_a_triangle_soup_and_drops_slivers():
    solid = brick()
    soup = solid.vertices[solid.faces.reshape(-1)]
    triangles = np.arange(len(soup)).reshape(-1, 3)
    sliver = np.array([[0, 0, 1]])
    vertices, welded = mesh.weld(soup, np.concatenate([triangles, sliver]))
    assert (len(vertices), len(welded)) == (8, 12)
    weight = mesh.inertia(vertices, welded, 1.0)
    assert weight is not None
    assert weight.mass == pytest.approx(24000.0, rel=1e-14)


# -- weights against closed forms --------------------------------------------------------------------

T = spatial.pose(spatial.exp_so3([0.4, -0.3, 0.8]), [0.1, -0.2, 0.3])


def placed(solid):
    vertices = np.asarray(solid.vertices) @ T[:3, :3].T + T[:3, 3]
    return mesh.inertia(vertices, np.asarray(solid.faces), 2700.0)


def test_a_box_has_the_inertia_of_a_box():
    a, b, c = 0.3, 0.2, 0.1
    got = placed(trimesh.creation.box([a, b, c]))
    m = 2700 * a * b * c
    moments = m / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    assert got.mass == pytest.approx(m, rel=1e-13)
    assert np.abs(got.p_body_com - T[:3, 3]).max() < 1e-14
    assert np.abs(got.I_com - T[:3, :3] @ moments @ T[:3, :3].T).max() < 1e-13 * m
    assert got.violations() == []


def test_a_cylinder_tends_to_the_inertia_of_a_cylinder():
    """A prism of n sides has sin(2a)/(2a) of the area, a = pi/n; its polar radius of gyration is known too."""
    r, h, n = 0.02, 0.3, 500
    got = placed(trimesh.creation.cylinder(r, h, sections=n))
    a = np.pi / n
    m = 2700 * h * n * r * r * np.sin(a) * np.cos(a)
    polar = m * r * r / 6 * (1 + 2 * np.cos(a) ** 2)  # of a regular polygon about its axis
    moments = np.diag([polar / 2 + m * h * h / 12] * 2 + [polar])
    assert got.mass == pytest.approx(m, rel=1e-12)
    assert got.mass == pytest.approx(2700 * np.pi * r * r * h, rel=3e-5)
    assert np.abs(got.I_com - T[:3, :3] @ moments @ T[:3, :3].T).max() < 1e-12 * m
    assert polar == pytest.approx(m * r * r / 2, rel=3e-5)


def test_a_sphere_tends_to_the_inertia_of_a_sphere():
    r = 0.05
    errors = []
    for n in (3, 4):
        got = placed(trimesh.creation.icosphere(n, r))
        m = 2700 * 4 / 3 * np.pi * r**3
        assert np.abs(got.p_body_com - T[:3, 3]).max() < 1e-14
        moments = np.linalg.eigvalsh(got.I_com)
        assert np.ptp(moments) < 1e-9 * moments[0]
        errors.append([1 - got.mass / m, 1 - moments[0] / (0.4 * m * r * r)])
    assert np.all(np.array(errors) > 0)  # inscribed: always too light
    assert np.allclose(np.array(errors[0]) / errors[1], 4, rtol=0.02)  # second order in the edge length
    assert max(errors[1]) < 6e-3


# -- parallel axes -----------------------------------------------------------------------------------


def test_two_halves_weigh_what_the_whole_does():
    a, b, c = 0.3, 0.2, 0.1
    whole = placed(trimesh.creation.box([a, b, c]))
    shift = trimesh.transformations.translation_matrix
    halves = [placed(trimesh.creation.box([a / 2, b, c], shift([s * a / 4, 0, 0]))) for s in (-1, 1)]
    got = reduce(add, halves)
    assert got.mass == pytest.approx(whole.mass, rel=1e-13)
    assert np.abs(got.p_body_com - whole.p_body_com).max() < 1e-15
    assert np.abs(got.I_com - whole.I_com).max() < 1e-13 * whole.mass


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 2**31), st.integers(1, 5))
def test_any_bodies_combine_as_their_points_do(seed, count):
    rng = np.random.default_rng(seed)
    clouds = [(rng.uniform(0.1, 2, 6), rng.normal(size=(6, 3))) for _ in range(count)]

    def weigh(masses, points):
        com = masses @ points / masses.sum()
        r = points - com
        J = np.einsum(
            "n,nij->ij", masses, np.einsum("nk,nk->n", r, r)[:, None, None] * np.eye(3) - np.einsum("ni,nj->nij", r, r)
        )
        return Inertia(masses.sum(), com, J)

    got = reduce(add, [weigh(*c) for c in clouds])
    want = weigh(np.concatenate([c[0] for c in clouds]), np.concatenate([c[1] for c in clouds]))
    assert got.mass == pytest.approx(want.mass, rel=1e-12)
    assert np.abs(got.p_body_com - want.p_body_com).max() < 1e-12
    assert np.abs(got.I_com - want.I_com).max() < 1e-11 * want.mass
