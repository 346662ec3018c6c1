"""Scene files with one wrong value, and their error messages."""

from __future__ import annotations

import re

import pytest

from twin.core.errors import DescriptionError
from twin.model.scene import Scene, load_scene


def refused(scene: Scene, folder, old: str, new: str) -> str:
    """Write a scene file without props and with `old` replaced by `new`; return the error message of its reader."""
    text = re.sub(r'props = ".*"\n', "", scene.file.read_text(encoding="utf-8"))
    assert old in text
    (folder / "scene.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        load_scene(folder / "scene.toml")
    return str(caught.value)
