"""Parameters of a DH table: what another value of one of them moves, by the order of the motions of its convention."""

from __future__ import annotations

import numpy as np
import pytest

from twin.comparison.dh_statements import CellStatement
from twin.comparison.side import Axis, DhTableRow, RobotSide
from twin.core import spatial

VALUES = {"alpha": 0.3, "a": 0.2, "theta": 0.4, "d": 0.1}


def cell(convention, parameter):
    units = dict.fromkeys(VALUES, 1.0)
    row = DhTableRow("t.csv", 2, "q1", "link1", convention, VALUES, units, frozenset({"q2"}), frozenset({"link1"}))
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


def turn(axis, angle):
    return spatial.pose(spatial.exp_so3(angle * np.eye(3)["xyz".index(axis)]))


def shift(axis, distance):
    return spatial.pose(p=distance * np.eye(3)["xyz".index(axis)])


def standard(v):
    return np.eye(4), turn("z", v["theta"]) @ shift("z", v["d"]) @ shift("x", v["a"]) @ turn("x", v["alpha"])


def modified(v):
    return turn("x", v["alpha"]) @ shift("x", v["a"]) @ turn("z", v["theta"]) @ shift("z", v["d"]), np.eye(4)


def khalil(v):
    branch = turn("z", v["gamma"]) @ shift("z", v["b"])
    return branch @ turn("x", v["alpha"]) @ shift("x", v["d"]) @ turn("z", v["theta"]) @ shift("z", v["r"]), np.eye(4)


def hayati(v):
    return np.eye(4), turn("z", v["theta"]) @ shift("x", v["a"]) @ turn("x", v["alpha"]) @ turn("y", v["beta"])


ROWS = {
    standard: ("alpha", "a", "theta", "d"),
    modified: ("alpha", "a", "theta", "d"),
    khalil: ("gamma", "b", "alpha", "d", "theta", "r"),
    hayati: ("alpha", "a", "theta", "beta"),
}


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(("row", "parameter"), [(row, name) for row, names in ROWS.items() for name in names])
def test_another_value_moves_lines_and_links_as_the_whole_table_does(row, parameter, kind):
    """The motions of a row are multiplied here in the order in which its authors print them."""
    T_base_parent = spatial.pose(spatial.exp_so3([0.3, -0.5, 0.9]), [0.3, 0.1, -0.2])
    T_link_next = spatial.pose(spatial.exp_so3([-0.4, 0.2, 0.6]), [0.05, 0.2, 0.1])
    drawn = 0.37
    T_q = turn("z", drawn) if kind == "revolute" else shift("z", drawn)

    def table(values):
        before, after = row(values)
        T_base_joint = T_base_parent @ before
        T_base_link = T_base_joint @ T_q @ after
        T_base_next = T_base_link @ T_link_next
        axes = (
            Axis("q1", kind, 0, 1, T_base_joint[:3, 3], T_base_joint[:3, 2], drawn),
            Axis("q2", "revolute", 1, 2, T_base_next[:3, 3], T_base_next[:3, 2], 0.0),
        )
        frames = {"link0": (0, T_base_parent), "link1": (1, T_base_link), "link2": (2, T_base_next)}
        return RobotSide("A", "r", axes, (), frames)

    values = {name: 0.2 + 0.1 * k for k, name in enumerate(ROWS[row])}
    changed = {**values, parameter: values[parameter] + 0.25}
    below = frozenset({"link1", "link2"})
    units = dict.fromkeys(values, 0.5)
    line = DhTableRow("t.csv", 2, "q1", "link1", row.__name__, values, units, frozenset({"q2"}), below)
    statement = CellStatement("t.csv", 2, "", (values[parameter] / 0.5,), line, parameter)
    found = statement.applied(table(values), [changed[parameter] / 0.5])
    expected = table(changed)
    for axis, expected_axis, axis_before in zip(found.axes, expected.axes, table(values).axes, strict=True):
        np.testing.assert_allclose(axis.direction, expected_axis.direction, atol=1e-12)
        offset = np.cross(axis.point - expected_axis.point, axis.direction)
        np.testing.assert_allclose(offset, 0.0, atol=1e-12)
        if not statement.moves(axis):
            np.testing.assert_allclose(axis.point, axis_before.point, atol=1e-12)
    for name, (_, T) in expected.frames.items():
        np.testing.assert_allclose(found.frames[name][1], T, atol=1e-12)


def test_an_equal_value_moves_nothing():
    before = side()
    after = cell("modified", "a").applied(before, [VALUES["a"]])
    assert np.allclose(after.axes[1].point, before.axes[1].point)
    assert np.allclose(after.frames["link1"][1], before.frames["link1"][1])
