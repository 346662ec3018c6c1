"""Planning mode on the page in Chromium: move the target through the dome, plan, cancel, plan again, accept, arrive."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import PAD, console
from made.dome_console import ABOVE, dome_console
from twin.api.scene_obstacles import obstacles_in_base
from twin.cli.scenes import load
from twin.core.units import DEG, MM
from twin.reference import ReferenceModel
from twin.reference.clearance import Shape, distance_between

pytestmark = pytest.mark.browser

PLAN = "twin.app.console.plan"
FOLLOWS = "twin.app.console.move('left', 0, 0, 0) || twin.app.model.console.hands.left.follows"
ARM = "twin.app.members.find((m) => m.model.info.name === 'raven_left')"


@pytest.fixture(scope="module")
def dome(tmp_path_factory):
    return dome_console(tmp_path_factory.mktemp("dome"))


@pytest.fixture(scope="module")
def page(browser, dome):
    server = headset.Serving(str(dome.file.parent))
    try:
        with console(browser, server.url, scripts=[PAD], size=(900, 520), draws=False) as opened:
            yield opened
    finally:
        server.stop()


def q(page):
    return np.array(page(f"[...{ARM}.model.frame.q]"), float)


def move(page, way, until):
    """Move the left hand by `way` (3,) in m in the picture, until something is seen."""
    for _ in range(30):
        page(f"twin.app.console.move('left', {way[0] / 30}, {way[1] / 30}, {way[2] / 30})")
        time.sleep(0.03)
    page.until(until, f"{until}: {page(f'{PLAN}.state')}")


def begin(page):
    """Press the pedal with its key; return the joints of the arm."""
    page("twin.app.console.chosen = 'left'")
    at = q(page)
    page.page.keyboard.down("p")
    page.until(f"{PLAN}.phase === 'aim' && {PLAN}.state.ready", "the hand moves the target, the geometry is loaded")
    time.sleep(0.3)  # longer than a tap
    return at


def out(scene, page):
    """Return the way in the picture from the tip to a place above the lid, in m."""
    robots = load(scene).robots
    kin = robots["raven_left"].kinematics()
    goal = np.append([x * (MM if i == 2 else DEG) for i, x in enumerate(ABOVE)], 0.0)
    way = kin.forward(goal)[:3, 3] - kin.forward(q(page))[:3, 3]
    view = np.array(page("twin.app.console.views.scope.matrixWorld.elements")).reshape(4, 4).T[:3, :3]
    return view.T @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ way


RED = f"{PLAN}.material.color.getHex() === 0xd81b2a"


def test_a_motion_out_of_the_dome_is_planned_cancelled_planned_again_and_made(page, dome):
    page.until(FOLLOWS, "the hand moves the arm")
    at, way = begin(page), out(dome, page)
    move(page, 0.5 * way, f"{PLAN}.state.blocked !== ''")
    page.until(RED, "the ghost is red in the lid")
    assert "props/dome" in page(f"{PLAN}.state.blocked")
    move(page, 0.5 * way, f"{PLAN}.state.blocked === ''")
    page.until(f"!({RED})", "the ghost is free above the lid")
    page("window.pad.connected = true; window.pad.buttons[9] = {pressed: true, value: 1}")
    page.until("twin.app.console.pad.decides.accept", "a button that was pressed before the preview")
    page.page.keyboard.up("p")
    page.until(f"{PLAN}.motion !== null", "the preview")
    assert q(page) == pytest.approx(at, abs=1e-6), "the arm rests"
    page.until(f"{PLAN}.clearance?.proven > 0", "the proven clearance")
    page.until("!document.querySelector('[data-id=clearance]').hidden", "the plot")
    assert page(f"{PLAN}.tree !== null && {PLAN}.tree.visible && {PLAN}.path.visible")
    assert page(f"{PLAN}.phase") == "preview", "a button accepts when it is pressed, not while it is down"
    page("window.pad.buttons[9] = {pressed: false, value: 0}; window.pad.connected = false")
    told = "(plan) => { const was = plan.state.said; plan.state.said = 'a reason'; const text = plan.status().text;"
    assert page(f"({told} plan.state.said = was; return text; }})({PLAN})") == "a reason", "what is said comes first"
    page(f"{PLAN}.hear({{type: 'clearance', t: [], distance: [], proven: null, found: null, bodies: []}})")
    page.until("document.querySelector('[data-id=clearance]').hidden", "there is no plot of nothing")
    page.page.keyboard.press("Escape")
    page.until(f"{PLAN}.phase === 'off'", "cancelled")
    page.until(f"!{PLAN}.group.visible", "nothing of it is shown")
    assert q(page) == pytest.approx(at, abs=1e-6)

    begin(page)
    move(page, way, f"{PLAN}.state.blocked === ''")
    page.page.keyboard.up("p")
    page.until(f"{PLAN}.phase === 'preview'", "the second preview")
    goal = np.frombuffer(bytes(page(f"[...new Uint8Array({PLAN}.motion.poses.buffer)]")), "<f4").reshape(-1, 7)[-1]
    # the page notes the joints in each picture: this program may be late
    page(
        f"window.passed = []; (function note() {{ requestAnimationFrame(note);"
        f" if ({PLAN}.phase === 'run') window.passed.push([...{ARM}.model.frame.q]); }})()"
    )
    page.page.keyboard.press("Enter")
    page.until(f"window.passed.length > 0 && {PLAN}.phase !== 'run'", "the arm has moved")
    passed = np.array(page("window.passed"))
    page.until("twin.app.model.status().text.includes('has arrived')", "the arm has arrived")
    assert page("twin.app.model.status().tone") == "good"
    link = page(f"{ARM}.model.info.links.at(-1)")
    seen = np.array(page(f"{ARM}.robot.links.get('{link}').node.position.toArray()"))
    assert seen == pytest.approx(goal[:3], abs=0.1 * MM)
    assert len(passed) > 5
    assert clear(dome, passed) > 1 * MM


def clear(scene, passed):
    """Return the smallest distance in m of the arm from the props and the other robots, by exact geometry alone."""
    import twin

    arm = twin.load("raven_left").mechanism
    model, stills = ReferenceModel(arm), obstacles_in_base(str(scene.file), "raven_left", twin.load)
    props = [(Shape(s.name, s.name, s.body.meshes), s.T_base_body) for s in stills if s.name.startswith("props/")]
    links = [Shape(b.name, b.name, b.meshes) for b in arm.bodies if b.meshes and b.name != arm.base]
    least = np.inf
    for joints in passed:
        poses = model.solve(joints).link_poses
        for link in links:
            least = min([least, *(distance_between(link, prop, poses[link.name], T) for prop, T in props)])
    return least


CLEARANCE = {
    "type": "clearance", "robot": "raven_left", "t": [0.0, 1.0, 2.0, 3.0], "distance": [0.02, 0.01, 0.006, 0.012],
    "proven": 0.005, "found": 0.006, "bodies": ["a", "b"],
}  # fmt: skip


def rectangle(page, name):
    """Return left, top, right, bottom of a part of the page in pixels."""
    return page(
        f"(() => {{ const b = document.querySelector('[data-id={name}]').getBoundingClientRect();"
        " return [b.left, b.top, b.right, b.bottom]; })()"
    )


@pytest.mark.parametrize("size", [(1280, 800), (900, 520)])
def test_the_plot_of_the_clearance_covers_no_scoreboard(browser, size):
    server = headset.Serving("raven_dome", None, "--task", "ring")
    try:
        with console(browser, server.url, size=size, draws=False) as page:
            page.until("!document.querySelector('[data-id=score]').hidden", "the scoreboard")
            page(
                f"(() => {{ const {{ plot }} = {PLAN}; const place = plot.place.bind(plot);"
                f" plot.show({json.dumps(CLEARANCE)}, 3); plot.place = (console) => place(console, true);"
                " plot.place(twin.app.console); })()"
            )
            left, top, right, bottom = rectangle(page, "clearance")
            assert right - left >= 110
            assert bottom - top >= 60
            assert left >= 0
            assert top >= 0
            assert right <= size[0]
            assert bottom <= size[1]
            l2, t2, r2, b2 = rectangle(page, "score")
            assert right <= l2 or left >= r2 or bottom <= t2 or top >= b2, "the plot is on the scoreboard"
    finally:
        server.stop()
