"""What the page draws beside the measured bodies: its file, its entry of scene.json, and the person for scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.api import Robot
from twin.core.json_types import JsonObject
from twin.core.units import MM
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.ui.access.responses import File
from twin.ui.headset import server_files
from twin.ui.session.drawn_parts import DrawnCable, DrawnParts, drawn_parts, person

_DRAWN_FILE = "drawn.glb"
_PERSON_FILE = "person.glb"

Owner = str | None
"""Name of a robot; None: the scene."""


@dataclass(frozen=True)
class DrawnFiles:
    """Files of what is drawn, by path, and the entries of scene.json that name them."""

    files: dict[str, File]
    entries: JsonObject


def drawn_of_robot(robot: Robot) -> DrawnFiles:
    """Return what is drawn beside one robot, with the person for scale.

    Raises:
        DescriptionError: its scenery.toml is invalid.
    """
    parts = _parts_of(robot)
    if parts is None:
        return _drawing_entry([])
    return _drawing_entry([(robot.name, parts)])


def drawn_of_scene(scene: Scene, robots: Mapping[str, Robot], props: Mechanism | None) -> DrawnFiles:
    """Return what is drawn in a scene and beside its robots, with the person; errors as of `drawn_of_robot`."""
    parts: list[tuple[Owner, DrawnParts]] = []
    bodies = () if props is None else [body.name for body in props.bodies]
    scene_parts = drawn_parts(scene.file, (), bodies)
    if scene_parts is not None:
        parts.append((None, scene_parts))
    for name, robot in robots.items():
        own_parts = _parts_of(robot)
        if own_parts is not None:
            parts.append((name, own_parts))
    return _drawing_entry(parts)


def _parts_of(robot: Robot) -> DrawnParts | None:
    if robot.files is None:
        return None
    return drawn_parts(robot.files.description, [body.name for body in robot.mechanism.bodies])


def _drawing_entry(parts: Sequence[tuple[Owner, DrawnParts]]) -> DrawnFiles:
    bodies: list[Body] = []
    nodes: list[JsonObject] = []
    cables: list[JsonObject] = []
    finishes: list[JsonObject] = []
    notes: list[str] = []
    for owner, parts_of_owner in parts:
        if parts_of_owner.note not in notes:
            notes.append(parts_of_owner.note)
        for link, pattern, body in parts_of_owner.bodies():
            name = f"drawn{len(bodies)}"
            meshes = tuple(replace(mesh, name=f"{name}_{mesh.name}") for mesh in body.meshes)
            bodies.append(Body(name, meshes))
            nodes.append({"node": name, "robot": owner, "link": link or None, "pattern": pattern})
        cables += [_cable_entry(owner, cable) for cable in parts_of_owner.cables]
        for finish in parts_of_owner.finishes:
            finishes.append({"body": finish.body, "color": list(finish.color), "pattern": finish.pattern})
    figure = person()
    standing = [body for _, _, body in figure.bodies()]
    contents = server_files.glb_file(_PERSON_FILE, _glb("person", standing))
    entries: JsonObject = {"person": {"file": _PERSON_FILE, "note": figure.note}}
    if parts:
        if bodies:
            contents |= server_files.glb_file(_DRAWN_FILE, _glb("drawn", bodies))
        entries["drawn"] = {
            "file": _DRAWN_FILE if bodies else None,
            "notes": notes,
            "parts": nodes,
            "cables": cables,
            "finishes": finishes,
        }
    return DrawnFiles(contents, entries)


def _cable_entry(owner: Owner, cable: DrawnCable) -> JsonObject:
    ends = []
    for end in cable.ends:
        ends.append({"link": end.link, "at": [value * MM for value in end.at_mm]})
    return {
        "robot": owner,
        "ends": ends,
        "length": cable.length_mm * MM,
        "radius": 0.5 * cable.diameter_mm * MM,
        "color": list(cable.color),
    }


def _glb(name: str, bodies: Sequence[Body]) -> bytes:
    """Return a geometry file in which each body has its own frame at the origin."""
    from twin.exchange.formats.glb.write import glb_bytes

    base = bodies[0].name
    joints = tuple(Joint(f"at_{body.name}", "fixed", base, body.name) for body in bodies[1:])
    mechanism = Mechanism(name, base, tuple(bodies), joints, (Frame("tool", base, np.eye(4)),))
    return glb_bytes(mechanism, (), {body.name: np.eye(4) for body in bodies})
