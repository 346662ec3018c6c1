"""Load a scene, and find a robot in it."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core import assets
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.model.scene import Place, Scene


def load_scene(scene: str | Path) -> Scene:
    """Read a scene, given by name or path.

    `scene` is the name of a built-in scene, or the path of a scene.toml or of its folder.

    Raises:
        TwinError: there is no such scene.
        DescriptionError: the scene file is malformed.

    Examples:
        >>> import twin
        >>> [place.robot for place in twin.load_scene("vsrs").places]
        ['pa10', 'lapbot', 'hibou']
    """
    from twin.model import scene as scene_files

    file = assets.scene_file(scene)
    if file is None:
        raise TwinError(unknown("scene", str(scene), assets.scenes()))
    return scene_files.load_scene(file)


def as_scene(scene: Scene | str | Path) -> Scene:
    """Return a scene that is given as such, by name or by path; the functions of the API take all three."""
    from twin.model import scene as scene_files

    if isinstance(scene, scene_files.Scene):
        return scene
    return load_scene(scene)


def scene_of_session(path: Path, name: str, scene: Scene | str | Path | None = None) -> Scene:
    """Return the scene of a session file `path`, which states the name of its scene, not the scene's folder.

    `scene` is the scene, its name or its path; None: the built-in scene with this name.

    Raises:
        TwinError: there is no such scene, or the file names one that is not built in.
    """
    if scene is None and name not in assets.scenes():
        raise TwinError(f"{path}: scene '{name}' is not built in: give its folder with --scene")
    return as_scene(name if scene is None else scene)


def place_of(scene: Scene, name: str, taken_names: Collection[str] = ()) -> Place:
    """Return the place named `name` or, if there is none, the first place with a built-in robot named `name`.

    Raises:
        TwinError: there is no such place, or the names of all such places are in `taken_names`.
    """
    free_names = []
    same_name = []
    same_robot = []
    for place in scene.places:
        if place.name not in taken_names:
            free_names.append(place.name)
        if place.name == name:
            same_name.append(place)
        if place.robot == name:
            same_robot.append(place)
    # a place may have the name of a robot that stands at other places
    candidates = same_name or same_robot
    for place in candidates:
        if place.name not in taken_names:
            return place
    further = ""
    if candidates:
        further = "further "
    raise TwinError(f"scene '{scene.name}' has no {further}robot '{name}'; it has: {', '.join(free_names)}")
