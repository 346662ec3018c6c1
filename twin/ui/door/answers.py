"""Build responses to GET requests: a file in memory or an error, with security headers."""

from __future__ import annotations

import gzip
import hashlib
from dataclasses import dataclass
from email.utils import formatdate
from functools import cached_property
from http import HTTPStatus

from websockets.datastructures import Headers
from websockets.http11 import Response

_PACKED = ("image/png", "font/woff2")
"""Content types that are already compressed."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; "
    "connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Default Content-Security-Policy: it forbids content from other origins."""


@dataclass(frozen=True)
class File:
    """A file to serve.

    Attributes:
        content: bytes of the file.
        type: value of the header Content-Type.
        tag: prefix of the entity tag (header ETag); "": no prefix.
        policy: value of the header Content-Security-Policy.
    """

    content: bytes
    type: str
    tag: str = ""
    policy: str = POLICY

    @cached_property
    def etag(self) -> str:
        """Entity tag: `tag` followed by a hash of the content."""
        digest = hashlib.sha256(self.content).hexdigest()[:16]
        return f'"{self.tag}-{digest}"' if self.tag else f'"{digest}"'

    @cached_property
    def gzipped(self) -> bytes | None:
        """Content compressed with gzip; None if compression does not make it smaller."""
        if self.type in _PACKED or len(self.content) < 512:
            return None
        packed = gzip.compress(self.content, 6, mtime=0)
        return packed if len(packed) < len(self.content) else None


def answer(file: File, headers: Headers, head_only: bool, cookie: str | None = None) -> Response:
    """Return the response to a request for a file; `cookie` is the value of the Set-Cookie header, None: no header."""
    packed = file.gzipped if "gzip" in _all(headers, "Accept-Encoding").lower() else None
    fields = _fields(file.type, file.policy)
    fields["ETag"] = file.etag
    fields["Cache-Control"] = "no-cache"
    fields["Vary"] = "Accept-Encoding"
    if cookie is not None:
        fields["Set-Cookie"] = cookie
        fields["Cache-Control"] = "no-store"
    elif file.etag in (t.strip().removeprefix("W/") for t in _all(headers, "If-None-Match").split(",")):
        return Response(304, "Not Modified", fields)
    if packed is not None:
        fields["Content-Encoding"] = "gzip"
    body = file.content if packed is None else packed
    fields["Content-Length"] = str(len(body))
    return Response(200, "OK", fields, b"" if head_only else body)


def _all(headers: Headers, name: str) -> str:
    return ", ".join(headers.get_all(name))


def refusal(status: HTTPStatus, text: str, head_only: bool = False) -> Response:
    """Return an error response."""
    body = (text + "\n").encode()
    fields = _fields("text/plain; charset=utf-8")
    fields["Cache-Control"] = "no-store"
    fields["Content-Length"] = str(len(body))
    return Response(status.value, status.phrase, fields, b"" if head_only else body)


def _fields(kind: str, policy: str = POLICY) -> Headers:
    return Headers(
        {
            "Date": formatdate(usegmt=True),
            "Connection": "close",
            "Content-Type": kind,
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "X-Frame-Options": "DENY",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Permissions-Policy": "xr-spatial-tracking=(self)",
        }
    )
