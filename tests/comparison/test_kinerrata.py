"""Published kinematics that were wrong: each entry states robot, source, numbers, and who confirmed it."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

from made import errata

ENTRIES = sorted((Path(__file__).parents[1] / "kinerrata").glob("*.toml"))

KINDS = {
    *("length", "sign", "axis", "offset", "digits swapped", "units", "convention mixed", "mirrored"),
    *("copied from a sibling", "tool frame", "joint order", "mimic ratio", "limits", "inertia", "equation"),
    "false alarm",
}
# who says so: the first three confirm; the others judge by the robot, by computing, by like files, or not at all
BY = {"maintainer", "vendor", "datasheet", "robot", "merged", "physics", "geometry", "sibling", "open"}


def read(path):
    return tomllib.loads(path.read_text("utf-8"))


@pytest.mark.parametrize("path", ENTRIES, ids=lambda path: path.stem)
def test_an_entry_says_what_was_wrong_where_and_who_says_so(path):
    entry = read(path)
    must = {"robot", "kind", "accused", "by", "confirmed", "truth", "source"}
    may = {"note", "number", "chain", "convention", "format", "joint", "body", "dh"}
    may |= {"order_before", "absent_before", "convention_before", "equation"}
    assert must <= set(entry) <= must | may
    assert entry["kind"] in KINDS
    assert entry["by"] in BY
    assert entry["robot"]
    assert entry["confirmed"]
    assert entry["truth"]
    assert set(entry["source"]) == {"repository", "path", "commits", "licence"}
    assert entry.get("number") or entry.get("note") or entry["kind"] == "limits"
    for number in entry.get("number", []):
        assert set(number) == {"place", "before", "after", "unit"}
        assert math.isfinite(number["before"])
        assert math.isfinite(number["after"])


@pytest.mark.parametrize("path", [p for p in ENTRIES if "chain" in read(p)], ids=lambda path: path.stem)
def test_the_chain_of_an_entry_holds_its_numbers_after_the_correction(path):
    entry = read(path)
    assert entry["chain"] in {"whole", "part"}
    things = entry.get("joint", []) + entry.get("body", []) + entry.get("dh", [])
    named = {thing["name"]: thing for thing in things}
    assert len(named) == len(things)
    assert ("convention" in entry) == ("dh" in entry)
    assert entry.get("format", "urdf") in {"urdf", "mjcf"}
    assert set(entry.get("absent_before", [])) <= set(named)
    assert set(entry.get("order_before", [])) <= {joint["name"] for joint in entry.get("joint", [])}
    for joint in entry.get("joint", []):
        assert {"name", "type", "parent", "child", "xyz", "rpy"} <= set(joint)
        assert ("axis" in joint) == (joint["type"] != "fixed")
    for number in entry.get("number", []):
        end = next(end for end in errata.PLACES if number["place"].endswith(" " + end))
        key, i = errata.PLACES[end]
        value = named[number["place"].removesuffix(" " + end)][key]
        assert (value if i is None else value[i]) == pytest.approx(number["after"], abs=1e-15)
        assert number["before"] != number["after"]


def test_no_entry_accuses_what_is_right():
    for path in ENTRIES:
        entry = read(path)
        if entry["kind"] == "false alarm":
            assert not entry["accused"]
