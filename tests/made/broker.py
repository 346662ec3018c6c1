"""An external MQTT broker, mosquitto, on a free port of this machine."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time

import pytest

from made.ports import free_port


def program():
    """Return the path of the broker.

    If it is missing, skip the test with a message, or fail if the environment variable TWIN_WITNESS_REQUIRED is set.
    """
    found = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
    if found is None:
        text = "mosquitto is not installed: apt-get install mosquitto"
        if os.environ.get("TWIN_WITNESS_REQUIRED"):
            pytest.fail(text, pytrace=False)
        pytest.skip(text)
    return found


class Broker:
    """The broker; its port is the same after `stop` and `start`."""

    def __init__(self):
        self.program = program()
        self.port = free_port()
        self.process = None

    def start(self):
        """Start the broker without retained messages."""
        # With only -p, mosquitto accepts connections from this machine only, without passwords.
        self.process = subprocess.Popen([self.program, "-p", str(self.port)], stderr=subprocess.DEVNULL)
        end = time.monotonic() + 60
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), 10).close()
                return self
            except OSError:
                assert self.process.poll() is None, "the broker has ended"
                assert time.monotonic() < end, "the broker does not answer"
                time.sleep(0.02)

    def stop(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None
