"""The Raven-II under efforts for ten seconds: in the model, and by the equations of a simulator of others."""

from __future__ import annotations

import json

import numpy as np
import pytest

import twin
from twin.core.units import DEG
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.write import xml_text
from twin.reference import inertia
from twin.simulation.dynamics.arm import arm
from twin.simulation.dynamics.effort_plants import ModelPlant

pytestmark = pytest.mark.witness
TICK, TICKS, FAR = 1e-3, 10_000, 1e-6


@pytest.mark.witness("drake")
@pytest.mark.parametrize("feedback", [True, False], ids=["feedback", "open"])
def test_the_raven_moves_as_it_does_by_drake(foreign, tmp_path, monkeypatch, feedback):
    """Both by Runge-Kutta of fourth order: without friction under the same law of control by the state of each, or by
    the efforts of our run with viscous friction. Without feedback, errors of rounding grow a million times in 10 s: the
    URDF has all digits here, in place of 12 decimals, with which the difference is 1.1e-6."""
    robot = twin.load("raven_left")
    model = arm(robot.mechanism, inertia.of_robot(robot.files.cad))
    viscous = np.zeros(7) if feedback else model.friction
    dynamics = model.dynamics(friction=viscous)
    plant = ModelPlant(dynamics, TICK)
    middle = np.array([30 * DEG, 90 * DEG, 0.4, 0, 0, 0, 0.3])
    sway = np.array([8 * DEG, 6 * DEG, 0.01, 0.5, 0.3, 0.3, 0.1])
    w = 2 * np.pi * np.array([0.25, 0.2, 0.15, 0.3, 0.2, 0.25, 0.3])
    kp, kd = 400 * np.diag(dynamics.rotor), 40 * np.diag(dynamics.rotor)
    t = TICK * np.arange(TICKS)[:, None]
    wanted, rates = middle + sway * (1 - np.cos(w * t)) / 2, sway * w * np.sin(w * t) / 2
    feed = np.array(
        [dynamics.inverse(*row) for row in zip(wanted, rates, sway * w**2 * np.cos(w * t) / 2, strict=True)]
    )
    plant.reset(middle, np.zeros(7))
    ours, efforts = [], []
    for q, qd, effort in zip(wanted, rates, feed, strict=True):
        efforts.append(effort + kp * (q - plant.q) + kd * (qd - plant.qd))
        plant.advance(efforts[-1], TICK)
        ours.append(plant.q)
    monkeypatch.setattr(xml_text, "DECIMALS", 17)
    job = {
        "urdf": str(write_urdf(model.mechanism, tmp_path)),
        "base": model.mechanism.base,
        "joints": [j.name for j in model.mechanism.active],
        "follow": {"jaw_half": {"jaw": 0.5}},
        "rotor": dynamics.rotor.tolist(),
        "viscous": viscous.tolist(),
        "tick": TICK,
        "q": middle.tolist(),
        "wanted": wanted.tolist(),
        "rates": rates.tolist(),
        "feed": (feed if feedback else np.array(efforts)).tolist(),
        "kp": (kp if feedback else 0 * kp).tolist(),
        "kd": (kd if feedback else 0 * kd).tolist(),
    }
    (tmp_path / "job.json").write_text(json.dumps(job))
    found = foreign.read("drake", "move_drake.py", tmp_path / "job.json")
    off = np.abs(np.array(found["q"]) - ours).max(axis=0)
    print(f"Drake {found['version']}: {off}")
    assert off.max() < FAR
