"""The plant with cables: against the plant without, against a Runge-Kutta method with Pinocchio, and at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.core.errors import MechanismError
from twin.core.units import DEG
from twin.reference import inertia
from twin.simulation.dynamics.arm import arm
from twin.simulation.machine.cable_plant import CablePlant, Cables
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import TICK, Physics

HOME = np.array([30 * DEG, 90 * DEG, 0.4, 0, 0, 0, 0])
SOFT = Cables(
    stiffness=np.array([200, 100, 1e4, 1, 1, 1, 1.0]),
    play=np.array([0.0075, 0.0087, 0.0005, 0.087, 0.087, 0.087, 0.087]),
    damping=np.array([4, 4, 200, 0.01, 0.01, 0.01, 0.01]),
    coulomb=np.zeros(7),
)


@pytest.fixture(scope="module")
def model():
    robot = twin.load("raven_left")
    return arm(robot.mechanism, inertia.of_robot(robot.files.cad))


@pytest.fixture(scope="module")
def plant(model):
    """A plant with cables and without Coulomb friction, compiled once."""
    return CablePlant(model, Physics.of(model), SOFT)


def torques(model, t):
    """Motor torques (7,) that hold the arm at home and sway it."""
    efforts = model.dynamics().gravity(HOME) + np.array([3, 2, 20, 0.02, 0.02, 0.02, 0.02]) * np.sin(8 * t)
    return model.mechanism.motor_matrix.T @ efforts


@pytest.mark.slow
def test_stiff_cables_without_play_move_the_arm_like_no_cables(model, plant):
    stiff = Cables(np.array([1e6, 1e6, 1e8, 1e3, 1e3, 1e3, 1e3]), np.zeros(7), np.zeros(7), np.zeros(7))
    cabled, rigid = CablePlant(model, Physics.of(model), stiff), MotorPlant(model, Physics.of(model))
    for each in (cabled, rigid):
        each.reset(HOME)
        for k in range(300):
            each.advance(torques(model, k * TICK))
    assert np.abs(rigid.q - HOME)[:3].max() > 1e-3, "it has moved"
    np.testing.assert_allclose(cabled.q, rigid.q, atol=2e-5)
    np.testing.assert_allclose(cabled.encoded, cabled.q, atol=2e-5)


@pytest.mark.slow
def test_links_and_motors_move_as_another_method_integrates_them(model, plant):
    """Runge-Kutta of fourth order, Pinocchio's equations, the cables' forces written here again; no Coulomb friction.

    The cables of the tool, whose links are very light, are softer: the explicit method would need tiny steps.
    """
    cables = replace(
        SOFT,
        stiffness=np.array([200, 100, 1e4, 0.05, 0.05, 0.05, 0.05]),
        damping=np.array([4, 4, 200, 1e-5, 1e-5, 1e-5, 1e-5]),
    )
    plant = CablePlant(model, plant.physics, cables)
    bare = [replace(actuator, rotor_inertia=None) for actuator in model.mechanism.actuators]
    links = replace(model, mechanism=replace(model.mechanism, actuators=tuple(bare)))
    dynamics = links.dynamics(friction=0.0)
    outward = np.linalg.inv(model.mechanism.motor_matrix)
    rotors = outward.T @ np.diag(plant.physics.rotors) @ outward
    fine, ticks = 8, 200

    def rates(x, effort):
        q, qd, p, pd = x
        apart = p - q
        slack = np.abs(apart) <= SOFT.play
        pull = cables.stiffness * (apart - np.sign(apart) * SOFT.play) + cables.damping * (pd - qd)
        pull[slack] = 0
        qdd = dynamics.forward(dynamics.near(q), qd, pull)
        pdd = np.linalg.solve(rotors, effort - pull - plant.physics.viscous * pd)
        return np.array([qd, qdd, pd, pdd])

    plant.reset(HOME)
    x = np.array([HOME, 0 * HOME, HOME, 0 * HOME])
    h = TICK / fine
    for k in range(ticks):
        motor = torques(model, k * TICK)
        plant.advance(motor)
        effort = outward.T @ motor
        for _ in range(fine):
            a = rates(x, effort)
            b = rates(x + h / 2 * a, effort)
            c = rates(x + h / 2 * b, effort)
            d = rates(x + h * c, effort)
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
    q, _, p, _ = x
    # without the tool: its light links ring faster than a tick, and the implicit method damps that
    moved = np.abs(q - HOME)[:3].max()
    assert moved > 0.02
    np.testing.assert_allclose(plant.q[:3], q[:3], atol=0.02 * moved)
    np.testing.assert_allclose(plant.encoded[:3], p[:3], atol=0.02 * moved)
    assert abs(plant.q - plant.encoded)[1] > SOFT.play[1], "the elbow's cable is stretched"


@pytest.mark.slow
def test_at_rest_the_links_hang_in_their_cables(model, plant):
    """Motors that do not move carry gravity by the stretch of the cables, at the side of their play."""
    heavy = replace(plant.physics, coulomb=np.full(7, 1e4), rotors=plant.physics.rotors)
    held = plant.another(heavy)
    held.reset(HOME)
    for _ in range(6000):
        held.advance(np.zeros(7))
    np.testing.assert_allclose(held.encoded, HOME, atol=1e-9)
    gravity = model.dynamics().gravity(held.q)
    expected = SOFT.play * np.sign(gravity) + gravity / SOFT.stiffness
    np.testing.assert_allclose((held.encoded - held.q)[:3], expected[:3], rtol=0.02)


def test_wrong_cables_are_named(model):
    for name, value, words in (
        ("stiffness", 0.0, "stiffness of shoulder is 0; it must be above 0"),
        ("play", -1.0, "play of shoulder is -1; it must be at least 0"),
        ("damping", np.nan, "damping of shoulder is nan"),
    ):
        values = getattr(SOFT, name).copy()
        values[0] = value
        with pytest.raises(MechanismError, match=words):
            replace(SOFT, **{name: values}).checked(model)
    with pytest.raises(MechanismError, match=r"play has shape \(3,\)"):
        replace(SOFT, play=np.zeros(3)).checked(model)
