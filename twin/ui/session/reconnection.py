"""Connect to a machine again, in a thread, after it has ended the connection or was started anew."""

from __future__ import annotations

import threading

from twin.core.errors import DeviceError
from twin.simulation.machine.machine_link import Address, MachineLink

_PAUSE = 0.5
"""Time in s before each attempt to connect."""


class Reconnection:
    """Attempts to connect to a machine, one after the other, until it answers."""

    def __init__(self, address: Address, n: int) -> None:
        """Begin the attempts to connect to a machine of n joints."""
        self._address = address
        self._n = n
        self._link: MachineLink | None = None
        self._lock = threading.Lock()  # of `_link`, and of the decision that nobody takes it any more
        self._ends = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def take(self) -> MachineLink | None:
        """Return the new connection, which the caller closes from then on; None: the machine does not answer yet."""
        with self._lock:
            link = self._link
            self._link = None
        return link

    def close(self) -> None:
        """End the attempts, and close a connection that nobody has taken."""
        with self._lock:
            self._ends.set()
        link = self.take()
        if link is not None:
            link.close()

    def _run(self) -> None:
        while not self._ends.wait(_PAUSE):
            try:
                link = MachineLink(self._address, self._n)
            except DeviceError:
                continue
            with self._lock:
                is_wanted = not self._ends.is_set()
                if is_wanted:
                    self._link = link
            if not is_wanted:
                link.close()
            return
