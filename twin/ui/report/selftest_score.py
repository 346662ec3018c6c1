"""Add the score of the validator, as measured by `twin selftest` on the same robot, to a report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from twin.core.json_types import JsonObject
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
        same = data["robot"] == report.robot and data["source"] == report.environment.get("input")
        facts = _facts(data)
    except (OSError, ValueError, KeyError, TypeError):
        return report
    if not same:
        return report
    return replace(report, facts={**report.facts, HEADING: facts})


def _facts(data: JsonObject) -> dict[str, str]:
    share = 100 * data["share"]
    required = 100 * data["bar"]
    alarms = len(data["false_alarms"])
    score = f"{data['caught']} of {data['counted']} ({share:.1f} %; required {required:.0f} %)"
    facts = {"seeded faults found": f"{score}, {alarms} false alarms on the correct robot"}
    for family in data["families"]:
        detected = family["caught"] + family["warned"]
        # an equivalent fault changes nothing: there is nothing to find
        counted = family["seeded"] - family["equivalent"]
        text = f"{detected} of {counted}"
        checks = list(family["by"])[:3]
        if checks:
            text = f"{text}, by {', '.join(checks)}"
        facts[f"{family['family']}: {family['meaning']}"] = text
    missed = []
    for fault in data["faults"]:
        if fault["state"] == "missed":
            missed.append(f"{fault['family']}: {fault['what']}")
    if missed:
        facts["missed"] = "; ".join(missed)
    facts["command"] = f"twin selftest {data['robot']} --seed {data['seed']} --count {len(data['faults'])}"
    return facts
