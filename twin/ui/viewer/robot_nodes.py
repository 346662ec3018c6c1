"""Scene nodes of one robot: links, names, frames, joint axes, points of the equations, ghost."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import viser

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.ui.session.display_meshes import DisplayMesh, behind, display_meshes
from twin.ui.viewer.pose_frames import FrameWriter

GREEN = (38, 150, 90)
RED = (225, 0, 0)
ORANGE = (255, 120, 20)
BLUE = (40, 110, 220)
_GHOST_OPACITY = 0.28


class RobotNodes:
    """Scene nodes of a robot; the root node has the robot's pose and scale, all other nodes are in m in the base frame.

    Attributes:
        root: node of the base frame in the world.
        bodies: node of each body, by name.
        meshes: (name of the body, handle) of each mesh; meshes can be grabbed.
        size: diagonal in m of the meshes' bounding box at the initial poses.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        path: str,
        mechanism: Mechanism,
        poses: Mapping[str, Array],
        ghost: tuple[int, int, int] | None = None,
    ) -> None:
        self._server = server
        self._path = path
        self._mechanism = mechanism
        scene = server.scene
        self.root = scene.add_frame(path, show_axes=False)
        self.bodies: dict[str, viser.FrameHandle] = {}
        self.meshes: list[tuple[str, viser.MeshHandle]] = []
        self._looks: list[tuple[str, DisplayMesh]] = []
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        with server.atomic():
            for body in mechanism.bodies:
                place = f"{path}/{body.name}"
                T = poses[body.name]
                wxyz = spatial.quat_from_matrix_wxyz(T[:3, :3])
                self.bodies[body.name] = scene.add_frame(
                    place, show_axes=False, axes_length=0.05, axes_radius=0.0015, wxyz=wxyz, position=T[:3, 3]
                )
                for k, look in enumerate(display_meshes(body)):
                    vertices, triangles, color, opacity = look
                    shown_opacity = opacity if ghost is None else _GHOST_OPACITY
                    handle = scene.add_mesh_simple(
                        f"{place}/mesh{k}",
                        vertices.astype(np.float32),
                        triangles,
                        color=ghost or color,
                        opacity=shown_opacity if shown_opacity < 1 else None,
                        cast_shadow=ghost is None,
                        side="double" if shown_opacity < 1 else "front",
                    )
                    self.meshes.append((body.name, handle))
                    self._looks.append((body.name, look))
                    points = vertices @ T[:3, :3].T + T[:3, 3]
                    low = np.minimum(low, points.min(axis=0))
                    high = np.maximum(high, points.max(axis=0))
        # a robot without meshes has a box, too, so that there is a view of it
        if not np.isfinite(low).all():
            low = np.full(3, -0.2)
            high = np.full(3, 0.2)
        self.box = np.array([low, high])
        self.size = float(np.linalg.norm(self.box[1] - self.box[0]))
        self._writer = FrameWriter(server, list(self.bodies.values()))
        self._extras: dict[str, list[viser.SceneNodeHandle]] = {}
        self._equations: viser.LineSegmentsHandle | None = None

    def write(self, poses: Mapping[str, Array]) -> None:
        """Show link poses T_base_body (4, 4), by body; all poses are sent as one frame."""
        Ts = np.array([poses[name] for name in self.bodies])
        self._writer.write(Ts[:, :3, 3], spatial.quat_from_matrix_wxyz(Ts[:, :3, :3]))

    def place(self, T_world_base: Array, scale: float) -> None:
        """Set pose and display scale of the whole robot; child nodes remain in m."""
        self.root.position = T_world_base[:3, 3]
        self.root.scale = scale
        self.root.wxyz = spatial.quat_from_matrix_wxyz(T_world_base[:3, :3])

    def to_base(self, p_world: Array) -> Array:
        """Convert a point (3,) from the displayed world, which has the display scale, to the base frame in m."""
        R = spatial.matrix_from_quat_wxyz(np.asarray(self.root.wxyz))
        scale = float(np.atleast_1d(self.root.scale)[0])
        return R.T @ (np.asarray(p_world, float) - np.asarray(self.root.position, float)) / scale

    def to_world(self, p_base: Array) -> Array:
        """Convert a point (3,) from the base frame in m to the displayed world, which has the display scale."""
        R = spatial.matrix_from_quat_wxyz(np.asarray(self.root.wxyz))
        scale = float(np.atleast_1d(self.root.scale)[0])
        return np.asarray(self.root.position) + scale * R @ p_base

    def show(self, visible: bool) -> None:
        """Show or hide the whole robot."""
        self.root.visible = visible

    # -- optional displays ----------------------------------------------------------------------------

    def frames(self, visible: bool) -> None:
        """Show or hide the axes of every link frame."""
        for handle in self.bodies.values():
            handle.show_axes = visible

    def labels(self, visible: bool) -> None:
        """Show or hide the names of the links."""

        def make() -> list[viser.SceneNodeHandle]:
            handles: dict[str, viser.SceneNodeHandle] = {}
            for body, (vertices, *_) in self._looks:
                # the label of a body is in the middle of its first mesh
                if body not in handles:
                    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
                    path = f"{self._path}/{body}/label"
                    handles[body] = self._server.scene.add_label(path, body, position=middle)
            return list(handles.values())

        self._toggle("labels", visible, make)

    def axes(self, visible: bool) -> None:
        """Show or hide the axes of joints with one degree of freedom: active joints blue, passive joints orange."""

        def make() -> list[viser.SceneNodeHandle]:
            handles: list[viser.SceneNodeHandle] = []
            half = np.array([0.0, 0.0, 0.06 * self.size])
            for joint in self._mechanism.joints:
                if len(joint.free_axes) != 1:
                    continue
                T = joint.T_parent_joint
                ends = np.array([T[:3, 3] - T[:3, :3] @ half, T[:3, 3] + T[:3, :3] @ half])
                color = BLUE if joint.active else ORANGE
                name = f"{self._path}/{joint.parent}/axis_{joint.name}"
                handles.append(
                    self._server.scene.add_line_segments(
                        name, ends[None].astype(np.float32), color, thickness=2.0, thickness_units="screen"
                    )
                )
            return handles

        self._toggle("axes", visible, make)

    def equations(
        self, points: Mapping[str, Array], actual: Mapping[str, Array], agrees: bool, exaggerated: float
    ) -> None:
        """Draw lines between points of the same body; the robot's equations compute the positions of the points.

        If no body has two points, nothing is drawn.

        Args:
            points: positions (3,) by point name, computed by the equations, in m in the base frame.
            actual: the same positions, computed by the mechanism.
            agrees: whether equations and mechanism agree; the lines are then green, otherwise red.
            exaggerated: factor by which the differences between `points` and `actual` are drawn larger.
        """
        owner = {point.name: point.body for point in self._mechanism.points}
        shown_points: dict[str, Array] = {}
        for name, position in points.items():
            if name in owner and name in actual and np.isfinite(position).all():
                shown_points[name] = actual[name] + exaggerated * (position - actual[name])
        ends = []
        for a, b in combinations(shown_points, 2):
            if owner[a] == owner[b]:
                ends.append([shown_points[a], shown_points[b]])
        if not ends:
            if self._equations is not None:
                self._equations.visible = False
            return
        segments = np.array(ends, np.float32)
        color = np.array(GREEN if agrees else RED, np.uint8)
        if self._equations is None or len(self._equations.points) != len(segments):
            self._equations = self._server.scene.add_line_segments(
                f"{self._path}/equations", segments, tuple(color.tolist()), thickness=0.005 * self.size
            )
        else:
            self._equations.points = segments
            self._equations.colors = np.broadcast_to(color, (*segments.shape[:2], 3)).copy()
        self._equations.visible = True

    def section(self, poses: Mapping[str, Array], point: Array | None, normal: Array) -> None:
        """Hide the part of the robot in front of a plane, on the side of the normal.

        The plane contains `point` (3,) in m and has the normal `normal` (3,), both in the base frame; if `point` is
        None, the whole robot is shown. `poses` are the link poses T_base_body (4, 4).
        """
        for (body, (vertices, triangles, *_)), (_, handle) in zip(self._looks, self.meshes, strict=True):
            shown_vertices = vertices
            faces = triangles
            if point is not None:
                T = poses[body]
                R = T[:3, :3]
                shown_vertices, faces = behind(vertices, triangles, R.T @ (point - T[:3, 3]), R.T @ normal)
            with self._server.atomic():
                handle.visible = bool(len(faces))
                if len(faces):
                    handle.vertices = shown_vertices.astype(np.float32)
                    handle.faces = faces
                    handle.side = "double" if point is not None else "front"

    def remove(self) -> None:
        """Remove the robot from the scene."""
        self.root.remove()

    def _toggle(self, kind: str, visible: bool, make) -> None:
        if visible and kind not in self._extras:
            with self._server.atomic():
                self._extras[kind] = make()
        for handle in self._extras.get(kind, ()):
            handle.visible = visible
