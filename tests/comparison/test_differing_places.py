"""Robots with loops: joints that formats write as several, other cuts, and links that differ."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pxr import Usd

import twin
from made.lanes import robots
from made.mechanisms import four_bar
from twin.comparison.mechanism_side import from_mechanism
from twin.comparison.merged_joints import with_merged_joints
from twin.comparison.pair import compare_pair
from twin.comparison.recut import with_tree_of
from twin.comparison.side import Axis, RobotSide
from twin.comparison.side_pair import SidePair
from twin.core import assets
from twin.core.spatial import Array
from twin.exchange.formats.mjcf.write import write_mjcf
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.formats.usd.write import write_usd
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close

TOLERANCE = 1e-5

SHIFT = np.array([0.0003, 0.0004, 0.0])
"""Change of a position in m: 0.5 mm."""

TILT = np.radians(0.5)
"""Change of a direction in rad."""


def side_of(file: Path) -> RobotSide:
    if file.suffix == ".usda":
        return from_mechanism(twin.load(file).mechanism, file.name)
    imported = read(file, guarded=False)
    mechanism = imported.mechanism
    if mechanism.loops:
        mechanism = close(imported).mechanism
    return from_mechanism(mechanism, file.name, path=file)


def located(pair: SidePair) -> str:
    """Return all texts that say where two robots differ, ties as well."""
    texts = [item.text for item in pair.differences]
    for tie in pair.ties:
        texts += tie
    return " ".join(texts)


def tilted(text: str) -> Array:
    """Return a direction (3,) that is turned by `TILT`."""
    axis = np.array([float(number) for number in text.split()])
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    return np.cos(TILT) * axis + np.sin(TILT) * across


def shifted(text: str) -> Array:
    return np.array([float(number) for number in text.split()]) + SHIFT


def with_number(file: Path, element: Callable[[ET.Element], ET.Element], attribute: str, new: Array) -> Path:
    """Change an attribute of one element of an XML file."""
    tree = ET.parse(file)
    element(tree.getroot()).set(attribute, " ".join(repr(float(value)) for value in new))
    tree.write(file)
    return file


# -- one concept each ---------------------------------------------------------------------------------


def test_two_points_that_close_a_loop_are_a_hinge(tmp_path: Path) -> None:
    mechanism = four_bar()
    first = side_of(write_mjcf(mechanism, tmp_path))
    second = from_mechanism(mechanism, "drawn")
    assert {axis.kind for axis in first.axes if axis.closes_loop} == {"spherical"}
    (closing,) = [axis for axis in with_merged_joints(first, second, TOLERANCE).axes if axis.closes_loop]
    assert closing.kind == "revolute"
    assert closing.name in [axis.name for axis in second.axes]
    pair = compare_pair(first, second, TOLERANCE)
    assert (pair.kinematics, pair.items) == ("agree", ())


BALL = """<mujoco><worldbody><body name="base"><body name="arm" pos="0 0 0.3">
<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/><joint name="shoulder" type="ball"/>
<body name="hand" pos="0.1 0 {length}"><inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
<joint name="wrist" axis="0 1 0"/></body></body></body></worldbody></mujoco>"""


def three_hinges(file: Path, *, apart: float = 0.0) -> Path:
    """Write a URDF with three hinges through one point, or apart, instead of a ball."""
    inertial = '<inertial><origin xyz="0 0 0.1"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" '
    inertial += 'ixy="0" ixz="0" iyz="0"/></inertial>'
    links = ["base", "shoulder_x_axis", "shoulder_y_axis", "arm", "hand"]
    joints = [
        ("shoulder_x", "0 0 0.3", "1 0 0"),
        ("shoulder_y", f"0 0 {apart}", "0 1 0"),
        ("shoulder_z", "0 0 0", "0 0 1"),
        ("wrist", "0.1 0 0.2", "0 1 0"),
    ]
    lines = ['<robot name="arm">']
    for link in links:
        lines.append(f'<link name="{link}">{inertial if link in ("arm", "hand") else ""}</link>')
    for parent, child, (name, xyz, axis) in zip(links[:-1], links[1:], joints, strict=True):
        lines.append(
            f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/></joint>'
        )
    file.write_text("\n".join([*lines, "</robot>"]), encoding="utf-8")
    return file


def test_three_hinges_through_one_point_are_a_ball(tmp_path: Path) -> None:
    ball = tmp_path / "ball.xml"
    ball.write_text(BALL.format(length=0.2), encoding="utf-8")
    hinges = three_hinges(tmp_path / "hinges.urdf")
    for pair in (twin.compare(ball, hinges).pairs[0], twin.compare(hinges, ball).pairs[0]):
        assert pair.agrees
        assert pair.differences == ()
    # both write hinges: nothing is joined
    pair = twin.compare(hinges, three_hinges(tmp_path / "same.urdf")).pairs[0]
    assert len(pair.first.axes) == 4


def test_three_hinges_that_do_not_meet_are_no_ball(tmp_path: Path) -> None:
    ball = tmp_path / "ball.xml"
    ball.write_text(BALL.format(length=0.2), encoding="utf-8")
    with pytest.raises(twin.TwinError, match="shoulder_x"):
        twin.compare(ball, three_hinges(tmp_path / "hinges.urdf", apart=0.001))


def test_a_length_behind_three_hinges_is_found_with_its_edit(tmp_path: Path) -> None:
    ball = tmp_path / "ball.xml"
    ball.write_text(BALL.format(length=0.23), encoding="utf-8")
    pair = twin.compare(ball, three_hinges(tmp_path / "hinges.urdf")).pairs[0]
    assert [item.joint for item in pair.differences] == ["wrist"]
    edits = {edit.file.rpartition("/")[2]: (edit.old, edit.new) for edit in pair.differences[0].edits}
    assert edits["hinges.urdf"] == ("0.2", "0.23")


def test_another_cut_and_another_parent_are_no_difference() -> None:
    side = from_mechanism(four_bar(), "drawn")
    (closing,) = [i for i, axis in enumerate(side.axes) if axis.closes_loop]
    axis = side.axes[closing]
    other = with_tree_of(side, side)
    assert other.axes == side.axes
    turned = [*side.axes]
    turned[closing] = type(axis)(
        **{**vars(axis), "parent": axis.child, "child": axis.parent, "direction": -axis.direction}
    )
    reversed_side = type(side)(**{**vars(side), "axes": tuple(turned)})
    again = with_tree_of(reversed_side, side).axes[closing]
    assert (again.parent, again.child) == (axis.parent, axis.child)
    np.testing.assert_array_equal(again.direction, axis.direction)


def cut_elsewhere(side: RobotSide, seed: int) -> RobotSide:
    """Return a side whose loops are cut at other joints, which have other names there, as an MJCF writes them."""
    rng = np.random.default_rng(seed)
    left = [side.axes[i] for i in rng.permutation(len(side.axes))]
    tree: list[Axis] = []
    reached = {0}
    while True:
        onward = [axis for axis in left if (axis.parent in reached) != (axis.child in reached)]
        if not onward:
            break
        left = [axis for axis in left if axis is not onward[0]]
        axis = onward[0]
        if axis.child in reached:
            axis = replace(axis, parent=axis.child, child=axis.parent, direction=-axis.direction)
        reached.add(axis.child)
        tree.append(replace(axis, closes_loop=False))
    closing = [replace(axis, closes_loop=True, name=f"equality_{k}") for k, axis in enumerate(left)]
    return replace(side, axes=(*tree, *closing), label="cut")


@pytest.mark.parametrize("name", robots(["lapbot"], slow=("davinci_psm", "hibou")))
def test_loops_that_are_cut_and_named_elsewhere_are_no_difference(name: str) -> None:
    side = drawn(name)
    sides = [cut_elsewhere(side, seed) for seed in range(3)]
    for other in sides:
        for first, second in ((other, side), (side, other)):
            pair = compare_pair(first, second, TOLERANCE)
            assert pair.agrees
            assert {item.kind for item in pair.items} <= {"name"}
    other = sides[-1]
    for i, axis in enumerate(other.axes):
        # the place of a hinge that one side calls otherwise
        if axis.closes_loop and axis.kind == "revolute":
            across = np.cross(axis.direction, np.eye(3)[int(np.argmin(np.abs(axis.direction)))])
            moved = replace(axis, point=axis.point + 0.0005 * across)
            spoiled = replace(other, axes=(*other.axes[:i], moved, *other.axes[i + 1 :]))
            assert compare_pair(spoiled, side, TOLERANCE).kinematics == "disagree"
            break


def test_a_joint_that_held_joints_lock_is_not_compared_alone() -> None:
    mechanism = four_bar()
    message = r"joint 'crank_joint' cannot move while .* to --only \(elbow, rocker_joint, closing\)"
    with pytest.raises(twin.TwinError, match=message):
        from_mechanism(mechanism, "drawn", only=["crank_joint"])
    # the loop is held at its fourth joint: the links of it are one
    side = from_mechanism(mechanism, "drawn", only=["crank_joint", "elbow", "rocker_joint"])
    assert [axis.closes_loop for axis in side.axes] == [False, False, True]
    assert ("coupler", "rocker") in [group.bodies for group in side.groups]


def _connect(root: ET.Element) -> ET.Element:
    return next(root.iter("connect"))


def test_a_loop_anchor_that_differs_is_located(tmp_path: Path) -> None:
    mechanism = four_bar()
    file = write_mjcf(mechanism, tmp_path)
    anchor = _connect(ET.parse(file).getroot())
    with_number(file, _connect, "anchor", shifted(anchor.get("anchor", "")))
    pair = compare_pair(from_mechanism(mechanism, "drawn"), side_of(file), TOLERANCE)
    assert pair.kinematics == "disagree"
    assert anchor.get("name", "").removesuffix("_0") in located(pair)


def test_the_edit_of_a_loop_anchor_is_named_with_its_line(tmp_path: Path) -> None:
    right = write_mjcf(four_bar(), tmp_path)
    anchor = _connect(ET.parse(right).getroot()).get("anchor", "")
    wrong = tmp_path / "wrong.xml"
    moved = " ".join(repr(float(value)) for value in shifted(anchor))
    text = right.read_text(encoding="utf-8")
    wrong.write_text(text.replace(f'anchor="{anchor}"', f'anchor="{moved}"', 1), encoding="utf-8")
    line = text[: text.index(f'anchor="{anchor}"')].count("\n") + 1
    (item,) = twin.compare(right, wrong).pairs[0].differences
    told = {edit.side: (edit.line, edit.what, numbers_of(edit.new)) for edit in item.edits}
    what = "equality connect 'closing_0' anchor"
    assert told["wrong.xml"] == (line, what, pytest.approx(numbers_of(anchor)))
    assert told[right.name] == (line, what, pytest.approx(numbers_of(moved)))


def three_slides(file: Path, *, shift: str = "0 0 0", turn: str = "1 0 0 0") -> Path:
    """Write an MJCF of an arm with two carriages on parallel rails; a weld ties one to a slide of the other."""
    file.write_text(
        f"""<mujoco><worldbody><body name="base">{BLOCK}
<body name="arm" pos="0.123 0.456 0.789">{BLOCK}<joint name="swing" axis="1 2 3" range="-3 3"/>
<body name="upper" pos="0.1 0 0">{BLOCK}<joint name="up" type="slide" range="-1 1"/>
<site name="seat" pos="-0.05 0 0"/></body>
<body name="lower">{BLOCK}<joint name="low" type="slide" range="-1 1"/>
<body name="rider" pos="0.05 0 0">{BLOCK}<joint name="middle" type="slide" range="-1 1"/>
<site name="foot" pos="{shift}" quat="{turn}"/></body></body></body></body></worldbody>
<equality><weld name="tie" site1="foot" site2="seat"/></equality>
<actuator><position joint="swing" kp="10"/><position joint="up" kp="10"/>
<position joint="low" kp="10"/></actuator></mujoco>""",
        encoding="utf-8",
    )
    return file


BLOCK = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'


@pytest.mark.parametrize("shift", ["0.0005 0 0", "0 0.0005 0"])
def test_a_shifted_weld_that_slides_cannot_take_up_is_found_with_its_size(shift: str, tmp_path: Path) -> None:
    right = side_of(three_slides(tmp_path / "right.xml"))
    wrong = side_of(three_slides(tmp_path / "wrong.xml", shift=shift))
    # what does not close moves nothing: the links stay where the file places them
    for body in ("arm", "upper", "lower", "rider"):
        np.testing.assert_allclose(wrong.frames[body][1], right.frames[body][1], atol=1e-9)
    for first, second in ((right, wrong), (wrong, right)):
        pair = compare_pair(first, second, TOLERANCE)
        assert pair.kinematics == "disagree"
        (item,) = pair.differences
        assert "joint 'tie' does not close the loop of joint 'middle'" in item.text
        assert item.shift == pytest.approx(0.0005, rel=1e-6)
    assert compare_pair(wrong, replace(wrong, label="again"), TOLERANCE).kinematics == "agree"


def test_a_turned_weld_is_found_and_a_shift_along_the_slides_is_taken_up(tmp_path: Path) -> None:
    right = side_of(three_slides(tmp_path / "right.xml"))
    # about the slides: no axis tilts
    turned = side_of(three_slides(tmp_path / "turned.xml", turn="0.99999 0 0 0.00447211"))
    (item,) = compare_pair(right, turned, TOLERANCE).differences
    assert "'tie'" in item.text
    assert item.turn == pytest.approx(2 * 0.00447211 / 0.99999, rel=1e-3)
    along = side_of(three_slides(tmp_path / "along.xml", shift="0 0 0.0005"))
    assert compare_pair(right, along, TOLERANCE).kinematics != "disagree"


def numbers_of(text: str) -> list[float]:
    return [float(number) for number in text.split()]


@pytest.mark.parametrize("place", ["localPos0", pytest.param("localPos1", marks=pytest.mark.slow)])
def test_the_edit_of_a_joint_frame_that_opens_a_loop_is_named_with_its_line(place: str, tmp_path: Path) -> None:
    (root,) = [file for file in write_usd(four_bar(), (), tmp_path) if file.name == "bars.usda"]
    right = tmp_path / "right.usda"
    Usd.Stage.Open(str(root)).Flatten().Export(str(right))
    text = right.read_text(encoding="utf-8")
    start = text.index(f"physics:{place} = (", text.index('Joint "closing"')) + len(f"physics:{place} = (")
    end = text.index(")", start)
    old = text[start:end].replace(",", "")
    moved = ", ".join(repr(float(value)) for value in shifted(old))
    wrong = tmp_path / "wrong.usda"
    wrong.write_text(text[:start] + moved + text[end:], encoding="utf-8")
    (item,) = twin.compare(right, wrong).pairs[0].differences
    (edit,) = item.edits
    assert (edit.side, edit.line) == ("wrong.usda", text[:start].count("\n") + 1)
    assert edit.what.endswith(f"closing>.physics:{place}")
    assert numbers_of(edit.new) == pytest.approx(numbers_of(old))


# -- every robot in every format ----------------------------------------------------------------------

AGREEING = robots([], slow=("hibou", "lapbot", "sils"))
SPOILABLE = robots([], slow=("sils",))
DEFECTS = ("length", "anchor", "axis")


@cache
def drawn(name: str) -> RobotSide:
    return from_mechanism(twin.load(name).weighed().mechanism, name)


def export(name: str, suffix: str, folder: Path) -> Path:
    """Return the file of a robot in a format: as the exporter writes it, or a copy of its stage."""
    if suffix == "usda":
        stages = assets.data_folder() / "usd" / name
        return Path(shutil.copytree(stages, folder / "usd")) / f"{name}.usda"
    mechanism = drawn(name).mechanism
    assert mechanism is not None
    write = write_mjcf if suffix == "xml" else write_urdf
    return write(replace(mechanism, bodies=tuple(replace(body, meshes=()) for body in mechanism.bodies)), folder)


@pytest.mark.parametrize("suffix", ["xml", "urdf", "usda"])
@pytest.mark.parametrize("name", AGREEING)
def test_each_export_agrees_with_its_robot(name: str, suffix: str, tmp_path: Path) -> None:
    pair = compare_pair(drawn(name), side_of(export(name, suffix, tmp_path)), TOLERANCE)
    # MJCF lists joints in the order of its tree
    assert {item.kind for item in pair.items} <= {"order"}
    assert pair.agrees
    assert pair.properties is not None
    for kind in ("limits", "masses", "centres of mass", "couplings"):
        assert pair.properties.verdict(kind) != "disagree"


def _spoiled_xml(file: Path, defect: str) -> str | None:
    root = ET.parse(file).getroot()
    if defect == "length":
        bodies = []
        for body in root.iter("body"):
            joint = body.find("joint")
            # where a slide begins is no length
            if joint is not None and joint.get("type", "hinge") == "hinge":
                bodies.append(body)
        found = bodies[len(bodies) // 2]
        name = next(found.iter("joint")).get("name", "")

        def element(root: ET.Element) -> ET.Element:
            return next(body for body in root.iter("body") if body.get("name") == found.get("name"))

        with_number(file, element, "pos", shifted(found.get("pos", "0 0 0")))
        return name
    if defect == "anchor" and root.find("equality/connect") is None:
        return _shifted_weld(file)
    tag, attribute = {"anchor": ("connect", "anchor"), "axis": ("joint", "axis")}[defect]
    names = [found.get("name", "") for found in root.iter(tag) if found.get(attribute)]
    if not names:
        return None
    name = names[len(names) // 2]
    found = next(found for found in root.iter(tag) if found.get("name") == name)
    change = tilted if defect == "axis" else shifted

    def named(root: ET.Element) -> ET.Element:
        return next(found for found in root.iter(tag) if found.get("name") == name)

    with_number(file, named, attribute, change(found.get(attribute, "")))
    return re.sub(r"_[01]$", "", name)


def _shifted_weld(file: Path) -> str | None:
    """Shift the site of a weld that closes a loop; return the name of the slide that the weld stands for."""
    welds = list(ET.parse(file).getroot().iter("weld"))
    if not welds:
        return None
    weld = welds[len(welds) // 2]

    def site(root: ET.Element) -> ET.Element:
        return next(found for found in root.iter("site") if found.get("name") == weld.get("site1"))

    old = site(ET.parse(file).getroot()).get("pos", "0 0 0")
    with_number(file, site, "pos", shifted(old))
    return re.sub(r"_0$", "", weld.get("name", ""))


def _spoiled_urdf(file: Path, defect: str) -> str | None:
    root = ET.parse(file).getroot()
    hinges = []
    for joint in root.findall("joint"):
        fixed = joint.get("type") == "fixed"
        name = joint.get("name", "")
        # a hinge of a ball tilts without an effect
        wanted = name.endswith("_b_fixed") if defect == "anchor" else not fixed and not re.search(r"_[xyz]$", name)
        if wanted and (defect != "length" or joint.get("type") in ("continuous", "revolute")):
            hinges.append(joint)
    if not hinges:
        return None
    found = hinges[len(hinges) // 2]
    name = found.get("name", "")
    tag = "axis" if defect == "axis" else "origin"

    def element(root: ET.Element) -> ET.Element:
        joint = next(joint for joint in root.findall("joint") if joint.get("name") == name)
        child = joint.find(tag)
        assert child is not None
        return child

    old = element(root).get("xyz", "0 0 0")
    with_number(file, element, "xyz", tilted(old) if defect == "axis" else shifted(old))
    return name.removesuffix("_b_fixed")


def _spoiled_stage(file: Path, defect: str) -> str | None:
    from pxr import Gf, Usd, UsdPhysics

    stage = Usd.Stage.Open(str(file))
    hinges = []
    closing_slides = []
    for prim in stage.Traverse():
        joint = UsdPhysics.Joint(prim)
        if not joint:
            continue
        closing = bool(joint.GetExcludeFromArticulationAttr().Get())
        if closing and prim.IsA(UsdPhysics.PrismaticJoint):
            closing_slides.append(joint)
        if prim.GetTypeName() not in ("PhysicsRevoluteJoint", "PhysicsSphericalJoint"):
            continue
        if closing == (defect == "anchor") and (defect == "anchor" or prim.IsA(UsdPhysics.RevoluteJoint)):
            hinges.append(joint)
    if defect == "anchor" and not hinges:
        hinges = closing_slides
    if not hinges:
        return None
    found = hinges[len(hinges) // 2]
    if defect == "axis":
        attribute = found.GetLocalRot0Attr()
        half = TILT / 2
        attribute.Set(attribute.Get() * Gf.Quatf(float(np.cos(half)), 0.0, float(np.sin(half)), 0.0))
    else:
        attribute = found.GetLocalPos0Attr()
        attribute.Set(attribute.Get() + Gf.Vec3f(*SHIFT.tolist()))
    stage.GetRootLayer().Save()
    return found.GetPrim().GetName()


SPOILED = {"xml": _spoiled_xml, "urdf": _spoiled_urdf, "usda": _spoiled_stage}


@pytest.mark.parametrize("defect", DEFECTS)
@pytest.mark.parametrize("suffix", ["xml", "urdf", "usda"])
@pytest.mark.parametrize("name", SPOILABLE)
def test_a_seeded_defect_is_found_and_located(name: str, suffix: str, defect: str, tmp_path: Path) -> None:
    file = export(name, suffix, tmp_path)
    joint = SPOILED[suffix](file, defect)
    if joint is None:
        assert defect == "anchor"
        assert not any(axis.closes_loop for axis in drawn(name).axes)
        return
    pair = compare_pair(drawn(name), side_of(file), TOLERANCE)
    assert pair.kinematics == "disagree"
    # the joint itself, or another joint on one of its links
    ends = {group for axis in pair.second.axes if axis.name == joint for group in (axis.parent, axis.child)}
    near = {axis.name for axis in pair.second.axes if not ends.isdisjoint((axis.parent, axis.child))}
    named = {item.joint for item in pair.differences}
    assert joint in located(pair) or named <= near, (joint, located(pair))
