"""Seeded defects in GLB: each changes the JSON or the binary of a good file, and the audit names it."""

from __future__ import annotations

import base64
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from made import bundle as base
from made.glb_apart import Glb as Apart
from twin.exchange.audit import audit
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.glb.audit import read_gltf


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    """The four-bar as GLB, and the track to hold it against."""
    whole = base.write_good(tmp_path_factory.mktemp("good") / "bars")
    part = whole.with_name("part")
    part.mkdir()
    shutil.copytree(whole / "tracks", part / "tracks")
    shutil.copy(whole / "bars.glb", part)
    return part


class Glb(Apart):
    """With what the defects below change, by names."""

    def index(self, name: str) -> int:
        return next(i for i, n in enumerate(self.document["nodes"]) if n.get("name") == name)

    def sampler(self, name: str, path: str) -> dict:
        clip = self.document["animations"][0]
        channel = next(c for c in clip["channels"] if c["target"] == {"node": self.index(name), "path": path})
        return clip["samplers"][channel["sampler"]]

    def keys(self, name: str, path: str) -> np.ndarray:
        return self.numbers(self.sampler(name, path)["output"])

    def mesh_of(self, name: str) -> dict:
        pending = [self.index(name)]
        while pending:
            node = self.document["nodes"][pending.pop(0)]
            if "mesh" in node:
                return self.document["meshes"][node["mesh"]]["primitives"][0]
            pending += node.get("children", [])
        raise KeyError(name)


def repaired_bounds(glb: Glb, index: int) -> None:
    """State min and max anew, so that a change of numbers is not given away by them."""
    spec = glb.document["accessors"][index]
    if "min" in spec:
        values = glb.numbers(index).astype(float)
        spec["min"], spec["max"] = values.min(axis=0).tolist(), values.max(axis=0).tolist()


def animated_matrix(glb):
    node = glb.node("rocker")
    node["matrix"] = np.eye(4).ravel().tolist()


def wrong_max(glb):
    times = glb.sampler("rocker", "rotation")["input"]
    glb.document["accessors"][times]["max"] = [3.0]


def not_unit(glb):
    glb.keys("rocker", "rotation")[9] *= 1.5


def times_back(glb):
    index = glb.sampler("rocker", "rotation")["input"]
    times = glb.numbers(index)
    times[[9, 10]] = times[[10, 9]]


def no_root_rotation(glb):
    glb.document["nodes"][glb.document["scenes"][0]["nodes"][0]]["rotation"] = [0, 0, 0, 1]


def millimetres(glb):
    for name in ("crank", "coupler", "rocker"):
        try:
            glb.keys(name, "translation")[:] *= 1000
        except StopIteration:
            node = glb.node(name)
            node["translation"] = [1000 * v for v in node["translation"]]


def wxyz(glb):
    for name in ("crank", "coupler", "rocker"):
        q = glb.keys(name, "rotation")
        q[:] = q[:, [3, 0, 1, 2]].copy()


def swapped_targets(glb):
    a, b = glb.index("coupler"), glb.index("rocker")
    for channel in glb.document["animations"][0]["channels"]:
        node = channel["target"]["node"]
        channel["target"]["node"] = {a: b, b: a}.get(node, node)


def duplicate_name(glb):
    glb.node("rocker")["name"] = "coupler"


def sign_flip(glb):
    glb.keys("rocker", "rotation")[9] *= -1


def winding(glb):
    primitive = glb.mesh_of("rocker")
    triangles = glb.numbers(primitive["indices"]).reshape(-1, 3)
    triangles[:] = triangles[:, ::-1].copy()
    normals = primitive["attributes"].get("NORMAL")
    if normals is not None:  # turned as well: nothing but the volume gives it away
        glb.numbers(normals)[:] *= -1
        repaired_bounds(glb, normals)


def no_alpha_mode(glb):
    material = next(m for m in glb.document["materials"] if m["pbrMetallicRoughness"]["baseColorFactor"][3] < 1)
    del material["alphaMode"]


LISTED = {
    # a survey seeded these: gltf-validator sees four, comparing poses in three.js five more, nobody the last three
    "matrix on an animated node": (animated_matrix, "gltf.matrix"),
    "wrong min and max": (wrong_max, "gltf.minmax"),
    "quaternion not unit": (not_unit, "gltf.quaternion"),
    "time not increasing": (times_back, "gltf.times"),
    "no z-up root rotation": (no_root_rotation, "compare.pose"),
    "millimetres": (millimetres, "compare.pose"),
    "wxyz order": (wxyz, "compare.pose"),
    "swapped targets": (swapped_targets, "compare.pose"),
    "duplicate names": (duplicate_name, "gltf.duplicate_name"),
    "sign flip": (sign_flip, "gltf.quaternion_sign"),
    "inverted winding": (winding, "gltf.winding"),
    "missing alphaMode": (no_alpha_mode, "gltf.alpha"),
}


def one_key(glb):
    translation = glb.keys("rocker", "rotation")
    angle = 2e-4
    x, y, z, w = translation[9].astype(float)
    s, c = np.sin(angle / 2), np.cos(angle / 2)
    translation[9] = [c * x + s * w, c * y + s * z, c * z - s * y, c * w - s * x]


def moved(glb):
    root = glb.document["nodes"][glb.document["scenes"][0]["nodes"][0]]
    root["translation"] = [0, 0, 2e-6]


def late(glb):
    index = glb.sampler("rocker", "rotation")["input"]
    glb.numbers(index)[:] += 0.5
    repaired_bounds(glb, index)


def faster(glb):
    index = glb.sampler("rocker", "rotation")["input"]
    glb.numbers(index)[:] *= np.float32(0.4)
    repaired_bounds(glb, index)


def not_finite(glb):
    glb.keys("rocker", "rotation")[9, 0] = np.nan


def scaled_link(glb):
    glb.node("rocker")["scale"] = [1, 1, 2]


def mirrored_link(glb):
    glb.node("rocker")["scale"] = [1, -1, 1]


def normals_against(glb):
    index = glb.mesh_of("rocker")["attributes"]["NORMAL"]
    glb.numbers(index)[:] *= -1
    repaired_bounds(glb, index)


def beyond_buffer(glb):
    glb.document["accessors"][glb.mesh_of("rocker")["indices"]]["count"] += 10_000_000


def huge_count(glb):
    glb.document["accessors"][0]["count"] = 2**31


def short_stride(glb):
    view = glb.document["accessors"][glb.mesh_of("rocker")["attributes"]["POSITION"]]["bufferView"]
    glb.document["bufferViews"][view]["byteStride"] = 8


def index_beyond(glb):
    indices = glb.numbers(glb.mesh_of("rocker")["indices"])
    indices[0] = 60_000


def lost_clip(glb):
    glb.document["animations"][0]["name"] = "something_else"


def lost_link(glb):
    glb.node("rocker").update(name="lever", extras={"link": "lever"})


def other_model(glb):
    glb.document["asset"]["extras"]["model_hash"] = "sha256:" + "0" * 64


def bigger_mesh(glb):
    index = glb.mesh_of("rocker")["attributes"]["POSITION"]
    glb.numbers(index)[:] *= 1.1
    repaired_bounds(glb, index)


def own_ancestor(glb):
    glb.node("rocker")["children"] = [glb.document["scenes"][0]["nodes"][0]]


def too_few_values(glb):
    glb.document["accessors"][glb.sampler("rocker", "rotation")["output"]]["count"] -= 1


MORE = {
    "one key turned by 0.2 mrad": (one_key, "compare.pose"),
    "moved by 2 um": (moved, "compare.pose"),
    "starts late": (late, "gltf.start"),
    "plays too fast": (faster, "compare.times"),
    "not finite": (not_finite, "gltf.finite"),
    "scale on a link": (scaled_link, "gltf.scale"),
    "mirrored link": (mirrored_link, "gltf.mirrored"),
    "normals against the winding": (normals_against, "gltf.normals_against"),
    "accessor beyond its buffer": (beyond_buffer, "gltf.bounds"),
    "huge count": (huge_count, "gltf.bounds"),
    "stride below an element": (short_stride, "gltf.bounds"),
    "index beyond the points": (index_beyond, "gltf.index"),
    "lost clip": (lost_clip, "compare.clip"),
    "lost link": (lost_link, "compare.missing_link"),
    "other model": (other_model, "compare.model_hash"),
    "own ancestor": (own_ancestor, "gltf.tree"),
    "too few values": (too_few_values, "gltf.samples"),
}


def spoilt(good: Path, folder: Path, spoil) -> Path:
    shutil.copytree(good, folder, dirs_exist_ok=True)
    glb = Glb((good / "bars.glb").read_bytes())
    spoil(glb)
    (folder / "bars.glb").write_bytes(glb.bytes())
    return folder


def test_taking_it_apart_changes_nothing(good, tmp_path):
    assert base.grave(audit(spoilt(good, tmp_path, lambda glb: None)).findings) == []


@pytest.mark.parametrize("name", [*LISTED, *MORE])
def test_each_defect_is_named(name, good, tmp_path):
    spoil, code = {**LISTED, **MORE}[name]
    report = audit(spoilt(good, tmp_path, spoil))
    found = [f for f in base.grave(report.findings) if f.code == code]
    assert found, [(f.code, f.message) for f in report.findings]
    assert found[0].message.endswith(".")
    assert report.exit_code > 0 or found[0].severity == "warning"


def test_a_bigger_mesh_is_seen_beside_another_file(good, tmp_path):
    folder = spoilt(good, tmp_path, bigger_mesh)
    shutil.copytree(good, tmp_path / "second")
    assert "compare.shape" in {f.code for f in audit(folder).findings}


def test_a_stride_below_an_element_is_stated_with_both_sizes(good, tmp_path):
    (found,) = [f for f in audit(spoilt(good, tmp_path, short_stride)).findings if f.code == "gltf.bounds"]
    assert "has byteStride 8, but an element of accessor" in found.message
    assert found.message.endswith("has 12 bytes.")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("no z-up root rotation", "the up axis is wrong"),
        ("millimetres", "millimetres"),
        ("wxyz order", "w, x, y, z"),
        ("moved by 2 um", "2 um"),
    ],
)
def test_the_mistake_is_guessed(name, reason, good, tmp_path):
    report = audit(spoilt(good, tmp_path, {**LISTED, **MORE}[name][0]))
    assert any(reason in f.message for f in report.findings if f.code == "compare.pose")


# ---------------------------------------------------------------------------------------- files of other people


def simple(path: Path, mode: str = "LINEAR", matrix_parent: bool = True) -> Path:
    """Write a .gltf with a matrix node above an animated one, as another program might; its data in a data URI."""
    times = np.array([0, 1, 2], "<f4")
    half = np.sin(np.pi / 4)
    turn = np.array([[0, 0, 0, 1], [0, half, 0, half], [0, 1, 0, 0]], "<f4")
    if mode == "CUBICSPLINE":
        zero = np.zeros_like(turn)
        turn = np.stack([zero, turn, zero], axis=1).reshape(-1, 4)
    data = times.tobytes() + turn.tobytes()
    parent = {"name": "parent", "children": [1]}
    if matrix_parent:
        parent["matrix"] = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1]
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [parent, {"name": "child", "translation": [0.5, 0, 0]}],
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12},
            {"buffer": 0, "byteOffset": 12, "byteLength": turn.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "SCALAR", "min": [0], "max": [2]},
            {"bufferView": 1, "componentType": 5126, "count": len(turn), "type": "VEC4"},
        ],
        "animations": [
            {
                "name": "spin",
                "samplers": [{"input": 0, "output": 1, "interpolation": mode}],
                "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
            },
            {
                "name": "again",
                "samplers": [{"input": 0, "output": 1, "interpolation": mode}],
                "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
            },
        ],
    }
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("mode", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_matrix_nodes_clips_and_samplers_of_others_are_read(mode, tmp_path):
    content = read_gltf(simple(tmp_path / "x.gltf", mode), Ledger("x"))
    assert [c.name for c in content.clips] == ["spin", "again"]
    child = content.clips[0].links["child"]
    # In the file's world at (1 + 2 * 0.5, 2, 3), y up; here z is up.
    assert child[0, :3, 3] == pytest.approx([2, -3, 2])
    assert child[1, :3, 0] == pytest.approx([0, 1, 0], abs=1e-6)  # x turned to -z of the file
    assert base.grave(audit(tmp_path / "x.gltf").findings) == []


def test_samplers_between_their_keys(tmp_path):
    from twin.exchange.formats.glb.audit.clips import Channel

    t, values = np.array([0.0, 2.0]), np.array([[0.0, 0, 0], [2.0, 0, 0]])
    zero = np.zeros_like(values)
    at = np.array([-1.0, 0.5, 1.0, 3.0])
    assert Channel(0, "translation", "LINEAR", t, values).at(at)[:, 0] == pytest.approx([0, 0.5, 1, 2])
    assert Channel(0, "translation", "STEP", t, values).at(at)[:, 0] == pytest.approx([0, 0, 0, 2])
    spline = Channel(0, "translation", "CUBICSPLINE", t, values, zero, zero).at(at)[:, 0]
    assert spline == pytest.approx([0, 2 * (3 / 16 - 2 / 64), 1, 2])  # s = 1/4: 3 s^2 - 2 s^3


@pytest.mark.parametrize(
    ("aside", "turn", "said"),
    [
        (0.0, 0.0, None),
        (9e-6, 9e-5, None),
        (2e-5, 0.0, "halfway between two keys, the position of link 'arm' differs by 20 um from the linear"),
        (0.0, 2e-4, "halfway between two keys, the rotation of link 'arm' differs by 0.01146 deg from the linear"),
    ],
)
def test_a_pose_halfway_between_keys_is_judged_by_place_and_by_rotation(aside, turn, said):
    from twin.exchange.audit.clip_comparison import compare_clips
    from twin.exchange.audit.clip_references import Reference
    from twin.exchange.audit.file_content import Content, FileClip
    from twin.exchange.audit.ledger import Ledger

    times, keys = np.array([0.0, 1.0]), np.tile(np.eye(4), (2, 1, 1))
    middle = np.eye(4)[None].copy()
    middle[0, :2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    middle[0, 0, 3] = aside
    clip = FileClip("swing", times, {"arm": keys}, middle={"arm": middle})
    ledger = Ledger("x.glb")
    compare_clips(
        [Content(ledger, "glb", [clip])], {"swing": Reference(FileClip("swing", times, {"arm": keys}), "the track")}
    )
    rows = {c.check.split(": ")[1]: (c.worst, c.unit) for c in ledger.checks if "halfway" in c.check}
    assert rows["position halfway between keys against the track"] == (pytest.approx(aside, abs=1e-12), "m")
    assert rows["rotation halfway between keys against the track"] == (pytest.approx(turn, abs=1e-9), "rad")
    assert [said in f.message for f in ledger.found] == ([] if said is None else [True])


def test_a_buffer_outside_the_folder_is_not_read(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(100))
    path = simple(tmp_path / "inner/x.gltf")
    data = json.loads(path.read_text())
    data["buffers"][0]["uri"] = "../secret.bin"
    path.write_text(json.dumps(data))
    (finding,) = audit(path).findings
    assert finding.code == "gltf.buffer"
    assert "outside" in finding.message


def test_a_rest_pose_that_no_joint_allows_is_found_in_a_file_with_motion(good, tmp_path):
    """Its clips begin elsewhere, so that only viewers that show the file at rest show the fault."""
    mechanism = base.made.four_bar()
    assert audit(good, mechanism=mechanism).verdict == "agree"
    glb = Glb((good / "bars.glb").read_bytes())
    glb.links()[-1]["translation"][0] += 0.001
    (tmp_path / "bars.glb").write_bytes(glb.bytes())
    report = audit(tmp_path, mechanism=mechanism)
    assert report.verdict == "disagree"
    assert "states.rest" in {finding.code for finding in report.findings}


@pytest.mark.parametrize(("stated", "word"), [({}, "no alphaMode"), ({"alphaMode": "OPAQUE"}, "alphaMode OPAQUE")])
def test_a_transparent_material_that_is_shown_opaque_is_named_by_what_the_file_states(stated, word, good, tmp_path):
    glb = Glb((good / "bars.glb").read_bytes())
    no_alpha_mode(glb)
    for material in glb.document["materials"]:
        material.update(stated)
    (tmp_path / "bars.glb").write_bytes(glb.bytes())
    (found,) = [f for f in audit(tmp_path / "bars.glb").findings if f.code == "gltf.alpha"]
    assert f"but {word}: it is shown opaque." in found.message
