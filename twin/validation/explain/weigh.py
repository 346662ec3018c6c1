"""Select the simpler explanation: edits of the source, or changed numbers.

The simpler explanation has fewer changes. One changed number after which every row agrees is simpler than two edits,
and as simple as one edit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from twin.validation.explain.candidate import Found
from twin.validation.explain.result import Identified
from twin.validation.explain.rows import Key

Lead = Literal["edits", "numbers", "edits or numbers", ""]


def weigh(found: Sequence[Found], lost: Sequence[Key], identified: Identified | None) -> Lead:
    """Return the simplest explanation of all wrong rows: "edits", "numbers", "edits or numbers"; "" if none exists."""
    numbers = _numbers(identified)
    changes = None if lost or not found else sum(len(f.cures[0][0].edits) for f in found if f.cures)
    if numbers is None:
        return "" if changes is None else "edits"
    if changes is None or numbers < changes:
        borrowed = identified is not None and all(m.note.startswith("the value of") for m in identified.moved)
        return "edits or numbers" if changes is not None and borrowed else "numbers"
    return "edits or numbers" if numbers == changes else "edits"


def _numbers(identified: Identified | None) -> int | None:
    """Return the number of changed parameters with which every row agrees; None if there is no such change."""
    if identified is None or not identified.exact or not identified.moved:
        return None
    return 1 if identified.alternatives else len(identified.moved)
