"""What the server answers to GET: the page and its assets, the robot's geometry and its description.

All of it is held in memory by its exact path, so that no path can lead out of it.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from email.utils import formatdate
from functools import cached_property
from http import HTTPStatus
from pathlib import Path
from typing import Any

from websockets.datastructures import Headers
from websockets.http11 import Response

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".map": "application/json",
    ".webmanifest": "application/manifest+json",
    ".txt": "text/plain; charset=utf-8",
    ".md": "text/plain; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".wasm": "application/wasm",
    ".glb": "model/gltf-binary",
}

_PACKED = ("image/png", "font/woff2")
"""Types that gzip does not make smaller."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; "
    "connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of everything: nothing from anywhere else."""


@dataclass(frozen=True)
class File:
    """One answer: its content, type, and the tag that changes with it."""

    content: bytes
    type: str
    tag: str = ""

    @cached_property
    def etag(self) -> str:
        """Entity tag: of the content, after the one that was given."""
        digest = hashlib.sha256(self.content).hexdigest()[:16]
        return f'"{self.tag}-{digest}"' if self.tag else f'"{digest}"'

    @cached_property
    def gzipped(self) -> bytes | None:
        """The content in gzip, if that is smaller."""
        if self.type in _PACKED or len(self.content) < 512:
            return None
        packed = gzip.compress(self.content, 6, mtime=0)
        return packed if len(packed) < len(self.content) else None


def page_files(folder: Path) -> dict[str, File]:
    """Return every file of the page by its path; index.html is "/" as well. Empty if there is no page."""
    out = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")):
        kind = _TYPES.get(path.suffix.lower(), "application/octet-stream")
        out["/" + path.relative_to(folder).as_posix()] = File(path.read_bytes(), kind)
    if "/index.html" in out:
        out["/"] = out["/index.html"]
    return out


def robot_files(glb: bytes, description: dict[str, Any]) -> dict[str, File]:
    """Return the robot's two files."""
    text = json.dumps(description, allow_nan=False, separators=(",", ":"), ensure_ascii=False).encode()
    tag = str(description["model_hash"]).partition(":")[2][:16]
    return {"/robot.glb": File(glb, _TYPES[".glb"], tag), "/robot.json": File(text, _TYPES[".json"], tag)}


def patient_files(glbs: Mapping[str, bytes]) -> dict[str, File]:
    """Return the patients' geometry, /patient/<protocol>.glb, from the content by protocol."""
    return {f"/patient/{name}.glb": File(glb, _TYPES[".glb"]) for name, glb in glbs.items()}


def answer(file: File, headers: Headers, head_only: bool, cookie: str | None = None) -> Response:
    """Return the response to a request for a file."""
    packed = file.gzipped if "gzip" in _all(headers, "Accept-Encoding").lower() else None
    fields = _fields(file.type)
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
    """Return a response that says why not."""
    body = (text + "\n").encode()
    fields = _fields("text/plain; charset=utf-8")
    fields["Cache-Control"] = "no-store"
    fields["Content-Length"] = str(len(body))
    return Response(status.value, status.phrase, fields, b"" if head_only else body)


def _fields(kind: str) -> Headers:
    return Headers(
        {
            "Date": formatdate(usegmt=True),
            "Connection": "close",
            "Content-Type": kind,
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Permissions-Policy": "xr-spatial-tracking=(self)",
        }
    )
