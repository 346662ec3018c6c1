"""Load the obstacles around robots of a scene: the bodies of its props and of its other robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from twin.api.robot_loading import load
from twin.api.scene_loading import load_scene, place_of
from twin.core import spatial
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.model.scene import Scene
    from twin.reference.collision_pairs import Obstacle


def obstacles_in_base(
    scene: str,
    robot: str,
    load: Callable[[str], Robot] = load,
    poses: Mapping[str, Mapping[str, Array]] | None = None,
) -> list[Obstacle]:
    """Return the bodies of the props and of the other robots of a scene, with poses in one robot's base frame.

    `scene` is the name of a built-in scene, or the path of a scene.toml or of its folder. `load` returns the robot of a
    given name. `robot` is the name of a robot in the scene, or of a built-in robot; in the second case, the first robot
    of that kind in the scene is used. `poses` is {name of a place: {body: T_world_body (4, 4)}} of other robots; a
    robot without poses is in its rest pose.

    Raises:
        TwinError: there is no such scene, or the robot is not in it.
    """
    read_scene = load_scene(scene)
    place = place_of(read_scene, robot)
    return _load_obstacles(read_scene, {place.name: ""}, place.T_world_base, load, poses or {})


def obstacles_in_world(scene: Scene, names: Sequence[str], load: Callable[[str], Robot]) -> list[Obstacle]:
    """Return the bodies of the props and of the other robots of a scene, with poses in the world frame.

    `names` are the names of the planned robots, which are not obstacles. In the result, `Obstacle.touches` lists the
    bodies of planned robots that may touch the obstacle, named as in `twin.model.combined_arms`. `load` returns the
    robot of a given name.
    """
    prefixes = {}
    for name in names:
        prefixes[name] = f"{name}_"  # as in the joined mechanism of all planned robots
    return _load_obstacles(scene, prefixes, spatial.pose(), load, {})


def _load_obstacles(
    scene: Scene,
    prefixes: Mapping[str, str],
    T_world_base: Array,
    load: Callable[[str], Robot],
    poses: Mapping[str, Mapping[str, Array]],
) -> list[Obstacle]:
    """Load the props and the robots that have no prefix in `prefixes`, as obstacles; see `twin.reference.obstacles`."""
    from twin.cad.build import read_props
    from twin.reference.obstacles import obstacles

    mechanisms = {}
    for place in scene.places:
        if place.name not in prefixes:
            robot = load(place.robot)
            protocol = robot.protocol(place.protocol or None)
            mechanisms[place.name] = robot.bound(protocol).mechanism
    props = None
    if scene.props is not None:
        props = read_props(scene.props)
    return obstacles(scene, prefixes, T_world_base, mechanisms, props, poses)
