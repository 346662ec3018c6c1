"""Export the view as screenshot, turntable, or recording that plays without Python."""

from __future__ import annotations

import io

import numpy as np
import viser

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.progress import StepProgress, silent_step
from twin.ui.viewer.front import Front

TURNTABLE_PICTURES = 36
"""Number of pictures in a turntable (one revolution of the camera)."""

_ALONG_UP = 1e-6
"""Sine of the angle between view and upward direction below which a camera looks straight up or down."""

_NEARLY_WHITE = 250
"""Grey (of 255) behind transparent parts of a picture."""

RECORDING_RATE = 30.0
"""Frames per second of a recording."""


def screenshot(client: viser.ClientHandle | None, title: str, progress: StepProgress) -> bytes:
    """Make a browser download its present view as a PNG file; return the content of the file."""
    client = _required_client(client)
    png = _png(_render(client, 1080, 1920))
    progress(1.0)
    client.send_file_download(f"{title}.png", png)
    return png


def turntable(client: viser.ClientHandle | None, title: str, progress: StepProgress) -> bytes:
    """Make a browser download a GIF of one camera revolution about the viewed point; return the content of the file."""
    from PIL import Image

    client = _required_client(client)
    camera = client.camera
    centre = camera.look_at.copy()
    up = camera.up_direction / np.linalg.norm(camera.up_direction)
    arm = camera.position - centre
    images = []
    for k in range(TURNTABLE_PICTURES):
        angle = 2 * np.pi * k / TURNTABLE_PICTURES
        eye = centre + _rotated(arm, up, angle)
        # axes of the camera: x to the right, y down, z along the view
        z = (centre - eye) / np.linalg.norm(centre - eye)
        sideways = np.cross(z, up)
        sine = np.linalg.norm(sideways)
        if sine > _ALONG_UP:
            x = sideways / sine
        else:  # the camera stays in its place and turns about its view, from its present orientation
            x = _rotated(spatial.matrix_from_quat_wxyz(camera.wxyz)[:, 0], up, angle)
        R = np.column_stack([x, np.cross(z, x), z])
        wxyz = spatial.quat_from_matrix_wxyz(R)
        image = _render(client, 480, 640, wxyz=wxyz, position=eye, fov=camera.fov)
        images.append(_over_grey(image))
        progress((k + 1) / TURNTABLE_PICTURES)
    buffer = io.BytesIO()
    frames = [Image.fromarray(image).convert("P", palette=Image.Palette.ADAPTIVE) for image in images]
    frames[0].save(buffer, "GIF", save_all=True, append_images=frames[1:], duration=80, loop=0)
    client.send_file_download(f"{title}.gif", buffer.getvalue())
    return buffer.getvalue()


def page(front: Front, progress: StepProgress = silent_step) -> str:
    """Return an HTML page that plays the planned protocols without a server; clock and gizmo are restored afterwards.

    Raises:
        TwinError: no protocol is planned.
    """
    clock = front.clock
    if clock.duration <= 0:
        raise TwinError("no protocol is loaded: choose a protocol in the tab Play first")
    # what is restored at the end
    time = clock.time
    was_playing = clock.playing
    was_visible = front.gizmo.visible
    clock.playing = False
    front.gizmo.visible = False
    try:
        serializer = front.server.get_scene_serializer()
        for t in np.arange(0.0, clock.duration, 1 / RECORDING_RATE):
            clock.seek(float(t))
            front.move_to_clock()
            front.deform_organs(1 / RECORDING_RATE)
            front.draw()
            front.refresh()
            serializer.insert_sleep(1 / RECORDING_RATE)
            progress(t / clock.duration)
        return serializer.as_html()
    finally:
        front.gizmo.visible = was_visible
        clock.playing = was_playing
        clock.seek(time)
        front.move_to_clock()


def _required_client(client: viser.ClientHandle | None) -> viser.ClientHandle:
    if client is None:
        raise TwinError("no browser shows the page: open the page to make a picture")
    return client


def _render(client: viser.ClientHandle, height: int, width: int, **camera) -> np.ndarray:
    try:
        return client.get_render(height, width, transport_format="png", timeout=120, **camera)
    except TimeoutError as error:
        raise TwinError("the browser did not answer within 120 s; bring its tab to the foreground") from error


def _rotated(v: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Return v (3,), turned by an angle in rad about a unit vector (3,): Rodrigues' rotation."""
    along = axis * (axis @ v) * (1 - np.cos(angle))
    return v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + along


def _over_grey(image: np.ndarray) -> np.ndarray:
    """Return a picture (h, w, 3) in front of a grey that is nearly white, where `image` (h, w, 4) is transparent."""
    a = image[..., 3:] / 255.0
    return (image[..., :3] * a + _NEARLY_WHITE * (1 - a)).astype(np.uint8)


def _png(image: np.ndarray) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(_over_grey(image)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()
