"""Run the stage checker and OpenUSD's validators on a USD file, and add their findings to the audit."""

from __future__ import annotations

from pathlib import Path

from pxr import Usd, UsdGeom, UsdPhysics

from twin.core.errors import StageError
from twin.core.findings import Finding
from twin.exchange.audit.ledger import Ledger, Measured
from twin.usd.check import check_stage, run_usd_validators
from twin.usd.check.bodies import check_meshes
from twin.usd.check.layout import check_names, check_ops, check_transforms, check_units
from twin.usd.check.samples import check_samples
from twin.usd.scan import RawStage


def check_usd(path: Path, physics: bool, ledger: Ledger) -> None:
    """Report faults of a stage. If `physics` is False (the stage has no rigid bodies), run only general checks."""
    try:
        if physics:
            stage_findings = check_stage(path)
        else:
            stage_findings = _general_findings(path)
        public_findings = run_usd_validators(path)
    except StageError as error:
        ledger.add("usd.unreadable", "error", f"{error}.")
        return
    applicable = [finding for finding in stage_findings if _applies(finding, physics)]
    for finding in applicable:
        text = finding.message
        if not text.endswith("."):
            text += "."
        _add(ledger, finding, text)
    for finding in public_findings:
        _add(ledger, finding, finding.message)
    faults = [finding for finding in applicable if finding.severity != "info" and not _is_choice(finding)]
    ledger.row("stage checks", float(len(faults)), "found", 0.0)
    public_faults = [finding for finding in public_findings if finding.severity != "info"]
    # The other checks of the file are by the reader, whose name the ledger has.
    reader = (ledger.tool, ledger.version)
    ledger.tool = "UsdValidation"
    ledger.version = version()
    ledger.row("public validators", float(len(public_faults)), "found", 0.0)
    ledger.tool, ledger.version = reader
    if path.suffix.lower() == ".usdz":
        _check_quick_look(path, ledger)


def _add(ledger: Ledger, finding: Finding, text: str) -> None:
    severity = finding.severity
    if _is_choice(finding):
        severity = "info"
    size = Measured(finding.size, finding.limit, finding.unit)
    ledger.add(finding.code, severity, text, finding.where, size=size, when=finding.when, suggestion=finding.suggestion)


def version() -> str:
    """Return the version of OpenUSD as the Python package usd-core states it, such as 26.11."""
    _, *numbers = Usd.GetVersion()  # the first number is always 0
    return ".".join(map(str, numbers))


def _general_findings(path: Path) -> list[Finding]:
    """Return the findings of the checks that apply to stages without rigid bodies."""
    scene = RawStage(path)
    findings = [*check_units(scene), *check_ops(scene), *check_names(scene), *check_samples(scene)]
    return [*findings, *check_transforms(scene), *check_meshes(scene)]


def _applies(finding: Finding, physics: bool) -> bool:
    """Return whether a finding applies to the stage.

    If the stage has no physics, findings about units of mass and warnings about the up axis do not apply: the up axis
    may be y, as AR Quick Look requires.
    """
    if physics:
        return True
    if finding.code == "stage.up_axis":
        return finding.severity != "warning"
    return finding.code != "stage.kilograms_per_unit"


def _is_choice(finding: Finding) -> bool:
    """Return whether the author may have intended the reported value; the finding then becomes a note."""
    if finding.code in ("stage.up_axis", "stage.meters_per_unit"):
        return finding.severity == "warning"  # a missing value has the severity "disagreement"
    return finding.code == "stage.empty"


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
        where = str(prim.GetPath())
        kind = str(prim.GetTypeName())
        if prim.IsA(UsdPhysics.Joint) or prim.HasAPI(UsdPhysics.RigidBodyAPI):
            text = f"{where} is a physics prim, which AR Quick Look and its checker reject."
            ledger.add("usd.ar_physics", "warning", text, where, suggestion="remove physics from the .usdz")
            return  # one finding is enough, because a robot has many such prims
        if kind not in _AR_TYPES and not kind.startswith("RealityKit"):
            text = f"{where} is a {kind}, which AR Quick Look does not support."
            ledger.add("usd.ar_type", "warning", text, where, suggestion="remove the prim from the .usdz")
            return
