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

_COMPRESSED_TYPES = ("image/png", "font/woff2")
"""Content types that are already compressed."""

_SMALLEST_GZIP = 512
"""Number of bytes below which a file is sent without compression: the head of gzip would outweigh what it saves."""

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
        if self.tag:
            return f'"{self.tag}-{digest}"'
        return f'"{digest}"'

    @cached_property
    def gzipped(self) -> bytes | None:
        """Content compressed with gzip; None if compression does not make it smaller."""
        if self.type in _COMPRESSED_TYPES or len(self.content) < _SMALLEST_GZIP:
            return None
        # A fixed time in the head of gzip: the same file gives the same bytes.
        compressed = gzip.compress(self.content, 6, mtime=0)
        if len(compressed) >= len(self.content):
            return None
        return compressed


def file_response(file: File, headers: Headers, head_only: bool, cookie: str | None = None) -> Response:
    """Return the response to a request for a file; `cookie` is the value of the Set-Cookie header, None: no header."""
    encodings = _joined_header(headers, "Accept-Encoding").lower()
    compressed = None
    if "gzip" in encodings:
        compressed = file.gzipped
    fields = _security_headers(file.type, file.policy)
    fields["ETag"] = file.etag
    fields["Cache-Control"] = "no-cache"
    fields["Vary"] = "Accept-Encoding"
    if cookie is not None:
        fields["Set-Cookie"] = cookie
        fields["Cache-Control"] = "no-store"
    elif _client_has(file, headers):
        return Response(304, "Not Modified", fields)
    body = file.content
    if compressed is not None:
        fields["Content-Encoding"] = "gzip"
        body = compressed
    return _with_body(HTTPStatus.OK, fields, body, head_only)


def _client_has(file: File, headers: Headers) -> bool:
    """Return whether the client names the entity tag of this file, which it then has in its cache."""
    for tag in _joined_header(headers, "If-None-Match").split(","):
        # A proxy may mark a tag as weak; the comparison for GET ignores the mark (RFC 9110, 13.1.2).
        if tag.strip().removeprefix("W/") == file.etag:
            return True
    return False


def _joined_header(headers: Headers, name: str) -> str:
    return ", ".join(headers.get_all(name))


def error_response(status: HTTPStatus, text: str, head_only: bool = False) -> Response:
    """Return an error response."""
    body = (text + "\n").encode()
    fields = _security_headers("text/plain; charset=utf-8")
    fields["Cache-Control"] = "no-store"
    return _with_body(status, fields, body, head_only)


def _with_body(status: HTTPStatus, fields: Headers, body: bytes, head_only: bool) -> Response:
    fields["Content-Length"] = str(len(body))
    if head_only:  # the length is that of the body which GET would give
        body = b""
    return Response(status.value, status.phrase, fields, body)


def _security_headers(kind: str, policy: str = POLICY) -> Headers:
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
