"""The page of `twin view x.step` in headless Chromium: a click on a face of a STEP gives the TOML that names it."""

from __future__ import annotations

import threading
import tomllib
from pathlib import Path

import numpy as np
import pytest

from made.headset_page import until
from twin.cad.description import Feature
from twin.cad.features import find
from twin.ui.session.drawn_faces import StepDrawing
from ui.test_viewer_page import Looker, without_shadows

pytestmark = pytest.mark.browser

STEP = Path(__file__).parents[2] / "cad/hibou/hibou.step"


@pytest.fixture
def page(browser):
    """A looker at the running page of STEP, and its drawing."""
    from twin.ui.viewer.face_page import FacePage
    from twin.ui.viewer.server import serve

    drawing = StepDrawing(STEP)
    front = without_shadows(FacePage(serve("hibou", "127.0.0.1", 0, content="faces"), "hibou", drawing))
    thread = threading.Thread(target=front.run)
    thread.start()
    try:
        yield Looker(browser, front, width=700, height=500, tab=None), drawing
    finally:
        front.stop()
        thread.join(30)
        assert not thread.is_alive()


def visible_cylinder(look, drawing):
    """Return (body, face, point) of a cylinder of which the camera sees a point well."""
    eye = np.asarray(look.clients[0].camera.position)
    best = None
    for body, part in drawing.placed_parts():
        for index, face in enumerate(part.drawn):
            if face is None or face.kind != "cylinder":
                continue
            corners = part.vertices[part.triangles[part.face_of_triangle == index]]
            centres = corners.mean(axis=1)
            areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
            for k in np.argsort(-areas)[:3]:
                met = drawing.meet(eye, centres[k] - eye)
                if met.part is part and met.index == index and (best is None or areas[k] > best[0]):
                    best = areas[k], body, face, centres[k]
    return best[1:]


def test_a_click_on_a_face_gives_the_toml_that_names_it_and_the_button_copies_it(page):
    look, drawing = page
    body, face, point = visible_cylinder(look, drawing)
    look.page.evaluate(
        "Object.defineProperty(navigator, 'clipboard', {value: {writeText: async (text) => { window.taken = text; }}})"
    )
    x, y = look.at(point)
    look.page.mouse.move(x, y)
    look.page.wait_for_timeout(500)  # the page finds out what is below the mouse
    look.page.mouse.click(x, y)
    shown = look.page.locator("[data-copied]")
    shown.wait_for()
    table = tomllib.loads(shown.text_content())["feature"]
    assert list(table) == [body]
    ((name, values),) = table[body].items()
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    found = find(body, name, Feature(**values), drawing.parts[body], drawing.tolerance).face
    assert np.abs(found.point - face.point).max() < 1e-9
    assert np.abs(np.cross(found.direction, face.direction)).max() < 1e-9
    assert f"{face.radius * 1e3:.6g} mm" in look.page.locator("[data-picked]").inner_text()

    field = look.field("name")
    field.fill("hinge")
    field.press("Enter")
    until(lambda: "hinge = {" in shown.text_content(), "the new name")
    look.page.locator("[data-copies]").click()
    until(lambda: look.page.evaluate("window.taken") == shown.text_content(), "the copied text")
    assert look.errors == []
