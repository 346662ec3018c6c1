"""Every declared field of an export is changed, one at a time, and the audit finds the change by its cause.

By default some changes of a small robot; `TWIN_SEEDS=all` changes every field of real robots.
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

import twin
from made import audit_every_field, audit_fresh, audit_seeds, bundle
from made.audit_every_field_run import judge
from made.audit_read_once import ReadOnce
from twin.exchange.audit import audit
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.unity.audit import check_package

EVERY = os.environ.get("TWIN_SEEDS") == "all"
ROBOTS = ("pa10", "sils", "sher", "davinci_psm", "raven_left")
LEAST = 0.98
"""Share of the changes that must be found by their cause, refused, or shown to be without effect."""

DRAWN = 40


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    return bundle.write_good(tmp_path_factory.mktemp("good") / "bars")


@pytest.fixture(scope="module")
def reader(bars) -> ReadOnce:
    return ReadOnce(bars)


@pytest.mark.slow
@pytest.mark.parametrize("part", [pytest.param("glb", marks=pytest.mark.nightly), "tracks", "csv"])
def test_drawn_changes_of_declared_fields_are_found(part, bars, tmp_path):
    rng = random.Random(f"1 {part}")
    changes = audit_every_field.PARTS[part](bars, rng, 1)
    missed = []
    reader = ReadOnce(bars)
    for change in rng.sample(changes, DRAWN):
        word, told = judge(change, reader, tmp_path / "spoilt", None)
        if word == "missed":
            missed.append(f"{change.name}: {told}")
    assert len(missed) <= (1 - LEAST) * DRAWN, missed


def test_the_fields_are_those_of_the_files(bars):
    rng = random.Random(0)
    fields = {change.field for change in audit_every_field.glb_changes(bars, rng, 1)}
    assert {"nodes.[].translation.[]", "accessors.[].min.[]", "animations.[].samplers.[].interpolation"} <= fields
    assert {"mesh POSITION", "mesh NORMAL", "mesh indices", "key times", "keys of rotation"} <= fields
    fields = {change.field for change in audit_every_field.track_changes(bars, rng, 1)}
    assert {"rate", "times.[]", "poses.[]", "joint_lower.[]", "phase_rcm.[]", "shaft_axis.[]"} <= fields


@pytest.mark.parametrize(
    "name",
    [
        "link hidden by an extension",
        "morph target with a weight",
        "vertex colours",
        "a clip twice under another name",
        "surface without points",
        "surface twice",
        "one mesh has no attributes.NORMAL: gone",
        "normals 1 % too long",
        "surface without material",
        "frames outside of the scene",
        "node of a frame without name",
        "link without list of joints",
    ],
)
def test_what_a_glb_has_or_lacks_is_found(name, bars, reader, tmp_path):
    part, _, edit, _, says = next(one for one in audit_fresh.FRESH if one[1] == name)
    file = next(path.name for path in bars.glob("*.glb"))
    change = audit_every_field.Change(part, name, "", file, edit, says)
    assert audit_every_field.copied(bars, tmp_path / "spoilt", change)
    report = reader.audit(tmp_path / "spoilt", None)
    assert audit_every_field.caused(report, change) == "found", [f.message for f in report.findings]


def test_a_unity_package_without_the_class_of_its_robot_is_found(tmp_path):
    package = tmp_path / "unity"
    for path in ("package.json", "Runtime/Robots.meta", "Runtime/Robots/Arm.cs"):
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text('{"name": "com.small.player", "version": "1.0.0"}')
    ledger = Ledger("unity")
    check_package(package, ledger)
    assert not any("no class" in finding.message for finding in ledger.found)
    (package / "Runtime/Robots/Arm.cs").unlink()
    check_package(package, ledger)
    assert any("no class" in finding.message for finding in ledger.found)


def test_a_track_that_is_not_recognised_is_found_by_the_table_of_its_name(bars, tmp_path):
    file = audit_every_field.tracks(bars)[0]
    schema = audit_every_field.json_edit(file, lambda data: data.pop("schema"))
    change = audit_every_field.Change("tracks", "schema", "gone", file, schema, "schema")
    assert audit_every_field.copied(bars, tmp_path / "spoilt", change)
    assert audit_every_field.caused(audit(tmp_path / "spoilt"), change) == "found"


@pytest.mark.nightly
@pytest.mark.skipif(not EVERY, reason="minutes: set TWIN_SEEDS=all")
@pytest.mark.parametrize("robot", [False, True])
def test_defects_by_hand_are_found(robot, tmp_path):
    audit_fresh.EXPORTS[:] = [tmp_path / "good"]
    missed = []
    for i, (part, name, edit, file, says) in enumerate(audit_fresh.FRESH):
        expected, change = audit_fresh.chosen(i, part, name, edit, file, says, tmp_path)
        told = audit_every_field.caused(twin.audit(tmp_path / "spoilt", expected if robot else None), change)
        if told not in ("found", "refused"):
            missed.append(f"{expected}: {name}: {told}")
    assert len(missed) <= (1 - LEAST) * len(audit_fresh.FRESH), missed


@pytest.mark.nightly
@pytest.mark.skipif(not EVERY, reason="hours: set TWIN_SEEDS=all")
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("part", [part for part in audit_every_field.PARTS if part != "proof"])
def test_changes_of_every_field_of_real_robots_are_found(part, robot, tmp_path):
    good = audit_seeds.exported([robot], tmp_path)[robot]
    count = 0
    missed = []
    reader = ReadOnce(good)
    for change in audit_every_field.PARTS[part](good, random.Random(1), 1):
        word, told = judge(change, reader, tmp_path / "spoilt", robot if count % 2 else None)
        count += bool(word)
        if word == "missed":
            missed.append(f"{change.name}: {told}")
    assert len(missed) <= (1 - LEAST) * count, missed
