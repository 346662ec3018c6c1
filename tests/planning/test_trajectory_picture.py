"""The pictures of joint values in the HTML of a trajectory."""

from __future__ import annotations

import re

import numpy as np

from twin.planning.trajectory_picture import html_of


def drawn_rows(values) -> list[float]:
    """Return the rows in pixels of the points of the curve that is drawn for the values (k,) in m of one joint."""
    qs = np.asarray(values, float)[:, None]
    html = html_of("title", "", ["q1"], qs, np.zeros_like(qs), [False])
    points = re.search(r'points="([^"]*)"', html)
    assert points is not None
    return [float(point.split(",")[1]) for point in points[1].split()]


def test_rounding_errors_of_a_joint_at_rest_are_not_drawn_as_a_motion():
    assert set(drawn_rows([0.3, 0.3 + 1e-16, 0.3])) == {14.0}
    assert set(drawn_rows([0.0, 1e-17])) == {14.0}


def test_a_motion_fills_its_picture():
    assert drawn_rows([0.0, 0.5, 1.0]) == [27.0, 14.0, 1.0]
