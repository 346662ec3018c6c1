"""How punctual `twin machine` is: 1 kHz for 60 s with a master that sends 1000 packets a second, and one connection.

    python tests/benchmarks/machine_pace.py [seconds] [--priority]

--priority gives the machine real-time priority (chrt -f 1), which needs the right to do so.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time

import numpy as np

from twin.simulation.machine.itp import pack

STILL = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1.0])


def main(seconds: float) -> None:
    """Run the machine, send packets, read states; print the machine's own figures and the load of the computer."""
    first = ["chrt", "-f", "1"] if "--priority" in sys.argv else []
    command = [*first, sys.executable, "-m", "twin", "machine", "raven_left", "--start", "--duration", f"{seconds}"]
    with subprocess.Popen([*command, "--state-port", "36001", "--port", "36000"], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        states = socket.create_connection(("127.0.0.1", 36001))
        received = [0]

        def read() -> None:
            while data := states.recv(65536):
                received[0] += len(data)

        threading.Thread(target=read, daemon=True).start()
        out = socket.socket(type=socket.SOCK_DGRAM)
        begin, k = time.monotonic(), 1
        while process.poll() is None and time.monotonic() - begin < seconds:
            step = STILL.copy()
            step[:3] = np.round([20 * np.cos(k / 500), 15 * np.sin(k / 400), 10 * np.cos(k / 700)])
            out.sendto(pack(k, 0, step), ("127.0.0.1", 36000))
            k += 1
            time.sleep(max(begin + k * 1e-3 - time.monotonic(), 0))
        text = process.communicate()[0].decode()
    print(text, end="")
    print(json.dumps({"load": os.getloadavg(), "states": received[0] / (48 + 24 * 7), "packets sent": k - 1}))


if __name__ == "__main__":
    numbers = [float(a) for a in sys.argv[1:] if a != "--priority"]
    main(numbers[0] if numbers else 60.0)
