"""Seeded defects of exports: each is one change of one format, like a bug of a writer or a manual mistake.

An edit is a function of the bundle's folder; it returns False if the robot does not have the edited data. The audit
finds the correct cause if a finding names the edited file, and a code or a word of the defect.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from pxr import Gf, Sdf, UsdUtils

import twin
from made.glb_apart import Glb
from twin.exchange.write.clip import ClipAccuracy


@dataclass(frozen=True)
class Seed:
    """One kind of defect: its name, its edit, and patterns of its finding's place (`blamed`) and text (`says`)."""

    name: str
    edit: Callable[[Path], Any]
    blamed: str
    says: str


SEEDS: list[Seed] = []


def seed(blamed: str, says: str):
    """Return a decorator that adds an edit to `SEEDS`; for `blamed` and `says` see `Seed`."""

    def add(edit):
        SEEDS.append(Seed(edit.__name__, edit, blamed, says))
        return edit

    return add


def robot(folder: Path) -> str:
    return next(folder.glob("*.urdf")).stem


# ------------------------------------------------------------------------------------------------------ USD


def layers(folder: Path, name: str = "physics.usda") -> tuple[Sdf.Layer, str]:
    layer = Sdf.Layer.OpenAsAnonymous(str(folder / "usd" / name))
    return layer, robot(folder)


def stored(layer: Sdf.Layer, folder: Path, name: str = "physics.usda") -> None:
    file = folder / "usd" / name
    file.unlink()
    assert layer.Export(str(file))


def joints(layer: Sdf.Layer, name: str) -> list[Sdf.PrimSpec]:
    return [j for j in layer.GetPrimAtPath(f"/{name}/joints").nameChildren if j.name != "root_joint"]


def value(prim: Sdf.PrimSpec, name: str) -> Any:
    return prim.attributes[name].default if name in prim.attributes else None


def usd_joints(choose, change):
    """Return an edit that applies `change` to the first joint prim for which `choose` is true."""

    def edit(folder):
        layer, name = layers(folder)
        chosen = [j for j in joints(layer, name) if choose(j)]
        if not chosen:
            return False
        change(chosen[0], layer)
        stored(layer, folder)
        return True

    return edit


def driven(j) -> bool:
    return bool(value(j, "twin:active"))


def drive_attribute(j, suffix: str) -> Sdf.AttributeSpec:
    return next(a for a in j.attributes if a.name.startswith("drive:") and a.name.endswith(suffix))


def scaled(suffix: str, factor: float):
    def change(j, layer):
        a = drive_attribute(j, suffix)
        a.default = a.default * factor

    return change


def removed(j, layer) -> None:
    del j.nameParent.nameChildren[j.name]


def has_drive(j) -> bool:
    return any(a.name.endswith("physics:stiffness") for a in j.attributes)


def put(name: str, new):
    def change(j, layer):
        a = j.attributes[name]
        a.default = new(a.default)

    return change


def add(name: str, *parts: tuple[str, Callable, Callable, str]) -> None:
    for kind, choose, change, says in parts:
        SEEDS.append(Seed(f"{name}: {kind}", usd_joints(choose, change), r"\.usd", says))


def loop(j) -> bool:
    return bool(value(j, "physics:excludeFromArticulation"))


def turning(j) -> bool:
    return j.typeName == "PhysicsRevoluteJoint"


def moved_point(v):
    return Gf.Vec3f(v[0] + 0.005, v[1] + 0.004, v[2])


def no_drive(j, layer) -> None:
    for a in [a for a in j.attributes if a.name.startswith("drive:") or a.name == "twin:active"]:
        del j.properties[a.name]
    schemas = j.GetInfo("apiSchemas")
    schemas.prependedItems = [s for s in schemas.prependedItems if not s.startswith("PhysicsDriveAPI")]
    j.SetInfo("apiSchemas", schemas)


def other_body(j, layer) -> None:
    path = j.relationships["physics:body1"].targetPathList.explicitItems[0]
    own = j.relationships["physics:body0"].targetPathList.explicitItems[0]
    others = [c.path for c in layer.GetPrimAtPath(path.GetParentPath()).nameChildren if c.name != "joints"]
    other = next(p for p in others if p not in (path, own))
    j.relationships["physics:body1"].targetPathList.explicitItems = [other]


def no_limits(j, layer) -> None:
    for name in ("physics:lowerLimit", "physics:upperLimit"):
        del j.properties[name]


def swapped_limits(j, layer) -> None:
    a, b = (j.attributes[f"physics:{n}Limit"] for n in ("lower", "upper"))
    a.default, b.default = b.default, a.default


def renamed(j, layer) -> None:
    j.name = f"{j.name}_renamed"


def disabled(j, layer) -> None:
    Sdf.AttributeSpec(j, "physics:jointEnabled", Sdf.ValueTypeNames.Bool).default = False


add(
    "USD",
    ("loop joint deleted", loop, removed, "joint|reach"),
    ("tree joint deleted", lambda j: driven(j) and not loop(j), removed, "joint"),
    ("passive joint deleted", lambda j: not driven(j) and turning(j), removed, "joint"),
    ("joint disabled", turning, disabled, "joint"),
    ("joint renamed", turning, renamed, "joint"),
    ("stiffness", has_drive, scaled("stiffness", 1e-5), "stiffness"),
    ("damping", has_drive, scaled("damping", 1e3), "damping"),
    ("largest force", has_drive, scaled("maxForce", 10.0), "effort"),
    (
        "speed",
        lambda j: "physxJoint:maxJointVelocity" in j.attributes,
        put("physxJoint:maxJointVelocity", lambda v: 1e3 * v),
        "speed",
    ),
    (
        "upper limit",
        lambda j: "physics:upperLimit" in j.attributes,
        put("physics:upperLimit", lambda v: v * 1.2 + 0.01),
        "limit",
    ),
    ("limits swapped", lambda j: "physics:upperLimit" in j.attributes, swapped_limits, "limit"),
    ("no limits", lambda j: "physics:upperLimit" in j.attributes, no_limits, "limit"),
    ("driven joint passive", driven, put("twin:active", lambda v: False), "passive|driven"),
    ("no drive", driven, no_drive, "passive|driven|stiffness"),
    ("axis", lambda j: turning(j), put("physics:axis", lambda v: "X"), "axis|joint"),
    ("anchor", lambda j: turning(j), put("physics:localPos0", moved_point), "joint|line or point"),
    ("anchor of the child", lambda j: turning(j), put("physics:localPos1", moved_point), "joint|line or point"),
    ("loop anchor", loop, put("physics:localPos1", moved_point), "joint|line or point"),
    ("revolute made fixed", turning, lambda j, _: setattr(j, "typeName", "PhysicsFixedJoint"), "kind|joint"),
    (
        "slide made a turn",
        lambda j: j.typeName == "PhysicsPrismaticJoint",
        lambda j, _: setattr(j, "typeName", "PhysicsRevoluteJoint"),
        "kind|joint",
    ),
    ("joint on another body", turning, other_body, "links|joint"),
)


def usd_masses(change, whole: bool = False):
    def edit(folder):
        layer, name = layers(folder)
        bodies = [b for b in layer.GetPrimAtPath(f"/{name}").nameChildren if value(b, "physics:mass")]
        if not bodies:
            return False
        for b in bodies if whole else bodies[-1:]:
            change(b)
        stored(layer, folder)
        return True

    return edit


def times(name: str, factor):
    def change(b):
        b.attributes[name].default = b.attributes[name].default * factor

    return change


def shifted(name: str, by):
    def change(b):
        b.attributes[name].default = b.attributes[name].default + by

    return change


def negative_moment(b):
    v = b.attributes["physics:diagonalInertia"].default
    b.attributes["physics:diagonalInertia"].default = Gf.Vec3f(-v[0], v[1], v[2])


def turned_axes(b):
    q = b.attributes["physics:principalAxes"].default
    b.attributes["physics:principalAxes"].default = Gf.Quatf(Gf.Quatd(q) * Gf.Quatd(0.8, 0.36, 0.48, 0.0))


for kind, change, whole, says in (
    ("mass x 1000", times("physics:mass", 1e3), False, "mass|density"),
    ("all masses x 1000", times("physics:mass", 1e3), True, "mass|density"),
    ("mass zero", times("physics:mass", 0.0), False, "mass"),
    ("mass centre", shifted("physics:centerOfMass", Gf.Vec3f(0.1, 0, 0)), False, "centre"),
    ("inertia x 10", times("physics:diagonalInertia", 10.0), False, "inertia"),
    ("inertia negative", negative_moment, False, "inertia|moment"),
    ("inertia turned", turned_axes, False, "inertia"),
):
    SEEDS.append(Seed(f"USD: {kind}", usd_masses(change, whole), r"\.usd", says))


@seed(r"_sim\.usda", "gravity")
def usd_gravity_up(folder):
    return usd_scene(folder, "physics:gravityDirection", Gf.Vec3f(0, 0, 1))


@seed(r"_sim\.usda", "gravity")
def usd_gravity_981(folder):
    return usd_scene(folder, "physics:gravityMagnitude", 981.0)


def usd_scene(folder, name, new):
    file = f"{robot(folder)}_sim.usda"
    layer, _ = layers(folder, file)
    layer.GetAttributeAtPath(f"/physicsScene.{name}").default = new
    stored(layer, folder, file)


@seed(r"\.usd", "held|fixed to the world|root_joint|anchor|float")
def usd_base_loose(folder):
    layer, name = layers(folder)
    del layer.GetPrimAtPath(f"/{name}/joints").nameChildren["root_joint"]
    stored(layer, folder)


def geometry(folder, wanted):
    """Return (geometry layer, its prims for which `wanted` is true)."""
    layer, name = layers(folder, "geometry.usdc")
    found = []
    layer.Traverse(Sdf.Path(f"/{name}"), lambda p: found.append(p))
    prims = [layer.GetPrimAtPath(p) for p in found if p.IsPrimPath()]
    return layer, [p for p in prims if wanted(p)]


def frames(folder):
    return geometry(folder, lambda p: value(p, "twin:kind") == "frame")


@seed(r"\.usd", "frame")
def usd_tool_frame(folder):
    layer, marks = frames(folder)
    mark = next(m for m in marks if value(m, "twin:name") == "tool" or m.name == "tool")
    mark.attributes["xformOp:translate"].default = mark.attributes["xformOp:translate"].default + Gf.Vec3d(0.05, 0, 0)
    stored(layer, folder, "geometry.usdc")


@seed(r"\.usd", "frame")
def usd_endoscope_longer(folder):
    layer, marks = frames(folder)
    mark = next((m for m in marks if "tip" in m.name), None)
    if mark is None:
        return False
    mark.attributes["xformOp:translate"].default = mark.attributes["xformOp:translate"].default + Gf.Vec3d(0, 0, 0.1)
    stored(layer, folder, "geometry.usdc")


@seed(r"\.usd", "frame|tool")
def usd_other_tool(folder):
    layer, name = layers(folder)
    root = layer.GetPrimAtPath(f"/{name}")
    root.attributes["twin:tool"].default = "base"
    stored(layer, folder)


def a_mesh(p) -> bool:
    return p.typeName == "Mesh" and len(p.attributes["points"].default) > 50


@seed(r"\.usd", "mesh|point")
def usd_point_moved(folder):
    layer, meshes = geometry(folder, a_mesh)
    points = meshes[0].attributes["points"]
    values = np.array(points.default)
    values[0] += (values.mean(axis=0) - values[0]) / np.linalg.norm(values.mean(axis=0) - values[0]) * 3e-3
    points.default = type(points.default).FromNumpy(values)
    stored(layer, folder, "geometry.usdc")


@seed(r"\.usd", "colour")
def usd_colour(folder):
    layer, shaders = geometry(folder, lambda p: "inputs:diffuseColor" in p.attributes)
    shaders[0].attributes["inputs:diffuseColor"].default = Gf.Vec3f(0.9, 0.05, 0.5)
    stored(layer, folder, "geometry.usdc")


def usd_head(key: str, new):
    def edit(folder):
        for name in (f"{robot(folder)}{end}.usda" for end in ("", "_sim")):
            layer, _ = layers(folder, name)
            layer.pseudoRoot.SetInfo(key, new)
            stored(layer, folder, name)

    return edit


def usd_winding(folder):
    layer, meshes = geometry(folder, lambda p: p.typeName == "Mesh")
    indices = meshes[0].attributes["faceVertexIndices"]
    indices.default = type(indices.default).FromNumpy(np.array(indices.default)[::-1].copy())
    stored(layer, folder, "geometry.usdc")


def usd_link_renamed(folder):
    layer, name = layers(folder, "geometry.usdc")
    link = [p for p in layer.GetPrimAtPath(f"/{name}").nameChildren if p.name not in ("joints", "materials")][-1]
    link.name = f"{link.name}_renamed"
    stored(layer, folder, "geometry.usdc")


def cut(path: Path, share: float = 0.6) -> None:
    """Truncate a file to a fraction of its bytes."""
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(data[: int(share * len(data))])


for kind, edit, says in (
    ("metres said to be millimetres", usd_head("metersPerUnit", 0.001), "unit|mesh|link|joint|mass|density"),
    ("up axis", usd_head("upAxis", "Y"), "up axis|gravity|link"),
    ("inside out", usd_winding, "mesh|winding|inside|normal"),
    ("link renamed", usd_link_renamed, "link|joint|body"),
    ("cut off", lambda folder: cut(folder / "usd/geometry.usdc"), "read|open"),
):
    SEEDS.append(Seed(f"USD: {kind}", edit, r"\.usd", says))


def baked(change):
    """Return an edit of a stage's baked motion by `change`: (layer, sampled links, sorted time codes).

    A change returns False if it has nothing to edit.
    """

    def edit(folder):
        name = next(iter(sorted((folder / "usd/motion").glob("*.usdc")))).relative_to(folder / "usd").as_posix()
        layer, _ = layers(folder, name)
        moving = prims_of(layer, lambda p: "xformOp:orient" in p.attributes)
        codes = layer.ListTimeSamplesForPath(f"{moving[-1].path}.xformOp:orient")
        if change(layer, [str(p.path) for p in moving], codes) is False:
            return False
        stored(layer, folder, name)
        return True

    return edit


def sample(op: str, new):
    def change(layer, moving, codes):
        path, code = f"{moving[-1]}.xformOp:{op}", codes[len(codes) // 2]
        layer.SetTimeSample(path, code, new(layer.QueryTimeSample(path, code)))

    return change


def samples_swapped(layer, moving, codes):
    for op in ("translate", "orient"):
        one, two = (f"{p}.xformOp:{op}" for p in moving[-2:])
        for code in codes:
            a, b = layer.QueryTimeSample(one, code), layer.QueryTimeSample(two, code)
            layer.SetTimeSample(one, code, b)
            layer.SetTimeSample(two, code, a)


def samples_slower(layer, moving, codes):
    layer.timeCodesPerSecond /= 2


def samples_w_last(layer, moving, codes):
    for code in codes:
        path = f"{moving[-1]}.xformOp:orient"
        q = layer.QueryTimeSample(path, code)
        x, y, z = q.imaginary
        layer.SetTimeSample(path, code, type(q)(z, q.real, x, y))


for kind, change, says in (
    ("one key", sample("translate", lambda v: v + type(v)(1e-3, 0, 0)), "link"),
    ("sign flip", sample("orient", lambda q: -q), "sign"),
    ("links swapped", samples_swapped, "link"),
    ("half as fast", samples_slower, "time|key|lasts"),
    ("quaternions w last", samples_w_last, "link"),
):
    SEEDS.append(Seed(f"USD motion: {kind}", baked(change), r"\.usd", says))


# ----------------------------------------------------------------------------------------------------- USDZ


def usdz(folder, change):
    """Edit the layer of the .usdz; return False if `change` has nothing to edit."""
    file = next(folder.glob("*_ar.usdz"))
    with zipfile.ZipFile(file) as archive:
        name = archive.namelist()[0]
        archive.extract(name, folder)
    layer = Sdf.Layer.OpenAsAnonymous(str(folder / name))
    (folder / name).unlink()
    if change(layer) is False:
        return False
    layer.Export(str(folder / name))
    file.unlink()
    assert UsdUtils.CreateNewUsdzPackage(str(folder / name), str(file))
    (folder / name).unlink()
    return True


def prims_of(layer, wanted):
    found = []
    layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
    return [p for p in (layer.GetPrimAtPath(f) for f in found if f.IsPrimPath()) if wanted(p)]


@seed(r"\.usdz", "colour")
def usdz_colour(folder):
    def change(layer):
        prims_of(layer, lambda p: "inputs:diffuseColor" in p.attributes)[0].attributes[
            "inputs:diffuseColor"
        ].default = Gf.Vec3f(0.9, 0.05, 0.5)

    usdz(folder, change)


@seed(r"\.usdz", "mesh|point")
def usdz_point(folder):
    def change(layer):
        points = prims_of(layer, a_mesh)[0].attributes["points"]
        values = np.array(points.default)
        values[0] += (values.mean(axis=0) - values[0]) / np.linalg.norm(values.mean(axis=0) - values[0]) * 3e-3
        points.default = type(points.default).FromNumpy(values)

    usdz(folder, change)


@seed(r"\.usdz", "link")
def usdz_key(folder):
    def change(layer):
        moving = prims_of(
            layer,
            lambda p: (
                "xformOp:translate" in p.attributes and layer.ListTimeSamplesForPath(f"{p.path}.xformOp:translate")
            ),
        )
        path = f"{moving[-1].path}.xformOp:translate"
        codes = layer.ListTimeSamplesForPath(path)
        code = codes[len(codes) // 2]
        layer.SetTimeSample(path, code, layer.QueryTimeSample(path, code) + Gf.Vec3f(1e-3, 0, 0))

    usdz(folder, change)


@seed(r"\.usdz", "sign")
def usdz_sign_flip(folder):
    def change(layer):
        orients = [f"{p.path}.xformOp:orient" for p in prims_of(layer, lambda p: "xformOp:orient" in p.attributes)]
        path = [p for p in orients if layer.ListTimeSamplesForPath(p)][-1]
        codes = layer.ListTimeSamplesForPath(path)
        layer.SetTimeSample(path, codes[len(codes) // 2], -layer.QueryTimeSample(path, codes[len(codes) // 2]))

    usdz(folder, change)


@seed(r"\.usdz", "time|key|lasts")
def usdz_half_as_fast(folder):
    usdz(folder, lambda layer: setattr(layer, "timeCodesPerSecond", layer.timeCodesPerSecond / 2))


@seed(r"\.usdz", "unit|mesh|link")
def usdz_millimetres(folder):
    usdz(folder, lambda layer: layer.pseudoRoot.SetInfo("metersPerUnit", 0.001))


@seed(r"\.usdz", "up axis|up|link")
def usdz_z_up(folder):
    usdz(folder, lambda layer: layer.pseudoRoot.SetInfo("upAxis", "Z"))


@seed(r"\.usdz", "link")
def usdz_link_renamed(folder):
    def change(layer):
        link = prims_of(layer, lambda p: "xformOp:orient" in p.attributes)[-1]
        link.name = f"{link.name}_renamed"

    usdz(folder, change)


@seed(r"\.usdz", "mesh|winding|inside|normal")
def usdz_inside_out(folder):
    def change(layer):
        indices = prims_of(layer, lambda p: p.typeName == "Mesh")[0].attributes["faceVertexIndices"]
        indices.default = type(indices.default).FromNumpy(np.array(indices.default)[::-1].copy())

    usdz(folder, change)


@seed(r"\.usdz", "read|open|zip")
def usdz_cut_off(folder):
    cut(next(folder.glob("*_ar.usdz")))


# ----------------------------------------------------------------------------------------------- MJCF and URDF


def xml(suffix: str, change):
    """Return an edit that applies `change` to the XML tree of every file with a suffix in the bundle's folder."""

    def edit(folder):
        done = False
        for file in sorted(folder.glob(f"*{suffix}")):
            root = ET.fromstring(file.read_bytes())
            if change(root) is False:
                continue
            done = True
            file.unlink()
            file.write_bytes(ET.tostring(root))
        return done

    return edit


def parent_of(root, element):
    return next(p for p in root.iter() if element in list(p))


def renamed_everywhere(kind: str):
    """Return a change of the name of the last element of a kind with a shape, and of all references to this name."""

    def change(root):
        old = [e.get("name") for e in root.iter(kind) if e.find("visual") is not None or e.find("geom") is not None][-1]
        for e in root.iter():
            for key, value in e.attrib.items():
                if value == old and (e.tag == kind or key not in ("name", "mesh", "material")):
                    e.set(key, f"{old}_renamed")

    return change


def xml_cut(suffix: str):
    return lambda folder: [cut(p) for p in folder.glob(f"*{suffix}")]


SEEDS.append(Seed("MJCF: cut off", xml_cut(".xml"), r"\.xml", "read|rejects"))
SEEDS.append(Seed("URDF: cut off", xml_cut(".urdf"), r"\.urdf", "read|rejects"))


def xml_seed(kind: str, suffix: str, change, says: str) -> None:
    SEEDS.append(Seed(kind, xml(suffix, change), rf"{re.escape(suffix)}", says))


def attribute(path: str, name: str, new, which: int = 0):
    def change(root):
        found = [e for e in root.findall(path) if e.get(name) is not None]
        if len(found) <= which and which >= 0:
            return False
        found[which].set(name, new(found[which].get(name)))
        return True

    return change


def every(path: str, name: str, new):
    def change(root):
        found = [e for e in root.findall(path) if e.get(name) is not None]
        for e in found:
            e.set(name, new(e.get(name)))
        return bool(found)

    return change


def row(change):
    """Return a function from text to text that applies `change` to the numbers in it."""
    return lambda text: " ".join(f"{v:.12g}" for v in change(np.array(text.split(), float)))


def drop(path: str, which: int = 0):
    def change(root):
        found = root.findall(path)
        if not found:
            return False
        parent_of(root, found[which]).remove(found[which])
        return True

    return change


def by(factor: float):
    return row(lambda v: v * factor)


def plus(*offset: float):
    return row(lambda v: v + np.array(offset))


def mjcf_gains(kp: float = 1.0, kv: float = 1.0, count: int | None = 1):
    """Return a change of the gains (gainprm, biasprm) of position drives: force = kp (target - q) - kv q'."""

    def change(root):
        found = root.findall("actuator/general")[:count]
        for e in found:
            e.set("gainprm", by(kp)(e.get("gainprm")))
            e.set("biasprm", row(lambda v: v * (kp, kp, kv))(e.get("biasprm")))
        return bool(found)

    return change


def mjcf_actuators(name: str):
    def change(root):
        if len(found := root.findall("actuator/*")) < 2:
            return False
        a, b = found[:2]
        one, two = a.get(name), b.get(name)
        a.set(name, two)
        b.set(name, one)
        return True

    return change


def mjcf_gravity(text: str):
    def change(root):
        option = root.find("option")
        option = ET.SubElement(root, "option") if option is None else option
        option.set("gravity", text)

    return change


def swapped_inertials(root):
    found = root.findall(".//body/inertial")
    a, b = found[-1], found[-2]
    one, two = dict(a.attrib), dict(b.attrib)
    a.attrib.update(two)
    b.attrib.update(one)


def loose_base(root):
    root.find("worldbody/body").insert(0, ET.Element("freejoint"))


def swapped_meshes(root):
    geoms = [g for g in root.iter("geom") if g.get("mesh")]
    a, b = geoms[0], geoms[-1]
    one, two = a.get("mesh"), b.get("mesh")
    a.set("mesh", two)
    b.set("mesh", one)


for kind, change, says in (
    ("loop tie deleted", drop("equality/*"), "joint"),
    ("all ties deleted", lambda r: r.remove(r.find("equality")) if len(r.find("equality")) else False, "joint"),
    (
        "loop tie inactive",
        lambda r: r.find("equality")[0].set("active", "false") if len(r.find("equality")) else False,
        "joint",
    ),
    (
        "loop anchor moved",
        attribute("equality/connect", "anchor", plus(0.003, 0, 0.002)),
        "line or point|joint|equality",
    ),
    ("actuators swapped", mjcf_actuators("joint"), "actuator|stiffness"),
    ("actuator names swapped", mjcf_actuators("name"), "actuator"),
    ("actuator deleted", drop("actuator/*"), "passive|driven|keyframe|ctrl"),
    ("kp x 0.001", mjcf_gains(kp=1e-3), "stiffness"),
    ("all kp x 0.001", mjcf_gains(kp=1e-3, count=None), "stiffness"),
    ("kv x 100", mjcf_gains(kv=100), "damping"),
    ("forcerange x 10", attribute("actuator/*", "forcerange", by(10)), "effort"),
    ("mass x 1000", attribute(".//inertial", "mass", by(1e3), -1), "mass|density"),
    ("all masses x 1000", every(".//inertial", "mass", by(1e3)), "mass|density"),
    ("mass centre", attribute(".//inertial", "pos", plus(0.1, 0, 0), -1), "centre"),
    ("inertia x 10", attribute(".//inertial", "fullinertia", by(10), -1), "inertia"),
    ("inertias swapped", swapped_inertials, "inertia|mass"),
    ("gravity up", mjcf_gravity("0 0 9.81"), "gravity"),
    ("gravity 981", mjcf_gravity("0 0 -981"), "gravity"),
    ("gravity sideways", mjcf_gravity("0 -9.81 0"), "gravity"),
    ("no gravity", mjcf_gravity("0 0 0"), "gravity"),
    ("range", attribute(".//joint", "range", row(lambda v: v * [1, 1.3] + [0, 0.01])), "limit|range"),
    ("no range", lambda r: next(j for j in r.iter("joint") if j.get("range")).attrib.pop("range"), "limit|range"),
    ("axis turned round", attribute(".//joint", "axis", by(-1.0)), "axis|link"),
    ("axis tilted", attribute(".//joint", "axis", plus(0.02, 0.01, 0)), "axis|link"),
    (
        "hinge made a slide",
        lambda r: next((j for j in r.iter("joint") if j.get("type") == "hinge"), ET.Element("x")).set("type", "slide"),
        "kind|joint|link",
    ),
    ("joint deleted", drop(".//body/joint", -1), "kind|joint|link|unreadable"),
    ("joint renamed", attribute(".//body/joint", "name", lambda t: f"{t}_renamed", -1), "joint|name|unreadable"),
    ("base loose", loose_base, "fixed to the world|held|link"),
    ("frame moved", attribute(".//site[@name='frame_tool']", "pos", plus(0.05, 0, 0)), "frame"),
    ("frame turned", attribute(".//site[@name='frame_tool']", "quat", lambda t: "0.9 0.3 0.2 0.1"), "frame"),
    ("body renamed", renamed_everywhere("body"), "link"),
    ("degrees", lambda r: r.find("compiler").set("angle", "degree"), "limit|range|joint|link"),
    ("body moved", attribute(".//body/body", "pos", plus(0.002, 0, 0)), "link|equality"),
    ("colour", attribute(".//geom[@mesh]", "rgba", lambda t: "0.9 0.1 0.6 1"), "colour"),
    ("meshes swapped", swapped_meshes, "mesh"),
    ("mesh scale", attribute("asset/mesh", "scale", by(1.02)), "mesh"),
    ("keyframe open", attribute("keyframe/key", "qpos", row(lambda v: v + 0.3 * (np.arange(len(v)) == 0))), "keyframe"),
    ("keyframe control", attribute("keyframe/key", "ctrl", row(lambda v: v + 0.05)), "keyframe"),
):
    xml_seed(f"MJCF: {kind}", ".xml", change, says)


def urdf_parent(root):
    joints_ = list(root.findall("joint"))
    last = joints_[-1]
    links = [e.get("name") for e in root.findall("link")]
    now = (last.find("parent").get("link"), last.find("child").get("link"))
    last.find("parent").set("link", next(n for n in links if n not in now))


def known_bound(name: str, factor: float):
    """Return a change of the first real bound; a bound of 1e5 or more is the writer's value for "unknown"."""

    def change(root):
        known = next((e for e in root.findall("joint/limit") if float(e.get(name)) < 1e5), None)
        if known is None:
            return False
        known.set(name, f"{float(known.get(name)) * factor:g}")
        return True

    return change


def urdf_kind(new: str):
    def change(root):
        found = [j for j in root.findall("joint") if j.get("type") in {"revolute", "prismatic", "continuous"} - {new}]
        found[0].set("type", new)

    return change


def inertial_removed(root):
    link = (
        root.findall("link")[-1]
        if root.findall("link")[-1].find("visual") is not None
        else next(e for e in reversed(root.findall("link")) if e.find("visual") is not None)
    )
    link.remove(link.find("inertial"))


def weighed(tag: str, name: str, new):
    """Return a change of an attribute in the <inertial> of the last link with a shape."""

    def change(root):
        link = next(e for e in reversed(root.findall("link")) if e.find("visual") is not None)
        element = link.find(f"inertial/{tag}")
        element.set(name, new(element.get(name)))

    return change


for kind, change, says in (
    ("mass x 1000", weighed("mass", "value", by(1e3)), "mass|density"),
    ("all masses x 1000", every("link/inertial/mass", "value", by(1e3)), "mass|density"),
    ("mass zero", weighed("mass", "value", by(0)), "mass"),
    ("mass negative", weighed("mass", "value", by(-1)), "mass"),
    ("inertia negative", weighed("inertia", "ixx", by(-1)), "inertia|moment"),
    ("inertia x 10", weighed("inertia", "iyy", by(10)), "inertia|moment"),
    ("inertia in g mm2", every("link/inertial/inertia", "izz", by(1e9)), "inertia|moment"),
    ("mass centre", weighed("origin", "xyz", plus(0.1, 0, 0)), "centre"),
    ("inertia turned", weighed("origin", "rpy", lambda t: "0.5 0.4 0.3"), "inertia"),
    ("no inertial", inertial_removed, "mass"),
    ("speed x 1000", known_bound("velocity", 1e3), "speed"),
    ("effort x 10", known_bound("effort", 10), "effort"),
    ("lower limit", attribute("joint/limit", "lower", lambda t: f"{float(t) - 0.5}"), "limit"),
    ("upper limit", attribute("joint/limit", "upper", lambda t: f"{float(t) + 0.3}"), "limit"),
    ("axis turned round", attribute("joint/axis", "xyz", by(-1)), "axis|link"),
    ("axis tilted", attribute("joint/axis", "xyz", plus(0.02, 0.01, 0)), "axis|link"),
    ("made fixed", urdf_kind("fixed"), "kind|link"),
    ("made a slide", urdf_kind("prismatic"), "kind|link"),
    ("link renamed", renamed_everywhere("link"), "link"),
    ("millimetres", every("joint/origin", "xyz", by(1e3)), "link"),
    ("origin moved", attribute("joint/origin", "xyz", plus(0.002, 0, 0)), "link|line"),
    ("origin turned", attribute("joint/origin", "rpy", plus(0.02, 0, 0)), "link|axis"),
    ("on another link", urdf_parent, "link|joint|unreadable"),
    ("joint renamed", attribute("joint", "name", lambda t: f"{t}_renamed"), "joint|name"),
    ("colour", attribute("material/color", "rgba", lambda t: "0.9 0.1 0.6 1"), "colour"),
    ("mesh scale", attribute("link/visual/geometry/mesh", "scale", by(1.02)), "mesh"),
):
    xml_seed(f"URDF: {kind}", ".urdf", change, says)


# ----------------------------------------------------------------------------------------------------- tracks


def track(change):
    """Return an edit that applies `change` to every track, and to the same entries in the header of its CSV file."""

    def edit(folder):
        done = False
        for file in sorted((folder / "tracks").glob("*.json")):
            if file.name.endswith(".schema.json"):
                continue
            data = json.loads(file.read_text("utf-8"))
            before = json.loads(json.dumps(data))
            if change(data) is False or data == before:
                continue
            done = True
            file.unlink()
            file.write_text(json.dumps(data), "utf-8")
            table = file.with_suffix(".csv")
            head, rows = [], []
            for line in table.read_text("utf-8").splitlines():
                key = line[2:].partition(":")[0] if line.startswith("# ") else ""
                if key and data.get(key) != before.get(key):
                    new = data[key]
                    line = f"# {key}: {new if isinstance(new, str) else json.dumps(new)}"
                (head if line.startswith("#") else rows).append(line)
            table.unlink()
            table.write_text("\n".join([*head, *rows]) + "\n", "utf-8")
        return done

    return edit


def track_seed(kind: str, change, says: str) -> None:
    SEEDS.append(Seed(f"tracks: {kind}", track(change), "tracks/", says))


def at(key: str, i: int, new):
    def change(data):
        if not data[key]:
            return False
        data[key][i] = new(data[key][i])
        return True

    return change


def named_frame(which: str, axis: int, by: float):
    def change(data):
        i = next(k for k, n in enumerate(data["frame_names"]) if which in n)
        data["frames_local"][7 * i + axis] += by

    return change


def rcm_said_to_be_kept(data):
    i = next((i for i, has in enumerate(data["phase_has_rcm"]) if has and not data["phase_rcm_enforced"][i]), None)
    if i is None:
        return False
    data["phase_rcm_enforced"][i] = 1
    return True


def shifted_rcm(axis: int, every_rcm: bool = True):
    def change(data):
        for i, has in enumerate(data["phase_has_rcm"]):
            if has:
                data["phase_rcm"][3 * i + axis] += 0.01
                if not every_rcm:
                    break
        if every_rcm and data["rcm"]:
            data["rcm"][axis] += 0.01
        return any(data["phase_has_rcm"])

    return change


def times_key(key: str, factor: float):
    def change(data):
        data[key] *= factor

    return change


def one_pose(data):
    links = len(data["links"])
    data["poses"][(data["frames"] // 2 * links + links - 1) * 7] += 1e-3


def cut_assumed(data):
    data["assumed"] = data["assumed"][1:]


def of_poses(new):
    """Return a change of the poses (frames, links, 7) of a track; `new` edits them in place or returns new ones."""

    def change(data):
        rows = np.reshape(data["poses"], (data["frames"], -1, 7)).astype(float)
        out = new(rows)
        data["poses"] = (rows if out is None else out).ravel().tolist()

    return change


def flipped(rows):
    rows[len(rows) // 2, -1, 3:] *= -1


def links_swapped(rows):
    rows[:, [-1, -2]] = rows[:, [-2, -1]]


def mirrored(rows):
    rows[..., 1] *= -1
    rows[..., [3, 5]] *= -1


def z_down(rows):
    rows[..., :3] = rows[..., [0, 2, 1]]


def key_dropped(data):
    k, n = data["frames"] // 2, data["frames"]
    for key in ("times", "poses", "positions"):
        values = np.reshape(data[key], (n, -1))
        data[key] = np.delete(values, k, axis=0).ravel().tolist()
    data["frames"] = n - 1


def twice_as_long(data):
    for key in ("times", "phase_start", "phase_end"):
        data[key] = [2 * t for t in data[key]]
    data["rate"] /= 2


for kind, change, says in (
    ("sign flip", of_poses(flipped), "sign"),
    ("w first", of_poses(lambda rows: rows[..., [0, 1, 2, 6, 3, 4, 5]]), "link"),
    ("millimetres", of_poses(lambda rows: rows * [1e3, 1e3, 1e3, 1, 1, 1, 1]), "link|size|millimetre"),
    ("links swapped", of_poses(links_swapped), "link"),
    ("mirrored", of_poses(mirrored), "link|mirror"),
    ("y and z exchanged", of_poses(z_down), "link"),
    ("one key dropped", key_dropped, "key|time|columns|rows"),
    ("twice as long", twice_as_long, "time|lasts"),
    ("link renamed", lambda d: d["links"].__setitem__(-1, d["links"][-1] + "_renamed"), "link"),
    ("driven joint passive", at("joint_active", 0, lambda v: 0), "passive"),
    ("upper limit", at("joint_upper", 0, lambda v: v * 1.2), "limit"),
    ("lower limit", at("joint_lower", 0, lambda v: v - 0.1), "limit"),
    ("joint type", at("joint_types", 0, lambda v: "prismatic" if v == "revolute" else "revolute"), "kind|column"),
    ("tool frame", at("tool_frame", 0, lambda v: v + 0.05), "tool frame"),
    ("tool frame turned", lambda d: d["tool_frame"].__setitem__(slice(3, 7), [0.6, 0, 0, 0.8]), "tool frame"),
    ("endoscope longer", named_frame("tip", 2, 0.1), "frame|RCM|shaft"),
    ("frame aside", named_frame("tip", 0, 0.01), "frame|RCM|shaft"),
    ("frame on another link", at("frame_links", -1, lambda v: "x"), "frame"),
    ("RCM aside", shifted_rcm(0), "rcm"),
    ("RCM deeper", shifted_rcm(2), "rcm"),
    ("RCM of one phase", shifted_rcm(1, every_rcm=False), "rcm"),
    ("watched RCM said to be kept", rcm_said_to_be_kept, "rcm"),
    ("assumed emptied", lambda d: d.__setitem__("assumed", []), "assum"),
    ("one assumption gone", cut_assumed, "assum"),
    ("between_position claimed 1 um", lambda d: d.__setitem__("between_position", 1e-6), "between|error between"),
    ("between_rotation claimed small", times_key("between_rotation", 0.01), "between"),
    ("joint_gap claimed small", times_key("joint_gap", 0.01), "joint_gap|opening"),
    ("between_position x 100", times_key("between_position", 100.0), "between"),
    ("one key of one link", one_pose, "link"),
    ("rate", times_key("rate", 2.0), "rate"),
    ("title", lambda d: d.__setitem__("title", "Another title"), "title of clip"),
    ("model hash", lambda d: d.__setitem__("model_hash", "sha256:0123"), "model"),
    ("moved frame unknown", lambda d: d.__setitem__("moved_frame", "nowhere"), "moved_frame"),
    ("shaft axis not a unit vector", lambda d: d.__setitem__("shaft_axis", [1, 1, 0]), "shaft_axis"),
    ("length unit", lambda d: d.__setitem__("length_unit", "mm"), "length_unit"),
    ("quaternion order", lambda d: d.__setitem__("quaternion_order", "wxyz"), "quaternion_order"),
    ("link without a name", lambda d: d["links"].__setitem__(-1, ""), "name"),
    ("link with a line break", lambda d: d["links"].__setitem__(-1, "a\nb"), "name"),
    ("phase beyond the end", at("phase_end", -1, lambda v: v + 5), "phase"),
    ("degrees", lambda d: d.__setitem__("positions", np.degrees(d["positions"]).tolist()), "joint"),
):
    track_seed(kind, change, says)


def table(change):
    def edit(folder):
        file = next(iter(sorted((folder / "tracks").glob("*.csv"))))
        lines = file.read_text("utf-8").splitlines()
        change(lines)
        file.unlink()
        file.write_text("\n".join(lines) + "\n", "utf-8")

    return edit


def _head(key: str, new: str):
    def change(lines):
        i = next(i for i, line in enumerate(lines) if line.startswith(f"# {key}:"))
        lines[i] = f"# {key}: {new}"

    return change


def _cell(lines):
    cells = lines[-3].split(",")
    cells[-5] = f"{float(cells[-5]) + 1e-3}"
    lines[-3] = ",".join(cells)


for kind, change, says in (
    ("assumed emptied", _head("assumed", "[]"), "assum"),
    ("between_position", _head("between_position", "1e-06"), "between"),
    ("tool frame", _head("tool_frame", "[0.05,0,0,0,0,0,1]"), "tool"),
    ("phase RCM", _head("phase_has_rcm", "[0]"), "RCM|phase"),
    ("one number", _cell, "link"),
    ("row cut off", lambda lines: lines.__setitem__(-1, lines[-1][: len(lines[-1]) // 2]), "row|column|read|number"),
    ("row lost", lambda lines: lines.pop(len(lines) - 5), "key|time|frames"),
):
    SEEDS.append(Seed(f"CSV: {kind}", table(change), r"\.csv", says))


# ------------------------------------------------------------------------------------------------------- GLB


def glb_step(glb):
    for animation in glb.document["animations"]:
        for sampler in animation["samplers"]:
            sampler["interpolation"] = "STEP"


def glb_colour(glb):
    glb.document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.9, 0.05, 0.5, 1]


def glb_mass(glb):
    node = [n for n in glb.links() if "mass" in n["extras"]][-1]
    node["extras"]["mass"] *= 1000


def glb_joint(glb):
    node = [n for n in glb.links() if n["extras"].get("joints")][-1]
    node["extras"]["joints"] = node["extras"]["joints"][1:]


def glb_joint_name(glb):
    node = [n for n in glb.links() if n["extras"].get("joints")][-1]
    node["extras"]["joints"][0] += "_renamed"


def glb_frame(glb):
    node = [n for n in glb.document["nodes"] if n.get("extras", {}).get("frame")][-1]
    t = node.get("translation", [0, 0, 0])
    node["translation"] = [t[0] + 0.05, *t[1:]]


def glb_key(glb):
    _, sampler = list(glb.channels("translation"))[-1]
    values = glb.numbers(sampler["output"])
    values[len(values) // 2] += 1e-3


def glb_vertex(glb):
    primitive = glb.document["meshes"][0]["primitives"][0]
    points = glb.numbers(primitive["attributes"]["POSITION"])
    middle = points.mean(axis=0)
    same = np.all(points == points[0], axis=1)
    points[same] += (middle - points[0]) / np.linalg.norm(middle - points[0]) * 3e-3
    accessor = glb.document["accessors"][primitive["attributes"]["POSITION"]]
    accessor["min"], accessor["max"] = points.min(axis=0).tolist(), points.max(axis=0).tolist()


def glb_names(glb):
    a, b = glb.links()[:2]
    a["name"], b["name"] = b["name"], a["name"]


def glb_slow(glb):
    done = set()
    for path in ("translation", "rotation"):
        for _, sampler in glb.channels(path):
            if sampler["input"] not in done:
                done.add(sampler["input"])
                glb.numbers(sampler["input"])[:] *= 2
                accessor = glb.document["accessors"][sampler["input"]]
                accessor["max"] = [2 * v for v in accessor["max"]]


def glb_meshes(glb):
    a, b = [n for n in glb.links() if "mesh" in n][:2]
    a["mesh"], b["mesh"] = b["mesh"], a["mesh"]


def glb_root(glb):
    del glb.document["nodes"][0]["rotation"]


def glb_no_link(glb):
    node = glb.links()[-1]
    del node["extras"]["link"]
    node["name"] += "_gone"


def glb_scale(glb):
    glb.document["nodes"][0]["scale"] = [1.001] * 3


def glb_w_first(glb):
    _, sampler = list(glb.channels("rotation"))[-1]
    values = glb.numbers(sampler["output"])
    values[:] = values[:, [3, 0, 1, 2]]


def glb_targets(glb):
    a, b = [c for c, _ in glb.channels("rotation")][-2:]
    a["target"]["node"], b["target"]["node"] = b["target"]["node"], a["target"]["node"]


def glb_millimetres(glb):
    for _, sampler in glb.channels("translation"):
        glb.numbers(sampler["output"])[:] *= 1000


def glb_winding(glb):
    primitive = glb.document["meshes"][0]["primitives"][0]
    accessor = glb.document["accessors"][primitive["indices"]]
    view = glb.document["bufferViews"][accessor["bufferView"]]
    kind = {5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    indices = np.frombuffer(glb.binary, kind, accessor["count"], start)
    indices[:] = indices[::-1].copy()


def glb_same_name(glb):
    a, b = glb.links()[-2:]
    a["name"] = b["name"]


def glb_clip(glb):
    glb.document["animations"][0]["name"] = "another"


for kind, change, says in (
    ("STEP", glb_step, "between|jumps"),
    ("colour", glb_colour, "colour"),
    ("mass x 1000", glb_mass, "mass"),
    ("joint left out", glb_joint, "joint"),
    ("joint renamed", glb_joint_name, "joint"),
    ("tool frame", glb_frame, "frame"),
    ("one key", glb_key, "link"),
    ("vertex 3 mm", glb_vertex, "mesh"),
    ("names swapped", glb_names, "link"),
    ("half as fast", glb_slow, "time|key"),
    ("meshes swapped", glb_meshes, "mesh"),
    ("root not turned", glb_root, "up axis|link"),
    ("link lost", glb_no_link, "missing|link"),
    ("scaled", glb_scale, "scale|link"),
    ("clip renamed", glb_clip, "clip"),
    ("quaternions w first", glb_w_first, "link"),
    ("targets swapped", glb_targets, "link"),
    ("millimetres", glb_millimetres, "link"),
    ("inside out", glb_winding, "mesh|winding|inside|normal"),
    ("two links of one name", glb_same_name, "name"),
):

    def _edit(folder, change=change):
        file = next(folder.glob("*.glb"))
        glb = Glb(file.read_bytes())
        change(glb)
        file.unlink()  # the copy may be a hard link to the correct file
        file.write_bytes(glb.bytes())

    SEEDS.append(Seed(f"GLB: {kind}", _edit, r"\.glb", says))


SEEDS.append(Seed("GLB: cut off", lambda folder: cut(next(folder.glob("*.glb"))), r"\.glb", "read|bytes|long|JSON"))

# ------------------------------------------------------------------------------------------------------- OBJ


def obj(change):
    def edit(folder):
        file = max((folder / "meshes").glob("*.obj"), key=lambda p: p.stat().st_size)
        lines = file.read_text().splitlines()
        change(lines)
        file.unlink()
        file.write_text("\n".join(lines) + "\n")

    return edit


def _obj_vertex(lines):
    rows = [i for i, line in enumerate(lines) if line.startswith("v ")]
    points = np.array([lines[i].split()[1:] for i in rows], float)
    k = 0
    new = points[k] + (points.mean(axis=0) - points[k]) / np.linalg.norm(points.mean(axis=0) - points[k]) * 3.0
    lines[rows[k]] = "v " + " ".join(f"{v:.3f}" for v in new)


def _obj_hole(lines):
    lines.pop(next(i for i, line in enumerate(lines) if line.startswith("f ")))


def _obj_turned(lines):
    for i, line in enumerate(lines):
        if line.startswith("f "):
            lines[i] = " ".join(["f", *reversed(line.split()[1:])])


def _obj_metres(lines):
    for i, line in enumerate(lines):
        if line.startswith("v "):
            lines[i] = "v " + " ".join(f"{float(v) / 1000:.6f}" for v in line.split()[1:])


for kind, change, says in (
    ("vertex 3 mm", _obj_vertex, "mesh"),
    ("triangle missing", _obj_hole, "mesh|closed"),
    ("inside out", _obj_turned, "mesh"),
    ("metres", _obj_metres, "mesh"),
):
    SEEDS.append(Seed(f"OBJ: {kind}", obj(change), r"\.urdf|\.xml", says))


# ------------------------------------------------------------------------------------------------------- Unity


def text(file: str, pattern: str, new: str, count: int = 1, flags: re.RegexFlag = re.NOFLAG):
    """Return an edit that replaces `count` matches (0: all) in the first file whose path matches the glob `file`."""

    def edit(folder):
        path = next(folder.glob(file), None)
        if path is None:
            return False
        old = path.read_text("utf-8")
        spoilt, done = re.subn(pattern, new, old, count=count, flags=flags)
        if not done or spoilt == old:
            return False
        path.unlink()
        path.write_text(spoilt, "utf-8")
        return True

    return edit


FRAMES = "unity/Runtime/Frames.cs"
for kind, pattern, new in (
    ("ToUnity of a point", r"new Vector3\(-p\.x, p\.y, p\.z\)", "new Vector3(p.x, p.y, p.z)"),
    ("ToUnity of a URDF's point", r"new Vector3\(-p\.y, p\.z, p\.x\)", "new Vector3(p.y, p.z, p.x)"),
    ("ToUnity of a rotation", r"new Quaternion\(q\.x, -q\.y, -q\.z, q\.w\)", "new Quaternion(q.x, -q.y, q.z, q.w)"),
    (
        "ToUnity of a URDF's rotation",
        r"new Quaternion\(-q\.y, q\.z, q\.x, -q\.w\)",
        "new Quaternion(-q.y, q.z, q.x, q.w)",
    ),
    ("FromUnity of a URDF's point", r"new Vector3\(p\.z, -p\.x, p\.y\)", "new Vector3(p.z, p.x, p.y)"),
    (
        "FromUnity of a URDF's rotation",
        r"new Quaternion\(q\.z, -q\.x, q\.y, -q\.w\)",
        "new Quaternion(q.z, q.x, q.y, -q.w)",
    ),
    ("RootRotation", r"new Quaternion\(-HalfRoot", "new Quaternion(HalfRoot"),
    ("Slerp the long way", r"dot < 0\.0 \? -1\.0", "dot > 0.0 ? -1.0"),
    ("Slerp reversed", r"first = Math\.Sin\(\(1\.0 - share\) \* angle\)", "first = Math.Sin(share * angle)"),
    ("chord", r"0\.5 \* chord", "0.25 * chord"),
):
    SEEDS.append(Seed(f"Frames.cs: {kind}", text(FRAMES, pattern, new), "Frames.cs|unity", "Frames"))

GOLDEN = "unity/Runtime/Resources/twin-golden.json"


def golden(key: str, change):
    def edit(folder):
        path = folder / GOLDEN
        if not path.is_file():
            return False
        data = json.loads(path.read_text("utf-8"))
        data[key] = change(data[key])
        path.unlink()
        path.write_text(json.dumps(data), "utf-8")

    return edit


def _bump(values):
    values = list(values)
    values[len(values) // 2] += 0.01
    return values


def _flip(values):
    values = list(values)
    k = int(np.argmax(np.abs(values)))
    values[k] = -values[k]
    return values


def _stream(value):
    data = bytearray(base64.b64decode(value))
    data[-37] ^= 0x10
    return base64.b64encode(bytes(data)).decode()


for key, change in (
    ("point_robot", _bump),
    ("point_gltfast", _flip),
    ("point_urdf", _bump),
    ("world_gltfast", _bump),
    ("world_urdf", _flip),
    ("between_pose", _bump),
    ("turn_want", _flip),
    ("joint_want", _bump),
    ("drive_target", _bump),
    ("grab_want_gltfast", _bump),
    ("grab_want_urdf", _bump),
    ("stream_joints", _bump),
    ("stream", _stream),
    ("place", _flip),
):
    SEEDS.append(Seed(f"golden vectors: {key}", golden(key, change), "golden|unity", "golden"))


def slim(folder: Path, name: str) -> None:
    """Delete the files that are not needed to find the seed with this name, to save time.

    proof.json is always deleted, because its hashes reveal every change, without the cause.
    """
    (folder / "proof.json").unlink(missing_ok=True)
    if name.startswith(("Frames", "golden")):
        for path in folder.iterdir():
            if path.name != "unity":
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        return
    shutil.rmtree(folder / "unity", ignore_errors=True)
    (folder / "README.txt").unlink(missing_ok=True)
    if not name.startswith("usdz"):
        for file in folder.glob("*.usdz"):
            file.unlink()
    if name.startswith("USD motion"):
        return
    stage = f"{robot(folder)}.usda"
    kept = {stage, "physics.usda", "geometry.usdc"}
    if name.lower().startswith("usd") or "gravity" in name:
        kept.add(f"{robot(folder)}_sim.usda")
    for file in (folder / "usd").rglob("*"):
        if file.is_file() and file.name not in kept:
            file.unlink()


def found(report, one: Seed, *, warned: bool = False) -> bool:
    """Return whether a report names the correct cause; if two files contradict each other, it may name both.

    With `warned`, a warning is enough.
    """
    severities = ("disagreement", "error", *["warning"] * warned)
    for f in report.findings:
        place = f.where + (f.message if "One of the two" in f.message else "")
        told = f"{f.code} {f.message} {f.where}"
        if f.severity in severities and re.search(one.blamed, place) and re.search(one.says, told, re.I):
            return True
    return False


def exported(robots: Iterable[str], folder: Path) -> dict[str, Path]:
    """Return exports of real robots in a folder, by name, with one protocol and few keys."""
    out = {}
    for name in robots:
        robot = twin.load(name)
        assert robot.files
        first = next(iter(robot.files.protocols()))
        out[name] = folder / name
        twin.api.export(robot, out=out[name], protocols=[first], budget=ClipAccuracy(2e-3, 0.02, 2e-3))
    return out


def copied(bundle: Path, target: Path, one: Seed) -> bool:
    """Copy a bundle and apply a seed to the copy; return whether the bundle has the edited data."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(bundle, target, copy_function=os.link)
    slim(target, one.name)
    return one.edit(target) is not False
