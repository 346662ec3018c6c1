"""Scene nodes of what is drawn beside the measured bodies of a robot, and of the person for scale."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser

from twin.core import units
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body
from twin.ui.session.display_meshes import display_meshes
from twin.ui.session.drawn_parts import DrawnCable, DrawnParts, hanging, person


class DrawnNodes:
    """Scene nodes of the drawn parts of one robot, below the nodes of its bodies; they follow these bodies.

    Attributes:
        note: text that says what is drawn, and that it is not measured.
    """

    def __init__(self, server: viser.ViserServer, path: str, parts: DrawnParts, poses: Mapping[str, Array]) -> None:
        self.note = parts.note
        self._cables: list[tuple[DrawnCable, viser.LineSegmentsHandle]] = []
        self._meshes: list[viser.MeshHandle] = []
        for link, _, body in parts.bodies():
            self._meshes += _add(server, f"{path}/{link}", body)
        for cable in parts.cables:
            r, g, b = (round(255 * units.srgb(value)) for value in cable.color)
            handle = server.scene.add_line_segments(
                f"{path}/cable_{cable.name}", _line(cable, poses), (r, g, b), thickness=cable.diameter_mm * MM
            )
            self._cables.append((cable, handle))

    def follow(self, poses: Mapping[str, Array]) -> None:
        """Let the cables follow link poses T_base_body (4, 4)."""
        for cable, handle in self._cables:
            if handle.visible:
                handle.points = _line(cable, poses)

    def show(self, visible: bool) -> None:
        """Show or hide all of it."""
        for handle in (*self._meshes, *(line for _, line in self._cables)):
            handle.visible = visible


def add_person(server: viser.ViserServer, foot: Array) -> viser.FrameHandle:
    """Add an adult who stands at `foot` (3,), in m in the world frame, and looks along x; return the node."""
    node = server.scene.add_frame("/person", show_axes=False, position=foot)
    for _, _, body in person().bodies():
        _add(server, "/person", body)
    return node


def _add(server: viser.ViserServer, path: str, body: Body) -> list[viser.MeshHandle]:
    handles = []
    for k, (vertices, triangles, color, opacity) in enumerate(display_meshes(body)):
        handle = server.scene.add_mesh_simple(
            f"{path}/{body.name}_{k}",
            vertices.astype(np.float32),
            triangles,
            color=color,
            opacity=opacity if opacity < 1 else None,
            side="double",
        )
        handles.append(handle)
    return handles


def _line(cable: DrawnCable, poses: Mapping[str, Array]) -> np.ndarray:
    """Return the segments (k, 2, 3) of a cable in the base frame."""
    ends = []
    for end in cable.ends:
        T = poses[end.link]
        ends.append(T[:3, :3] @ (np.array(end.at_mm) * MM) + T[:3, 3])
    points = hanging(ends[0], ends[1], cable.length_mm * MM)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
