"""Access rules: accepted hosts and origins, one-time tokens, and sessions."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections import OrderedDict
from collections.abc import Callable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

MAX_SESSIONS = 64
"""Maximum number of sessions; if there are more, the oldest session becomes invalid."""

_LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")


def is_local(host: str) -> bool:
    """Return whether a server on this host can be reached only from this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class AccessRules:
    """Access rules of one server.

    Attributes:
        needs_token: whether clients need a token or a session, because other machines can reach the server.
        token: the valid one-time token; "" if clients need none.
    """

    def __init__(self, host: str, port: int, secure: bool, announce: Callable[[str], object]) -> None:
        """Set the rules for a server on host and port.

        `secure`: whether the server uses TLS; if so, cookies are sent over TLS only. `announce` receives new tokens.
        """
        self.needs_token = not is_local(host)
        self._announce = announce
        self._secure = secure
        # Browsers send the cookies of all ports of a host: the port in the name keeps several servers apart.
        self._cookie = f"twin_{port}"
        self._sessions: OrderedDict[str, None] = OrderedDict()
        self._names = {*_LOCAL_HOSTS, host.lower()}
        if self.needs_token:
            machine = socket.gethostname().lower()
            self._names |= {machine, f"{machine}.local"}
        self._names -= {"", "0.0.0.0", "::"}  # these mean "every address", and name no server
        self.token = ""
        if self.needs_token:
            self._renew()

    def _renew(self) -> None:
        self.token = secrets.token_urlsafe(18)
        self._announce(self.token)

    def accepts_host(self, host: str | None, own_host: str) -> bool:
        """Return whether a Host header contains a name of this server, or the connection's local address `own_host`.

        This check prevents DNS rebinding: an attack in which the host name of another site resolves to this machine.
        """
        try:
            name = urlsplit(f"//{host or ''}").hostname
        except ValueError:
            return False
        if name is None:
            return False
        own_without_zone = own_host.partition("%")[0]  # fe80::1%eth0
        return name in self._names or name == own_without_zone

    @staticmethod
    def accepts_origin(origin: str | None, host: str | None) -> bool:
        """Return whether the Origin header is missing, or names the same host and port as the Host header.

        Browsers always send an Origin header when they request a WebSocket; other programs send none.
        """
        if origin is None:
            return True
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        if parts.scheme not in ("http", "https") or not host:
            return False
        return origin == f"{parts.scheme}://{host}"

    def has_session(self, cookies: str | None) -> bool:
        """Return whether a Cookie header contains a valid session."""
        try:
            morsel = SimpleCookie(cookies or "").get(self._cookie)
        except CookieError:
            return False
        return morsel is not None and morsel.value in self._sessions

    def open_session(self, token: str) -> str | None:
        """If a token is valid, announce the next token and return a Set-Cookie header; otherwise return None."""
        if not self.use_token(token):
            return None
        session = secrets.token_urlsafe(24)
        self._sessions[session] = None
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        secure = "; Secure" if self._secure else ""
        return f"{self._cookie}={session}; Path=/; HttpOnly; SameSite=Strict{secure}"

    def use_token(self, token: str) -> bool:
        """Invalidate a token, if it is valid, and announce the next one; return whether it was valid."""
        if not self.token:
            return False
        received = token.encode("utf-8", "replace")
        # A comparison in constant time: the duration tells nothing about the token.
        if not hmac.compare_digest(received, self.token.encode()):
            return False
        self._renew()
        return True
