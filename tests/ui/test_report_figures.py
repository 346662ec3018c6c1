"""Figures of pages: what their colours mean is said, and words can be read on a light and on a dark page."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from twin.simulation.session.training import Training
from twin.ui.report import compare_figures, session_figures, sweep_figures, tolerance_figures
from twin.ui.report.figure_output import svg
from twin.ui.report.style import FIT, PALETTE, UNFIT


def test_words_with_the_colour_of_a_verdict_take_that_of_the_page():
    figure = Figure(figsize=(2, 1))
    ax = figure.add_axes((0, 0, 1, 1))
    ax.bar([0], [1], color=UNFIT)
    ax.text(0, 0.2, "beyond", color=UNFIT)
    ax.text(0, 0.6, "within", color=FIT)
    text = svg(figure, "f", "f")
    assert "fill: var(--bad)" in text
    assert "fill: var(--good)" in text
    assert f"fill: {UNFIT}" in text, "the bar keeps its colour, for the white text on it"


@pytest.mark.parametrize(("required", "color"), [(None, PALETTE[0].lower()), (300e-6, FIT), (200e-6, UNFIT)])
def test_bars_of_a_tolerance_are_green_only_within_a_requirement(required, color):
    ax = Figure().subplots()
    tolerance_figures._draw_states(ax, [{"state": "home", "within_position": 232e-6}], required)
    (bar,) = ax.patches
    assert to_hex(bar.get_facecolor()) == color
    assert all(text.get_text().startswith("\u00a0") for text in ax.texts), "an SVG drops other spaces at the begin"


def test_the_deviation_of_a_machine_has_the_colour_of_its_arm():
    machines = [Training(n, np.arange(3.0), np.ones(3), 2e-3, (), (0.0, 0.0), 0, 0.0) for n in ("left", "right")]
    ax = Figure().subplots()
    arms = [("right", "right"), ("left", "left")]
    session_figures._draw_deviation(ax, SimpleNamespace(training=machines), arms)
    assert [line.get_color() for line in ax.lines[:2]] == [PALETTE[1], PALETTE[0]]


def test_a_sweep_of_one_objective_names_its_marks():
    sweep = SimpleNamespace(
        robot="r",
        best=np.array([False, True, False]),
        job=SimpleNamespace(factors=[SimpleNamespace(scale=1e-3)]),
        designs=np.array([[0.1], [0.2], [0.3]]),
        rows=[{"design": "CAD", "l [mm]": 100, "tolerance [µm]": 3, "pareto": False}],
        judged=np.array([[3.0], [2.0], [4.0]]),
    )
    legend = sweep_figures.figure(sweep).axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["dominated", "best", "CAD"]


def test_the_room_of_two_robots_takes_the_colour_of_the_page():
    figure = Figure(figsize=(3, 3))
    compare_figures._equal_axes(figure.add_subplot(projection="3d"), np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]))
    assert svg(figure, "f", "f").count("fill: var(--band)") == 3
