"""Content of `twin serve`: the live robot or scene, and the files to display it."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from twin.api import Robot
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.units import DEG, MM
from twin.model import alignment
from twin.model.movable import together
from twin.model.scene import Place, Scene
from twin.model.trainer import MODEL
from twin.ui.access.responses import File
from twin.ui.headset import files
from twin.ui.headset import protocol as wire
from twin.ui.headset.description import describe, numbers, pose
from twin.ui.headset.live import Live
from twin.ui.headset.twin import Twin
from twin.ui.session.desk import Desk
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.feed import Feed, FieldSurface
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.timeline import Clock

if TYPE_CHECKING:
    from twin.ui.headset.mirrored import Mirrored
    from twin.ui.headset.operation import Operation
    from twin.ui.session.mirror import Mirror

_ROBOTS = "robots/{}/"
"""URL path of the folder with the files of a robot in a scene; {} is the name of the robot's place."""

_PROPS, _OBJECTS = "props.glb", "objects.glb"

Endpoint = tuple[str, int]
"""Host and port."""


@dataclass(frozen=True)
class Served:
    """Content of a server.

    Attributes:
        live: source of the stream.
        name: name of the robot or of the scene.
        model_hash: hash of the displayed geometry.
        files: all files except those of the page, by path.
        preload: paths of the files that the page requests first.
        late: files that appear while the server runs, by path.
    """

    live: Live | Operation | Mirrored
    name: str
    model_hash: str
    files: dict[str, File]
    preload: tuple[str, ...]
    late: dict[str, File] = field(default_factory=dict)

    @property
    def hello(self) -> JsonObject:
        """Entries of the first document `hello` for a client: name of the robot or scene, and hash of the geometry."""
        return {"robot" if self.live.alone else "scene": self.name, "model_hash": self.model_hash}


def of_robot(
    robot: Robot, source: str, protocol: str | None = None, plans: bool = True, feed: Feed | None = None
) -> Served:
    """Return the content for one robot, with the patients of its protocols; call this function in an event loop.

    `robot`, `source`, `protocol` and `plans` are arguments of `Twin`; `feed` is the source of deformables, None: none.
    """
    from twin.exchange.formats.glb.write import glb_bytes

    clock = Clock()
    twin = Twin(robot, source, protocol, plans, clock)
    about = twin.description
    own = files.robot_files(glb_bytes(robot.mechanism), about)
    own |= files.patient_files({n: glb_bytes(p.mechanism, (), p.poses) for n, p in twin.patients.items()})
    scene = _describe(robot.name, about["title"], [{**about, "files": "", "ports": []}], feed)
    scene["model_hash"] = about["model_hash"]
    own |= files.scene_file(scene)
    live = Live([twin], clock, feed)
    return Served(live, robot.name, about["model_hash"], own, ("robot.glb",))


def of_scene(loaded: LoadedScene, plans: bool = True) -> Served:
    """Return the content for a scene: robots at their places, and props; call this function in an event loop.

    `plans`: whether the robots plan and play their protocols.
    """
    clock = Clock()
    twins = [Twin(loaded.robots[p.name], p.robot, p.protocol, plans, clock, p) for p in loaded.scene.places]
    return _placed(loaded, Live(twins, clock, loaded.feed), [t.description for t in twins])


def of_console(
    loaded: LoadedScene,
    exercise: Exercise = NO_TASK,
    packets: Endpoint | None = None,
    mqtt: Endpoint | None = None,
    topic: str | None = None,
) -> Served:
    """Return the content for a scene whose robots are controlled by its console; call this function in an event loop.

    Args:
        loaded: the scene; the models of its machines are shown beside the machines.
        exercise: task, condition, session file and report.
        packets: host and port at which poses of the hands are received by UDP; None: no UDP.
        mqtt: address of the MQTT broker for the motion scale; None: no broker.
        topic: topic of the motion scale; None: twin/<scene>/scale.

    Raises:
        TwinError: the scene has no console, its robots do not match the console, or the port for packets is in use.
        OutputError: the session cannot be written.
    """
    # It imports MuJoCo and the simulation, which a single robot does not need.
    from twin.ui.headset.operation import Operation

    operation, scene, robots = Operation(loaded, exercise), loaded.scene, loaded.robots
    if loaded.machines is not None:
        robots = {**robots, **{p.name: robots[p.name.removesuffix(MODEL)] for p in scene.models}}
        scene = replace(scene, places=(*scene.places, *scene.models))
    try:
        if packets is not None:
            operation.listen(*packets)
        if mqtt is not None:
            operation.connect(*mqtt, f"twin/{scene.name}/scale" if topic is None else topic)
    except TwinError:
        operation.close()
        raise
    about = [describe(robots[p.name], Desk(robots[p.name]), {}, {}, p) for p in scene.places]
    nothing = {"protocols": [], "variants": [], "postures": [], "has_workspace": False}
    props = alignment.beside(loaded.props, None if exercise.task is None else exercise.task.alignment)
    shown = LoadedScene(scene, robots, props, operation.feed)
    return _placed(shown, operation, [a | nothing for a in about])


def of_mirror(mirror: Mirror) -> Served:
    """Return the content for a mirrored machine: solid robot (measured joint values), ghost (desired joint values)."""
    from twin.exchange.formats.glb.write import glb_bytes
    from twin.ui.headset.mirrored import Mirrored

    robot, own, placed = mirror.robot, {}, []
    glb, live = glb_bytes(robot.mechanism), Mirrored(mirror)
    nothing = {"protocols": [], "variants": [], "postures": [], "has_workspace": False}
    for name in (mirror.name, mirror.ghost):
        folder = _ROBOTS.format(name)
        place = Place(name, robot.name, "", np.eye(4), {}, {}, {})
        one = describe(robot, Desk(robot), {}, {}, place) | nothing
        own |= files.robot_files(glb, one, folder)
        placed.append({**one, "files": folder, "ports": []})
    described = _describe(mirror.name, f"{placed[0]['title']}: its machine", placed, None)
    described["machines"] = live.about_machines
    text = json.dumps(described, sort_keys=True).encode()
    described["model_hash"] = "sha256:" + hashlib.sha256(text).hexdigest()
    own |= files.scene_file(described)
    preload = tuple(f"{_ROBOTS.format(n)}robot.glb" for n in (mirror.name, mirror.ghost))
    return Served(live, mirror.name, described["model_hash"], own, preload)


def _placed(loaded: LoadedScene, live: Live | Operation, about: Sequence[JsonObject]) -> Served:
    from twin.exchange.formats.glb.write import glb_bytes

    scene, robots, props, own, placed = loaded.scene, loaded.robots, loaded.props, {}, []
    for place, one in zip(scene.places, about, strict=True):
        folder = _ROBOTS.format(place.name)
        own |= files.robot_files(glb_bytes(robots[place.name].mechanism), one, folder)
        placed.append({**one, "files": folder, "ports": _ports(place)})
    described = _describe(scene.name, scene.title, placed, loaded.feed)
    described["cameras"] = _cameras(scene, robots)
    if not isinstance(live, Live) and live.task is not None and (a := live.task.alignment) is not None:
        next(c for c in described["cameras"] if c["name"] == live.table.camera)["line"] = a.line
    described["assumed"] = [f"{p.name}: {p.note}" for p in scene.parameters if p.provenance == "ASSUMED"]
    if not isinstance(live, Live):
        described["console"] = live.about
        if (machines := live.about_machines) is not None:
            described["machines"] = machines
        if live.objects:
            glb = glb_bytes(together(live.objects, wire.OBJECTS))
            own |= files.glb_file(_OBJECTS, glb)
            described["objects"] = {"file": _OBJECTS, "names": [item.name for item in live.objects]}
    preload = [f"{_ROBOTS.format(p.name)}robot.glb" for p in scene.places]
    if props is not None:
        glb = glb_bytes(props)
        own |= files.glb_file(_PROPS, glb)
        digest = hashlib.sha256(glb).hexdigest()
        described["props"] = {"name": props.name, "file": _PROPS, "sha256": digest}
        preload.append(_PROPS)
    text = json.dumps(described, sort_keys=True).encode()
    described["model_hash"] = "sha256:" + hashlib.sha256(text).hexdigest()
    own |= files.scene_file(described)
    late = {} if isinstance(live, Live) else live.files
    return Served(live, scene.name, described["model_hash"], own, tuple(preload), late)


def _describe(name: str, title: str, robots: Sequence[JsonObject], feed: Feed | None) -> JsonObject:
    return {
        "schema": "twin-scene",
        "version": 1,
        "name": name,
        "title": title,
        "frame": "z-up right-handed",
        "robots": list(robots),
        "props": None,
        "cameras": [],
        "fields": [] if feed is None else [_field(n, s) for n, s in feed.surfaces.items()],
        "assumed": [],
    }


def _field(name: str, surface: FieldSurface) -> JsonObject:
    triangles = np.ascontiguousarray(surface.triangles, "<u4")
    return {
        "name": name,
        "triangles": base64.b64encode(triangles.tobytes()).decode(),
        "color": list(surface.color),
        "opacity": surface.opacity,
    }


def _ports(place: Place) -> list[JsonObject]:
    """Return the ports in the patient that a robot uses, with positions in the robot's base frame."""
    T = spatial.inverse(place.T_world_base)
    return [
        {"trocar": trocar, "name": place.ports[trocar], "at": numbers((T @ np.append(p, 1.0))[:3])}
        for trocar, p in place.p_world_ports.items()
    ]


def _cameras(scene: Scene, robots: Mapping[str, Robot]) -> list[JsonObject]:
    out = []
    for name, camera in scene.cameras.items():
        frame = next((f for f in robots[camera.robot].mechanism.frames if f.name == camera.frame), None)
        if frame is None:
            raise TwinError(f"{scene.file}: camera '{name}': {camera.robot} has no frame '{camera.frame}'")
        out.append(
            {
                "name": name,
                "robot": camera.robot,
                "link": frame.body,
                "T_link_camera": pose(frame.T_body_frame @ camera.in_frame),
                "view": camera.view_deg * DEG,
                **({} if (s := camera.stereo) is None else {"stereo": [s.baseline_mm * MM, s.converge_mm * MM]}),
            }
        )
    return out
