"""Goals of ROS clients are taken only in the frame and for the joint of their topic; addresses for ROS and MQTT."""

from __future__ import annotations

import errno
import socket
from argparse import ArgumentTypeError

import numpy as np
import pytest

from made.ros_client import stamped
from twin.cli.commands.serve import _broker
from twin.cli.parser import host_and_port
from twin.cli.server_address import ros_port_and_url
from twin.core.errors import DeviceError, TwinError
from twin.ui.headset.ros.operations import JointState, PoseStamped, checked_message


def posed(**header):
    message = stamped(np.eye(4))
    message["header"] = header
    return checked_message(PoseStamped, message)


def test_a_goal_in_another_frame_is_refused():
    posed().require_frame("sils/base")
    posed(frame_id="").require_frame("sils/base")
    posed(frame_id="sils/base").require_frame("sils/base")
    with pytest.raises(DeviceError, match="frame_id is 'sils/tool'; give the pose in sils/base"):
        posed(frame_id="sils/tool").require_frame("sils/base")


def test_a_position_of_another_joint_is_refused():
    def value(**message):
        return checked_message(JointState, message).value_of("jaw")

    assert value(position=[0.2]) == value(name=["jaw"], position=[0.2]) == 0.2
    with pytest.raises(DeviceError, match=r"name is \['wrist'\]; give \['jaw'\]"):
        value(name=["wrist"], position=[0.2])
    with pytest.raises(DeviceError, match="there are 7 positions; give one, that of jaw"):
        value(position=[0.2] * 7)
    with pytest.raises(DeviceError, match="name is"):
        value(name=["wrist", "jaw"], position=[0.2])


def test_addresses_for_ros_clients_can_be_opened():
    port, url = ros_port_and_url(*host_and_port("0"), False)
    assert url == f"ws://127.0.0.1:{port}"
    port, url = ros_port_and_url(*host_and_port("0.0.0.0:0"), False)
    assert url.startswith("ws://")
    assert "0.0.0.0" not in url  # no address of a computer
    assert host_and_port("[::1]:9090") == ("::1", 9090)


def test_a_broker_may_have_an_address_of_ipv6():
    assert _broker("[::1]") == ("::1", 1883)
    assert _broker("[::1]:1884") == ("::1", 1884)
    assert _broker("localhost:1884") == ("localhost", 1884)
    for text in ("::1", "::1:1884", "[::1]:1884:1", "[::1", "[::1]1884", "[]", ":1884"):
        with pytest.raises(ArgumentTypeError):
            _broker(text)


def test_an_address_that_cannot_be_opened_is_refused_with_the_cause(monkeypatch):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(TwinError, match="the port is in use; choose another one"):
            ros_port_and_url("127.0.0.1", other.getsockname()[1], False)
    with pytest.raises(TwinError, match=r"203\.0\.113\.1:0: the host is not an address of this computer; choose"):
        ros_port_and_url("203.0.113.1", 0, False)

    def reserved(self, address):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", reserved)
    with pytest.raises(TwinError, match=r"127\.0\.0\.1:80: this user may not listen on the port"):
        ros_port_and_url("127.0.0.1", 80, False)


@pytest.mark.skipif(not socket.has_ipv6, reason="this computer has no IPv6")
def test_addresses_of_ipv6_are_in_brackets():
    try:
        port, url = ros_port_and_url("::1", 0, True)
    except TwinError:
        pytest.skip("IPv6 is switched off")
    assert url == f"wss://[::1]:{port}"
