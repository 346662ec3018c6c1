"""What an exported file declares is compared field by field: control maps, loops, transmissions, scripts."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from pxr import Gf, Sdf

from made.bundle import grave, write_good
from twin.core.provenance import Parameter
from twin.exchange.audit import audit
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.parameter_claims import PARAMETERS, compare_parameters
from twin.exchange.audit.reader_context import Context
from twin.exchange.formats.mjcf.audit import read_mujoco
from twin.exchange.formats.unity.audit import check_package
from twin.exchange.formats.unity.audit import read as read_unity
from twin.exchange.formats.unity.audit.shipped_files import PACKAGE
from twin.exchange.formats.urdf.audit import Urdf


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_good(tmp_path_factory.mktemp("good") / "bars")


def edited(good: Path, folder: Path, name: str, pattern: str, new) -> Path:
    """Return the path of a copy of a file of the bundle in which the first match of a pattern is replaced."""
    shutil.copytree(good / "meshes", folder / "meshes")
    text, count = re.subn(pattern, new, (good / name).read_text(), count=1)
    assert count == 1
    (folder / name).write_text(text)
    return folder / name


def ranged(text: str) -> str:
    """Return a range with its sign changed, made asymmetric: the negative of a symmetric range is the range itself."""
    low, high = map(float, text.split())
    return f"{-high - 0.3} {-low + 0.3}"


CONTROLS = (
    (r'gainprm="([^"]+)"', lambda m: f'gainprm="{float(m[1].split()[0]) / 57.3}"', "mjcf.control"),
    (r'gainprm="([^"]+)"', lambda m: f'gainprm="{float(m[1].split()[0]) * 57.3}"', "mjcf.control"),
    (r'ctrlrange="([^"]+)"', lambda m: f'ctrlrange="{ranged(m[1])}"', "mjcf.control"),
    (r'(<connect [^>]*)solref="[^"]+"', lambda m: f'{m[1]}solref="0.02 1"', "mjcf.softness"),
    (r'(<connect [^>]*)solimp="[^"]+"', lambda m: f'{m[1]}solimp="0.9 0.95 0.001 0.5 2"', "mjcf.softness"),
)


@pytest.mark.parametrize(("pattern", "new", "code"), CONTROLS)
def test_a_wrong_control_map_or_a_soft_loop_of_an_mjcf_is_found(pattern, new, code, good, tmp_path):
    if not re.search(pattern, (good / "bars.xml").read_text()):
        pytest.fail(f"the MJCF of the bundle has no {pattern}")
    file = edited(good, tmp_path, "bars.xml", pattern, new)
    assert code in {f.code for f in grave(audit(file).findings)}


SOFT = (
    ("both", r'solref="[^"]+" solimp="[^"]+"', 'solref="0.02 1" solimp="0.9 0.95 0.001 0.5 2"', 4.4e-4),
    ("time constant", r'solref="[^"]+"', 'solref="0.02 1"', 3.9e-7),
    ("impedance", r'solimp="[^"]+"', 'solimp="0.9 0.95 0.001 0.5 2"', 4.4e-6),
)


@pytest.mark.parametrize(("pattern", "new", "opening"), [s[1:] for s in SOFT], ids=[s[0] for s in SOFT])
def test_loops_that_are_all_soft_are_found_and_their_opening_is_computed(pattern, new, opening, good, tmp_path):
    text, count = re.subn(pattern, new, (good / "bars.xml").read_text())
    assert count >= 2
    shutil.copytree(good / "meshes", tmp_path / "meshes")
    shutil.copytree(good / "usd", tmp_path / "usd")
    (tmp_path / "bars.xml").write_text(text)
    found = [f for f in grave(audit(tmp_path).findings) if f.code == "physics.opening"]
    assert [f.where for f in found] == ["bars.xml: the loops"]
    assert found[0].size == pytest.approx(opening, rel=0.05)
    # A comment of an export states with which parameters its loops stay closed; a file of others has no such comment.
    claims = {f.code for f in audit(tmp_path / "bars.xml").findings if f.severity == "disagreement"}
    assert claims == {"mjcf.claim"}
    (tmp_path / "bars.xml").write_text(re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))
    alone = [f for f in audit(tmp_path / "bars.xml").findings if f.severity == "disagreement"]
    assert not alone  # a file of others may have the defaults of MuJoCo


def pin_points(root: ET.Element) -> tuple[ET.Element, np.ndarray]:
    """Return a <connect> of a pin, and the vector (3,) in m from its anchor to that of the other <connect>."""
    one, two = root.findall("equality/connect")[:2]
    assert one.get("body1") == two.get("body1")
    assert one.get("body2") == two.get("body2")
    a, b = (np.array(str(c.get("anchor")).split(), float) for c in (one, two))
    return one, b - a


@pytest.mark.parametrize(("share", "codes"), [(0.01, set()), (0.995, {"physics.kind"})])
def test_an_anchor_moved_along_its_pin_does_no_harm_until_the_points_of_the_pin_meet(share, codes, good, tmp_path):
    """Two points hold the line through them, wherever they are on it; only when they meet they hold a point."""
    shutil.copytree(good / "meshes", tmp_path / "meshes")
    shutil.copytree(good / "usd", tmp_path / "usd")
    right = mujoco.MjModel.from_xml_path(str(good / "bars.xml"))
    root = ET.fromstring((good / "bars.xml").read_bytes())
    connect, along = pin_points(root)
    anchor = np.array(str(connect.get("anchor")).split(), float) + share * along
    connect.set("anchor", " ".join(map(repr, anchor.tolist())))
    (tmp_path / "bars.xml").write_bytes(ET.tostring(root))
    assert {f.code for f in grave(audit(tmp_path).findings)} == codes
    if not codes:  # MuJoCo closes the loop at the same states
        moved = mujoco.MjModel.from_xml_path(str(tmp_path / "bars.xml"))
        one, two = (free_velocity(model) for model in (right, moved))
        assert abs(one @ two) == pytest.approx(1, abs=1e-9)


def free_velocity(model: mujoco.MjModel) -> np.ndarray:
    """Return the velocity (nv,) of size 1 that the closed loop allows at the start."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-9
    rows = np.zeros((data.nefc, model.nv))
    for k in range(data.nefc):
        force = np.zeros(data.nefc)
        force[k] = 1.0
        mujoco.mj_mulJacTVec(model, data, rows[k], force)
    return np.linalg.svd(rows)[2][-1]


def usd_edited(good: Path, folder: Path, change) -> set[tuple[str, str, str]]:
    """Return {(severity, code, subject)} of an audit after an edit of the geometry layer, with and without its MJCF."""
    for part in ("meshes", "usd"):
        shutil.copytree(good / part, folder / part)
    shutil.copy(good / "bars.xml", folder / "bars.xml")
    file = folder / "usd/geometry.usdc"
    layer = Sdf.Layer.OpenAsAnonymous(str(file))
    found: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
    change(layer, [layer.GetPrimAtPath(p) for p in found if p.IsPrimPath()])
    file.unlink()
    layer.Export(str(file))
    told = grave(audit(folder).findings)
    return {(f.severity, f.code, f.where.partition(": ")[2]) for f in told}


def mark(prims, kind: str, name: str):
    for prim in prims:
        told = prim.attributes.get("twin:kind")
        if told is not None and told.default == kind and name in prim.name:
            return prim
    raise AssertionError(name)


def frame_inactive(layer, prims):
    mark(prims, "frame", "tool").SetInfo("active", False)


def point_inactive(layer, prims):
    mark(prims, "point", "marker").SetInfo("active", False)


def point_moved(layer, prims):
    translate = mark(prims, "point", "marker").attributes["xformOp:translate"]
    translate.default = translate.default + Gf.Vec3d(0, 0.02, 0)


def stray_shape(layer, prims):
    prim = Sdf.CreatePrimInLayer(layer, "/bars/stray")
    prim.specifier = Sdf.SpecifierDef
    prim.typeName = "Cube"


def binding_lost(layer, prims):
    mesh = next(p for p in prims if "material:binding" in p.relationships)
    del mesh.properties["material:binding"]


MARKS = (
    (frame_inactive, "disagreement", "physics.existence", "frame 'tool'"),
    (point_inactive, "disagreement", "physics.existence", "point 'marker'"),
    (point_moved, "disagreement", "physics.point", "point 'marker'"),
    (stray_shape, "warning", "usd.stray", "/bars/stray"),
    (binding_lost, "warning", "usd.no_material", None),
)


@pytest.mark.parametrize(("change", "severity", "code", "subject"), MARKS, ids=lambda v: getattr(v, "__name__", ""))
def test_frames_points_stray_shapes_and_lost_materials_of_a_stage_are_found(
    change, severity, code, subject, good, tmp_path
):
    told = usd_edited(good, tmp_path, change)
    assert {(severity, code)} == {(s, c) for s, c, _ in told}
    if subject is not None:
        assert {where for _, _, where in told} == {subject}


def driven_urdf(good: Path, folder: Path, change) -> set[str]:
    """Return the codes of an audit of stages and URDF, after an edit of the URDF's text; without its YAML."""
    for part in ("meshes", "usd"):
        shutil.copytree(good / part, folder / part)
    text = (good / "bars.urdf").read_text()
    (folder / "bars.urdf").write_text(change(text))
    return {f.code for f in grave(audit(folder).findings)}


TRANSMISSIONS = (
    ("untouched", lambda t: t, set()),
    ("deleted", lambda t: re.sub("<transmission .*?</transmission>", "", t, flags=re.DOTALL), {"urdf.transmission"}),
    ("reduction", lambda t: t.replace("<mechanicalReduction>1<", "<mechanicalReduction>50<"), {"physics.reduction"}),
    (
        "of a passive joint",
        lambda t: t.replace(
            "</robot>", TRANSMISSION.format("more", re.findall(r'<joint name="([^"]+)" type="revolute"', t)[1], "m")
        ),
        {"physics.driven", "physics.reduction", "physics.existence"},
    ),
)


@pytest.mark.parametrize(("change", "codes"), [t[1:] for t in TRANSMISSIONS], ids=[t[0] for t in TRANSMISSIONS])
def test_transmissions_of_a_urdf_are_compared_as_sets_of_joint_actuator_reduction(change, codes, good, tmp_path):
    found = driven_urdf(good, tmp_path, change)
    assert found <= codes
    assert bool(found) == bool(codes)


TRANSMISSION = """<transmission name="{0}"><type>transmission_interface/SimpleTransmission</type>
<joint name="{1}"/><actuator name="{2}"><mechanicalReduction>1</mechanicalReduction></actuator>
</transmission></robot>"""


def test_a_swapped_transmission_of_a_urdf_is_found(good, tmp_path):
    text = re.sub("<transmission.*?</transmission>", "", (good / "bars.urdf").read_text(), flags=re.DOTALL)
    names = re.findall(r'<joint name="([^"]+)" type="revolute"', text)
    found = {}
    for case, joint in (("right", names[0]), ("wrong", names[1])):
        folder = tmp_path / case
        shutil.copytree(good / "meshes", folder / "meshes")
        file = folder / "bars.urdf"
        file.write_text(text.replace("</robot>", TRANSMISSION.format("drive", joint, names[0])))
        found[case] = {f.code for f in grave(audit(file).findings)}
    assert found == {"right": set(), "wrong": {"urdf.transmission"}}


def faults(folder: Path) -> list[str]:
    ledger = Ledger("unity")
    check_package(folder, ledger)
    return [f.where for f in ledger.findings if f.code == "unity.shipped"]


def test_scripts_of_the_unity_package_are_those_that_twin_ships(tmp_path):
    folder = tmp_path / "unity"
    shutil.copytree(PACKAGE, folder)
    assert not faults(folder)
    scripts = sorted(folder.rglob("*.cs"))
    for script in scripts[::7]:
        text = script.read_bytes()
        brace = text.rindex(b"}")
        script.write_bytes(text[:brace] + text[brace + 1 :])
        assert faults(folder) == [f"unity: {script.relative_to(folder).as_posix()}"]
        script.write_bytes(text.replace(b"\n", b"\r\n"))
        assert not faults(folder)


def test_another_layout_of_json_in_the_unity_package_is_no_fault(tmp_path):
    folder = tmp_path / "unity"
    shutil.copytree(PACKAGE, folder)
    for file in (*folder.rglob("*.json"), *folder.rglob("*.asmdef")):
        file.write_text(json.dumps(json.loads(file.read_text("utf-8")), indent=7), "utf-8")
    assert not faults(folder)


def test_points_of_a_mesh_are_moved_turned_and_scaled_as_mujoco_does(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
    (tmp_path / "a.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    mesh = '<mesh name="a" file="a.obj" refpos="0.3 -0.2 0.5" refquat="0.5 0.1 -0.7 0.3" scale="2 3 0.5"/>'
    body = '<body name="b"><freejoint/><geom type="mesh" mesh="a" quat="1 2 0 0" pos="0.1 0 0"/></body>'
    path = tmp_path / "a.xml"
    path.write_text(f"<mujoco><asset>{mesh}</asset><worldbody>{body}</worldbody></mujoco>")
    file = read_mujoco(path, Ledger("a.xml"))
    data = mujoco.MjData(file.model)
    mujoco.mj_kinematics(file.model, data)
    shown = file.model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    shape = file.shapes["b"].points
    for own, other in ((shape, shown), (shown, shape)):
        assert np.linalg.norm(own[:, None] - other, axis=2).min(axis=1).max() < 1e-6


def test_a_turned_shape_is_found_whatever_form_its_rotation_has(good, tmp_path):
    edited(good, tmp_path, "bars.xml", '(<geom [^>]*mesh="[^"]*")( quat="[^"]*")?', r'\1 axisangle="1 0 0 0.1"')
    shutil.copytree(good / "usd", tmp_path / "usd")
    codes = {finding.code for finding in audit(tmp_path).findings}
    assert codes & {"compare.shape", "physics.surface"}


@pytest.mark.parametrize(("motors", "found"), [('"a", "b", "c"', []), ('"a", "c", "b"', ["urdf.driven_order"])])
def test_the_driven_joints_of_a_closure_yaml_have_the_order_of_the_transmissions(motors, found, tmp_path):
    robot = ET.Element("robot", name="made")
    ET.SubElement(robot, "link", name="base")
    for name in ("a", "b", "c"):
        ET.SubElement(robot, "link", name=f"link_{name}")
        joint = ET.SubElement(robot, "joint", name=name, type="continuous")
        ET.SubElement(joint, "parent", link="base")
        ET.SubElement(joint, "child", link=f"link_{name}")
        ET.SubElement(ET.SubElement(robot, "transmission", name=f"t_{name}"), "joint", name=name)
    ET.ElementTree(robot).write(tmp_path / "made.urdf")
    (tmp_path / "made.yaml").write_text(f"closed_loop: []\ntype: []\nname_mot: [{motors}]\n")
    ledger = Ledger("made.urdf")
    Urdf(tmp_path / "made.urdf", ledger)
    assert [f.code for f in ledger.found if f.code.startswith("urdf.driven")] == found


LENGTH = {"value": 0.33, "shown": 330.0, "unit": "mm", "provenance": "ASSUMED", "note": "not printed: see the table"}


def told(content: Content) -> list[str]:
    return [f.message for f in content.ledger.found if f.code == "claims.parameter"]


@pytest.mark.parametrize(
    ("change", "field"),
    [({}, ""), ({"provenance": "CITED"}, "provenance"), ({"unit": "m"}, "unit"), ({"shown": 331.0}, "number")],
)
def test_parameters_of_a_stage_are_those_that_other_files_and_the_robot_assume(change, field):
    stage = Content(Ledger("arm.usda"), "usda", stated={"robot": "arm"}, extra={PARAMETERS: {"reach": LENGTH | change}})
    assumed = ["reach = 330 mm: not printed: see the table", "speed = 2 m/s: unhurried"]
    track = Content(Ledger("swing.json"), "tracks", extra={"data": {"assumed": assumed}})
    compare_parameters([stage, track], "arm", [Parameter("reach", 0.33, "mm", 330.0, "ASSUMED", "not printed")])
    compare_parameters([stage], "leg", [Parameter("reach", 0.9, "mm", 900.0, "CITED", "another robot")])
    assert len(told(stage)) == (2 if field else 0)
    assert all(field in message for message in told(stage))


def test_a_package_beside_the_tracks_of_a_robot_has_its_class_or_a_reason(tmp_path):
    package = tmp_path / "unity"
    package.mkdir()
    (package / "package.json").write_text((PACKAGE / "package.json").read_text())
    track = Content(Ledger("tracks/swing.json"), "tracks", stated={"robot": "arm"})

    def lacks_class(context: Context) -> bool:
        ledger = Ledger("unity")
        read_unity(package, ledger, context)
        return any(f.code == "unity.no_kinematics" for f in ledger.found)

    assert lacks_class(Context(tracks=[track]))
    assert not lacks_class(Context())
    (tmp_path / "README.txt").write_text("arm: an arm")
    assert not lacks_class(Context(tracks=[track]))
