"""The address of a server of twin: a port that is free, the URL for its clients, and the lines that print it."""

from __future__ import annotations

import errno
import socket

from twin.core.errors import TwinError
from twin.core.extras import require

_ALL_ADDRESSES = ("0.0.0.0", "::", "")
"""Values of --host with which a server listens on all addresses of this machine."""


def free_port(host: str, port: int) -> int:
    """Return `port` if a server can listen there now; for `port` 0, any free port.

    Args:
        host: name or IP address of this machine on which the server will listen, as in --host.
        port: TCP port, 0 to 65535.

    Raises:
        TwinError: the port is in use (the message names a free port), or `host` is not an address of this computer.
    """
    try:
        return _listening_port(host, port)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            free = _listening_port(host, 0)
            raise TwinError(
                f"port {port} is in use, possibly by another twin command: stop that process, or use the free port "
                f"{free} (--port {free})"
            ) from error
        raise TwinError(f"cannot listen on {_authority(host, port)}: {error.strerror or error}") from error


def ros_port_and_url(host: str, port: int, secure: bool) -> tuple[int, str]:
    """Return (a free port for ROS clients, the URL that they open): ws://HOST:PORT, or wss:// if the server has TLS.

    Args:
        host: name or IP address of this machine on which the server will listen, as in --ros.
        port: TCP port; 0: any free one.
        secure: whether the server has TLS.

    Raises:
        TwinError: the port is in use or reserved, or `host` is not an address of this computer.
    """
    try:
        free = _listening_port(host, port)
    except OSError as error:
        raise TwinError(f"--ros {_authority(host, port)}: {_reason(error)}; choose another one") from error
    scheme = "wss" if secure else "ws"
    return free, _client_url(scheme, host, free)


def _listening_port(host: str, port: int) -> int:
    """Return the port on which a server can listen, by listening there for a moment; `port` 0: any free port.

    Raises:
        OSError: no server of this user can listen there.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        # as servers do: a port whose last connections are still closing is free
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
        return int(probe.getsockname()[1])


def _reason(error: OSError) -> str:
    """Return in words why no server can listen on an address."""
    if error.errno == errno.EADDRINUSE:
        return "the port is in use"
    if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
        return "the host is not an address of this computer"
    if error.errno == errno.EACCES:
        return "this user may not listen on the port (ports below 1024 are often reserved)"
    return f"no server can listen there: {error.strerror or error}"


def _client_url(scheme: str, host: str, port: int) -> str:
    """Return SCHEME://HOST:PORT for clients; of a server on all addresses, with the host under which others find it."""
    if host in _ALL_ADDRESSES:  # a client cannot open these
        host = _own_address_in_network()
    return f"{scheme}://{_authority(host, port)}"


def _authority(host: str, port: int) -> str:
    """Return HOST:PORT, the authority of a URL; an IPv6 address is in brackets."""
    if ":" in host:
        return f"[{host}]:{port}"
    return f"{host}:{port}"


def _own_address_in_network() -> str:
    """Return the IP address of this machine in its network; without a network, its host name."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # reserved address (RFC 5737): nothing is sent, but the socket then has the address of this machine
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


class PageAddress:
    """The address of a page, printed on the terminal when the server starts, and again for each further device.

    Attributes:
        url: URL for a browser on this machine or, if the server is open to the network, on another one.
        title: name of the page, printed before the URL.
        advice: line that is printed once if the server is open to the network; "" for none.
    """

    def __init__(self, host: str, port: int, secure: bool, title: str, advice: str = "") -> None:
        self.title = title
        self.advice = advice
        scheme = "https" if secure else "http"
        self.url = _client_url(scheme, host, port) + "/"
        self._is_printed = False

    def announce(self, token: str) -> None:
        """Print the URL; for a server that is open to the network, with a token and as a QR code.

        Args:
            token: lets one device in, so that each device needs its own; "": the server is not open to the network.
        """
        if not token:
            print(f"{self.title}: {self.url}   (Ctrl-C stops the server)", flush=True)
            return
        url_with_token = f"{self.url}?token={token}"
        if not self._is_printed:
            print(f"{self.title}: open to the network; each address works only once   (Ctrl-C stops the server)")
            if self.advice:
                print(f"  {self.advice}")
        else:
            print("  a device is connected; address for the next device:")
        self._is_printed = True
        try:
            qr_code = require("segno", "a QR code").make(url_with_token, error="m")
            qr_code.terminal(compact=True)
        except TwinError as error:  # without the package for QR codes, only the address is printed
            print(f"  {error}")
        print(f"  {url_with_token}", flush=True)
