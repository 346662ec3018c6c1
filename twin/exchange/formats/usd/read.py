"""Read any UsdPhysics stage with `twin.usd.read`, and report data that a mechanism cannot hold."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.errors import SourceError, TwinError
from twin.core.findings import Finding
from twin.core.foreign.admit import admit
from twin.exchange.read.source import Findings, Imported, Options, possible, stated_gravity, tooled

_READ = (
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

_WITHOUT = ("friction", "armature", "breakforce", "breaktorque", "damping", "stiffness", "solver", "actuator")
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
    findings = Findings(replace(f, severity="warning") if f.code == "stage.read.shape" else f for f in findings)
    bodies = (replace(b, inertia=b.inertia and possible(b.inertia, b.name, findings)) for b in mechanism.bodies)
    mechanism = replace(mechanism, bodies=tuple(bodies), gravity=stated_gravity(np.array(mechanism.gravity), findings))
    for joint in mechanism.joints:
        if joint.type == "free" and joint.parent == mechanism.base:
            text = f"no joint fixes body '{joint.child}' to the world: the robot floats, by joint '{joint.name}'."
            findings.warn("free", text, joint.child)
    findings += _left_out(path, root, {n for c in mechanism.couplings for n in c.joints})
    if not mechanism.active:
        moving = {j.name for j in mechanism.tree if len(j.free_axes) == 1}
        joints = tuple(replace(j, active=j.name in moving) for j in mechanism.joints)
        mechanism = replace(mechanism, joints=joints, postures={})
        text = f"no joint has a drive: all joints of the tree are driven, {', '.join(sorted(moving))}."
        findings.warn("driven", text, mechanism.base)
    return Imported(tooled(mechanism, findings), findings)


def _left_out(path: Path, root: str | None, coupled: Container[str]) -> list[Finding]:
    from pxr import Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    top = stage.GetPrimAtPath(root) if root else stage.GetPseudoRoot()
    found = Findings()
    for prim in Usd.PrimRange(top, Usd.TraverseInstanceProxies()):
        where = str(prim.GetPath())
        strange = [str(s) for s in prim.GetPrimTypeInfo().GetAppliedAPISchemas() if str(s).split(":")[0] not in _READ]
        joint = prim.IsA(UsdPhysics.Joint)
        for schema in strange:
            # The part after the colon is the instance name. Couplings of our own stages are read from customData.
            if joint and "mimic" in schema.split(":")[0].lower() and prim.GetName() not in coupled:
                raise SourceError(
                    f"{path}: joint {where} is coupled to another joint by {schema}: couplings of other vendors are "
                    "not supported. "
                    "Remove the schema, and write the [[coupling]] into the new folder."
                )
            if prim.HasAPI(UsdPhysics.RigidBodyAPI) or joint:
                found.warn("schema", f"{where}: {schema} is not read.", where)
        if prim.HasAPI(UsdPhysics.RigidBodyAPI) and prim.HasAPI(UsdPhysics.MassAPI):
            mass = UsdPhysics.MassAPI(prim)
            kilograms, tensor = mass.GetMassAttr().Get(), mass.GetDiagonalInertiaAttr().Get()
            if kilograms and not any(tensor or ()):
                text = f"{where}: the mass of {kilograms:g} kg is not imported: the stage does not state the inertia."
                found.warn("inertia", text, where)
        if joint:
            names = [a.GetName() for a in prim.GetAttributes() if a.HasAuthoredValue()]
            names = [
                n for n in names if not n.startswith(("drive:", "state:")) and any(w in n.lower() for w in _WITHOUT)
            ]
            if names := [n for n in names if _is_set(prim.GetAttribute(n))]:
                found.warn("friction", f"joint {where}: {', '.join(names)} are not imported.", where)
        elif prim.IsA(UsdGeom.Gprim) and not prim.IsA(UsdGeom.Mesh) and prim.IsA(UsdGeom.PointBased):
            found.warn("shape", f"{where}: a {prim.GetTypeName()} is not shown.", where)
        elif prim.GetTypeName() in ("PhysicsTendon", "PhysxTendon") or "Tendon" in str(prim.GetTypeName()):
            found.warn("tendon", f"{where}: a {prim.GetTypeName()} is not imported.", where)
    return found


def _is_set(attribute: Any) -> bool:
    """Return whether an attribute has a value other than zero or infinity."""
    value = attribute.Get()
    return value not in (None, 0, 0.0, False, float("inf"))


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a stage; see `read_usd`."""
    if options.guarded:
        admit(path)
    return read_usd(path, options.root)
