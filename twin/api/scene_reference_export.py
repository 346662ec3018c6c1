"""Export a scene again, so that an audit can compare the files of its export with what twin writes for it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from twin.api.robot_loading import load
from twin.api.scene_export import export_scene
from twin.api.scene_loading import load_scene
from twin.core import assets
from twin.core.progress import Progress
from twin.exchange.audit import SCENE, ExportStatement, NewExport
from twin.exchange.write.model_hash import model_hash


def export_scene_again(
    path: Path, statement: ExportStatement, folder: Path, formats: Sequence[str], progress: Progress
) -> NewExport:
    """Return a new export of the built-in scene that an export states, without a folder if it is not of this scene.

    Args:
        path: folder of the export.
        statement: what its files state: the hashes of all robots of the scene must be among them.
        folder: an empty folder for the new export.
        formats: names of the formats.
        progress: see `twin.api.Progress`.
    """
    name = json.loads((path / SCENE).read_text("utf-8")).get("scene")
    if name not in assets.scenes():
        return NewExport(None)
    scene = load_scene(name)
    for place in scene.places:
        if model_hash(load(place.robot).weighed().mechanism) not in statement.model_hashes:
            return NewExport(None)
    bundles = export_scene(scene.file, folder, formats, progress=progress).bundles
    for bundle in bundles.values():
        for clip in bundle.order.clips:
            if clip.name not in statement.key_counts:
                return NewExport(None)
            reason = statement.reason_of_other_keys(clip.name, len(clip.times))
            if reason:
                return NewExport(None, reason)
    return NewExport(folder)
