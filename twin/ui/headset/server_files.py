"""Files of the server: the page with its assets, and the robot's geometry and description.

All files are in memory and are found by their exact path, so that requests have no access to other files.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.core.json_types import JsonObject
from twin.ui.access.responses import File

_CONTENT_TYPES = {
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

_PRELOAD_LINK = '<link rel="preload" href="{}" as="fetch" crossorigin="anonymous">\n'


def page_files(folder: Path, preload: Sequence[str] = ()) -> dict[str, File]:
    """Return all files in the folder of the page, by path; index.html is also at "/".

    Args:
        folder: folder of the page; if it is missing or empty, the result is empty.
        preload: paths of the files that a browser is told to load in parallel with the script of index.html.
    """
    files = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")):
        kind = _CONTENT_TYPES.get(path.suffix.lower(), "application/octet-stream")
        content = path.read_bytes()
        if path.name == "index.html":
            links = "".join(_PRELOAD_LINK.format(p) for p in preload)
            content = content.replace(b"<script", links.encode() + b"<script", 1)
        files["/" + path.relative_to(folder).as_posix()] = File(content, kind)
    if "/index.html" in files:
        files["/"] = files["/index.html"]
    return files


def robot_files(glb: bytes, description: JsonObject, folder: str = "") -> dict[str, File]:
    """Return the robot's geometry and description files by path; `folder` is "" or ends with "/"."""
    tag = _tag(description)
    return {
        f"/{folder}robot.glb": File(glb, _CONTENT_TYPES[".glb"], tag),
        f"/{folder}robot.json": File(_json(description), _CONTENT_TYPES[".json"], tag),
    }


def scene_file(description: JsonObject) -> dict[str, File]:
    """Return the file /scene.json with the descriptions of all robots and the props."""
    return {"/scene.json": File(_json(description), _CONTENT_TYPES[".json"], _tag(description))}


def glb_file(name: str, glb: bytes) -> dict[str, File]:
    """Return one geometry file with the content `glb`, by its path `/<name>`."""
    return {f"/{name}": File(glb, _CONTENT_TYPES[".glb"])}


def _json(description: JsonObject) -> bytes:
    return json.dumps(description, allow_nan=False, separators=(",", ":"), ensure_ascii=False).encode()


def _tag(description: JsonObject) -> str:
    return str(description["model_hash"]).partition(":")[2][:16]


def patient_files(glbs: Mapping[str, bytes]) -> dict[str, File]:
    """Return a geometry file for each patient, by path /patient/<protocol>.glb; `glbs`: contents, by protocol."""
    files: dict[str, File] = {}
    for name, glb in glbs.items():
        files |= glb_file(f"patient/{name}.glb", glb)
    return files
