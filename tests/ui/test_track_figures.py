"""The figure of computed-torque control shows only limits that the robot states."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from twin.simulation.dynamics.computed_torque import EffortRow
from twin.ui.report.track_figures import _draw_efforts, _draw_errors

T = np.linspace(0.0, 1.0, 101)
EFFORT = np.column_stack([np.sin(6 * T), np.cos(6 * T)])


def axes():
    from matplotlib.figure import Figure

    return Figure().add_subplot()


@pytest.mark.parametrize(
    ("limits", "has_lines", "label"),
    [
        ((None, None), False, "effort, % of peak"),
        ((10.0, None), False, "effort, % of limit or peak"),
        ((1.1, None), True, "effort, % of limit or peak"),
        ((1.1, 10.0), True, "effort, % of limit"),
        ((10.0, 10.0), False, "effort, % of limit"),
    ],
)
def test_limits_are_drawn_where_a_motor_states_one(limits, has_lines, label):
    rows = []
    for i, limit in enumerate(limits):
        rows.append(EffortRow(f"q{i}", "N m", float(np.abs(EFFORT[:, i]).max()), 0.7, limit))
    ax = axes()
    _draw_efforts(ax, SimpleNamespace(efforts=rows, worst="heavier"), SimpleNamespace(t=T, effort=EFFORT))
    assert ("limit" in [text.get_text() for text in ax.texts]) is has_lines
    assert ax.get_ylabel() == label


def test_more_runs_than_colours_are_all_drawn():
    runs = {}
    for i in range(12):
        runs[f"run {i}"] = SimpleNamespace(t=T, tip_error=np.full(len(T), 1e-5), tip_max=1e-5)
    ax = axes()
    _draw_errors(ax, runs)
    assert len(ax.lines) == 12
