"""The GLB: read again by trimesh, decoded by hand, the same bytes each time."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from twin.core import spatial
from twin.exchange.formats.glb.document import surface
from twin.exchange.formats.glb.write import glb_bytes, moving_paths, write_glb
from twin.exchange.write.clip import Clip, InterpolationErrors
from twin.exchange.write.home_poses import home_poses
from twin.model.body import Body, Frame, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.usd.write.geometry import corner_normals

C = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Z up to y up."""


def box(name: str, color=(0.2, 0.3, 0.4, 1.0), size=0.1) -> Mesh:
    shape = trimesh.creation.box((size, 2 * size, 3 * size))
    return Mesh(name, np.asarray(shape.vertices), np.asarray(shape.faces, np.int32), color)


def robot(*more: Mesh, name: str = "arm") -> Mechanism:
    bodies = (
        Body("ground", (box("plate"),)),
        Body("link", (box("bar"), box("glass", (0.1, 0.2, 0.3, 0.5)), *more), Inertia(2.5, np.zeros(3), np.eye(3))),
        Body("slider"),
    )
    joints = (
        Joint("pin", "revolute", "ground", "link", spatial.pose(None, [0.1, 0.2, 0.3]), active=True),
        Joint("rail", "prismatic", "link", "slider", active=True),
    )
    frames = (Frame("tool", "slider", spatial.pose(None, [0, 0, 0.5])), Frame("other", "link", np.eye(4)))
    return Mechanism(name, "ground", bodies, joints, frames, rest={b.name: np.eye(4) for b in bodies})


def clip(mechanism: Mechanism, q: np.ndarray, s: np.ndarray, name: str = "swing") -> Clip:
    times = np.arange(len(q)) / 10
    link = spatial.pose(spatial.rotation_z(q), [0.1, 0.2, 0.3])
    slide = link @ spatial.pose(None, np.column_stack([0 * s, 0 * s, s]))
    links = {"ground": np.tile(np.eye(4), (len(q), 1, 1)), "link": link, "slider": slide}
    return Clip(
        name,
        name,
        times,
        links,
        {"pin": q, "rail": s},
        ("pin", "rail"),
        (("go", 0.0, float(times[-1])),),
        10.0,
        InterpolationErrors(0, 0, 0),
    )


class Read:
    """A GLB taken apart by the specification, without any of the writer's code."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        self.binary = b""
        if len(data) > 20 + size:
            n, kind = struct.unpack_from("<I4s", data, 20 + size)
            assert kind == b"BIN\0"
            assert n % 4 == 0
            self.binary = data[28 + size :]
            assert len(self.binary) == n == self.json["buffers"][0]["byteLength"]
        self.nodes = {n["name"]: n for n in self.json["nodes"]}

    def accessor(self, i: int) -> np.ndarray:
        a = self.json["accessors"][i]
        view = self.json["bufferViews"][a["bufferView"]]
        kind = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[a["componentType"]]
        wide = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[a["type"]]
        start = view["byteOffset"] + a["byteOffset"]
        assert start % np.dtype(kind).itemsize == 0
        stop = start + a["count"] * wide * np.dtype(kind).itemsize
        assert stop <= view["byteOffset"] + view["byteLength"]
        out = np.frombuffer(self.binary[start:stop], kind).reshape(-1, wide)
        if "min" in a:
            assert a["min"] == out.min(axis=0).tolist()
            assert a["max"] == out.max(axis=0).tolist()
        return out

    def channels(self, name: str) -> dict[tuple[str, str], np.ndarray]:
        a = next(x for x in self.json["animations"] if x["name"] == name)
        assert len({s["input"] for s in a["samplers"]}) == 1, "all channels share one time accessor"
        assert "min" in self.json["accessors"][a["samplers"][0]["input"]]
        assert {s["interpolation"] for s in a["samplers"]} == {"LINEAR"}
        nodes = self.json["nodes"]
        return {
            (nodes[c["target"]["node"]]["name"], c["target"]["path"]): self.accessor(
                a["samplers"][c["sampler"]]["output"]
            )
            for c in a["channels"]
        }


Q = np.linspace(0, 6.0, 41)
S = np.linspace(0, 0.2, 41)


def test_trimesh_finds_every_link_of_sils_at_rest(sils_cad, tmp_path):
    m = sils_cad.mechanism
    scene = trimesh.load(write_glb(m, (), tmp_path / "sils.glb"))
    rest = home_poses(m)
    for body in m.bodies:
        assert np.abs(scene.graph.get(body.name)[0] - C @ rest[body.name]).max() < 1e-12, body.name
    mine = sum(len(mesh.triangles) for b in m.bodies for mesh in b.meshes)
    assert sum(len(g.faces) for g in scene.geometry.values()) == mine
    volume = sum(trimesh.Trimesh(x.vertices, x.triangles, process=False).volume for b in m.bodies for x in b.meshes)
    read = sum(trimesh.Trimesh(g.vertices, g.faces, process=False).volume for g in scene.geometry.values())
    assert read == pytest.approx(volume, rel=1e-6)
    assert read > 0, "inside out"


def test_same_bytes_twice(sils_cad):
    assert glb_bytes(sils_cad.mechanism) == glb_bytes(sils_cad.mechanism)


def test_root_turns_z_up_to_y_up_once_and_links_are_flat_below_it():
    m = robot()
    read = Read(glb_bytes(m, [clip(m, Q, S)]))
    root = read.json["nodes"][read.json["scenes"][0]["nodes"][0]]
    x, y, z, w = root["rotation"]
    assert np.allclose(spatial.matrix_from_quat_wxyz([w, x, y, z]), C[:3, :3])
    assert [read.json["nodes"][i]["name"] for i in root["children"]] == ["ground", "link", "slider"]
    assert all("matrix" not in n and "scale" not in n for n in read.json["nodes"])
    assert read.nodes["link"]["extras"] == {"link": "link", "mass": 2.5, "joints": ["pin"]}
    assert "mass" not in read.nodes["slider"]["extras"]
    asset = read.json["asset"]["extras"]
    assert (asset["schema"], asset["units"]) == ("twin-glb", "m, kg, s")


def test_keys_are_the_poses_of_the_clip_and_signs_never_jump():
    m = robot()
    c = clip(m, Q, S)
    channels = Read(glb_bytes(m, [c])).channels("swing")
    assert set(channels) == {(n, p) for n in ("link", "slider") for p in ("translation", "rotation")} - {
        ("link", "translation")
    }
    for name in ("link", "slider"):
        q = channels[name, "rotation"].astype(float)
        assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0), "a player by components would swing round"
        R = spatial.matrix_from_quat_wxyz(np.roll(q, 1, axis=1))
        assert np.abs(R - c.links[name][:, :3, :3]).max() < 3e-7
    assert np.abs(channels["slider", "translation"] - c.links["slider"][:, :3, 3]).max() < 1e-7


def test_a_link_that_stands_elsewhere_than_at_rest_is_put_there():
    """Not to move is not a reason to be left at the rest pose."""
    m = robot()
    c = clip(m, np.full(5, 0.7), np.zeros(5))
    channels = Read(glb_bytes(m, [c])).channels("swing")
    assert ("link", "rotation") in channels


def test_what_one_clip_moves_every_clip_sets():
    """A player leaves where it is what the next clip does not name."""
    m = robot()
    still, moving = clip(m, np.zeros(5), np.zeros(5), "still"), clip(m, Q, S)
    read = Read(glb_bytes(m, [moving, still]))
    assert set(read.channels("still")) == set(read.channels("swing"))
    assert moving_paths([still], home_poses(m)) == set()
    assert "animations" not in Read(glb_bytes(m, [still])).json


def test_materials_are_linear_shared_and_say_when_they_are_clear():
    read = Read(glb_bytes(robot()))
    solid, clear = read.json["materials"]
    assert solid["pbrMetallicRoughness"]["baseColorFactor"] == [0.2, 0.3, 0.4, 1.0]
    assert "alphaMode" not in solid
    assert clear["alphaMode"] == "BLEND"
    assert not solid["doubleSided"]
    assert not clear["doubleSided"]


def test_nodes_have_names_of_their_own_whatever_the_robot_is_called():
    m = robot(name="link")
    weld = Joint("weld", "fixed", "ground", "frame_tool")
    m = replace(m, bodies=(*m.bodies, Body("frame_tool")), joints=(*m.joints, weld))
    names = [n["name"] for n in Read(glb_bytes(m)).json["nodes"]]
    assert len(set(names)) == len(names)
    assert {b.name for b in m.bodies} <= set(names)


def test_indices_take_two_bytes_while_they_can(rng):
    small = Read(glb_bytes(robot()))
    kinds = {
        small.json["accessors"][p["indices"]]["componentType"] for x in small.json["meshes"] for p in x["primitives"]
    }
    assert kinds == {5123}
    many = rng.normal(size=(66000, 3))
    read = Read(glb_bytes(robot(Mesh("cloud", many, np.arange(66000, dtype=np.int32).reshape(-1, 3), (1, 0, 0, 1)))))
    cloud = read.json["meshes"][1]["primitives"][-1]
    assert read.json["accessors"][cloud["indices"]]["componentType"] == 5125
    points, faces = read.accessor(cloud["attributes"]["POSITION"]), read.accessor(cloud["indices"]).reshape(-1, 3)
    assert np.allclose(np.sort(points[faces].reshape(-1, 3), axis=0), np.sort(many, axis=0), atol=1e-6)


def test_surface_keeps_corners_and_normals_and_doubles_vertices_only_at_edges():
    shape = trimesh.creation.cylinder(0.1, 0.3, sections=64)
    v, f = np.asarray(shape.vertices), np.asarray(shape.faces)
    points, normals, faces = surface(v, f)
    assert np.abs(points[faces] - v[f]).max() < 1e-8
    assert np.abs(normals[faces].reshape(-1, 3) - corner_normals(v, f)).max() < 2e-4
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-6
    assert len(points) == 2 + 4 * 64, "rim vertices twice, the two centres once"


def test_triangles_without_area_in_single_precision_are_dropped():
    v = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1 + 1e-12, 0, 0]])
    _, _, faces = surface(v, np.array([[0, 1, 2], [1, 3, 2]]))
    assert len(faces) == 1


def test_a_robot_without_meshes_is_still_a_file():
    m = robot()
    bare = replace(m, bodies=tuple(replace(b, meshes=()) for b in m.bodies))
    read = Read(glb_bytes(bare))
    assert not {"meshes", "materials", "accessors", "buffers"} & set(read.json)
