"""Check a UsdPhysics stage for faults that public validators miss, and run these validators.

    layout       units, frame rates, transform ops, names
    structure    loops, articulation root, self collision
    timeline     poses of all bodies, at rest and at every time sample
    joint_frames coincidence of the two frames of each joint, along the whole timeline
    coordinates  limits, states, drives and speeds along the whole timeline; also finds angles in radians
    bodies       masses, inertias, nesting, meshes
    samples      time range, quaternion signs, steps

The checker does not use the writer. It reads only two attributes of twin: `twin:active` (an active joint without a
drive is a finding) and `twin:base` (a missing mass of the base is only a note).
"""

from __future__ import annotations

from pathlib import Path

from pxr import Tf, UsdValidation

from twin.core.errors import StageError
from twin.core.findings import Finding, Kind, Severity, by_severity, error, finding
from twin.usd.check.bodies import check_bodies, check_meshes
from twin.usd.check.joint_frames import check_joints
from twin.usd.check.layout import check_names, check_ops, check_transforms, check_units
from twin.usd.check.samples import check_samples
from twin.usd.check.structure import check_structure
from twin.usd.check.timeline import timeline
from twin.usd.scan import RawStage

__all__ = ["check_stage", "run_usd_validators"]


_UNCHECKED = Kind("stage.unchecked", "error", "repair the transform ops first")

_SEVERITY: dict[str, Severity] = {"Error": "disagreement", "Warn": "warning", "Info": "info"}
"""Severities of the findings of public validators, by type of error."""


def check_stage(path: str | Path) -> list[Finding]:
    """Return the findings on a stage, the most severe first.

    A finding has a code "stage.<name>", the prim path in `where` and the time code in `when`. A finding on a measured
    value also has the value, the limit and their unit.

    Raises:
        StageError: the file is missing or not USD, or one of its layers cannot be found.
    """
    scene = RawStage(path)
    findings = [*check_units(scene), *check_ops(scene), *check_names(scene), *check_samples(scene)]
    try:
        findings += [
            *check_transforms(scene),
            *check_structure(scene),
            *check_joints(scene, timeline(scene)),
            *check_bodies(scene),
            *check_meshes(scene),
        ]
    except StageError as failed:  # a transform op that cannot be evaluated; check_ops has already reported it
        findings.append(_UNCHECKED(scene.path, f"{failed} Therefore poses, joints and bodies are not checked"))
    return by_severity(findings)


def run_usd_validators(path: str | Path) -> list[Finding]:
    """Run all registered UsdValidation validators and return their findings, with codes usd.<validator>.<error>.

    Raises:
        StageError: if the stage cannot be opened.
    """
    stage = RawStage(path).stage
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    try:
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
    except Tf.ErrorException as failed:  # validators fail, for example, on a transform op of a wrong type
        reason = str(failed).strip().splitlines()[-1].strip()
        return [error("usd.failed", str(path), f"the validators of OpenUSD failed: {reason}")]
    findings: list[Finding] = []
    for usd_error in errors:
        places: list[str] = []
        for site in usd_error.GetSites():
            place = site.GetProperty() or site.GetPrim()
            if place:
                places.append(str(place.GetPath()))
        kind = str(usd_error.GetType()).rpartition(".")[2]
        severity = _SEVERITY.get(kind, "disagreement")
        validator = usd_error.GetValidator().GetMetadata().name
        code = f"usd.{validator}.{usd_error.GetName()}"
        findings.append(finding(severity, code, ", ".join(places), usd_error.GetMessage()))
    return findings
