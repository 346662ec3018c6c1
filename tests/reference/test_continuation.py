"""Loops continued from tick to tick, and the second derivatives of their residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made import mechanisms
from twin.core import spatial
from twin.reference.continuation import LoopContinuation
from twin.reference.model import ReferenceModel


def bars(elbow: str, closing: str) -> ReferenceModel:
    """Return the four-bar linkage with other types of the joints at both ends of its coupler."""
    types = {"elbow": elbow, "closing": closing}
    mechanism = mechanisms.four_bar()
    joints = []
    for joint in mechanism.joints:
        if joint.name in types:
            joint = replace(joint, type=types[joint.name], limits=None)
        joints.append(joint)
    return ReferenceModel(replace(mechanism, joints=tuple(joints)))


@pytest.mark.parametrize("ends", [("revolute", "revolute"), ("spherical", "spherical"), ("spherical", "revolute")])
def test_rates_of_continued_loops_are_those_of_the_pseudoinverse(ends):
    """Between two balls, the coupler may spin: the columns of its loop depend on each other."""
    model = bars(*ends)
    continuation = LoopContinuation(model)
    rng = np.random.default_rng(3)
    q = np.tile(model.home().q, (3, 1))
    for _ in range(5):
        q = q + 1e-3 * rng.uniform(-1, 1, q.shape)
        qd, qdd = rng.normal(size=(2, *q.shape))
        V, change, gain = continuation.motion(q, qd, qdd)
        residuals, _ = model.loops_only(continuation.X, np.arange(3))
        assert np.abs(residuals).max() < 1e-14
        for found, expected in zip((V, change, gain), model.motion(continuation.X, qd, qdd), strict=True):
            # the Jacobian is that before the last correction, of at most 1e-8 m in bars of 0.1 m
            assert found == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("closing", ["revolute", "prismatic", "cylindrical", "spherical", "fixed"])
def test_drift_is_the_second_derivative_of_the_residual_also_of_open_loops(closing):
    model = bars("spherical", closing)
    tree = model.tree
    rng = np.random.default_rng(4)
    X = np.tile(model.home().x, (3, 1))
    X = tree.integrate(X, 0.1 * rng.normal(size=(3, tree.model.nv)))
    V = rng.normal(size=(3, tree.model.nv))
    h = 1e-3
    residuals = []
    for t in (-2 * h, -h, 0.0, h, 2 * h):
        r, _ = model.loops_only(tree.integrate(X, t * V), np.arange(3))
        residuals.append(r)
    far = residuals[0] + residuals[4]
    near = residuals[1] + residuals[3]
    # central difference of fourth order
    expected = (16 * near - far - 30 * residuals[2]) / (12 * h * h)
    drift, acceleration = tree.drift(X, V)
    assert drift == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())
    tools = []
    for t in (-2 * h, -h, 0.0, h, 2 * h):
        poses, _ = tree.update(tree.integrate(X, t * V))
        tools.append(tree.tool(poses)[:, :3, 3])
    expected = (16 * (tools[1] + tools[3]) - tools[0] - tools[4] - 30 * tools[2]) / (12 * h * h)
    assert acceleration[:, :3] == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


def test_a_step_is_the_integral_of_its_rates():
    tree = bars("spherical", "spherical").tree
    rng = np.random.default_rng(5)
    X = tree.integrate(np.tile(tree.start(tree.mechanism.rest), (4, 1)), rng.normal(size=(4, tree.model.nv)))
    steps = rng.normal(size=(4, tree.model.nv))
    steps[0] = 0.0  # a ball that does not turn
    moved = tree.step(X, steps)
    expected = tree.integrate(X, steps)
    poses, _ = tree.update(moved)
    wanted, _ = tree.update(expected)
    assert poses == pytest.approx(wanted, abs=1e-14)
    assert spatial.is_pose(tree.tool(poses), 1e-12)
