"""Obstacles around robots of a scene: the other robots, and the props."""

from __future__ import annotations

from collections.abc import Mapping

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.reference.collision_pairs import Obstacle
from twin.reference.model import ReferenceModel


def obstacles(
    scene: Scene,
    planned: Mapping[str, str],
    T_world_base: Array,
    mechanisms: Mapping[str, Mechanism],
    props: Mechanism | None,
    poses: Mapping[str, Mapping[str, Array]],
) -> list[Obstacle]:
    """Return the bodies of the other robots and of the props of a scene as obstacles of the robots `planned`.

    Args:
        scene: the scene; the pairs in its `touching` touch intentionally.
        planned: {name of a planned robot in the scene: prefix of the names of its bodies in `Obstacle.touches`}.
        T_world_base: pose (4, 4) of the frame in which the poses of the obstacles are returned.
        mechanisms: mechanism of each robot, by its name in the scene; robots without a mechanism are no obstacles.
        props: mechanism of the props; None: there are none.
        poses: poses T_world_body (4, 4) of the bodies of other robots, by robot and body; a robot without poses is in
            its rest pose.
    """
    groups = []
    for place in scene.places:
        if place.name in mechanisms and place.name not in planned:
            groups.append((place.name, mechanisms[place.name], place.T_world_base))
    if props is not None:
        groups.append((props.name, props, spatial.pose()))
    T_base_world = spatial.inverse(T_world_base)
    obstacles = []
    for name, mechanism, T_world_group in groups:
        links = poses.get(name)
        if links is None:
            links = {}
            for body_name, T in ReferenceModel(mechanism).home().link_poses.items():
                links[body_name] = T_world_group @ T
        for body in mechanism.bodies:
            full_name = f"{name}/{body.name}"
            touches = set()
            for pair in scene.touching:
                if full_name not in pair:
                    continue
                for partner in pair - {full_name}:
                    owner, inner = partner.split("/", 1)
                    if owner in planned:
                        touches.add(f"{planned[owner]}{inner}")
            T_base_body = T_base_world @ links[body.name]
            obstacles.append(Obstacle(full_name, body, T_base_body, frozenset(touches)))
    return obstacles
