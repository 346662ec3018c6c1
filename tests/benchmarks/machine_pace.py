"""How punctual `twin machine` is: 1 kHz for 60 s with a master that sends 1000 packets a second, and one connection.

    python tests/benchmarks/machine_pace.py [seconds] [--priority]
    python tests/benchmarks/machine_pace.py --both [--priority]

--priority gives the machines real-time priority (chrt -f 1), which needs the right to do so. --both: two machines
that `twin operate raven` controls with both hands; the figures are those from its start to its end.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np

from twin.simulation.machine.itp import pack

TWIN = [sys.executable, "-m", "twin"]
PRIORITY = ["chrt", "-f", "1"] if "--priority" in sys.argv else []
STILL = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1.0])


def both() -> None:
    """Run the machines of both arms under one operation; print the figures of all three, and the load."""
    running = {}
    for k, name in enumerate(("raven_left", "raven_right")):
        ports = str(36010 + 2 * k), str(36011 + 2 * k)
        command = [*PRIORITY, *TWIN, "machine", name, "--start", "--json", "--port", ports[0], "--state-port", ports[1]]
        running[name] = ":".join(ports), subprocess.Popen(command, stdout=subprocess.PIPE)
    for where, _ in running.values():
        while socket.socket().connect_ex(("127.0.0.1", int(where.split(":")[1]))):
            time.sleep(0.1)
    with tempfile.TemporaryDirectory() as folder:
        given = [x for name, (where, _) in running.items() for x in ("--machine", f"{name}={where}")]
        command = [*TWIN, "operate", "raven", "--quiet", "--trials", "2", "--out", folder, *given]
        text = subprocess.run(command, stdout=subprocess.PIPE, text=True).stdout
    for _, process in running.values():
        process.send_signal(signal.SIGINT)
        found = json.loads(process.communicate()[0])
        print(
            json.dumps(
                {k: found[k] for k in ("robot", "level", "accepted", "ticks", "late", "p50_ms", "p99_ms", "max_ms")}
            )
        )
    print(text, end="")
    print(json.dumps({"load": os.getloadavg()}))


def main(seconds: float) -> None:
    """Run the machine, send packets, read states; print the machine's own figures and the load of the computer."""
    command = [*PRIORITY, *TWIN, "machine", "raven_left", "--start", "--duration", f"{seconds}"]
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
    numbers = [float(a) for a in sys.argv[1:] if not a.startswith("--")]
    both() if "--both" in sys.argv else main(numbers[0] if numbers else 60.0)
