"""Baseline: the findings that are known, so that only new ones fail."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from twin.checking.check_finding import CheckFinding, readable
from twin.core.atomic import write_text
from twin.core.errors import BudgetError, SourceError
from twin.core.foreign.text import load_json

SCHEMA = "twin/check-baseline/1"


def read_baseline(path: Path) -> set[str]:
    """Return the fingerprints in a baseline.

    Raises:
        SourceError: the file does not exist, or is not a baseline.
    """
    try:
        data = load_json(path)
    except BudgetError:
        raise
    except OSError as error:
        advice = "write it with --write-baseline"
        raise SourceError(f"{path}: the baseline cannot be read ({error.strerror or error}); {advice}") from error
    except (ValueError, RecursionError) as error:
        raise SourceError(f"{path}: the baseline is not JSON: {error}") from error
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or not isinstance(data.get("findings"), list):
        raise SourceError(f"{path}: not a baseline: expected the schema {SCHEMA} and a list of findings")
    fingerprints: set[str] = set()
    for i, row in enumerate(data["findings"]):
        fingerprint = row.get("fingerprint") if isinstance(row, dict) else None
        if not isinstance(fingerprint, str):
            raise SourceError(f"{path}: finding {i + 1} of the baseline has no fingerprint")
        fingerprints.add(fingerprint)
    return fingerprints


def write_baseline(path: Path, findings: Iterable[CheckFinding]) -> int:
    """Write warnings and errors as a baseline, sorted; return their number."""
    rows: list[dict[str, str]] = []
    for finding in findings:
        # notes never fail; what was not judged must not pass because it is known
        if finding.level != "note" and finding.rule != "file/unjudged":
            rows.append(
                {
                    "fingerprint": finding.fingerprint,
                    "rule": finding.rule,
                    "file": readable(finding.file),
                    "message": readable(finding.message),
                }
            )
    # the file is under version control: it changes only where findings change
    rows.sort(key=lambda row: (row["file"], row["rule"], row["message"], row["fingerprint"]))
    text = json.dumps({"schema": SCHEMA, "findings": rows}, indent=1, ensure_ascii=False)
    write_text(path, text + "\n")
    return len(rows)
