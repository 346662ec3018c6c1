"""Where a server is: a port that is free, the address that the terminal shows, and the token in it."""

from __future__ import annotations

import socket

from twin.core.errors import TwinError
from twin.core.extras import require


def free_port(host: str, port: int) -> int:
    """Return the port if it is free; 0 takes any.

    Raises:
        TwinError: something listens there, or the host is not this machine's; with what would do.
    """
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind((host, port))
        except OSError as error:
            if error.errno in (98, 48, 10048):  # in use, on Linux, macOS, Windows
                with socket.socket() as other:
                    other.bind((host, 0))
                    free = other.getsockname()[1]
                raise TwinError(
                    f"port {port} is taken, perhaps by another twin view: end that, or use --port {free}, which is free"
                ) from error
            raise TwinError(f"cannot listen on {host}:{port}: {error.strerror or error}") from error
        return int(s.getsockname()[1])


class Address:
    """Where the page is, as the terminal shows it.

    Attributes:
        url: for a browser on this machine, or in the network that the server is open to.
        title: of what is served.
        advice: what to tell a person who opens it to the network.
    """

    def __init__(self, host: str, port: int, secure: bool, title: str, advice: str = "") -> None:
        self.title, self.advice = title, advice
        shown = _reachable() if host in ("0.0.0.0", "::", "") else host
        shown = f"[{shown}]" if ":" in shown else shown
        self.url = f"{'https' if secure else 'http'}://{shown}:{port}/"
        self._first = True

    def say(self, token: str) -> None:
        """Print the address; with a token also as a QR code, for one device."""
        if not token:
            print(f"{self.title}: {self.url}   (Ctrl-C ends it)", flush=True)
            return
        url = f"{self.url}?token={token}"
        if self._first:
            print(f"{self.title}: open to the network; each address opens once   (Ctrl-C ends it)")
            if self.advice:
                print(f"  {self.advice}")
        else:
            print("  a device has come in; for the next one:")
        self._first = False
        try:
            require("segno", "a QR code").make(url, error="m").terminal(compact=True)
        except TwinError as error:  # the address alone does as well
            print(f"  {error}")
        print(f"  {url}", flush=True)


def _reachable() -> str:
    """Return the address of this machine in its network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        try:
            s.connect(("192.0.2.1", 9))  # an address of documentation: nothing is sent, a route is chosen
            return str(s.getsockname()[0])
        except OSError:
            return socket.gethostname()
