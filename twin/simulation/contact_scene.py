"""Contact of a console's instruments with the movable objects, bodies of props, pegs and wires of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body, Mesh
from twin.model.contact import ContactTable
from twin.model.hull import require_hull
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.model.task import ConsoleTask, goal_of, required_goal
from twin.reference import ReferenceModel
from twin.simulation.plants.contact import Contact, Gripper, Solid
from twin.simulation.setup import Setup
from twin.simulation.tasks.guide.task import GuideTable
from twin.simulation.tasks.transfer.task import Transfers


@dataclass(frozen=True)
class Peg:
    """A peg: its name, the centres (3,) of its free end and of its other end in m in the World, and its radius in m."""

    name: str
    end: Array
    foot: Array
    radius: float


@dataclass(frozen=True)
class WireCourse:
    """Wire and dome of a task with a ring to guide, in the World, in m.

    Attributes:
        wire: (k, 3) middle line of the wire, from its free end.
        dome: (m, 4) the convex hull of the dome: p is inside if dome[:, :3] @ p + dome[:, 3] <= 0 in all rows.
    """

    wire: Array
    dome: Array

    def outside(self, p: Array) -> float:
        """Return a lower bound in m of the distance of a point p (3,) from the dome's convex hull; negative inside."""
        return float((self.dome[:, :3] @ p + self.dome[:, 3]).max())


def contact(setup: Setup, instruments: Sequence[str], q: Mapping[str, Array]) -> Contact:
    """Return the plant that simulates contact of a task's objects with the scene's solid bodies and the instruments.

    The plant writes the planes of the contacts if the forces on the hands include contact forces. It writes contacts of
    the ring with the wire if the task has a ring to guide.

    Args:
        setup: a scene with a section [contact], its robots, props and task.
        instruments: names of the robots that can be in contact.
        q: {robot: joint values (n,) at the start} of the instruments.

    Raises:
        TwinError: the scene has no section [contact], or a solid body is not in the props.
        WorldError: an object overlaps something at the start.
    """
    scene = setup.scene
    task = setup.task
    table = _table(scene)
    effort = table.jaw_effort_n_mm * MM
    grippers = []
    for name in instruments:
        member = setup.members[name]
        grippers.append(Gripper(name, member.mechanism, member.kin, setup.places[name].T_world_base, effort))
    solids = _solids(scene, setup.props)
    rubbed = []
    if task is not None and goal_of(task, GuideTable) is not None:
        for _, part in _wire(solids, scene, task):
            rubbed.append(part.name)
    return Contact(setup.objects, solids, grippers, q, friction=table.friction, feels=setup.felt, rubbed=rubbed)


def pegs(scene: Scene, props: Mechanism | None, task: ConsoleTask) -> dict[str, Peg]:
    """Return {name: peg} for the pegs of a task, measured on the drawn parts.

    The axis of a peg is its longest direction. Its free end is the end that is farther from the bounding boxes of the
    other parts of its body.

    Raises:
        TwinError: a peg is not a part of a solid body, or the body has no other part.
    """
    solids = _solids(scene, props)
    names = {transfer.peg for transfer in required_goal(task, Transfers).transfers}
    pegs = {}
    for name in sorted(names):  # several rings can be for one peg
        pegs[name] = _peg(scene, solids, task, name)
    return pegs


def course(scene: Scene, props: Mechanism | None, task: ConsoleTask) -> WireCourse:
    """Return wire and dome of a task with a ring to guide, measured on the drawn parts.

    Raises:
        TwinError: wire or dome is not among the solid bodies, the dome is flat, the wire has only one part, or the
            task has no ring to guide.
    """
    from scipy.spatial import ConvexHull  # imported here, because the import takes a while

    guide = goal_of(task, GuideTable)
    if guide is None:
        raise TwinError(f"task '{task.name}' has no ring to guide: choose a task with a section [task.NAME.guide]")
    solids = _solids(scene, props)
    wire = _wire(solids, scene, task)
    if len(wire) < 2:
        raise TwinError(
            f"{scene.file.name}: task '{task.name}': the wire has one part, '{wire[0][1].name}': its free end "
            f"is not known. Draw the wire as two or more parts whose names begin with '{guide.wire}', first the "
            "one with the free end"
        )
    ends = []
    for solid, part in wire:
        middle, axis, half, radius = _axis(solid, part)
        to_end = (half - radius) * axis
        ends.append((middle - to_end, middle + to_end))
    # the free end of the first part is the one that is farther from the second part
    line = list(ends[0])
    if _nearest(line[0], ends[1]) < _nearest(line[1], ends[1]):
        line.reverse()
    for first, second in ends[1:]:
        farther = first
        if _far(second, line[-1]) > _far(first, line[-1]):
            farther = second
        line.append(farther)
    bodies = {solid.name: solid for solid in solids}
    if guide.dome not in bodies:
        raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('solid body', guide.dome, bodies)}")
    dome = bodies[guide.dome]
    corners = np.concatenate([part.vertices for part in dome.parts])
    require_hull(f"{scene.file.name}: task '{task.name}': dome '{dome.name}'", corners)
    hull = ConvexHull(corners @ dome.T_world_body[:3, :3].T + dome.T_world_body[:3, 3])
    return WireCourse(np.array(line), hull.equations)


def _peg(scene: Scene, solids: Sequence[Solid], task: ConsoleTask, name: str) -> Peg:
    parts = _parts(solids)
    if name not in parts:
        raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('peg', name, parts)}")
    solid, part = parts[name]
    boxes = []
    for neighbour in solid.parts:
        if neighbour is not part:
            boxes.append(_box(neighbour, solid))
    if not boxes:
        raise TwinError(
            f"{scene.file.name}: task '{task.name}': '{name}' is the only part of its body: its free end is not known. "
            "Draw the peg and the board under it as parts of one body"
        )
    middle, axis, half, radius = _axis(solid, part)
    foot = middle - half * axis
    end = middle + half * axis
    if _from_boxes(end, boxes) < _from_boxes(foot, boxes):
        foot, end = end, foot
    return Peg(name, end, foot, radius)


def _from_boxes(p: Array, boxes: Sequence[tuple[Array, Array]]) -> float:
    """Return the smallest distance in m of a point (3,) from boxes, each with its lower and upper corner (3,)."""
    distances = []
    for lower, upper in boxes:
        distances.append(_far(np.clip(p, lower, upper), p))
    return min(distances)


def _parts(solids: Sequence[Solid]) -> dict[str, tuple[Solid, Mesh]]:
    """Return {name: (solid, part)} of all parts."""
    parts = {}
    for solid in solids:
        for part in solid.parts:
            parts[part.name] = (solid, part)
    return parts


def _wire(solids: Sequence[Solid], scene: Scene, task: ConsoleTask) -> list[tuple[Solid, Mesh]]:
    """Return the parts of the wire of a task, from the free end."""
    prefix = required_goal(task, GuideTable).wire
    parts = _parts(solids)
    wire = []
    for name, place in parts.items():
        if name.startswith(prefix):
            wire.append(place)
    if not wire:
        raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('wire', prefix, parts)}")
    return wire


def _axis(solid: Solid, part: Mesh) -> tuple[Array, Array, float, float]:
    """Return middle (3,), direction (3,), half the length, and radius of a long part in the World, in m."""
    p = _vertices(part, solid)
    centre = (p.min(axis=0) + p.max(axis=0)) / 2
    # the direction in which the vertices spread most
    axis = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
    along = (p - centre) @ axis
    radius = float(np.linalg.norm(p - centre - np.outer(along, axis), axis=1).max())
    middle = centre + axis * (along.max() + along.min()) / 2
    half = float(along.max() - along.min()) / 2
    return middle, axis, half, radius


def _nearest(p: Array, ends: Sequence[Array]) -> float:
    return min(_far(p, end) for end in ends)


def _far(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b))


def _table(scene: Scene) -> ContactTable:
    if scene.contact is None:
        raise TwinError(f"scene '{scene.name}' has no contact: add a section [contact] to {scene.file.name}")
    return scene.contact


def _solids(scene: Scene, props: Mechanism | None) -> list[Solid]:
    table = _table(scene)
    bodies: Mapping[str, Body] = {}
    poses: Mapping[str, Array] = {}
    if props is not None:
        bodies = {body.name: body for body in props.bodies}
    for name in table.solid:
        if name not in bodies:
            raise TwinError(f"{scene.file.name}: contact: {unknown('props body', name, bodies)}")
    if props is not None:
        poses = ReferenceModel(props).home().link_poses
    solids = []
    for name in table.solid:
        solids.append(Solid(name, bodies[name].meshes, table.friction, poses[name]))
    return solids


def _vertices(part: Mesh, solid: Solid) -> Array:
    """Return the vertices (k, 3) of a part of a solid in the World."""
    return part.vertices @ solid.T_world_body[:3, :3].T + solid.T_world_body[:3, 3]


def _box(part: Mesh, solid: Solid) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) of the box around a part in the World."""
    p = _vertices(part, solid)
    return p.min(axis=0), p.max(axis=0)
