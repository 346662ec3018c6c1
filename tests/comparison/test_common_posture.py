"""Robots with loops that are drawn in other postures, on other bases, or with balls instead of a hinge."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from made.moved_side import moved
from twin.api import comparison
from twin.comparison.file_numbers import why_not_edited
from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import line_gap
from twin.comparison.matching import match
from twin.comparison.pair import compare_pair
from twin.comparison.side import Axis, JointGroup, RobotSide
from twin.core import spatial
from twin.core.spatial import Array

TOLERANCE = 1e-5

X, _, Z = np.eye(3)

SHIFTED = spatial.pose(spatial.exp_so3(np.array([0.4, 0.2, 0.3])), np.array([0.3, 0.1, 0.2]))


def groups(*names: str) -> tuple[JointGroup, ...]:
    return tuple(JointGroup((name,)) for name in names)


def about(direction: Array, angle: float, point: Array) -> Array:
    return spatial.pose(spatial.exp_so3(angle * direction), point)


def four_bar(label: str, crank: float, balls: tuple[float, ...] = ()) -> RobotSide:
    """Return a planar four-bar: its loop is closed by a hinge, or by balls on its line, at heights in m."""
    pin = 0.08 * np.array([np.cos(crank), np.sin(crank), 0.0])
    base = np.array([0.2, 0.0, 0.0])
    coupler, rocker = 0.18, 0.14
    along = (base - pin) / np.linalg.norm(base - pin)
    distance = float(np.linalg.norm(base - pin))
    to_foot = (coupler**2 - rocker**2 + distance**2) / (2 * distance)
    closing = pin + to_foot * along + np.sqrt(coupler**2 - to_foot**2) * np.cross(Z, along)
    coupler_angle = float(np.arctan2(closing[1] - pin[1], closing[0] - pin[0]))
    rocker_angle = float(np.arctan2(closing[1] - base[1], closing[0] - base[0]))
    axes = [
        Axis("a", "revolute", 0, 1, np.zeros(3), Z, crank),
        Axis("b", "revolute", 1, 2, pin, Z, coupler_angle - crank),
        Axis("c", "revolute", 0, 3, base, Z, rocker_angle),
    ]
    if not balls:
        axes.append(Axis("h", "revolute", 2, 3, closing, Z, rocker_angle - coupler_angle, closes_loop=True))
    for number, height in enumerate(balls):
        point = closing + height * Z
        axes.append(Axis(f"h_{number}", "spherical", 2, 3, point, Z, 0.0, closes_loop=True, active=False))
    frames = {
        "base": (0, np.eye(4)),
        "crank": (1, about(Z, crank, np.zeros(3))),
        "coupler": (2, about(Z, coupler_angle, pin)),
        "rocker": (3, about(Z, rocker_angle, base)),
    }
    links = groups("base", "crank", "coupler", "rocker")
    return RobotSide(label, label, tuple(axes), links, frames, tool="coupler", driven_joints=("a",))


@pytest.mark.parametrize("balls", [(-0.01, 0.01), (0.01, -0.01)])
def test_the_order_of_two_balls_of_a_hinge_does_not_matter(balls: tuple[float, ...]) -> None:
    second = moved(four_bar("balls", 1.6, balls), SHIFTED)
    pair = compare_pair(four_bar("hinge", 1.0), second, TOLERANCE)
    assert pair.kinematics == "agree after conventions"
    (item,) = pair.items
    assert item.kind == "base frame"
    assert item.turn == pytest.approx(float(spatial.rotation_angle(SHIFTED[:3, :3])), abs=1e-4)


def test_a_line_without_a_positive_end_does_not_agree_with_one_across_it() -> None:
    def hinge(direction: Array) -> RobotSide:
        axis = Axis("a", "revolute", 0, 1, np.zeros(3), direction, 0.0, is_directed=False)
        return RobotSide("hinge", "hinge", (axis,), groups("base", "arm"), {"base": (0, np.eye(4))})

    first, second = hinge(X), hinge(Z)
    problem = FitProblem(first, second, match(first, second), TOLERANCE)
    assert line_gap(problem, problem.unchanged).angles[0] == pytest.approx(np.pi / 2)


def spatial_four_bar(label: str, crank: float, rod: float = 0.29) -> RobotSide:
    """Return a crank about z and a rocker about x with a rod between balls, of this length in m."""
    base = np.array([0.3, 0.05, 0.02])
    pin = 0.06 * np.array([np.cos(crank), np.sin(crank), 0.0])

    def end(angle: float) -> Array:
        return base + 0.15 * np.array([0.0, np.cos(angle), np.sin(angle)])

    def excess(angle: float) -> float:
        return float(np.linalg.norm(end(angle) - pin)) - rod

    angles = np.linspace(0.0, 2 * np.pi, 200)
    k = next(k for k in range(199) if excess(angles[k]) * excess(angles[k + 1]) < 0.0)
    rocker = float(brentq(excess, angles[k], angles[k + 1], xtol=1e-14))  # pyright: ignore[reportArgumentType]
    axes = (
        Axis("crank", "revolute", 0, 1, np.zeros(3), Z, crank),
        Axis("rocker", "revolute", 0, 2, base, X, rocker),
        Axis("near", "spherical", 1, 3, pin, Z, 0.0, active=False),
        Axis("far", "spherical", 3, 2, end(rocker), Z, 0.0, closes_loop=True, active=False),
    )
    frames = {
        "base": (0, np.eye(4)),
        "crank": (1, about(Z, crank, np.zeros(3))),
        "rocker": (2, about(X, rocker, base)),
        "rod": (3, spatial.pose(spatial.frame_from_axes(end(rocker) - pin, Z), pin)),
    }
    links = groups("base", "crank", "rocker", "rod")
    return RobotSide(label, label, axes, links, frames, tool="rocker", driven_joints=("crank",))


def test_the_posture_in_which_a_loop_is_drawn_is_no_difference() -> None:
    pair = compare_pair(spatial_four_bar("one", 0.5), spatial_four_bar("other", 0.8), TOLERANCE)
    assert (pair.kinematics, pair.items) == ("agree", ())
    assert pair.properties is not None
    pair = compare_pair(spatial_four_bar("one", 0.5), moved(spatial_four_bar("other", 0.8), SHIFTED), TOLERANCE)
    assert [item.kind for item in pair.items] == ["base frame"]


def test_a_longer_rod_in_another_posture_is_a_difference() -> None:
    pair = compare_pair(spatial_four_bar("one", 0.5), spatial_four_bar("other", 0.8, 0.291), TOLERANCE)
    assert pair.kinematics == "disagree"
    for item in pair.differences:
        assert max(item.shift / TOLERANCE, item.turn / (2 * TOLERANCE)) > 1.0


@pytest.mark.parametrize("looped", [True, False])
def test_the_text_of_a_stage_with_loops_is_not_edited(
    looped: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = four_bar("stage", 1.0)
    if not looped:
        stage = replace(stage, axes=stage.tree)
    file = tmp_path / "arm.usda"
    file.write_text("#usda 1.0\n", encoding="utf-8")
    monkeypatch.setattr(comparison, "load", lambda _: None)
    monkeypatch.setattr(comparison, "_robot_side", lambda *_: stage)
    with ExitStack() as mirrors:
        side = comparison._side(file, "arm.usda", (), None, None, mirrors)  # pyright: ignore[reportArgumentType]
    assert side.path == file
    assert (side.reread is None) == looped
    assert ("loops" in why_not_edited(side)) == looped
