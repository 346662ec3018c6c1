"""Every field of an export is compared with a new export: a change is named, another way of writing it is none."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom

import twin
from twin.api.clip_protocols import clip_of_no_protocol, played_protocols
from twin.api.scene_export import export_scene
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.reference_export.difference import FieldDifference, differences
from twin.exchange.audit.reference_export.field_comparison import READERS, compare_with_reference
from twin.exchange.audit.reference_export.json_entries import entry_of
from twin.exchange.write.clip import ClipAccuracy


def told(reference: Path, found: Path) -> list[FieldDifference]:
    read = READERS[found.suffix].read
    return list(differences(read(reference), read(found)))


def ledgers(path: Path, reference: Path) -> list[Ledger]:
    return list(compare_with_reference(path, reference, ()))


# ------------------------------------------------------------------------------------------------------ any content

leaves = st.one_of(
    st.booleans(),
    st.text("abc ", max_size=5),
    st.floats(-10, 10).map(lambda x: round(x, 3)),
    st.lists(st.floats(-10, 10), min_size=1, max_size=12),
)
objects = st.recursive(
    st.dictionaries(st.sampled_from("abcdef"), leaves, min_size=1, max_size=3),
    lambda inner: st.dictionaries(st.sampled_from("pqrs"), st.one_of(inner, st.lists(inner, min_size=1, max_size=3))),
    max_leaves=12,
)


@given(objects)
def test_equal_content_has_no_difference_in_any_order_of_keys(content):
    turned = json.loads(json.dumps(content))
    turned = dict(reversed(turned.items()))
    assert not list(differences(entry_of("file", "", content), entry_of("file", "", turned)))


@given(objects, st.data())
def test_a_changed_leaf_is_the_only_difference_and_is_named(content, data):
    changed = json.loads(json.dumps(content))
    places = list(leaf_places(changed))
    if not places:
        return
    parent, key = data.draw(st.sampled_from(places))
    if isinstance(parent[key], list):
        parent[key][-1] += 1.0
    else:
        parent[key] = "changed"
    (found,) = differences(entry_of("file", "", content), entry_of("file", "", changed))
    assert found.form == "value"
    assert found.text.startswith(f"'{key}' ")


def leaf_places(content):
    """Yield (object, key) of all values in parsed JSON that are no objects."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from leaf_places(value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for element in value:
                yield from leaf_places(element)
        else:
            yield content, key


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=30))
def test_rounding_to_single_precision_is_no_difference(numbers):
    rounded = np.array(numbers, "f4").astype(float).tolist()
    assert not list(differences(entry_of("file", "", {"n": numbers}), entry_of("file", "", {"n": rounded})))


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 1e30])
def test_numbers_that_are_not_finite_are_compared(number):
    reference = entry_of("file", "", {"n": [1.0, number]})
    assert not list(differences(reference, entry_of("file", "", {"n": [1.0, number]})))
    assert list(differences(reference, entry_of("file", "", {"n": [1.0, 2.0]})))


def test_of_long_texts_the_part_that_differs_is_quoted():
    line = "x" * 300
    (found,) = differences(entry_of("file", "", {"t": line}), entry_of("file", "", {"t": line + " in mm"}))
    assert "in mm" in found.text


# -------------------------------------------------------------------------------------------------------------- XML

URDF = """<robot name="r"><!-- r.urdf: a comment -->
<link name="a"><visual><origin xyz="0 0 0.1"/></visual><visual><origin xyz="0 0 0.2"/></visual></link>
<link name="b"/><joint name="j" type="revolute"><limit lower="-1" upper="1.5"/></joint></robot>"""


@pytest.mark.parametrize(
    ("old", "new", "place", "text"),
    [
        ('upper="1.5"', 'upper="1.6"', "joint 'j', limit", "'upper' is 1.6; in a new export it is 1.5"),
        (' upper="1.5"', "", "joint 'j', limit", "'upper' is missing; in a new export it is 1.5"),
        ('type="revolute"', 'type="revolute" axis="x"', "joint 'j'", "'axis' is 'x'; a new export does not have it"),
        ('<link name="b"/>', "", "", "link 'b' is missing, which a new export has"),
        ('<link name="b"/>', '<link name="b"/><link name="c"/>', "", "link 'c' is not in a new export"),
        ('<visual><origin xyz="0 0 0.1"/></visual>', "", "link 'a'", "visual 1 is missing, which a new export has"),
        ('xyz="0 0 0.2"', 'xyz="0 0 0.3"', "link 'a', visual 2, origin", "is (0, 0, 0.3); in a new export"),
        ("a comment", "another comment", "", "comment 'r.urdf: another comment' is not in a new export"),
    ],
)
def test_a_change_in_xml_is_named(old, new, place, text, tmp_path):
    (tmp_path / "r.urdf").write_text(URDF)
    (tmp_path / "s.urdf").write_text(URDF.replace(old, new))
    found = told(tmp_path / "r.urdf", tmp_path / "s.urdf")
    assert [f for f in found if f.place == place and text in f.text]
    assert len(found) == (2 if "comment" in old else 1)


def test_text_after_what_stands_inside_an_element_is_compared(tmp_path):
    (tmp_path / "r.xml").write_text('<sdf><pose text="near">1 2 <!-- c --> 3</pose></sdf>')
    (tmp_path / "s.xml").write_text('<sdf><pose text="far">1 2 <!-- c --> 4</pose></sdf>')
    texts = [f.text for f in told(tmp_path / "r.xml", tmp_path / "s.xml")]
    assert texts == [
        "'text' is 'far'; in a new export it is 'near'",
        "'text inside' is (1, 2, 4); in a new export it is (1, 2, 3)",
    ]


def test_xml_saved_again_has_no_difference_but_comments(tmp_path):
    (tmp_path / "r.urdf").write_text(URDF.replace("0.1", "1.00e-1"))
    ET.ElementTree(ET.fromstring(URDF)).write(tmp_path / "s.urdf", encoding="utf-16")
    assert [f.pattern for f in told(tmp_path / "r.urdf", tmp_path / "s.urdf")] == ["/comment"]
    (tmp_path / "again").mkdir()
    shutil.copy(tmp_path / "s.urdf", tmp_path / "again/r.urdf")
    assert not ledgers(tmp_path / "again/r.urdf", tmp_path)[0].found


# ------------------------------------------------------------------------------------------------------------ tables


def test_a_table_without_rows_is_compared(tmp_path):
    (tmp_path / "r.csv").write_text("# rate: 50\nt,q1\n0,1\n0.02,2\n")
    (tmp_path / "s.csv").write_text("# rate: 50\nt,q1\n")
    texts = [f.text for f in told(tmp_path / "r.csv", tmp_path / "s.csv")]
    assert texts == [
        "'column t' is (); in a new export it is (0, 0.02)",
        "'column q1' is (); in a new export it is (1, 2)",
    ]


# -------------------------------------------------------------------------------------------------------------- USD


def layer(path: Path) -> Path:
    stage = Usd.Stage.CreateNew(str(path))
    arm = UsdGeom.Xform.Define(stage, "/arm")
    arm.AddTranslateOp().Set(Gf.Vec3d(0, 0, 0.1))
    turn = arm.AddRotateZOp()
    for time in range(12):
        turn.Set(10.0 * time, time)
    arm.GetPrim().CreateRelationship("body").AddTarget("/arm/hand")
    UsdGeom.Mesh.Define(stage, "/arm/hand").CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    arm.GetPrim().SetCustomDataByKey("mass:unit", "kg")
    stage.SetDefaultPrim(arm.GetPrim())
    stage.Save()
    return path


def deactivated(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/arm/hand").SetActive(False)


def one_key_moved(stage: Usd.Stage) -> None:
    stage.GetAttributeAtPath("/arm.xformOp:rotateZ").Set(55.0, 5)


def one_point_moved(stage: Usd.Stage) -> None:
    stage.GetAttributeAtPath("/arm/hand.points").Set([(0, 0, 0), (1, 0, 0), (0, 1.1, 0)])


def other_target(stage: Usd.Stage) -> None:
    stage.GetRelationshipAtPath("/arm.body").SetTargets(["/arm"])


def other_unit(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/arm").SetCustomDataByKey("mass:unit", "g")


def other_default_prim(stage: Usd.Stage) -> None:
    stage.ClearDefaultPrim()


def with_an_offset(stage: Usd.Stage) -> None:
    stage.GetRootLayer().subLayerPaths.append("none.usda")
    stage.GetRootLayer().subLayerOffsets[0] = Sdf.LayerOffset(10.0)


@pytest.mark.parametrize(
    ("change", "place", "text"),
    [
        (deactivated, "Xform 'arm', Mesh 'hand'", "'active' is False"),
        (one_key_moved, "Xform 'arm', attribute 'xformOp:rotateZ'", "differs in 1 of 12 numbers, most at [5]"),
        (one_point_moved, "Xform 'arm', Mesh 'hand', attribute 'points'", "differs in 1 of 9 numbers"),
        (other_target, "Xform 'arm', relationship 'body'", "'targets' is '/arm'; in a new export it is '/arm/hand'"),
        (other_unit, "Xform 'arm'", "'customData:mass:unit' is 'g'; in a new export it is 'kg'"),
        (other_default_prim, "", "'defaultPrim' is missing"),
        (with_an_offset, "", "'subLayerOffsets' is (10, 1)"),
    ],
)
def test_a_change_in_a_layer_is_named(change, place, text, tmp_path):
    layer(tmp_path / "r.usda")
    stage = Usd.Stage.Open(str(layer(tmp_path / "s.usda")))
    change(stage)
    stage.Save()
    found = told(tmp_path / "r.usda", tmp_path / "s.usda")
    assert [f for f in found if f.place == place and text in f.text], found


def test_a_layer_saved_again_has_no_difference(tmp_path):
    layer(tmp_path / "r.usda")
    Sdf.Layer.OpenAsAnonymous(str(tmp_path / "r.usda")).Export(str(tmp_path / "s.usdc"))
    assert not told(tmp_path / "r.usda", tmp_path / "s.usdc")


# ------------------------------------------------------------------------------------- glTF, tables, text and meshes


def glb(path: Path, **changes) -> Path:
    """Write a box on a named node; changes are of `mesh`, `node` or `material`."""
    box = trimesh.creation.box((1, 2, 3))
    box.vertices += changes.get("shift", 0.0)
    scene = trimesh.Scene()
    scene.add_geometry(
        box, node_name=changes.get("node", "arm"), geom_name="box", transform=changes.get("T", np.eye(4))
    )
    path.write_bytes(scene.export(file_type="glb"))
    return path


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"shift": [0, 0, 0.01]}, "'POSITION' differs in"),
        ({"node": "hand"}, "node 'hand' is not in a new export"),
        ({"T": trimesh.transformations.translation_matrix([0, 0, 1])}, "matrix"),
    ],
)
def test_a_change_in_a_glb_is_named(changes, text, tmp_path):
    found = told(glb(tmp_path / "r.glb"), glb(tmp_path / "s.glb", **changes))
    assert [f for f in found if text in f.text], found


def test_a_glb_with_other_numbers_of_its_parts_has_no_difference(tmp_path):
    """Two vertices instead of one that three faces share: the triangles are the same."""
    reference = glb(tmp_path / "r.glb")
    box = trimesh.creation.box((1, 2, 3))
    apart = trimesh.Trimesh(
        box.vertices[box.faces.ravel()], np.arange(3 * len(box.faces)).reshape(-1, 3), process=False
    )
    scene = trimesh.Scene()
    scene.add_geometry(apart, node_name="arm", geom_name="box", transform=np.eye(4))
    (tmp_path / "s.glb").write_bytes(scene.export(file_type="glb"))
    assert not [f for f in told(reference, tmp_path / "s.glb") if "POSITION" in f.text]


@pytest.mark.parametrize(
    ("name", "text", "new", "words"),
    [
        ("r.csv", "# rate: 20\ntime_s,q1_m\n0,.1\n1,.2\n", ("20", "30"), "'rate' is '30'"),
        ("r.csv", "# rate: 20\ntime_s,q1_m\n0,.1\n1,.2\n", (".2", ".3"), "'column q1_m' is (0.1, 0.3)"),
        ("r.txt", "metres\nradians\n", ("radians", "degrees"), "'text' is 'degrees'"),
        ("r.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ("v 1 0 0", "v 2 0 0"), "'corners of the triangles' differs"),
        ("r.json", '{"a": {"b": 1}}', ("1", "2"), "'b' is 2; in a new export it is 1"),
    ],
)
def test_a_change_in_text_is_named(name, text, new, words, tmp_path):
    for folder in ("reference", "audited"):
        (tmp_path / folder).mkdir()
    (tmp_path / "reference" / name).write_text(text)
    (tmp_path / "audited" / name).write_text(text.replace(*new))
    first, of_all = ledgers(tmp_path / "audited", tmp_path / "reference")
    assert first.file == name
    assert words in first.findings[0].message
    assert of_all.checks[0].worst == 1.0
    assert of_all.checks[0].verdict == "disagree"


@pytest.mark.parametrize(("rpy", "count"), [("-3.14159265 -0 0", 0), ("0 3.14159265 3.14159265", 0), ("3 0 0", 1)])
def test_other_angles_of_the_same_rotation_are_no_difference(rpy, count, tmp_path):
    for name, angles in (("r", "3.14159265 0 0"), ("s", rpy)):
        (tmp_path / f"{name}.urdf").write_text(f"<robot><origin rpy='{angles}'/></robot>")
    assert len(told(tmp_path / "r.urdf", tmp_path / "s.urdf")) == count


@pytest.mark.parametrize(
    ("root", "expected"), [("robot", []), ("mujoco", ["joint 'b' stands where a new export has 'a'"])]
)
def test_the_order_of_named_elements_is_compared_where_it_says_something(root, expected, tmp_path):
    (tmp_path / "r.xml").write_text(f"<{root}><joint name='a'/><joint name='b'/></{root}>")
    (tmp_path / "s.xml").write_text(f"<{root}><joint name='b'/><joint name='a'/></{root}>")
    assert [f.text for f in told(tmp_path / "r.xml", tmp_path / "s.xml")] == expected


def test_xml_that_a_program_rejects_is_compared_and_a_layer_that_cannot_be_read_is_not(tmp_path):
    for folder, mass in (("reference", "1"), ("audited", "-1")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "r.xml").write_text(f"<mujoco><body mass='{mass}'/></mujoco>")
        (tmp_path / folder / "r.usda").write_text(f"#usda 1.0 {mass}")
    told = list(compare_with_reference(tmp_path / "audited", tmp_path / "reference", {"r.xml", "r.usda"}))
    assert [ledger.file for ledger in told] == ["r.xml", "1 file"]
    assert "'mass' is -1" in told[0].findings[0].message


@pytest.mark.parametrize(("readme", "expected"), [(True, ["tracks/a.csv"]), (False, [])])
def test_a_file_that_a_whole_export_lacks_is_named(readme, expected, tmp_path):
    for name in ("README.txt", "proof.json", "a.urdf", "tracks/a.csv"):
        file = tmp_path / "reference" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("<m/>")
    (tmp_path / "audited").mkdir()
    shutil.copy(tmp_path / "reference/a.urdf", tmp_path / "audited")
    if readme:
        shutil.copy(tmp_path / "reference/README.txt", tmp_path / "audited")
    told = ledgers(tmp_path / "audited", tmp_path / "reference")
    assert [ledger.file for ledger in told if ledger.findings] == expected


def test_entities_are_not_expanded(tmp_path):
    for folder, text in (("reference", "<m/>"), ("audited", '<!DOCTYPE m [<!ENTITY a "b">]><m>&a;</m>')):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "r.xml").write_text(text)
    first = ledgers(tmp_path / "audited", tmp_path / "reference")[0]
    assert [f.severity for f in first.findings] == ["error"]


def test_scenery_may_be_added(tmp_path):
    for folder, added in (("reference", ""), ("audited", "<camera name='c'/><light/><geom type='plane'/>")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "r.xml").write_text(f"<m><geom type='box'/>{added}</m>")
    (finding,) = [f for ledger in ledgers(tmp_path / "audited", tmp_path / "reference") for f in ledger.findings]
    assert finding.severity == "info"
    assert "not checked: 3 entries (geom 2, camera 'c', light)" in finding.message


@pytest.mark.parametrize(("name", "count"), [("r.cs", 5), ("r.yaml", 0)])
def test_a_text_of_something_else_is_named_and_a_yaml_on_other_lines_is_not(name, count, tmp_path):
    for folder, text in (("reference", "abcdefgh"), ("audited", "ijklmnop")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text("\n".join(text))
    first = ledgers(tmp_path / "audited", tmp_path / "reference")[0]
    assert len([f for f in first.findings if f.severity == "disagreement"]) == count


def test_a_file_that_another_program_has_structured_anew_is_not_compared(tmp_path):
    for folder in ("reference", "audited"):
        (tmp_path / folder).mkdir()
    (tmp_path / "reference/r.xml").write_text("<m><a x='1'/><b/><c/><d/></m>")
    (tmp_path / "audited/r.xml").write_text("<m><a y='1'/><e/><f/><g/></m>")
    (first, _) = ledgers(tmp_path / "audited", tmp_path / "reference")
    assert [(f.code, f.severity) for f in first.findings] == [("export.rewritten", "info")]


# --------------------------------------------------------------------------------------------------- a built-in robot


@pytest.fixture(scope="module")
def hibou(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("hibou") / "export"
    twin.export("hibou", out=folder)
    (folder / "proof.json").unlink()
    return folder


def replaced(file: Path, old: str, new: str) -> None:
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), "utf-8")


def of_fields(report) -> list[str]:
    """Return "place: message" of the findings of the comparison with a new export."""
    return [f"{f.where}: {f.message}" for f in report.findings if f.code.startswith("export.")]


@pytest.mark.slow
@pytest.mark.parametrize("robot", [None, "hibou"])
def test_an_untouched_export_is_equal_to_a_new_one(hibou, robot):
    report = twin.audit(hibou, robot)
    assert not of_fields(report)
    (check,) = (check for check in report.checks if check.against == "a new export")
    assert check.worst == 0.0
    assert int(check.file.split()[0]) > 100


@pytest.mark.slow
@pytest.mark.parametrize(("to", "protocols"), [("glb,urdf", ()), ("tracks,usdz", None), ("mjcf", ["cavity"])])
def test_an_untouched_export_of_some_formats_is_equal_to_a_new_one(to, protocols, tmp_path):
    twin.export("hibou", to=to, out=tmp_path / "export", protocols=protocols)
    for robot in (None, "hibou"):
        assert not of_fields(twin.audit(tmp_path / "export", robot))


SEEDS = {
    "hibou.urdf": ('<material name="', '<material name="x', "material 'x"),
    "hibou.xml": ('iterations="100"', 'iterations="10"', "option"),
    "hibou.yaml": ("closed_loop", "closed_loops", "line 2"),
    "tracks/cavity.csv": ("# rate: ", "# rate: 1", "'rate'"),
    "usd/hibou_sim.usda": ("gravityMagnitude = 9.8", "gravityMagnitude = 9.7", "gravityMagnitude"),
    "unity/Runtime/Frames.cs": ("public static", "internal static", "line "),
    "unity/Runtime.meta": ("guid: ", "guid: 0", "line 2"),
    "README.txt": ("- Metres", "- Inches", "line "),
}
"""{file: (text, what replaces it, what the finding names)}."""


@pytest.mark.slow
def test_every_seed_is_named_without_the_robot(hibou, tmp_path):
    folder = tmp_path / "export"
    shutil.copytree(hibou, folder)
    for file, (old, new, _) in SEEDS.items():
        replaced(folder / file, old, new)
    findings = of_fields(twin.audit(folder))
    for file, (_, _, place) in SEEDS.items():
        assert [text for text in findings if text.startswith(file) and place in text], (file, findings)


@pytest.mark.parametrize(
    ("clips", "expected"),
    [
        (["table2", "r_table2", "r_ar"], ["table2"]),
        (["table2", "low", "r_sim"], ["low", "table2"]),
        (["table2", "own"], ["table2"]),
        ([], []),
    ],
)
def test_the_protocols_of_clips(clips, expected):
    assert played_protocols(clips, ["low", "table2"]) == expected


@pytest.mark.parametrize(
    ("clip_formats", "expected"),
    [
        ({"low": ["tracks", "glb"], "r_low": ["usd"], "r_ar": ["usdz"], "r_sim": ["usd"]}, ""),
        ({"low": ["tracks", "glb"], "own": ["tracks", "glb"], "r_own": ["usd"]}, "own"),
        ({"low": ["tracks", "glb"], "own": ["glb"]}, ""),  # renamed in one format
        ({"own": ["glb"]}, "own"),
        ({}, ""),
    ],
)
def test_a_clip_that_was_renamed_in_one_format_is_no_protocol_of_its_own(clip_formats, expected):
    assert clip_of_no_protocol(clip_formats, ["low", "table2"], "r") == expected


@pytest.mark.slow
@pytest.mark.parametrize("robot", [None, "hibou"])
def test_a_second_change_is_named_beside_a_renamed_clip(robot, hibou, tmp_path):
    folder = tmp_path / "export"
    shutil.copytree(hibou, folder)
    glb_file = folder / "hibou.glb"
    data = glb_file.read_bytes()
    assert data.count(b'"cavity"') == 1
    glb_file.write_bytes(data.replace(b'"cavity"', b'"gavity"'))
    replaced(folder / "README.txt", "- Metres", "- Inches")
    findings = of_fields(twin.audit(folder, robot))
    assert [text for text in findings if "'gavity'" in text]
    assert [text for text in findings if text.startswith("README.txt")]


@pytest.mark.slow
def test_an_export_with_a_protocol_that_the_robot_does_not_have_is_not_compared_and_says_so(hibou, tmp_path):
    for file in (hibou / "hibou.glb", *hibou.glob("tracks/*.*")):
        own = tmp_path / "export" / file.relative_to(hibou).parent / file.name.replace("cavity", "gavity")
        own.parent.mkdir(parents=True, exist_ok=True)
        own.write_bytes(file.read_bytes().replace(b"cavity", b"gavity"))
    (finding,) = of_fields(twin.audit(tmp_path / "export"))
    assert "'gavity' has the name of no protocol of hibou" in finding


@pytest.mark.slow
def test_a_spoilt_file_is_a_disagreement_and_not_said_to_have_other_names(hibou, tmp_path):
    folder = tmp_path / "export"
    shutil.copytree(hibou, folder)
    table = folder / "tracks/cavity.csv"
    lines = table.read_text("utf-8").splitlines(keepends=True)
    table.write_text("".join([*lines[:-50], lines[-51], *lines[-50:]]), "utf-8")  # a row is there twice
    report = twin.audit(folder, "hibou")
    assert report.verdict == "disagree"
    assert not [finding for finding in report.findings if finding.code == "audit.not_compared"]
    assert [finding for finding in report.findings if finding.code == "tracks.times"]


@pytest.mark.slow
def test_a_single_file_is_compared_by_its_suffix(hibou, tmp_path):
    file = tmp_path / "renamed.urdf"
    shutil.copy(hibou / "hibou.urdf", file)
    shutil.copytree(hibou / "meshes", tmp_path / "meshes")
    shutil.copy(hibou / "hibou.yaml", tmp_path / "renamed.yaml")
    replaced(file, '<material name="', '<material name="x')
    assert [text for text in of_fields(twin.audit(file, "hibou")) if "material 'x" in text]


@pytest.mark.slow
@pytest.mark.parametrize("why", ["another mechanism", "another version", "other keys", "another rest pose"])
def test_what_is_no_export_of_the_robot_is_not_compared(why, hibou, tmp_path):
    folder = tmp_path / "export"
    if why == "other keys":
        twin.export("hibou", out=folder, to="tracks,urdf", budget=ClipAccuracy(position=1e-6))
    elif why == "another rest pose":
        export_scene(Path("cad/davinci/scene.toml"), tmp_path / "scene", ["urdf", "glb"])
        robot = next(path.parent for path in sorted((tmp_path / "scene").glob("*/README.txt")))
        robot.rename(folder)
    else:
        shutil.copytree(hibou, folder)
        for file in folder.rglob("*"):
            if file.suffix in (".json", ".csv", ".glb", ".usda", ".cs") and why == "another mechanism":
                data = file.read_bytes()
                start = data.find(b"sha256:")
                if start >= 0:
                    file.write_bytes(data.replace(data[start : start + 71], b"sha256:" + b"0" * 64))
        if why == "another version":
            replaced(folder / "README.txt", f"twin {twin.__version__}", "twin 0.0.1")
    checks = twin.audit(folder).checks
    assert not [check for check in checks if check.against == "a new export"]
