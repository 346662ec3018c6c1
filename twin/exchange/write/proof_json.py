"""Write proof.json, the record of an export: its sources and files with their hashes, and the results of all checks.

Proofs by `twin prove` are in the package `proof`.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from twin.core.findings import Finding, Kind, verdict
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.quantity import Quantity
from twin.core.version import __version__
from twin.exchange.write.clip import Clip, ClipAccuracy, InterpolationErrors
from twin.exchange.write.model_hash import model_hash
from twin.exchange.write.order import Order

PROOF = "proof.json"

_BUDGET_EXCEEDED = Kind(
    "export.budget",
    "disagreement",
    "the highest key rate is already used: use a larger --budget-um, or make the protocol slower",
    word="budget",
)


def budget_checks(order: Order) -> tuple[list[JsonObject], list[Finding]]:
    """Return a check for each error budget of each clip, and a finding for each budget that is exceeded."""
    rows = []
    findings = []
    for clip in order.clips:
        errors = clip.between
        position = rotation = joint_gap = None
        if clip.budget is not None:
            position = clip.budget.position
            rotation = clip.budget.rotation
            joint_gap = clip.budget.joint_gap
        for name, worst, (where, when), unit, limit in (
            ("any point of a link, between keys", errors.position, errors.position_at, "m", position),
            ("rotation of a link, between keys", errors.rotation, errors.rotation_at, "rad", rotation),
            ("gap of a joint, between keys", errors.joint_gap, errors.joint_gap_at, "m", joint_gap),
        ):
            time = f"t = {when:.3f} s"
            is_within_budget = limit is None or worst <= limit
            tolerance: float | None = None
            if limit is not None:
                tolerance = _six_digits(limit)
            row = {
                "check": name,
                "file": f"clip {clip.name}",
                "tool": "twin.exchange.write",
                "version": __version__,
                "worst": _six_digits(worst),
                "unit": unit,
                "tolerance": tolerance,
                "verdict": "agree" if is_within_budget else "disagree",
                "where": where,
                "when": time if where else "",
            }
            rows.append(row)
            if limit is not None and not is_within_budget:
                text = f"{clip.name}: {name} at {clip.rate:g} Hz"
                findings.append(_BUDGET_EXCEEDED(where, text, Quantity(worst, unit), limit, when=time))
    return rows, findings


def proof_content(
    order: Order, work: Path, files: Sequence[Path], checks: Sequence[JsonObject], findings: Sequence[Finding]
) -> JsonObject:
    """Return the content of proof.json, which does not depend on the date: sources and results of all checks."""
    inputs = []
    for name, sha in order.inputs:
        inputs.append({"file": name, "sha256": sha})
    file_entries = []
    for file in files:
        data = (work / file).read_bytes()
        sha = hashlib.sha256(data).hexdigest()
        file_entries.append({"file": file.as_posix(), "sha256": sha, "bytes": len(data)})
    return {
        "schema": "twin-proof",
        "version": 1,
        "robot": order.mechanism.name,
        "model_hash": model_hash(order.mechanism),
        "made_by": f"twin {__version__}",
        "inputs": inputs,
        "files": file_entries,
        "clips": list(map(_proof_of_clip, order.clips)),
        "checks": list(map(_shortened, checks)),
        "findings": list(map(Finding.as_dict, findings)),
        "verdict": verdict(findings),
    }


def _proof_of_clip(clip: Clip) -> JsonObject:
    entry = {
        "protocol": clip.name,
        "rate": clip.rate,
        "keys": len(clip.times),
        "duration_s": round(float(clip.times[-1]), 9),
    }
    entry |= _error_entries("between_", "", clip.between)
    if clip.budget is not None:
        entry |= _error_entries("budget_", "budget_", clip.budget)
    return entry


def _shortened(check: JsonMapping) -> JsonObject:
    """Return a check with its numbers rounded."""
    shortened = dict(check)
    for key, value in check.items():
        if isinstance(value, float):
            shortened[key] = _six_digits(value)
    return shortened


def _error_entries(begin: str, begin_gap: str, errors: InterpolationErrors | ClipAccuracy) -> dict[str, float]:
    return {
        f"{begin}position_m": _six_digits(errors.position),
        f"{begin}rotation_rad": _six_digits(errors.rotation),
        f"{begin_gap}joint_gap_m": _six_digits(errors.joint_gap),
    }


def json_lines(proof: JsonMapping) -> str:
    """Return JSON text with one line for each entry and each list element, so that `diff` can compare versions."""
    entries = []
    for key, value in proof.items():
        content = _json(value)
        if isinstance(value, list) and value:
            rows = ",\n".join(map(_json, value))
            content = f"[\n{rows}\n]"
        entries.append(f"{json.dumps(key)}: {content}")
    return "{\n" + ",\n".join(entries) + "\n}\n"


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _six_digits(value: float) -> float:
    """Return a number rounded to six digits, so that the file does not depend on the processor."""
    return float(f"{value:.6g}")


def written_before(folder: Path) -> list[str]:
    """Return the files of an earlier export that are unchanged: their hashes are equal to the hashes in proof.json."""
    unchanged = []
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        proof = json.loads((folder / PROOF).read_text(encoding="utf-8"))
        if proof["schema"] == "twin-proof":
            for row in proof["files"]:
                name = str(row["file"])
                if _is_unchanged(folder, name, str(row["sha256"])):
                    unchanged.append(name)
            return unchanged
    return []  # also if one of the files cannot be read: then no file is removed


def _is_unchanged(folder: Path, name: str, sha: str) -> bool:
    relative = Path(name)
    if relative.is_absolute() or ".." in relative.parts:
        return False
    path = folder / name
    # A link in the folder may lead out of it; such a file is not one of the export.
    if not path.resolve().is_relative_to(folder.resolve()) or not path.is_file():
        return False
    return hashlib.sha256(path.read_bytes()).hexdigest() == sha
