"""The page of a procedure, in Chromium: a gamepad takes out the gallbladder in five stages; a mistake is shown."""

from __future__ import annotations

import time

import numpy as np
import pytest

import twin
from made import headset_page as headset
from made.console_page import console, joints
from made.player import STEER, Player

STAGES = ["Expose the organ", "Show the vessel", "Clip it", "Cut between the clips", "Take the organ out"]
DUCT = "cystic_duct"


@pytest.fixture(scope="module")
def serving():
    server = headset.Serving("vsrs", None, "--task", "cholecystectomy")
    yield server
    server.stop()


@pytest.fixture(scope="module")
def page(browser, serving):
    with console(browser, serving.url, size=(700, 440), scripts=(STEER,), draws=False) as page:
        page.until("twin.app.loaded && twin.app.fields.vertices('cystic_duct').length > 0", "the vessels")
        yield page


@pytest.fixture
def player(page):
    scene = twin.load_scene("vsrs")
    ports = {p.name: next(iter(p.p_world_ports.values())) for p in scene.places}
    hands = page("twin.app.console.info.hands")
    return Player(page, {side: ports[names[0]] for side, names in hands.items()})


def grasp_and_lift(player):
    """Grasp the gallbladder at its end away from the duct, and lift it."""
    player.approach("left", lambda: player.fundus(DUCT))
    player.snap("left")
    player.page.until("twin.app.model.console.task.events.some(e => e[2].includes('holds the'))", "it is held")
    player.go(left=player.tip("left") + np.array([-0.010, -0.006, 0.022]))


def close_at(player, part, jaw):
    """Bring the middle of the right jaws to a part of the length of the duct, and close them."""

    def see():
        p = player.place(DUCT, part)
        return p + player.inwards("right", p) * jaw / 2

    player.approach("right", see)
    player.snap("right")


def again(page):
    """Begin a new attempt."""
    page("window.steer.left = window.steer.right = null")
    page("twin.app.console.pens.drop()")
    attempt = page("twin.app.model.console.task.attempt")
    page.until("twin.app.model.console.owner === null", "the hands are free")
    page.id("task-restart").click()
    page.until(f"twin.app.model.console.task.attempt === {attempt + 1}", "a new attempt")


@pytest.mark.browser
@pytest.mark.nightly
def test_a_gamepad_grasps_and_lifts_the_gallbladder_and_an_unplugged_one_keeps_it(page, player):
    page.until("twin.app.model.console.task.next.startsWith('Drag an instrument')", "the page says what is to be done")
    before = player.vertices("gallbladder")
    grasp_and_lift(player)
    page.until("twin.app.model.console.task.stages[0][1] === 'done'", "exposed")
    moved = np.linalg.norm(player.vertices("gallbladder") - before, axis=1)
    assert moved.max() > 8e-3, "the page draws the gallbladder where it was lifted"
    page("window.pad.connected = false")
    page.until("twin.app.console.pad.name === ''", "the pad is gone")
    headset.until(lambda: "gamepad was disconnected" in page.id("status").inner_text(), "it is told")
    page.until("twin.app.model.console.silent || !twin.app.console.pens.active", "nothing is sent")
    time.sleep(1.0)
    held, still = player.tip("left"), joints(page)
    time.sleep(1.0)
    assert all(np.array_equal(a, b) for a, b in zip(still, joints(page), strict=True)), "nothing moves"
    np.testing.assert_array_equal(player.tip("left"), held)
    assert not player.hand("left")["open"], "the jaws stay closed"
    assert not any("released" in e[2] for e in page("twin.app.model.console.task.events"))
    assert player.stages()["Expose the organ"] == "done"
    page("window.pad.connected = true")
    page.until("twin.app.console.pad.name !== ''", "the pad is back")


@pytest.mark.browser
def test_a_cut_without_clips_is_shown_as_failed_checks(page, player):
    again(page)
    player.take("right", "scissors")
    close_at(player, 0.46, 12e-3)
    page.until("twin.app.model.console.task.stages[3][1] === 'failed'", "the mistake is shown")
    states = player.stages()
    assert [states[s] for s in STAGES] == ["open", "done", "failed", "failed", "open"]
    for said in ("✗ Cut between the clips", "is open: bile leaks"):
        headset.until(lambda s=said: s in page.id("score").inner_text(), "the board shows it")
    rings = player.vertices(DUCT).reshape(-1, 2, 9, 3)
    assert (np.ptp(rings[:, :, -1], axis=1).max(axis=1) < 1e-6).any(), "the page draws the gap of the cut"


BOXES = """
(() => {
  const box = (what) => document.querySelector(what).getBoundingClientRect().toJSON();
  const lines = [...document.querySelectorAll('.score tr, .score li')].filter((o) => !o.hidden && o.offsetHeight);
  const windows = ['.score', '.tools', '.inset', '.help', '.foot', '.side', '.heading'];
  return {...Object.fromEntries(windows.map((w) => [w, box(w)])),
    cut: [...document.querySelectorAll('.help, .tool span')].some((o) => o.scrollWidth > o.clientWidth),
    lowest: Math.max(...lines.map((o) => o.getBoundingClientRect().bottom))};
})()
"""


@pytest.mark.browser
@pytest.mark.parametrize("size", [(1280, 800), (1000, 700)])
def test_no_panel_covers_another(page, size):
    again(page)

    def apart():
        b = page(BOXES)
        board, bar, side = b[".score"]["bottom"], b[".foot"]["top"], b[".side"]["left"]
        return (
            b["lowest"] <= board <= b[".inset"]["top"]
            and b[".inset"]["bottom"] < bar
            and b[".help"]["bottom"] <= bar
            and b[".help"]["top"] >= b[".side"]["bottom"]
            and b[".heading"]["right"] <= side
            and not b["cut"]
        )

    with page.sized(*size):
        headset.until(apart, f"the panels stand apart at {size}")


GALLBLADDER = """
(() => {
  const mesh = twin.app.fields.group.children.find((o) => o.name === 'gallbladder');
  mesh.geometry.computeBoundingSphere();
  const middle = mesh.geometry.boundingSphere.center.clone().applyMatrix4(mesh.matrixWorld);
  const { x, y } = twin.app.console.views.project(middle, 'scope');
  return [x, y];
})()
"""


@pytest.mark.browser
@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_the_board_hides_neither_the_gallbladder_nor_the_tools(page, player, size):
    again(page)

    def free():
        b = page(BOXES)
        x, y = page(GALLBLADDER)
        board, tools, inset = b[".score"], b[".tools"], b[".inset"]
        across = tools["top"] >= board["bottom"] and inset["top"] >= tools["bottom"]
        beside = x > board["right"] and y < tools["top"] and tools["left"] >= inset["right"]
        return tools["width"] > 300 and (across or beside)

    with page.sized(*size):
        headset.until(free, f"the panels stand apart at {size}")


@pytest.mark.browser
def test_panels_leave_most_of_the_width_to_the_picture_and_the_tabs_unfold(page):
    def wide():
        b = page(BOXES)
        return b[".heading"]["right"] <= b[".side"]["left"] and b[".score"]["right"] < 0.4 * 1280

    with page.sized(1280, 800):
        headset.until(wide, "the picture is wide")
        assert page("twin.app.world.free()[0] - twin.app.world.beside") >= 0.6 * 1280
        fold = page.id("fold")
        assert fold.get_attribute("aria-expanded") == "false"
        fold.click()
        page.id("motion-scale").wait_for()
        headset.until(lambda: page(BOXES)[".tools"]["right"] <= page(BOXES)[".side"]["left"], "the tools make room")
        fold.click()
        headset.until(lambda: not page.id("motion-scale").is_visible(), "the tabs are folded")


@pytest.mark.long
def test_a_gamepad_does_the_five_stages(page, player):
    again(page)
    begin = time.monotonic()
    told = []

    def tell(what):
        told.append(f"{what} {time.monotonic() - begin:.0f} s")

    page.until("twin.app.model.console.task.next.startsWith('Drag an instrument')", "the page says what is to be done")
    grasp_and_lift(player)
    page.until("twin.app.model.console.task.stages[0][1] === 'done'", "exposed")
    tell("exposed")
    for k, part in enumerate((0.62, 0.74, 0.3), 1):
        close_at(player, part, 10e-3)
        page.until(f"parseInt(twin.app.model.console.task.rows[1][1]) === {6 - k}", "a clip is used")
        player.back("right")
        tell(f"clip {k}")
    assert player.stages()["Clip it"] == "done", page("JSON.stringify(twin.app.model.console.task.events)")
    player.take("right", "scissors")
    tell("scissors")
    close_at(player, 0.46, 12e-3)
    page.until("twin.app.model.console.task.stages[3][1] === 'done'", "cut")
    tell("cut")
    player.take("right", "cautery")
    tell("cautery")
    while len(marks := player.marks()):
        nearest = marks[np.argmin(np.linalg.norm(marks - player.ports["right"], axis=1))]
        player.approach("right", lambda p=nearest: p)
        player.press(7)
        player.until_marks(len(marks) - 1)
        player.press(7, False)
        player.back("right")
        player.go(3e-3, left=player.tip("left") + np.array([-0.004, -0.001, 0.006]))
        tell(f"{len(marks) - 1} cells left")
    port = player.ports["left"]
    player.go(6e-3, left=port + 0.05 * player.inwards("left", player.tip("left")))
    page.until("twin.app.model.console.task.over !== null", "the end")
    tell("out")
    print(", ".join(told), "\n", dict(page("twin.app.model.console.task.rows")))
    assert [player.stages()[s] for s in STAGES] == ["done"] * 5
    page.id("result").get_by_text("All checks are passed").wait_for()


@pytest.mark.browser
def test_the_drawn_tool_is_the_one_that_the_instrument_carries(page):
    """Each kind of tool has its own shape at the tip, along the shaft; what is drawn changes with the choice."""
    ports = {p.name: next(iter(p.p_world_ports.values())) for p in twin.load_scene("vsrs").places}
    carried = "twin.app.model.console.hands.right.carries"
    page.until(f"twin.app.console.heads.drawn('right')?.tool === {carried}", "the drawn tool")
    names = page("twin.app.console.info.tools.map((t) => t.name)")
    shapes = {}
    for name in names:
        # An exchange takes the instrument out of the patient; here, the page is told that it has happened.
        tool, corners, tip, angle, robot = page(
            """((name) => {
              const { heads } = twin.app.console;
              const hand = twin.app.model.console.hands.right;
              const before = [hand.carries, hand.open];
              [hand.carries, hand.open] = [name, true];
              heads.refresh();
              const { tool, angle } = heads.drawn('right');
              hand.open = false;
              heads.refresh();
              const head = heads.shown.right;
              const corners = [];
              head.group.updateWorldMatrix(true, true);
              const at = head.group.position.clone();
              head.group.traverse((o) => {
                const corner = o.geometry?.attributes.position;
                if (!corner) return;
                for (let i = 0; i < corner.count; i++) {
                  at.fromBufferAttribute(corner, i).applyMatrix4(o.matrixWorld);
                  twin.app.world.robotWorld.worldToLocal(at);
                  corners.push(at.toArray());
                }
              });
              const tip = head.group.getWorldPosition(at);
              twin.app.world.robotWorld.worldToLocal(tip);
              [hand.carries, hand.open] = before;
              heads.refresh();
              return [tool, corners, tip.toArray(), angle, head.robot];
            })"""
            f"('{name}')"
        )
        assert tool == name
        corners, tip, port = np.array(corners), np.array(tip), ports[robot]
        along = (corners - tip) @ (tip - port) / np.linalg.norm(tip - port)
        about = page(f"twin.app.console.info.tools.find((t) => t.name === '{name}')")
        assert abs(along.max()) < 1e-3, "the jaws end at the tip"
        assert -about["jaw"] - 0.007 < along.min() < -about["jaw"]
        if about["kind"] in ("grasper", "scissors", "clip_applier"):
            assert np.isclose(2 * about["jaw"] * np.sin(angle), about["open"]), "the gap of the open jaws"
        shapes[name] = len(corners), round(float(np.ptp(corners, axis=0).max()), 5)
    assert len(set(shapes.values())) == len(names), "each has a shape of its own"
