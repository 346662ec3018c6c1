"""The page of `twin view x.step`: a click on a face shows its geometry and the TOML that names it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape

import numpy as np
import viser

from twin.core import units
from twin.core.spatial import Array
from twin.core.units import UM
from twin.ui.session.display_meshes import creased
from twin.ui.session.drawn_faces import DrawnFace, StepDrawing
from twin.ui.session.face_picker import FacePicker, PickedFace
from twin.ui.viewer.loop import ViewerPage
from twin.ui.viewer.robot_nodes import BLUE, ORANGE
from twin.ui.viewer.surroundings import extent, furnish

_HIGHLIGHT_OFFSET = 4e-4
"""Distance by which a highlight is drawn in front of its face, as a fraction of the scene's size."""

_INTRO = (
    "**Click a face.** Its geometry and the TOML that names it appear here. Faces stay in the list until you remove "
    "them, and one button copies the TOML of all."
)

_TOML_STYLE = (
    "white-space:pre-wrap;overflow-wrap:anywhere;font:12px/1.5 ui-monospace,monospace;margin:0;"
    "padding:.6em .8em;border-radius:6px;background:light-dark(#eef2f7,#10161d);color:light-dark(#17212e,#e6ebf1)"
)
_BUTTON_STYLE = (
    "font:600 14px system-ui,sans-serif;min-height:40px;width:100%;margin:.5em 0 0;border:0;border-radius:6px;"
    "background:#1b6ec2;color:#fff;cursor:pointer"
)


class FacePage(ViewerPage):
    """The page of a STEP file; all browsers show the same picked faces.

    Attributes:
        picker: the picked faces.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        title: str,
        drawing: StepDrawing,
        stopping: threading.Event | None = None,
    ) -> None:
        super().__init__(server, title, stopping)
        self.picker = FacePicker(drawing)
        low, middle, self._size = extent([drawing.box])
        self._grid = furnish(server, middle, self._size, float(low[2]))
        server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        self._highlights: list[viser.SceneNodeHandle] = []
        self._bodies: list[str] = []  # of each drawn part, in the order of `placed_parts`
        self._meshes: list[viser.MeshHandle] = []
        self._hidden: set[str] = set()
        with server.atomic():
            self._draw_parts(drawing)
        self._build_panel(drawing)
        self._show()

    def frame(self, passed: float, has_requests: bool) -> None:
        """Do nothing: the page changes by requests only."""

    # -- the scene ------------------------------------------------------------------------------------

    def _draw_parts(self, drawing: StepDrawing) -> None:
        scene = self.server.scene
        scene.add_frame("/step", show_axes=False)
        for number, (body, part) in enumerate(drawing.placed_parts()):
            vertices, triangles = creased(part.vertices, part.triangles)
            red, green, blue = (round(255 * units.srgb(value)) for value in part.color_rgba[:3])
            opacity = part.color_rgba[3]
            # the names of the nodes are those of links of a robot, so that the page names a body under the mouse
            handle = scene.add_mesh_simple(
                f"/step/{body}/mesh{number}",
                vertices.astype(np.float32),
                triangles,
                color=(red, green, blue),
                opacity=opacity if opacity < 1 else None,
                side="double",
            )
            handle.on_click(self._clicked)
            self._bodies.append(body)
            self._meshes.append(handle)

    async def _clicked(self, event: viser.SceneNodePointerEvent) -> None:
        origin = np.array(event.ray_origin, float)
        direction = np.array(event.ray_direction, float)
        self.ask("pick", lambda: self._pick(origin, direction))

    def _pick(self, origin: Array, direction: Array) -> None:
        visible_parts = [k for k, body in enumerate(self._bodies) if body not in self._hidden]
        if self.picker.pick(origin, direction, visible_parts) is not None:
            self._show()

    def _hide_body(self) -> None:
        """Hide the body of the current face, so that faces behind and inside it can be picked."""
        if self.picker.current is not None:
            self._hidden.add(self.picker.current.drawn.body)
            self._show()

    def _show_all_bodies(self) -> None:
        self._hidden.clear()
        self._show()

    def _draw_marks(self) -> None:
        """Colour the picked faces, and draw the axis of the current one."""
        with self.server.atomic():
            for mark in self._highlights:
                mark.remove()
            self._highlights = []
            for body, mesh in zip(self._bodies, self._meshes, strict=True):
                mesh.visible = body not in self._hidden
            for k, face in enumerate(self.picker.picked):
                if face.drawn.body in self._hidden:
                    continue
                color = ORANGE if face is self.picker.current else BLUE
                self._highlights.append(self._highlight(f"/picked/face{k}", face.drawn, color))
            if self.picker.current is not None:
                axis = _axis_line(self.picker.current)
                if axis is not None:
                    line = self.server.scene.add_line_segments(
                        "/picked/axis", axis[None].astype(np.float32), ORANGE, thickness=3.0, thickness_units="screen"
                    )
                    self._highlights.append(line)

    def _highlight(self, path: str, face: DrawnFace, color: tuple[int, int, int]) -> viser.MeshHandle:
        corners = face.part.vertices[face.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        lifted = corners + _HIGHLIGHT_OFFSET * self._size * normals[:, None]
        return self.server.scene.add_mesh_simple(
            path,
            lifted.reshape(-1, 3).astype(np.float32),
            np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3),
            color=color,
            side="double",
            cast_shadow=False,
        )

    # -- the panel ------------------------------------------------------------------------------------

    def _build_panel(self, drawing: StepDrawing) -> None:
        gui = self.server.gui
        gui.add_markdown(_INTRO)
        notes = _notes_text(drawing)
        if notes:
            gui.add_html(f"<div style='font-size:13px;line-height:1.4;padding:0 .8em'>{escape(notes)}</div>")
        self._facts_html = gui.add_html("")
        self._name = gui.add_text("name", "", hint="name of this face in the TOML")
        self._name.on_update(lambda event: self._rename(event.target.value))
        self._drop_button = gui.add_button("Remove this face")
        self._drop_button.on_click(lambda _: self.ask("drop", lambda: self._change(self.picker.drop)))
        self._clear_button = gui.add_button("Remove all faces")
        self._clear_button.on_click(lambda _: self.ask("clear", lambda: self._change(self.picker.clear)))
        self._hide_button = gui.add_button("Hide its body", hint="to pick faces behind it and inside it")
        self._hide_button.on_click(lambda _: self.ask("hide", self._hide_body))
        self._unhide_button = gui.add_button("Show all bodies")
        self._unhide_button.on_click(lambda _: self.ask("unhide", self._show_all_bodies))
        self._toml_html = gui.add_html("")

    def _rename(self, name: str) -> None:
        current = self.picker.current
        if current is None or name == current.name:
            return  # the page itself wrote the name into the field

        if not name:
            return  # the user clears the field before typing

        def rename() -> None:
            self.picker.rename(name)  # a name that is refused stays in the field, to be corrected
            self._show_panel()

        self.ask("rename", rename)

    def _change(self, change: Callable[[], None]) -> None:
        change()
        self._show()

    def _show(self) -> None:
        self._draw_marks()
        self._show_panel()

    def _show_panel(self) -> None:
        current = self.picker.current
        self._facts_html.content = "" if current is None else _facts_html(current)
        self._name.visible = current is not None and current.feature is not None
        if current is not None and self._name.value != current.name:
            self._name.value = current.name
        self._drop_button.visible = current is not None
        self._clear_button.visible = len(self.picker.picked) > 1
        self._hide_button.visible = current is not None and current.drawn.body not in self._hidden
        self._unhide_button.visible = bool(self._hidden)
        self._toml_html.content = _toml_html(self.picker)


def _axis_line(face: PickedFace) -> Array | None:
    """Return the ends (2, 3) in m of the line that shows the axis of a face; None: it has no axis.

    The line is longer than the face by its half at both ends.
    """
    axis = face.axis()
    if axis is None:
        return None
    point, direction = axis
    along = (face.drawn.part.vertices[face.drawn.triangles] - point) @ direction
    low = float(along.min())
    high = float(along.max())
    radius = 0.0
    if face.drawn.geometry is not None:
        radius = face.drawn.geometry.radius
    margin = max(0.5 * (high - low), 2 * radius)
    return np.array([point + (low - margin) * direction, point + (high + margin) * direction])


def _notes_text(drawing: StepDrawing) -> str:
    """Return what a user must know of a STEP file, as text."""
    if drawing.note:
        text = drawing.note + "."
    elif drawing.source is not None:
        text = f"The names of the bodies are those of {drawing.source.name}."
    else:
        text = "The names of the bodies are those of the nodes in the STEP, as `twin new` writes them."
    if drawing.placement_error > 0:
        error = drawing.placement_error / UM
        text += f" The STEP places its parts in single precision, so that faces are exact to {error:.2g} µm."
    return text


def _facts_html(face: PickedFace) -> str:
    """Return the geometry of a face as HTML."""
    rows = []
    for what, value in face.facts():
        rows.append(
            f"<tr><th scope='row' style='text-align:left;font-weight:400;opacity:.78;padding:.1em 1em .1em 0;"
            f"vertical-align:top'>{escape(what)}</th><td style='overflow-wrap:anywhere'>{escape(value)}</td></tr>"
        )
    text = ""
    if face.feature is None:
        text = f"<p style='margin:.5em 0;color:light-dark(#8f5200,#f0b34a)'>No TOML: {escape(face.reason)}.</p>"
    elif face.feature.kind == "cylinder":
        text = (
            f"<p style='margin:.5em 0'>Axis of a joint: <code>z = \"{escape(face.name)}\"</code> in its frame. "
            "The other sign of <code>direction</code> turns the axis round.</p>"
        )
    return (
        "<div style='font-size:13px;line-height:1.4;padding:.6em .8em 0' data-picked>"
        f"<table style='border-spacing:0'>{''.join(rows)}</table>{text}</div>"
    )


def _toml_html(picker: FacePicker) -> str:
    """Return the TOML of all picked faces as HTML, with a button that copies it; "" without a face."""
    text = picker.toml()
    if not text:
        return ""
    count = sum(face.feature is not None for face in picker.picked)
    faces = "1 face" if count == 1 else f"{count} faces"
    return (
        "<div style='padding:0 .8em' class='twin-last'>"
        f"<pre style='{_TOML_STYLE}' data-copied role='region' tabindex='0' aria-label='TOML'>{escape(text)}</pre>"
        f"<button type='button' style='{_BUTTON_STYLE}' data-copies='TOML of {faces}'>"
        f"Copy the TOML of {faces}</button></div>"
    )
