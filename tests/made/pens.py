"""Program of two haptic pens, which sends packets to a port of this machine."""

from __future__ import annotations

import socket
import threading

import numpy as np

from twin.core import spatial
from twin.core.units import DEG
from twin.simulation.devices.packets import FORCE, pack

SIDES = ("right", "left")


class Pens:
    """Poses of both pens in {H}, positions `p` in m; their grip angles in rad; and the pedals."""

    def __init__(self, port):
        self.to, self.number = ("127.0.0.1", port), 0
        self.p = {"right": np.array([0.08, 0, 0]), "left": np.array([-0.08, 0, 0])}
        self.R = {side: np.eye(3) for side in SIDES}
        self.grip = dict.fromkeys(SIDES, 0.0)
        self.clutch = self.camera = False
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.name = f"127.0.0.1:{self.socket.getsockname()[1]}"

    def packets(self):
        """Return a packet of each pen, with the next number."""
        self.number += 1
        return [
            pack(k, self.number, spatial.pose(self.R[s], self.p[s]), self.grip[s], self.clutch, self.camera)
            for k, s in enumerate(SIDES)
        ]

    def send(self, *packets):
        for data in packets or self.packets():
            self.socket.sendto(data, self.to)

    def forces(self):
        """Return (hand, force (3,) in N) of each received answer."""
        found = []
        while True:
            try:
                _, _, hand, _, _, _, *force = FORCE.unpack(self.socket.recv(100))
            except BlockingIOError:
                return found
            found.append((hand, np.array(force)))

    def roll(self):
        """Roll both handles about their axes by 5 deg, which shows that a person holds them."""
        for side in SIDES:
            self.R[side] = self.R[side] @ spatial.rotation_z(5 * DEG)

    def close(self):
        self.socket.close()


class Streaming(Pens):
    """Pens that send 250 packets per second each, until `close`."""

    def __init__(self, port):
        super().__init__(port)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._stream)
        self._thread.start()

    def _stream(self):
        while not self._ended.wait(0.004):
            packets = self.packets()
            if self.number % 20:  # 5 % are lost
                self.send(*packets)

    def close(self):
        self._ended.set()
        self._thread.join()
        super().close()
