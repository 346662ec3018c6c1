"""What the server answers to GET: the page and its assets, the robot's geometry and its description.

All of it is held in memory by its exact path, so that no path can lead out of it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.ui.door.answers import File

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
