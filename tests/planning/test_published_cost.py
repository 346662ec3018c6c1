"""Eq. (1) of the Raven paper as a cost: against motions that are integrated by programs that share nothing with it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import spearmanr

import twin
from made.arm import arm, post, space_of
from made.mechanisms import four_bar
from twin.core.errors import ProtocolError
from twin.exchange.formats.mjcf.write import mjcf_text
from twin.planning.costs import COSTS, length_and_stops, total
from twin.planning.fmt import FmtSearch
from twin.planning.protocol.phases.free import FreeTable
from twin.planning.published_cost import (
    BANDWIDTH,
    EDGE_TIME,
    REMAINING,
    normalised_length,
    published_cost,
    squared_acceleration,
)
from twin.reference import inertia
from twin.simulation.dynamics.arm import arm as weighed_arm
from twin.simulation.dynamics.effort_plants import MujocoPlant

STEP = 0.2e-3
"""Step in s. The controller in MuJoCo holds its efforts for a step: with 0.5 ms, an edge differs by 1.4 %."""


def squares(p, step):
    """Return the integral of |acceleration|^2 of points p (k, 3) at moments that are `step` apart."""
    acceleration = (p[2:] - 2 * p[1:-1] + p[:-2]) / step**2
    # the acceleration at both ends, by extrapolation
    acceleration = np.vstack(
        [2 * acceleration[0] - acceleration[1], acceleration, 2 * acceleration[-1] - acceleration[-2]]
    )
    return np.trapezoid((acceleration**2).sum(axis=1), dx=step)


def drawn(limits, count, part, seed=0):
    """Return ends a, b (count, n) of edges; the longest is about `part` of each joint's range."""
    rng = np.random.default_rng(seed)
    low, high = limits.T
    a = rng.uniform(low, high, (count, len(limits)))
    b = a + part * rng.uniform(-1, 1, a.shape) * rng.uniform(0.2, 1, (count, 1)) * (high - low)
    return a, np.clip(b, low, high)


def integrated(model, a, b):
    """Return the positions (k, 3) of the tool of a mechanism at steps of `STEP`; PD control, by scipy."""
    reference = model.reference if hasattr(model, "reference") else model

    def rates(t, x):
        q, qd = np.split(x, 2)
        return np.concatenate([qd, BANDWIDTH**2 * (b - q) - 2 * BANDWIDTH * qd])

    t = np.arange(0, EDGE_TIME + STEP / 2, STEP)
    solution = solve_ivp(rates, (0, t[-1]), np.concatenate([a, 0 * a]), t_eval=t, rtol=1e-10, atol=1e-12)
    return reference.run(solution.y[: len(a)].T).Ts_base_tool[:, :3, 3]


class RavenUnderTorques:
    """The Raven in MuJoCo, whose own mass matrix and bias forces the controller uses."""

    def __init__(self):
        robot = twin.load("raven_left")
        self.arm = weighed_arm(robot.mechanism, inertia.of_robot(robot.files.cad))
        mechanism = self.arm.mechanism
        names = [joint.name for joint in mechanism.active]
        self.plant = MujocoPlant(mjcf_text(mechanism), names, self.arm.rotor, self.arm.friction, step=STEP)
        self.tool = mechanism.frame(mechanism.tool)
        self.limits = mechanism.limits

    def tip(self):
        data = self.plant.data
        body = data.body(self.tool.body)
        return body.xpos + body.xmat.reshape(3, 3) @ self.tool.T_body_frame[:3, 3]

    def moved(self, a, b):
        """Return positions (k, 3) of the tool at each step, from rest at a towards the set point b; the jaw rests."""
        plant, model, data = self.plant, self.plant.model, self.plant.data
        plant.reset(a, 0 * a)
        points = []
        efforts = np.zeros(model.nv)
        for _ in range(round(EDGE_TIME / STEP) + 1):
            data.qfrc_applied[:] = 0
            mujoco.mj_forward(model, data)
            points.append(self.tip().copy())
            wanted = np.zeros(model.nv)
            wanted[plant._rates] = BANDWIDTH**2 * (b - plant.q) - 2 * BANDWIDTH * plant.qd
            mujoco.mj_mulM(model, data, efforts, wanted)
            data.qfrc_applied[:] = efforts + data.qfrc_bias - data.qfrc_passive
            mujoco.mj_step(model, data)
        return np.array(points)


def test_an_edge_ends_when_two_percent_remain():
    x = BANDWIDTH * EDGE_TIME
    assert (1 + x) * np.exp(-x) == pytest.approx(REMAINING, rel=1e-12)
    paper = np.mean([4.705 / 12.5, 4.277 / 13.3, 3.909 / 10.1, 3.688 / 10.1])
    assert pytest.approx(paper, abs=1e-4) == EDGE_TIME


def test_a_simulated_edge_is_the_straight_connection_without_overshoot():
    """So the test of the straight connection is that of the simulation."""
    a, b = drawn(arm().limits, 1, 0.5)

    def rates(t, x):
        q, qd = np.split(x, 2)
        return np.concatenate([qd, BANDWIDTH**2 * (b[0] - q) - 2 * BANDWIDTH * qd])

    start = np.concatenate([a[0], 0 * a[0]])
    q = solve_ivp(rates, (0, 2 * EDGE_TIME), start, rtol=1e-10, atol=1e-12, max_step=1e-3).y[:3].T
    shares = (q - a[0]) / (b[0] - a[0])
    np.testing.assert_allclose(shares, np.repeat(shares[:, :1], 3, axis=1), atol=1e-8)
    assert np.diff(shares[:, 0]).min() > -1e-12
    assert shares.max() <= 1 + 1e-12


def test_the_integral_is_that_of_a_motion_that_scipy_integrates():
    mechanism = arm()
    model = space_of(mechanism)._model
    a, b = drawn(mechanism.limits, 5, 0.5)
    found = squared_acceleration(mechanism)(a, b)
    expected = [squares(integrated(model, *ends), STEP) for ends in zip(a, b, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0.01)


@pytest.mark.slow
def test_the_raven_moves_like_that_under_the_efforts_of_a_controller_in_mujoco():
    raven = RavenUnderTorques()
    a, b = drawn(raven.limits, 26, 0.5)
    b[:, -1] = a[:, -1]
    found = squared_acceleration(raven.arm.mechanism)(a, b)
    expected = np.array([squares(raven.moved(*ends), STEP) for ends in zip(a, b, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=0.01)
    published = 0.1 * np.linalg.norm((b - a) / np.ptp(raven.limits, axis=1), axis=1) + 0.5 * expected
    assert spearmanr(published_cost(raven.arm.mechanism, raven.limits)(a, b), published).statistic > 0.95
    weights = np.where([joint.is_angle for joint in raven.arm.mechanism.active], 0.1, 1.0)
    assert spearmanr(length_and_stops(weights)(a, b), published).statistic < 0.9, "the other cost is another one"


def test_length_counts_the_range_of_each_joint_as_one():
    limits = np.array([[0.0, 2.0], [-1.0, 3.0], [5.0, 5.0]])
    a, b = np.array([[0.0, -1.0, 5.0]]), np.array([[2.0, 3.0, 5.0]])
    assert normalised_length(limits)(a, b) == pytest.approx([np.sqrt(2)])


def test_more_waypoints_lower_the_acceleration_and_leave_the_length():
    mechanism = arm()
    a, b = drawn(mechanism.limits, 1, 0.5, seed=3)
    halves = np.array([a[0], (a[0] + b[0]) / 2, b[0]])
    for eta, ratio in (((1.0, 0.0), 1.0), ((0.0, 1.0), 0.5)):
        cost = published_cost(mechanism, mechanism.limits, eta)
        whole = total(cost, np.array([a[0], b[0]]))
        assert total(cost, halves) == pytest.approx(ratio * whole, rel=0.2)


def test_a_search_by_the_weights_finds_what_they_ask_for():
    space = space_of(arm(), post(0.52, 0))
    start, goal = np.array([-1.1, 0.2, 0.1]), np.array([1.1, 0.2, 0.1])
    costs = {eta: published_cost(space.mechanism, space.limits, eta) for eta in ((1.0, 0.0), (0.0, 1.0))}
    paths = {}
    for eta, cost in costs.items():
        search = FmtSearch(space, start, goal, space.limits, np.random.default_rng(1), cost)
        paths[eta] = search.path(250)
    short, smooth = paths[1.0, 0.0], paths[0.0, 1.0]
    assert total(costs[1.0, 0.0], short) < total(costs[1.0, 0.0], smooth)
    assert total(costs[0.0, 1.0], smooth) < total(costs[0.0, 1.0], short)
    assert len(smooth) > len(short), "as in the paper: 54 waypoints instead of 36"


def test_an_arm_with_loops_is_refused():
    with pytest.raises(ProtocolError, match='cost = "published" needs an arm without loops'):
        squared_acceleration(four_bar())


def test_weights_belong_to_the_published_cost():
    def read(**keys):
        return FreeTable.model_validate({"type": "free", "name": "out", "to": "far", **keys}).phase(None)

    assert read(cost="published").eta == (0.1, 0.5)
    assert read(cost="published", eta1=1, eta2=0).eta == (1.0, 0.0)
    for keys, words in (
        ({"eta1": 1.0}, 'has no effect with cost = "length"'),
        ({"cost": "published", "eta1": 0, "eta2": 0}, "both 0"),
        ({"cost": "published", "eta2": -1}, "greater than or equal to 0"),
    ):
        with pytest.raises(ValueError, match=words):
            read(**keys)


def test_the_cost_of_a_protocol_is_that_with_the_papers_weights():
    space = space_of(arm())
    a, b = drawn(space.limits, 5, 0.5)
    np.testing.assert_array_equal(COSTS["published"](space)(a, b), published_cost(space.mechanism, space.limits)(a, b))
