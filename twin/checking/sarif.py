"""SARIF 2.1.0 (OASIS standard), which GitHub and other programs show beside the lines of a file."""

from __future__ import annotations

from collections.abc import Sequence
from urllib.parse import quote_from_bytes

from twin.checking.check_finding import CheckFinding, readable
from twin.checking.rules import RULES
from twin.core.json_types import JsonObject
from twin.core.version import __version__

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"

_FINGERPRINT = "twinCheck/v1"
"""Key of our fingerprints among the partial fingerprints of a result."""


def sarif(findings: Sequence[CheckFinding], prefix: str = "") -> JsonObject:
    """Return the findings as one run; known findings are unchanged in comparison with the baseline.

    `prefix` is the path of the checked folder in its repository, as "robots/": files have paths in the repository.
    """
    ids = list(RULES)
    rules: list[JsonObject] = []
    for rule in RULES.values():
        rules.append(
            {
                "id": rule.id,
                "shortDescription": {"text": f"{rule.title}."},
                "help": {"text": rule.help},
                "defaultConfiguration": {"level": rule.level},
            }
        )
    is_complete = True  # whether all files could be judged
    results = []
    for finding in findings:
        results.append(_result(finding, ids, prefix))
        if finding.rule == "file/unjudged":
            is_complete = False
    driver: JsonObject = {"name": "twin check", "version": __version__, "rules": rules}
    run: JsonObject = {
        "tool": {"driver": driver},
        "invocations": [{"executionSuccessful": is_complete, "commandLine": "twin check"}],
        "columnKind": "unicodeCodePoints",
        "results": results,
    }
    return {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}


def _result(finding: CheckFinding, ids: Sequence[str], prefix: str) -> JsonObject:
    # GitHub shows only results with a region; without a known line, the first one
    line = finding.line or 1
    uri = quote_from_bytes(f"{prefix}{finding.file}".encode("utf-8", "surrogateescape"))
    return {
        "ruleId": finding.rule,
        "ruleIndex": ids.index(finding.rule),
        "level": finding.level,
        "message": {"text": _literal(f"{finding.message} {finding.advice}")},
        "locations": [
            {
                "physicalLocation": {
                    "artifactLocation": {"uri": uri, "uriBaseId": "%SRCROOT%"},
                    "region": {"startLine": line},
                }
            }
        ],
        "partialFingerprints": {_FINGERPRINT: finding.fingerprint},
        "baselineState": "unchanged" if finding.known else "new",
    }


def _literal(text: str) -> str:
    """Return a text as a message string, in which single braces would stand for arguments (SARIF 2.1.0, 3.11.5)."""
    doubled = text.replace("{", "{{").replace("}", "}}")
    return readable(doubled)
