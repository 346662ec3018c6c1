"""Rates of closed loops against finite differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from made.loops import mechanism, two_links
from twin.core import spatial
from twin.model.joint import Joint
from twin.model.mechanism import Coupling
from twin.reference import ReferenceModel


def test_rates_are_the_derivatives_of_a_run(sils_model):
    q0, q1 = (sils_model.mechanism.posture(n) for n in ("home", "inserted"))
    wave = np.array([1.0, 1.3, 0.7, 1.1, 0.9, 1.6])

    def motion(t):
        return q0 + (q1 - q0) * (0.5 - 0.5 * np.cos(wave * t[:, None]))

    def rates(t):
        u = wave * t[:, None]
        return (q1 - q0) * 0.5 * wave * np.sin(u), (q1 - q0) * 0.5 * wave**2 * np.cos(u)

    t = np.linspace(0.3, 1.2, 7)
    h = 1e-3
    offsets = np.arange(-2, 3)
    dense = sils_model.run(motion((t[:, None] + h * offsets).reshape(-1)))
    T = dense.Ts_base_tool.reshape(7, 5, 4, 4)
    middle = sils_model.run(motion(t))
    twist, acceleration = sils_model.rates(middle.x, *rates(t))
    first, second = np.array([1, -8, 0, 8, -1]) / 12 / h, np.array([-1, 16, -30, 16, -1]) / 12 / h**2
    v = np.einsum("o,koi->ki", first, T[..., :3, 3])
    a = np.einsum("o,koi->ki", second, T[..., :3, 3])
    # Rotation vectors from the middle sample: their rate at it is the angular velocity, their second rate
    # the angular acceleration, as the rotation vector is zero there.
    turn = spatial.log_so3(T[..., :3, :3] @ np.swapaxes(T[:, 2:3, :3, :3], -1, -2))
    w, dw = np.einsum("o,koi->ki", first, turn), np.einsum("o,koi->ki", second, turn)
    for got, want, tolerance in (
        (twist[:, :3], v, 1e-6),
        (twist[:, 3:], w, 1e-6),
        (acceleration[:, :3], a, 1e-4),
        (acceleration[:, 3:], dw, 1e-4),
    ):
        assert np.abs(got - want).max() < tolerance * np.abs(want).max()


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic", "cylindrical", "spherical", "free"])
@pytest.mark.parametrize("scatter", [0.0, 0.6], ids=["closed", "open"])
def test_loop_jacobians_are_derivatives_for_every_joint_type(kind, scatter, rng):
    """Two arms of many joints, tied by one loop joint that is closed, or far from it."""

    def anywhere(size=0.5):
        return spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.uniform(-size, size, 3))

    joints = [
        Joint("j0", "revolute", "base", "a0", anywhere(), anywhere()),
        Joint("j1", "spherical", "a0", "a1", anywhere(), anywhere()),
        Joint("j2", "prismatic", "a1", "a2", anywhere(), anywhere()),
        Joint("j3", "cylindrical", "a0", "a3", anywhere(), anywhere()),
        Joint("j4", "free", "base", "a4", anywhere(), anywhere()),
        Joint("j5", "fixed", "a4", "a5", anywhere(), anywhere()),
    ]
    model = ReferenceModel(mechanism(*joints, tool="a2"))
    x = pin.integrate(model.tree.model, pin.neutral(model.tree.model), rng.normal(size=model.tree.model.nv))
    links = {n: T[0] for n, T in model.link_poses(x[None]).items()}
    for parent, child in (("a2", "a5"), ("a3", "a2"), ("base", "a2"), ("a5", "base")):
        T_parent = anywhere()
        T_child = spatial.inverse(links[child]) @ links[parent] @ T_parent
        T_child = T_child @ spatial.pose(spatial.exp_so3(scatter * rng.normal(size=3)), scatter * rng.normal(size=3))
        loop = Joint("loop", kind, parent, child, T_parent, T_child)
        tree = ReferenceModel(mechanism(*joints, loop, tool="a2")).tree
        r, A = tree.loops.evaluate(x[None], *tree.update(x[None]))
        assert r.shape == (1, 6 - len(loop.free_axes))
        assert A.shape == (1, r.shape[1], tree.model.nv)
        if not scatter:
            assert np.abs(r).max(initial=0.0) < 4e-15
        h = 1e-6
        for i, unit in enumerate(np.eye(tree.model.nv)):
            ends = [pin.integrate(tree.model, x, s * h * unit) for s in (1, -1)]
            plus, minus = (tree.loops.evaluate(e[None], *tree.update(e[None]))[0] for e in ends)
            assert np.abs((plus - minus) / (2 * h) - A[..., i]).max(initial=0.0) < 1e-9


def test_rates_of_a_belt_are_derivatives():
    model = ReferenceModel(two_links(Coupling("gear", ("b", "c"), (2.0, -1.0))))
    x, h = model.solve(np.array([0.3, 0.4])).x[None], 1e-5
    qd = np.array([[0.7, -0.5]])
    twist, _ = model.rates(x, qd, np.zeros((1, 2)))
    ends = [model.solve(np.array([0.3, 0.4]) + s * h * qd[0]).T_base_tool for s in (1, -1)]
    np.testing.assert_allclose(twist[0, :3], (ends[0] - ends[1])[:3, 3] / (2 * h), atol=1e-8)
    assert twist[0, 5] == pytest.approx(0.7 - 0.5 + 2 * -0.5)
