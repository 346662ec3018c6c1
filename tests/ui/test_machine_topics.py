"""What the topics of a machine answer to a client, without sockets."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from twin.simulation.machine.levels import Level
from twin.ui.headset.ros.machine_bridge import MachineTopics


class Master:
    """A master that notes what it is given, and whose machine holds the goal or does not."""

    def __init__(self, held: bool):
        self.held = held
        self.opening = None
        self.link = SimpleNamespace(problem="", state=SimpleNamespace(level=Level.PEDAL_DN, wanted=np.zeros(2)))
        joints = [SimpleNamespace(name="q1"), SimpleNamespace(name="jaw")]
        self.parts = SimpleNamespace(
            arm=SimpleNamespace(mechanism=SimpleNamespace(active=joints)), kin=SimpleNamespace(auxiliary=[False, True])
        )

    def tool(self, q):
        return np.eye(4)

    def lead(self, T_base_tool, jaw=None):
        self.opening = jaw


@pytest.mark.parametrize("held", [False, True])
def test_a_client_hears_that_jaws_do_not_move_while_the_goal_is_held(held):
    master = Master(held)
    topics = MachineTopics("arm", master)
    text = topics.inputs["/ARM/jaw/servo_jp"].take("client", {"name": ["jaw"], "position": [0.3]})
    assert master.opening == pytest.approx(0.3)
    assert bool(text) == held
    if held:
        assert "the jaws do not move while the machine holds the tool's goal" in text
