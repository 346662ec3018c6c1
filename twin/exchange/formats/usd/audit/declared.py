"""Check what a stage of this project declares beside mechanism and shapes: it must agree with the rest of the stage.

Other stages are only checked for what their own schemas say: they may declare anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pxr import Usd, UsdGeom, UsdPhysics

from twin.core.provenance import EARLIER
from twin.core.units import SI
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.poses import Array
from twin.exchange.formats.usd.audit.engine_settings import check_applied_schemas, check_engine_settings, stated_text
from twin.exchange.formats.usd.audit.mesh_checks import check_display_colors, check_mesh_colliders, check_meshes
from twin.exchange.formats.usd.audit.time_samples import (
    check_changing_attributes,
    check_sample_times,
    check_sampled_joints,
    check_time_range,
)

_PROVENANCE = ("PUBLISHED", "CITED", "DERIVED", "ASSUMED", *EARLIER)
"""Provenances of a parameter, with their former names."""

_SINGLE_PRECISION = 1e-5
"""Relative difference of two equal numbers that a stage stores in single precision, with about seven digits."""

_SHOWN_ROUNDING = 1e-3
"""Relative difference of a number and the one shown for it, which is rounded for people."""


def is_ours(stage: Usd.Stage) -> bool:
    """Return whether a stage is one of this project, by one of the several marks that it has."""
    root = stage.GetDefaultPrim()
    if not root:
        return False
    # Any mark will do: that another one is missing is a finding, and no reason to check less.
    if root.GetAttribute("twin:base") or root.GetCustomDataByKey("twin"):
        return True
    return any(prim.GetAttribute("twin:active") for prim in stage.Traverse())


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
    check_applied_schemas(stage, ledger)
    _check_joints(stage, ledger)
    _check_joint_ends(stage, ledger)
    _check_resets(stage, ledger)
    check_sampled_joints(stage, ledger)
    check_sample_times(stage, mechanism.links, ledger)
    check_changing_attributes(stage, ledger)
    _check_scene(stage, ledger)
    check_mesh_colliders(stage, ledger)
    check_meshes(stage, ledger)
    check_engine_settings(stage, ledger)
    check_display_colors(stage, ledger)
    check_time_range(stage, codes, ledger)
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
            f"self collisions are {stated_text(physx)} in physxArticulation:enabledSelfCollisions, and "
            f"{stated_text(newton)} in newton:selfCollisionEnabled."
        )
        ledger.wrong("usd.self_collision", text, str(root.GetPath()), suggestion="export the stage again")


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
        if abs(value - shown_value) > _SHOWN_ROUNDING * max(abs(value), abs(shown_value)):
            text = (
                f"parameter '{name}' is {value:g}, but shows {row['shown']:g} {row['unit']}, which is {shown_value:g}."
            )
            size = Measured(value, shown_value)
            ledger.wrong("usd.parameter", text, name, size=size, suggestion="export the stage again")
        if row["provenance"] not in _PROVENANCE:
            text = f"parameter '{name}' has the provenance '{row['provenance']}', expected {', '.join(_PROVENANCE)}."
            ledger.wrong("usd.parameter", text, name, suggestion="export the stage again")


_LISTED_FIELDS: Mapping[str, Callable[[FileDrive], float | None]] = {
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
        if field not in _LISTED_FIELDS or "value" not in row or not set(joints) <= drives.keys():
            continue
        expected = float(row["value"])
        for joint in joints:
            stated = _LISTED_FIELDS[field](drives[joint])
            if stated is None or abs(float(stated) - expected) > _SINGLE_PRECISION * max(1e-3, abs(expected)):
                number_text = "not stated"
                if stated is not None:
                    number_text = f"{float(stated):.6g}"
                text = (
                    f"joint '{joint}': {field} is {number_text}, but {expected:.6g} in the parameter '{name}' of the "
                    "stage."
                )
                ledger.wrong("usd.listed", text, joint, suggestion="export the stage again")


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
        if abs(position - newton) > _SINGLE_PRECISION * max(1.0, abs(position)):
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


def _check_joint_ends(stage: Usd.Stage, ledger: Ledger) -> None:
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


def _check_undefined(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report values of prims that no layer defines, as where a motion's prim has another path than its link."""
    for prim in stage.TraverseAll():
        if prim.IsDefined() or prim.IsAbstract() or not prim.GetAuthoredProperties():
            continue
        path = str(prim.GetPath())
        names = ", ".join(sorted(prim.GetAuthoredPropertyNames())[:3])
        text = f"no layer defines the prim {path}: what is stated there ({names}) acts on nothing."
        ledger.wrong("usd.undefined", text, path, suggestion="move the values to the prim that they are meant for")
