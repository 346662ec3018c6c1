"""Small files that would need hours or gigabytes without limits, each with the command that reads it.

The name of each function describes its file.
"""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODEL = "3D/3dmodel.model"


@dataclass(frozen=True)
class Bomb:
    """A file that a command must refuse.

    Attributes:
        make: function that writes files to a folder and returns the file for the command.
        argv: arguments of `twin`, with the placeholders {file} and {folder}.
        says: part of the error message.
    """

    make: Callable[[Path], Path]
    argv: tuple[str, ...]
    says: str


NEW = ("new", "bomb", "--from", "{file}", "--out", "{folder}/out")
AUDIT = ("audit", "{file}")
INFO = ("info", "{file}")

BOMBS: dict[str, Bomb] = {}


def bomb(argv: tuple[str, ...], says: str) -> Callable[[Callable[[Path], Path]], Callable[[Path], Path]]:
    def keep(make: Callable[[Path], Path]) -> Callable[[Path], Path]:
        BOMBS[make.__name__] = Bomb(make, argv, says)
        return make

    return keep


def _write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def _robot_of(folder: Path, mesh: str) -> Path:
    """Write a URDF with two links, one with the given mesh file; return its path."""
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    shape = f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>'
    joint += '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    return _write(folder / "r.urdf", f'<robot name="r"><link name="a">{shape}</link><link name="b"/>{joint}</robot>')


def _glb(folder: Path, name: str, data: dict, binary: bytes = b"") -> Path:
    text = json.dumps({"asset": {"version": "2.0"}, **data}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return _write(folder / name, b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)


def _3mf(folder: Path, text: bytes) -> Path:
    with zipfile.ZipFile(folder / "m.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(MODEL, text)
    return _robot_of(folder, "m.3mf")


TRIANGLE = (
    '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices>'
    '<triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>'
)


def _doubled(levels: int, times: int) -> bytes:
    objects = [f'<object id="0">{TRIANGLE}</object>']
    part = '<component objectid="{}"/>'
    objects += [
        f'<object id="{i}"><components>{part.format(i - 1) * times}</components></object>' for i in range(1, levels + 1)
    ]
    return (
        f'<model><resources>{"".join(objects)}</resources><build><item objectid="{levels}"/></build></model>'.encode()
    )


# ------------------------------------------------------------------------------------------ of a reviewer


@bomb(NEW, "depth of its objects")
def threemf_doubled_39_times(folder: Path) -> Path:
    return _3mf(folder, _doubled(39, 2))


@bomb(NEW, "unpacked bytes")
def threemf_of_3_mb_that_unpacks_to_gigabytes(folder: Path) -> Path:
    rows = b'<vertex x="0" y="0" z="0"/>' * 400_000
    whole = b"<model><resources><object id='0'><mesh><vertices>" + rows * 100
    return _3mf(folder, whole)


@bomb(AUDIT, "depth of the nodes")
def glb_chain_of_200_000_nodes(folder: Path) -> Path:
    nodes = [{"children": [i + 1]} for i in range(199_999)] + [{}]
    return _glb(folder, "chain.glb", {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes})


@bomb(AUDIT, "depth of the brackets")
def usda_nested_20_000_deep(folder: Path) -> Path:
    return _write(folder / "deep.usda", "#usda 1.0\n" + 'def Xform "a" {\n' * 20_000 + "}\n" * 20_000)


@bomb(NEW, "<link> so far")
def urdf_chain_of_3000_joints(folder: Path) -> Path:
    return _chain(folder, 3000)


def _chain(folder: Path, count: int) -> Path:
    rows = ['<robot name="c"><link name="l0"/>']
    for i in range(count):
        ends = f'<parent link="l{i}"/><child link="l{i + 1}"/><axis xyz="0 0 1"/>'
        rows.append(f'<link name="l{i + 1}"/><joint name="j{i}" type="continuous">{ends}</joint>')
    return _write(folder / "chain.urdf", "".join(rows) + "</robot>")


@bomb(INFO, "bytes")
def toml_array_of_40_mb(folder: Path) -> Path:
    return _robot_folder(folder, "a = [" + "1," * 20_000_000 + "]")


def _robot_folder(folder: Path, text: str) -> Path:
    (folder / "robot/cad").mkdir(parents=True)
    _write(folder / "robot/cad/arm.toml", text)
    return folder / "robot"


ENTITIES = (
    '<?xml version="1.0" encoding="{}"?><!DOCTYPE robot [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;">]>'
    '<robot name="&b;"><link name="a"/></robot>'
)


@bomb(NEW, "document type or entities")
def urdf_in_utf_16_with_entities(folder: Path) -> Path:
    return _write(folder / "r.urdf", ENTITIES.format("utf-16").encode("utf-16"))


@bomb(AUDIT, "document type or entities")
def urdf_in_utf_16_with_entities_audited(folder: Path) -> Path:
    return _write(folder / "r.urdf", ENTITIES.format("utf-16").encode("utf-16"))


# ------------------------------------------------------------------------------------------ our own


@bomb(NEW, "vertices and triangles in its objects")
def threemf_of_few_levels_and_many_copies(folder: Path) -> Path:
    return _3mf(folder, _doubled(7, 60))


@bomb(NEW, "degrees of freedom")
def urdf_chain_of_400_joints(folder: Path) -> Path:
    """Write a chain that is read quickly; but the memory for its dynamics grows with the cube of the joint count."""
    return _chain(folder, 400)


@bomb(AUDIT, "nodes so far")
def glb_whose_nodes_are_shared(folder: Path) -> Path:
    nodes = [{"children": [i + 1] * 30} for i in range(9)] + [{}]
    return _glb(folder, "shared.glb", {"scenes": [{"nodes": [0]}], "nodes": nodes})


def _dae(folder: Path, nodes: str) -> Path:
    """Write a URDF with a Collada mesh: a triangle in node n0, and more nodes; the scene shows node n0."""
    source = '<source id="p"><float_array id="a" count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common>'
    source += '<accessor source="#a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
    source += '<param name="Z" type="float"/></accessor></technique_common></source>'
    mesh = '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="1">'
    mesh += '<input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>'
    geometry = f'<library_geometries><geometry id="g"><mesh>{source}{mesh}</mesh></geometry></library_geometries>'
    scene = '<library_visual_scenes><visual_scene id="s"><node><instance_node url="#n0"/></node></visual_scene>'
    scene += '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
    head = '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
    _write(folder / "m.dae", f"{head}{geometry}<library_nodes>{nodes}</library_nodes>{scene}</COLLADA>")
    return _robot_of(folder, "m.dae")


@bomb(NEW, "numbers in all instances")
def dae_whose_nodes_multiply(folder: Path) -> Path:
    rows = [f'<node id="n{i}">{f"""<node><instance_node url="#n{i + 1}"/></node>""" * 20}</node>' for i in range(8)]
    return _dae(folder, "".join(rows) + '<node id="n8"><instance_geometry url="#g"/></node>')


@bomb(NEW, "numbers in all instances")
def dae_whose_nodes_hide_behind_others_of_their_name(folder: Path) -> Path:
    rows = [f'<node id="n{i}">{f"""<node><instance_node url="#n{i + 1}"/></node>""" * 20}</node>' for i in range(8)]
    hidden = "".join(f'<node id="n{i}"/>' for i in range(9))
    return _dae(folder, hidden + "".join(rows) + '<node id="n8"><instance_geometry url="#g"/></node>' + hidden)


@bomb(NEW, "depth of the nodes")
def dae_chain_of_nodes_that_no_scene_shows(folder: Path) -> Path:
    rows = [f'<node id="n{i}"><instance_node url="#n{i + 1}"/></node>' for i in range(1, 9000)]
    return _dae(folder, "".join(rows) + '<node id="n0"/>')


@bomb(NEW, "depth of the elements")
def dae_nested_100_000_deep(folder: Path) -> Path:
    return _dae(folder, "<node>" * 100_000 + "</node>" * 100_000)


@bomb(NEW, "numbers")
def glb_whose_accessors_state_4_000_000_000_zeros(folder: Path) -> Path:
    accessors = [{"componentType": 5126, "count": 4_000_000_000, "type": "VEC3"}]
    data = {"accessors": accessors, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}
    _glb(folder, "m.glb", {**data, "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0})
    return _robot_of(folder, "m.glb")


@bomb(AUDIT, "numbers")
def glb_that_reads_one_buffer_a_thousand_times(folder: Path) -> Path:
    size = 1_200_000
    data = {
        "buffers": [{"byteLength": size}],
        "bufferViews": [{"buffer": 0, "byteLength": size}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": size // 12, "type": "VEC3"}] * 1000,
        "meshes": [{"primitives": [{"attributes": {"POSITION": i}} for i in range(1000)]}],
    }
    scene = {"nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0}
    return _glb(folder, "same.glb", {**data, **scene}, bytes(size))


@bomb(NEW, "not a regular file")
def gltf_whose_buffer_is_a_device(folder: Path) -> Path:
    data = {"asset": {"version": "2.0"}, "buffers": [{"uri": "../" * 20 + "dev/zero", "byteLength": 8}]}
    _write(folder / "m.gltf", json.dumps({**data, "scenes": [{"nodes": []}]}))
    return _robot_of(folder, "m.gltf")


@bomb(NEW, "rows stated in the header")
def ply_that_states_4_000_000_000_rows(folder: Path) -> Path:
    head = "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n0\n"
    _write(folder / "m.ply", head)
    return _robot_of(folder, "m.ply")


@bomb(NEW, "USD parser")
def usda_whose_references_multiply(folder: Path) -> Path:
    """Write eight small files, each with ten references to the next: more than a million prims."""
    for level in range(8):
        below = "".join(f'def "p{i}" (references = @{level + 1}.usda@</a>) {{}}\n' for i in range(10))
        _write(
            folder / f"{level}.usda", f'#usda 1.0\n(defaultPrim = "a")\ndef "a" {{\n{below if level < 7 else ""}}}\n'
        )
    return folder / "0.usda"


@bomb(AUDIT, " prims; the limit")
def usda_whose_instances_multiply(folder: Path) -> Path:
    rows = ['#usda 1.0\ndef "a0" {\ndef "leaf" {}\n}\n']
    for level in range(1, 8):
        refs = "".join(f'def "p{i}" (\ninstanceable = true\nreferences = </a{level - 1}>\n) {{}}\n' for i in range(10))
        rows.append(f'def "a{level}" {{\n{refs}}}\n')
    return _write(folder / "many.usda", "".join(rows))


@bomb(AUDIT, "unpacked bytes")
def usdz_that_unpacks_to_gigabytes(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "z.usdz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.usda", "#usda 1.0\n")
        for i in range(30):
            archive.writestr(f"{i}.png", bytes(40_000_000))
    return folder / "z.usdz"


@bomb(NEW, "MJCF parser")
def mjcf_that_replicates_10_000_000_bodies(folder: Path) -> Path:
    body = '<body><joint/><geom size="0.1"/></body>'
    for _ in range(7):
        body = f'<replicate count="10" offset="1 0 0">{body}</replicate>'
    return _write(folder / "r.xml", f"<mujoco><worldbody>{body}</worldbody></mujoco>")


@bomb(AUDIT, "MJCF parser")
def mjcf_with_a_height_field_of_gigabytes(folder: Path) -> Path:
    field = '<asset><hfield name="h" nrow="40000" ncol="40000" size="1 1 1 1"/></asset>'
    return _write(folder / "h.xml", f'<mujoco>{field}<worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>')


@bomb(NEW, "included files")
def sdf_whose_includes_multiply(folder: Path) -> Path:
    for level in range(8):
        below = f"<include><uri>{level + 1}.sdf</uri><name>n{{}}</name></include>"
        rows = "".join(below.format(i) for i in range(20)) if level < 7 else "<link name='l'/>"
        _write(folder / f"{level}.sdf", f"<sdf version='1.9'><model name='m{level}'>{rows}</model></sdf>")
    return folder / "0.sdf"


@bomb(NEW, "depth of the elements")
def urdf_nested_100_000_deep(folder: Path) -> Path:
    return _write(folder / "d.urdf", '<robot name="r">' + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>")


@bomb(NEW, "STEP parser")
def step_whose_assemblies_double_30_times(folder: Path) -> Path:
    return _write(folder / "d.step", step_doubled(30))


@bomb(NEW, "no length unit")
def step_whose_unit_is_looked_for_in_a_megabyte_of_brackets(folder: Path) -> Path:
    return _write(folder / "b.step", "ISO-10303-21;\n" + "=(" * 1_000_000 + "\nEND-ISO-10303-21;\n")


@bomb(AUDIT, "objects and lists")
def track_of_10_000_000_empty_objects(folder: Path) -> Path:
    return _write(folder / "t.json", '{"schema": "twin-track", "links": [' + "{}," * 10_000_000 + "{}]}")


@bomb(AUDIT, "bytes")
def obj_beside_a_urdf_of_60_mb(folder: Path) -> Path:
    _write(folder / "m.obj", "v 0 0 0\n" * 7_500_000)
    return _robot_of(folder, "m.obj")


@bomb(INFO, "depth of the brackets")
def toml_nested_5000_deep(folder: Path) -> Path:
    return _robot_folder(folder, "a = " + "[" * 5000 + "]" * 5000)


@bomb(INFO, "depth of the dotted names")
def toml_name_of_200_000_parts(folder: Path) -> Path:
    return _robot_folder(folder, "a." * 200_000 + "b = 1")


@bomb(INFO, "digits")
def toml_number_of_400_000_digits(folder: Path) -> Path:
    return _robot_folder(folder, "a = " + "9" * 400_000)


@bomb(NEW, "bytes")
def closures_of_500_kb(folder: Path) -> Path:
    _write(folder / "r.yaml", "closed_loop: [" + "[a, b]," * 70_000 + "]")
    return _robot_of(folder, "none.stl")


def _png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes(height * (1 + width // 8)), 9)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
        + chunk(b"IDAT", rows)
        + chunk(b"IEND", b"")
    )


@bomb(NEW, "MJCF parser")
def mjcf_with_a_texture_of_40_000_by_40_000(folder: Path) -> Path:
    _write(folder / "t.png", _png(40_000, 40_000))
    asset = '<asset><texture name="t" type="2d" file="t.png"/></asset>'
    body = '<body><joint/><geom size="0.1"/></body>'
    return _write(folder / "t.xml", f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>")


def step_doubled(levels: int) -> str:
    """Return the text of a STEP file in which each assembly contains the previous one twice; the first is the crank."""
    text = (ROOT / "tests/data/cad/crank.step").read_text("latin-1")
    rows, below, shape = [], 5, 10  # product definition and shape of the previous level
    for level in range(levels):
        n = 100_000 + 100 * level
        rows += [
            f"#{n + 1}=SHAPE_DEFINITION_REPRESENTATION(#{n + 2},#{n + 8});",
            f"#{n + 2}=PRODUCT_DEFINITION_SHAPE('','',#{n + 3});",
            f"#{n + 3}=PRODUCT_DEFINITION('design','',#{n + 4},#{n + 7});",
            f"#{n + 4}=PRODUCT_DEFINITION_FORMATION('','',#{n + 5});",
            f"#{n + 5}=PRODUCT('a{level}','a{level}','',(#{n + 6}));",
            f"#{n + 6}=PRODUCT_CONTEXT('',#2,'mechanical');",
            f"#{n + 7}=PRODUCT_DEFINITION_CONTEXT('part definition',#2,'design');",
            f"#{n + 8}=SHAPE_REPRESENTATION('',(#11,#{n + 9},#{n + 10}),#18);",
            f"#{n + 9}=AXIS2_PLACEMENT_3D('',#12,#13,#14);",
            f"#{n + 10}=AXIS2_PLACEMENT_3D('',#12,#13,#14);",
        ]
        for k in (0, 1):
            m = n + 20 + 10 * k
            rows += [
                f"#{m}=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{m + 1},#{m + 3});",
                f"#{m + 1}=( REPRESENTATION_RELATIONSHIP('','',#{shape},#{n + 8})"
                f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{m + 2})SHAPE_REPRESENTATION_RELATIONSHIP() );",
                f"#{m + 2}=ITEM_DEFINED_TRANSFORMATION('','',#11,#{n + 9 + k});",
                f"#{m + 3}=PRODUCT_DEFINITION_SHAPE('Placement','Placement of an item',#{m + 4});",
                f"#{m + 4}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('{m}','c{k}','',#{n + 3},#{below},$);",
            ]
        below, shape = n + 3, n + 8
    return text.replace("ENDSEC;\nEND-ISO", "\n".join(rows) + "\nENDSEC;\nEND-ISO")
