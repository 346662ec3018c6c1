"""Run the stage checker and OpenUSD's validators on a USD file, and add their findings to the audit."""

from __future__ import annotations

from pathlib import Path

from pxr import Usd, UsdGeom, UsdPhysics

from twin.core.errors import StageError
from twin.core.findings import Finding
from twin.exchange.audit.report import Ledger, Measured
from twin.usd.check import check_stage, run_usd_validators
from twin.usd.check.bodies import check_meshes
from twin.usd.check.layout import check_names, check_ops, check_transforms, check_units
from twin.usd.check.samples import check_samples
from twin.usd.scan import RawStage


def check_usd(path: Path, physics: bool, ledger: Ledger) -> None:
    """Report faults of a stage. If `physics` is False (the stage has no rigid bodies), run only general checks."""
    try:
        found = check_stage(path) if physics else _bare(path)
        public = run_usd_validators(path)
    except StageError as error:
        ledger.add("usd.unreadable", "error", f"{error}.")
        return
    archive = path.suffix.lower() == ".usdz"
    kept = [f for f in found if _counts(f, physics)]
    for f in [*kept, *public]:
        text = f.message if f in public or f.message.endswith(".") else f"{f.message}."
        ledger.add(
            f.code,
            "info" if _is_choice(f) else f.severity,
            text,
            f.where,
            size=Measured(f.size, f.limit, f.unit),
            when=f.when,
            suggestion=f.suggestion,
        )
    grave = [f for f in kept if f.severity != "info" and not _is_choice(f)]
    ledger.row("stage checks", float(len(grave)), "found", 0.0)
    public = [f for f in public if f.severity != "info"]
    own, ledger.tool, ledger.version = (ledger.tool, ledger.version), "UsdValidation", version()
    ledger.row("public validators", float(len(public)), "found", 0.0)
    ledger.tool, ledger.version = own
    if archive:
        _check_quick_look(path, ledger)


def version() -> str:
    """Return the version of OpenUSD as the Python package usd-core states it, such as 26.11."""
    return ".".join(str(n) for n in Usd.GetVersion()[1:])


def _bare(path: Path) -> list[Finding]:
    """Return the findings of the checks that apply to stages without rigid bodies."""
    scene = RawStage(path)
    found = [*check_units(scene), *check_ops(scene), *check_names(scene), *check_samples(scene)]
    return [*found, *check_transforms(scene), *check_meshes(scene)]


def _counts(f: Finding, physics: bool) -> bool:
    """Return whether a finding applies to the stage.

    If the stage has no physics, findings about units of mass and warnings about the up axis do not apply: the up axis
    may be y, as AR Quick Look requires.
    """
    plain = f.code == "stage.kilograms_per_unit" or (f.code == "stage.up_axis" and f.severity == "warning")
    return physics or not plain


def _is_choice(f: Finding) -> bool:
    """Return whether the author may have intended the reported value; the finding then becomes a note."""
    authored = f.severity == "warning"  # a missing value has the severity "disagreement"
    return f.code == "stage.empty" or (f.code in ("stage.up_axis", "stage.meters_per_unit") and authored)


_AR_TYPES = {
    *("", "Xform", "Scope", "Camera", "Mesh", "GeomSubset", "Points", "Sphere", "Cube", "Cylinder", "Cone", "Capsule"),
    *("Material", "Shader", "SkelRoot", "Skeleton", "SkelAnimation", "BlendShape", "SpatialAudio", "PhysicsScene"),
    *("Preliminary_ReferenceImage", "Preliminary_Text", "Preliminary_Trigger"),
}
"""Prim types that AR Quick Look supports (ARKit rules of OpenUSD 26.5), in addition to the prim types of RealityKit."""


def _check_quick_look(path: Path, ledger: Ledger) -> None:
    """Report content that AR Quick Look rejects: z up, physics, lights and other unsupported prims."""
    stage = Usd.Stage.Open(str(path))
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.y:
        text = "AR Quick Look expects y up and shows this robot rotated by 90 degrees."
        ledger.add("usd.ar_up_axis", "warning", text, suggestion="rotate the root prim, and author upAxis Y")
    for prim in stage.Traverse():
        where, kind = str(prim.GetPath()), str(prim.GetTypeName())
        if prim.IsA(UsdPhysics.Joint) or prim.HasAPI(UsdPhysics.RigidBodyAPI):
            text = f"{where} is a physics prim, which AR Quick Look and its checker reject."
            ledger.add("usd.ar_physics", "warning", text, where, suggestion="remove physics from the .usdz")
            return
        if kind not in _AR_TYPES and not kind.startswith("RealityKit"):
            text = f"{where} is a {kind}, which AR Quick Look does not support."
            ledger.add("usd.ar_type", "warning", text, where, suggestion="remove the prim from the .usdz")
            return
