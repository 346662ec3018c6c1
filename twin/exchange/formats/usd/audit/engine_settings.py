"""Check what a stage states for physics engines: settings with which it was tested, and schemas that they need."""

from __future__ import annotations

import re
from collections.abc import Mapping

from pxr import Usd, UsdPhysics

from twin.exchange.audit.ledger import Ledger

_TESTED_SETTINGS: Mapping[str, str | bool | int] = {
    "mjc:option:integrator": "discrete",
    "physxScene:enableExternalForcesEveryIteration": True,
    "physxScene:solverType": "TGS",
    "physxScene:timeStepsPerSecond": 1000,
    "physxArticulation:solverPositionIterationCount": 128,
}
"""Settings of engines at which the stages were tested (tests/witness/test_physx.py)."""

_SCHEMA_OF_PROPERTY = (
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


def stated_text(value: object) -> str:
    """Return a value of the stage as text; "not stated" for None."""
    if value is None:
        return "not stated"
    return str(value)


def check_applied_schemas(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report prims that state properties of a schema that they do not apply: engines ignore what they state."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        # As authored: usd-core does not register the schemas of PhysX and Newton, and leaves them out elsewhere.
        applied = set(map(str, prim.GetPrimTypeInfo().GetAppliedAPISchemas()))
        lacking: dict[str, str] = {}
        for prop in prim.GetAuthoredProperties():
            name = str(prop.GetName())
            for pattern, schema in _SCHEMA_OF_PROPERTY:
                match = re.fullmatch(pattern, name)
                if match and match.expand(schema) not in applied:
                    lacking.setdefault(match.expand(schema), name)
        for schema, name in lacking.items():
            path = str(prim.GetPath())
            text = f"{path} states {name}, but does not apply {schema}: engines ignore it."
            ledger.wrong("usd.schema", text, path, suggestion=f"apply {schema}")


def check_engine_settings(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report settings of physics engines that are not those with which the stages of this project were tested."""
    for prim in stage.Traverse():
        scene = prim.IsA(UsdPhysics.Scene)
        articulated = prim.HasAPI(UsdPhysics.ArticulationRootAPI)
        for name, tested in _TESTED_SETTINGS.items():
            is_concerned = scene
            if name.startswith("physxArticulation"):
                is_concerned = articulated
            if not is_concerned:
                continue
            value = prim.GetAttribute(name).Get()
            if value != tested:
                text = f"{name} is {stated_text(value)}; the stages of this project were tested with {tested}."
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
