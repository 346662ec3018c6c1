"""The camera task on the page, in Chromium: the endoscope's picture shows the angle that the projection gives."""

from __future__ import annotations

import io
import time

import numpy as np
import pytest
from PIL import Image

from made import headset_page as headset
from made.console_page import console
from twin.api.console_runs import replay_session
from twin.api.scene_parts import members_of
from twin.core.units import DEG
from twin.simulation import console_scene
from twin.simulation.session import session_run
from twin.simulation.setup import Setup
from twin.simulation.tasks.align import projected_side, upper_side

pytestmark = pytest.mark.browser

ONLY_THE_PICTURE = """
document.querySelectorAll('*').forEach(e => {
  e.style.visibility = e.tagName === 'CANVAS' && !e.closest('.inset') ? 'visible' : 'hidden';
})
"""


def start(loaded):
    """Return the frame of the picture at the start, by the equations."""
    setup = Setup(loaded.scene, members_of(loaded.robots), loaded.scene.tasks["camera"])
    world = console_scene.world(setup, session_run.surgeon(setup), records=False)
    return world.signals["ecm.view"].reshape(4, 4)


def linear(png):
    """Return the linear colours of a screenshot."""
    v = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def test_the_picture_of_the_page_shows_the_angle_and_its_session_is_measured(browser, theatre, tmp_path):
    task, file = theatre.scene.tasks["camera"], tmp_path / "page.session"
    projected = projected_side.angle(projected_side.seen_ends(task.goal, start(theatre), 70 * DEG))
    server = headset.Serving("davinci", None, "--task", "camera", "--session", file)
    try:
        with console(browser, server.url, size=(1000, 760)) as page:
            lines = "twin.app.console.views.scope.children.filter(c => c.name === 'line')"
            assert page(f"{lines}.length") == 1
            page(ONLY_THE_PICTURE)
            page(f"{lines}.forEach(c => c.visible = false)")  # it would cut the mask
            page("twin.app.refresh()")
            sharp = "twin.app.world.renderer.getPixelRatio() === 1 && !twin.app.world.dirty"
            page.until(sharp, "a picture at rest")
            time.sleep(0.5)
            seen = upper_side.angle(linear(page.page.screenshot()))
    finally:
        server.stop()
    assert seen == pytest.approx(projected, abs=0.05 * DEG)
    assert abs(projected) > 10 * DEG
    found = replay_session(file)
    assert found.task.name == "camera"
    assert found.run.difference is None
    assert found.outcome.aligned.angle == pytest.approx(projected, abs=1e-6)
    assert abs(found.outcome.aligned.seen - projected) < 0.05 * DEG
    assert "task.missed" in [f.code for f in found.findings]
