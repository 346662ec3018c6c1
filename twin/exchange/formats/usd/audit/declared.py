"""Check what a stage of this project declares beside mechanism and shapes: it must agree with the rest of the stage.

Other stages are only checked for what their own schemas say: they may declare anything.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from twin.core.provenance import EARLIER
from twin.core.units import SI
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured

_PROVENANCE = ("PUBLISHED", "CITED", "DERIVED", "ASSUMED", *EARLIER)

_TURNED = 60.0
"""Angle in degrees between a normal and its face that no smooth surface of an export has."""

_ROUNDED = 1e-3
"""Relative difference of a number and the one shown for it, which is rounded for people."""

_TESTED: Mapping[str, Any] = {
    "mjc:option:integrator": "discrete",
    "physxScene:enableExternalForcesEveryIteration": True,
    "physxScene:solverType": "TGS",
    "physxScene:timeStepsPerSecond": 1000,
    "physxArticulation:solverPositionIterationCount": 128,
}
"""Settings of engines at which the stages were tested (tests/witness/test_physx.py)."""

_READ = re.compile(
    r"drive:(angular|linear):physics:(damping|maxForce|stiffness|targetPosition|targetVelocity|type)"
    r"|extent|faceVertex(Counts|Indices)|points|normals|orientation|subdivisionScheme|holeIndices|primvars:.*"
    r"|purpose|visibility"
    r"|info:id|inputs:(diffuseColor|metallic|opacity|roughness)|outputs:.*|xformOp.*|twin:.*|newton:.*:position"
    r"|newton:selfCollisionEnabled|physics:(approximation|axis|breakForce|centerOfMass|collisionEnabled|coneAngle.Limit)"
    r"|physics:(diagonalInertia|excludeFromArticulation|gravity.*|jointEnabled|kinematicEnabled|localPos.|localRot.)"
    r"|physics:(lowerLimit|upperLimit|mass|principalAxes|rigidBodyEnabled)"
    r"|physxArticulation:(enabledSelfCollisions|solverPositionIterationCount)|physxJoint:maxJointVelocity"
    r"|physxMimicJoint:.*|physxRigidBody:disableGravity|physxTendon:.*|state:.*|limit:.*:physics:(low|high)"
    r"|mjc:option:integrator|physxScene:(enableExternalForcesEveryIteration|solverType|timeStepsPerSecond)"
    r"|familyName|elementType|indices"
)
"""Attributes that other checks and comparisons read."""

_MOVING = re.compile(r"xformOp:.*|state:.*|points|normals|extent")
"""Attributes that change during a motion: poses, joint values, and the surfaces of deformables."""

_READ_RELATIONSHIPS = re.compile(r"physics:body[01]|material:binding|physxMimicJoint:.*:referenceJoint|proxyPrim")
"""Relationships that other checks and comparisons read."""

_MOST = 0.7
"""Share of the prims that must have one form for the others to be odd."""

_LONGEST_VALUE = 60
"""Number of letters of a value that a finding shows."""

_LOOK = (UsdGeom.Gprim, UsdGeom.Subset, UsdShade.Material, UsdShade.Shader)
"""Prims whose further declarations act on contacts or on the look."""


def is_ours(stage: Usd.Stage) -> bool:
    """Return whether a stage is one of this project, by one of the several marks that it has."""
    root = stage.GetDefaultPrim()
    if not root:
        return False
    # Any mark will do: that another one is missing is a finding, and no reason to check less.
    if root.GetAttribute("twin:base") or root.GetCustomDataByKey("twin"):
        return True
    return any(prim.GetAttribute("twin:active") for prim in stage.Traverse())


def further_declarations(stage: Usd.Stage) -> tuple[dict[str, dict[str, str]], dict[str, dict[str, str]]]:
    """Return {prim: {attribute: value}} of what no other check reads: (of the motion, of contacts and look).

    Values that are those of the schemas where nothing is authored are left out, and cameras and lights, which are no
    parts of the robot.
    """
    motion: dict[str, dict[str, str]] = {}
    contact: dict[str, dict[str, str]] = {}
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Camera) or prim.HasAPI(UsdLux.LightAPI):
            continue
        fields: dict[str, str] = {}
        for attribute in prim.GetAuthoredAttributes():
            name = str(attribute.GetName())
            if _is_read_elsewhere(prim, name) or attribute.Get() == _fallback(prim, name):
                continue
            fields[name] = str(attribute.Get())[:_LONGEST_VALUE]
        for relationship in prim.GetAuthoredRelationships():
            name = str(relationship.GetName())
            targets = relationship.GetForwardedTargets()
            if targets and not _READ_RELATIONSHIPS.fullmatch(name):
                fields[name] = ", ".join(map(str, targets))[:_LONGEST_VALUE]
        if prim.IsA(UsdGeom.Gprim):
            purpose = str(UsdGeom.Imageable(prim).ComputePurpose())
            if purpose != UsdGeom.Tokens.default_:  # viewers show some purposes only on demand
                fields["purpose"] = purpose
        if not fields:
            continue
        path = str(prim.GetPath())
        if any(map(prim.IsA, _LOOK)):
            contact[path] = fields
        else:
            motion[path] = fields
    return motion, contact


def _is_read_elsewhere(prim: Usd.Prim, name: str) -> bool:
    """Return whether other checks read an attribute of a prim; two attributes are read of some joints only."""
    if name == "physics:breakForce":
        return prim.IsA(UsdPhysics.RevoluteJoint) or prim.IsA(UsdPhysics.PrismaticJoint)
    if name == "physics:excludeFromArticulation":
        return not _holds_base(prim)
    return _READ.fullmatch(name) is not None


def _holds_base(joint: Usd.Prim) -> bool:
    """Return whether a joint connects a link to what is no link: the world, or the prim of the robot."""
    for name in ("physics:body0", "physics:body1"):
        relationship = joint.GetRelationship(name)
        holds_link = False
        if relationship:
            for target in relationship.GetForwardedTargets():
                body = joint.GetStage().GetPrimAtPath(target)
                holds_link = holds_link or bool(body and body.HasAPI(UsdPhysics.RigidBodyAPI))
        if not holds_link:
            return True
    return False


def _fallback(prim: Usd.Prim, name: str) -> Any:
    """Return the value of an attribute where nothing is authored; None without one."""
    definition = prim.GetPrimDefinition()
    attribute_definition = definition.GetAttributeDefinition(name)
    if not attribute_definition:
        return None
    return attribute_definition.GetFallbackValue()


def check_declared(stage: Usd.Stage, mechanism: FileMechanism, codes: Array, ledger: Ledger) -> None:
    """Report declarations of a stage of this project that contradict each other, or are missing.

    Args:
        stage: the stage.
        mechanism: the mechanism data of the stage.
        codes: time codes (k,) of its samples.
        ledger: receives the findings.
    """
    root = stage.GetDefaultPrim()
    _check_marks(root, mechanism, _frames(stage), ledger)
    _check_parameters(root, ledger)
    _check_listed(root, mechanism, ledger)
    _check_schemas(stage, ledger)
    _check_joints(stage, ledger)
    _check_ends(stage, ledger)
    _check_resets(stage, ledger)
    _check_sampled(stage, ledger)
    _check_sample_times(stage, mechanism.links, ledger)
    _check_changing(stage, ledger)
    _check_scene(stage, ledger)
    _check_colliders(stage, ledger)
    _check_meshes(stage, ledger)
    _check_engines(stage, ledger)
    _check_display_colors(stage, ledger)
    _check_range(stage, codes, ledger)
    _check_undefined(stage, ledger)


def _frames(stage: Usd.Stage) -> set[str]:
    """Return the names of the frames of a stage, also of inactive ones, whose absence is found by itself."""
    names = set()
    for prim in stage.TraverseAll():
        if prim.GetAttribute("twin:kind").Get() == "frame":
            names.add(str(prim.GetAttribute("twin:name").Get() or prim.GetName()))
    return names


def _check_marks(root: Usd.Prim, mechanism: FileMechanism, frames: set[str], ledger: Ledger) -> None:
    """Report names of base and tool that are missing, or of nothing in the stage."""
    base = str(root.GetAttribute("twin:base").Get() or "")
    if base not in mechanism.links:
        text = "twin:base is missing."
        if base:
            text = f"twin:base is '{base}', which is no link of the stage."
        ledger.wrong("usd.mark", text, "twin:base", suggestion="export the stage again")
    if mechanism.tool not in frames:
        text = "twin:tool is missing."
        if mechanism.tool:
            text = f"twin:tool is '{mechanism.tool}', which is no frame of the stage."
        ledger.wrong("usd.mark", text, "twin:tool", suggestion="export the stage again")
    physx = root.GetAttribute("physxArticulation:enabledSelfCollisions").Get()
    newton = root.GetAttribute("newton:selfCollisionEnabled").Get()
    # Each engine reads its own attribute only: if they differ, one robot behaves in two ways.
    if physx != newton:
        text = (
            f"self collisions are {_word(physx)} in physxArticulation:enabledSelfCollisions, and {_word(newton)} in "
            "newton:selfCollisionEnabled."
        )
        ledger.wrong("usd.self_collision", text, str(root.GetPath()), suggestion="export the stage again")


def _word(value: Any) -> str:
    """Return a value of the stage as text; "not stated" for None."""
    if value is None:
        return "not stated"
    return str(value)


def _check_parameters(root: Usd.Prim, ledger: Ledger) -> None:
    """Report parameters whose value is not the number that they show, or whose provenance is none."""
    for name, row in (root.GetCustomDataByKey("twin:parameters") or {}).items():
        missing = [key for key in ("value", "shown", "unit", "provenance", "note") if key not in row]
        if missing:
            text = f"parameter '{name}' has no {', '.join(missing)}."
            ledger.wrong("usd.parameter", text, name, suggestion="export the stage again")
            continue
        factor = SI.get(str(row["unit"]), 1.0)
        value = float(row["value"])
        shown_value = float(row["shown"]) * factor
        if abs(value - shown_value) > _ROUNDED * max(abs(value), abs(shown_value)):
            text = (
                f"parameter '{name}' is {value:g}, but shows {row['shown']:g} {row['unit']}, which is {shown_value:g}."
            )
            size = Measured(value, shown_value)
            ledger.wrong("usd.parameter", text, name, size=size, suggestion="export the stage again")
        if row["provenance"] not in _PROVENANCE:
            text = f"parameter '{name}' has the provenance '{row['provenance']}', expected {', '.join(_PROVENANCE)}."
            ledger.wrong("usd.parameter", text, name, suggestion="export the stage again")


_LISTED: Mapping[str, Callable[[FileDrive], Any]] = {
    "limits from": lambda drive: drive.limits and drive.limits[0],
    "limits to": lambda drive: drive.limits and drive.limits[1],
    "soft_limits from": lambda drive: drive.soft and drive.soft[0],
    "soft_limits to": lambda drive: drive.soft and drive.soft[1],
    "max_speed": lambda drive: drive.speed,
    "max_acceleration": lambda drive: drive.acceleration,
    "max_jerk": lambda drive: drive.jerk,
    "drive stiffness": lambda drive: drive.stiffness,
    "drive damping": lambda drive: drive.damping,
    "drive max_effort": lambda drive: drive.effort,
}
"""Fields of the parameters "<joint>,<joint> <field>", with what they are of a joint."""


def _check_listed(root: Usd.Prim, mechanism: FileMechanism, ledger: Ledger) -> None:
    """Compare the limits and drives of joints with the parameters that the stage itself lists of them."""
    drives = {}
    for joint in mechanism.joints:
        if joint.names:
            drives[joint.names[0]] = joint.drive
    for name, row in (root.GetCustomDataByKey("twin:parameters") or {}).items():
        listed, _, field = str(name).partition(" ")
        joints = listed.split(",")
        if field not in _LISTED or "value" not in row or not set(joints) <= drives.keys():
            continue
        expected = float(row["value"])
        for joint in joints:
            stated = _LISTED[field](drives[joint])
            if stated is None or abs(float(stated) - expected) > 1e-5 * max(1e-3, abs(expected)):
                stated_text = "not stated"
                if stated is not None:
                    stated_text = f"{float(stated):.6g}"
                text = (
                    f"joint '{joint}': {field} is {stated_text}, but {expected:.6g} in the parameter '{name}' of the "
                    "stage."
                )
                ledger.wrong("usd.listed", text, joint, suggestion="export the stage again")


_SCHEMAS = (
    (r"physxJoint:.*", "PhysxJointAPI"),
    (r"state:(\w+):.*", r"PhysicsJointStateAPI:\1"),
    (r"drive:(\w+):.*", r"PhysicsDriveAPI:\1"),
    (r"limit:(\w+):.*", r"PhysicsLimitAPI:\1"),
    (r"physxMimicJoint:(\w+):.*", r"PhysxMimicJointAPI:\1"),
    (r"physics:approximation", "PhysicsMeshCollisionAPI"),
    (r"physics:(mass|centerOfMass|diagonalInertia|principalAxes|density)", "PhysicsMassAPI"),
    (r"material:binding", "MaterialBindingAPI"),
)
"""Properties that engines read only of prims with a schema."""


def _check_schemas(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report prims that state properties of a schema that they do not apply: engines ignore what they state."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        # As authored: usd-core does not register the schemas of PhysX and Newton, and leaves them out elsewhere.
        applied = set(map(str, prim.GetPrimTypeInfo().GetAppliedAPISchemas()))
        lacking: dict[str, str] = {}
        for prop in prim.GetAuthoredProperties():
            name = str(prop.GetName())
            for pattern, schema in _SCHEMAS:
                match = re.fullmatch(pattern, name)
                if match and match.expand(schema) not in applied:
                    lacking.setdefault(match.expand(schema), name)
        for schema, name in lacking.items():
            path = str(prim.GetPath())
            text = f"{path} states {name}, but does not apply {schema}: engines ignore it."
            ledger.wrong("usd.schema", text, path, suggestion=f"apply {schema}")


def _check_joints(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report joints whose declared states contradict each other, or are missing."""
    single = (UsdPhysics.RevoluteJoint, UsdPhysics.PrismaticJoint)
    for prim in stage.Traverse():
        if not any(map(prim.IsA, single)):
            continue
        name = prim.GetName()
        token = "angular" if prim.IsA(UsdPhysics.RevoluteJoint) else "linear"
        position = prim.GetAttribute(f"state:{token}:physics:position").Get()
        velocity = prim.GetAttribute(f"state:{token}:physics:velocity").Get()
        newton = prim.GetAttribute(f"newton:{token}:position").Get()
        stated = {"position": position, "velocity": velocity, "newton position": newton}
        missing = [key for key, value in stated.items() if value is None]
        if missing:
            text = f"joint '{name}' declares no {' and no '.join(missing)} of its state."
            ledger.wrong("usd.state", text, name, suggestion="export the stage again")
            continue
        # Both are stored in single precision, which has about seven digits.
        if abs(position - newton) > 1e-5 * max(1.0, abs(position)):
            text = f"joint '{name}' is at {position:g} in its state, but at {newton:g} for Newton."
            ledger.wrong("usd.state", text, name, size=Measured(newton, position), suggestion="export the stage again")
        if velocity:
            text = f"joint '{name}' has the velocity {velocity:g} at rest."
            ledger.wrong("usd.state", text, name, size=Measured(velocity, 0.0), suggestion="write 0")
        driven = prim.HasAPI(UsdPhysics.DriveAPI, token)
        if driven and prim.GetAttribute("twin:active").Get() is None:
            text = f"joint '{name}' has a drive, but no twin:active: readers take it for active without being told."
            ledger.add("usd.mark", "warning", text, name, suggestion="export the stage again")


def _check_resets(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report prims that ignore the transforms above them: they stay where they are if the robot is placed elsewhere."""
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).GetResetXformStack():
            path = str(prim.GetPath())
            text = f"{path} resets the transforms above it: it stays in place if a scene places the robot elsewhere."
            ledger.wrong("usd.reset", text, path, suggestion="remove !resetXformStack! from xformOpOrder")


def _check_ends(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report joints that do not join two prims: that of the base joins it to the prim of the robot."""
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint):
            continue
        for name in ("physics:body0", "physics:body1"):
            relationship = prim.GetRelationship(name)
            targets = relationship.GetForwardedTargets() if relationship else []
            if len(targets) != 1:
                text = f"joint '{prim.GetName()}' has {len(targets)} targets of {name}, expected one link."
                ledger.wrong("usd.joint_end", text, prim.GetName(), suggestion=f"name one link in {name}")


def _check_sampled(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report joints without samples of their coordinate if most others have some."""
    sampled: dict[str, bool] = {}
    for prim in stage.Traverse():
        for token in ("angular", "linear"):
            attribute = prim.GetAttribute(f"state:{token}:physics:position")
            if attribute and attribute.HasAuthoredValue():
                sampled[prim.GetName()] = attribute.GetNumTimeSamples() > 0
    for name, has_samples, most_have, count in _odd(sampled):
        if most_have and not has_samples:
            text = f"joint '{name}' has no samples of its coordinate; {count} others have some."
            ledger.add("usd.state", "warning", text, name, suggestion="bake the motion again")


def _check_sample_times(stage: Usd.Stage, links: Sequence[str], ledger: Ledger) -> None:
    """Report links whose poses have samples at other time codes than those of most links."""
    times: dict[str, tuple[float, ...]] = {}
    for prim in stage.Traverse():
        if prim.GetName() in links and prim.HasAPI(UsdPhysics.RigidBodyAPI):
            samples: set[float] = set()
            for op in UsdGeom.Xformable(prim).GetOrderedXformOps():
                samples |= set(op.GetTimeSamples())
            times[prim.GetName()] = tuple(sorted(samples))
    for link, own_times, common_times, count in _odd(times):
        if not own_times:  # at rest during the motion
            continue
        differing = sorted(set(own_times) ^ set(common_times))
        text = (
            f"the poses of link '{link}' have a time sample at the time code {differing[0]:g} that those of {count} "
            "other links lack."
        )
        if differing[0] in common_times:
            text = (
                f"the poses of link '{link}' lack the time sample at the time code {differing[0]:g}, which {count} "
                "other links have."
            )
        ledger.add("usd.sample_times", "warning", text, link, suggestion="bake the motion again")


def _check_changing(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report what changes with time besides poses, joint values and the points of deformables: a player shows it."""
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            name = attribute.GetName()
            if attribute.GetNumTimeSamples() == 0 or _MOVING.fullmatch(name):
                continue
            path = str(attribute.GetPath())
            text = f"{name} of {prim.GetPath()} has time samples; only poses, joint values and points may change."
            ledger.wrong("usd.changing", text, path, suggestion="remove the time samples, and write one value")


def _check_scene(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report a stage that says of itself that it is in a physics scene, without one; and one with several."""
    scenes = []
    for prim in stage.Traverse():
        if prim.IsA(UsdPhysics.Scene):
            scenes.append(str(prim.GetPath()))
    layer = stage.GetRootLayer()
    is_documented = "physics scene" in f"{layer.comment} {layer.documentation}"
    if is_documented and not scenes:
        text = "the stage is documented as one in a physics scene (physicsScene), but has no PhysicsScene."
        ledger.wrong("usd.scene", text, "physicsScene", suggestion="add the scene, with its gravity")
    if len(scenes) > 1:
        text = f"the stage has {len(scenes)} physics scenes, {', '.join(scenes)}: engines simulate in one of them."
        ledger.wrong("usd.scene", text, scenes[1], suggestion="keep one of them")


def _check_colliders(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report meshes that collide in another way than most others, or not at all."""
    forms: dict[str, tuple[str, ...]] = {}
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        form = []
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            form.append("PhysicsCollisionAPI")
        if prim.HasAPI(UsdPhysics.MeshCollisionAPI):
            form.append("PhysicsMeshCollisionAPI")
        form.append(f"approximation {prim.GetAttribute('physics:approximation').Get() or 'none'}")
        forms[str(prim.GetPath())] = tuple(form)
    for path, own_form, common_form, count in _odd(forms):
        differing = ", ".join(sorted({*own_form} ^ {*common_form}))
        text = f"the mesh {path} collides in another way than {count} others: {differing}."
        ledger.add("usd.collider", "warning", text, path, suggestion="export the stage again")


def _check_meshes(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report meshes that state other primvars than most others, no bounding box, or normals far from their faces."""
    forms: dict[str, tuple[str, ...]] = {}
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        path = str(prim.GetPath())
        primvars = UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues()
        names = [str(primvar.GetPrimvarName()) for primvar in primvars]
        forms[path] = tuple(sorted(names))
        box = UsdGeom.Mesh(prim).GetExtentAttr().Get()
        if box is None or len(box) != 2:
            text = f"the mesh {path} states no bounding box (extent) of two points."
            ledger.add("usd.extent", "warning", text, path, suggestion="write the extent of the points")
        turned = _turned_normals(UsdGeom.Mesh(prim))
        if turned:
            text = f"{turned} normals of the mesh {path} are more than {_TURNED:g} degrees from their faces."
            ledger.add("usd.normal_turned", "warning", text, path, suggestion="export the stage again")
    for path, own_form, common_form, count in _odd(forms):
        differing = ", ".join(sorted({*own_form} ^ {*common_form}))
        text = f"the mesh {path} states other primvars than {count} others: {differing}."
        ledger.add("usd.primvar", "warning", text, path, suggestion="export the stage again")


def _turned_normals(mesh: UsdGeom.Mesh) -> int:
    """Return how many normals at corners of triangles are far from the normals of these; 0 for other meshes."""
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    counts = mesh.GetFaceVertexCountsAttr().Get()
    if not primvar or primvar.GetInterpolation() != "faceVarying" or not counts or set(counts) != {3}:
        return 0
    points = np.array(mesh.GetPointsAttr().Get() or [], float)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], int)
    normals = np.array(primvar.ComputeFlattened() or [], float)
    if len(normals) != len(indices) or not len(indices) or indices.min() < 0 or indices.max() >= len(points):
        return 0  # reported by other checks
    a, b, c = points[indices.reshape(-1, 3)].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    areas = np.linalg.norm(across, axis=1)
    solid = areas > 1e-3 * areas.max(initial=0.0)  # thin triangles have inexact normals
    cosines = np.einsum("ij,ikj->ik", across / np.where(areas, areas, 1.0)[:, None], normals.reshape(-1, 3, 3))
    return int(np.count_nonzero(cosines[solid] < np.cos(np.radians(_TURNED))))


def check_primvars(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report primvars of meshes with another number of values than their interpolation needs: readers ignore them."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        needed = {
            "constant": 1,
            "uniform": len(mesh.GetFaceVertexCountsAttr().Get() or ()),
            "varying": len(mesh.GetPointsAttr().Get() or ()),
            "vertex": len(mesh.GetPointsAttr().Get() or ()),
            "faceVarying": len(mesh.GetFaceVertexIndicesAttr().Get() or ()),
        }
        for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues():
            name = str(primvar.GetPrimvarName())
            interpolation = str(primvar.GetInterpolation())
            values = primvar.Get()
            is_known = name in ("normals", "displayColor", "displayOpacity") and interpolation in needed
            if not is_known or values is None or primvar.GetElementSize() != 1:
                continue
            count = len(values)
            indices = np.arange(count)
            if primvar.IsIndexed():
                indices = np.array(primvar.GetIndices(), int)
            path = str(prim.GetPath())
            if len(indices) != needed[interpolation]:
                text = (
                    f"primvar {name} of {path} has {len(indices)} values; the interpolation '{interpolation}' needs "
                    f"{needed[interpolation]}: readers ignore it."
                )
                ledger.wrong("usd.primvar", text, path, suggestion="correct its interpolation or its values")
            elif len(indices) and (indices.min() < 0 or indices.max() >= count):
                text = f"primvar {name} of {path} has {count} values, but indices {indices.min()} .. {indices.max()}."
                ledger.wrong("usd.primvar", text, path, suggestion="correct its indices")


def _odd(forms: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any, int]]:
    """Yield (key, its form, the common form, its count) of the values that differ from most others."""
    if len(forms) < 3:  # two that differ say nothing about which of them is meant
        return
    common, count = Counter(forms.values()).most_common(1)[0]
    if count < _MOST * len(forms):
        return
    for key, form in forms.items():
        if form != common:
            yield key, form, common, count


def _check_engines(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report settings of physics engines that are not those with which the stages of this project were tested."""
    for prim in stage.Traverse():
        scene = prim.IsA(UsdPhysics.Scene)
        articulated = prim.HasAPI(UsdPhysics.ArticulationRootAPI)
        for name, tested in _TESTED.items():
            is_concerned = scene
            if name.startswith("physxArticulation"):
                is_concerned = articulated
            if not is_concerned:
                continue
            value = prim.GetAttribute(name).Get()
            if value != tested:
                text = f"{name} is {_word(value)}; the stages of this project were tested with {tested}."
                ledger.add("usd.engine", "warning", text, str(prim.GetPath()), suggestion=f"write {tested}")
        needed_schemas = set()
        if scene:
            needed_schemas = {"PhysxSceneAPI"}
        if articulated:
            needed_schemas = {"PhysxArticulationAPI", "NewtonArticulationRootAPI"}
        lacking = sorted(needed_schemas - set(map(str, prim.GetPrimTypeInfo().GetAppliedAPISchemas())))
        if lacking:
            text = f"{prim.GetPath()} does not apply {', '.join(lacking)}: the engine ignores what it states for it."
            ledger.wrong("usd.engine", text, str(prim.GetPath()), suggestion=f"apply {', '.join(lacking)}")


def _check_display_colors(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report meshes whose displayColor is not the colour of their material, or a shader that is no preview surface."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdShade.Shader) and prim.GetAttribute("info:id").Get() != "UsdPreviewSurface":
            text = f"{prim.GetPath()} is no UsdPreviewSurface: viewers show its material grey."
            ledger.wrong("usd.shader", text, str(prim.GetPath()), suggestion="write info:id UsdPreviewSurface")
        if not prim.IsA(UsdGeom.Mesh):
            continue
        displayed = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not material or not displayed or len(displayed) != 1:
            continue
        shader, *_ = material.ComputeSurfaceSource()
        color = None
        if shader and shader.GetInput("diffuseColor"):
            color = shader.GetInput("diffuseColor").Get()
        if color is not None and not Gf.IsClose(Gf.Vec3f(displayed[0]), Gf.Vec3f(color), 1e-4):
            text = f"the displayColor of {prim.GetPath()} is {_plain(displayed[0])}, its material has {_plain(color)}."
            path = str(prim.GetPath())
            ledger.add("usd.display_color", "warning", text, path, suggestion="export the stage again")


def _plain(color: Iterable[float]) -> str:
    return " ".join(map("{:.4g}".format, map(float, color)))


def _hidden_samples(stage: Usd.Stage) -> str:
    """Return the first attribute whose time samples a default of a stronger layer hides, as text; "" without one."""
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetNumTimeSamples():
                continue
            stronger = ""  # the strongest layer with a default value
            for spec in attribute.GetPropertyStack():
                file = spec.layer.GetDisplayName()
                if stronger and spec.layer.GetNumTimeSamplesForPath(spec.path):
                    return (
                        f"no link moves: {file} has time samples of {attribute.GetPath()}, but the value in "
                        f"{stronger}, a stronger layer, hides them."
                    )
                if not stronger and spec.HasDefaultValue():
                    stronger = file
    return ""


def _check_range(stage: Usd.Stage, codes: Array, ledger: Ledger) -> None:
    """Report a time range that is not that of the samples."""
    first = stage.GetStartTimeCode()
    last = stage.GetEndTimeCode()
    hidden = "" if len(codes) else _hidden_samples(stage)
    if last > first and hidden:
        advice = "list the layer of the motion above the layer of the robot in the sublayers"
        ledger.wrong("usd.range", hidden, "subLayers", suggestion=advice)
        return
    if last > first and not len(codes):
        text = (
            f"startTimeCode .. endTimeCode is {first:g} .. {last:g}, but no link has time samples: the layer of the "
            "motion is missing among the sublayers, or has none."
        )
        ledger.wrong("usd.range", text, "endTimeCode", suggestion="add the layer of the motion to the sublayers")
        return
    expected: Sequence[float] = (0.0, 0.0)
    if len(codes):
        expected = (float(codes[0]), float(codes[-1]))
    if not np.allclose((first, last), expected, rtol=0.0, atol=1e-6):
        text = (
            f"startTimeCode .. endTimeCode is {first:g} .. {last:g}; the time codes of the samples are "
            f"{expected[0]:g} .. {expected[1]:g}."
        )
        ledger.add("usd.range", "warning", text, "endTimeCode", suggestion="write the range of the samples")


def _check_undefined(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report values of prims that no layer defines, as where a motion's prim has another path than its link."""
    for prim in stage.TraverseAll():
        if prim.IsDefined() or prim.IsAbstract() or not prim.GetAuthoredProperties():
            continue
        path = str(prim.GetPath())
        names = ", ".join(sorted(prim.GetAuthoredPropertyNames())[:3])
        text = f"no layer defines the prim {path}: what is stated there ({names}) acts on nothing."
        ledger.wrong("usd.undefined", text, path, suggestion="move the values to the prim that they are meant for")
