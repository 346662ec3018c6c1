"""The master that moves the tool of a machine to goals, in simulated time: pace, targets out of reach, lost packets."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin.api.machine import machine, machine_parts
from twin.core import spatial
from twin.core.units import MM
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_master import MachineMaster
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.state_packets import State

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("sils"))


class MovableRobot:
    """A machine and its master, tick by tick: a packet arrives in the next tick, unless it is lost."""

    problem = ""

    def __init__(self, parts):
        self.machine = machine(parts)
        self.machine.start()
        self.master = MachineMaster(self, parts)
        self.waiting = []
        self.state = None
        self.ticks = 0
        self.lost = lambda number: False
        self.fastest = 0.0

    def send(self, packet):
        if not self.lost(self.ticks):
            self.waiting.append(packet)

    def run(self, ticks, goal=None):
        for _ in range(ticks):
            if goal is not None:
                self.master.lead(goal)
            self.master.step(1)
            packets, self.waiting = self.waiting[:2], self.waiting[2:]
            m = self.machine
            m.step(self.ticks * TICK, [(packet, "master") for packet in packets])
            r = m.receiver
            counts = (r.sequence, r.accepted, r.refused, m.held, 0)
            self.state = State(
                m.plc.level, r.pedal(m.t), m.tick, m.t, *counts, m.q.copy(), m.wanted.copy(), m.dac.copy()
            )
            self.ticks += 1
            self.fastest = max(self.fastest, np.abs(m.plant.qd).max())

    @property
    def tool(self):
        return self.master.tool(self.machine.wanted).copy()


def moved(T, way):
    return spatial.pose(T[:3, :3], T[:3, 3] + np.array(way) * MM)


def test_no_carriage_is_faster_than_its_limit_on_the_way_to_a_singularity(parts):
    """The way ends where carriages 3 and 4 would come closer than 40 mm; q4 there needs 9 times the tool's speed."""
    movable = MovableRobot(parts)
    movable.run(100)
    goal = moved(movable.tool, (41, -10, -91))
    movable.run(6000, goal)
    assert movable.master.held
    assert movable.machine.reason == ""
    q = movable.machine.wanted
    assert 0.04 <= q[2] - q[3] < 0.05
    assert 0.06 < movable.fastest < 0.1  # m/s; the limit of sils.toml is 0.1, at 0.2 the machine would stop


def test_lost_packets_are_made_up_for(parts):
    movable = MovableRobot(parts)
    movable.run(100)
    goal = moved(movable.tool, (3, 2, -4))
    movable.lost = lambda number: number % 7 == 0
    movable.run(1200, goal)
    movable.lost = lambda number: False
    movable.run(1000, goal)
    assert movable.machine.receiver.refused > 20
    np.testing.assert_allclose(movable.tool, goal, atol=6e-6)


def test_a_master_that_rests_lets_the_machine_stop_and_another_one_take_it(parts):
    movable = MovableRobot(parts)
    movable.run(100)
    goal = moved(movable.tool, (0, 0, -20))
    movable.run(300, goal)
    assert movable.machine.level == Level.PEDAL_DN
    movable.master.rest()
    movable.run(200)
    assert movable.machine.level == Level.PEDAL_UP
    q = movable.machine.plant.q.copy()
    sequence = movable.machine.receiver.sequence
    movable.run(1000)
    assert np.abs(movable.machine.plant.q - q).max() < 1e-6
    assert movable.machine.receiver.sequence == sequence
    assert movable.machine.receiver.silent(movable.machine.t)
