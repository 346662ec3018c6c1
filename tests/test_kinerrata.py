"""Published kinematics that were wrong: each entry states robot, source, numbers, and who confirmed it."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

ENTRIES = sorted((Path(__file__).parent / "kinerrata").glob("*.toml"))

KINDS = {
    *("length", "sign", "axis", "offset", "digits swapped", "units", "convention mixed", "mirrored"),
    *("copied from a sibling", "tool frame", "joint order", "mimic ratio", "limits", "inertia", "equation"),
    "false alarm",
}


@pytest.mark.parametrize("path", ENTRIES, ids=lambda path: path.stem)
def test_an_entry_says_what_was_wrong_where_and_who_says_so(path):
    entry = tomllib.loads(path.read_text("utf-8"))
    assert set(entry) <= {"robot", "kind", "accused", "confirmed", "truth", "note", "source", "number"}
    assert entry["kind"] in KINDS
    assert entry["robot"]
    assert entry["confirmed"]
    assert entry["truth"]
    assert set(entry["source"]) == {"repository", "path", "commits", "licence"}
    assert entry.get("number") or entry.get("note") or entry["kind"] == "limits"
    for number in entry.get("number", []):
        assert set(number) == {"place", "before", "after", "unit"}
        assert math.isfinite(number["before"])
        assert math.isfinite(number["after"])


def test_no_entry_accuses_what_is_right():
    for path in ENTRIES:
        entry = tomllib.loads(path.read_text("utf-8"))
        if entry["kind"] == "false alarm":
            assert not entry["accused"]
