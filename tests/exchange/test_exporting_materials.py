"""Materials of all formats: the same names, colours and finishes, each format read here by means of its own."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

import twin
from twin.cad.description import load
from twin.core import spatial, units
from twin.exchange.formats.glb.write import write_glb
from twin.exchange.formats.mjcf.write import write_mjcf
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.formats.usdz.write import write_usdz
from twin.exchange.read import read
from twin.model.body import Body, Finish, Frame, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.usd.read import read_stage
from twin.usd.write import write_stage

GREY, SEEN_THROUGH = (0.4, 0.4, 0.4, 1.0), (0.4, 0.4, 0.4, 0.5)
STEEL, PLASTIC = Finish("steel", 1.0, 0.35), Finish("plastic", 0.0, 0.6)
LOOKS = {
    "pin": (GREY, STEEL),
    "cap": (GREY, PLASTIC),
    "key": (GREY, PLASTIC),  # shares a material
    "lens": (SEEN_THROUGH, PLASTIC),
    "bush": ((0.4001, 0.4, 0.4, 1.0), STEEL),  # no display shows the difference, but it is another material
    "rough_pin": (GREY, Finish("steel", 1.0, 0.9)),
    "unknown": ((1.0, 0.0, 0.5, 1.0), Finish()),
}

Row = tuple[str, tuple[float, ...], float | None, float | None]
"""Name, linear colour, metallic and roughness; None: the format cannot say it."""


def robot() -> Mechanism:
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    meshes = tuple(Mesh(name, corners, faces, *look) for name, look in LOOKS.items())
    weight = Inertia(1.0, np.zeros(3), np.eye(3) * 0.01)
    bodies = (Body("ground", meshes[:3]), Body("arm", meshes[3:], weight))
    joints = (Joint("hinge", "revolute", "ground", "arm", active=True),)
    frames = (Frame("tool", "arm", np.eye(4)),)
    return Mechanism("m", "ground", bodies, joints, frames, rest={b.name: np.eye(4) for b in bodies})


def linear(rgba: str) -> tuple[float, ...]:
    c = np.array(rgba.split(), float)
    return (*np.where(c[:3] <= 0.04045, c[:3] / 12.92, ((c[:3] + 0.055) / 1.055) ** 2.4), c[3])


def of_stage(path: Path) -> Iterator[tuple[str, Row]]:
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
            shader = material.ComputeSurfaceSource()[0]
            color, metallic, roughness = (shader.GetInput(n).Get() for n in ("diffuseColor", "metallic", "roughness"))
            alpha = shader.GetInput("opacity").Get() if shader.GetInput("opacity") else 1.0
            yield prim.GetName(), (material.GetPrim().GetName(), (*color, alpha), metallic, roughness)


def usd(mechanism: Mechanism, folder: Path) -> dict[str, Row]:
    rest = dict(mechanism.rest)
    return dict(of_stage(write_stage(mechanism, folder, rest, {"hinge": 0.0}).root))


def usdz(mechanism: Mechanism, folder: Path) -> dict[str, Row]:
    return dict(of_stage(write_usdz(mechanism, None, folder / "m.usdz")))


def glb(mechanism: Mechanism, folder: Path) -> dict[str, Row]:
    """By material, because all meshes of a body are one: each stands for the first part that has it."""
    data = write_glb(mechanism, (), folder / "m.glb").read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    used = {p["material"] for m in document["meshes"] for p in m["primitives"]}
    assert used == set(range(len(document["materials"])))
    rows = {}
    for m in document["materials"]:
        pbr = m["pbrMetallicRoughness"]
        rows[m["name"]] = (m["name"], pbr["baseColorFactor"], pbr["metallicFactor"], pbr["roughnessFactor"])
    return {mesh: rows[material.name] for mesh, material in mechanism.materials.items()}


def urdf(mechanism: Mechanism, folder: Path) -> dict[str, Row]:
    root = ET.parse(write_urdf(mechanism, folder)).getroot()
    colors = {m.get("name"): m.find("color").get("rgba") for m in root.findall("material")}
    out = {}
    for visual in root.iter("visual"):
        name = visual.find("material").get("name")
        out[visual.get("name").removesuffix("_visual")] = (name, linear(colors[name]), None, None)
    return out


def mjcf(mechanism: Mechanism, folder: Path) -> dict[str, Row]:
    m = mujoco.MjModel.from_xml_path(str(write_mjcf(mechanism, folder)))
    out = {}
    for g in range(m.ngeom):
        i = m.geom_matid[g]
        color = linear(" ".join(str(c) for c in m.mat_rgba[i]))
        out[m.mesh(m.geom_dataid[g]).name] = (m.mat(i).name, color, m.mat_metallic[i], m.mat_roughness[i])
    return out


@pytest.mark.parametrize("reader", [usd, usdz, glb, urdf, mjcf])
def test_every_format_says_the_same_names_and_finish(reader: Callable[[Mechanism, Path], dict[str, Row]], tmp_path):
    got = reader(robot(), tmp_path)
    assert set(got) == set(LOOKS)
    for mesh, (color, finish) in LOOKS.items():
        name, shown, metallic, roughness = got[mesh]
        assert name == robot().materials[mesh].name
        assert shown == pytest.approx(color, abs=1e-4)
        assert metallic is None or metallic == pytest.approx(finish.metallic)
        assert roughness is None or roughness == pytest.approx(finish.roughness)


def test_names_say_material_and_colour_and_no_two_materials_share_one():
    materials = robot().materials
    assert materials["pin"].name == "steel_aaaaaa"
    assert materials["cap"] is materials["key"]
    assert materials["cap"].name == "plastic_aaaaaa"
    assert materials["lens"].name == "plastic_aaaaaa80"
    assert materials["unknown"].name == "color_ff00bc"
    assert len({m.name for m in materials.values()}) == len(set(materials.values())) == len(LOOKS) - 1


def test_names_do_not_depend_on_what_else_the_robot_has():
    """What a user puts in the place of a material in another program stays when a part is added."""
    whole = robot()
    arm = Mechanism("m", "arm", (whole.body("arm"),), ())
    assert all(arm.materials[m.name].name == whole.materials[m.name].name for m in whole.body("arm").meshes[:1])


def test_stage_read_back_keeps_names_and_finish(tmp_path):
    mechanism = robot()
    write_stage(mechanism, tmp_path, {b.name: spatial.pose() for b in mechanism.bodies}, {"hinge": 0.0})
    back = read_stage(tmp_path / "m.usda")
    for mesh, material in mechanism.materials.items():
        assert back.materials[mesh].name == material.name
        assert (back.materials[mesh].finish.metallic, back.materials[mesh].finish.roughness) == (
            material.finish.metallic,
            material.finish.roughness,
        )


@pytest.mark.parametrize("name", twin.names())
def test_committed_stages_show_what_the_descriptions_declare(name):
    robot = twin.load(name)
    declared = load(robot.files.description).material
    for mesh, (material, _, metallic, roughness) in of_stage(robot.files.stage):
        spec = declared.get(material.rsplit("_", 1)[0])
        assert spec is not None, f"{mesh}: {material} is not a material of the description"
        assert (metallic, roughness) == pytest.approx((spec.metallic, spec.roughness))


@pytest.mark.parametrize("part", [0.0, 0.002, 0.003, 0.0031308, 0.004, 0.2, 0.5, 1.0])
def test_a_colour_for_displays_and_back_is_itself(part):
    assert units.linear(units.srgb(part)) == pytest.approx(part, abs=1e-8)
    assert units.srgb(units.linear(part)) == pytest.approx(part, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("write", [write_mjcf, write_urdf])
def test_a_colour_that_is_written_is_read_again(write, tmp_path):
    robot = twin.load("lapbot").weighed().mechanism
    back = read(write(robot, tmp_path)).mechanism
    for body in robot.bodies:
        got = sorted(m.color_rgba for m in back.body(body.name).meshes)
        np.testing.assert_allclose(got, sorted(m.color_rgba for m in body.meshes), atol=2e-4)
