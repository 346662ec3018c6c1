"""States of hands that arrive from outside the World: their sequence numbers, and states of another thread."""

from __future__ import annotations

import numpy as np
import pytest

from twin.simulation.devices.received_hands import HandState, ReceivedHands

LAST_NUMBER = 2**32 - 1


def state(hand, number, grip=0.0):
    return HandState(hand, False, False, number, np.eye(4), grip)


@pytest.mark.parametrize(
    ("right", "left", "earliest"),
    [(7, 5, 5), (5, 7, 5), (3, LAST_NUMBER, LAST_NUMBER), (LAST_NUMBER - 1, 0, 0xFFFFFFFE)],
)
def test_the_earliest_number_that_both_hands_have_sent(right, left, earliest):
    device = ReceivedHands("pedals")
    device.give(state(0, right))
    device.step({}, 0.0, 1e-3)
    assert device.heard == -1
    device.give(state(1, left))
    device.step({}, 1e-3, 1e-3)
    assert device.heard == earliest


def test_no_state_is_lost_after_the_last_number():
    device = ReceivedHands("pedals")
    for number in (LAST_NUMBER - 1, LAST_NUMBER, 0, 2):
        device.give(state(0, number))
    signals = device.step({}, 0.0, 1e-3)
    assert signals["right.lost"] == 1.0
    assert signals["pedals.ignored"] == 0.0


def test_a_state_that_arrives_during_a_tick_is_used_in_the_next(monkeypatch):
    device = ReceivedHands("pedals")
    accept = device._accept
    late = [state(0, 2, grip=0.5)]

    def accept_while_another_arrives(arrived, t):
        accept(arrived, t)
        if late:
            device.give(late.pop())

    monkeypatch.setattr(device, "_accept", accept_while_another_arrives)
    device.give(state(0, 1))
    assert device.step({}, 0.0, 1e-3)["right.grip"] == 0.0
    assert device.step({}, 1e-3, 1e-3)["right.grip"] == 0.5


def test_hands_that_leave_during_a_tick_are_silent(monkeypatch):
    device = ReceivedHands("pedals")
    accept = device._accept

    def accept_and_leave(arrived, t):
        accept(arrived, t)
        device.leave()

    monkeypatch.setattr(device, "_accept", accept_and_leave)
    device.give(state(0, 1))
    device.give(state(1, 1))
    assert device.step({}, 0.0, 1e-3)["pedals.silent"] == 1.0


def test_a_state_from_before_leaving_does_not_keep_the_next_sender_out(monkeypatch):
    device = ReceivedHands("pedals", moving=(0,))
    accept = device._accept

    def leave_and_accept(arrived, t):
        device.leave()
        accept(arrived, t)

    device.give(state(0, 1))
    with monkeypatch.context() as patch:
        patch.setattr(device, "_accept", leave_and_accept)
        device.step({}, 0.0, 1e-3)
    device.give(state(0, 500_000, grip=0.5))
    signals = device.step({}, 1e-3, 1e-3)
    assert (signals["right.grip"], signals["pedals.ignored"], signals["pedals.silent"]) == (0.5, 0.0, 1.0)
    assert device.step({}, 2e-3, 1e-3)["pedals.silent"] == 0.0
