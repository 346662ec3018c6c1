"""Contact of a console's instruments with the movable objects, bodies of props, pegs and wires of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Mesh
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
    scene, task = setup.scene, setup.task
    table, members, places = _table(scene), setup.members, setup.places
    effort = table.jaw_effort_n_mm * MM
    grippers = [Gripper(n, members[n].mechanism, members[n].kin, places[n].T_world_base, effort) for n in instruments]
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
    return {name: _peg(scene, solids, task, name) for name in sorted(names)}


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
    axes = [_axis(solid, part) for solid, part in wire]
    ends = [(middle - (half - radius) * axis, middle + (half - radius) * axis) for middle, axis, half, radius in axes]
    line = [*ends[0]]
    if min(_far(line[0], p) for p in ends[1]) < min(_far(line[1], p) for p in ends[1]):
        line.reverse()
    for pair in ends[1:]:
        line.append(max(pair, key=lambda p: _far(p, line[-1])))
    bodies = {solid.name: solid for solid in solids}
    if guide.dome not in bodies:
        raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('solid body', guide.dome, bodies)}")
    dome = bodies[guide.dome]
    corners = np.concatenate([part.vertices for part in dome.parts])
    require_hull(f"{scene.file.name}: task '{task.name}': dome '{dome.name}'", corners)
    hull = ConvexHull(corners @ dome.T_world_body[:3, :3].T + dome.T_world_body[:3, 3])
    return WireCourse(np.array(line), hull.equations)


def _peg(scene: Scene, solids: Sequence[Solid], task: ConsoleTask, name: str) -> Peg:
    parts = {part.name: (solid, part) for solid in solids for part in solid.parts}
    if name not in parts:
        raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('peg', name, parts)}")
    solid, part = parts[name]
    middle, axis, half, radius = _axis(solid, part)
    ends = [middle - half * axis, middle + half * axis]
    if not (others := [_box(x, solid) for x in solid.parts if x is not part]):
        raise TwinError(
            f"{scene.file.name}: task '{task.name}': '{name}' is the only part of its body: its free end is not known. "
            "Draw the peg and the board under it as parts of one body"
        )
    ends.sort(key=lambda end: min(float(np.linalg.norm(np.clip(end, *box) - end)) for box in others))
    return Peg(name, ends[1], ends[0], radius)


def _wire(solids: Sequence[Solid], scene: Scene, task: ConsoleTask) -> list[tuple[Solid, Mesh]]:
    """Return the parts of the wire of a task, from the free end."""
    prefix = required_goal(task, GuideTable).wire
    parts = {part.name: (solid, part) for solid in solids for part in solid.parts}
    if not (found := [parts[name] for name in parts if name.startswith(prefix)]):
        raise TwinError(f"{scene.file.name}: task '{task.name}': {unknown('wire', prefix, parts)}")
    return found


def _axis(solid: Solid, part: Mesh) -> tuple[Array, Array, float, float]:
    """Return middle (3,), direction (3,), half the length, and radius of a long part in the World, in m."""
    p = part.vertices @ solid.T_world_body[:3, :3].T + solid.T_world_body[:3, 3]
    middle = (p.min(axis=0) + p.max(axis=0)) / 2
    axis = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
    along = (p - middle) @ axis
    radius = float(np.linalg.norm(p - middle - np.outer(along, axis), axis=1).max())
    middle, half = middle + axis * (along.max() + along.min()) / 2, float(along.max() - along.min()) / 2
    return middle, axis, half, radius


def _far(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b))


def _table(scene: Scene) -> ContactTable:
    if scene.contact is None:
        raise TwinError(f"scene '{scene.name}' has no contact: add a section [contact] to {scene.file.name}")
    return scene.contact


def _solids(scene: Scene, props: Mechanism | None) -> list[Solid]:
    table = _table(scene)
    bodies = {} if props is None else {b.name: b for b in props.bodies}
    for name in table.solid:
        if name not in bodies:
            raise TwinError(f"{scene.file.name}: contact: {unknown('props body', name, bodies)}")
    poses = {} if props is None else ReferenceModel(props).home().link_poses
    return [Solid(name, bodies[name].meshes, table.friction, poses[name]) for name in table.solid]


def _box(part: Mesh, solid: Solid) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) of the box around a part in the World."""
    p = part.vertices @ solid.T_world_body[:3, :3].T + solid.T_world_body[:3, 3]
    return p.min(axis=0), p.max(axis=0)
