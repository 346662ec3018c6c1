"""The haptic cue: both readings of the paper's equation (5), and machine and model side by side."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin.api.machine import machine, machine_parts
from twin.core.errors import TwinError
from twin.simulation.controllers.cue import Cue
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.itp import pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_and_model import MachineAndModel

REST = np.zeros(3)


def size(mm, mm_s=0.0, **cue):
    return np.linalg.norm(Cue(**cue).force(np.array([mm * 1e-3, 0, 0]), np.array([0, mm_s * 1e-3, 0])))


@pytest.mark.parametrize(
    ("mm", "mm_s", "expected"),
    [(0, 0, 0), (0, 100, 0), (2.999, 0, 0), (2.999, 500, 0), (3.001, 0, 0.3001), (3.001, 50, 0.4001), (14, 0, 1.4)],
)
def test_the_corrected_reading(mm, mm_s, expected):
    assert size(mm, mm_s) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("mm", "mm_s"), [(16, 0), (1e4, 0), (3.1, 1e5)])
def test_the_force_is_clamped(mm, mm_s):
    assert size(mm, mm_s) == pytest.approx(1.5, abs=1e-12)


@pytest.mark.parametrize(("mm", "expected"), [(0, 0), (1, 0.1), (2.999, 0.2999), (3.001, 0.05), (100, 0.05)])
def test_the_printed_reading_falls_at_the_limit(mm, expected):
    assert size(mm, reading="printed") == pytest.approx(expected, abs=1e-12)


def test_the_force_points_from_the_machine_to_the_model():
    dp = np.array([3e-3, -4e-3, 12e-3])
    force = Cue().force(dp, REST)
    np.testing.assert_allclose(force, 1.3 * dp / 13e-3, atol=1e-12)


def test_a_blended_force_has_no_jump():
    mm = np.linspace(2.9, 6, 3101)
    forces = np.array([size(x, blend=1.0) for x in mm])
    assert np.abs(np.diff(forces)).max() < 1e-3
    assert forces[0] == 0
    assert forces[-1] == pytest.approx(0.6)


@pytest.mark.parametrize("wrong", [{"kp": -1}, {"most": np.inf}, {"tol": np.nan}])
def test_an_impossible_cue_is_refused(wrong):
    with pytest.raises(TwinError, match=f"cue: {next(iter(wrong))} is"):
        Cue(**wrong)


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("raven_left"), overdrive="soft")


def run(parts, faults=(), ticks=500, **physics):
    """Return deviation in m and force in N, both (k,), along a slow circle after homing."""
    pair = MachineAndModel(machine(parts, faults=faults, **physics))
    k = sequence = 0
    out = []
    while len(out) < ticks:
        packets = []
        if pair.model.plc.level in (Level.PEDAL_UP, Level.PEDAL_DN) or sequence:
            sequence += 1
            a = sequence / 200
            step = np.array([round(6 * np.cos(a)), round(6 * np.sin(a)), 0, 1, 0, 0, 0, 0, 1.0])
            packets = [(pack(sequence, 0, step), "master")]
            out.append((pair.deviation, np.linalg.norm(pair.force)))
        pair.step(k * 1e-3, packets)
        k += 1
        if k == 1:
            pair.start()
    return np.array(out).T, pair


def test_without_fault_and_with_another_plant_there_is_no_cue(parts):
    (same, force), pair = run(parts)
    assert same.max() == 0
    assert force.max() == 0
    assert pair.machine.plc.level == Level.PEDAL_DN
    (apart, force), _ = run(parts, mass=1.1, friction=1.3)
    assert 1e-6 < apart.max() < 3e-3
    assert force.max() == 0


def test_a_stuck_dac_is_felt_when_the_tips_are_3_mm_apart(parts):
    """The cue begins in the tick in which the measured tips are more than 3 mm apart."""
    fault = Fault("dac", 300, 600, "overwrite", 2500.0, target=0, counts=True)
    (apart, force), pair = run(parts, [fault], ticks=700)
    felt = int(np.argmax(force > 0))
    assert apart.max() > 5e-3
    assert felt == int(np.argmax(apart > 3e-3))
    assert force[felt] >= 0.3
    assert 300 < felt < 450
    assert abs(pair.compared.joints[0]) > 0.01 or pair.machine.reason
