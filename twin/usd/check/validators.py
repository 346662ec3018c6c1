"""The public validators that come with OpenUSD, and its own physics parser as a second count."""

from __future__ import annotations

from pathlib import Path

from pxr import Tf, UsdPhysics, UsdValidation

from twin.core.findings import Finding, Severity
from twin.usd.scan import Scene

_SEVERITY: dict[str, Severity] = {"Error": "disagreement", "Warn": "warning", "Info": "info"}


def run_usd_validators(path: str | Path) -> list[Finding]:
    """Return what all registered UsdValidation validators find; the code is usd.<validator>.<error>.

    Raises:
        StageError: if the stage cannot be opened.

    """
    stage = Scene(path).stage
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    out = []
    try:
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
    except Tf.ErrorException as error:  # a transform op of a wrong type, for one, makes them give up
        text = f"the validators of OpenUSD give up: {str(error).strip().splitlines()[-1].strip()}"
        return [Finding("usd.failed", "error", text, where=str(path))]
    for error in errors:
        sites = [s.GetProperty() or s.GetPrim() for s in error.GetSites()]
        places = [str(s.GetPath()) for s in sites if s]
        out.append(
            Finding(
                f"usd.{error.GetValidator().GetMetadata().name}.{error.GetName()}",
                _SEVERITY.get(str(error.GetType()).rpartition(".")[2], "disagreement"),
                error.GetMessage(),
                where=", ".join(places),
            )
        )
    return out


def parse_with_usdphysics(path: str | Path) -> dict[str, list[str]]:
    """Return prim paths by kind of object, as the physics parser of OpenUSD itself finds them.

    Kinds are those of `UsdPhysics.ObjectType` (RigidBody, Articulation, RevoluteJoint, D6Joint, ...): an
    independent count beside `Scene`.

    Raises:
        StageError: if the stage cannot be opened.

    """
    stage = Scene(path).stage
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/"])
    return {str(kind).rpartition(".")[2]: [str(p) for p in paths] for kind, (paths, _) in found.items()}
