"""What the stage checker and OpenUSD's own validators say of a stage, passed on for every kind of USD file."""

from __future__ import annotations

from pathlib import Path

from pxr import Usd, UsdGeom, UsdPhysics

from twin.core.errors import StageError
from twin.core.findings import Finding
from twin.exchange.audit.report import Ledger
from twin.usd.check import check_stage, run_usd_validators
from twin.usd.check.bodies import check_meshes
from twin.usd.check.layout import check_names, check_ops, check_transforms, check_units
from twin.usd.check.samples import check_samples
from twin.usd.scan import Scene


def check_usd(path: Path, physics: bool, ledger: Ledger) -> None:
    """Note what is wrong with a stage, with or without rigid bodies."""
    try:
        found = check_stage(path) if physics else _bare(path)
        public = run_usd_validators(path)
    except StageError as error:
        ledger.add("usd.unreadable", "error", f"{error}.")
        return
    archive = path.suffix.lower() == ".usdz"
    kept = [f for f in found if _counts(f, physics)]
    for f in [*kept, *public]:
        ledger.add(
            f.code,
            "info" if _is_choice(f, physics) else f.severity,
            f.message,
            where=f.where,
            when=f.when,
            size=f.size,
            unit=f.unit,
            limit=f.limit,
            suggestion=f.suggestion,
        )
    grave = [f for f in kept if f.severity != "info" and not _is_choice(f, physics)]
    ledger.row("stage checks", float(len(grave)), "found", 0.0)
    public = [f for f in public if f.severity != "info"]
    own, ledger.tool, ledger.version = (ledger.tool, ledger.version), "UsdValidation", version()
    ledger.row("public validators", float(len(public)), "found", 0.0)
    ledger.tool, ledger.version = own
    if archive:
        _check_quick_look(path, ledger)


def version() -> str:
    """Return the version of OpenUSD as its wheel names it, like 26.11."""
    return ".".join(str(n) for n in Usd.GetVersion()[1:])


def _bare(path: Path) -> list[Finding]:
    """Return findings on a stage without rigid bodies: what holds for any stage."""
    scene = Scene(path)
    found = [*check_units(scene), *check_ops(scene), *check_names(scene), *check_samples(scene)]
    return [*found, *check_transforms(scene), *check_meshes(scene)]


def _counts(f: Finding, physics: bool) -> bool:
    """Without physics neither kilograms nor a lack of bodies matters, and y up is what Quick Look wants."""
    plain = f.code == "stage.kilograms_per_unit" or (f.code == "stage.up_axis" and f.severity == "warning")
    return physics or not plain


def _is_choice(f: Finding, physics: bool) -> bool:
    """Whether a finding is legal in a file for other uses than twin's: said, but not held against it."""
    authored = f.severity == "warning"  # what is not authored at all is a disagreement
    return f.code == "stage.empty" or (f.code in ("stage.up_axis", "stage.meters_per_unit") and authored)


_AR_TYPES = {
    *("", "Xform", "Scope", "Camera", "Mesh", "GeomSubset", "Points", "Sphere", "Cube", "Cylinder", "Cone", "Capsule"),
    *("Material", "Shader", "SkelRoot", "Skeleton", "SkelAnimation", "BlendShape", "SpatialAudio", "PhysicsScene"),
    *("Preliminary_ReferenceImage", "Preliminary_Text", "Preliminary_Trigger"),
}
"""Types of prims that AR Quick Look knows, by the ARKit rules of OpenUSD 26.5; those of RealityKit come to it."""


def _check_quick_look(path: Path, ledger: Ledger) -> None:
    """Note what AR Quick Look refuses: z up, physics, lights and other prims it does not know."""
    stage = Usd.Stage.Open(str(path))
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.y:
        text = "AR Quick Look wants y up: this robot lies on its side there."
        ledger.add("usd.ar_up_axis", "warning", text, suggestion="turn the root prim, and say upAxis Y")
    for prim in stage.Traverse():
        where, kind = str(prim.GetPath()), str(prim.GetTypeName())
        if prim.IsA(UsdPhysics.Joint) or prim.HasAPI(UsdPhysics.RigidBodyAPI):
            text = f"{where} is physics, which AR Quick Look and its checker refuse."
            ledger.add("usd.ar_physics", "warning", text, where=where, suggestion="leave physics out of a .usdz")
            return
        if kind not in _AR_TYPES and not kind.startswith("RealityKit"):
            text = f"{where} is a {kind}, which AR Quick Look does not know."
            ledger.add("usd.ar_type", "warning", text, where=where, suggestion="leave it out of a .usdz")
            return
