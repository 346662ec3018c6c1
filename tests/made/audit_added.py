"""Elements and prims added to an exported URDF, MJCF or stage: one of each kind that the format knows.

`audit_fields` changes what a file declares; here a file gets something that it has not: a body, a shape, a joint, a
motor, a constraint, a default class, an option, a layer that overrides. The kinds are lists of snippets; a robot gives
the places: its first moving body, its joints, its motors.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

from pxr import Gf, Sdf, UsdGeom

from made.audit_fields import FieldChange, parsed, stored
from made.audit_fields_usd import Edit, usd_change

IN_BODY = (
    '<geom type="sphere" size="0.05"/>',
    '<geom type="box" size="0.02 0.02 0.02" mass="0.5" contype="0" conaffinity="0"/>',
    '<geom type="sphere" size="0.01" mass="0" contype="0" conaffinity="0" rgba="1 0 0 1"/>',
    '<site name="point_more" pos="0.01 0 0"/>',
    '<site name="frame_more" pos="0.01 0 0"/>',
    '<body name="more" pos="0 0 0.1"><inertial pos="0 0 0" mass="0.3" diaginertia="1e-4 1e-4 1e-4"/></body>',
    '<body name="more" pos="0 0 0.1"><joint name="more_joint" type="hinge" axis="1 0 0"/>'
    '<inertial pos="0 0 0" mass="0.3" diaginertia="1e-4 1e-4 1e-4"/></body>',
    '<joint name="more_joint" type="slide" axis="1 0 0"/>',
    '<joint name="more_joint" type="ball"/>',
    '<camera name="more_camera" pos="0 0 1"/>',
)
"""Elements added to the last body of an MJCF."""

IN_MJCF = (
    '<equality><joint joint1="{joint}" joint2="{other}" polycoef="0 1 0 0 0"/></equality>',
    '<equality><joint joint1="{joint}" polycoef="0 0 0 0 0"/></equality>',
    '<equality><connect body1="{body}" body2="{parent}" anchor="0 0 0"/></equality>',
    '<equality><weld body1="{body}" body2="{parent}"/></equality>',
    '<actuator><motor name="more" joint="{joint}"/></actuator>',
    '<actuator><position name="more" joint="{joint}" kp="10"/></actuator>',
    '<actuator><velocity name="more" joint="{joint}" kv="10"/></actuator>',
    '<actuator><general name="more" body="{body}" gainprm="1"/></actuator>',
    '<tendon><fixed name="more" stiffness="100"><joint joint="{joint}" coef="1"/></fixed></tendon>',
    '<tendon><fixed name="more" frictionloss="1"><joint joint="{joint}" coef="1"/></fixed></tendon>',
    '<contact><exclude body1="{body}" body2="{parent}"/></contact>',
    '<sensor><jointpos name="more" joint="{joint}"/></sensor>',
    '<keyframe><key name="more"/></keyframe>',
    '<custom><numeric name="more" data="1 2 3"/></custom>',
    '<default><default class="more"><joint damping="1"/></default></default>',
    '<option gravity="0 0 0"/>',
    '<option gravity="0 0 9.81"/>',
    '<option timestep="0.01"/>',
    '<option integrator="Euler"/>',
    '<option cone="elliptic"/>',
    '<option iterations="2"/>',
    '<option><flag gravity="disable"/></option>',
    '<option><flag equality="disable"/></option>',
    '<option><flag limit="disable"/></option>',
    '<option><flag actuation="disable"/></option>',
    '<option><flag autoreset="disable"/></option>',
    '<option actuatorgroupdisable="0"/>',
    '<option o_margin="0.1" o_solref="0.1 1"><flag override="enable"/></option>',
    '<compiler alignfree="true"/>',
    '<compiler boundinertia="1"/>',
    '<compiler autolimits="false"/>',
    '<compiler meshdir="meshes"/>',
    '<size nuserdata="3"/>',
    '<deformable><skin name="more" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="{body}" bindpos="0 0 0" '
    'bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>',
)
"""Elements added to the root of an MJCF."""

IN_URDF = (
    '<link name="more"/><joint name="more_joint" type="fixed"><parent link="{link}"/><child link="more"/></joint>',
    '<link name="more"><inertial><mass value="0.3"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
    '</inertial></link><joint name="more_joint" type="fixed"><parent link="{link}"/><child link="more"/></joint>',
    '<link name="more"><inertial><mass value="0.3"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
    '</inertial></link><joint name="more_joint" type="continuous"><axis xyz="1 0 0"/><parent link="{link}"/>'
    '<child link="more"/></joint>',
    '<link name="more"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>'
    '<joint name="more_joint" type="fixed"><parent link="{link}"/><child link="more"/></joint>',
    '<transmission name="more"><type>transmission_interface/SimpleTransmission</type><joint name="{passive}">'
    "<hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface></joint>"
    '<actuator name="{passive}"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>',
    '<gazebo reference="{link}"><selfCollide>true</selfCollide></gazebo>',
    '<gazebo reference="{joint}"><implicitSpringDamper>true</implicitSpringDamper><springStiffness>5</springStiffness>'
    "</gazebo>",
    "<gazebo><static>true</static></gazebo>",
    '<gazebo reference="{link}"><gravity>false</gravity></gazebo>',
    '<ros2_control name="more" type="system"><joint name="{passive}"><command_interface name="position"/></joint>'
    "</ros2_control>",
)
"""Elements added to the root of a URDF."""


def added_changes(folder: Path, file: str) -> Iterator[FieldChange]:
    """Yield one change for each kind of element or prim that can be added to a file of an export."""
    if file.endswith(".xml"):
        yield from _in_mjcf(folder, file)
    elif file.endswith(".urdf"):
        yield from _in_urdf(folder, file)
    else:
        yield from _in_stage(folder, file)


def _xml(file: str, kind: str, place: str, words: set[str], change: Callable[[ET.Element], None]) -> FieldChange:
    def edit(folder: Path) -> None:
        root = parsed(folder / file)
        change(root)
        stored(folder / file, root)

    return FieldChange(file, kind, place, frozenset(words), edit)


def _words(snippet: ET.Element) -> set[str]:
    """Return tags, attributes and names of a snippet, of which a finding must have one."""
    words: set[str] = set()
    for element in snippet.iter():
        words |= {element.tag, *element.attrib}
        words |= {text for text in element.attrib.values() if text[:1].isalpha()}
    return words


def _in_mjcf(folder: Path, file: str) -> Iterator[FieldChange]:
    root = parsed(folder / file)
    bodies = [body.get("name", "") for body in root.iter("body") if body.find("inertial") is not None]
    parents = {child.get("name"): body.get("name") for body in root.iter("body") for child in body.findall("body")}
    joints = [j.get("name", "") for j in root.iter("joint") if j.get("type") in ("hinge", "slide") and j.get("name")]
    body = next(name for name in reversed(bodies) if parents.get(name))
    names = {"body": body, "parent": str(parents[body]), "joint": joints[0], "other": joints[1]}
    for text in IN_BODY:
        snippet = ET.fromstring(text)

        def append(own: ET.Element, snippet: ET.Element = snippet) -> None:
            target = next(b for b in own.iter("body") if b.get("name") == body)
            # Joints stand before the mass, as in files that are written by hand.
            target.insert(0, copy.deepcopy(snippet))

        yield _xml(file, f"body/{text} added", body, _words(snippet) | {body}, append)
    for text in IN_MJCF:
        snippet = ET.fromstring(text.format(**names))
        # A second section of a kind is joined with the first by MuJoCo.
        yield _xml(file, f"{text} added", "", _words(snippet), lambda own, s=snippet: own.append(copy.deepcopy(s)))


def _in_urdf(folder: Path, file: str) -> Iterator[FieldChange]:
    root = parsed(folder / file)
    driven = {joint.get("name") for joint in root.findall("transmission/joint")}
    moving = [j for j in root.findall("joint") if j.get("type") != "fixed"]
    passive = [str(j.get("name")) for j in moving if j.get("name") not in driven] or [str(moving[0].get("name"))]
    child = moving[-1].find("child")
    assert child is not None
    names = {"link": str(child.get("link")), "joint": str(moving[0].get("name")), "passive": passive[0]}
    for text in IN_URDF:
        snippets = ET.fromstring(f"<all>{text.format(**names)}</all>")

        def append(own: ET.Element, snippets: ET.Element = snippets) -> None:
            for snippet in snippets:
                own.append(copy.deepcopy(snippet))

        yield _xml(file, f"{text} added", names["link"], _words(snippets) | set(names.values()), append)


class _Stage:
    """Places in the layer of the physics of an export, for the prims that are added."""

    def __init__(self, layer: Sdf.Layer) -> None:
        self.root = Sdf.Path(f"/{layer.defaultPrim or layer.rootPrims[0].name}")
        joints = layer.GetPrimAtPath(self.root.AppendChild("joints"))
        single = [j for j in joints.nameChildren if j.typeName in ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint")]
        self.joint = single[0].path
        self.kind = single[0].typeName
        self.body = single[0].relationships["physics:body1"].targetPathList.GetAddedOrExplicitItems()[0]
        self.other = single[-1].relationships["physics:body1"].targetPathList.GetAddedOrExplicitItems()[0]
        self.driven = next(j.path for j in joints.nameChildren if "twin:active" in j.attributes)


def _prim(layer: Sdf.Layer, path: Sdf.Path, kind: str) -> Sdf.PrimSpec:
    prim = Sdf.CreatePrimInLayer(layer, path)
    prim.specifier = Sdf.SpecifierDef
    prim.typeName = kind
    return prim


def _value(prim: Sdf.PrimSpec, name: str, kind: Sdf.ValueTypeName, value: object) -> None:
    attribute = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, kind)
    attribute.default = value


def _apply(prim: Sdf.PrimSpec, schema: str) -> None:
    schemas = Sdf.TokenListOp()
    own = prim.GetInfo("apiSchemas") if prim.HasInfo("apiSchemas") else None
    schemas.prependedItems = [*(own.prependedItems if own else []), schema]
    prim.SetInfo("apiSchemas", schemas)


def _targets(prim: Sdf.PrimSpec, name: str, *paths: Sdf.Path) -> None:
    relationship = prim.relationships.get(name) or Sdf.RelationshipSpec(prim, name)
    relationship.targetPathList.explicitItems = list(paths)


def _new_prims(at: _Stage) -> dict[str, Edit]:
    """Return {kind: edit} of prims that a stage gets besides its own."""

    def cube(layer: Sdf.Layer) -> None:
        _value(_prim(layer, at.body.AppendChild("more"), "Cube"), "size", Sdf.ValueTypeNames.Double, 0.05)

    def stray(layer: Sdf.Layer) -> None:
        _value(_prim(layer, at.root.AppendChild("more"), "Sphere"), "radius", Sdf.ValueTypeNames.Double, 0.05)

    def collider(layer: Sdf.Layer) -> None:
        prim = _prim(layer, at.body.AppendChild("more"), "Sphere")
        _apply(prim, "PhysicsCollisionAPI")
        _value(prim, "purpose", Sdf.ValueTypeNames.Token, "guide")

    def body(layer: Sdf.Layer) -> None:
        prim = _prim(layer, at.root.AppendChild("more"), "Xform")
        _apply(prim, "PhysicsRigidBodyAPI")
        _apply(prim, "PhysicsMassAPI")
        _value(prim, "physics:mass", Sdf.ValueTypeNames.Float, 1.0)

    def nested_body(layer: Sdf.Layer) -> None:
        _apply(_prim(layer, at.body.AppendChild("more"), "Xform"), "PhysicsRigidBodyAPI")

    def joint(kind: str) -> Edit:
        def edit(layer: Sdf.Layer) -> None:
            prim = _prim(layer, at.root.AppendPath("joints/more"), kind)
            _targets(prim, "physics:body0", at.body)
            _targets(prim, "physics:body1", at.other)

        return edit

    def group(layer: Sdf.Layer) -> None:
        prim = _prim(layer, at.root.AppendChild("more"), "PhysicsCollisionGroup")
        _targets(prim, "collection:colliders:includes", at.root)
        _targets(prim, "physics:filteredGroups", at.root.AppendChild("more"))

    def scene(layer: Sdf.Layer) -> None:
        prim = _prim(layer, Sdf.Path("/more"), "PhysicsScene")
        _value(prim, "physics:gravityMagnitude", Sdf.ValueTypeNames.Float, 1.6)

    def material(layer: Sdf.Layer) -> None:
        path = at.root.AppendChild("more")
        prim = _prim(layer, path, "Material")
        _apply(prim, "PhysicsMaterialAPI")
        _value(prim, "physics:dynamicFriction", Sdf.ValueTypeNames.Float, 0.0)
        link = Sdf.CreatePrimInLayer(layer, at.body)
        _apply(link, "MaterialBindingAPI")
        _targets(link, "material:binding:physics", path)

    def frame(layer: Sdf.Layer) -> None:
        prim = _prim(layer, at.body.AppendChild("more"), "Xform")
        _value(prim, "twin:kind", Sdf.ValueTypeNames.Token, "frame")

    return {
        "Cube below a link": cube,
        "Sphere beside the links": stray,
        "guide collider below a link": collider,
        "rigid body beside the links": body,
        "rigid body below a link": nested_body,
        "PhysicsFixedJoint": joint("PhysicsFixedJoint"),
        "PhysicsDistanceJoint": joint("PhysicsDistanceJoint"),
        "PhysicsRevoluteJoint": joint("PhysicsRevoluteJoint"),
        "PhysicsCollisionGroup": group,
        "PhysicsScene": scene,
        "physics material": material,
        "frame": frame,
    }


def _stronger_values(at: _Stage) -> dict[str, Edit]:
    """Return {kind: edit} of values that a stronger layer states over those of the stage."""
    float_, token = Sdf.ValueTypeNames.Float, Sdf.ValueTypeNames.Token
    drive = "angular" if at.kind == "PhysicsRevoluteJoint" else "linear"

    def over(path: Sdf.Path, name: str, kind: Sdf.ValueTypeName, value: object) -> Edit:
        return lambda layer: _value(Sdf.CreatePrimInLayer(layer, path), name, kind, value)

    def sampled(path: Sdf.Path, name: str, kind: Sdf.ValueTypeName, value: object) -> Edit:
        def edit(layer: Sdf.Layer) -> None:
            prim = Sdf.CreatePrimInLayer(layer, path)
            if name not in prim.attributes:
                Sdf.AttributeSpec(prim, name, kind)
            layer.SetTimeSample(path.AppendProperty(name), 1.0, value)

        return edit

    def info(path: Sdf.Path, key: str, value: object) -> Edit:
        return lambda layer: Sdf.CreatePrimInLayer(layer, path).SetInfo(key, value)

    def schema(path: Sdf.Path, name: str) -> Edit:
        return lambda layer: _apply(Sdf.CreatePrimInLayer(layer, path), name)

    def filtered(layer: Sdf.Layer) -> None:
        prim = Sdf.CreatePrimInLayer(layer, at.body)
        _apply(prim, "PhysicsFilteredPairsAPI")
        _targets(prim, "physics:filteredPairs", at.other)

    def variant(layer: Sdf.Layer) -> None:
        prim = Sdf.CreatePrimInLayer(layer, at.root)
        choice = Sdf.VariantSpec(Sdf.VariantSetSpec(prim, "size"), "large")
        prim.variantSetNameList.Add("size")
        prim.variantSelections["size"] = "large"
        lower = Sdf.CreatePrimInLayer(layer, choice.path.AppendChild(at.body.name))
        _value(lower, "physics:mass", float_, 77.0)

    def reset(layer: Sdf.Layer) -> None:
        prim = Sdf.CreatePrimInLayer(layer, at.body)
        order = ["!resetXformStack!", "xformOp:translate", "xformOp:orient"]
        _value(prim, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, order)

    def scaled(layer: Sdf.Layer) -> None:
        prim = Sdf.CreatePrimInLayer(layer, at.body)
        _value(prim, "xformOp:scale", Sdf.ValueTypeNames.Float3, Gf.Vec3f(1.0, 1.0, 1.01))
        order = ["xformOp:translate", "xformOp:orient", "xformOp:scale"]
        _value(prim, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, order)

    return {
        "inactive link": info(at.body, "active", False),
        "instanceable link": info(at.body, "instanceable", True),
        "inactive joint": info(at.joint, "active", False),
        "link as a class": info(at.body, "specifier", Sdf.SpecifierClass),
        "lower limit": over(at.joint, "physics:lowerLimit", float_, -0.1),
        "lower limit at a time": sampled(at.joint, "physics:lowerLimit", float_, -0.1),
        "joint disabled": over(at.joint, "physics:jointEnabled", Sdf.ValueTypeNames.Bool, False),
        "joint without collisions": over(at.joint, "physics:collisionEnabled", Sdf.ValueTypeNames.Bool, True),
        "type of the drive": over(at.driven, f"drive:{drive}:physics:type", token, "acceleration"),
        "target velocity": over(at.driven, f"drive:{drive}:physics:targetVelocity", float_, 3.0),
        "mass": over(at.body, "physics:mass", float_, 77.0),
        "mass at a time": sampled(at.body, "physics:mass", float_, 77.0),
        "density": over(at.body, "physics:density", float_, 77.0),
        "velocity": over(at.body, "physics:velocity", Sdf.ValueTypeNames.Vector3f, Gf.Vec3f(1, 0, 0)),
        "angular velocity": over(at.body, "physics:angularVelocity", Sdf.ValueTypeNames.Vector3f, Gf.Vec3f(9, 0, 0)),
        "asleep": over(at.body, "physics:startsAsleep", Sdf.ValueTypeNames.Bool, True),
        "kinematic": over(at.body, "physics:kinematicEnabled", Sdf.ValueTypeNames.Bool, True),
        "rigid body disabled": over(at.body, "physics:rigidBodyEnabled", Sdf.ValueTypeNames.Bool, False),
        "invisible": over(at.body, "visibility", token, "invisible"),
        "purpose guide": over(at.body, "purpose", token, "guide"),
        "purpose render": over(at.body, "purpose", token, "render"),
        "invisible at a time": sampled(at.body, "visibility", token, "invisible"),
        "place": over(at.body, "xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(0.1, 0.2, 0.3)),
        "place at a time": sampled(at.body, "xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(0.1, 0.2, 0.3)),
        "resetXformStack": reset,
        "scale": scaled,
        "variant": variant,
        "filteredPairs": filtered,
        "articulation root on a link": schema(at.body, "PhysicsArticulationRootAPI"),
        "damping of PhysX": over(at.body, "physxRigidBody:linearDamping", float_, 5.0),
        "friction of PhysX": over(at.joint, "physxJoint:jointFriction", float_, 5.0),
        "armature of PhysX": over(at.joint, "physxJoint:armature", float_, 5.0),
        "root moved": over(at.root, "xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(0.1, 0, 0)),
        "root kind": info(at.root, "kind", "component"),
    }


def _layer_values() -> dict[str, Edit]:
    """Return {kind: edit} of metadata of the root layer."""

    def set_(key: str, value: object) -> Edit:
        return lambda layer: layer.pseudoRoot.SetInfo(key, value)

    return {
        "metersPerUnit": set_("metersPerUnit", 0.01),
        "kilogramsPerUnit": set_("kilogramsPerUnit", 0.001),
        "upAxis": set_("upAxis", UsdGeom.Tokens.y),
        "timeCodesPerSecond": set_("timeCodesPerSecond", 12.0),
        "startTimeCode": set_("startTimeCode", 3.0),
        "endTimeCode": set_("endTimeCode", 7.0),
        "framesPerSecond": set_("framesPerSecond", 12.0),
        "defaultPrim": set_("defaultPrim", "more"),
    }


def _in_stage(folder: Path, file: str) -> Iterator[FieldChange]:
    """Yield what is added to the root layer of a stage, which is stronger than its other layers."""
    at = _Stage(Sdf.Layer.OpenAsAnonymous(str(folder / "usd/physics.usda")))
    words = {at.body.name, at.joint.name, at.driven.name, "more", "default prim", "scale"}
    for name, edit in (_new_prims(at) | _stronger_values(at)).items():
        yield usd_change(file, f"stage {name} added", at.body, {*words, *name.split()}, edit)
    for name, edit in _layer_values().items():
        yield usd_change(file, f"stage {name} set", at.root, {name, "more", "time code", "rate", "up", "unit"}, edit)
