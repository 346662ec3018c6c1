"""Run the public validators of OpenUSD."""

from __future__ import annotations

from pathlib import Path

from pxr import Tf, UsdValidation

from twin.core.findings import Finding, Severity, error, finding
from twin.usd.scan import RawStage

_SEVERITY: dict[str, Severity] = {"Error": "disagreement", "Warn": "warning", "Info": "info"}


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
