"""Read any UsdPhysics stage with `twin.usd.read`, and report data that a mechanism cannot hold."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core.errors import SourceError, TwinError, UnsupportedError
from twin.core.findings import Finding
from twin.core.foreign.admit import admit
from twin.exchange.read.imported_robot import (
    Findings,
    Imported,
    Options,
    possible_inertia,
    stated_gravity,
    with_tool_frame,
)

if TYPE_CHECKING:
    from pxr import Usd

_READ_SCHEMAS = (
    "PhysicsRigidBodyAPI",
    "PhysicsMassAPI",
    "PhysicsArticulationRootAPI",
    "PhysicsCollisionAPI",
    "PhysicsMeshCollisionAPI",
    "PhysicsDriveAPI",
    "PhysicsLimitAPI",
    "PhysicsJointStateAPI",
    "MaterialBindingAPI",
    "GeomModelAPI",
    "PhysxJointAPI",  # its maximum speed is read; friction and armature are reported as properties
)
"""Applied API schemas that the reader reads."""

_UNREAD_PROPERTY_WORDS = (
    *("friction", "armature", "breakforce", "breaktorque"),
    *("damping", "stiffness", "solver", "actuator"),
)
"""Words that identify unsupported joint properties; each such property has one of these words in its name."""


def read_usd(path: Path, root: str | None) -> Imported:
    """Read a stage. A tool frame is added if the stage has none.

    If no joint of the stage has a drive, all tree joints with one coordinate become driven joints. `root` is the
    prim path of the robot. None selects the only robot of the stage.

    Raises:
        SourceError: the stage has unsupported data, and the mechanism would be wrong if the data were ignored.
        TwinError: the stage is invalid.
    """
    from twin.usd.read import inspect_stage

    try:
        mechanism, findings = inspect_stage(path, root)
    except TwinError as error:
        if str(path) in str(error):
            raise
        raise SourceError(f"{path}: {error}") from error
    findings = Findings(map(_as_import, findings))
    bodies = []
    for body in mechanism.bodies:
        if body.inertia is not None:
            body = replace(body, inertia=possible_inertia(body.inertia, body.name, findings))
        bodies.append(body)
    gravity = stated_gravity(np.array(mechanism.gravity), findings)
    mechanism = replace(mechanism, bodies=tuple(bodies), gravity=gravity)
    for joint in mechanism.joints:
        if joint.type == "free" and joint.parent == mechanism.base:
            text = f"no joint fixes body '{joint.child}' to the world: the robot floats, by joint '{joint.name}'."
            findings.warn("free", text, joint.child)
    coupled: set[str] = set()
    for coupling in mechanism.couplings:
        coupled.update(coupling.joints)
    findings += _left_out(path, root, coupled)
    if not mechanism.active:
        moving = {joint.name for joint in mechanism.tree if len(joint.free_axes) == 1}
        joints = tuple(replace(joint, active=joint.name in moving) for joint in mechanism.joints)
        mechanism = replace(mechanism, joints=joints, postures={})
        text = f"no joint has a drive: all joints of the tree are driven, {', '.join(sorted(moving))}."
        findings.warn("driven", text, mechanism.base)
    return Imported(with_tool_frame(mechanism, findings), findings)


def _as_import(finding: Finding) -> Finding:
    """Return a finding of the reader; a shape that cannot be shown is no reason to refuse a stage."""
    if finding.code == "stage.read.shape":
        return replace(finding, severity="warning")
    return finding


def _left_out(path: Path, root: str | None, coupled: Container[str]) -> list[Finding]:
    """Return warnings of the data of a stage that are not imported; `coupled` are the joints of imported couplings.

    Raises:
        SourceError: a joint is coupled to another by a schema that is not supported.
    """
    from pxr import Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    top = stage.GetPrimAtPath(root) if root else stage.GetPseudoRoot()
    findings = Findings()
    for prim in Usd.PrimRange(top, Usd.TraverseInstanceProxies()):
        where = str(prim.GetPath())
        kind = str(prim.GetTypeName())
        is_joint = prim.IsA(UsdPhysics.Joint)
        is_body = prim.HasAPI(UsdPhysics.RigidBodyAPI)
        for schema in map(str, prim.GetPrimTypeInfo().GetAppliedAPISchemas()):
            name = schema.split(":")[0]  # the part after the colon is the instance name
            if name in _READ_SCHEMAS:
                continue
            # Couplings of our own stages are read from customData.
            if is_joint and "mimic" in name.lower() and prim.GetName() not in coupled:
                raise UnsupportedError(
                    f"{path}: joint {where} is coupled to another joint by {schema}: couplings of other vendors are "
                    "not supported. "
                    "Remove the schema, and write the [[coupling]] into the new folder."
                )
            if is_body or is_joint:
                findings.warn("schema", f"{where}: {schema} is not read.", where)
        if is_body and prim.HasAPI(UsdPhysics.MassAPI):
            mass = UsdPhysics.MassAPI(prim)
            kilograms = mass.GetMassAttr().Get()
            moments = mass.GetDiagonalInertiaAttr().Get()
            if kilograms and not any(moments or ()):
                text = f"{where}: the mass of {kilograms:g} kg is not imported: the stage does not state the inertia."
                findings.warn("inertia", text, where)
        if is_joint:
            names = [attribute.GetName() for attribute in prim.GetAttributes() if _is_left_out(attribute)]
            if names:
                findings.warn("friction", f"joint {where}: {', '.join(names)} are not imported.", where)
        elif prim.IsA(UsdGeom.Gprim) and not prim.IsA(UsdGeom.Mesh) and prim.IsA(UsdGeom.PointBased):
            findings.warn("shape", f"{where}: a {kind} is not shown.", where)
        elif "Tendon" in kind:
            findings.warn("tendon", f"{where}: a {kind} is not imported.", where)
    return findings


def _is_left_out(attribute: Usd.Attribute) -> bool:
    """Return whether an attribute of a joint is an unsupported property with a value other than zero or infinity."""
    if not attribute.HasAuthoredValue():
        return False
    name = attribute.GetName()
    if name.startswith(("drive:", "state:")):
        return False
    if not any(word in name.lower() for word in _UNREAD_PROPERTY_WORDS):
        return False
    return attribute.Get() not in (None, 0, 0.0, False, float("inf"))


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a stage; see `read_usd`."""
    if options.guarded:
        admit(path)
    return read_usd(path, options.root)
