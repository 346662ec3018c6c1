"""Find what a stage declares beside all that other checks and comparisons of an audit read."""

from __future__ import annotations

import re
from typing import Any

from pxr import Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

_READ_ATTRIBUTES = re.compile(
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

_READ_RELATIONSHIPS = re.compile(r"physics:body[01]|material:binding|physxMimicJoint:.*:referenceJoint|proxyPrim")
"""Relationships that other checks and comparisons read."""

_LONGEST_VALUE = 60
"""Number of letters of a value that a finding shows."""

_LOOK_SCHEMAS = (UsdGeom.Gprim, UsdGeom.Subset, UsdShade.Material, UsdShade.Shader)
"""Prims whose further declarations act on contacts or on the look."""


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
        if any(map(prim.IsA, _LOOK_SCHEMAS)):
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
    return _READ_ATTRIBUTES.fullmatch(name) is not None


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
