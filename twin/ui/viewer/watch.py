"""A read-only page that shows the robots, organs and objects of a scene as a running `twin serve` simulates them."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from html import escape
from typing import Protocol

import numpy as np
import viser

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import srgb
from twin.model.trainer import MODEL
from twin.reference import ReferenceModel
from twin.simulation.plants.tissue import clips_of
from twin.ui.session.feed import FieldSurface
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.viewer.console_page import AWAY, hand_text, status
from twin.ui.viewer.loop import ViewerPage
from twin.ui.viewer.nodes import BLUE, RobotNodes, object_nodes
from twin.ui.viewer.room import OUTSIDE, extent, furnish

OBJECTS = "objects"
"""Key of the poses of movable objects in a frame of a stream."""


class SpectatorStream(Protocol):
    """Interface of the source from which a page reads the data of a running server.

    Attributes:
        surfaces: triangles and colours of the deformables, by name.
        robots: names of the robots.
        objects: names of the movable objects.
        reading: last state of the console; None before the first state, and for a scene without a console.
        problem: reason for missing frames; "" while frames arrive.
    """

    surfaces: Mapping[str, FieldSurface]
    robots: Sequence[str]
    objects: Sequence[str]
    reading: JsonObject | None
    problem: str

    def take(self) -> tuple[Mapping[str, Mapping[str, Array]], Mapping[str, Array]] | None:
        """Return (link poses, vertices) of the newest frame; None if no frame has arrived since the last call.

        Link poses are T_base_link (4, 4), by robot and link; the entry "objects" has the poses T_world_object (4, 4) of
        the movable objects. Vertices are (n, 3) in m in the world frame, by deformable.
        """
        ...

    def close(self) -> None: ...  # noqa: D102


class WatchFront(ViewerPage):
    """The page of a spectator.

    Attributes:
        stream: source of the shown frames.
        nodes: scene nodes of each robot and, if the server shows machines, of the model of each machine.
    """

    def __init__(
        self,
        title: str,
        loaded: LoadedScene,
        server: viser.ViserServer,
        stream: SpectatorStream,
        stopping: threading.Event | None = None,
    ) -> None:
        """Draw the scene; the robots are in their home postures until the first frame.

        Raises:
            TwinError: the server shows robots or movable objects that the scene does not have.
        """
        super().__init__(server, title, stopping)
        self.stream = stream
        scene = loaded.scene
        self._places = {place.name: place.T_world_base for place in (*scene.places, *scene.models)}
        self.nodes: dict[str, RobotNodes] = {}
        boxes = []
        for name, robot in loaded.robots.items():
            home = robot.reference().home().link_poses
            poses = {body: self._places[name] @ T for body, T in home.items()}
            self.nodes[name] = RobotNodes(server, f"/{name}", robot.mechanism, poses)
            boxes.append(self.nodes[name].box)
        # a server with machines also shows their models
        self._models = {}
        for model in scene.models:
            self._models[model.name] = loaded.robots[model.name.removesuffix(MODEL)].mechanism
        props = loaded.props
        if props is not None:
            drawn = RobotNodes(server, f"/{props.name}", props, ReferenceModel(props).home().link_poses)
            boxes.append(drawn.box)
            for body, handle in drawn.meshes:
                handle.opacity = 0.3 if body == "patient" else None
        known = {item.name: item for item in (*scene.objects, *clips_of(scene.tools))}
        unknown = [*(set(stream.objects) - set(known)), *(set(stream.robots) - set(self._places))]
        if unknown:
            raise TwinError(f"the server shows {', '.join(sorted(unknown))}, which the scene's files here do not have")
        self._objects = {name: object_nodes(server, known[name], np.eye(4)) for name in stream.objects}
        self._meshes: dict[str, viser.MeshHandle] = {}
        low, middle, size = extent(boxes)
        furnish(server, middle, size, min(0.0, float(low[2])))
        server.initial_camera.position = middle + AWAY * size * OUTSIDE["overview"]
        server.initial_camera.look_at = middle
        server.gui.set_panel_label(title)
        self._status = server.gui.add_html("")

    def frame(self, passed: float, wished: bool) -> None:
        """Show the newest frame and the state."""
        frame = self.stream.take()
        if frame is not None:
            self._draw(*frame)
        reading = self.stream.reading
        lines = []
        if self.stream.problem:
            lines.append(self.stream.problem)
        if reading is not None:
            lines.append(status(reading)[1])
            tools = []
            for hand, state in reading["hands"].items():
                lines.append(hand_text(reading, hand)[1])
                if "tool" in state:
                    tools.append(f"Tool of {state['robot']}: {state['tool']}")
            lines += tools
        self._status.content = "".join(f"<div style='padding:0 1em .4em'>{escape(line)}</div>" for line in lines)

    def close(self) -> None:
        """End the connection, and release the port."""
        self.stream.close()
        super().close()

    def _draw(self, links: Mapping[str, Mapping[str, Array]], fields: Mapping[str, Array]) -> None:
        for name, pose in links.get(OBJECTS, {}).items():
            self._objects[name].write({name: pose})
        for robot, poses in links.items():
            if robot == OBJECTS:
                continue
            T_world_base = self._places[robot]
            placed = {name: T_world_base @ T for name, T in poses.items()}
            if robot in self._models and robot not in self.nodes:
                self.nodes[robot] = RobotNodes(self.server, f"/{robot}", self._models[robot], placed, BLUE)
            self.nodes[robot].write(placed)
        for name, vertices in fields.items():
            if name in self._meshes:
                self._meshes[name].vertices = np.asarray(vertices, np.float32)
                continue
            surface = self.stream.surfaces[name]
            red, green, blue = (round(255 * srgb(c)) for c in surface.color)
            triangles = np.asarray(surface.triangles, np.uint32)
            self._meshes[name] = self.server.scene.add_mesh_simple(
                f"/fields/{name}", vertices, triangles, color=(red, green, blue), side="double"
            )
