"""A page that only shows: the robots and organs of a scene as a running `twin serve` simulates them.

It is a client of the stream (docs/stream.md) that sends nothing.
"""

from __future__ import annotations

import base64
import json
import threading
import urllib.request
from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
import viser
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from twin.api import Robot
from twin.core.errors import TwinError
from twin.core.units import srgb
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.reference import ReferenceModel
from twin.ui.headset import protocol as wire
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.viewer.console import AWAY, hand_text, status
from twin.ui.viewer.loop import Loop
from twin.ui.viewer.nodes import RobotNodes
from twin.ui.viewer.room import OUTSIDE, corners, furnish

_AGAIN, _PATIENCE = 1.0, 10.0
"""Time in s between two attempts to connect; time in s in which an answer must arrive."""


class Watched:
    """The stream of a running server, read by a thread.

    Attributes:
        about: content of the server's /scene.json.
        reading: last state of the console; None before the first state, and for a scene without a console.
        problem: why nothing arrives; "" while frames arrive.
    """

    def __init__(self, port: int, scene: str) -> None:
        """Connect to a server on this machine.

        Raises:
            TwinError: no server answers, or it serves something else.
        """
        self._port, self.problem = port, ""
        self.reading: dict[str, Any] | None = None
        self._frame: bytes | None = None
        self._stop = threading.Event()
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/scene.json", timeout=_PATIENCE) as answer:
                self.about = json.load(answer)
        except (OSError, ValueError) as error:
            raise TwinError(f"--watch {port}: no `twin serve {scene}` answers on this port: {error}") from None
        if self.about["name"] != scene:
            raise TwinError(f"--watch {port}: the server shows '{self.about['name']}', not '{scene}'")
        threading.Thread(target=self._read, daemon=True).start()

    def take(self) -> bytes | None:
        """Return the newest frame, once; None if none has arrived since the last call."""
        frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        """End the connection."""
        self._stop.set()

    def _read(self) -> None:
        while not self._stop.is_set():
            try:
                origin = f"http://127.0.0.1:{self._port}"
                with connect(f"ws://127.0.0.1:{self._port}/ws", origin=origin, max_size=None) as ws:  # type: ignore[arg-type]
                    self._hear(ws)
            except (OSError, WebSocketException, TimeoutError) as error:
                self.problem = f"The server on port {self._port} does not answer: {error}"
            self._stop.wait(_AGAIN)

    def _hear(self, ws: Any) -> None:
        while not self._stop.is_set():
            message = ws.recv(timeout=_PATIENCE)
            self.problem = ""
            if isinstance(message, bytes):
                self._frame = message
            elif (document := json.loads(message)).get("type") == "state":
                self.reading = document.get("console")


class WatchFront(Loop):
    """The page of a spectator.

    Attributes:
        watched: the stream.
        nodes: scene nodes of each robot.
    """

    def __init__(
        self,
        title: str,
        scene: Scene,
        robots: Mapping[str, Robot],
        props: Mechanism | None,
        server: viser.ViserServer,
        port: int,
        stopping: threading.Event | None = None,
    ) -> None:
        """Connect to the `twin serve` at a port of this machine, and draw the scene.

        Raises:
            TwinError: no server answers, or it serves another scene.
        """
        super().__init__(server, title, stopping)
        self.watched = Watched(port, scene.name)
        self._places = {p.name: p.T_world_base for p in scene.places}
        homes = {n: r.reference().home().link_poses for n, r in robots.items()}
        self.nodes = {
            n: RobotNodes(server, f"/{n}", r.mechanism, {b: self._places[n] @ T for b, T in homes[n].items()})
            for n, r in robots.items()
        }
        boxes = [n.box for n in self.nodes.values()]
        if props is not None:
            drawn = RobotNodes(server, f"/{props.name}", props, ReferenceModel(props).home().link_poses)
            boxes.append(drawn.box)
            for body, handle in drawn.meshes:
                handle.opacity = 0.3 if body == "patient" else None
        self._meshes: list[viser.MeshHandle] = []
        found = np.concatenate([corners(b) for b in boxes])
        low, high = found.min(axis=0), found.max(axis=0)
        middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
        furnish(server, middle, size, min(0.0, float(low[2])))
        away = next(iter(OUTSIDE.values()))
        server.initial_camera.position, server.initial_camera.look_at = middle + AWAY * size * away, middle
        server.gui.set_panel_label(title)
        self._status, self._said = server.gui.add_html(""), ""

    def frame(self, passed: float, wished: bool) -> None:
        """Show the newest frame and the state."""
        if (data := self.watched.take()) is not None:
            self._draw(data)
        reading = self.watched.reading
        lines = [self.watched.problem] if self.watched.problem else []
        if reading is not None:
            lines += [status(reading)[1], *(hand_text(reading, hand)[1] for hand in reading["hands"])]
            lines += [f"Tool of {h['robot']}: {h['tool']}" for h in reading["hands"].values() if "tool" in h]
        said = "".join(f"<div style='padding:0 1em .4em'>{escape(line)}</div>" for line in lines)
        if said != self._said:
            self._said = self._status.content = said

    def close(self) -> None:
        """End the connection, and release the port."""
        self.watched.close()
        super().close()

    def _draw(self, data: bytes) -> None:
        shown = unpack_scene(data)
        for robot, part in zip(self.watched.about["robots"], shown.robots, strict=False):
            T = self._places[robot["name"]]
            poses = {n: T @ wire.pose_of(seven) for n, seven in zip(robot["links"], part.poses, strict=True)}
            self.nodes[robot["name"]].write(poses)
        for k, vertices in enumerate(shown.fields):
            if k < len(self._meshes):
                self._meshes[k].vertices = vertices
            else:
                field = self.watched.about["fields"][k]
                triangles = np.frombuffer(base64.b64decode(field["triangles"]), "<u4").reshape(-1, 3)
                red, green, blue = (round(255 * srgb(c)) for c in field["color"])
                self._meshes.append(
                    self.server.scene.add_mesh_simple(
                        f"/fields/{field['name']}", vertices, triangles, color=(red, green, blue), side="double"
                    )
                )
