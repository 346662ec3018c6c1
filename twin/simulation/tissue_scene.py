"""The soft organs of a scene, and the links that touch them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model import anatomy
from twin.model.deformable import Bend
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.model.tissue import Tissue
from twin.reference import ReferenceModel
from twin.simulation.plants.tissue import Links, Organs, Tool


def tissues(scene: Scene, anatomy_mechanism: Mechanism | None) -> tuple[Tissue, ...]:
    """Return the organs of a scene from the mechanism of its anatomy; empty if the scene has none.

    Raises:
        TwinError: an organ is not drawn, or its surface is open, inverted or too fine.
    """
    if anatomy_mechanism is None or scene.anatomy is None:
        return ()
    link_poses = ReferenceModel(anatomy_mechanism).home().link_poses
    return anatomy.tissues(scene.file, scene.anatomy, scene.tissues, anatomy_mechanism, link_poses)


def touching(scene: Scene) -> dict[str, list[str]]:
    """Return {robot: names of its bodies that touch organs}."""
    bodies: dict[str, list[str]] = {}
    if scene.anatomy is None:
        return bodies
    for name in scene.anatomy.touching:
        robot, body = name.split("/")
        bodies.setdefault(robot, []).append(body)
    return bodies


def links(scene: Scene, mechanisms: Mapping[str, Mechanism], q: Mapping[str, Array]) -> list[Links]:
    """Return the links that touch organs, at joint values q (n,) of each robot.

    Raises:
        WorldError: a robot lacks a body that should touch organs.
        TwinError: a robot of [anatomy] is not among the mechanisms.
    """
    places = {place.name: place for place in scene.places}
    links = []
    for robot, bodies in touching(scene).items():
        if robot not in mechanisms:
            raise TwinError(f"scene '{scene.name}': no mechanism for '{robot}', which touches organs")
        links.append(Links(robot, mechanisms[robot], places[robot].T_world_base, bodies, q[robot]))
    return links


def followed(tissues: Sequence[Tissue], tools: Sequence[Tool], poses: Sequence[Array], period: float) -> list[Bend]:
    """Return the motions of the organs that a motion of the links causes.

    Args:
        tissues: the organs.
        tools: the links that touch them.
        poses: T_world_link (k, 4, 4) of each link.
        period: time in s between two poses.

    Raises:
        WorldError: a link is inside an organ at the start.
    """
    samples = list(zip(*poses, strict=True))  # the poses of all links, by time
    organs = Organs(tissues, tools, samples[0], period)
    nodes: dict[str, list[Array]] = {}
    for tissue in tissues:
        nodes[tissue.name] = [organs.nodes[tissue.name]]
    for sample in samples[1:]:
        organs.step(sample)
        for name, rows in nodes.items():
            rows.append(organs.nodes[name])
    times = period * np.arange(len(samples), dtype=float)
    bends = []
    for tissue in tissues:
        bends.append(Bend(tissue.deformable.mesh, tissue.weights, times, np.stack(nodes[tissue.name])))
    return bends
