"""Sides made by hand: open and closed loops, welds, cuts, joints that are several joints on one side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from made.mechanisms import four_bar
from twin.comparison.mechanism_side import from_mechanism
from twin.comparison.merged_joints import with_merged_joints
from twin.comparison.pair import compare_pair
from twin.comparison.recut import with_tree_of
from twin.comparison.side import UNLIMITED, Axis, JointGroup, RobotSide
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

TOLERANCE = 1e-5
Z = np.array([0.0, 0.0, 1.0])
A = np.array([0.08 * np.cos(1.0), 0.08 * np.sin(1.0), 0.0])
C = np.array([0.2, 0.0, 0.0])
B = np.array([0.17, 0.15, 0.0])
"""Hinges of a four-bar linkage in m; its crank turns about the origin."""


def hinge(name: str, parent: int, child: int, point: Array, *, closing: bool = False) -> Axis:
    return Axis(name, "revolute", parent, child, point, Z, 0.0, closing)


def side(label: str, axes: Sequence[Axis], links: int) -> RobotSide:
    """Return a side whose links have their frames in the base frame."""
    groups = tuple(JointGroup((f"link_{k}",)) for k in range(links))
    frames = {f"link_{k}": (k, np.eye(4)) for k in range(links)}
    return RobotSide(label, label, tuple(axes), groups, frames, tool=f"link_{links - 1}", driven_joints=("a",))


def loop(label: str = "loop") -> RobotSide:
    """Return the linkage, cut at its hinge h."""
    axes = [hinge("a", 0, 1, np.zeros(3)), hinge("b", 1, 2, A), hinge("c", 0, 3, C)]
    return side(label, [*axes, hinge("h", 2, 3, B, closing=True)], 4)


def test_an_open_loop_is_no_closed_one() -> None:
    closed = loop()
    axes = (*closed.axes[:3], hinge("h", 2, 4, B))
    opened = side("open", axes, 5)  # a copy of link 3 behind the hinge
    for pair in ((closed, opened), (opened, closed)):
        with pytest.raises(TwinError, match="a loop of one side is open"):
            compare_pair(*pair, TOLERANCE)


def test_another_base_link_is_another_robot() -> None:
    closed = loop()
    number = {0: 3, 1: 0, 2: 1, 3: 2}
    axes = [replace(axis, parent=number[axis.parent], child=number[axis.child]) for axis in closed.axes]
    names = {"b": False, "h": False, "a": True, "c": True}
    other = [replace(next(axis for axis in axes if axis.name == name), closes_loop=cut) for name, cut in names.items()]
    with pytest.raises(TwinError, match="connect different links"):
        compare_pair(closed, replace(closed, label="other", axes=tuple(other)), TOLERANCE)


def test_a_cut_elsewhere_is_found_under_names_with_a_prefix() -> None:
    closed = loop()
    a, b, c, h = closed.axes
    turned = replace(h, parent=3, child=2, direction=-Z, closes_loop=False)
    axes = []
    for axis in (a, c, turned, replace(b, closes_loop=True)):
        axes.append(replace(axis, name=f"arm_{axis.name}"))
    other = replace(side("cut", axes, 4), driven_joints=("arm_a",))
    assert [axis.closes_loop for axis in with_tree_of(other, closed).axes] == [False, False, False, True]
    assert compare_pair(closed, other, TOLERANCE).agrees


def test_a_weld_makes_one_link_of_two() -> None:
    mechanism = four_bar()
    (pin,) = mechanism.loops
    welded = replace(mechanism, joints=tuple(_fixed(joint, pin) for joint in mechanism.joints))
    found = from_mechanism(welded, "weld")
    drawn = from_mechanism(mechanism, "drawn")
    assert len(found.groups) == len(drawn.groups) - 1
    assert [axis.closes_loop for axis in found.axes] == [False, False, True]
    with pytest.raises(TwinError, match="cannot be matched"):
        compare_pair(drawn, found, TOLERANCE)
    assert compare_pair(found, from_mechanism(welded, "again"), TOLERANCE).kinematics == "agree"


def test_the_mass_of_a_light_link_between_a_joint_and_a_weld_does_not_count() -> None:
    mechanism = four_bar()
    (pin,) = mechanism.loops
    carrier = next(name for name in (pin.parent, pin.child) if len(_joints_at(mechanism, name)) == 2)
    masses = []
    for mass in (0.001, 0.01):
        inertia = Inertia(mass, np.zeros(3), 1e-7 * np.eye(3))
        bodies = []
        for body in mechanism.bodies:
            bodies.append(replace(body, inertia=inertia if body.name == carrier else None))
        joints = tuple(_fixed(joint, pin) for joint in mechanism.joints)
        found = from_mechanism(replace(mechanism, bodies=tuple(bodies), joints=joints), "weld")
        masses.append([group.inertia.mass for group in found.groups if group.inertia is not None])
    assert masses == [[], [0.01]]


def test_a_loop_that_does_not_close_is_no_closed_one() -> None:
    mechanism = four_bar()
    (pin,) = mechanism.loops
    apart = replace(pin, T_child_joint=pin.T_child_joint @ spatial.pose(p=0.0005 * X))
    joints = tuple(apart if joint.name == pin.name else joint for joint in mechanism.joints)
    opened = from_mechanism(replace(mechanism, joints=joints), "opened")
    pair = compare_pair(from_mechanism(mechanism, "drawn"), opened, TOLERANCE)
    assert pair.kinematics == "disagree"
    assert [(item.joint, round(item.shift, 9)) for item in pair.differences] == [(pin.name, 0.0005)]
    assert compare_pair(opened, replace(opened, label="again"), TOLERANCE).kinematics == "agree"


def _joints_at(mechanism: Mechanism, body: str) -> list[str]:
    return [joint.name for joint in mechanism.joints if body in (joint.parent, joint.child)]


def _fixed(joint: Joint, chosen: Joint) -> Joint:
    return replace(joint, type="fixed") if joint.name == chosen.name else joint


# -- several joints that are one -------------------------------------------------------------------------


def wrist(directions: Sequence[Array], **changes: object) -> RobotSide:
    """Return an arm with a hinge and three hinges through one point; none: a ball."""
    point = np.array([0.0, 0.0, 0.3])
    axes = [Axis("a", "revolute", 0, 1, np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.0)]
    for k, direction in enumerate(directions):
        part = Axis(f"wrist_{k}", "revolute", k + 1, k + 2, point, direction, 0.0, active=False)
        axes.append(replace(part, **changes))  # pyright: ignore[reportArgumentType]
    if not directions:
        axes.append(Axis("wrist", "spherical", 1, 2, point, Z, 0.0, active=False))
    found = side("hinges" if directions else "ball", axes, len(axes) + 1)
    frames = {"base": (0, np.eye(4)), "hand": (len(axes), spatial.pose(p=np.array([0.0, 0.0, 0.4])))}
    return replace(found, frames=frames, tool="hand")


X, Y = np.eye(3)[:2]
SKEW = [Z, np.array([0.5, 0.0, np.sqrt(0.75)]), np.array([0.0, 0.5, np.sqrt(0.75)])]
"""Three independent directions that are not at right angles: rotations far from zero cannot be reached."""


def test_three_hinges_are_a_ball_at_right_angles_only() -> None:
    ball = wrist([])
    for directions in ([X, Y, Z], [Z, Y, Z]):
        for pair in ((ball, wrist(directions)), (wrist(directions), ball)):
            assert compare_pair(*pair, TOLERANCE).kinematics == "agree"
    with pytest.raises(TwinError, match="wrist_0"):
        compare_pair(wrist(SKEW), ball, TOLERANCE)


def test_limits_and_motors_of_three_hinges_that_are_a_ball_are_told() -> None:
    ball = wrist([])
    limited = compare_pair(wrist([X, Y, Z], limits=(-0.02, 0.02)), ball, TOLERANCE)
    assert limited.properties is not None
    (row,) = limited.properties.rows
    assert (row.kind, row.where, row.stated) == ("limits", "wrist", False)
    assert "wrist_1" in row.first
    assert "wrist_2" in row.first
    # a file that states that its ball has no limits disagrees
    free = replace(ball, axes=(ball.axes[0], replace(ball.axes[1], limits=UNLIMITED)))
    found = compare_pair(wrist([X, Y, Z], limits=(-0.02, 0.02)), free, TOLERANCE)
    assert found.properties is not None
    assert found.properties.verdict("limits") == "disagree"
    driven = compare_pair(ball, wrist([X, Y, Z], active=True), TOLERANCE)
    assert driven.kinematics == "agree after conventions"
    assert "motors of hinges drive joint 'wrist'" in driven.items[0].text


def points(gap: float, *, swapped: bool = False, rough: float = 0.0) -> RobotSide:
    """Return the linkage closed by two balls, `gap` apart, whose points are up to `rough` beside the hinge, in m."""
    closed = loop("points")
    axes = [*closed.axes[:3]]
    for k, sign in enumerate((-1.0, 1.0)):
        ends = (3, 2) if swapped and k else (2, 3)
        point = B + sign * (gap / 2 * Z + rough * X)
        axes.append(Axis(f"h_{k}", "spherical", *ends, point, Z, 0.0, closes_loop=True, active=False))
    return replace(closed, axes=tuple(axes))


def test_two_points_that_name_their_links_in_either_order_are_a_hinge() -> None:
    found = with_merged_joints(points(0.02, swapped=True), loop(), TOLERANCE)
    assert (found.axes[3].parent, found.axes[3].child) == (2, 3)
    assert compare_pair(loop(), points(0.02, swapped=True), TOLERANCE).kinematics == "agree"


def test_rounded_points_near_to_each_other_are_a_hinge() -> None:
    for pair in ((loop(), points(0.02, rough=5e-7)), (points(0.02, rough=5e-7), loop())):
        assert compare_pair(*pair, TOLERANCE).kinematics == "agree"
    # beside the line by more than the tolerance
    assert compare_pair(loop(), points(0.02, rough=2e-5), TOLERANCE).kinematics == "disagree"


def slide(offset: Array) -> RobotSide:
    """Return the linkage with a slide on its coupler, which carries a hinge at an offset in m from its place."""
    axes = [*loop("slide").axes[:3]]
    axes.append(Axis("s", "prismatic", 2, 4, B, Y, 0.0))
    axes.append(Axis("t", "revolute", 4, 5, B + 0.02 * Y + offset, Z, 0.0))
    return side("slide", [*axes, hinge("h", 2, 3, B, closing=True)], 6)


def test_what_a_slide_carries_moves_along_it_only() -> None:
    assert compare_pair(slide(np.zeros(3)), slide(0.001 * Y), TOLERANCE).agrees  # another zero of the slide
    pair = compare_pair(slide(np.zeros(3)), slide(0.001 * X), TOLERANCE)
    assert pair.kinematics == "disagree"
    assert pair.differences
    assert pair.differences[0].shift == pytest.approx(0.001, abs=1e-6)
