"""More kinds of seeded defects, none of which is in `audit_seeds`: what formats declare beside poses and masses.

Each kind is seeded without proof.json and README.txt; it is found by its cause, with and without `--robot`.
"""

from __future__ import annotations

import itertools
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from pxr import Gf, Sdf

from made import audit_seeds as base
from made.audit_seeds import (
    Seed,
    attribute,
    baked,
    by,
    drive_attribute,
    every,
    geometry,
    has_drive,
    joints,
    layers,
    loop,
    of_poses,
    plus,
    prims_of,
    robot,
    stored,
    table,
    text,
    track,
    turning,
    usd_joints,
    usdz,
    value,
    xml,
)
from made.glb_apart import Glb

MORE: list[Seed] = []
WARNED = ("USD: stray shape", "USD: binding lost", "MJCF: soft limit")
"""Kinds that are warnings: the motion is right."""


def more(kind: str, edit, says: str, blamed: str) -> None:
    MORE.append(Seed(kind, edit, blamed, says))


# -------------------------------------------------------------------------------------------------------- USD


def in_geometry(wanted, change):
    def edit(folder):
        layer, found = geometry(folder, wanted)
        if not found:
            return False
        change(found[0], layer)
        stored(layer, folder, "geometry.usdc")
        return True

    return edit


def is_mark(kind: str, part: str = ""):
    return lambda p: value(p, "twin:kind") == kind and part in p.name


def is_mesh(p) -> bool:
    return p.typeName == "Mesh"


def inactive(p, layer) -> None:
    p.SetInfo("active", False)


def moved(x: float, y: float, z: float):
    def change(p, layer):
        a = p.attributes["xformOp:translate"]
        a.default = a.default + type(a.default)(x, y, z)

    return change


def to_frame(p, layer) -> None:
    p.attributes["twin:kind"].default = "frame"


def renamed_mark(p, layer) -> None:
    p.name = f"{p.name}_other"
    if "twin:name" in p.attributes:
        p.attributes["twin:name"].default = f"{p.attributes['twin:name'].default}_other"


def set_or_add(name: str, kind, new):
    def change(p, layer):
        a = p.attributes[name] if name in p.attributes else Sdf.AttributeSpec(p, name, kind)
        a.default = new

    return change


def target_aside(j, layer) -> None:
    """Put the target of a drive 0.2 degrees, or 0.2 units of the stage, further."""
    a = drive_attribute(j, "targetPosition")
    a.default = a.default + 0.2


def target_velocity(j, layer) -> None:
    token = drive_attribute(j, "stiffness").name.split(":")[1]
    set_or_add(f"drive:{token}:physics:targetVelocity", Sdf.ValueTypeNames.Float, 3.0)(j, layer)


def stray(folder):
    layer, name = layers(folder, "geometry.usdc")
    prim = Sdf.CreatePrimInLayer(layer, f"/{name}/stray")
    prim.specifier, prim.typeName = Sdf.SpecifierDef, "Cube"
    stored(layer, folder, "geometry.usdc")


def unbound(p, layer) -> None:
    del p.properties["material:binding"]


def half_triangles(p, layer) -> None:
    for name, width in (("faceVertexCounts", 1), ("faceVertexIndices", 3)):
        a = p.attributes[name]
        a.default = type(a.default).FromNumpy(np.array(a.default)[: -20 * width])


def scaled_points(p, layer) -> None:
    a = p.attributes["points"]
    a.default = type(a.default).FromNumpy(1.01 * np.array(a.default))


def turned_frame(name: str):
    def change(j, layer):
        a = j.attributes[name]
        a.default = Gf.Quatf(Gf.Quatd(a.default) * Gf.Quatd(0.9990482, 0.0436194, 0, 0))

    return change


def limit_shift(j, layer) -> None:
    for name in ("physics:lowerLimit", "physics:upperLimit"):
        j.attributes[name].default += 0.02


def limited(j) -> bool:
    return "physics:upperLimit" in j.attributes


def acceleration_drive(j, layer) -> None:
    base.drive_attribute(j, "physics:type").default = "acceleration"


def body_prim(folder, change):
    layer, name = layers(folder)
    bodies = [b for b in layer.GetPrimAtPath(f"/{name}").nameChildren if value(b, "physics:mass")]
    change(bodies[-1], layer)
    stored(layer, folder)


def every_joint_inactive(folder):
    layer, name = layers(folder)
    for j in joints(layer, name):
        if loop(j):
            j.SetInfo("active", False)
            stored(layer, folder)
            return True
    return False


def no_layer(folder):
    (folder / "usd/physics.usda").unlink()


def attribute_of_body(name: str, new: bool):
    return lambda folder: body_prim(folder, set_or_add(name, Sdf.ValueTypeNames.Bool, new))


def invisible(p, layer) -> None:
    set_or_add("visibility", Sdf.ValueTypeNames.Token, "invisible")(p, layer)


def guide(p, layer) -> None:
    set_or_add("purpose", Sdf.ValueTypeNames.Token, "guide")(p, layer)


def grams(folder):
    file = f"{robot(folder)}.usda"
    layer, _ = layers(folder, file)
    layer.pseudoRoot.SetInfo("kilogramsPerUnit", 0.001)
    stored(layer, folder, file)


def with_mesh_op(p, layer) -> None:
    a = Sdf.AttributeSpec(p, "xformOp:translate", Sdf.ValueTypeNames.Double3)
    a.default = Gf.Vec3d(0.005, 0, 0)
    order = Sdf.AttributeSpec(p, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
    order.default = ["xformOp:translate"]


def plain_mesh(p) -> bool:
    return is_mesh(p) and "xformOpOrder" not in p.attributes


USD = r"\.usd|\.xml"
for kind, edit, says in (
    ("frame inactive", in_geometry(is_mark("frame", "tool"), inactive), "frame"),
    ("point inactive", in_geometry(is_mark("point"), inactive), "point"),
    ("point moved", in_geometry(is_mark("point"), moved(0, 0.02, 0)), "point"),
    ("point 5 um off", in_geometry(is_mark("point"), moved(5e-6, 0, 0)), "point"),
    ("point called a frame", in_geometry(is_mark("point"), to_frame), "point|frame"),
    ("frame renamed", in_geometry(is_mark("frame", "tip"), renamed_mark), "frame"),
    ("stray shape", stray, "stray"),
    ("binding lost", in_geometry(lambda p: "material:binding" in p.relationships, unbound), "material"),
    ("mesh invisible", in_geometry(base.a_mesh, invisible), "mesh|link"),
    ("mesh said to be a guide", in_geometry(base.a_mesh, guide), "mesh|link"),
    ("20 triangles missing", in_geometry(base.a_mesh, half_triangles), "mesh|closed|face|triangle"),
    ("mesh 1 % larger", in_geometry(base.a_mesh, scaled_points), "mesh"),
    ("mesh 5 mm aside", in_geometry(plain_mesh, with_mesh_op), "mesh"),
    ("joint frame turned", usd_joints(turning, turned_frame("physics:localRot0")), "axis|joint"),
    ("child's joint frame turned", usd_joints(turning, turned_frame("physics:localRot1")), "axis|joint"),
    ("limits shifted", usd_joints(limited, limit_shift), "limit"),
    ("drive of acceleration", usd_joints(has_drive, acceleration_drive), "drive"),
    ("drive target aside", usd_joints(has_drive, target_aside), "target"),
    ("drive target velocity", usd_joints(has_drive, target_velocity), "target velocity"),
    (
        "joint breaks",
        usd_joints(turning, set_or_add("physics:breakForce", Sdf.ValueTypeNames.Float, 5.0)),
        "breaks",
    ),
    ("loop joint inactive", every_joint_inactive, "joint"),
    (
        "loop joint in the articulation",
        usd_joints(loop, set_or_add("physics:excludeFromArticulation", Sdf.ValueTypeNames.Bool, False)),
        "loop|articulation",
    ),
    ("body kinematic", attribute_of_body("physics:kinematicEnabled", True), "fixed|kinematic"),
    ("body without gravity", attribute_of_body("physxRigidBody:disableGravity", True), "weight"),
    ("body not rigid", attribute_of_body("physics:rigidBodyEnabled", False), "link|joint|body"),
    ("grams", grams, "mass|kilogram"),
    ("layer lost", no_layer, "layer|composed"),
):
    more(f"USD: {kind}", edit, says, USD)


def first_code(layer, moving, codes) -> None:
    layer.startTimeCode = 5.0


def value_key(layer, moving, codes) -> None:
    paths = [f"{p.path}.{a.name}" for p in prims_of(layer, lambda p: True) for a in p.attributes]
    path = next(p for p in paths if p.endswith("physics:position") and layer.ListTimeSamplesForPath(p))
    code = codes[len(codes) // 2]
    layer.SetTimeSample(path, code, layer.QueryTimeSample(path, code) + 5.0)


def shifts(layer, path: str) -> tuple[float, float] | None:
    """Return two time codes at which a translation differs by more than 1 mm; None if there are none."""
    codes = layer.ListTimeSamplesForPath(path)
    for a in codes[2:]:
        for b in (codes[-1], codes[len(codes) // 2]):
            one, two = layer.QueryTimeSample(path, a), layer.QueryTimeSample(path, b)
            if (Gf.Vec3d(one) - Gf.Vec3d(two)).GetLength() > 1e-3:
                return a, b
    return None


def exchange(layer, links) -> bool:
    """Exchange two keys of the last link that moves by more than 1 mm; return whether there is one."""
    for link in reversed(links):
        path = f"{link}.xformOp:translate"
        pair = shifts(layer, path)
        if pair is not None:
            one, two = (layer.QueryTimeSample(path, code) for code in pair)
            layer.SetTimeSample(path, pair[0], two)
            layer.SetTimeSample(path, pair[1], one)
            return True
    return False


def keys_exchanged(layer, moving, codes) -> bool:
    return exchange(layer, moving)


def link_still(layer, moving, codes) -> bool:
    """Delete the keys of the last link that moves by more than 1 mm."""
    for link in reversed(moving):
        if shifts(layer, f"{link}.xformOp:translate") is not None:
            prim = layer.GetPrimAtPath(link)
            for op in ("translate", "orient"):
                del prim.properties[f"xformOp:{op}"]
            return True
    return False


for kind, change, says in (
    ("joint value", value_key, "joint"),
    ("keys exchanged", keys_exchanged, "link"),
    ("link stands still", link_still, "link"),
):
    more(f"USD motion: {kind}", baked(change), says, r"\.usd")


def usdz_smaller(folder):
    def change(layer):
        mesh = prims_of(layer, base.a_mesh)[0]
        points = mesh.attributes["points"]
        points.default = type(points.default).FromNumpy(0.98 * np.array(points.default))

    usdz(folder, change)


def usdz_two_keys(folder):
    def change(layer):
        links = [str(p.path) for p in prims_of(layer, lambda p: "xformOp:translate" in p.attributes)]
        return exchange(layer, links)

    return usdz(folder, change)


more("usdz: mesh 2 % smaller", usdz_smaller, "mesh", r"\.usdz")
more("usdz: keys exchanged", usdz_two_keys, "link", r"\.usdz")

# ------------------------------------------------------------------------------------------------------- URDF


def transmissions_exchange(part: str):
    def change(root):
        found = [t for t in root.findall("transmission") if t.find(part) is not None]
        if len(found) < 2:
            return False
        one, two = found[0].find(part), found[1].find(part)
        a, b = one.get("name"), two.get("name")
        one.set("name", b)
        two.set("name", a)
        return True

    return change


def dynamics(root):
    joint = next(j for j in root.findall("joint") if j.get("type") in ("revolute", "prismatic", "continuous"))
    ET.SubElement(joint, "dynamics", damping="5", friction="2")


def bounds_mirrored(root):
    for limit in root.findall("joint/limit"):
        low, high = (float(limit.get(k, "0")) for k in ("lower", "upper"))
        if abs(low + high) > 1e-3 and limit.get("lower") is not None:
            limit.set("lower", f"{-high!r}")
            limit.set("upper", f"{-low!r}")
            return True
    return False


def limits_exchanged(root):
    found = [e for e in root.findall("joint/limit") if e.get("lower")]
    for other in found[1:]:
        one = found[0]
        if one.attrib != other.attrib:
            mine, its = dict(one.attrib), dict(other.attrib)
            one.attrib.update(its)
            other.attrib.update(mine)
            return True
    return False


def other_mesh(root):
    meshes = root.findall("link/visual/geometry/mesh")
    meshes[0].set("filename", meshes[-1].get("filename"))


def visual_moved(root):
    visual = root.find("link/visual")
    origin = visual.find("origin")
    origin = ET.SubElement(visual, "origin") if origin is None else origin
    origin.set("xyz", "0 0.003 0")


def collision_of(change):
    """Return an edit of the first collision shape with a mesh."""

    def edit(root):
        link = next(e for e in root.findall("link") if e.find("collision/geometry/mesh") is not None)
        change(link, link.find("collision"), root)

    return edit


def collision_deleted(link, collision, root) -> None:
    link.remove(collision)


def collision_of_other_mesh(link, collision, root) -> None:
    meshes = root.findall("link/visual/geometry/mesh")
    collision.find("geometry/mesh").set("filename", meshes[-1].get("filename"))


def collision_lost(link, collision, root) -> None:
    collision.find("geometry/mesh").set("filename", "meshes/no_such_mesh.obj")


def collision_scaled(link, collision, root) -> None:
    collision.find("geometry/mesh").set("scale", "0.00101 0.001 0.001")


def collision_moved(link, collision, root) -> None:
    ET.SubElement(collision, "origin", xyz="0 0.0005 0")


def collision_turned(link, collision, root) -> None:
    ET.SubElement(collision, "origin", rpy="0 0 1.5708")


def extra_link(root):
    link = ET.SubElement(root, "link", name="ballast")
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="1")
    ET.SubElement(inertial, "inertia", ixx="0.01", iyy="0.01", izz="0.01", ixy="0", ixz="0", iyz="0")
    parent = root.find("link").get("name")
    joint = ET.SubElement(root, "joint", name="ballast_joint", type="revolute")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link="ballast")
    ET.SubElement(joint, "axis", xyz="0 0 1")
    ET.SubElement(joint, "limit", lower="-1", upper="1", effort="1", velocity="1")


def product_negated(root):
    inertia = next(e for e in root.findall("link/inertial/inertia") if abs(float(e.get("ixz", "0"))) > 1e-5)
    inertia.set("ixz", str(-float(inertia.get("ixz"))))


def duplicate(part: str):
    def change(root):
        found = root.findall(part)
        if len(found) < 2:
            return False
        found[1].set("name", found[0].get("name"))
        return True

    return change


for kind, change, says in (
    ("transmission's joints exchanged", transmissions_exchange("joint"), "actuator|transmission|reduction"),
    ("transmission's actuators exchanged", transmissions_exchange("actuator"), "actuator|transmission"),
    ("dynamics", dynamics, "friction"),
    ("collision deleted", collision_of(collision_deleted), "collision"),
    ("collision of another mesh", collision_of(collision_of_other_mesh), "collision"),
    ("collision mesh does not exist", collision_of(collision_lost), "collision mesh|collision"),
    ("collision scaled", collision_of(collision_scaled), "collision"),
    ("collision 0.5 mm aside", collision_of(collision_moved), "collision"),
    ("collision turned", collision_of(collision_turned), "collision"),
    ("bounds mirrored", bounds_mirrored, "limit"),
    ("limits exchanged", limits_exchanged, "limit|effort|speed"),
    ("another link's mesh", other_mesh, "mesh"),
    ("visual moved", visual_moved, "mesh"),
    ("extra link", extra_link, "ballast"),
    ("product of inertia negated", product_negated, "inertia"),
    ("two links of one name", duplicate("link"), "named|name|exist|root"),
    ("axis longer", attribute("joint/axis", "xyz", by(2.0)), "axis"),
    ("alpha", attribute("material/color", "rgba", lambda t: " ".join([*t.split()[:3], "0.2"])), "colour"),
):
    more(f"URDF: {kind}", xml(".urdf", change), says, r"\.urdf")
FIRST_LOOP = r'closed_loop: \[\["[^\]]*"\], '
TRANSMISSION = r"<transmission .*?</transmission>"
for kind, edit, says in (
    ("reduction 50", text("*.urdf", r"<mechanicalReduction>[^<]*<", "<mechanicalReduction>50<"), "reduction"),
    ("reduction negative", text("*.urdf", r"<mechanicalReduction>1<", "<mechanicalReduction>-1<"), "reduction"),
    ("transmission deleted", text("*.urdf", TRANSMISSION, "", flags=re.DOTALL), "driven|passive|transmission"),
    ("transmissions deleted", text("*.urdf", TRANSMISSION, "", 0, re.DOTALL), "driven|transmission"),
    (
        "loop of the YAML deleted",
        text("*.yaml", r'closed_loop: \[\["[^\]]*"\], ', "closed_loop: ["),
        "loop|type|joint",
    ),
    ("loop type of the YAML", text("*.yaml", r'type: \["6d"', 'type: ["3d"'), "joint|kind|loop"),
    ("motor of the YAML deleted", text("*.yaml", r'name_mot: \["[^"]*", ', "name_mot: ["), "driven"),
    ("motors of the YAML exchanged", text("*.yaml", r'(name_mot: \[)("[^"]*"), ("[^"]*")', r"\1\3, \2"), "order"),
    ("home of the YAML", text("*.yaml", r"(home: \{[^}]*\": -?)0\.[1-9]", r"\g<1>0.0"), "home|loop"),
):
    more(f"URDF: {kind}", edit, says, r"\.urdf|\.yaml")

# ------------------------------------------------------------------------------------------------------- MJCF


def joint_number(name: str, new: str):
    def change(root):
        joint = next(j for j in root.iter("joint") if j.get("type") != "ball" and j.get("axis"))
        joint.set(name, new)

    return change


def flag(name: str):
    def change(root):
        if name == "equality" and not len(root.findall("equality/*")):
            return False
        ET.SubElement(root.find("option"), "flag", {name: "disable"})
        return True

    return change


def weightless(root):
    next(b for b in root.find("worldbody").iter("body") if b.find("inertial") is not None).set("gravcomp", "1")


def site_gone(prefix: str):
    def change(root):
        for body in root.iter("body"):
            for site in body.findall("site"):
                if site.get("name").startswith(prefix):
                    body.remove(site)
                    return True
        return False

    return change


def other_end(root):
    connect = root.find("equality/connect")
    if connect is None:
        return False
    names = [b.get("name") for b in root.iter("body")]
    connect.set("body2", next(n for n in names if n not in (connect.get("body1"), connect.get("body2"))))
    return True


def point_site_moved(root):
    site = next((s for s in root.iter("site") if s.get("name").startswith("point_")), None)
    if site is None:
        return False
    site.set("pos", plus(0.02, 0, 0)(site.get("pos")))
    return True


def geared(root):
    root.find("actuator")[0].set("gear", "2")


def pins_meet(root):
    ties = root.findall("equality/connect")
    for one, two in itertools.pairwise(ties):
        if one.get("body1") == two.get("body1") and one.get("body2") == two.get("body2"):
            two.set("anchor", one.get("anchor"))
            return True
    return False


for kind, change, says in (
    ("all loops soft", every("equality/*", "solref", lambda t: "0.02 1"), "loops|open"),
    ("impedance of all loops", every("equality/*", "solimp", lambda t: "0.9 0.95 0.001 0.5 2"), "loops|open"),
    ("points of a pin meet", pins_meet, "joint"),
    ("loop on another body", other_end, "joint|equality"),
    ("joint damped", joint_number("damping", "5"), "damping"),
    ("joint heavy", joint_number("armature", "1"), "inertia"),
    ("joint with friction", joint_number("frictionloss", "2"), "friction"),
    ("joint with a spring", joint_number("stiffness", "100"), "stiffness"),
    ("joint without limits", joint_number("limited", "false"), "limit|range"),
    ("zero of a joint", joint_number("ref", "0.1"), "zero|link|joint|equality|keyframe"),
    ("gravity disabled", flag("gravity"), "gravity"),
    ("loops disabled", flag("equality"), "joint"),
    ("limits disabled", flag("limit"), "limit"),
    ("actuators disabled", flag("actuation"), "driven|passive"),
    ("a link without weight", weightless, "weight"),
    ("point moved", point_site_moved, "point"),
    ("point deleted", site_gone("point_"), "point"),
    ("frame deleted", site_gone("frame_"), "frame"),
    ("gear", geared, "stiffness|effort|control"),
    ("mesh mirrored", attribute("asset/mesh", "scale", lambda t: "-" + t), "mirror|mesh"),
):
    more(f"MJCF: {kind}", xml(".xml", change), says, r"\.xml|\.usd")

# ------------------------------------------------------------------------------------------------ tracks, CSV


def swapped(key: str):
    def change(data):
        if len(data[key]) < 2 or data[key][0] == data[key][1]:
            return False
        data[key][0], data[key][1] = data[key][1], data[key][0]
        return True

    return change


def one_value(data):
    data["positions"][len(data["positions"]) // 2] += 0.05


def twice(data):
    data["times"][5] = data["times"][4]


def not_a_number(data):
    data["poses"][len(data["poses"]) // 2] = float("nan")


def unit_lost(rows):
    rows[len(rows) // 2, -1, 3:] *= 1.01


def jitter(data):
    data["times"][7] += 2e-3


def frame_turned(data):
    data["frames_local"][-4:] = [0.6, 0.0, 0.0, 0.8]


def frame_gone(data):
    for key, width in (("frame_names", 1), ("frame_links", 1), ("frames_local", 7)):
        data[key] = data[key][:-width]


def end_of_phase(data):
    data["phase_end"][0] = data["phase_start"][0] - 0.1


for kind, change, says in (
    ("joint names exchanged", swapped("joints"), "joint"),
    ("one joint value", one_value, "joint|link"),
    ("a time twice", twice, "time|key"),
    ("not a number", not_a_number, "finite|number|read"),
    ("quaternion of length 1.01", of_poses(unit_lost), "quaternion|length"),
    ("a key 2 ms late", jitter, "rate|time"),
    ("frame turned", frame_turned, "frame|RCM|shaft"),
    ("frame deleted", frame_gone, "frame"),
    ("phase ends before it starts", end_of_phase, "phase"),
    ("angle unit", lambda d: d.__setitem__("angle_unit", "deg"), "angle_unit"),
    ("count of keys", lambda d: d.__setitem__("frames", d["frames"] + 1), "frames|length|numbers|key"),
    ("tool link", lambda d: d.__setitem__("tool_link", d["links"][0]), "tool"),
):
    more(f"tracks: {kind}", track(change), says, r"tracks/")


def columns_exchanged(lines):
    i = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    cells = lines[i].split(",")
    cells[-1], cells[-8] = cells[-8], cells[-1]
    lines[i] = ",".join(cells)


more("CSV: columns exchanged", table(columns_exchanged), "column|head", r"\.csv")

# -------------------------------------------------------------------------------------------------------- GLB


def glb(change):
    def edit(folder):
        file = next(folder.glob("*.glb"))
        data = Glb(file.read_bytes())
        if change(data) is False:
            return False
        file.unlink()
        file.write_bytes(data.bytes())
        return True

    return edit


def channel_gone(path: str):
    def change(data):
        animation = data.document["animations"][0]
        gone = [c for c in animation["channels"] if c["target"]["path"] == path][-1]
        animation["channels"].remove(gone)

    return change


def later(data):
    done = set()
    for path in ("translation", "rotation"):
        for _, sampler in data.channels(path):
            if sampler["input"] not in done:
                done.add(sampler["input"])
                data.numbers(sampler["input"])[:] += 0.5
                accessor = data.document["accessors"][sampler["input"]]
                accessor["min"] = [v + 0.5 for v in accessor["min"]]
                accessor["max"] = [v + 0.5 for v in accessor["max"]]


def keys_of_a_link(data):
    _, sampler = list(data.channels("rotation"))[-1]
    values = data.numbers(sampler["output"])
    a, b = 2, len(values) // 2
    values[[a, b]] = values[[b, a]]


def long_quaternion(data):
    _, sampler = list(data.channels("rotation"))[-1]
    data.numbers(sampler["output"])[:] *= 1.05


def normals(data):
    primitive = data.document["meshes"][0]["primitives"][0]
    data.numbers(primitive["attributes"]["NORMAL"])[:] *= -1


def transparent(data):
    material = data.document["materials"][0]["pbrMetallicRoughness"]
    material["baseColorFactor"] = [*material.get("baseColorFactor", [1, 1, 1, 1])[:3], 0.3]


def no_mesh(data):
    next(n for n in data.links() if "mesh" in n).pop("mesh")


def link_scaled(data):
    data.links()[-1]["scale"] = [1.02, 1.02, 1.02]


def spline(data):
    for animation in data.document["animations"]:
        animation["samplers"][-1]["interpolation"] = "CUBICSPLINE"


def frame_gone_glb(data):
    node = next((n for n in data.document["nodes"] if "frame" in n.get("extras", {})), None)
    if node is None:
        return False
    del node["extras"]
    return True


def rest_moved(data):
    node = data.links()[-1]
    old = node.get("translation", [0, 0, 0])
    node["translation"] = [old[0] + 0.01, *old[1:]]


def wrong_bounds(data):
    primitive = data.document["meshes"][0]["primitives"][0]
    data.document["accessors"][primitive["attributes"]["POSITION"]]["max"][0] += 1.0


for kind, change, says in (
    ("translation of a link missing", channel_gone("translation"), "link"),
    ("rotation of a link missing", channel_gone("rotation"), "link"),
    ("half a second late", later, "time|start|lasts"),
    ("keys of a link exchanged", keys_of_a_link, "link"),
    ("quaternions of length 1.05", long_quaternion, "quaternion"),
    ("normals inside out", normals, "normal"),
    ("alpha", transparent, "colour|alpha|opaque"),
    ("link without a mesh", no_mesh, "mesh|link"),
    ("link scaled", link_scaled, "scale|link"),
    ("spline without tangents", spline, "spline|keys|values|CUBICSPLINE"),
    ("rest moved", rest_moved, "rest|link|joint"),
    ("bounds of an accessor", wrong_bounds, "max|bound|accessor"),
):
    more(f"GLB: {kind}", glb(change), says, r"\.glb")

# ------------------------------------------------------------------------------------------------------ Unity


def script(choose, new):
    def edit(folder):
        files = sorted((folder / "unity").rglob("*.cs"))
        file = next((f for f in files if choose in f.name), None)
        if file is None:
            return False
        old = file.read_text("utf-8")
        file.unlink()
        if new is not None:
            file.write_text(new(old), "utf-8")
        return True

    return edit


def line_gone(text: str) -> str:
    lines = text.splitlines(keepends=True)
    lines.pop(len(lines) // 2)
    return "".join(lines)


for kind, edit in (
    ("script deleted", script("Track.cs", None)),
    ("line deleted", script("Keys.cs", line_gone)),
    ("sign of a script", script("Playhead.cs", lambda t: t.replace(" < ", " > ", 1))),
    ("script empty", script("Grab.cs", lambda t: "")),
):
    more(f"Unity: {kind}", edit, "Track.cs|Keys.cs|Playhead.cs|Grab.cs", "unity")


# ------------------------------------------------------------------------------------- what formats hold beside bodies


def scene_empty(glb) -> None:
    glb.document["scenes"] = [{"nodes": []}]


def collider_off(p, layer) -> None:
    set_or_add("physics:collisionEnabled", Sdf.ValueTypeNames.Bool, False)(p, layer)


def in_physics(wanted, change):
    def edit(folder):
        layer, _ = layers(folder)
        found = prims_of(layer, wanted)
        if not found:
            return False
        change(found[0], layer)
        stored(layer, folder)
        return True

    return edit


def is_link_with_meshes(p) -> bool:
    return any(is_mesh(child) for child in p.nameChildren)


def is_collider(p) -> bool:
    return "PhysicsCollisionAPI" in str(p.GetInfo("apiSchemas"))


for kind, edit, says in (
    ("medium", text("*.xml", "<option ", '<option density="1000" viscosity="0.5" '), "medium"),
    ("links collide", text("*.xml", 'contype="0"', 'contype="1"', count=0), "collisions of its own links"),
    ("reference of a mesh", text("*.xml", '(<mesh name="[^"]*")', r'\1 refpos="10 0 0"'), "mesh"),
    ("turn of a mesh", text("*.xml", '(<mesh name="[^"]*")', r'\1 refquat="0.7 0.7 0 0"'), "mesh"),
    ("margin of a limit", text("*.xml", '(type="hinge")( [^>]*range=)', r'\1 margin="0.2"\2'), "limits"),
    ("filter of a drive", text("*.xml", "(<general )", r'<general dyntype="filter" dynprm="2" '), "law"),
    ("soft limit", text("*.xml", '(type="hinge")( [^>]*range=)', r'\1 solreflimit="0.5 1"\2'), "limit of joint"),
    ("control beyond a tendon", text("*.xml", '(tendon="[^>]*ctrlrange=")-', r"\1-1"), "ctrlrange .* tendon"),
):
    more(f"MJCF: {kind}", edit, says, r"\.xml")
for kind, edit, says in (
    ("link invisible", in_geometry(is_link_with_meshes, invisible), "mesh"),
    ("cone", text("usd/physics.usda", r"(coneAngle1Limit = )\d", r"\g<1>1"), "cone"),
    ("collider disabled", in_physics(is_collider, collider_off), "collider"),
    ("assumed called published", text("usd/physics.usda", '= "ASSUMED"', '= "PUBLISHED"'), "provenance"),
):
    more(f"USD: {kind}", edit, says, r"\.usd|\.xml|\.urdf|\.glb")
for kind, edit, says in (
    (
        "soft limits",
        text(
            "*.urdf",
            '(type="(?:revolute|prismatic)">(?:(?!</joint>)[^$])*<limit [^>]*/>)',
            r'\1<safety_controller soft_lower_limit="0" soft_upper_limit="0.01" k_velocity="1" k_position="1"/>',
        ),
        "soft limits",
    ),
    ("material undefined", text("*.urdf", '<material name="[^"]*" />', '<material name="nobody" />'), "material"),
    (
        "two joints of one name",
        text("*.urdf", '(<joint name=")([^"]*)("[^$]*<joint name=")[^"]*', r"\1\2\3\2"),
        "two joints are named",
    ),
):
    more(f"URDF: {kind}", edit, says, r"\.urdf")
more("GLB: units", glb(lambda data: data.document["asset"]["extras"].update(units="mm, g, s")), "units", r"\.glb")


def fewer_normals(glb) -> None:
    attributes = glb.document["meshes"][0]["primitives"][0]["attributes"]
    glb.document["accessors"][attributes["NORMAL"]]["count"] -= 3


def cut_off(glb) -> None:
    glb.document["materials"][0].update(alphaMode="MASK", alphaCutoff=2.0)


listed_ratio = text("usd/physics.usda", r"(dictionary couplings = \{[\s\S]*?double \w+ = )(-?)\d", r"\1\g<2>7")
more("USD: coupling listed otherwise", listed_ratio, "coupling", r"\.usd")
more("GLB: material cut off", glb(cut_off), "alphaCutoff", r"\.glb")
more("GLB: normals missing", glb(fewer_normals), "NORMAL has", r"\.glb")
more("GLB: scene empty", glb(scene_empty), "scene", r"\.glb")


def slim(folder: Path, name: str) -> None:
    """Delete what a kind of defect does not need, proof.json always: its hashes show every change."""
    (folder / "proof.json").unlink(missing_ok=True)
    (folder / "README.txt").unlink(missing_ok=True)
    if name.startswith("Unity"):
        for path in folder.iterdir():
            if path.name not in ("unity", f"{robot(folder)}.urdf", "meshes"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        return
    shutil.rmtree(folder / "unity", ignore_errors=True)
    if not name.startswith("usdz"):
        for file in folder.glob("*.usdz"):
            file.unlink()
    if not name.startswith("USD motion"):
        kept = {f"{robot(folder)}.usda", "physics.usda", "geometry.usdc"}
        if "gravity" in name:
            kept.add(f"{robot(folder)}_sim.usda")
        for file in (folder / "usd").rglob("*"):
            if file.is_file() and file.name not in kept:
                file.unlink()


def copied(bundle: Path, target: Path, one: Seed) -> bool:
    """Copy a bundle and apply a seed to the copy; return whether the bundle has the edited data."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(bundle, target)
    slim(target, one.name)
    return one.edit(target) is not False


def found(report, one: Seed) -> bool:
    """Return whether a report names the right cause; of the kinds in WARNED, as a warning."""
    return base.found(report, one, warned=one.name in WARNED)
