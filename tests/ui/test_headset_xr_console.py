"""The console in a headset: emulated controllers and bare hands move both arms, pedals, jaws and the camera."""

from __future__ import annotations

import numpy as np
import pytest

from made import headset_page as headset
from made.console_page import ARMS, JAW, console, joints, let_go, moved, rest, seen
from twin.core.units import MM

pytestmark = pytest.mark.browser
EYES = np.array([0.0, 1.6, 1.4])
HOME = {"right": EYES + np.array([0.2, -0.35, -0.35]), "left": EYES + np.array([-0.1, -0.35, -0.35])}
"""Where the hands begin: not before the panel, which stands at the left."""


@pytest.fixture(scope="module")
def opened(browser, emulator):
    server = headset.Serving("davinci")
    start = f"emulate('vr', false); device.position.set({', '.join(map(str, EYES))})"
    with console(browser, server.url, size=(320, 240), scripts=(emulator, start), draws=False) as page:
        page.until("twin.app.xr.vr", "VR")
        page.enter()
        page.until("twin.app.hands.count === 2", "controllers")
        yield page
    server.stop()


class Tracked:
    """Two controllers or hands of the emulated headset."""

    def __init__(self, page, kind):
        self.page, self.kind = page, kind
        page(f"device.primaryInputMode = '{'controller' if kind == 'controllers' else 'hand'}'")
        self.at = {side: np.array(p, float) for side, p in HOME.items()}
        for side in ARMS:
            self.grip(side, 1.0)
            self.to(side, self.at[side])
            page(f"device.{kind}.{side}.quaternion.set(0, 0, 0, 1)")
            if kind == "hands":
                page(f"device.hands.{side}.poseId = 'default'")
        self.page.pictures(3)

    def to(self, side, p):
        self.at[side] = np.array(p, float)
        self.page(f"device.{self.kind}.{side}.position.set({p[0]}, {p[1]}, {p[2]})")

    def move(self, way, *sides, steps=4):
        """Move hands by (3,) m of the room."""
        for _ in range(steps):
            for side in sides:
                self.to(side, self.at[side] + np.array(way) / steps)
            self.page.pictures(1)
        self.page.pictures(2)

    def grip(self, side, open):
        if self.kind == "controllers":
            self.page(f"device.controllers.{side}.updateButtonValue('trigger', {1 - open})")
        else:
            self.page(f"device.hands.{side}.updatePinchValue({1 - open})")

    def take(self, *sides):
        """Shut the gripper, by which a hand begins to move its tool; open it again."""
        for side in sides:
            self.grip(side, 0.0)
        self.page.until(f"twin.app.console.hands.leading.size >= {len(sides)}", "the hands move")
        for side in sides:
            self.page.until(f"twin.app.model.console.hands.{side}.follows", f"the {side} arm follows")

    def pedal(self, name, on):
        if self.kind == "controllers":
            button, value = {"clutch": ("squeeze", int(on)), "camera": ("a-button", int(on))}[name]
            self.page(f"device.controllers.right.updateButtonValue('{button}', {value})")
        else:
            for side in {"clutch": ["right"], "camera": ["right", "left"]}[name]:
                self.page(
                    f"device.hands.{side}.poseId = '{'fist' if on else 'default'}',"
                    f"device.hands.{side}.updatePinchValue({0 if on else 1})"
                )
        mode = {"clutch": "nothing", "camera": "camera"}[name] if on else "instruments"
        self.page.until(f"twin.app.model.console.mode === '{mode}'", f"the pedals say {mode}")


@pytest.fixture(params=["controllers", "hands"])
def hands(opened, request):
    let_go(opened)
    yield Tracked(opened, request.param)
    let_go(opened)


def test_hands_move_arms_jaws_pedals_and_camera(hands):
    page = hands.page
    before = rest(page)
    hands.move([0.03, 0, 0], *ARMS)
    assert moved(before, rest(page)) == set(), "hands that have not closed a gripper move nothing"

    hands.take(*ARMS)
    assert moved(before, rest(page)) == set(), "taking an instrument does not move it"
    for side, name in ARMS.items():
        before, tip, hand = rest(page), seen(page, side), hands.at[side]

        def up(side=side, tip=tip):
            hands.move([0.0, 0.01, 0.0], side)
            return seen(page, side)[1] - tip[1] > 5 * MM

        headset.until(up, "the instrument goes up")  # where a page is silent for 0.25 s, a part of the way is lost
        assert moved(before, rest(page)) == {name}
        x, y, z = seen(page, side) - tip
        assert y < 0.5 * (hands.at[side] - hand)[1] + 0.1 * MM, "not further than the motion scale says"
        assert max(abs(x), abs(z)) < 0.3 * MM, "up in the room, before the screen, is up in the picture"

    for side, k in (("right", 0), ("left", 1)):
        hands.grip(side, 1.0)
        headset.until(lambda k=k: joints(page)[k][JAW] > 0.5, "the jaw opens")
        hands.grip(side, 0.0)
        headset.until(lambda k=k: joints(page)[k][JAW] < 0.05, "the jaw shuts")

    hands.pedal("clutch", True)
    before = rest(page)
    hands.move([0, -0.02, 0], *ARMS)
    assert moved(before, rest(page)) == set(), "clutch"
    hands.pedal("clutch", False)
    assert moved(before, rest(page)) == set(), "after the clutch the hands take hold where they are"

    hands.pedal("camera", True)
    before = rest(page)

    def pans():
        hands.move([0.02, 0, 0], *ARMS)
        return moved(before, joints(page)) == {"ecm"}

    headset.until(pans, "the camera follows")
    hands.pedal("camera", False)


@pytest.mark.parametrize("hands", ["hands", pytest.param("controllers", marks=pytest.mark.nightly)], indirect=True)
def test_a_hand_that_is_lost_lets_nothing_move(hands):
    page = hands.page
    hands.take(*ARMS)
    before = rest(page)
    see = {"controllers": "guess('left', {})", "hands": "device.hands.left.connected = !{}"}[hands.kind]
    page(see.format("true"))
    page.until("twin.app.model.status().text.includes('The left hand is not tracked')", "the page names the hand")
    page.until("twin.app.model.console.silent", "the server hears nothing")
    hands.move([0, 0.04, 0], "right")
    hands.to("left", hands.at["left"] + [0, 0.2, 0])
    assert moved(before, rest(page)) == set()
    page(see.format("false"))
    page.until("!twin.app.model.console.silent && twin.app.model.console.hands.right.follows", "the hands are back")
    assert moved(before, rest(page)) == set(), "nothing jumps to where a hand is now"

    def moves():
        hands.move([0, 0.01, 0], "right")
        return moved(before, joints(page)) == {"psm1"}

    headset.until(moves, "the right hand moves again")


@pytest.mark.parametrize("hands", ["hands", pytest.param("controllers", marks=pytest.mark.nightly)], indirect=True)
def test_a_hand_that_points_at_the_panel_moves_nothing(hands):
    page = hands.page
    hands.take("right")
    hands.grip("right", 1.0)
    page.aim(page("twin.app.xrPanel.group.position.toArray()"), kind=hands.kind)
    before = rest(page)
    for large in ("room", "scope"):
        page.press("swap", kind=hands.kind)
        assert page("twin.app.console.views.large") == large
    after = rest(page)
    assert moved(before, after) == set()
    assert after[0][JAW] == before[0][JAW], "a trigger that presses a button shuts no jaw"


def test_a_limit_is_felt_in_the_hand_that_meets_it(opened):
    page = opened
    let_go(page)
    hands = Tracked(page, "controllers")
    hands.take("right")
    page(
        "window.felt = [];"
        "for (const s of twin.app.xr.session.inputSources) {"
        " const a = s.gamepad.hapticActuators[0];"
        " a.pulse = (v, ms) => { felt.push([s.handedness, ms]); return Promise.resolve(true) } } null"
    )
    hands.move([0, -0.6, 0], "right", steps=60)  # slower than a hand can be
    page.until("twin.app.model.console.hands.right.wall !== null", "a limit")
    page.until("felt.some((pulse) => pulse[1] === 120)", "the pulse of a limit")
    page.until("felt.filter((pulse) => pulse[1] === 60).length > 2", "pulses while the force of the limit lasts")
    assert {side for side, _ in page("felt")} == {"right"}
    assert page("felt.filter((pulse) => pulse[1] === 120).length") == 1, "a limit is reached once"
    let_go(page)
    page.until("twin.app.console.forces.strength('right') === 0", "no force")


def test_each_eye_sees_through_its_lens(opened):
    """Offsets between the pictures are those of two parallel cameras: nearer ones cross, farther ones do not."""
    import twin

    stereo = twin.load_scene("davinci").cameras["endoscope"].stereo
    assert stereo is not None
    base, converge = stereo.baseline_mm * MM, stereo.converge_mm * MM
    for depth in (0.04, converge, 0.2):
        x = opened(
            f"""(() => {{
              const v = twin.app.console.views, c = v.scope;
              v.drawEyes(320, 200);
              const p = c.position.clone().set(0.004, -0.01, -{depth}).applyMatrix4(c.matrixWorld);
              return ['left', 'right'].map((e) => p.clone().project(v.eyes[e]).x);
            }})()"""
        )
        half = np.tan(np.deg2rad(70) / 2) * 320 / 200  # half the width of the picture at 1 m
        offset = base * (1 / depth - 1 / converge) / half
        np.testing.assert_allclose(x[0] - x[1], offset, atol=1e-6)
    panes = opened("Object.entries(twin.app.console.screen.panes).map(([eye, p]) => [eye, p.layers.mask])")
    assert sorted(panes) == [["left", 2], ["right", 4]], "layers 1 and 2 are those of the left and the right eye"


def test_leaving_the_session_lets_the_hands_go(opened):
    page = opened
    Tracked(page, "controllers").take("right")
    page("twin.app.xr.leave()")
    page.until("!twin.app.xr.presenting", "the session ends")
    assert page("[twin.app.console.screen.group.visible, twin.app.world.placement.visible]") == [False, True]
    assert page("twin.app.console.hands.leading.size") == 0
    page.enter()  # as it was


@pytest.mark.nightly
def test_a_button_of_a_controller_plans_a_motion_of_its_arm(opened):
    let_go(opened)
    hands, page = Tracked(opened, "controllers"), opened
    hands.take("left")
    before = rest(page)
    page("device.controllers.left.updateButtonValue('y-button', 1)")
    page.until("twin.app.console.plan.phase === 'aim'", "the hand moves the target")
    at = page("[...twin.app.console.plan.target]")
    hands.move([0, 0.02, 0], "left")
    page.until(f"twin.app.console.plan.target.some((x, i) => Math.abs(x - {at}[i]) > 0.002)", "the ghost moves")
    assert moved(before, rest(page)) == set(), "the arm rests"
    page("device.controllers.left.updateButtonValue('y-button', 0)")
    page.until("['plan', 'preview'].includes(twin.app.console.plan.phase)", "its release plans")
    assert page("twin.app.model.console.plan.robot") == "psm2"
    page("twin.app.console.plan.cancel()")
    page.until("twin.app.console.plan.phase === 'off'", "cancelled")
    assert moved(before, rest(page)) == set()
    let_go(page)
