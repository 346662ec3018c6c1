"""A robot that stands where its machine stands: what is refused, and a connection that comes again."""

from __future__ import annotations

import asyncio
import socket
import time

import numpy as np
import pytest

import twin
from twin.simulation.machine.machine_link import Address
from twin.simulation.machine.machine_server import HOST
from twin.ui.headset.client_messages import PostureMessage, RefusedError, UndoMessage
from twin.ui.headset.live_robot import LiveRobot
from twin.ui.session import driven_machine


class Still:
    """A machine that stands where the robot stands."""

    problem = ""

    def elsewhere(self, q):
        return None

    def state(self):
        return {"level": "PEDAL_UP", "behind": None, "problem": None}

    def advance(self, passed, goal, held):
        pass

    def close(self):
        pass


def test_postures_and_undo_are_refused_where_a_machine_leads_and_undo_keeps_its_entry():
    async def play():
        shown = LiveRobot(twin.load("pa10"), "pa10", None, False, machine=Still())
        try:
            shown._undo_states = [np.array(shown.movable.assembly.q) + 0.1]
            name = next(iter(shown.movable.postures))
            with pytest.raises(RefusedError, match="a posture moves no machine: drag the tool instead"):
                shown.ask("c1", PostureMessage(type="posture", name=name))
            with pytest.raises(RefusedError, match="undo moves no machine"):
                shown.ask("c1", UndoMessage(type="undo"))
            assert len(shown._undo_states) == 1
            assert shown.state()["machine"]["level"] == "PEDAL_UP"
        finally:
            shown.close()

    asyncio.run(play())


def test_a_machine_that_answers_again_is_connected_again(monkeypatch):
    monkeypatch.setattr(driven_machine, "_CONNECTION_PAUSE", 0.01)
    with socket.socket() as states:
        states.bind((HOST, 0))  # nobody listens yet: connections are refused
        again = driven_machine.Reconnection(Address(HOST, 9, states.getsockname()[1]), 6)
        assert again.take() is None
        states.listen()
        end = time.monotonic() + 60
        link = None
        while link is None:
            assert time.monotonic() < end
            link = again.take()
        assert link.reader.problem == ""
        again.close()  # the connection belongs to who has taken it
        assert link.reader.problem == ""
        link.close()
