"""Obstacles around robots of a scene: the other robots, and the props."""

from __future__ import annotations

from collections.abc import Mapping

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.reference.model import ReferenceModel
from twin.reference.pairs import Still


def obstacles(
    scene: Scene,
    own: Mapping[str, str],
    T_world_base: Array,
    mechanisms: Mapping[str, Mechanism],
    props: Mechanism | None,
    poses: Mapping[str, Mapping[str, Array]],
) -> list[Still]:
    """Return the bodies of the other robots and of the props of a scene as obstacles of the robots `own`.

    Args:
        scene: the scene; the pairs in its `touching` touch intentionally.
        own: for each planned robot, {name in the scene: prefix of the names of its bodies in `Still.touches`}.
        T_world_base: pose (4, 4) of the frame in which the poses of the obstacles are returned.
        mechanisms: mechanism of each robot, by its name in the scene; robots without a mechanism are no obstacles.
        props: mechanism of the props; None: there are none.
        poses: poses T_world_body (4, 4) of the bodies of other robots, by robot and body; a robot without poses is in
            its rest pose.
    """
    others = [p for p in scene.places if p.name in mechanisms and p.name not in own]
    groups = [(p.name, mechanisms[p.name], p.T_world_base) for p in others]
    if props is not None:
        groups.append((props.name, props, spatial.pose()))
    T_base_world = spatial.inverse(T_world_base)
    obstacles = []
    for name, mechanism, T_world in groups:
        links = poses.get(name)
        if links is None:
            home = ReferenceModel(mechanism).home().link_poses
            links = {body: T_world @ T for body, T in home.items()}
        for body in mechanism.bodies:
            full_name = f"{name}/{body.name}"
            touches = set()
            for pair in scene.touching:
                if full_name not in pair:
                    continue
                for partner in pair - {full_name}:
                    owner, inner = partner.split("/", 1)
                    if owner in own:
                        touches.add(f"{own[owner]}{inner}")
            T_base_body = T_base_world @ links[body.name]
            obstacles.append(Still(full_name, body, T_base_body, frozenset(touches)))
    return obstacles
