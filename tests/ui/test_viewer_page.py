"""The page itself in headless Chromium: each module is driven by mouse and keys; numbers and pixels are looked at."""

from __future__ import annotations

import io
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import twin
from made.headset_page import BLIND, WAIT, until
from made.lanes import nightly
from twin.core import spatial
from twin.core.units import MM
from twin.ui.session.display_meshes import display_meshes
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.readings import read
from twin.ui.session.trocars import rcm_at
from twin.ui.viewer import view_export

pytestmark = pytest.mark.browser

CALM = """
const every = window.setInterval.bind(window), paint = window.requestAnimationFrame.bind(window);
window.setInterval = (act, ms, ...more) => every(act, ms === 1000 ? 10000 : ms, ...more);
window.requestAnimationFrame = (act) => window.setTimeout(() => paint(act), 100);
window.cancelAnimationFrame = window.clearTimeout.bind(window);
const { getContext } = HTMLCanvasElement.prototype;
HTMLCanvasElement.prototype.getContext = function (kind, how) {
  return getContext.call(this, kind, { ...how, antialias: false });
};
"""
"""For every page, which a processor draws: few pictures, with one sample for each pixel.

viser draws once a second though nothing has changed, which costs this machine most of the second.
"""

COARSE = "?fixedDpr=0.5"
"""Address of a page whose canvas has a quarter of the pixels: a processor draws them."""


def without_shadows(front):
    """Replace the light that casts shadows: three of four triangles are drawn for them only."""
    front.server.scene.add_light_directional("/light/key", intensity=1.7, position=(1.2, -0.9, 2.2))
    return front


@contextmanager
def shown(name, protocol=None):
    """Yield a running front with one robot."""
    from twin.ui.viewer.front import ShownRobot
    from twin.ui.viewer.page import open_page
    from twin.ui.viewer.server import serve

    actor = ShownRobot(name, name, MovableRobot(twin.load(name)), protocol=protocol)
    front = without_shadows(open_page(f"twin · {name}", [actor], None, serve(name, "127.0.0.1", 0)))
    thread = threading.Thread(target=front.run)
    thread.start()
    try:
        yield front
    finally:
        front.stop()
        thread.join(120)
        assert not thread.is_alive()


class Looker:
    """A page, its canvas, and what it looks like."""

    def __init__(self, browser, front, width=1100, height=720, tab="Instruments"):
        self.front, self.errors = front, []
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.set_default_timeout(1000 * WAIT)
        self.page.on("pageerror", lambda e: self.errors.append(str(e)))
        self.page.add_init_script(CALM)
        self.page.goto(f"http://127.0.0.1:{front.server.get_port()}/{COARSE}")
        if tab is not None:
            self.page.get_by_role("tab", name=tab).wait_for(timeout=1000 * WAIT)
        until(lambda: any(c.camera._state.update_timestamp for c in self.clients), "the camera's first message")
        until(lambda: self.ink() > 0.02, "the robot's first picture")

    @property
    def clients(self):
        return list(self.front.server.get_clients().values())

    def shot(self):
        box = self.page.locator("canvas").first.bounding_box()
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot(clip=box))).convert("RGB")).astype(int)

    def ink(self):
        """Return the part of the canvas that is neither background nor grid."""
        image = self.shot()
        return float(np.mean((image.max(axis=2) < 170) | (np.ptp(image, axis=2) > 40)))

    def differs(self, before):
        """Return the part of the canvas that does not look as it did."""
        return float(np.mean(np.abs(self.shot() - before).max(axis=2) > 25))

    def tab(self, name):
        self.page.get_by_role("tab", name=name).click(force=True)

    def field(self, label):
        """Return the number field in the row of a label."""
        return self.page.locator(
            f"xpath=//label[contains(., '{label}')]/following::input[not(@type='hidden')][1]"
        ).first

    def at(self, p_world):
        """Return the pixel of the page at which a point (3,) of the world is seen."""
        camera, box = self.clients[0].camera, self.page.locator("canvas").first.bounding_box()
        R = spatial.matrix_from_quat_wxyz(np.asarray(camera.wxyz))
        x, y, z = R.T @ (np.asarray(p_world) - camera.position)
        focal = 0.5 * box["height"] / np.tan(camera.fov / 2)
        return box["x"] + box["width"] / 2 + focal * x / z, box["y"] + box["height"] / 2 + focal * y / z

    def drag(self, start, end, steps=8, key=None):
        mouse, keys = self.page.mouse, self.page.keyboard
        mouse.move(*start)
        time.sleep(0.3)  # the page finds out what is below the mouse
        if key:
            keys.down(key)
        mouse.down()
        for s in np.linspace(0, 1, steps + 1)[1:]:
            mouse.move(start[0] + s * (end[0] - start[0]), start[1] + s * (end[1] - start[1]))
            time.sleep(0.12)
        time.sleep(0.4)
        mouse.up()
        if key:
            keys.up(key)

    def readout(self):
        return self.page.locator("[data-agrees]").inner_text()


@pytest.fixture(scope="module")
def sils(browser):
    with shown("sils") as front:
        look = Looker(browser, front)
        front.ask("load", lambda: front.load(front.active, "table2"))
        until(lambda: front.active.playback is not None, "the plan", 120)
        yield look
        assert look.errors == []


@pytest.fixture
def aside(sils):
    """Make the page small while others are open: viser's page draws without end, here on the processor."""
    size = sils.page.viewport_size
    sils.page.set_viewport_size({"width": 200, "height": 150})
    yield
    sils.page.set_viewport_size(size)
    time.sleep(0.5)


def still(look):
    """Go home, hold the clock, and wait until the page shows it."""
    front = look.front
    front.clock.playing = False
    front.ask("home", lambda: front.active.movable.go_to_posture("home"))
    until(lambda: not front._requests, "the wish")
    time.sleep(1.0)
    return front.active.movable


# -- simulation ---------------------------------------------------------------------------------------


def test_play_moves_the_robot_through_named_phases(sils):
    front = sils.front
    sils.tab("Play")
    before, start = sils.shot(), front.active.movable.assembly.q.copy()
    sils.page.get_by_role("button", name="Play").click()
    until(lambda: front.clock.time > 1.5, "two seconds of play")
    sils.page.get_by_role("button", name="Pause").click()
    until(lambda: not front.clock.playing, "the pause")
    assert np.abs(front.active.movable.assembly.q - start).max() > 1 * MM
    until(lambda: sils.differs(before) > 0.002, "another picture")
    phase = front.active.playback.phase(front.clock.time)
    until(lambda: phase in sils.page.locator("text=/phase/").first.inner_text(), "the name of the phase")


def test_the_timeline_is_scrubbed_and_the_curve_has_a_cursor(sils):
    front = sils.front
    sils.tab("Play")
    field = sils.field("t [s]")
    field.fill("5")
    field.press("Enter")
    until(lambda: abs(front.clock.time - 5.0) < 1e-6, "the clock at 5 s")
    k = round(5.0 * 60)
    until(
        lambda: np.allclose(front.active.movable.assembly.q, front.active.playback.q[k], atol=1e-9), "the robot at 5 s"
    )
    assert read(front.active.movable, rcm_at(front.active.playback, front.clock.time)).rcm_error < 1e-9
    sils.tab("Curves")
    curve = sils.page.locator(".uplot canvas").first
    until(lambda: (curve.bounding_box() or {"width": 0})["width"] > 0, "the curve")
    time.sleep(1.5)

    def coloured():
        shot = sils.page.screenshot(clip=curve.bounding_box())
        image = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
        return np.mean(np.ptp(image, axis=2) > 60)

    until(lambda: coloured() > 0.003, "coloured curves")
    sils.tab("Instruments")


# -- interaction --------------------------------------------------------------------------------------


def test_a_joint_is_set_by_a_number(sils):
    movable = still(sils)
    sils.tab("Move")
    target = movable.assembly.q[0] / MM + 3.0
    field = sils.field("q1 [mm]")
    field.fill(f"{target:.2f}")
    field.press("Enter")
    until(lambda: abs(movable.assembly.q[0] / MM - target) < 0.006, "q1")
    assert movable.assembly.worst_gap < 1e-9


def test_the_gizmo_takes_the_tool_along(sils):
    movable = still(sils)
    T = movable.assembly.T_base_tool
    node = sils.front.nodes["sils"]
    arrow = 0.75 * float(sils.front.gizmo.scale)
    start = sils.at(node.to_world(T[:3, 3] + arrow * T[:3, 0]))
    end = sils.at(node.to_world(T[:3, 3] + (arrow + 0.02) * T[:3, 0]))
    sils.drag(start, end)
    until(lambda: np.linalg.norm(movable.assembly.T_base_tool[:3, 3] - T[:3, 3]) > 5 * MM, "the tool")
    step = movable.assembly.T_base_tool[:3, 3] - T[:3, 3]
    assert abs(step @ T[:3, 0]) > 0.98 * np.linalg.norm(step)  # along the arrow
    np.testing.assert_allclose(movable.assembly.T_base_tool[:3, :3], T[:3, :3], atol=1e-6)
    assert movable.assembly.worst_gap < 1e-9


def test_a_passive_link_is_taken_with_shift(sils):
    movable = still(sils)
    mesh = max(movable.mechanism.body("strut2").meshes, key=lambda m: np.ptp(m.vertices, axis=0).max())
    ends = mesh.vertices[
        [mesh.vertices[:, i].argmin() for i in range(3)] + [mesh.vertices[:, i].argmax() for i in range(3)]
    ]
    a, b = max(((p, q) for p in ends for q in ends), key=lambda e: np.linalg.norm(e[0] - e[1]))
    local = 0.35 * a + 0.65 * b
    centre = mesh.vertices[np.argsort(np.linalg.norm(mesh.vertices - local, axis=1))[:12]].mean(axis=0)
    T = movable.assembly.link_poses["strut2"]
    p = (T @ np.append(centre, 1.0))[:3]
    before = movable.assembly.q.copy()
    x, y = sils.at(sils.front.nodes["sils"].to_world(p))
    sils.drag((x, y), (x + 25, y + 40), key="Shift")
    until(lambda: np.abs(movable.assembly.q - before).max() > 1 * MM, "the loop")
    assert movable.assembly.worst_gap < 1e-9


def test_what_cannot_be_reached_stays_and_says_why(sils):
    movable = still(sils)
    good = movable.assembly
    T = good.T_base_tool.copy()
    T[:3, 3] += [2.0, 0, 0]
    sils.front.ask("tool", lambda: movable.move_tool(T))
    until(lambda: bool(movable.last_move.reason), "the refusal")
    assert movable.assembly is good
    until(lambda: "out of reach" in sils.readout(), "the reason")


def test_a_session_is_recorded_and_replayed(sils):
    movable = still(sils)
    sils.tab("Move")
    sils.page.get_by_role("button", name="Record").click()
    until(lambda: sils.page.get_by_role("button", name="Stop recording").count(), "the recording")
    passed = []
    for k in range(1, 6):
        before = movable.assembly.q[0]
        sils.front.ask("joint", lambda k=k: movable.move_joint(0, movable.assembly.q[0] + k * MM))
        until(lambda before=before: movable.assembly.q[0] != before, "the joint")
        time.sleep(0.2)
        passed.append(movable.assembly.q.copy())
    sils.page.get_by_role("button", name="Stop recording").click()
    until(lambda: sils.page.get_by_role("button", name="Replay").is_enabled(), "the end of the recording")
    sils.front.ask("home", lambda: movable.go_to_posture("home"))
    until(lambda: not np.allclose(movable.assembly.q, passed[-1]), "home")
    sils.page.get_by_role("button", name="Replay").click()
    until(lambda: np.allclose(movable.assembly.q, passed[-1], atol=1e-9), "the last recorded posture")


# -- instruments --------------------------------------------------------------------------------------


def reds(image):
    r, g, b = image[..., 0], image[..., 1], image[..., 2]
    return int((r - np.maximum(g, b) > 60).sum())


def test_the_printed_formula_turns_the_readout_red(sils):
    movable = still(sils)
    until(lambda: "agree" in sils.readout(), "the readout of the robot's equations")
    with_gizmo = reds(sils.shot())
    sils.front.ask("gizmo", lambda: setattr(sils.front.gizmo, "visible", False))
    until(lambda: reds(sils.shot()) < with_gizmo - 50, "a picture without the red arrows of the gizmo")
    before = reds(sils.shot())
    sils.tab("Design")
    box = sils.field("eq1")
    box.click()
    sils.page.get_by_role("option", name="printed").click()
    until(lambda: movable.kin.variants["eq1"] == "printed", "the variant")
    until(lambda: "DISAGREE" in sils.readout(), "the readout")
    until(lambda: reds(sils.shot()) > before + 50, "red lines between the points of the platform")
    box.click()
    sils.page.get_by_role("option", name="corrected").click()
    until(lambda: "DISAGREE" not in sils.readout(), "the readout again")
    sils.front.ask("gizmo", lambda: setattr(sils.front.gizmo, "visible", True))


# -- design -------------------------------------------------------------------------------------------


def test_a_distance_of_the_mechanism_is_edited_and_undone(sils):
    movable = still(sils)
    sils.tab("Design")
    field = sils.field("length [mm]")
    drawn = float(field.input_value().replace(",", ""))
    field.fill(f"{drawn + 0.5}")
    field.press("Enter")
    until(lambda: movable.edited, "the new mechanism")
    until(lambda: "sils" in sils.front.ghosts, "the ghost of what is drawn")
    sils.page.get_by_role("button", name="as drawn").click()
    until(lambda: not movable.edited, "the drawn mechanism")


def test_the_workspace_is_found_without_stalling_the_hand(sils):
    movable = still(sils)
    front = sils.front
    sils.tab("Design")
    before = sils.shot()
    sils.page.get_by_role("button", name="Compute workspace").click()
    until(lambda: len(front.panels.design._cloud_points) > 0, "the first points")
    T = movable.assembly.T_base_tool.copy()
    took = []
    for k in range(60):
        moved = T.copy()
        moved[:3, 3] += [0, 0, 2 * MM * np.sin(k / 5)]
        front.ask("tool", lambda m=moved: took.append(movable.move_tool(m)))
        time.sleep(1 / 60)
    until(
        lambda: sum(map(len, front.panels.design._cloud_points)) > 1000 and "1 000 000 poses" in found(sils),
        "the whole",
        180,
    )
    assert took  # a benchmark measures how long they took
    assert all(moved.good for moved in took)
    until(lambda: sils.differs(before) > 0.01, "the cloud in the picture")
    sils.page.get_by_role("button", name="Hide workspace").click()


def found(look):
    texts = look.page.locator("text=/poses,/")
    return texts.first.inner_text() if texts.count() else ""


def test_two_designs_stand_beside_each_other(sils):
    movable = still(sils)
    front = sils.front
    sils.tab("Design")
    before = sils.shot()
    sils.page.get_by_role("button", name="Keep this design as B").click()
    until(lambda: front.panels.design._design_b_nodes is not None, "design B")
    front.ask("design", lambda: movable.change(parameters={"l_p": movable.kin.parameters["l_p"] + 2 * MM}))
    front.ask("tool", lambda: movable.move_tool(movable.assembly.T_base_tool))
    until(lambda: sils.page.locator("text=B (orange)").count() > 0, "the table of both")
    other = front.panels.design._design_b
    until(lambda: np.abs(other.assembly.q - movable.assembly.q).max() > 1e-6, "different joints for one tool pose")
    until(lambda: sils.differs(before) > 0.005, "design B in the picture")
    l_p = movable.robot.kinematics().parameters["l_p"]
    front.ask("design", lambda: (movable.change(parameters={"l_p": l_p}),
                                 front.panels.design._show_design_b(False)))  # fmt: skip
    until(lambda: not movable.edited, "the robot's own equations")


# -- scene --------------------------------------------------------------------------------------------


def test_scene_switches_change_the_picture_and_not_the_numbers(sils):
    movable = still(sils)
    q = movable.assembly.q.copy()
    sils.tab("Scene")
    hand = sils.front.active
    before_it = hand.playback, hand.protocol
    hand.playback, hand.protocol = None, "lowered_patient"  # which has a patient
    for name in ("joint axes", "link names", "table and patient"):
        before = sils.shot()
        box = sils.page.get_by_label(name)
        box.click(force=True)
        until(lambda b=before: sils.differs(b) > 5e-4, name)
        box.click(force=True)
        until(lambda b=before: sils.differs(b) < 1e-4, f"{name} gone")
    for view in ("top", "along the shaft", "overview"):
        before = sils.clients[0].camera.position.copy()
        sils.front.scenery.cameras.look(view, None)
        until(lambda b=before: np.linalg.norm(sils.clients[0].camera.position - b) > 0.05, view)
    np.testing.assert_array_equal(movable.assembly.q, q)
    hand.playback, hand.protocol = before_it


def test_the_robot_is_rescaled_and_its_numbers_stay(sils):
    movable = still(sils)
    front = sils.front

    def at_rest():
        before = sils.readout()
        time.sleep(1.5)
        return before == sils.readout()

    until(at_rest, "what was done before is shown")
    text = sils.readout()
    front.ask("place", lambda: front.scenery._place_robot(front.active, np.array([0.1, 0.0, 0.0]), 0.3, 0.5))
    until(lambda: not front._requests, "the wish")
    until(at_rest, "what was done is shown")
    assert sils.readout() == text
    T = movable.assembly.T_base_tool
    world = front.nodes["sils"].to_world(T[:3, 3])
    np.testing.assert_allclose(front.nodes["sils"].to_base(world), T[:3, 3], atol=1e-12)
    assert np.linalg.norm(np.asarray(front.gizmo.position) - world) < 1e-6
    front.ask("place", lambda: front.scenery._place_robot(front.active, np.zeros(3), 0.0, 1.0))
    until(lambda: not front._requests, "the wish")


def test_a_screenshot_and_a_section(sils):
    still(sils)
    before = sils.ink()
    sils.front.scenery._section = (1, 0.4)
    sils.front.ask("cut", lambda: None)
    until(lambda: sils.ink() < before, "less of the robot")
    sils.front.scenery._section = None
    sils.front.ask("cut", lambda: None)
    png = view_export.screenshot(sils.clients[0], "shot", lambda part: None)
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    assert image.shape == (1080, 1920, 3)
    assert np.mean(np.ptp(image, axis=2) > 25) > 0.005


# -- browsers come and go -----------------------------------------------------------------------------


@pytest.mark.usefixtures("aside")
def test_browsers_come_and_go(browser, sils):
    front = sils.front
    other = browser.new_page(viewport={"width": 300, "height": 200})
    other.add_init_script(BLIND % "true")
    other.goto(f"http://127.0.0.1:{front.server.get_port()}/")
    until(lambda: len(sils.clients) == 2, "the other tab")
    other.close()
    until(lambda: len(sils.clients) == 1, "the closed tab")
    movable = still(sils)
    front.ask("joint", lambda: movable.move_joint(0, movable.assembly.q[0] + 1 * MM))
    until(lambda: not front._requests, "the wish")
    third = Looker(browser, front, 600, 400)  # sees the present pose, not the first one
    third.page.close()


def hit(look, x, y):
    """Return (name of the nearest link, its point (3,) in m in the world) at a pixel of the page, by our own rays."""
    movable = look.front.active.movable
    camera, box = look.clients[0].camera, look.page.locator("canvas").first.bounding_box()
    focal = 0.5 * box["height"] / np.tan(camera.fov / 2)
    ray = np.array([x - box["x"] - box["width"] / 2, y - box["y"] - box["height"] / 2, focal])
    ray = spatial.matrix_from_quat_wxyz(np.asarray(camera.wxyz)) @ ray / np.linalg.norm(ray)
    found = []
    for body in movable.mechanism.bodies:
        T = movable.assembly.link_poses[body.name]
        for vertices, triangles, *_ in display_meshes(body):
            corners = (vertices @ T[:3, :3].T + T[:3, 3])[triangles]
            a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            p = np.cross(ray, e2)
            det = np.einsum("ij,ij->i", e1, p)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = camera.position - a
                u = np.einsum("ij,ij->i", s, p) / det
                q = np.cross(s, e1)
                v = q @ ray / det
                far = np.einsum("ij,ij->i", e2, q) / det
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0)
            if inside.any():
                found.append((far[inside].min(), body.name))
    if not found:
        return "", np.full(3, np.nan)
    far, name = min(found)
    return name, camera.position + far * ray


def seen(look, link):
    """Return a pixel (x, y) of the page at which a link is seen, in the middle of one of its largest triangles."""
    movable = look.front.active.movable
    T = movable.assembly.link_poses[link]
    corners = np.concatenate(
        [vertices[triangles] for vertices, triangles, *_ in display_meshes(movable.mechanism.body(link))]
    )
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    for k in np.argsort(-area)[:60]:
        pixel = look.at(T[:3, :3] @ corners[k].mean(axis=0) + T[:3, 3])
        if hit(look, *pixel)[0] == link:
            return pixel
    raise AssertionError(f"{link} is hidden")


def test_links_are_named_measured_and_fitted_and_a_link_opens_the_posture(sils):
    look, page, front = sils, sils.page, sils.front
    movable = still(look)
    page.wait_for_function("window.twinTools?.meshes().length > 10")
    first, second = seen(look, "limb1"), seen(look, "frame")
    names, points = [], []
    for x, y in (first, second):
        name, p = hit(look, x, y)
        names.append(name)
        points.append(p)
        page.mouse.move(x - 3, y)
        page.mouse.move(x, y)
        until(lambda n=name: page.locator(".twin-name").text_content() == n, f"the name {name}")
    assert len(set(names)) == 2
    page.locator("[data-id=measure]").click()
    for x, y in (first, second):
        page.mouse.click(x, y)
    until(lambda: page.locator(".twin-measure").get_attribute("data-mm"), "a distance")
    shown = float(page.locator(".twin-measure").get_attribute("data-mm"))
    assert shown == pytest.approx(np.linalg.norm(points[1] - points[0]) / MM, rel=2e-3)  # a pixel is about 1 mm
    page.locator("[data-id=measure]").click()
    camera = look.clients[0].camera
    first_view = camera.position.copy(), camera.look_at.copy()
    control = "window.__viserMutable.cameraControl.distance"
    before = page.evaluate(control)
    page.mouse.dblclick(*first)
    until(lambda: page.evaluate(control) < 0.7 * before, "the view of one link")
    page.locator("[data-id=fit]").click()
    until(lambda: page.evaluate(control) > 0.9 * before, "the view of the robot")
    page.locator("[data-id=view-top]").click()

    def is_above():
        away = camera.position - camera.look_at
        return away[2] > 0.99 * np.linalg.norm(away)

    until(is_above, "the view from above")
    q = movable.assembly.q.copy()
    movable.move_joint(0, q[0] + 5 * MM)
    front.ask("look", lambda: None)
    until(lambda: page.evaluate("fetch('state.json').then(r => r.json())")["joints"]["q1"]["value"] != q[0] / MM, "it")
    link = page.evaluate("fetch('state.json').then(r => r.json())")["link"]
    wanted = movable.assembly.q.copy()
    still(look)
    page.evaluate(f"location.hash = '{link}'")
    until(lambda: np.allclose(movable.assembly.q, wanted, rtol=0, atol=1e-9), "the posture of the link")
    assert page.evaluate("location.hash") == ""
    camera.position, camera.look_at = first_view
    until(lambda: np.allclose(camera.position, first_view[0], atol=1e-3), "the view before")


def test_a_turntable_is_a_moving_picture(sils, monkeypatch):
    monkeypatch.setattr(view_export, "TURNTABLE_PICTURES", 4)
    gif = Image.open(io.BytesIO(view_export.turntable(sils.clients[0], "turn", lambda part: None)))
    assert gif.n_frames == 4
    frames = []
    for k in range(4):
        gif.seek(k)
        frames.append(np.asarray(gif.convert("RGB")).astype(int))
    assert np.mean(np.abs(frames[0] - frames[1]).max(axis=2) > 30) > 0.02


@pytest.mark.usefixtures("aside")
def test_a_recording_plays_without_python(browser, tmp_path):
    with shown("hibou") as front:
        front.ask("load", lambda: front.load(front.active, None))
        until(lambda: front.active.playback is not None, "the plan", 120)
        done = []
        front.ask("page", lambda: done.append(view_export.page(front)))
        until(lambda: bool(done), "the recording", 120)
    path = Path(tmp_path) / "hibou.html"
    path.write_text(done[0], encoding="utf-8")
    page = browser.new_page(viewport={"width": 400, "height": 300})
    page.set_default_timeout(1000 * WAIT)
    page.context.set_offline(True)
    page.goto(path.as_uri())
    page.locator("canvas").first.wait_for(timeout=1000 * WAIT)

    def image():
        return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)

    time.sleep(6)  # all of it is loaded
    before = image()
    until(lambda: np.mean(np.abs(image() - before).max(axis=2) > 30) > 2e-4, "it moves")
    page.close()


# -- the access control ------------------------------------------------------------------------


@contextmanager
def somebody_else():
    """Yield the address of another site, with a page that does nothing by itself, and what it is asked for."""
    import http.server

    asked = []

    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_response(200)
            self.send_header("Access-Control-Allow-Origin", "*")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>elsewhere</title>")

        def log_message(self, *args):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()


KNOCK = """async ([where, protocol]) => await new Promise(done => {
    const socket = new WebSocket(where, [protocol]);
    socket.onopen = () => done("open");
    socket.onerror = () => done("refused");
})"""


@pytest.mark.usefixtures("aside")
def test_another_site_in_the_same_browser_stays_outside(browser, sils):
    """The attack as it is done: a page from elsewhere, opened while the robot is shown."""
    import viser

    port, protocol = sils.front.server.get_port(), f"viser-v{viser.__version__}"
    clients = len(sils.clients)
    with somebody_else() as (site, _):
        page = browser.new_page()
        page.goto(site)
        assert page.evaluate(KNOCK, [f"ws://127.0.0.1:{port}/", protocol]) == "refused"
        assert page.evaluate(KNOCK, [f"ws://localhost:{port}/", protocol]) == "refused"
        frame = f"<iframe src='http://127.0.0.1:{port}/'></iframe>"
        page.evaluate("html => { document.body.innerHTML = html }", frame)
        time.sleep(3.0)
        assert len(sils.clients) == clients  # nor is it shown inside that page
        page.close()
    assert sils.page.evaluate(KNOCK, [f"ws://127.0.0.1:{port}/", protocol]) == "open"


@pytest.mark.usefixtures("aside")
@pytest.mark.parametrize("query", nightly(["?websocket={ws}", "?playbackPath={http}/scene.viser"], every=2))
def test_a_link_to_our_page_lets_no_other_server_write_into_it(browser, query, monkeypatch):
    """viser's page connects with any server that its address names; without our policy it does."""
    from twin.ui.viewer import server as servers

    def asks(seconds):
        """Return after how many seconds the page has asked the other site; None if it has not by then."""
        server = servers.serve("link", "127.0.0.1", 0)
        try:
            with somebody_else() as (site, asked):
                page = browser.new_page(viewport={"width": 300, "height": 200})
                page.add_init_script(BLIND % "true")
                named = query.format(ws=site.replace("http", "ws"), http=site)
                start = time.monotonic()
                page.goto(f"http://127.0.0.1:{server.get_port()}/{named}")
                page.locator("canvas").first.wait_for(timeout=1000 * WAIT, state="attached")
                while (took := time.monotonic() - start) < seconds and not asked:
                    page.wait_for_timeout(100)
                page.close()
                return took if asked else None
        finally:
            servers.stop(server)

    with monkeypatch.context() as patch:
        patch.setattr(servers, "PAGE_POLICY", "default-src * 'unsafe-inline' 'unsafe-eval' data: blob:")
        unguarded = asks(WAIT)
    assert unguarded is not None
    assert asks(2.0 + 3 * unguarded) is None


@pytest.mark.usefixtures("aside")
def test_the_page_opens_by_its_token_when_it_is_open_to_the_network(browser):
    from twin.ui.access.rules import AccessRules
    from twin.ui.viewer.front import ShownRobot
    from twin.ui.viewer.page import open_page
    from twin.ui.viewer.server import serve

    tokens = []
    server = serve("hibou", "127.0.0.1", 0, AccessRules("0.0.0.0", 0, False, tokens.append))
    front = open_page(
        "twin · hibou", [ShownRobot("hibou", "hibou", MovableRobot(twin.load("hibou")))], None, server, local=False
    )
    thread = threading.Thread(target=front.run)
    thread.start()
    try:
        context = browser.new_context(viewport={"width": 1100, "height": 720})
        page = context.new_page()
        page.add_init_script(BLIND % "true")
        page.add_init_script(CALM)
        page.set_default_timeout(1000 * WAIT)
        assert page.goto(f"http://127.0.0.1:{server.get_port()}/").status == 403
        assert page.goto(f"http://127.0.0.1:{server.get_port()}/?token={tokens[-1]}").status == 200
        page.get_by_role("tab", name="Move").click(force=True)
        page.get_by_role("button", name="Load a session").wait_for(state="attached")
        assert server.get_clients()
        assert not page.get_by_role("button", name="Save the session").count()
        assert not page.get_by_text("Write into the robot's files").count()
        context.close()
    finally:
        front.stop()
        thread.join(30)
