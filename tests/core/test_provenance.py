"""Assumed values are counted in one way: in the terminal, the report, the export and the page of a robot."""

from __future__ import annotations

import pytest

import twin
from twin.core.provenance import AssumedCounts, Parameter, count_assumed
from twin.exchange.write.order_of_robot import order_of_robot
from twin.ui.headset.description import describe
from twin.ui.session.movable_robot import MovableRobot


def parameter(name, provenance="ASSUMED"):
    return Parameter(name, 1.0, "mm", 1.0, provenance, "a reason")


def test_values_lengths_of_the_drawing_and_those_of_the_motion_are_apart():
    robot = [parameter("a"), parameter("b", "PUBLISHED"), parameter("drawing.c"), parameter("drawing.d", "CITED")]
    counts = count_assumed(robot, [parameter("speed"), parameter("t", "DERIVED")])
    assert counts == AssumedCounts(robot=1, protocol=1, drawing=1)
    assert str(counts) == "1 of the robot, 1 of its motion, 1 length that affects only its appearance"
    assert str(AssumedCounts(0, 0, 0)) == ""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hibou"])
def test_report_export_and_page_have_one_count(name):
    robot = twin.load(name)
    report = twin.validate(name)
    exported = order_of_robot(robot, None, [], None, twin.plan, lambda what, part: None)
    shown = describe(robot, MovableRobot(robot), {}, {}, None)
    assert report.assumed_counts.robot == exported.assumed_counts.robot == len(shown["assumed"]) > 0
    assert report.assumed_counts.drawing == exported.assumed_counts.drawing > 0
