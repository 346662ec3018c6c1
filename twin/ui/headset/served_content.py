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
from twin.model.movable import objects_as_mechanism
from twin.model.scene import Place, Scene
from twin.model.task import goal_of
from twin.model.trainer import MODEL
from twin.simulation.tasks.align import task as alignment
from twin.simulation.tasks.align.task import Alignment
from twin.ui.access.responses import File
from twin.ui.headset import server_files
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.description import assumptions, describe, numbers, pose
from twin.ui.headset.live_robot import LiveRobot
from twin.ui.headset.live_scene import LiveScene
from twin.ui.headset.scenery_files import drawn_of_robot, drawn_of_scene
from twin.ui.session.deformable_feed import Feed, FieldSurface
from twin.ui.session.driven_machine import DrivenMachine
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.timeline import Clock

if TYPE_CHECKING:
    from twin.ui.headset.console_stream import ConsoleStream
    from twin.ui.headset.mirrored_machine import MirroredMachine
    from twin.ui.session.mirror import Mirror

_ROBOT_FOLDER = "robots/{}/"
"""URL path of the folder with the files of a robot in a scene; {} is the name of the robot's place."""

_PROPS_FILE = "props.glb"
_OBJECTS_FILE = "objects.glb"

_NO_MOTION_ENTRIES = {"protocols": [], "variants": [], "postures": [], "distances": [], "has_workspace": False}
"""Entries of robot.json that a robot lacks if clients cannot move it alone."""

Endpoint = tuple[str, int]
"""Host and port."""


@dataclass(frozen=True)
class ServedContent:
    """Content of a server.

    Attributes:
        live: source of the stream.
        name: name of the robot or of the scene.
        model_hash: hash of the displayed geometry.
        files: all files except those of the page, by path.
        preload: paths of the files that the page requests first.
        late: files that appear while the server runs, by path.
    """

    live: LiveScene | ConsoleStream | MirroredMachine
    name: str
    model_hash: str
    files: dict[str, File]
    preload: tuple[str, ...]
    late: dict[str, File] = field(default_factory=dict)

    @property
    def hello(self) -> JsonObject:
        """Entries of the first document `hello` for a client: name of the robot or scene, and hash of the geometry."""
        kind = "robot" if self.live.is_single_robot else "scene"
        return {kind: self.name, "model_hash": self.model_hash}


def of_robot(
    robot: Robot,
    source: str,
    protocol: str | None = None,
    plans: bool = True,
    feed: Feed | None = None,
    machine: DrivenMachine | None = None,
) -> ServedContent:
    """Return the content for one robot, with the patients of its protocols; call this function in an event loop.

    `robot`, `source`, `protocol`, `plans` and `machine` are arguments of `LiveRobot`; `feed` is the source of
    deformables, None: none.
    """
    from twin.exchange.formats.glb.write import glb_bytes

    clock = Clock()
    twin = LiveRobot(robot, source, protocol, plans, clock, machine=machine)
    robot_document = twin.description
    files = server_files.robot_files(glb_bytes(robot.mechanism), robot_document)
    patients = {}
    for name, patient in twin.patients.items():
        patients[name] = glb_bytes(patient.mechanism, (), patient.poses)
    files |= server_files.patient_files(patients)
    robot_entry = {**robot_document, "files": "", "ports": []}
    scene_document = _describe(robot.name, robot_document["title"], [robot_entry], feed)
    scene_document["model_hash"] = robot_document["model_hash"]
    scenery = drawn_of_robot(robot)
    scene_document |= scenery.entries
    files |= scenery.files
    files |= server_files.scene_file(scene_document)
    live = LiveScene([twin], clock, feed)
    return ServedContent(live, robot.name, robot_document["model_hash"], files, ("robot.glb",))


def of_scene(loaded: LoadedScene, plans: bool = True) -> ServedContent:
    """Return the content for a scene: robots at their places, and props; call this function in an event loop.

    `plans`: whether the robots plan and play their protocols.
    """
    clock = Clock()
    twins = []
    for place in loaded.scene.places:
        twins.append(LiveRobot(loaded.robots[place.name], place.robot, place.protocol, plans, clock, place))
    live = LiveScene(twins, clock, loaded.feed)
    return _content_of_places(loaded, live, [twin.description for twin in twins])


def of_console(
    loaded: LoadedScene,
    exercise: Exercise = NO_TASK,
    packets: Endpoint | None = None,
    mqtt: Endpoint | None = None,
    topic: str | None = None,
) -> ServedContent:
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
    from twin.ui.headset.console_stream import ConsoleStream

    stream = ConsoleStream(loaded, exercise)
    scene = loaded.scene
    robots = dict(loaded.robots)
    if loaded.machines is not None:
        for model in scene.models:
            robots[model.name] = robots[model.name.removesuffix(MODEL)]
        scene = replace(scene, places=(*scene.places, *scene.models))
    if topic is None:
        topic = f"twin/{scene.name}/scale"
    try:
        if packets is not None:
            stream.listen(*packets)
        if mqtt is not None:
            stream.connect(*mqtt, topic)
    except TwinError:
        stream.close()
        raise
    robot_documents = []
    for place in scene.places:
        robot = robots[place.name]
        robot_documents.append(describe(robot, MovableRobot(robot), {}, {}, place) | _NO_MOTION_ENTRIES)
    props = alignment.beside(loaded.props, goal_of(exercise.task, Alignment))
    return _content_of_places(LoadedScene(scene, robots, props, stream.feed), stream, robot_documents)


def of_mirror(mirror: Mirror) -> ServedContent:
    """Return the content for a mirrored machine: solid robot (measured joint values), ghost (desired joint values)."""
    from twin.exchange.formats.glb.write import glb_bytes
    from twin.ui.headset.mirrored_machine import MirroredMachine

    robot = mirror.robot
    glb = glb_bytes(robot.mechanism)
    live = MirroredMachine(mirror)
    files: dict[str, File] = {}
    robots = []
    preload = []
    for name in (mirror.name, mirror.ghost):
        folder = _ROBOT_FOLDER.format(name)
        place = Place(name, robot.name, "", np.eye(4), {}, {}, {})
        robot_document = describe(robot, MovableRobot(robot), {}, {}, place) | _NO_MOTION_ENTRIES
        files |= server_files.robot_files(glb, robot_document, folder)
        robots.append({**robot_document, "files": folder, "ports": []})
        preload.append(f"{folder}robot.glb")
    scene_document = _describe(mirror.name, f"{robots[0]['title']}: its machine", robots, None)
    scene_document["machines"] = live.about_machines
    scene_document["model_hash"] = _hash_of(scene_document)
    files |= server_files.scene_file(scene_document)
    return ServedContent(live, mirror.name, scene_document["model_hash"], files, tuple(preload))


def _content_of_places(
    loaded: LoadedScene, live: LiveScene | ConsoleStream, robot_documents: Sequence[JsonObject]
) -> ServedContent:
    """Return the content for robots at their places; `robot_documents`: content of robot.json of each robot."""
    from twin.exchange.formats.glb.write import glb_bytes

    scene = loaded.scene
    files: dict[str, File] = {}
    robots = []
    preload = []
    for place, robot_document in zip(scene.places, robot_documents, strict=True):
        folder = _ROBOT_FOLDER.format(place.name)
        files |= server_files.robot_files(glb_bytes(loaded.robots[place.name].mechanism), robot_document, folder)
        robots.append({**robot_document, "files": folder, "ports": _ports(place)})
        preload.append(f"{folder}robot.glb")
    scene_document = _describe(scene.name, scene.title, robots, loaded.feed)
    scene_document["cameras"] = _cameras(scene, loaded.robots)
    scene_document["assumed"] = assumptions(scene.parameters)
    late: dict[str, File] = {}
    if not isinstance(live, LiveScene):
        late = live.files
        goal = goal_of(live.task, Alignment)
        if goal is not None:
            for camera in scene_document["cameras"]:
                if camera["name"] == live.table.camera:
                    camera["line"] = goal.line
        scene_document["console"] = live.about
        machines = live.about_machines
        if machines is not None:
            scene_document["machines"] = machines
        if live.objects:
            files |= server_files.glb_file(
                _OBJECTS_FILE, glb_bytes(objects_as_mechanism(live.objects, wire.OBJECTS_PREFIX))
            )
            scene_document["objects"] = {"file": _OBJECTS_FILE, "names": [item.name for item in live.objects]}
    props = loaded.props
    if props is not None:
        glb = glb_bytes(props)
        files |= server_files.glb_file(_PROPS_FILE, glb)
        digest = hashlib.sha256(glb).hexdigest()
        scene_document["props"] = {"name": props.name, "file": _PROPS_FILE, "sha256": digest}
        preload.append(_PROPS_FILE)
    scene_document["model_hash"] = _hash_of(scene_document)
    # what is only drawn does not change the hash of the geometry
    solid = {place.name: loaded.robots[place.name] for place in scene.places if not place.name.endswith(MODEL)}
    scenery = drawn_of_scene(scene, solid, props)
    scene_document |= scenery.entries
    files |= scenery.files
    files |= server_files.scene_file(scene_document)
    return ServedContent(live, scene.name, scene_document["model_hash"], files, tuple(preload), late)


def _hash_of(scene_document: JsonObject) -> str:
    """Return the hash of the content of scene.json, with which a client notices another geometry."""
    text = json.dumps(scene_document, sort_keys=True).encode()
    return "sha256:" + hashlib.sha256(text).hexdigest()


def _describe(name: str, title: str, robots: Sequence[JsonObject], feed: Feed | None) -> JsonObject:
    """Return the content of scene.json for robots, without cameras, props and console."""
    fields = []
    if feed is not None:
        for field_name, surface in feed.surfaces.items():
            fields.append(_field(field_name, surface))
    return {
        "schema": "twin-scene",
        "version": 1,
        "name": name,
        "title": title,
        "frame": "z-up right-handed",
        "robots": list(robots),
        "props": None,
        "cameras": [],
        "fields": fields,
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
    T_base_world = spatial.inverse(place.T_world_base)
    entries = []
    for trocar, p_world in place.p_world_ports.items():
        p_base = (T_base_world @ np.append(p_world, 1.0))[:3]
        entries.append({"trocar": trocar, "name": place.ports[trocar], "at": numbers(p_base)})
    return entries


def _cameras(scene: Scene, robots: Mapping[str, Robot]) -> list[JsonObject]:
    """Return the cameras of a scene.

    Raises:
        TwinError: a robot lacks the frame of its camera.
    """
    entries = []
    for name, camera in scene.cameras.items():
        frames = {frame.name: frame for frame in robots[camera.robot].mechanism.frames}
        frame = frames.get(camera.frame)
        if frame is None:
            raise TwinError(f"{scene.file}: camera '{name}': {camera.robot} has no frame '{camera.frame}'")
        entry = {
            "name": name,
            "robot": camera.robot,
            "link": frame.body,
            "T_link_camera": pose(frame.T_body_frame @ camera.in_frame),
            "view": camera.view_deg * DEG,
        }
        if camera.stereo is not None:
            entry["stereo"] = [camera.stereo.baseline_mm * MM, camera.stereo.converge_mm * MM]
        entries.append(entry)
    return entries
