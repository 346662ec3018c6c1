"""Check the asset of a glTF file, and what a file of twin states in the extras of its asset, nodes and clips."""

from __future__ import annotations

import re

from twin.core.json_types import JsonObject
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.glb.audit.container import Gltf
from twin.exchange.formats.glb.audit.nodes import Node

_SCHEMA = "twin-glb"
"""Schema of the extras of the asset in a GLB of twin."""

_CONVENTIONS = {
    "schema": _SCHEMA,
    "version": 1,
    "units": "m, kg, s",
    "frame": "links below the root node: z-up right-handed",
}
"""Entries of these extras that are the same in every file."""

_CLIP_ENTRIES = ("title", "rate", "between_position", "between_rotation", "joint_gap")
"""Entries of the extras of a clip."""


def check_asset(asset: JsonObject, content: Content, ledger: Ledger) -> None:
    """Report another version than 2.x, and entries in the extras of a file of twin that are missing or wrong.

    The units and the frame are wrong that are not those of every GLB of twin.
    """
    version = asset.get("version")
    if re.fullmatch(r"2\.\d+", str(version)) is None:
        ledger.wrong("gltf.version", f"the version of the file is {version!r}, not 2.x.", "version")
    extras = asset.get("extras")
    if not isinstance(extras, dict) or not extras:
        return
    written_by_twin = str(asset.get("generator", "")).startswith("twin ")
    if extras.get("schema") != _SCHEMA and not written_by_twin:
        return  # a file of others
    for key, expected in _CONVENTIONS.items():
        if extras.get(key) != expected:
            text = (
                f"asset.extras: '{key}' is {extras.get(key)!r}; for links and poses as in this file it is {expected!r}."
            )
            code = "gltf.units" if key == "units" else "gltf.asset"
            ledger.wrong(code, text, key)
    for key in ("robot", "model_hash"):
        if not extras.get(key):
            ledger.wrong("gltf.asset", f"asset.extras: '{key}' is missing or empty.", key)
    if extras.get("robot"):
        content.stated[ROBOT] = extras["robot"]


def check_node_extras(nodes: list[Node], ledger: Ledger) -> None:
    """Report nodes of a file of twin that are neither links nor frames, or are not named and described as these."""
    for node in nodes:
        frame = node.extras.get("frame")
        if node.parent >= 0 and not node.extras.get("link") and not frame:
            text = f"node '{node.label}' is neither a link nor a frame: its extras state neither."
            ledger.wrong("gltf.node", text, node.label, suggestion="export the file again")
        # A link or another frame may have the name, which then ends in "_".
        if frame and node.name.rstrip("_") != f"frame_{frame}".rstrip("_"):
            text = f"the node of frame '{frame}' is named '{node.name}', not 'frame_{frame}'."
            ledger.wrong("gltf.node", text, node.label, suggestion="give the node the name of its frame")
        if node.is_link and not isinstance(node.extras.get("joints"), list):
            text = f"the extras of link '{node.label}' have no list 'joints' of the joints that move it."
            ledger.wrong("gltf.node", text, node.label, suggestion="export the file again")


def record_clip_extras(file: Gltf, content: Content) -> None:
    """Store what the extras of the clips state about them; report the first entry that one of twin lacks."""
    for spec in file.items("animations"):
        extras = spec.get("extras")
        if not isinstance(extras, dict):
            continue
        missing: list[str] = []
        for key in _CLIP_ENTRIES:
            if key in extras:
                content.stated[f"{key} of clip '{spec.get('name')}'"] = extras[key]
            else:
                missing.append(key)
        if missing and ROBOT in content.stated:  # files of others need not state them
            text = f"clip '{spec.get('name')}' does not state its {missing[0]}."
            file.ledger.wrong("gltf.clip", text, missing[0], suggestion="export the file again")
