"""Parameters of a DH table: what another value of one of them moves, by the order of the motions of its convention."""

from __future__ import annotations

import numpy as np
import pytest

from twin.comparison.dh_statements import CellStatement
from twin.comparison.side import Axis, RobotSide, TableLine
from twin.core import spatial

VALUES = {"alpha": 0.3, "a": 0.2, "theta": 0.4, "d": 0.1}


def cell(convention, parameter):
    units = dict.fromkeys(VALUES, 1.0)
    row = TableLine("t.csv", 2, "q1", "link1", convention, VALUES, units, frozenset({"q2"}), frozenset({"link1"}))
    return CellStatement("t.csv", 2, f"row 'q1' {parameter}", (VALUES[parameter],), row, parameter)


def side():
    first = Axis("q1", "revolute", 0, 1, np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0]), 0.5)
    second = Axis("q2", "revolute", 1, 2, np.array([0.4, 0.2, 0.3]), np.array([0.0, 1.0, 0.0]), 0.0)
    T_base_link = spatial.pose(spatial.rotation_z(0.7), (0.3, 0.2, 0.1))
    return RobotSide("A", "r", (first, second), (), {"link1": (1, T_base_link)})


@pytest.mark.parametrize(
    ("convention", "parameter", "is_moved"),
    [("standard", "a", False), ("standard", "d", False), ("modified", "a", True), ("modified", "alpha", True)],
)
def test_a_row_moves_its_own_joint_only_by_what_stands_before_it(convention, parameter, is_moved):
    statement = cell(convention, parameter)
    before = side()
    after = statement.applied(before, [VALUES[parameter] + 0.1])
    own, next_joint = before.axes
    assert statement.moves(own) is is_moved
    assert statement.moves(next_joint)
    assert np.allclose(after.axes[0].point, own.point) is not is_moved
    assert not np.allclose(after.axes[1].point, next_joint.point)
    assert not np.allclose(after.frames["link1"][1], before.frames["link1"][1])


def test_an_equal_value_moves_nothing():
    before = side()
    after = cell("modified", "a").applied(before, [VALUES["a"]])
    assert np.allclose(after.axes[1].point, before.axes[1].point)
    assert np.allclose(after.frames["link1"][1], before.frames["link1"][1])
