"""Sixty kinds of seeded defects that are no single field: mistakes of meaning, of several fields at once, of layers.

They were written and run before anything was mended for them, so that their first share says how many kinds that
nobody has drawn are found. Each is seeded without proof.json and README.txt, in URDF, MJCF and stages.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from pxr import Gf, Sdf

from made.audit_fields import parsed, stored, written
from made.audit_seeds import Seed, prims_of, value

FRESH: list[Seed] = []


def numbers(text: str) -> np.ndarray:
    return np.array(text.split(), float)


def xml(suffix: str, kind: str, says: str) -> Callable:
    """Return a decorator that adds a change of the root of a file; the change returns False if there is nothing."""

    def add(change: Callable[[ET.Element], bool | None]):
        def edit(folder: Path) -> bool:
            file = next(iter(sorted(folder.glob(f"*{suffix}"))))
            root = parsed(file)
            if change(root) is False:
                return False
            stored(file, root)
            return True

        name = {".urdf": "URDF", ".xml": "MJCF"}[suffix]
        FRESH.append(Seed(f"{name}: {kind}", edit, rf"\{suffix}", says))
        return change

    return add


def usd(layer: str, kind: str, says: str) -> Callable:
    """Return a decorator that adds a change of a layer of a stage, such as "physics.usda" or "ROBOT_sim.usda"."""

    def add(change: Callable[[Sdf.Layer, str], bool | None]):
        def edit(folder: Path) -> bool:
            robot = next(folder.glob("*.urdf")).stem
            name = layer.replace("ROBOT", robot)
            if "CLIP" in name:
                motions = sorted((folder / "usd/motion").glob("*.usdc"))
                if not motions:
                    return False
                name = name.replace("CLIP", motions[0].stem)
            file = folder / "usd" / name
            own = Sdf.Layer.OpenAsAnonymous(str(file))
            if change(own, robot) is False:
                return False
            file.unlink()
            assert own.Export(str(file))
            return True

        FRESH.append(Seed(f"USD: {kind}", edit, r"\.usd", says))
        return change

    return add


def driven_joints(root: ET.Element) -> list[ET.Element]:
    names = {j.get("name") for j in root.findall("transmission/joint")}
    return [j for j in root.findall("joint") if j.get("name") in names]


# -------------------------------------------------------------------------------------------------------- URDF


@xml(".urdf", "all origins in millimetres", "link|unit|larger")
def origins_in_millimetres(root):
    for origin in root.findall("joint/origin"):
        origin.set("xyz", written(1000 * numbers(origin.get("xyz", "0 0 0"))))


@xml(".urdf", "all angles in degrees", "link|axis|zero|pose")
def angles_in_degrees(root):
    for origin in root.findall("joint/origin"):
        origin.set("rpy", written(np.degrees(numbers(origin.get("rpy", "0 0 0")))))


@xml(".urdf", "limits of one joint in degrees", "limit")
def limits_in_degrees(root):
    joint = next((j for j in driven_joints(root) if j.get("type") == "revolute"), None)
    if joint is None:
        return False
    limit = joint.find("limit")
    for key in ("lower", "upper"):
        limit.set(key, f"{np.degrees(float(limit.get(key))):.9g}")


@xml(".urdf", "two joints exchange their origins", "link|joint|axis|zero")
def origins_exchanged(root):
    first, second, *_ = [j for j in root.findall("joint") if j.get("type") != "fixed" and j.find("origin") is not None]
    a, b = first.find("origin"), second.find("origin")
    if a.attrib == b.attrib:
        return False
    kept = dict(a.attrib)
    a.attrib.clear()
    a.attrib.update(b.attrib)
    b.attrib.clear()
    b.attrib.update(kept)


def heavy_links(root: ET.Element) -> list[ET.Element]:
    return [e for e in root.findall("link") if e.find("inertial") is not None and e.find("visual") is not None]


def tensor(inertial: ET.Element) -> np.ndarray:
    i = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (float(i.get(k)) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def set_tensor(inertial: ET.Element, moments: np.ndarray) -> None:
    i = inertial.find("inertia")
    for key, (a, b) in zip(
        ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), strict=True
    ):
        i.set(key, f"{moments[a, b]:.12g}")


@xml(".urdf", "inertia about the link's origin", "inertia")
def inertia_about_origin(root):
    inertial = heavy_links(root)[-1].find("inertial")
    c = numbers(inertial.find("origin").get("xyz"))
    if np.linalg.norm(c) < 1e-3:
        return False
    m = float(inertial.find("mass").get("value"))
    set_tensor(inertial, tensor(inertial) + m * (c @ c * np.eye(3) - np.outer(c, c)))


@xml(".urdf", "two moments of inertia exchanged", "inertia")
def moments_exchanged(root):
    inertial = heavy_links(root)[1].find("inertial")
    i = inertial.find("inertia")
    a, b = i.get("ixx"), i.get("izz")
    if abs(float(a) - float(b)) < 1e-3 * float(a):
        return False
    i.set("ixx", b)
    i.set("izz", a)


@xml(".urdf", "mass moved to the parent", "mass")
def mass_moved(root):
    first, second = (e.find("inertial/mass") for e in heavy_links(root)[-2:])
    moved = 0.3 * float(second.get("value"))
    first.set("value", f"{float(first.get('value')) + moved:.12g}")
    second.set("value", f"{float(second.get('value')) - moved:.12g}")


@xml(".urdf", "axis and limits mirrored", "link|axis|limit")
def joint_mirrored(root):
    joint = next(j for j in driven_joints(root) if j.find("limit") is not None)
    axis, limit = joint.find("axis"), joint.find("limit")
    axis.set("xyz", written(-numbers(axis.get("xyz"))))
    low, high = float(limit.get("lower")), float(limit.get("upper"))
    limit.set("lower", f"{-high:.12g}")
    limit.set("upper", f"{-low:.12g}")


@xml(".urdf", "robot raised by a new root", "link|root|pose|world|joint")
def raised(root):
    children = {j.find("child").get("link") for j in root.findall("joint")}
    base = next(e.get("name") for e in root.findall("link") if e.get("name") not in children)
    root.append(ET.fromstring('<link name="floor"/>'))
    text = '<joint name="stand" type="fixed"><origin xyz="0 0 0.01"/><parent link="floor"/><child link="{}"/></joint>'
    root.append(ET.fromstring(text.format(base)))


@xml(".urdf", "a fixed joint turned by 180 degrees", "link|pose")
def mount_turned(root):
    shown = {e.get("name") for e in root.findall("link") if e.find("visual") is not None}
    joint = next(
        (j for j in root.findall("joint") if j.get("type") == "fixed" and j.find("child").get("link") in shown), None
    )
    if joint is None or joint.find("origin") is None:
        return False
    origin = joint.find("origin")
    r, p, y = numbers(origin.get("rpy", "0 0 0"))
    origin.set("rpy", written([r + np.pi, p, y]))


@xml(".urdf", "last link hung at the link before", "link|joint")
def hung_before(root):
    moving = [j for j in root.findall("joint") if j.get("type") != "fixed"]
    parents = {j.find("child").get("link"): j.find("parent").get("link") for j in root.findall("joint")}
    joint = next(j for j in reversed(moving) if j.find("parent").get("link") in parents)
    joint.find("parent").set("link", parents[joint.find("parent").get("link")])


@xml(".urdf", "a revolute joint continuous", "limit|kind|joint")
def made_continuous(root):
    joint = next((j for j in driven_joints(root) if j.get("type") == "revolute"), None)
    if joint is None:
        return False
    joint.set("type", "continuous")
    for key in ("lower", "upper"):
        joint.find("limit").attrib.pop(key, None)


@xml(".urdf", "efforts and speeds exchanged", "effort|speed|velocity")
def efforts_and_speeds(root):
    for joint in driven_joints(root):
        limit = joint.find("limit")
        effort, speed = limit.get("effort"), limit.get("velocity")
        limit.set("effort", speed)
        limit.set("velocity", effort)


@xml(".urdf", "centres of mass left out", "mass centre|centre of mass")
def centres_left_out(root):
    for inertial in root.findall("link/inertial"):
        origin = inertial.find("origin")
        if origin is not None:
            inertial.remove(origin)


@xml(".urdf", "a driven joint follows another", "joint|mimic|coupling|driven|link")
def driven_follows(root):
    first, second, *_ = driven_joints(root)
    if first.get("type") != second.get("type") or second.find("mimic") is not None:
        return False
    second.append(ET.fromstring(f'<mimic joint="{first.get("name")}" multiplier="-1" offset="0"/>'))


@xml(".urdf", "two actuators of one name", "actuator|name")
def actuators_of_one_name(root):
    actuators = [t.find("actuator") for t in root.findall("transmission") if len(t.findall("actuator")) == 1]
    if len(actuators) < 2:
        return False
    actuators[1].set("name", actuators[0].get("name"))


@xml(".urdf", "visuals of two links exchanged", "mesh|shape|surface|bounding")
def visuals_exchanged(root):
    first, second, *_ = heavy_links(root)
    for tag in ("visual", "collision"):
        own, other = first.findall(tag), second.findall(tag)
        for e in own:
            first.remove(e)
        for e in other:
            second.remove(e)
        first.extend(other)
        second.extend(own)


@xml(".urdf", "all colours grey", "colour")
def all_grey(root):
    for color in root.iter("color"):
        color.set("rgba", "0.5 0.5 0.5 1")


# -------------------------------------------------------------------------------------------------------- MJCF


@xml(".xml", "a quaternion as x y z w", "link|joint|equality|keyframe|axis|zero|pose")
def quaternion_xyzw(root):
    body = next(b for b in root.iter("body") if b.get("quat") and np.ptp(np.abs(numbers(b.get("quat")))[[0, 3]]) > 1e-3)
    w, x, y, z = numbers(body.get("quat"))
    body.set("quat", written([x, y, z, w]))


@xml(".xml", "two actuators drive each other's joint", "actuator|drives")
def actuators_crossed(root):
    first, second, *_ = [*root.findall("actuator/general")]
    for key in ("joint", "tendon"):
        if first.get(key) and second.get(key):
            a, b = first.get(key), second.get(key)
            first.set(key, b)
            second.set(key, a)


@xml(".xml", "two coordinates of the keyframe exchanged", "keyframe|posture|claim|actuator")
def key_exchanged(root):
    key = root.find("keyframe/key")
    q = numbers(key.get("qpos"))
    a, b = max(((i, i + 1) for i in range(len(q) - 1)), key=lambda p: abs(q[p[0]] - q[p[1]]))
    if q[a] == q[b]:
        return False
    q[[a, b]] = q[[b, a]]
    key.set("qpos", written(q))


@xml(".xml", "all forces ten times", "effort|motor")
def forces_ten_times(root):
    for actuator in root.findall("actuator/*"):
        if actuator.get("forcerange"):
            actuator.set("forcerange", written(10 * numbers(actuator.get("forcerange"))))


@xml(".xml", "one servo twice as stiff", "stiffness")
def twice_as_stiff(root):
    actuator = next(a for a in root.findall("actuator/general") if a.get("biastype") == "affine")
    actuator.set("gainprm", written(2 * numbers(actuator.get("gainprm"))))
    b = numbers(actuator.get("biasprm"))
    b[1] *= 2
    actuator.set("biasprm", written(b))


@xml(".xml", "damping in the joint instead of the servo", "damping")
def damping_moved(root):
    actuator = next(a for a in root.findall("actuator/general") if a.get("joint") and a.get("biastype") == "affine")
    b = numbers(actuator.get("biasprm"))
    joint = next(j for j in root.iter("joint") if j.get("name") == actuator.get("joint"))
    joint.set("damping", f"{-b[2]:g}")
    b[2] = 0
    actuator.set("biasprm", written(b))


@xml(".xml", "gravity along y", "gravity")
def gravity_along_y(root):
    root.find("option").set("gravity", "0 -9.81 0")


@xml(".xml", "a connect made a weld", "joint|kind|equality|loop")
def connect_made_weld(root):
    connect = root.find("equality/connect")
    if connect is None:
        return False
    connect.tag = "weld"
    connect.attrib.pop("anchor", None)


@xml(".xml", "one of the two points of a pin deleted", "joint|kind")
def pin_of_one_point(root):
    parent = root.find("equality")
    connects = [] if parent is None else parent.findall("connect")
    pinned = next((c for c in connects if c.get("name", "").endswith("_1")), None)
    if pinned is None:
        return False
    parent.remove(pinned)


@xml(".xml", "masses of two bodies exchanged", "mass")
def masses_exchanged(root):
    first, second, *_ = [b.find("inertial") for b in root.iter("body") if b.find("inertial") is not None][1:]
    a, b = first.get("mass"), second.get("mass")
    if a == b:
        return False
    first.set("mass", b)
    second.set("mass", a)


@xml(".xml", "axis of a joint 1 mm aside, the same pose at rest", "joint|link")
def axis_aside(root):
    joint = next(j for j in root.iter("joint") if j.get("type") == "hinge" and j.get("pos"))
    axis = numbers(joint.get("axis"))
    aside = np.cross(axis, [1, 0, 0] if abs(axis[0]) < 0.9 else [0, 1, 0])
    joint.set("pos", written(numbers(joint.get("pos")) + 0.001 * aside / np.linalg.norm(aside)))


@xml(".xml", "a tool frame hung at another body", "frame|link")
def frame_elsewhere(root):
    bodies = [*root.iter("body")]
    owner = next(b for b in bodies for s in b.findall("site") if s.get("name", "").startswith("frame_"))
    other = next(b for b in bodies if b is not owner)
    site = next(s for s in owner.findall("site") if s.get("name", "").startswith("frame_"))
    owner.remove(site)
    other.append(site)


@xml(".xml", "a ball joint made a hinge", "joint|kind|link|equality")
def ball_made_hinge(root):
    joint = next((j for j in root.iter("joint") if j.get("type") == "ball"), None)
    if joint is None:
        return False
    joint.set("type", "hinge")
    joint.set("axis", "0 0 1")
    key = root.find("keyframe/key")
    if key is not None:
        root.remove(root.find("keyframe"))


@xml(".xml", "range and ctrlrange narrower by 5 percent", "limit|range")
def narrower(root):
    actuator = next((a for a in root.findall("actuator/general") if a.get("joint") and a.get("ctrlrange")), None)
    if actuator is None:
        return False
    joint = next(j for j in root.iter("joint") if j.get("name") == actuator.get("joint"))
    for e, key in ((joint, "range"), (actuator, "ctrlrange")):
        low, high = numbers(e.get(key))
        e.set(key, written([low + 0.05 * (high - low), high]))


@xml(".xml", "ctrlrange narrower by 20 percent", "control|ctrlrange")
def control_narrower(root):
    actuator = next((a for a in root.findall("actuator/general") if a.get("joint") and a.get("ctrlrange")), None)
    if actuator is None:
        return False
    low, high = numbers(actuator.get("ctrlrange"))
    actuator.set("ctrlrange", written([low + 0.1 * (high - low), high - 0.1 * (high - low)]))


@xml(".xml", "a payload welded to the last link", "payload|link|body|mass")
def payload(root):
    body = [*root.iter("body")][-1]
    text = '<body name="payload"><inertial pos="0 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/></body>'
    body.append(ET.fromstring(text))


@xml(".xml", "masses computed from the shapes", "mass|inertia")
def masses_from_shapes(root):
    root.find("compiler").set("inertiafromgeom", "true")
    for geom in root.iter("geom"):
        geom.attrib.pop("mass", None)


@xml(".xml", "all links collide with each other", "collision|collide")
def links_collide(root):
    for geom in root.iter("geom"):
        geom.set("contype", "1")


@xml(".xml", "a mesh shown by its convex hull's box", "mesh|shape|surface|bounding")
def shown_by_box(root):
    geom = next(g for g in root.iter("geom") if g.get("mesh"))
    geom.set("type", "box")


@xml(".xml", "motors without servo", "stiffness|damping|driven|law|actuator")
def without_servo(root):
    for actuator in root.findall("actuator/general"):
        for key in ("biastype", "biasprm"):
            actuator.attrib.pop(key, None)
        actuator.set("gainprm", "1")


# --------------------------------------------------------------------------------------------------------- USD


def joint_prims(layer: Sdf.Layer) -> list[Sdf.PrimSpec]:
    return prims_of(layer, lambda p: p.typeName in ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint"))


def attribute_of(prim: Sdf.PrimSpec, name: str) -> Sdf.AttributeSpec:
    return prim.attributes[name]


@usd("geometry.usdc", "a link scaled by 1.001", "scale|mesh|link")
def link_scaled(layer, robot):
    prim = prims_of(layer, lambda p: p.path.pathElementCount == 2 and "xformOp:translate" in p.attributes)[1]
    Sdf.AttributeSpec(prim, "xformOp:scale", Sdf.ValueTypeNames.Float3).default = Gf.Vec3f(1.001, 1.001, 1.001)
    order = prim.attributes["xformOpOrder"]
    order.default = type(order.default)([*order.default, "xformOp:scale"])


@usd("physics.usda", "both frames of a joint tilted by 2 degrees", "axis|joint")
def frames_tilted(layer, robot):
    joint = next(j for j in joint_prims(layer) if j.typeName == "PhysicsRevoluteJoint")
    tilt = Gf.Quatf(Gf.Rotation(Gf.Vec3d(1, 0, 0), 2).GetQuat())
    for name in ("physics:localRot0", "physics:localRot1"):
        a = attribute_of(joint, name)
        a.default = a.default * tilt


@usd("physics.usda", "both frames of a joint moved by 1 mm", "joint|axis")
def frames_moved(layer, robot):
    joint = next(j for j in joint_prims(layer) if j.typeName == "PhysicsRevoluteJoint")
    for name in ("0", "1"):
        a = attribute_of(joint, f"physics:localPos{name}")
        q = attribute_of(joint, f"physics:localRot{name}").default
        a.default = a.default + Gf.Vec3f(Gf.Rotation(q).TransformDir(Gf.Vec3d(0.001, 0, 0)))


@usd("physics.usda", "limits of a joint in radians", "limit")
def limits_in_radians(layer, robot):
    joint = next(
        (
            j
            for j in joint_prims(layer)
            if j.typeName == "PhysicsRevoluteJoint" and value(j, "physics:upperLimit") is not None
        ),
        None,
    )
    if joint is None:
        return False
    for name in ("physics:lowerLimit", "physics:upperLimit"):
        a = attribute_of(joint, name)
        a.default = float(np.radians(a.default))


@usd("physics.usda", "all stiffnesses per radian", "stiffness")
def stiffness_per_radian(layer, robot):
    done = False
    for joint in joint_prims(layer):
        for a in joint.attributes:
            if a.name == "drive:angular:physics:stiffness":
                a.default = a.default * 57.29578
                done = True
    return done


def bodies(layer: Sdf.Layer) -> list[Sdf.PrimSpec]:
    return prims_of(layer, lambda p: "physics:mass" in p.attributes)


@usd("physics.usda", "a centre of mass in the world", "mass centre|centre of mass")
def centre_in_world(layer, robot):
    a = attribute_of(bodies(layer)[-1], "physics:centerOfMass")
    a.default = a.default + Gf.Vec3f(0.3, -0.02, 0.5)


@usd("physics.usda", "principal axes as x y z w", "inertia")
def axes_xyzw(layer, robot):
    for body in bodies(layer)[1:]:
        a = attribute_of(body, "physics:principalAxes")
        w, (x, y, z) = a.default.GetReal(), a.default.GetImaginary()
        turned = Gf.Quatf(x, y, z, w)
        moments = np.diag(np.array(value(body, "physics:diagonalInertia"), float))
        before, after = (np.array(Gf.Matrix3d(Gf.Quatd(q))).T for q in (a.default, turned))
        change = after @ moments @ after.T - before @ moments @ before.T
        if np.abs(change).max() > 1e-3 * moments.max():
            a.default = turned
            return True
    return False


@usd("physics.usda", "moments of inertia in another order", "inertia")
def moments_in_order(layer, robot):
    for body in bodies(layer)[1:]:
        a = attribute_of(body, "physics:diagonalInertia")
        x, y, z = a.default
        if abs(x - y) + abs(y - z) > 0.1 * max(x, y, z):
            a.default = Gf.Vec3f(y, z, x)
            return True
    return False


@usd("geometry.usdc", "a mesh under another link", "mesh|shape|link|surface|bounding")
def mesh_elsewhere(layer, robot):
    meshes = prims_of(layer, lambda p: p.typeName == "Mesh")
    links = prims_of(layer, lambda p: p.path.pathElementCount == 2 and p.name != "materials")
    mesh = meshes[0]
    other = next(e for e in links if e.path != mesh.path.GetParentPath())
    Sdf.CopySpec(layer, mesh.path, layer, other.path.AppendChild(f"{mesh.name}_moved"))
    del mesh.nameParent.nameChildren[mesh.name]


@usd("ROBOT.usda", "a stronger layer changes a mass", "mass")
def stronger_mass(layer, robot):
    prim = Sdf.CreatePrimInLayer(layer, f"/{robot}/{BODY[robot]}")
    Sdf.AttributeSpec(prim, "physics:mass", Sdf.ValueTypeNames.Float).default = 0.123


BODY = {"pa10": "link3", "sils": "bar1", "sher": "platform", "davinci_psm": "yaw", "raven_left": "link2"}
JOINT = {"pa10": "q3", "sils": "q1", "sher": "q1", "davinci_psm": "q1", "raven_left": "elbow"}
"""A link and a joint of each robot that is seeded."""


@usd("ROBOT_sim.usda", "only the scene changes a limit", "limit")
def scene_limit(layer, robot):
    prim = Sdf.CreatePrimInLayer(layer, f"/{robot}/joints/{JOINT[robot]}")
    Sdf.AttributeSpec(prim, "physics:upperLimit", Sdf.ValueTypeNames.Float).default = 0.01


@usd("ROBOT_sim.usda", "the scene deactivates a link", "link|joint|body")
def scene_without_link(layer, robot):
    prim = Sdf.CreatePrimInLayer(layer, f"/{robot}/{BODY[robot]}")
    prim.SetInfo("active", False)


@usd("ROBOT_CLIP.usda", "the layer of a motion with an offset", "clip|time|offset|sample|range|joint|link")
def layer_offset(layer, robot):
    layer.subLayerOffsets[0] = Sdf.LayerOffset(10.0, 0.5)


@usd("physics.usda", "the ends of a joint exchanged, not its frames", "joint|axis|link")
def ends_exchanged(layer, robot):
    joint = joint_prims(layer)[1]
    first, second = (joint.relationships[f"physics:body{k}"].targetPathList for k in (0, 1))
    a, b = list(first.explicitItems), list(second.explicitItems)
    first.explicitItems = b
    second.explicitItems = a


@usd("physics.usda", "a loop in the articulation", "articulation|loop")
def loop_in_articulation(layer, robot):
    joints = prims_of(layer, lambda p: value(p, "physics:excludeFromArticulation"))
    if not joints:
        return False
    joints[0].attributes["physics:excludeFromArticulation"].default = False


@usd("geometry.usdc", "a mesh invisible for a moment", "visib|mesh|link")
def invisible_for_a_moment(layer, robot):
    mesh = prims_of(layer, lambda p: p.typeName == "Mesh")[0]
    a = Sdf.AttributeSpec(mesh, "visibility", Sdf.ValueTypeNames.Token)
    layer.SetTimeSample(a.path, 0.0, "inherited")
    layer.SetTimeSample(a.path, 30.0, "invisible")


@usd("physics.usda", "a drive with two schemas", "drive|schema|stiffness")
def second_drive(layer, robot):
    joint = next(j for j in joint_prims(layer) if any("drive:" in a.name for a in j.attributes))
    items = joint.GetInfo("apiSchemas")
    other = "linear" if joint.typeName == "PhysicsRevoluteJoint" else "angular"
    items.prependedItems = [*items.prependedItems, f"PhysicsDriveAPI:{other}"]
    joint.SetInfo("apiSchemas", items)
    name = f"drive:{other}:physics:stiffness"
    Sdf.AttributeSpec(joint, name, Sdf.ValueTypeNames.Float).default = 5.0


@usd("physics.usda", "a passive joint sprung by a drive", "driven|drive|stiffness")
def passive_sprung(layer, robot):
    joint = next(
        (
            j
            for j in joint_prims(layer)
            if j.typeName == "PhysicsRevoluteJoint" and not any(a.name.startswith("drive:") for a in j.attributes)
        ),
        None,
    )
    if joint is None:
        return False
    items = joint.GetInfo("apiSchemas")
    items.prependedItems = [*items.prependedItems, "PhysicsDriveAPI:angular"]
    joint.SetInfo("apiSchemas", items)
    Sdf.AttributeSpec(joint, "drive:angular:physics:stiffness", Sdf.ValueTypeNames.Float).default = 5.0


@usd("physics.usda", "two joints between the same links", "joint")
def doubled_joint(layer, robot):
    joint = joint_prims(layer)[0]
    Sdf.CopySpec(layer, joint.path, layer, joint.path.ReplaceName(f"{joint.name}_again"))


@usd("geometry.usdc", "points in another order than the faces", "mesh|closed|winding|normal")
def points_in_order(layer, robot):
    mesh = prims_of(layer, lambda p: p.typeName == "Mesh" and len(p.attributes["points"].default) > 20)[0]
    points = mesh.attributes["points"]
    points.default = type(points.default)([*points.default[5:], *points.default[:5]])


@usd("geometry.usdc", "a link's pose at rest mirrored", "link|joint|pose|gap")
def rest_mirrored(layer, robot):
    prim = next(
        p
        for p in prims_of(layer, lambda p: p.path.pathElementCount == 2 and "xformOp:translate" in p.attributes)
        if abs(p.attributes["xformOp:translate"].default[1]) > 1e-3
    )
    a = prim.attributes["xformOp:translate"]
    x, y, z = a.default
    a.default = Gf.Vec3d(x, -y, z)


@usd("physics.usda", "an articulation root at a link", "articulation")
def root_at_a_link(layer, robot):
    root = layer.GetPrimAtPath(f"/{robot}")
    items = root.GetInfo("apiSchemas")
    items.prependedItems = [t for t in items.prependedItems if t != "PhysicsArticulationRootAPI"]
    root.SetInfo("apiSchemas", items)
    body = bodies(layer)[-1]
    own = body.GetInfo("apiSchemas")
    own.prependedItems = [*own.prependedItems, "PhysicsArticulationRootAPI"]
    body.SetInfo("apiSchemas", own)
