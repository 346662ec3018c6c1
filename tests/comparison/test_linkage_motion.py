"""A parallelogram made by hand, with its loop and with mimic joints: what besides its motions is compared, and how."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made.moved_side import moved
from twin.comparison.comparison_result import Comparison
from twin.comparison.linkage_motion import LinkageMotion
from twin.comparison.pair import compare_pair
from twin.comparison.side import UNLIMITED, Axis, CouplingRow, JointGroup, RobotSide
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array

TOLERANCE = 1e-5
X, Y, Z = np.eye(3)
STROKE = (-0.5, 0.5)
GROUPS = tuple(JointGroup((name,)) for name in ("base", "crank", "coupler", "rocker"))
C = np.array([0.2, 0.0, 0.0])
"""Place of the hinge of the rocker in m; the crank turns about the origin."""


def hinges(angle: float, drawn: float) -> tuple[list[Axis], Array]:
    """Return (hinges, place of the hinge that closes the loop) at an angle of the crank, with coordinates `drawn`."""
    A = 0.08 * np.array([np.cos(angle), np.sin(angle), 0.0])
    axes = [
        Axis("a", "revolute", 0, 1, np.zeros(3), Z, drawn, limits=STROKE),
        Axis("b", "revolute", 1, 2, A, Z, -drawn),
        Axis("c", "revolute", 0, 3, C, Z, drawn),
    ]
    return axes, A + C


def linkage(*, drawn: float = 0.0, closing: str = "spherical", along: Array = Z) -> RobotSide:
    """Return the parallelogram with its loop; the file draws it with its crank at a coordinate in rad."""
    axes, B = hinges(1.0 + drawn, drawn)
    axes.append(Axis("h", closing, 2, 3, B, along, 0.0, closes_loop=True, active=False))
    frames = {"tip": (2, spatial.pose(p=B))}
    return RobotSide("linkage", "linkage", tuple(axes), GROUPS, frames, tool="tip", driven_joints=("a",))


def coupled() -> RobotSide:
    """Return the parallelogram with mimic joints."""
    axes, B = hinges(1.0, 0.0)
    rows = (CouplingRow("b", {"b": 1.0, "a": 1.0}, 0.0), CouplingRow("c", {"c": 1.0, "a": -1.0}, 0.0))
    frames = {"tip": (2, spatial.pose(p=B))}
    return RobotSide("mimic", "mimic", tuple(axes), GROUPS, frames, tool="tip", driven_joints=("a",), couplings=rows)


def with_limits(side: RobotSide, limits: tuple[float, float] | None) -> RobotSide:
    return replace(side, axes=(replace(side.axes[0], limits=limits), *side.axes[1:]))


@pytest.mark.parametrize("drawn", [0.0, 0.4])
def test_the_state_in_which_a_linkage_is_drawn_does_not_matter(drawn: float) -> None:
    pair = compare_pair(linkage(drawn=drawn), coupled(), TOLERANCE)
    assert pair.kinematics == "agree"
    assert pair.mimic is not None
    assert pair.mimic.moved_hinges == ()
    assert pair.mimic.worst.distance < 1e-8


def test_a_driver_that_follows_two_joints_reaches_its_coordinate() -> None:
    side = linkage(drawn=0.4)
    row = CouplingRow("a", {"a": 1.0, "b": -2.0, "c": -1.0}, 0.8)  # a = 2 b + c + 0.8, as drawn
    motion = LinkageMotion(replace(side, couplings=(row,)), driver=0)
    moved_by = motion.displacements(0.5, np.zeros(0))
    np.testing.assert_allclose(moved_by, [0.1, 0.05, 0.0], atol=1e-12)  # b has the larger ratio


def test_a_driver_that_its_couplings_hold_has_no_motion() -> None:
    rows = (CouplingRow("a", {"a": 1.0, "b": -2.0}, 0.0), CouplingRow("b", {"a": 1.0, "b": 1.0}, 0.3))
    assert LinkageMotion(replace(linkage(), couplings=rows), driver=0).values_at_zero() is None


def test_a_loop_closed_by_a_slide_or_by_a_tilted_hinge_is_none_of_points() -> None:
    for kind, along in (("prismatic", X), ("revolute", X)):
        with pytest.raises(TwinError, match="cannot be matched"):
            compare_pair(linkage(closing=kind, along=along), coupled(), TOLERANCE)
    assert compare_pair(linkage(closing="revolute"), coupled(), TOLERANCE).agrees


def test_limits_of_the_driven_joint_are_compared() -> None:
    narrow = compare_pair(with_limits(linkage(), (-0.1, 0.1)), coupled(), TOLERANCE)
    assert narrow.kinematics == "agree"
    assert narrow.properties is not None
    assert narrow.properties.verdict("limits") == "disagree"
    result = Comparison((narrow.first, narrow.second), (narrow,), TOLERANCE)
    assert result.verdict == "disagree"
    assert [finding.code for finding in result.findings if finding.severity == "info"][-1] == "compare.uncompared"
    assert any("masses" in str(part) for part in result.text())
    # joints without limits have a stroke all the same
    free = compare_pair(with_limits(linkage(), None), with_limits(coupled(), UNLIMITED), TOLERANCE)
    assert free.mimic is not None
    np.testing.assert_allclose(free.mimic.stroke, (-np.pi, np.pi))


def test_other_base_and_tool_frames_are_conventions() -> None:
    T = spatial.pose(spatial.exp_so3(np.array([0.4, 0.0, 0.0])), np.array([1.0, 0.0, 0.0]))
    pair = compare_pair(linkage(), moved(coupled(), T), TOLERANCE)
    assert pair.kinematics == "agree after conventions"
    assert [item.kind for item in pair.items] == ["base frame"]
    assert pair.items[0].turn == pytest.approx(0.4)
    tip = coupled().frames["tip"]
    other = replace(coupled(), frames={"tip": (2, tip[1] @ spatial.pose(p=0.05 * Y))})
    pair = compare_pair(other, linkage(), TOLERANCE)
    assert [(item.kind, round(item.shift, 9)) for item in pair.items] == [("tool frame", 0.05)]


def test_hinges_that_point_the_other_way_are_the_same() -> None:
    side = coupled()
    turned = tuple(replace(axis, direction=-axis.direction) for axis in side.axes)
    pair = compare_pair(linkage(), replace(side, axes=turned), TOLERANCE)
    assert pair.kinematics == "agree"


def test_a_hinge_that_is_elsewhere_disagrees() -> None:
    side = coupled()
    axes = [*side.axes]
    axes[1] = replace(axes[1], point=axes[1].point + 0.0005 * X)
    pair = compare_pair(linkage(), replace(side, axes=tuple(axes)), 1e-5)
    assert pair.kinematics == "disagree"
    assert pair.mimic is not None
    assert [name for name, _ in pair.mimic.moved_hinges] == ["b"]
