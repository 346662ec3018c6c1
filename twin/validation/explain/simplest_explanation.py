"""Select the simpler explanation: edits of the source, or changed numbers.

The simpler explanation has fewer changes. One changed number after which every row agrees is simpler than two edits,
and as simple as one edit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from twin.validation.explain.candidate import GroupResult
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.explanation_data import FittedParameters

Lead = Literal["edits", "numbers", "edits or numbers", ""]


def simplest_explanation(
    found: Sequence[GroupResult], lost: Sequence[RowKey], identified: FittedParameters | None
) -> Lead:
    """Return the simplest explanation of all wrong rows: "edits", "numbers", "edits or numbers"; "" if none exists."""
    numbers = _numbers(identified)
    edits = _edits(found, lost)
    if numbers is None and edits is None:
        return ""
    if numbers is None:
        return "edits"
    if edits is None:
        return "numbers"
    if numbers == edits:
        return "edits or numbers"
    if numbers > edits:
        return "edits"
    # The value of another parameter is as likely a misprint of its name.
    assert identified is not None
    if all(m.note.startswith("the value of") for m in identified.moved):
        return "edits or numbers"
    return "numbers"


def _edits(found: Sequence[GroupResult], lost: Sequence[RowKey]) -> int | None:
    """Return the number of edits with which every row agrees; None if there are no such edits."""
    if lost or not found:
        return None
    return sum(len(f.cures[0][0].edits) for f in found if f.cures)


def _numbers(identified: FittedParameters | None) -> int | None:
    """Return the number of changed parameters with which every row agrees; None if there is no such change."""
    if identified is None or not identified.exact or not identified.moved:
        return None
    return 1 if identified.alternatives else len(identified.moved)
