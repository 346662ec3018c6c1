"""Run the public validators of OpenUSD."""

from __future__ import annotations

from pathlib import Path

from pxr import Tf, UsdValidation

from twin.core.findings import Finding, Severity, error, finding
from twin.usd.scan import Scene

_SEVERITY: dict[str, Severity] = {"Error": "disagreement", "Warn": "warning", "Info": "info"}


def run_usd_validators(path: str | Path) -> list[Finding]:
    """Run all registered UsdValidation validators and return their findings, with codes usd.<validator>.<error>.

    Raises:
        StageError: if the stage cannot be opened.
    """
    stage = Scene(path).stage
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    out = []
    try:
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
    except Tf.ErrorException as failed:  # validators fail, for example, on a transform op of a wrong type
        return [
            error(
                "usd.failed",
                str(path),
                f"the validators of OpenUSD failed: {str(failed).strip().splitlines()[-1].strip()}",
            )
        ]
    for found in errors:
        sites = [s.GetProperty() or s.GetPrim() for s in found.GetSites()]
        places = [str(s.GetPath()) for s in sites if s]
        out.append(
            finding(
                _SEVERITY.get(str(found.GetType()).rpartition(".")[2], "disagreement"),
                f"usd.{found.GetValidator().GetMetadata().name}.{found.GetName()}",
                ", ".join(places),
                found.GetMessage(),
            )
        )
    return out
