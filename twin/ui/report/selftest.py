"""Add the score of the validator, as measured by `twin selftest` on the same robot, to a report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from twin.validation.result import Report

HEADING = "self-test of the validator on this robot"


def with_selftest(report: Report, path: Path) -> Report:
    """Return the report with the score from a file `selftest.json`.

    Args:
        report: the report.
        path: the file. If the file is missing or malformed, or if its score belongs to another robot or to other input
            files, the report is returned unchanged.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        same = (data["robot"], data["source"]) == (report.robot, report.environment.get("input"))
        facts = _facts(data)
    except (OSError, ValueError, KeyError, TypeError):
        return report
    if not same:
        return report
    return replace(report, facts={**report.facts, HEADING: facts})


def _facts(data: dict[str, Any]) -> dict[str, str]:
    alarms = len(data["false_alarms"])
    out = {
        "seeded faults found": f"{data['caught']} of {data['counted']} ({100 * data['share']:.1f} %; required "
        f"{100 * data['bar']:.0f} %), {alarms} false alarms on the correct robot"
    }
    for f in data["families"]:
        counted = f["seeded"] - f["equivalent"]
        by = ", ".join(list(f["by"])[:3])
        out[f"{f['family']}: {f['meaning']}"] = f"{f['caught'] + f['warned']} of {counted}" + (
            f", by {by}" if by else ""
        )
    missed = [f"{o['family']}: {o['what']}" for o in data["faults"] if o["state"] == "missed"]
    if missed:
        out["missed"] = "; ".join(missed)
    out["command"] = f"twin selftest {data['robot']} --seed {data['seed']} --count {len(data['faults'])}"
    return out
