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

SESSIONS = 64
"""Maximum number of sessions; if there are more, the oldest session becomes invalid."""

_LOCAL = ("127.0.0.1", "localhost", "::1")


def is_local(host: str) -> bool:
    """Return whether a server on this host can be reached only from this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Access rules of one server.

    Attributes:
        open: whether other machines can reach the server; if so, clients need a token or a session.
        token: the valid one-time token; "" if the server is not open.
    """

    def __init__(self, host: str, port: int, secure: bool, announce: Callable[[str], object]) -> None:
        """Set the rules for a server on host and port.

        `secure`: whether the server uses TLS; if so, cookies are sent over TLS only. `announce` receives new tokens.
        """
        self.open = not is_local(host)
        self._announce, self._secure = announce, secure
        self._cookie = f"twin_{port}"
        self._sessions: OrderedDict[str, None] = OrderedDict()
        name = socket.gethostname().lower()
        self._names = {*_LOCAL, host.lower(), name, f"{name}.local"} if self.open else set(_LOCAL) | {host.lower()}
        self._names -= {"", "0.0.0.0", "::"}
        self.token = ""
        if self.open:
            self._renew()

    def _renew(self) -> None:
        self.token = secrets.token_urlsafe(18)
        self._announce(self.token)

    def answers_to(self, host: str | None, own: str) -> bool:
        """Return whether a Host header contains a name of this server, or the connection's local address `own`.

        This check prevents DNS rebinding: an attack in which the host name of another site resolves to this machine.
        """
        try:
            name = urlsplit(f"//{host or ''}").hostname
        except ValueError:
            return False
        return name is not None and (name in self._names or name == own.partition("%")[0])

    @staticmethod
    def same_origin(origin: str | None, host: str | None) -> bool:
        """Return whether the Origin header is missing, or names the same host and port as the Host header.

        Browsers always send an Origin header when they request a WebSocket; other programs send none.
        """
        if origin is None:
            return True
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return parts.scheme in ("http", "https") and bool(host) and origin == f"{parts.scheme}://{host}"

    def known(self, cookies: str | None) -> bool:
        """Return whether a Cookie header contains a valid session."""
        try:
            morsel = SimpleCookie(cookies or "").get(self._cookie)
        except CookieError:
            return False
        return morsel is not None and morsel.value in self._sessions

    def enter(self, token: str) -> str | None:
        """If a token is valid, announce the next token and return a Set-Cookie header; otherwise return None."""
        if not self.spend(token):
            return None
        session = secrets.token_urlsafe(24)
        self._sessions[session] = None
        while len(self._sessions) > SESSIONS:
            self._sessions.popitem(last=False)
        secure = "; Secure" if self._secure else ""
        return f"{self._cookie}={session}; Path=/; HttpOnly; SameSite=Strict{secure}"

    def spend(self, token: str) -> bool:
        """Invalidate a token, if it is valid, and announce the next one; return whether it was valid."""
        if not self.token or not hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode()):
            return False
        self._renew()
        return True
