"""Find a free port for a server, and print the server's address with its token on the terminal."""

from __future__ import annotations

import errno
import socket

from twin.core.errors import TwinError
from twin.core.extras import require


def free_port(host: str, port: int) -> int:
    """Return `port` if this port is free; if `port` is 0, return any free port.

    Raises:
        TwinError: the port is in use (the message names a free port), or `host` is not an address of this computer.
    """
    try:
        return _bound_port(host, port)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            free = _bound_port(host, 0)
            raise TwinError(
                f"port {port} is in use, possibly by another twin command: stop that process, or use the free port "
                f"{free} (--port {free})"
            ) from error
        raise TwinError(f"cannot listen on {_with_port(host, port)}: {error.strerror or error}") from error


def ros_address(host: str, port: int, secure: bool) -> tuple[int, str]:
    """Return a free port (see `free_port`) for ROS clients, and the address of the server for them.

    Raises:
        TwinError: the port is in use or reserved, or `host` is not an address of this computer.
    """
    try:
        free = _bound_port(host, port)
    except OSError as error:
        raise TwinError(f"--ros {_with_port(host, port)}: {_cause(error)}; choose another one") from error
    url = PageAddress(host, free, secure, "ROS").url
    return free, url.replace("http", "ws", 1).rstrip("/")


def _bound_port(host: str, port: int) -> int:
    """Return the port on which a server can listen; `port` 0: any free port.

    Raises:
        OSError: no server of this user can listen there.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        # as servers do: a port whose last connections are still closing is free
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
        return int(probe.getsockname()[1])


def _cause(error: OSError) -> str:
    """Return why no server can listen on an address."""
    if error.errno == errno.EADDRINUSE:
        return "the port is in use"
    if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
        return "the host is not an address of this computer"
    if error.errno == errno.EACCES:
        return "this user may not listen on the port (ports below 1024 are often reserved)"
    return f"no server can listen there: {error.strerror or error}"


def _with_port(host: str, port: int) -> str:
    """Return HOST:PORT as in addresses of pages; an address of IPv6 is in brackets."""
    if ":" in host:
        return f"[{host}]:{port}"
    return f"{host}:{port}"


_ALL_ADDRESSES = ("0.0.0.0", "::", "")
"""Values of --host with which a server listens on all addresses of this machine."""


class PageAddress:
    """The address of a page, as printed on the terminal.

    `url` is the address for a browser on this machine or, if the server is open to the network, on another machine;
    `advice` is printed if the server is open to the network.
    """

    def __init__(self, host: str, port: int, secure: bool, title: str, advice: str = "") -> None:
        self.title = title
        self.advice = advice
        reachable_host = host
        if host in _ALL_ADDRESSES:  # a browser cannot open these
            reachable_host = _reachable()
        scheme = "https" if secure else "http"
        self.url = f"{scheme}://{_with_port(reachable_host, port)}/"
        self._is_first = True

    def say(self, token: str) -> None:
        """Print the address; if there is a token (valid for one device), also print a QR code."""
        if not token:
            print(f"{self.title}: {self.url}   (Ctrl-C stops the server)", flush=True)
            return
        url = f"{self.url}?token={token}"
        if self._is_first:
            print(f"{self.title}: open to the network; each address works only once   (Ctrl-C stops the server)")
            if self.advice:
                print(f"  {self.advice}")
        else:
            print("  a device is connected; address for the next device:")
        self._is_first = False
        try:
            require("segno", "a QR code").make(url, error="m").terminal(compact=True)
        except TwinError as error:  # without the package for QR codes, only the address is printed
            print(f"  {error}")
        print(f"  {url}", flush=True)


def _reachable() -> str:
    """Return the IP address of this machine in its network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # reserved address (RFC 5737): nothing is sent, but the socket then has the address of this machine
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:  # no network
            return socket.gethostname()
