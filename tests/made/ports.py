"""Ports of servers that tests start."""

from __future__ import annotations

import random
import socket


def free_port():
    """Return a port of this machine on which nobody listens.

    It is below the ports that the system gives to connections and to servers without a port of their own: until the
    server has begun to listen, which takes seconds, nobody else gets it by chance.
    """
    for port in random.SystemRandom().sample(range(12_000, 30_000), 1000):
        with socket.socket() as s:
            try:
                s.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
    raise OSError("no free port")
