"""Find a scene, a robot in a scene, and the obstacles around a robot (props and other robots)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.core import assets, spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.model.scene import Place, Scene
    from twin.reference.pairs import Still


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
    from twin.model.scene import load_scene as read

    file = assets.scene_file(scene)
    if file is None:
        raise TwinError(unknown("scene", str(scene), assets.scenes()))
    return read(file)


def loaded_scene(scene: Scene | str | Path) -> Scene:
    """Return a scene that is given as such, by name or by path; the functions of the API take all three."""
    from twin.model.scene import Scene as Read

    if isinstance(scene, Read):
        return scene
    return load_scene(scene)


def place_of(scene: Scene, name: str, taken: Collection[str] = ()) -> Place:
    """Return the place named `name` or, if there is none, the first place with a built-in robot named `name`.

    Raises:
        TwinError: there is no such place, or the names of all such places are in `taken`.
    """
    named = [place for place in scene.places if place.name == name]
    if not named:
        named = [place for place in scene.places if place.robot == name]
    for place in named:
        if place.name not in taken:
            return place
    further = ""
    if named:
        further = "further "
    free = ", ".join(place.name for place in scene.places if place.name not in taken)
    raise TwinError(f"scene '{scene.name}' has no {further}robot '{name}'; it has: {free}")


def standing(
    scene: str, robot: str, load: Callable[[str], Any], poses: Mapping[str, Mapping[str, Array]] | None = None
) -> list[Still]:
    """Return the bodies of the props and of the other robots of a scene, with poses in one robot's base frame.

    `scene` is the name of a built-in scene, or the path of a scene.toml or of its folder. `load` returns the robot of a
    given name. `robot` is the name of a robot in the scene, or of a built-in robot; in the second case, the first robot
    of that kind in the scene is used. `poses` is {name of a place: {body: T_world_body (4, 4)}} of other robots; a
    robot without poses is in its rest pose.

    Raises:
        TwinError: there is no such scene, or the robot is not in it.
    """
    read = load_scene(scene)
    own = place_of(read, robot)
    return _loaded(read, {own.name: ""}, own.T_world_base, load, poses or {})


def obstacles(read: Scene, names: Sequence[str], load: Callable[[str], Any]) -> list[Still]:
    """Return the bodies of the props and of the other robots of a scene, with poses in the world frame.

    `names` are the names of the planned robots, which are not obstacles. In the result, `Still.touches` lists the
    bodies of planned robots that may touch the obstacle, named as in `twin.model.joined`. `load` returns the robot of a
    given name.
    """
    return _loaded(read, {name: f"{name}_" for name in names}, spatial.pose(), load, {})


def _loaded(
    read: Scene,
    own: Mapping[str, str],
    T_world_base: Array,
    load: Callable[[str], Any],
    poses: Mapping[str, Mapping[str, Array]],
) -> list[Still]:
    """Load the props and the robots that are not in `own`, as obstacles; see `twin.reference.obstacles`."""
    from twin.cad.build import read_props
    from twin.reference.obstacles import obstacles

    mechanisms = {}
    for place in read.places:
        if place.name not in own:
            other = load(place.robot)
            protocol = other.protocol(place.protocol or None)
            mechanisms[place.name] = other.bound(protocol).mechanism
    props = None
    if read.props is not None:
        props = read_props(read.props)
    return obstacles(read, own, T_world_base, mechanisms, props, poses)
