"""A read-only client of the stream: receives frames and states of a running `twin serve` on this machine."""

from __future__ import annotations

import base64
import json
import threading
import urllib.request
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from twin.core.errors import TwinError
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.spatial import Array
from twin.ui.headset import protocol as wire
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.session.feed import FieldSurface

_PAUSE = 1.0
"""Time in s between two attempts to connect."""

_PATIENCE = 10.0
"""Maximum time in s until the server answers."""


class Watched:
    """The stream of a running server, read by a thread. The server must show the same scene and task throughout.

    Attributes:
        surfaces: triangles and colours of the deformables, by name.
        robots: names of the robots.
        objects: names of the movable objects.
        reading: last state of the console; None before the first state, and for a scene without a console.
        problem: reason for missing frames; "" while frames arrive.
    """

    def __init__(self, port: int, scene: str) -> None:
        """Connect to a server on this machine.

        Raises:
            TwinError: no server answers, or the server shows a different scene.
        """
        self._port = port
        self._scene = scene
        self.problem = ""
        self.reading: JsonObject | None = None
        self._frame: bytes | None = None
        self._stop = threading.Event()
        about = self._about()
        self._model = about["model_hash"]
        self._links: dict[str, Sequence[str]] = {}
        for robot in about["robots"]:
            self._links[robot["name"]] = robot["links"]
        self.robots: Sequence[str] = tuple(self._links)
        self.objects: Sequence[str] = tuple(about.get("objects", {}).get("names", ()))
        if self.objects:
            self._links[wire.OBJECTS] = self.objects
        surfaces = {}
        for field in about["fields"]:
            surfaces[field["name"]] = _surface(field)
        self.surfaces: Mapping[str, FieldSurface] = surfaces
        threading.Thread(target=self._read, daemon=True).start()

    def take(self) -> tuple[dict[str, dict[str, Array]], dict[str, Array]] | None:
        """Return (link poses, vertices) of the newest frame; None if no frame has arrived since the last call.

        Link poses are T_base_link (4, 4), by robot and link; the entry "objects" has the poses T_world_object (4, 4) of
        the movable objects. Vertices are (n, 3) in m in the world frame, by deformable.
        """
        data = self._frame
        self._frame = None
        if data is None:
            return None
        frame = unpack_scene(data)
        links: dict[str, dict[str, Array]] = {}
        for (robot, names), part in zip(self._links.items(), frame.robots, strict=True):
            links[robot] = {}
            for name, pose in zip(names, part.poses, strict=True):
                links[robot][name] = wire.pose_of(pose)
        return links, dict(zip(self.surfaces, frame.fields, strict=True))

    def close(self) -> None:
        """End the connection."""
        self._stop.set()

    def _about(self) -> JsonObject:
        """Return the document scene.json of the server.

        Raises:
            TwinError: no server answers, or the server shows a different scene.
        """
        port = self._port
        scene = self._scene
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/scene.json", timeout=_PATIENCE) as answer:
                about = json.load(answer)
            name = about["name"]
            about["model_hash"]  # another server's document without a hash is refused here
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise TwinError(f"--watch {port}: no `twin serve {scene}` answers on this port: {error}") from None
        if name != scene:
            raise TwinError(f"--watch {port}: the server shows '{name}', not '{scene}'")
        return about

    def _read(self) -> None:
        while not self._stop.is_set():
            try:
                if self._about()["model_hash"] != self._model:
                    raise TwinError(
                        f"--watch {self._port}: the server shows '{self._scene}' with another task or other files: "
                        "start this command again"
                    )
                origin = f"http://127.0.0.1:{self._port}"
                with connect(f"ws://127.0.0.1:{self._port}/ws", origin=origin, max_size=None) as ws:  # type: ignore[arg-type]
                    self._hear(ws)
            except (OSError, WebSocketException, TimeoutError) as error:
                self.problem = f"The server on port {self._port} does not answer: {error}"
                self.reading = None
            except TwinError as error:
                self.problem = str(error)
                self.reading = None
            except (ValueError, AttributeError) as error:
                self.problem = f"The server on port {self._port} sends no valid document: {error}"
                self.reading = None
            self._stop.wait(_PAUSE)

    def _hear(self, ws: Any) -> None:
        while not self._stop.is_set():
            message = ws.recv(timeout=_PATIENCE)
            self.problem = ""
            if isinstance(message, bytes):
                self._frame = message
                continue
            document = json.loads(message)
            if document.get("type") == "state":
                self.reading = document.get("console")


def _surface(field: JsonMapping) -> FieldSurface:
    triangles = np.frombuffer(base64.b64decode(field["triangles"]), "<u4").reshape(-1, 3)
    red, green, blue = field["color"]
    return FieldSurface(triangles, (red, green, blue), field["opacity"])
