"""Organs in exported files: readers that nobody here wrote get the vertices that were simulated."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from made import organs as made
from twin.core.units import MM, UM
from twin.exchange.audit.deformables import audit_deformables
from twin.exchange.formats.glb.write import bends_glb
from twin.exchange.write.player_interpolation import poses_between_keys
from twin.model.deformable import Bend
from twin.usd.write.deformables import write_deformables

LIMIT = 10 * UM


@pytest.fixture(scope="module")
def bends():
    return made.bends()


truth = made.at_time


TIMES = (0.0, 0.25, 0.5083, 0.7, 0.991, 1.5, 1.9833)


def test_shapes_add_up_to_the_motion(bends):
    bend = bends[0]
    shapes, factors = bend.shapes()
    assert len(shapes) < bend.nodes.shape[1] * 3
    for k in range(0, 120, 7):
        v = bend.mesh.vertices + np.einsum("s,snd->nd", factors[k], shapes)
        assert np.abs(v - bend.vertices(k)).max() < 1 * UM
    assert len(bends[1].shapes()[0]) == 0
    assert list(bends[1].changes()) == [0, 119]


def accessor(document, binary, k):
    """Return the rows of an accessor of a glTF file: the reader of this test."""
    a = document["accessors"][k]
    view = document["bufferViews"][a["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[a["type"]]
    kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[a["componentType"]]
    start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    return np.frombuffer(binary, kind, a["count"] * width, start).reshape(-1, width)


def test_glb_plays_the_vertices(bends):
    data = bends_glb("organs", bends)
    assert data == bends_glb("organs", bends)
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    names = [n["name"] for n in document["nodes"]]
    assert names == ["organs", *(b.name for b in bends)]
    (animation,) = document["animations"]
    assert len(animation["channels"]) == 1
    for bend in bends:
        node = document["nodes"][names.index(bend.name)]
        mesh = document["meshes"][node["mesh"]]
        (primitive,) = mesh["primitives"]
        rest = accessor(document, binary, primitive["attributes"]["POSITION"])
        faces = accessor(document, binary, primitive["indices"]).reshape(-1, 3)
        assert np.array_equal(faces, bend.mesh.triangles)
        targets = [accessor(document, binary, t["POSITION"]) for t in primitive.get("targets", [])]
        for t in TIMES:
            factors = np.zeros(len(targets))
            for channel in animation["channels"]:
                if channel["target"]["node"] == names.index(bend.name):
                    sampler = animation["samplers"][channel["sampler"]]
                    keys = accessor(document, binary, sampler["input"]).ravel()
                    values = accessor(document, binary, sampler["output"]).reshape(len(keys), len(targets))
                    factors = np.array([np.interp(t, keys, v) for v in values.T])
            v = rest + sum((f * p for f, p in zip(factors, targets, strict=True)), np.zeros_like(rest))
            assert np.abs(v - truth(bend, t)).max() < LIMIT


def test_a_vertex_without_triangle_has_a_normal(bends):
    bend = bends[1]
    mesh = replace(bend.mesh, vertices=np.vstack([bend.mesh.vertices, np.zeros(3)]))
    data = bends_glb("organs", [replace(bend, mesh=mesh, weights=np.vstack([bend.weights, bend.weights[:1]]))])
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    (primitive,) = document["meshes"][0]["primitives"]
    normals = accessor(document, data[28 + length :], primitive["attributes"]["NORMAL"])
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_trimesh_reads_the_glb_at_rest(bends, tmp_path):
    import trimesh

    (tmp_path / "organs.glb").write_bytes(bends_glb("organs", bends))
    scene = trimesh.load(tmp_path / "organs.glb", process=False)
    for bend in bends:
        T, name = scene.graph[bend.name]
        v = scene.geometry[name].vertices @ T[:3, :3].T + T[:3, 3]
        z_up = np.column_stack([v[:, 0], -v[:, 2], v[:, 1]])
        assert np.abs(z_up - bend.vertices(0)).max() < LIMIT
        assert scene.geometry[name].is_watertight


def test_openusd_plays_the_points(bends, tmp_path):
    stage = Usd.Stage.Open(str(write_deformables("organs", bends, tmp_path / "organs.usdc")))
    assert stage.GetTimeCodesPerSecond() == 60
    for bend in bends:
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/organs/{bend.name}"))
        for t in TIMES:
            v = np.array(mesh.GetPointsAttr().Get(t * 60), float)
            assert np.abs(v - truth(bend, t)).max() < LIMIT
            low, high = np.array(mesh.GetExtentAttr().Get(t * 60))
            assert (v.min(axis=0) > low - 0.2 * MM).all()
            assert (v.max(axis=0) < high + 0.2 * MM).all()
        assert np.array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), bend.mesh.triangles)
    assert len(UsdGeom.Mesh(stage.GetPrimAtPath(f"/organs/{bends[1].name}")).GetPointsAttr().GetTimeSamples()) == 2


def test_poses_between_keys_are_those_of_a_player():
    keys = np.array([0.0, 1.0])
    Ts = np.stack([made.at(0, 0, 0), made.at(1, 2, 3)])
    Ts[1, :2, :2] = [[0, -1], [1, 0]]
    got = poses_between_keys(keys, Ts, np.array([-1.0, 0.5, 9.0]))
    assert np.allclose(got[0], Ts[0])
    assert np.allclose(got[2], Ts[1])
    assert np.allclose(got[1, :3, 3], [0.5, 1, 1.5])
    assert np.allclose(got[1, 0, 0], np.sqrt(0.5))


def exported(folder, bends):
    (folder / "usd").mkdir(exist_ok=True)
    (folder / "organs.glb").write_bytes(bends_glb("organs", bends))
    write_deformables("organs", bends, folder / "usd/organs.usdc")


def test_audit_finds_nothing_in_what_was_written(bends, tmp_path):
    exported(tmp_path, bends)
    (ledger,) = audit_deformables(tmp_path)
    assert not ledger.findings
    assert len(ledger.checks) == 4
    assert audit_deformables(tmp_path / "usd") == []


def shifted(bend):
    nodes = bend.nodes.copy()
    nodes[:, :, 2] += 15 * UM
    return Bend(bend.mesh, bend.weights, bend.times, nodes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (lambda b: [shifted(b[0]), b[1]], "bend.vertices"),
        (lambda b: b[:1], "bend.missing"),
        (lambda b: [replace(b[0], mesh=replace(b[0].mesh, triangles=b[0].mesh.triangles[1:])), b[1]], "bend.vertices"),
    ],
)
def test_audit_finds_seeded_faults(bends, tmp_path, fault, code):
    exported(tmp_path, bends)
    write_deformables("organs", fault(bends), tmp_path / "usd/organs.usdc")
    (ledger,) = audit_deformables(tmp_path)
    assert {f.code for f in ledger.findings} == {code}


def without_samples(mesh):
    points = mesh.GetPointsAttr()
    first = points.Get(points.GetTimeSamples()[0])
    points.Clear()
    points.Set(first)


def with_nan_at(sample):
    def fault(mesh):
        points = mesh.GetPointsAttr()
        code = points.GetTimeSamples()[sample]
        values = np.array(points.Get(code))
        values[3, 1] = np.nan
        points.Set(values, code)

    return fault


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (without_samples, "bend.samples"),
        (with_nan_at(0), "bend.not_finite"),
        (with_nan_at(1), "bend.not_finite"),
        (with_nan_at(-1), "bend.not_finite"),
    ],
)
def test_audit_finds_points_that_cannot_be_compared(bends, tmp_path, fault, code):
    exported(tmp_path, bends)
    stage = Usd.Stage.Open(str(tmp_path / "usd/organs.usdc"))
    fault(UsdGeom.Mesh(stage.GetPrimAtPath(f"/organs/{bends[0].name}")))
    stage.Save()
    (ledger,) = audit_deformables(tmp_path)
    assert [f.code for f in ledger.findings] == [code]
    assert [c.verdict for c in ledger.checks if "against" in c.check] == ["disagree", "agree"]


def test_audit_finds_that_the_layer_of_the_organs_is_missing_if_the_scene_has_usd(bends, tmp_path):
    (tmp_path / "organs.glb").write_bytes(bends_glb("organs", bends))
    (ledger,) = audit_deformables(tmp_path)
    assert [f.code for f in ledger.findings] == ["bend.missing"]
    assert "disagree" in {c.verdict for c in ledger.checks}
    (ledger,) = audit_deformables(tmp_path, expects_usd=False)
    assert not ledger.findings
    assert len(ledger.checks) == 2


def test_audit_finds_that_a_glb_has_no_organs(bends, tmp_path):
    exported(tmp_path, bends)
    data = bends_glb("organs", bends)
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    for node in document["nodes"]:
        node.pop("mesh", None)
    text = json.dumps(document, separators=(",", ":")).encode().ljust(length)
    (tmp_path / "organs.glb").write_bytes(data[:20] + text + data[20 + length :])
    (ledger,) = audit_deformables(tmp_path, expects_usd=False)
    assert "bend.missing" in {f.code for f in ledger.findings}


def test_audit_refuses_two_meshes_with_one_name(bends, tmp_path):
    exported(tmp_path, bends)
    stage = Usd.Stage.Open(str(tmp_path / "usd/organs.usdc"))
    UsdGeom.Mesh.Define(stage, f"/organs/again/{bends[0].name}")
    stage.Save()
    (ledger,) = audit_deformables(tmp_path)
    assert [f.code for f in ledger.findings] == ["bend.unreadable"]
    assert "two meshes are named" in ledger.findings[0].message
    exported(tmp_path, bends)
    (tmp_path / "organs.glb").write_bytes(bends_glb("organs", [bends[0], bends[0]]))
    (ledger,) = audit_deformables(tmp_path)
    assert "bend.unreadable" in {f.code for f in ledger.findings}


@pytest.mark.slow
def test_audit_finds_an_open_surface_and_a_broken_file(bends, tmp_path):
    torn = replace(bends[1], mesh=replace(bends[1].mesh, triangles=bends[1].mesh.triangles[1:]))
    exported(tmp_path, [bends[0], torn])
    assert {f.code for f in audit_deformables(tmp_path)[0].findings} == {"bend.open"}
    data = bends_glb("organs", bends)
    for k in range(0, len(data), len(data) // 40):
        (tmp_path / "organs.glb").write_bytes(data[:k])
        assert {f.severity for f in audit_deformables(tmp_path)[0].findings} >= {"error"}
