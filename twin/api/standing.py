"""Obstacles around a robot in a scene: props, and the other robots in their rest poses or in given ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from twin.core import assets, spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.reference.pairs import Still


def standing(
    scene: str, robot: str, load: Callable[[str], Any], poses: Mapping[str, Mapping[str, Array]] | None = None
) -> list[Still]:
    """Return the bodies of the props and of the other robots of a scene, with poses in one robot's base frame.

    `scene` is the name of a built-in scene, or the path of a scene.toml or of its folder; `load` returns the robot with
    a name. `robot` is the name of a robot in the scene, or of a built-in robot; in the second case, the first robot of
    that kind in the scene is used. `poses` are the poses T_world_body (4, 4) of the bodies of other robots, by the name
    of their place; a robot without them is in its rest pose.

    Raises:
        TwinError: there is no such scene, or the robot is not in it.
    """
    from twin.cad.build import read_props
    from twin.model.scene import load_scene
    from twin.reference import ReferenceModel
    from twin.reference.pairs import Still

    if (file := assets.scene_file(scene)) is None:
        raise TwinError(unknown("scene", scene, assets.scenes()))
    read = load_scene(file)
    own = next((p for key in ("name", "robot") for p in read.places if getattr(p, key) == robot), None)
    if own is None:
        raise TwinError(f"scene '{read.name}' has no robot '{robot}'; it has: {', '.join(p.name for p in read.places)}")
    groups = []
    for place in read.places:
        if place is not own:
            other = load(place.robot)
            mechanism = other.bound(other.protocol(place.protocol or None)).mechanism
            groups.append((place.name, mechanism, place.T_world_base))
    if read.props is not None:
        props = read_props(read.props)
        groups.append((props.name, props, spatial.pose()))
    out = []
    for name, mechanism, T_world in groups:
        links = (poses or {}).get(name)
        if links is None:
            home = ReferenceModel(mechanism).home().link_poses
            links = {body: T_world @ T for body, T in home.items()}
        for body in mechanism.bodies:
            full = f"{name}/{body.name}"
            touches = {n.removeprefix(f"{own.name}/") for pair in read.touching if full in pair for n in pair - {full}}
            T = spatial.inverse(own.T_world_base) @ links[body.name]
            out.append(Still(full, body, T, frozenset(touches)))
    return out
