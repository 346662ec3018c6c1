"""The headset page with a scene, in Chromium: robots in their places, each taken by the mouse, a cloth that bends."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from made import headset_page as headset
from made.cloth import Cloth
from made.room import CLOTH
from twin.cli import scenes
from twin.model.scene import load_scene
from twin.ui.headset.scene_frame import QUANTISATION_STEPS
from twin.ui.headset.stream_frames import pose_of

pytestmark = pytest.mark.browser
SCENE = "vsrs"


@pytest.fixture(scope="module")
def serving():
    server = headset.Serving(SCENE, command=("made.room",))
    yield server
    server.stop()


@pytest.fixture(scope="module")
def page(browser, serving):
    with headset.shown(browser, serving.url, draws=False) as page:
        page.until("twin.app.model.robots.every(r => r.state.protocol !== null)", "all plans")
        yield page


@pytest.fixture(scope="module")
def scene():
    return load_scene(scenes.find(SCENE))


def drawn(page):
    """Return where links are drawn in the scene's world and, of the same picture, where frame and place put them."""
    got = page("({links: twin.links(), root: twin.root(), poses: twin.poses()})")
    root = headset._matrix(got["root"])
    links = {n: np.linalg.solve(root, headset._matrix(m)) for n, m in got["links"].items()}
    return links, {n: pose_of(p) for n, p in got["poses"].items()}


def test_every_link_of_every_robot_is_drawn_in_its_place(page, scene):
    page("twin.app.ask('seek', {t: 3.3})")
    page.until("Math.abs(twin.app.model.time - 3.3) < 0.01", "the time")
    page.settled()
    links, poses = drawn(page)
    for place in scene.places:
        robot = twin.load(place.name)
        for body in robot.mechanism.bodies:
            name = f"{place.name}/{body.name}"
            np.testing.assert_allclose(
                links[name], place.T_world_base @ poses[name], atol=headset.FLOAT32, err_msg=name
            )
    assert len(links) == sum(len(twin.load(p.name).mechanism.bodies) for p in scene.places)
    assert page("twin.app.surroundings.props.children.length") > 0
    assert page("twin.app.surroundings.rings.length") == sum(len(p.ports) for p in scene.places)
    # A port is where the robot's own trocar is: the ring and the ball of the RCM are one.
    for i, place in enumerate(scene.places):
        rcm = place.T_world_base @ np.append(page(f"twin.app.model.robots[{i}].state.rcm"), 1.0)
        assert np.linalg.norm(rcm[:3] - next(iter(place.p_world_ports.values()))) < 1e-4


def test_the_cloth_is_drawn_as_it_bends(page):
    cloth, shapes = Cloth(np.array(CLOTH["corner"]), CLOTH["edge"]), []
    page.draws(True)
    for t in (0.0, 0.4, 1.35):
        page(f"twin.app.ask('seek', {{t: {t}}})")
        page.until(f"Math.abs(twin.app.model.time - {t}) < 1e-6", "the time")
        page.until("!twin.app.world.dirty", "a picture")
        seen = np.array(page("twin.field('cloth')")).reshape(-1, 3)
        wanted = cloth.at(t).fields["cloth"]
        assert np.abs(seen - wanted).max() < 0.6 * np.ptp(wanted, axis=0).max() / QUANTISATION_STEPS + 1e-6
        page.settled()
        page("twin.app.world.touch()")
        shapes.append(page.image())
    page.draws(False)
    # Where it hangs the picture changes: its colour is seen, and moves.
    teal = [(i[..., 1] > 1.3 * i[..., 0]) & (i[..., 1] > 40) for i in shapes]
    assert min(t[:, :600].sum() for t in teal) > 1500
    assert (teal[0] != teal[2]).sum() > 1500


def test_the_mouse_takes_one_robot_and_the_others_stay(page, scene):
    page("twin.app.ask('seek', {t: 0})")
    page.settled()
    _, before = drawn(page)
    for i, place in enumerate(scene.places):
        at = page(
            f"(() => {{ const g = twin.app.members[{i}].handle.group;"
            " return g.getWorldPosition(g.position.clone()).project(twin.app.world.camera).toArray(); })()"
        )
        size = page.page.viewport_size
        start = np.array([size["width"] * (1 + at[0]) / 2, size["height"] * (1 - at[1]) / 2])
        page.drag(start, start + np.array([-9, -6]), steps=6, release=False)
        assert page("twin.app.grab.held.member.model.info.name") == place.name
        assert page("twin.app.model.chosen") == i  # the controls speak of what is held
        page.until(f"twin.app.model.robots[{i}].state.holder === twin.app.model.client", "the holder")
        assert page("twin.app.model.robots.map(r => r.holding)") == [k == i for k in range(len(scene.places))]
        assert page("twin.app.model.status().text").startswith(("You hold", "Target not reached"))
        page.page.mouse.up()
        page.until("twin.app.model.robots.every(r => r.state.holder === null)", "let go")
        page.settled()
        _, after = drawn(page)
        moved = {n.split("/")[0] for n in before if not np.allclose(before[n], after[n], atol=1e-4)}
        assert moved == {place.name}
        before = after
    page.page.locator("[data-id='robot-simulation']").select_option(str(len(scene.places) - 1))
    assert page("twin.app.model.info.name") == scene.places[-1].name
    assert page.id("protocol").input_value() == scene.places[-1].protocol
