"""The search of the fewest signs, zeros and places that explain rows of poses, on a chain of hinges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin.comparison.fewest_changes import fewest_changes
from twin.comparison.row_fit import LEVER, RowFit
from twin.comparison.row_noise import RowNoise
from twin.comparison.side import Axis, JointGroup, PoseRows, RobotSide
from twin.comparison.tool_motion import ChainMotion, JointChange

POINTS = np.array([[0, 0, 0.1], [0.05, 0, 0.4], [0.05, 0.02, 0.8], [0.3, 0, 0.85]])
DIRECTIONS = np.array([[0, 0, 1.0], [0, 1.0, 0], [0, 1.0, 0], [1.0, 0, 0]])
NOISE = 2e-5
"""Standard deviation of a coordinate in m."""

NOISE_ANGLE = 1e-4
"""Standard deviation of a rotation about an axis in rad."""


def pose(vector, p):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    T[:3, 3] = p
    return T


BASE = pose([0.3, -1.0, 0.5], [1.0, 0.2, -0.3])
TOOL_AT_ZERO = pose([0.0, 0.0, 0.0], [0.6, 0.1, 0.85])
TOOL = pose([0.1, 0.4, -0.5], [0.1, 0.02, 0.3])


def side():
    axes = []
    for i, (point, direction) in enumerate(zip(POINTS, DIRECTIONS, strict=True)):
        axes.append(Axis(f"q{i}", "revolute", i, i + 1, point, direction, 0.0))
    groups = tuple(JointGroup((f"link{i}",)) for i in range(len(axes) + 1))
    order = tuple(axis.name for axis in axes)
    frames = {"tool": (len(axes), TOOL_AT_ZERO)}
    return RobotSide("A", "arm", tuple(axes), groups, frames, tool="tool", driven_joints=order)


def rows(signs=(1, 1, 1, 1), zeros=(0, 0, 0, 0), shifts=None, noise=NOISE):
    """Return rows of the chain with changed signs, zeros in rad and shifts (4, 3) in m; `noise` in m of coordinates."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.5, 1.5, (40, 4))
    points = POINTS if shifts is None else POINTS + shifts
    Ts = []
    for joints in q:
        T = np.eye(4)
        for point, place, direction, sign, zero, angle in zip(
            points, POINTS, DIRECTIONS, signs, zeros, joints, strict=True
        ):
            turn = pose((sign * angle + zero) * direction, [0, 0, 0])
            # what the joint carries is shifted with it
            T = T @ pose([0, 0, 0], point) @ turn @ pose([0, 0, 0], -place)
        disturbance = pose(rng.normal(0, NOISE_ANGLE, 3), [0, 0, 0])
        T = BASE @ T @ TOOL_AT_ZERO @ TOOL @ disturbance
        T[:3, 3] += rng.normal(0, noise, 3)
        Ts.append(T)
    return PoseRows(("q0", "q1", "q2", "q3"), (True,) * 4, q, np.array(Ts))


def searched(measured):
    """Return the fit with the fewest changes, and the noise before the search."""
    motion = ChainMotion(side(), measured.q)
    noise, frames_alone, saturated = RowNoise(RowFit(measured, motion), 1e-9).saturated(
        RowFit(measured, motion).frames_alone(np.ones(4))
    )
    lever = noise.fit.lever
    explained, _ = fewest_changes(noise, motion, frames_alone, saturated)
    assert noise.fit.lever == lever
    return explained


def test_a_zero_is_the_only_change():
    explained = searched(rows(zeros=(0, 0, 0.03, 0)))
    assert explained.changes == (JointChange("zero", 2),)
    assert explained.x[12] == pytest.approx(0.03, abs=3e-4)
    assert explained.signs.tolist() == [1, 1, 1, 1]


@pytest.mark.slow
def test_a_sign_and_a_zero_are_found_together():
    explained = searched(rows(signs=(1, 1, -1, 1), zeros=(0, 0.04, 0, 0)))
    assert explained.signs.tolist() == [1, 1, -1, 1]
    assert explained.changes == (JointChange("zero", 1),)
    assert explained.x[12] == pytest.approx(0.04, abs=3e-4)


def test_of_a_place_only_the_numbers_that_differ_are_kept():
    explained = searched(rows(shifts=np.array([[0, 0, 0], [0, 0, 0], [0.01, 0, 0], [0, 0, 0]])))
    assert explained.changes == (JointChange("place", 2),)
    changed = explained.x[12:]
    assert np.linalg.norm(changed[3:]) == pytest.approx(0.01, abs=2e-4)
    assert np.count_nonzero(changed) < 6


@pytest.mark.slow
def test_a_flip_is_one_change_although_turned_places_explain_it_too():
    """Half a turn of a joint's place, and half a turn back behind it, move like the other sign."""
    explained = searched(rows(signs=(1, 1, -1, 1)))
    assert explained.signs.tolist() == [1, 1, -1, 1]
    assert explained.changes == ()


def test_rows_that_scatter_widely_are_explained_by_nothing():
    assert searched(rows(zeros=(0, 0.1, 0, 0), noise=0.02)) is None


def test_an_estimate_of_the_noise_leaves_the_fit_that_it_is_made_of_as_it_is():
    measured = rows(zeros=(0, 0, 0.03, 0))
    fit = RowFit(measured, ChainMotion(side(), measured.q))
    frames_alone = fit.frames_alone(np.ones(4))
    remainder = frames_alone.r.copy()
    saturation = RowNoise(fit, 1e-9).saturated(frames_alone)
    assert saturation.noise.fit.lever == pytest.approx(NOISE / NOISE_ANGLE, rel=0.2)
    assert fit.lever == LEVER
    np.testing.assert_array_equal(frames_alone.r, remainder)
