"""The live console in the viewer: arrows, sliders and pedals move the World of the scene as any other device does."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from made.headset_page import until
from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.units import DEG, MM
from twin.model.console import CameraRangeTable
from twin.simulation.controllers.camera import Drag, Dragging, hands
from twin.ui.session import scene_control
from twin.ui.session.exercise import Exercise
from twin.ui.session.pens import IDLE, ROLL, Pens
from twin.ui.session.scene_control import HeldError, LiveConsole
from twin.ui.viewer.console_page import ARROWS, ConsoleFront, hand_text, status
from twin.ui.viewer.server import serve

ARMS = {"right": "psm1", "left": "psm2"}
FRAME = 1 / 60


class Desk:
    """A live console with the pens of a page, and the time that passes."""

    def __init__(self, loaded):
        self.live = LiveConsole(loaded)
        self.pens = Pens(self.live)
        self.live.advance(FRAME)

    def wait(self, seconds):
        for _ in range(round(seconds / FRAME)):
            self.pens.say(FRAME)
            self.live.advance(FRAME)

    def rest(self):
        """Let time pass until nothing moves."""
        for _ in range(100):
            before = self.q()
            self.wait(0.1)
            if self.pens.settled and not moved(before, self.q()):
                return
        raise AssertionError("the robots do not come to rest")

    def q(self):
        return {n: self.live.world.signals[f"{n}.q"].copy() for n in ("psm1", "psm2", "ecm")}

    def move(self, hand, way=(0, 0, 0), turn=(0, 0, 0), client="page 1"):
        """Drag the arrows of a hand by a way in m and a turn in rad, in the World."""
        T = self.live.tool(hand)
        to = spatial.pose(spatial.exp_so3(np.array(turn)) @ T[:3, :3], T[:3, 3] + way)
        self.pens.move(client, hand, T, to)
        return to


@pytest.fixture
def desk(bare_theatre, monkeypatch):
    monkeypatch.setattr(scene_control, "_BUDGET", np.inf)  # a busy machine does not make the World late
    return Desk(bare_theatre)


def moved(before, after):
    return {n for n, q in after.items() if not np.allclose(q, before[n], atol=1e-9, rtol=0)}


# -- pens -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hand", ARMS)
def test_a_tool_goes_where_its_arrows_are_dragged_and_nothing_else_moves(desk, hand):
    before = desk.q()
    to = desk.move(hand, (0.006, -0.004, 0.008), (0.1, -0.05, 0.2))
    desk.rest()
    np.testing.assert_allclose(desk.live.tool(hand), to, atol=1e-9)
    assert moved(before, desk.q()) == {ARMS[hand]}
    desk.live.rescale("page 1", 0.1)
    desk.wait(FRAME)
    to = desk.move(hand, (-0.006, 0.004, -0.008))
    desk.rest()
    np.testing.assert_allclose(desk.live.tool(hand), to, atol=1e-9)


def test_a_far_drag_is_no_jump_and_as_fast_as_the_tool_may_be(desk):
    to = desk.move("right", (0.0, 0.0, 0.03))
    at = [desk.live.tool("right")[:3, 3]]
    for _ in range(60):
        desk.wait(FRAME)
        at.append(desk.live.tool("right")[:3, 3])
    fastest = np.linalg.norm(np.diff(at, axis=0), axis=1).max()
    np.testing.assert_allclose(desk.live.tool("right"), to, atol=1e-9)
    assert fastest <= 0.5 * FRAME + 1 * MM
    assert desk.live.reading["hands"]["right"]["jumps"] == 0


def test_what_is_beyond_a_limit_is_told_and_nothing_is_left_to_go_back(desk, caplog):
    before = desk.q()
    with caplog.at_level(logging.WARNING):
        desk.move("right", 0.1 * desk.live.view[:3, 2])  # out of the patient
        desk.rest()
    wall = desk.live.reading["hands"]["right"]["wall"]
    assert "is at its limit" in wall
    assert f"psm1: {wall}" in caplog.text
    assert status(desk.live.reading) == ("warn", f"psm1: {wall}")
    assert hand_text(desk.live.reading, "right") == ("warn", f"Right hand: psm1 {wall}")
    at = desk.q()
    assert moved(before, at) == {"psm1"}
    desk.pens.settle("right")
    desk.rest()
    assert np.abs(desk.q()["psm1"] - at["psm1"]).max() < 1e-4
    assert desk.live.reading["hands"]["right"]["wall"] is None
    to = desk.move("right", -0.01 * desk.live.view[:3, 2])
    desk.rest()
    np.testing.assert_allclose(desk.live.tool("right")[:3, 3], to[:3, 3], atol=1e-6)


def test_a_jaw_opens_by_parts_of_its_range(desk):
    desk.pens.squeeze("page 1", "left", 0.5)
    before = desk.q()
    desk.rest()
    assert desk.q()["psm2"][-1] == pytest.approx(40 * DEG, abs=1e-6)
    assert moved({"psm2": before["psm2"][:-1]}, {"psm2": desk.q()["psm2"][:-1]}) == set()
    assert moved(before, desk.q()) == {"psm2"}
    desk.pens.squeeze("page 1", "left", 0.0)
    desk.rest()
    assert desk.q()["psm2"][-1] == pytest.approx(0.0, abs=1e-6)


def test_under_the_clutch_arrows_move_freely_and_the_instruments_stand(desk):
    desk.move("right", (0.002, 0, 0))
    desk.rest()
    before = desk.q()
    desk.pens.press("page 1", clutch=True)
    desk.wait(0.1)
    assert status(desk.live.reading) == ("good", "Clutch: only the arrows move; the instruments are at rest.")
    desk.move("right", (0.02, 0, 0))
    desk.wait(0.5)
    desk.pens.press("page 1", clutch=False)
    desk.rest()
    assert moved(before, desk.q()) == set()
    to = desk.move("right", (0.0, 0.003, 0))
    desk.rest()
    np.testing.assert_allclose(desk.live.tool("right"), to, atol=1e-6)


def test_with_the_camera_pedal_the_scene_goes_with_the_arrows(desk):
    before, T = desk.q(), desk.live.view.copy()
    desk.pens.press("page 1", camera=True)
    desk.wait(0.1)
    R, lever = T[:3, :3], Drag().lever
    seen = np.linalg.solve(T, [*(T[:3, 3] - lever * T[:3, 2]), 1.0])  # a point of the scene, before the lens
    p = T @ seen
    desk.move("left", R @ (0.004, 0.003, 0.0))
    desk.rest()
    assert moved(before, desk.q()) == {"ecm"}
    shown = np.linalg.solve(desk.live.view, p)[:3] - seen[:3]
    np.testing.assert_allclose(shown, (0.004, 0.003, 0.0), atol=0.6 * MM)
    roll = desk.live.camera_at[3]
    desk.move("left", turn=0.2 * desk.live.view[:3, 2])
    desk.rest()
    assert desk.live.camera_at[3] == pytest.approx(roll - 0.2, abs=1e-6)


def test_the_camera_goes_to_its_sliders_by_both_hands(desk):
    wanted = desk.live.camera_at + np.array([5 * DEG, -4 * DEG, 6 * MM, 8 * DEG])
    before = desk.q()
    for k in range(4):
        desk.pens.aim("page 1", k, wanted[k])
    desk.rest()
    np.testing.assert_allclose(desk.live.camera_at, wanted, atol=1e-6)
    assert moved(before, desk.q()) == {"ecm"}
    assert desk.live.reading["mode"] == "instruments"
    desk.pens.aim("page 1", 3, 9.0)
    desk.wait(0.1)
    assert desk.live.camera_at[3] > wanted[3] + 0.02
    desk.pens.aim("page 1", 3, wanted[3])  # another place, before the first is reached
    desk.rest()
    np.testing.assert_allclose(desk.live.camera_at, wanted, atol=1e-6)


@pytest.mark.slow
def test_the_camera_stops_at_the_range_of_its_scene_and_the_pedal_is_released(bare_theatre, monkeypatch):
    monkeypatch.setattr(scene_control, "_BUDGET", np.inf)
    scene, depth = bare_theatre.scene, LiveConsole(bare_theatre).camera_at[2] / MM
    limits = CameraRangeTable(
        pan_deg=(-40, 40), tilt_deg=(-40, 40), depth_mm=(depth - 10, depth + 10), roll_deg=(-88, 88)
    )
    table = scene.console.model_copy(update={"camera_range": limits})
    desk = Desk(replace(bare_theatre, scene=replace(scene, console=table)))
    desk.pens.aim("page 1", 2, 0.2)
    desk.wait(2.0)
    assert desk.live.camera_at[2] == pytest.approx((depth + 10) * MM, abs=1e-6)
    assert not desk.pens.aims, "the camera pedal is not pressed for ever"


def test_where_the_hands_go_is_the_inverse_of_the_cameras_law():
    rng, drag = np.random.default_rng(3), Drag(rate=(1e6,) * 4)
    for _ in range(100):
        at, wanted = rng.uniform(np.array(drag.lower) * 0.9, np.array(drag.upper) * 0.9, (2, 4))
        right, left = rng.normal(size=(2, 3))
        law = Dragging(at, 1e-3, drag)
        law.step(right, left)
        np.testing.assert_allclose(law.step(*hands(at, wanted, right, left, drag)), wanted, atol=1e-9)


def test_hands_are_let_go_after_a_while_and_taken_by_one_page_at_a_time(desk):
    desk.move("right", (0.002, 0, 0))
    desk.wait(0.3)
    assert desk.live.owner == "page 1"
    assert status(desk.live.reading) == ("good", "page 1 controls psm1.")
    with pytest.raises(HeldError, match="page 1 controls the hands"):
        desk.move("left", (0.002, 0, 0), client="page 2")
    desk.pens.press("page 1", clutch=True)
    desk.wait(IDLE + 0.5)
    assert desk.live.owner == "page 1", "a pedal is held"
    desk.pens.press("page 1", clutch=False)
    desk.wait(IDLE + 0.5)
    assert desk.live.owner is None
    assert status(desk.live.reading) == ("plain", "No client controls the hands: nothing moves.")
    before = desk.q()
    to = desk.move("left", (0.002, 0, 0), client="page 2")
    desk.rest()
    np.testing.assert_allclose(desk.live.tool("left"), to, atol=1e-9)
    assert moved(before, desk.q()) == {"psm2"}


def test_another_device_that_has_the_hands_is_left_alone(desk):
    desk.move("right", (0.002, 0, 0))
    desk.wait(0.3)
    desk.pens.say(FRAME)
    desk.live.release("page 1")
    desk.live.owner = "a pen"
    desk.live.device._heard = [desk.live.world.t] * 2
    desk.pens.say(FRAME)
    assert desk.pens.client is None
    assert desk.live.owner == "a pen"


def test_silence_and_a_world_that_fails_are_told(desk, monkeypatch):
    desk.move("right", (0.002, 0, 0))
    desk.wait(0.3)
    for _ in range(30):
        desk.live.advance(FRAME)
    assert status(desk.live.reading) == ("warn", "No data from page 1: nothing moves.")

    def fail(ticks):
        raise WorldError("signal 'psm1.q' is not finite at t = 1.000 s")

    monkeypatch.setattr(desk.live.world, "step", fail)
    desk.live.advance(FRAME)
    tone, text = status(desk.live.reading)
    assert tone == "bad"
    assert "psm1.q" in text
    desk.live.advance(FRAME)
    assert ROLL > 4 * DEG


# -- the page ---------------------------------------------------------------------------------------------------------


@contextmanager
def fronted(loaded):
    front = ConsoleFront("test", loaded, serve("test", "127.0.0.1", 0))
    try:
        yield front
    finally:
        front.close()


@pytest.fixture(scope="module")
def front(bare_theatre):
    with pytest.MonkeyPatch.context() as patch, fronted(bare_theatre) as front:
        patch.setattr(scene_control, "_BUDGET", np.inf)
        yield front


def go_on(front, until, seconds=20.0):
    """Let frames pass, each of which finds that the same time has passed since the last one, until something holds."""
    for _ in range(round(seconds / FRAME)):
        front._last = time.perf_counter() - FRAME
        front.step()
        if until():
            return
    raise AssertionError(status(front.console.reading))


@pytest.mark.slow
def test_the_scoreboard_of_a_task_its_end_and_a_restart(theatre):
    scene, server = theatre.scene, serve("test", "127.0.0.1", 0)
    front = ConsoleFront("test", theatre, server, Exercise(scene.tasks["pegboard"]))
    try:
        score = front._score
        front.step()
        assert "Rings transferred" in score._html.content
        assert "0 of 4" in score._html.content
        assert score._window is None
        ring = front.nodes["ring1"].bodies["ring1"]
        np.testing.assert_allclose(np.asarray(ring.position), scene.objects[0].T_world_object[:3, 3], atol=1e-3)
        score._end_task("page 1")
        front.step()
        assert "The task was ended." in front._status.content
        assert "This attempt has no report." in score._result.content
        assert score._end.disabled
        score._restart("page 1")
        front.step()
        assert score._window is None
        assert not score._end.disabled
        assert front.console.attempt == 2
    finally:
        front.close()


def drag(front, hand, way, ended=True):
    T = front._T_arrows[hand].copy()
    T[:3, 3] += way
    front.ask(hand, lambda: front._move(hand, "page 1", T, ended))
    return T


def test_views_look_at_the_tools_and_through_the_endoscope(front):
    for view in ("close", "overview"):
        eye, at, _ = front.camera(view)
        assert np.linalg.norm(eye - at) > 0.3
    eye, at, up = front.camera("endoscope")
    tips = np.array([front.console.tool(hand)[:3, 3] for hand in ARMS])
    along = (at - eye) / np.linalg.norm(at - eye)
    assert ((tips - eye) @ along > 0.02).all()
    assert up @ along == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
def test_arrows_move_a_tool_and_come_back_to_it(front):
    drag(front, "right", (0.001, 0.0, 0.0), ended=False)
    T = drag(front, "right", (0.004, 0.002, 0.0), ended=False)
    go_on(front, lambda: np.allclose(front.console.tool("right"), T, atol=1e-8))
    poses = front.console.world.frame().link_poses["psm1"]
    for body in front.console.members["psm1"].mechanism.bodies:
        node = front.nodes["psm1"].bodies[body.name]
        np.testing.assert_allclose(np.asarray(node.position), poses[body.name][:3, 3], atol=1e-7)
    drag(front, "right", 0.1 * front.console.view[:3, 2])  # out of the patient: beyond a limit
    go_on(front, lambda: front.console.reading["hands"]["right"]["wall"])
    assert "is at its limit" in front._status.content
    go_on(front, lambda: not front.console.reading["hands"]["right"]["wall"] and not front._left_to_settle)
    go_on(front, lambda: np.allclose(front.arrows["right"].position, front.console.tool("right")[:3, 3], atol=1e-6))


def test_controls_show_what_holds_in_the_world(front):
    front.ask("scale", lambda: front.console.rescale("page 1", 0.8))
    go_on(front, lambda: front._scale.value == 0.8)
    at = front.console.camera_at + np.array([0, 0, 5 * MM, 0])
    front.ask("aim", lambda: front.pens.aim("page 1", 2, at[2]))
    go_on(front, lambda: not front.pens.aims and abs(front._camera[2].value - at[2] / MM) < 0.3)
    np.testing.assert_allclose(front.console.camera_at, at, atol=1e-6)
    front._jaws["left"].value = 30  # as a page does, before its request comes
    for _ in range(3):
        go_on(front, lambda: True)
    assert front._jaws["left"].value == 30
    front.ask("pedal", lambda: front.pens.press("page 1", clutch=True))
    go_on(front, lambda: front._clutch.value and "instruments are at rest" in front._status.content)
    front.ask("let go", front.pens.release)
    go_on(front, lambda: not front._clutch.value and "No client controls" in front._status.content)


def test_a_page_that_is_refused_is_told_once_and_its_arrows_go_back(front, monkeypatch):
    said = []
    monkeypatch.setattr("twin.ui.viewer.loop.tell", lambda server, title, text, bad: said.append(text))
    go_on(front, lambda: front._rest_time > 0.3)
    front.pens.use("page 7")
    go_on(front, lambda: front.console.owner == "page 7")
    for _ in range(3):
        drag(front, "left", (0.01, 0, 0))
        go_on(front, lambda: True)
    assert said == ["page 7 controls the hands of the console; wait until it releases them"]
    go_on(front, lambda: np.allclose(front.arrows["left"].position, front.console.tool("left")[:3, 3], atol=1e-9))
    front.pens.release()


# -- in Chromium ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_rings_move_on_the_page(theatre):
    """A ring that is set free beside the pegs falls to the floor; on its peg it counts."""
    scene = theatre.scene
    loose = replace(scene.objects[0], T_world_object=spatial.pose(p=np.array([0, 40, 910]) * MM))
    placed = replace(scene.objects[1], T_world_object=spatial.pose(p=np.array([-42, 40, 900]) * MM))
    changed = replace(scene, objects=(loose, placed, *scene.objects[2:]))
    changed, exercise = replace(theatre, scene=changed), Exercise(scene.tasks["pegboard"])
    front = ConsoleFront("test", changed, serve("test", "127.0.0.1", 0), exercise)
    try:
        node = front.nodes["ring1"].bodies["ring1"]
        go_on(front, lambda: abs(node.position[2] - 895.7 * MM) < 0.03 * MM)  # flat on the floor
        assert front.nodes["ring3"].bodies["ring3"].position[2] > 920 * MM
        go_on(front, lambda: "1 of 4" in front._score._html.content)
        assert "ring 2 is on its peg: 1 of 4" in front._score._html.content
    finally:
        front.close()


@pytest.fixture(scope="module")
def look(browser, bare_theatre):
    from ui.test_viewer_page import Looker, without_shadows

    front = without_shadows(ConsoleFront("twin · davinci", bare_theatre, serve("davinci", "127.0.0.1", 0)))
    thread = threading.Thread(target=front.run)
    thread.start()
    try:
        look = Looker(browser, front, width=900, height=760, tab=None)
        yield look
        assert look.errors == []
    finally:
        front.stop()
        thread.join(30)


@pytest.mark.browser
def test_the_mouse_drags_an_instrument_by_its_arrows(look):
    front = look.front
    before = look.shot()
    look.page.get_by_role("button", name="endoscope").click()  # the arrows of both hands are apart there
    until(lambda: np.allclose(look.clients[0].camera.position, front.console.view[:3, 3], atol=1e-4), "the endoscope")
    until(lambda: look.differs(before) > 0.1, "its picture")  # a busy machine draws late
    until(lambda: look.differs(look.shot()) == 0, "the picture at rest")
    T, ecm = front.console.tool("right"), front.console.world.signals["ecm.q"]
    p, middle, other = T[:3, 3], np.array(look.at(T[:3, 3])), np.array(look.at(front.console.tool("left")[:3, 3]))
    ways = np.array([look.at(p + 1 * MM * axis) for axis in T[:3, :3].T]) - middle
    k = int(np.argmin(ways @ (other - middle)))  # the arrow that points away from the other hand
    axis, along = T[:3, k], ways[k] / np.linalg.norm(ways[k])
    start = middle + 0.6 * ARROWS * along
    look.drag(start, start + 40 * along)
    until(lambda: np.linalg.norm(front.console.tool("right")[:3, 3] - p) > 2 * MM, "the instrument follows")
    until(lambda: not front._left_to_settle, "the arrows are back")
    step = front.console.tool("right")[:3, 3] - p
    assert step @ axis > 0.95 * np.linalg.norm(step), "along the arrow"
    assert np.array_equal(front.console.world.signals["ecm.q"], ecm)


@pytest.mark.browser
def test_a_slider_opens_a_jaw_and_a_pedal_is_pressed(look):
    front = look.front
    field = look.field("left jaw")
    field.fill("50")
    field.press("Enter")
    until(lambda: abs(front.console.world.signals["psm2.q"][-1] - 40 * DEG) < 1e-6, "the jaw")
    look.page.locator("label", has_text="clutch").click()
    until(lambda: front.console.reading["mode"] == "nothing", "the clutch")
    look.page.get_by_text("the instruments are at rest").first.wait_for()
    look.page.get_by_role("button", name="Release the hands").click()
    until(lambda: front.console.owner is None, "the hands are free")
    look.page.get_by_text("No client controls").first.wait_for()


@pytest.mark.browser
def test_the_picture_goes_with_the_endoscope(look):
    front = look.front
    look.page.get_by_role("button", name="endoscope").click()
    until(lambda: np.allclose(look.clients[0].camera.position, front.console.view[:3, 3], atol=1e-4), "the endoscope")
    field = look.field("pan")
    field.fill("6")
    field.press("Enter")
    until(lambda: abs(front.console.camera_at[0] - 6 * DEG) < 1e-6, "the pan")
    until(lambda: np.allclose(look.clients[0].camera.position, front.console.view[:3, 3], atol=1e-4), "the picture")


@pytest.mark.browser
def test_a_motion_is_planned_and_made_on_the_page(look):
    from ui.test_viewer_planning import plan_here

    front, page = look.front, look.page
    mode = front.console.planning
    front.ask("hands", front.pens.release)
    plan_here(front.console, "psm2")
    page.get_by_role("button", name="left hand").click()
    until(lambda: mode.phase == "aim" and mode.ready, "the target")
    T = front._T_arrows["left"].copy()
    T[:3, 3] += 0.004 * front.console.view[:3, 0]
    front.ask("left", lambda: front._move("left", "page 1", T, True))
    until(lambda: np.allclose(front.console.moved("left"), T, atol=1e-6), "the moved target")
    page.get_by_text("Left hand: psm2 is at rest; its target follows").wait_for()
    page.get_by_role("button", name="Plan a motion").click()
    page.get_by_text("Clearance of the motion").wait_for()
    page.get_by_text("proven to be at least 4.5 mm").wait_for()
    page.get_by_role("button", name="Accept").click()
    page.get_by_text("psm2 has arrived").wait_for()
