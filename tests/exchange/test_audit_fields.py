"""A change of any field that an exported URDF, MJCF or stage declares, or could declare, is found by its cause.

The fields are listed by the files and by the schemas of the formats (`made.audit_fields`), not by hand. By default a
dozen fields of the small robot in one audit; `-m slow` a drawn part of its fields; nightly all of them, and a part of
those of real robots. By the command line: `made.audit_campaign`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from made import audit_effects, audit_fields, audit_fields_usd, audit_seeds, audit_seeds_fresh, bundle
from made.audit_fields import parsed, stored
from twin.exchange.audit import audit

LEAST = 0.98
"""Share of the changes with an effect that must be found by their cause."""

FOUND = ("found", "elsewhere", "refused", "none")
"""Classes of outcomes that are no miss; `elsewhere` is found, but named by other words than those of the field."""


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    return bundle.write_good(tmp_path_factory.mktemp("good") / "bars")


@pytest.fixture(scope="module")
def real(tmp_path_factory) -> dict[str, Path]:
    robots = ("pa10", "sils", "sher", "davinci_psm", "raven_left")
    return audit_seeds.exported(robots, tmp_path_factory.mktemp("real"))


def spoil_urdf(root: ET.Element) -> None:
    root.set("name", "other")
    root.append(ET.fromstring(ET.tostring(root.find("material"))))
    del root.find("link/inertial/inertia").attrib["ixy"]
    link = root.find("link")
    link.append(ET.fromstring(ET.tostring(link.find("collision"))))
    root.find("transmission/type").text = "transmission_interface/NoTransmission"
    root.append(ET.fromstring('<gazebo reference="crank"><gravity>false</gravity></gazebo>'))
    root.find("joint").append(ET.fromstring('<calibration rising="0.1"/>'))
    root.findall("link")[1].append(ET.fromstring(BALL))


BALL = '<collision name="ball"><geometry><sphere radius="0.2"/></geometry></collision>'


def spoil_mjcf(root: ET.Element) -> None:
    root.find("option").set("timestep", "0.002")
    next(root.iter("geom")).set("friction", "0.1 0 0")
    next(root.iter("joint")).set("actuatorfrcrange", "-1 1")
    actuator = root.find("actuator/general")
    low, high = map(float, actuator.get("ctrlrange").split())
    actuator.set("ctrlrange", f"{low / 2} {high / 2}")
    actuator.set("name", "crank_x")
    actuator.set("forcelimited", "false")
    next(joint for joint in root.iter("joint") if joint.get("range")).set("solreflimit", "0.5 1")
    first, second = root.findall("equality/connect")
    first.set("solref", "0.001 1.01")
    second.set("name", "closing_1_x")
    root.find("keyframe/key").set("name", "home_x")
    del next(root.iter("geom")).attrib["type"]


def spoil_motion(layer: Sdf.Layer) -> None:
    Sdf.CopySpec(layer, "/bars/base", layer, "/bars/crank/base")
    del layer.GetPrimAtPath("/bars").nameChildren["base"]


def spoil_stage(layer: Sdf.Layer) -> None:
    joint = layer.GetPrimAtPath("/bars/joints/crank_joint")
    joint.attributes["state:angular:physics:velocity"].default = 3.0
    root = layer.GetPrimAtPath("/bars")
    root.attributes["physxArticulation:solverPositionIterationCount"].default = 4
    root.attributes["twin:tool"].default = "nothing"
    for kind, field in (("Camera", "focalLength"), ("DistantLight", "inputs:intensity")):  # no parts of the robot
        added = Sdf.CreatePrimInLayer(layer, f"/bars/{kind}")
        added.specifier, added.typeName = Sdf.SpecifierDef, kind
        Sdf.AttributeSpec(added, field, Sdf.ValueTypeNames.Float).default = 20.0
    crank = layer.GetPrimAtPath("/bars/crank")
    Sdf.RelationshipSpec(crank, "physics:filteredPairs").targetPathList.explicitItems = ["/bars/rocker"]
    added = Sdf.CreatePrimInLayer(layer, "/bars/more")
    added.specifier, added.typeName = Sdf.SpecifierDef, "Xform"
    added.SetInfo("apiSchemas", Sdf.TokenListOp.CreateExplicit(["PhysicsRigidBodyAPI"]))
    held = layer.GetPrimAtPath("/bars/joints/root_joint")
    Sdf.AttributeSpec(held, "physics:breakForce", Sdf.ValueTypeNames.Float).default = 1.0
    mesh = layer.GetPrimAtPath("/bars/crank/crank_visual")
    Sdf.AttributeSpec(mesh, "physxCollision:contactOffset", Sdf.ValueTypeNames.Float).default = 0.5


EXPECTED = {
    "bars.urdf": (*("physics.robot", "urdf.duplicate_name", "urdf.attribute", "urdf.repeated", "urdf.transmission"),),
    "bars.xml": (
        *("mjcf.claim", "physics.declarations_of_contact_or_look", "physics.further_declarations"),
        "physics.range_of_control",
    ),
    "usd/bars.usda": ("usd.state", "usd.engine", "usd.mark", "physics.declarations_of_contact_or_look"),
}
"""Codes of the findings on what `spoil_...` does to each file."""

PLACED = {
    ("bars.xml: crank_x", "mjcf.claim"),
    ("bars.xml: crank_x", "mjcf.range_off"),
    ("bars.xml: joint 'crank_joint'", "physics.largest_effort"),
    ("bars.xml: joint 'crank_joint'", "physics.declarations_of_contact_or_look"),
    ("usd/bars_swing.usda: /bars/crank/base", "usd.undefined"),
    ("bars.urdf: joint 'crank_joint'", "physics.settings_of_single_programs"),
    ("bars.urdf: 'crank' in Gazebo", "physics.settings_of_single_programs"),
    ("bars.urdf: crank", "urdf.collision"),
    ("bars.xml: closing_0", "mjcf.claim"),
    ("bars.xml: joint 'closing'", "physics.name"),
    ("bars.xml: keyframe", "mjcf.claim"),
    ("usd/bars.usda: /bars/crank", "physics.further_declarations"),
    ("usd/bars.usda: /bars/joints/root_joint", "physics.further_declarations"),
    ("bars.xml: body 'more'", "physics.existence"),
}
"""Places and codes of those that must be found although the robot has one actuator, two limits, and a base at rest."""


def test_what_formats_declare_beside_the_mechanism_is_compared(bars, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(bars, folder, ignore=shutil.ignore_patterns("*.glb", "*.usdz", "unity", "proof.json", "*_sim.usda"))
    for name, spoil in (("bars.urdf", spoil_urdf), ("bars.xml", spoil_mjcf)):
        root = parsed(folder / name)
        spoil(root)
        stored(folder / name, root)
    for name, spoil in (("usd/physics.usda", spoil_stage), ("usd/motion/swing.usdc", spoil_motion)):
        layer = Sdf.Layer.OpenAsAnonymous(str(folder / name))
        spoil(layer)
        (folder / name).unlink()
        assert layer.Export(str(folder / name))
    placed = {(f.where, f.code) for f in audit(folder).findings if f.severity != "info"}
    assert placed >= PLACED, PLACED - placed
    assert not [where for where, _ in placed if "Camera" in where or "DistantLight" in where]
    told = {(where.split(":")[0], code) for where, code in placed}
    missing = {(file, code) for file, codes in EXPECTED.items() for code in codes} - told
    assert not missing, sorted(told)


def changes_of(folder: Path) -> dict[str, Callable]:
    return {
        "bars.urdf": lambda: audit_fields.declared_changes(folder, "bars.urdf"),
        "bars.xml": lambda: audit_fields.declared_changes(folder, "bars.xml"),
        "usd/physics.usda": lambda: audit_fields_usd.declared_changes(folder, "usd/physics.usda"),
        "usd/geometry.usdc": lambda: audit_fields_usd.declared_changes(folder, "usd/geometry.usdc"),
    }


def test_every_field_is_listed_and_every_change_changes_the_file(bars, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(bars, folder)
    for file, make in changes_of(folder).items():
        changes = list(make())
        assert len({change.kind for change in changes}) > 180, file
        before = (folder / file).read_bytes()
        for change in changes[:: len(changes) // 6]:
            change.edit(folder)
            assert (folder / file).read_bytes() != before, change.kind
            (folder / file).write_bytes(before)
    known = audit_fields.mjcf_fields()
    assert {"solreflimit", "actuatorfrcrange"} <= set(known["joint"])


SOLIMP = [[0.9999, 0.9999, 0.001, 0.5, 2.0]]
VALUES = (
    ("eq_solimp", SOLIMP, [[1.009, 0.9999, 0.001, 0.5, 2.0]], True),
    ("eq_solimp", SOLIMP, [[0.9999, 0.9999, 0.002, 0.6, 3.0]], True),
    ("eq_solimp", SOLIMP, [[-0.9999, 0.9999, 0.001, 0.5, 2.0]], False),
    ("effort", [1e6, 5.0], [1.01e6, 5.0], True),
    ("effort", [1e6, 5.0], [1e6, 5.05], False),
    ("mat_rgba", [[0.5, 0.2, 0.1, 1.0]], [[0.505, 0.2, 0.1, 1.0]], True),
    ("mat_rgba", [[0.5, 0.2, 0.1, 1.0]], [[0.52, 0.2, 0.1, 1.0]], False),
    ("mat_rgba", [[0.5, 0.2, 0.1, 1.0]], [[0.5, 0.2, 0.1, 1.0]] * 2, False),
    ("inertias", [1e-6 * np.eye(6)], [1.01e-6 * np.eye(6)], True),
    ("inertias", [np.eye(6)], [1.01 * np.eye(6)], False),
)


@pytest.mark.parametrize(("field", "before", "after", "none"), VALUES)
def test_a_change_has_no_effect_by_its_values_not_by_its_name(field, before, after, none):
    assert audit_effects.harmless({field: np.array(before)}, {field: np.array(after)}, field) is none


def test_the_fresh_kinds_are_sixty_and_stand_in_no_other_table():
    names = [one.name for one in audit_seeds_fresh.FRESH]
    assert len(set(names)) == len(names) == 60
    assert not set(names) & {one.name for one in audit_seeds.SEEDS}


def campaign(folder: Path, robot: str, out: Path, *options: str) -> list[dict]:
    """Return the outcomes of a campaign, which runs in a process of its own because it replaces parts of the audit."""
    tests = Path(__file__).parents[1]
    command = [sys.executable, "-m", "made.audit_campaign", str(folder), robot, "--out", str(out), *options]
    environment = {**os.environ, "PYTHONPATH": str(tests)}
    subprocess.run(command, check=True, env=environment, cwd=tests.parent, capture_output=True)
    return [json.loads(line) for line in out.read_text().splitlines()]


def judge(outcomes: list[dict], least: int = 10) -> None:
    missed = [o for o in outcomes if o["verdict"] not in FOUND]
    effective = [o for o in outcomes if o["verdict"] != "none"]
    print(f"{len(effective) - len(missed)} of {len(effective)} changes with an effect found by their cause")
    for o in missed:
        print(f"  {o['file']}: {o['kind']} | {o['place']} | {o['verdict']} | {o['effect']} | {o['told'][:1]}")
    assert len(outcomes) > least
    assert 1 - len(missed) / len(effective) >= LEAST


PARTS = (("urdf", "7/30"), ("mjcf", "11/30"), ("usd", "13/90"))


@pytest.mark.slow
@pytest.mark.parametrize(("format", "part"), PARTS)
def test_a_drawn_part_of_the_fields_of_a_small_robot_is_found(format, part, bars, tmp_path):
    judge(campaign(bars, "bars", tmp_path / "out.jsonl", "--format", format, "--part", part))


@pytest.mark.slow
@pytest.mark.parametrize(("format", "part"), [("urdf", "1/3"), ("mjcf", "2/9"), ("usd", "3/9")])
def test_elements_and_prims_added_to_a_small_robot_are_found(format, part, bars, tmp_path):
    judge(campaign(bars, "bars", tmp_path / "out.jsonl", "--format", format, "--added", "--part", part), least=5)


@pytest.mark.nightly
@pytest.mark.parametrize("format", ["urdf", "mjcf", "usd"])
@pytest.mark.parametrize("robot", ["bars", "sils", "raven_left"])
def test_every_added_element_is_found(robot, format, bars, real, tmp_path):
    folder = bars if robot == "bars" else real[robot]
    judge(campaign(folder, robot, tmp_path / "out.jsonl", "--format", format, "--added"))


def lose_motion(folder: Path) -> None:
    stage = folder / "usd/bars_swing.usda"
    stage.write_text(stage.read_text().replace("@./motion/swing.usdc@,", ""))


def lose_shader(folder: Path) -> None:
    file = str(folder / "usd/geometry.usdc")
    layer = Sdf.Layer.OpenAsAnonymous(file)
    materials = layer.GetPrimAtPath("/bars/materials").nameChildren
    materials[0].nameChildren[0].SetInfo("active", False)
    Path(file).unlink()
    layer.Export(file)


def move_sample(folder: Path) -> None:
    file = str(folder / "usd/motion/swing.usdc")
    layer = Sdf.Layer.OpenAsAnonymous(file)
    times = layer.ListTimeSamplesForPath("/bars/crank.xformOp:orient")
    value = layer.QueryTimeSample("/bars/crank.xformOp:orient", times[4])
    layer.SetTimeSample("/bars/crank.xformOp:orient", times[4] + 0.3, value)
    Path(file).unlink()
    layer.Export(file)


def hide_during_motion(folder: Path) -> None:
    stage = Usd.Stage.Open(str(folder / "usd/bars_swing.usda"))
    crank = UsdGeom.Imageable(stage.GetPrimAtPath("/bars/crank"))
    crank.CreateVisibilityAttr().Set("invisible", 3.0)
    stage.GetRootLayer().Save()


LAYER_FAULTS = (
    (hide_during_motion, "usd.changing", "visibility of /bars/crank has time samples"),
    (lose_motion, "usd.unused_layer", "it only states values for /bars, which another layer must define"),
    (lose_motion, "usd.range", "no link has time samples"),
    (lose_shader, "usd.material", "has no shader"),
    (move_sample, "usd.sample_times", "link 'crank' have a time sample at the time code"),
)


@pytest.mark.slow
@pytest.mark.parametrize(("edit", "code", "says"), LAYER_FAULTS)
def test_a_layer_without_its_stage_or_its_content_is_named(edit, code, says, bars, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(bars, folder, ignore=shutil.ignore_patterns("*.glb", "*.usdz", "unity", "proof.json"))
    edit(folder)
    assert [f for f in audit(folder).findings if f.code == code and says in f.message]


@pytest.mark.nightly
@pytest.mark.parametrize("format", ["urdf", "mjcf", "usd"])
@pytest.mark.parametrize("undeclared", [False, True])
def test_every_field_of_a_small_robot_is_found(format, undeclared, bars, tmp_path):
    options = ["--undeclared"] * undeclared
    judge(campaign(bars, "bars", tmp_path / "out.jsonl", "--format", format, *options))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("robot", "format", "part"),
    [
        (r, f, f"{k}/12")
        for k, (r, f) in enumerate(
            [(r, f) for r in ("pa10", "sils", "sher", "davinci_psm", "raven_left") for f in ("urdf", "mjcf", "usd")]
        )
        if k < 12
    ],
)
def test_a_drawn_part_of_the_fields_of_real_robots_is_found(robot, format, part, real, tmp_path):
    judge(campaign(real[robot], robot, tmp_path / "out.jsonl", "--format", format, "--part", part))


def wanted(one: audit_seeds.Seed, export: Path) -> list[str]:
    """Return the stages and layers that a kind needs beside the stage of the robot, which take time."""
    if "motion" in one.name:
        clip = sorted(path.stem for path in (export / "usd/motion").glob("*.usdc"))[0]
        return [f"{export.name}_{clip}.usda", f"{clip}.usdc"]
    return [f"{export.name}_sim.usda"] if "scene" in one.name else []


@pytest.mark.nightly
@pytest.mark.parametrize("mechanism", [False, True])
def test_the_fresh_kinds_are_found_in_real_robots(mechanism, real, tmp_path):
    import twin
    from made.audit_campaign import slim

    robots = list(real)
    missed = []
    for i, one in enumerate(audit_seeds_fresh.FRESH):
        for name in (*robots[i % 5 :], *robots[: i % 5]):
            slim(real[name], tmp_path / name, stages=[f"{name}.usda", *wanted(one, real[name])])
            if one.edit(tmp_path / name) is not False:
                break
        report = twin.audit(tmp_path / name, name if mechanism else None)
        if not audit_seeds.found(report, one, warned=True):
            missed.append(
                (name, one.name, [f"{f.code} {f.where}" for f in report.findings if f.severity != "info"][:3])
            )
    assert 1 - len(missed) / len(audit_seeds_fresh.FRESH) >= LEAST, missed
