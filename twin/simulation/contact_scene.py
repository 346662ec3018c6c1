"""Contact of a console's instruments with a scene: with its movable objects, the bodies of its props, and its pegs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics import Kinematics
from twin.model.body import Mesh
from twin.model.contact import ContactTable
from twin.model.mechanism import Mechanism
from twin.model.movable import Movable
from twin.model.scene import Place, Scene
from twin.model.task import Task
from twin.reference import ReferenceModel
from twin.simulation.plants.contact import Contact, Gripper, Solid


@dataclass(frozen=True)
class Peg:
    """A peg: its name, the centres (3,) of its free end and of its other end in m in the World, and its radius in m."""

    name: str
    end: Array
    foot: Array
    radius: float


def contact(
    scene: Scene,
    props: Mechanism | None,
    arms: Mapping[str, tuple[Place, Mechanism, Kinematics]],
    q: Mapping[str, Array],
    objects: Sequence[Movable],
    feels: bool = False,
) -> Contact:
    """Return the contact of objects with the solid bodies of a scene and the instruments.

    Args:
        scene: a scene with a section [contact].
        props: mechanism of the props.
        arms: place, mechanism and equations of each instrument, by robot.
        q: joint values (n,) of the instruments at the start, by robot.
        objects: the movable objects.
        feels: whether the planes are written that the forces on the hands need.

    Raises:
        TwinError: the scene has no such table, or a solid body is not in the props.
        WorldError: an object overlaps something at the start.
    """
    table = _table(scene)
    grippers = [
        Gripper(name, mechanism, kin, place.T_world_base, table.jaw_effort_n_mm * MM)
        for name, (place, mechanism, kin) in arms.items()
    ]
    return Contact(objects, _solids(scene, props), grippers, q, friction=table.friction, feels=feels)


def pegs(scene: Scene, props: Mechanism | None, task: Task) -> dict[str, Peg]:
    """Return the pegs of a task by name, measured on the drawn parts.

    The axis of a peg is its longest direction. Its free end is the end that is farther from the bounding boxes of the
    other parts.

    Raises:
        TwinError: a peg is not a part of a solid body.
    """
    parts = {part.name: (solid, part) for solid in _solids(scene, props) for part in solid.parts}
    out = {}
    for name in {t.peg for t in task.transfers}:
        if name not in parts:
            raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('peg', name, parts)}")
        solid, part = parts[name]
        p = part.vertices @ solid.T_world_body[:3, :3].T + solid.T_world_body[:3, 3]
        middle = (p.min(axis=0) + p.max(axis=0)) / 2
        axis = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
        along = (p - middle) @ axis
        radius = float(np.linalg.norm(p - middle - np.outer(along, axis), axis=1).max())
        ends = [middle + axis * along.min(), middle + axis * along.max()]
        others = [_box(x, solid) for x in solid.parts if x is not part]
        ends.sort(key=lambda end: min(float(np.linalg.norm(np.clip(end, *box) - end)) for box in others))
        out[name] = Peg(name, ends[1], ends[0], radius)
    return dict(sorted(out.items()))


def _table(scene: Scene) -> ContactTable:
    if scene.contact is None:
        raise TwinError(f"scene '{scene.name}' has no contact: add a section [contact] to {scene.file.name}")
    return scene.contact


def _solids(scene: Scene, props: Mechanism | None) -> list[Solid]:
    table = _table(scene)
    bodies = {} if props is None else {b.name: b for b in props.bodies}
    for name in table.solid:
        if name not in bodies:
            raise TwinError(f"{scene.file.name}: contact: {unknown('body of the props', name, bodies)}")
    poses = {} if props is None else ReferenceModel(props).home().link_poses
    return [Solid(name, bodies[name].meshes, table.friction, poses[name]) for name in table.solid]


def _box(part: Mesh, solid: Solid) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) of the box around a part in the World."""
    p = part.vertices @ solid.T_world_body[:3, :3].T + solid.T_world_body[:3, 3]
    return p.min(axis=0), p.max(axis=0)
