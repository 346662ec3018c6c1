"""Scene files with one wrong value, and what is said of them."""

from __future__ import annotations

import re

import pytest

from twin.core.errors import DescriptionError
from twin.model.scene import Scene, load_scene


def refused(scene: Scene, folder, old: str, new: str) -> str:
    """Write the file of a scene without props and with one text replaced; return the message that refuses it."""
    text = re.sub(r'props = ".*"\n', "", scene.file.read_text(encoding="utf-8"))
    assert old in text
    (folder / "scene.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        load_scene(folder / "scene.toml")
    return str(caught.value)
