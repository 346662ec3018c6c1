"""Meshes of foreign robots: the up axis and unit of each format, Collada, shapes that serve, sizes that can be read."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
import trimesh

from twin.cad import mesh
from twin.cad.collada import TO_Z_UP, read_collada
from twin.cli import main
from twin.core import spatial
from twin.core.errors import BudgetError
from twin.core.foreign.budget import BUDGETS, Budget
from twin.exchange.read import read

SIZE = np.array([0.1, 0.2, 0.3])
POINTS = SIZE * [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
"""A tetrahedron in m, z up, with another length along each axis; its volume is that of the box / 6."""
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]

# What a file writes for a point (x, y, z) of the z-up world: right, up and in of the Collada specification.
INTO = {
    "X_UP": lambda p: np.stack([p[:, 2], -p[:, 0], -p[:, 1]], 1),
    "Y_UP": lambda p: np.stack([p[:, 0], p[:, 2], -p[:, 1]], 1),
    "Z_UP": lambda p: p,
}
UNITS = {"meter": 1.0, "millimeter": 1e-3, "inch": 0.0254}
ROBOT = """<robot name="r"><link name="a">{shapes}</link><link name="b"/>
<joint name="j" type="revolute">
<parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
SDF = """<sdf version="1.9"><model name="m"><link name="a">{shapes}</link><link name="b"/>
<joint name="j" type="revolute">
<parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""


def numbers(values):
    return " ".join(f"{v:.9g}" for v in np.ravel(values))


def faces(kind):
    head = '<input semantic="VERTEX" source="#v" offset="0"/>'
    if kind == "polygons":
        return f'<polygons count="4">{head}{"".join(f"<p>{numbers(f)}</p>" for f in FACES)}</polygons>'
    counts = "<vcount>3 3 3 3</vcount>" if kind == "polylist" else ""
    return f'<{kind} count="4">{head}{counts}<p>{numbers(FACES)}</p></{kind}>'


def collada(points, scene, asset="", kind="triangles", library="", before=""):
    """Return a Collada file with the geometry "g" of the tetrahedron's faces over points (4, 3)."""
    source = f'<source id="p"><float_array id="a" count="12">{numbers(points)}</float_array><technique_common>'
    source += '<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
    source += '<param name="Z" type="float"/></accessor></technique_common></source>'
    source += '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
    return (
        f'<?xml version="1.0"?>{before}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset>{asset}</asset><library_geometries><geometry id="g"><mesh>{source}{faces(kind)}</mesh></geometry>'
        f"</library_geometries><library_nodes>{library}</library_nodes><library_visual_scenes>"
        f'<visual_scene id="s">{scene}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


SHOWN = '<node><instance_geometry url="#g"/></node>'


def same_points(got, wanted):
    order = [np.lexsort(np.round(p, 6).T) for p in (got, wanted)]
    np.testing.assert_allclose(got[order[0]], wanted[order[1]], atol=1e-6)


def volume(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


@pytest.mark.parametrize("kind", ["triangles", "polylist", "polygons"])
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("up", [*INTO, None])
def test_collada_of_a_robot_folder_is_read_in_its_unit_and_with_its_up_axis(tmp_path, up, unit, kind):
    asset = f'<unit name="{unit}" meter="{UNITS[unit]}"/>' + (f"<up_axis> {up}\n</up_axis>" if up else "")
    text = collada(INTO[up or "Y_UP"](POINTS) / UNITS[unit], SHOWN, asset, kind)
    (tmp_path / "m.dae").write_text(text)
    vertices, triangles, stated = read_collada(tmp_path / "m.dae")
    assert stated == (up or "Y_UP")
    same_points(vertices @ TO_Z_UP[stated].T, POINTS)
    loaded, _ = mesh.load_mesh(tmp_path / "m.dae", "m")
    same_points(loaded.vertices, POINTS)
    assert volume(vertices, triangles) == pytest.approx(SIZE.prod() / 6, rel=1e-5)


def test_instances_of_collada_stand_where_their_nodes_say(tmp_path, rng):
    """Drawn trees of nodes, also repeated and mirrored, against the product of their matrices."""
    for _ in range(40):
        wanted, volumes = [], 0.0
        inner = np.eye(4)
        inner[:3] = np.hstack([rng.normal(size=(3, 3)), rng.normal(size=(3, 1))])
        library = f'<node id="part"><matrix>{numbers(inner)}</matrix><instance_geometry url="#g"/></node>'
        rows = []
        for _ in range(rng.integers(1, 5)):
            outer = np.eye(4)
            outer[:3] = np.hstack([rng.normal(size=(3, 3)), rng.normal(size=(3, 1))])
            shift = rng.normal(size=3)
            T = outer @ np.block([[np.eye(3), shift[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
            by_node = rng.random() < 0.5
            shown = '<instance_node url="#part"/>' if by_node else '<instance_geometry url="#g"/>'
            rows.append(
                f"<node><matrix>{numbers(outer)}</matrix><node><translate>{numbers(shift)}</translate>{shown}</node></node>"
            )
            T = T @ inner if by_node else T
            wanted.append(POINTS @ T[:3, :3].T + T[:3, 3])
            volumes += SIZE.prod() / 6 * abs(np.linalg.det(T[:3, :3]))
        text = collada(POINTS, "".join(rows), "<up_axis>Z_UP</up_axis>", library=library)
        (tmp_path / "m.dae").write_text(text)
        vertices, triangles, _ = read_collada(tmp_path / "m.dae")
        np.testing.assert_allclose(vertices, np.concatenate(wanted), atol=2e-5)
        assert volume(vertices, triangles) == pytest.approx(volumes, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (collada(POINTS, SHOWN, before='<!DOCTYPE a [<!ENTITY x "y">]>'), "document type or entities"),
        (collada(POINTS, SHOWN.replace("#g", "other.dae#g")), "other files are not read"),
        (collada(POINTS, '<node id="n"><instance_node url="#n"/></node>'), "contains itself"),
        (collada(POINTS, SHOWN, '<unit meter="nan"/>'), "expected a positive number"),
        (collada(POINTS, SHOWN, "<up_axis>UP</up_axis>"), "is not one of X_UP, Y_UP, Z_UP"),
        (collada(POINTS, SHOWN).replace("<p>0 2 1", "<p>0 9 1"), "cannot be read as DAE"),
        (collada(POINTS, SHOWN.replace("geometry", "controller")), "<instance_controller> is not supported"),
        (collada(POINTS, SHOWN.replace("#g", "#none")), "cannot be read as DAE"),
        ("<robot/>", "expected <COLLADA>"),
    ],
)
def test_collada_that_cannot_be_read_is_a_warning_and_the_collision_shape_serves(tmp_path, text, said):
    (tmp_path / "m.dae").write_text(text)
    shapes = '<visual><geometry><mesh filename="m.dae"/></geometry></visual>'
    shapes += '<collision><geometry><box size="1 2 3"/></geometry></collision>'
    (tmp_path / "r.urdf").write_text(ROBOT.format(shapes=shapes))
    in_sdf = "<visual name='v'><geometry><mesh><uri>m.dae</uri></mesh></geometry></visual>"
    in_sdf += "<collision name='c'><geometry><box><size>1 2 3</size></box></geometry></collision>"
    (tmp_path / "r.sdf").write_text(SDF.format(shapes=in_sdf))
    for name in ("r.urdf", "r.sdf"):
        imported = read(tmp_path / name)
        told = [f.message for f in imported.findings if f.severity == "warning"]
        assert any(said in m for m in told), told
        assert any("none of its visual shapes can be read: 1 of its collision shapes serve." in m for m in told)
        (shape,) = imported.mechanism.body("a").meshes
        np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [1, 2, 3])


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb", "gltf", "dae"])
def test_one_solid_in_each_format_stands_upright_in_urdf_and_sdf(tmp_path, suffix):
    """glTF has y up; the robot shows z up. A scale is along the axes of the robot."""
    file = tmp_path / f"m.{suffix}"
    if suffix == "dae":
        file.write_text(collada(POINTS, SHOWN))
    else:
        points = INTO["Y_UP"](POINTS) if suffix.startswith("gl") else POINTS
        solid = trimesh.Trimesh(points, FACES, process=False)
        if suffix == "gltf":
            for name, data in trimesh.exchange.gltf.export_gltf(solid.scene()).items():
                (tmp_path / ("m.gltf" if name == "model.gltf" else name)).write_bytes(data)
        else:
            solid.export(file)
    shapes = f'<visual><geometry><mesh filename="{file.name}" scale="1 1 2"/></geometry></visual>'
    (tmp_path / "r.urdf").write_text(ROBOT.format(shapes=shapes))
    in_sdf = f"<visual name='v'><geometry><mesh><uri>{file.name}</uri><scale>1 1 2</scale></mesh></geometry></visual>"
    (tmp_path / "r.sdf").write_text(SDF.format(shapes=in_sdf))
    for name in ("r.urdf", "r.sdf"):
        (shape,) = read(tmp_path / name).mechanism.body("a").meshes
        same_points(shape.vertices, POINTS * [1, 1, 2])
        assert volume(shape.vertices, shape.triangles) == pytest.approx(SIZE.prod() / 3, rel=1e-5)


@pytest.mark.parametrize("up", [*INTO, None])
def test_the_up_axis_of_collada_is_not_applied_in_urdf_and_sdf_and_told_once(tmp_path, up):
    """As RViz, Gazebo and Pinocchio do; two links have such meshes, and the finding names the first."""
    asset = f"<up_axis>{up}</up_axis>" if up else ""
    for name in ("m", "n"):
        (tmp_path / f"{name}.dae").write_text(collada(POINTS, SHOWN, asset))
    visual = '<visual><geometry><mesh filename="{}.dae"/></geometry></visual>'
    urdf = ROBOT.format(shapes=visual.format("m")).replace(
        '<link name="b"/>', f'<link name="b">{visual.format("n")}</link>'
    )
    (tmp_path / "r.urdf").write_text(urdf)
    visual = "<visual name='v'><geometry><mesh><uri>{}.dae</uri></mesh></geometry></visual>"
    sdf = SDF.format(shapes=visual.format("m")).replace(
        '<link name="b"/>', f'<link name="b">{visual.format("n")}</link>'
    )
    (tmp_path / "r.sdf").write_text(sdf)
    shown = {"X_UP": "(-y, -z, x)", "Y_UP": "(x, -z, y)", None: "(x, -z, y)", "Z_UP": None}[up]
    if shown:
        names = dict(zip("xyz", POINTS.T, strict=True))
        names.update({f"-{k}": -v for k, v in names.items()})
        said = np.stack([names[k] for k in shown.strip("()").split(", ")], 1)
        same_points(said, POINTS @ TO_Z_UP[up or "Y_UP"].T)
    for file in ("r.urdf", "r.sdf"):
        imported = read(tmp_path / file)
        for link in "ab":
            (shape,) = imported.mechanism.body(link).meshes
            same_points(shape.vertices, POINTS)
        told = [f for f in imported.findings if f.code == "import.up_axis"]
        if shown is None:
            assert not told
            continue
        (finding,) = told
        assert finding.severity == "warning"
        assert f"link 'a': the up axis of mesh m.dae is {up or 'Y_UP'}; it is not applied" in finding.message
        assert shown in finding.message


@pytest.mark.parametrize("up", INTO)
def test_pinocchio_reads_collada_of_a_urdf_with_the_same_axes(tmp_path, up, rng):
    """Drawn points, and a node with a drawn pose."""
    points = rng.normal(size=(4, 3))
    pose = np.eye(4)
    pose[:3, :3] = spatial.exp_so3(rng.normal(size=3))
    pose[:3, 3] = rng.normal(size=3)
    scene = f'<node><matrix>{numbers(pose)}</matrix><instance_geometry url="#g"/></node>'
    (tmp_path / "m.dae").write_text(collada(points, scene, f"<up_axis>{up}</up_axis>"))
    path = tmp_path / "r.urdf"
    path.write_text(ROBOT.format(shapes='<visual><geometry><mesh filename="m.dae"/></geometry></visual>'))
    model = pinocchio.buildModelFromUrdf(str(path))
    seen = pinocchio.buildGeomFromUrdf(model, str(path), pinocchio.GeometryType.VISUAL, package_dirs=[str(tmp_path)])
    (shape,) = read(path).mechanism.body("a").meshes
    same_points(np.unique(seen.geometryObjects[0].geometry.vertices(), axis=0), np.unique(shape.vertices, axis=0))


@pytest.mark.parametrize("limit", [10_000, 100])
def test_every_mesh_that_new_writes_can_be_read_back(tmp_path, monkeypatch, limit, capsys):
    """Above the size of an OBJ that is read, a binary STL is written; above that of an STL, nothing."""
    solid = trimesh.creation.icosphere(2, 0.3)
    solid.export(tmp_path / "m.glb")
    monkeypatch.setitem(BUDGETS, "OBJ", Budget(limit // 10))
    monkeypatch.setitem(BUDGETS, "STL", Budget(limit * 2))
    (tmp_path / "r.urdf").write_text(
        ROBOT.format(shapes='<visual><geometry><mesh filename="m.glb"/></geometry></visual>')
    )
    argv = ["new", "big", "--from", str(tmp_path / "r.urdf"), "--out", str(tmp_path / "out")]
    if limit < 1000:
        assert main(argv) == 2
        assert "the limit for STL is 200" in "".join(capsys.readouterr())
        assert not (tmp_path / "out").exists()
        return
    monkeypatch.setitem(BUDGETS, "STL", Budget(50 * len(solid.faces) + 84))
    assert main(argv) == 0
    assert main(["info", str(tmp_path / "out")]) == 0
    (file,) = (tmp_path / "out/cad/meshes").iterdir()
    assert file.suffix == ".stl"
    loaded, findings = mesh.load_mesh(file, "m")
    assert not findings
    assert len(loaded.triangles) == len(solid.faces)
    wanted = INTO_Z_UP @ solid.vertices.T
    same_points(loaded.vertices, wanted.T)


INTO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def test_a_mesh_of_collada_above_the_limit_of_bytes_is_refused(tmp_path, monkeypatch):
    (tmp_path / "m.dae").write_text(collada(POINTS, SHOWN))
    monkeypatch.setitem(BUDGETS, "DAE", Budget(100))
    with pytest.raises(BudgetError, match="the limit for DAE is 100"):
        mesh.load_mesh(tmp_path / "m.dae", "m")


ARM = """<mujoco><worldbody><body name="b"><joint name="k" axis="0 1 0"/><geom size=".1"/><body name="c" pos="0 0 .3">
<joint name="l" type="slide"/><geom size=".1"/><body name="d"><joint name="m"/><geom size=".1"/></body></body></body>
</worldbody>{more}</mujoco>"""


@pytest.mark.parametrize(
    ("more", "driven"),
    [
        ("", ["k", "l", "m"]),
        ('<equality><joint joint1="m" joint2="k" polycoef="0 2 0 0 0"/></equality>', ["k", "l"]),
        ('<actuator><motor joint="l"/></actuator>', ["l"]),
        ('<equality><connect body1="d" anchor="0 0 0"/></equality>', []),
    ],
)
def test_without_actuators_all_joints_of_an_mjcf_are_driven(tmp_path, more, driven):
    (tmp_path / "a.xml").write_text(ARM.format(more=more))
    assert [j.name for j in read(tmp_path / "a.xml").mechanism.active] == driven
