"""Planning mode in the viewer: its buttons ask the console; ghost, path, tree, clearance and status are shown."""

from __future__ import annotations

import time
from contextlib import contextmanager

import numpy as np
import pytest

from made.dome_console import dome_console
from twin.cli.scene import load
from twin.core.units import MM
from twin.ui.session import plan_view, scene_control
from twin.ui.session.plan_mode import Preview
from twin.ui.session.plan_work import DT, SHOWN, CheckedTarget, Clear, PlannedMotion, Proven, TargetCheck
from twin.ui.viewer.console_page import ConsoleFront
from twin.ui.viewer.nodes import BLUE, RED
from twin.ui.viewer.server import serve
from ui.test_plan_mode import Here

ARM, FRAME = "raven_left", 1 / 60
LOW = 0.02
"""Distance in m below the start, from which a target counts as blocked."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return load(dome_console(tmp_path_factory.mktemp("dome")))


class Planner:
    """A planner of straight motions, of which those to more than `LOW` below the start are blocked."""

    def __init__(self, member):
        self.member, self.z = member, None

    def __call__(self, job):
        kin, links = self.member.kin, self.member.links
        if isinstance(job, TargetCheck):
            if job.q is not None:
                z = kin.forward(job.q)[2, 3]
                self.z = z if self.z is None else self.z
                yield CheckedTarget("jaw and floor are 0.10 mm apart (limit 2 mm)" if z < self.z - LOW else "")
            return
        yield 0.5
        ticks = round(2 * SHOWN / DT)
        q = job.start + np.linspace(0, 1, ticks + 1)[:, None] * (job.goal - job.start)
        poses = [links(x) for x in q[:: round(SHOWN / DT)]]
        names = tuple(poses[0])
        Ts = kin.forward_many(q)
        tree = np.stack([Ts[:3, :3, 3], Ts[1:4, :3, 3] + 0.01], axis=1)
        yield PlannedMotion(Ts, np.array([[row[n] for n in names] for row in poses]), names, tree)
        yield Clear(np.array([0.0, 0.01]), np.array([8, 6]) * MM)
        yield Clear(np.array([0.02, 0.033]), np.array([5, 7]) * MM)
        yield Proven(4.5 * MM, 5 * MM, ("jaw", "floor"))


def plan_here(console, arm):
    """Let a console make its plans by `Planner` in this process."""
    console.planning._stream.close()
    console.planning._stream = Here(Planner(console.members[arm]))


@contextmanager
def opened(scene):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_control, "_BUDGET", np.inf)
        front = ConsoleFront("test", scene, serve("test", "127.0.0.1", 0))
        plan_here(front.console, ARM)
        try:
            yield front
        finally:
            front.close()


@pytest.fixture(scope="module")
def page(scene):
    with opened(scene) as front:
        yield front


@pytest.fixture
def front(page):
    """The page, without hands and without planning."""
    page.console.planning.reset()
    page.pens.release()
    go_on(page, lambda: page._rest_time > 0.3)
    return page


def go_on(front, until=lambda: True, seconds=20.0):
    for _ in range(round(seconds / FRAME)):
        front._last = time.perf_counter() - FRAME
        front.step()
        if until():
            return
    raise AssertionError(front.console.planning.state())


def press(front, button):
    """Press a button as a page does."""
    panel = front._planning
    do = {"Target": lambda: panel._ask("page 1", "aim", "left"), "Plan": lambda: panel._again("page 1")}
    do |= {"Accept": lambda: panel._ask("page 1", "accept"), "Cancel": lambda: panel._ask("page 1", "cancel")}
    front.ask(button, do[button])
    go_on(front)


def aim(front, way):
    """Move the target of the left arm by a way in m in the World."""
    if front.console.planning.phase != "aim":
        press(front, "Target")
        go_on(front, lambda: np.allclose(front._T_arrows["left"], front.console.moved("left"), atol=1e-9))
    T = front._T_arrows["left"].copy()
    T[:3, 3] += way
    front.ask("left", lambda: front._move("left", "page 1", T, True))
    go_on(front, lambda: np.allclose(front.console.moved("left"), T, atol=1e-6))
    go_on(front, lambda: front.console.planning.ready and not front.console.planning._checks)
    return T


def usable(front):
    """Return which controls a user can press: targets, Plan, Accept, Cancel."""
    panel = front._planning
    controls = {"targets": panel._aim, "plan": panel._find, "accept": panel._accept, "cancel": panel._cancel}
    return {name for name, control in controls.items() if control.visible and not control.disabled}


def colors(front):
    return {tuple(np.asarray(handle.color)) for _, handle in front._planning._ghost.meshes}


def ghost_at(front):
    nodes = front._planning._ghost
    return {n: np.asarray(handle.position) for n, handle in nodes.bodies.items()}


def test_a_target_is_moved_by_the_arrows_and_the_arm_rests(front):
    assert usable(front) == {"targets"}
    q = front.console.world.signals[f"{ARM}.q"].copy()
    T = aim(front, (0.002, 0.0, 0.004))
    np.testing.assert_allclose(front.console.world.signals[f"{ARM}.q"], q, atol=1e-12)
    assert usable(front) == {"plan", "cancel"}
    go_on(front, lambda: np.allclose(front.arrows["left"].position, T[:3, 3], atol=1e-6))
    assert np.linalg.norm(front.console.tool("left")[:3, 3] - T[:3, 3]) > 4 * MM
    poses, seen = front.console.planning.ghost, ghost_at(front)
    assert front._planning._ghost.root.visible
    for name, T_base_body in poses.items():
        np.testing.assert_allclose(seen[name], T_base_body[:3, 3], atol=1e-6)
    assert "Move the target of raven_left; the target may pass through anything" in front._status.content
    assert "Left hand: raven_left is at rest; its target follows" in front._status.content


def test_the_ghost_is_red_where_the_target_is_not_free(front):
    aim(front, (0.0, 0.0, -1.5 * LOW))
    go_on(front, lambda: colors(front) == {RED})
    go_on(front, lambda: "Target of raven_left (red): jaw and floor are 0.10 mm apart" in front._status.content)
    aim(front, (0.0, 0.0, 1.5 * LOW))
    go_on(front, lambda: colors(front) == {BLUE})


def test_a_plan_is_shown_with_path_tree_and_clearance_then_accepted_and_made(front):
    aim(front, (0.0, 0.002, 0.003))
    press(front, "Plan")
    go_on(front, lambda: front.console.planning.phase == "preview")
    panel, mode = front._planning, front.console.planning
    go_on(front, lambda: mode.preview.proven is not None)
    go_on(front)
    found, T = mode.preview.found, front.console.place(ARM)
    tip, tree = (panel._lines[n] for n in ("tip", "tree"))
    assert tip.visible
    assert tree.visible
    world = lambda p: p @ T[:3, :3].T + T[:3, 3]  # noqa: E731
    np.testing.assert_allclose(np.asarray(tip.points)[[0, -1], [0, 1]], world(found.Ts[[0, -1], :3, 3]), atol=1e-6)
    np.testing.assert_allclose(tree.points, world(found.tree), atol=1e-6)
    assert panel._plot.visible
    np.testing.assert_allclose(panel._plot.data, [[0, 0.01, 0.02, 0.033], [8, 6, 5, 7], [4.5] * 4])
    assert (
        "Minimum clearance 5.0 mm (jaw and floor), proven to be at least 4.5 mm. Accept it, or cancel."
        in front._status.content
    )
    assert usable(front) == {"plan", "accept", "cancel"}
    assert panel._find.label == "Change the target"
    places = set()
    for _ in range(20):
        go_on(front)
        time.sleep(SHOWN / 2)
        places.add(tuple(np.round(list(ghost_at(front).values())[-1], 9)))
    assert len(places) > 1, "the ghost makes the motion"
    press(front, "Accept")
    assert mode.phase == "run"
    assert (tip.visible, tree.visible, panel._cancel.label) == (True, False, "Stop the arm")
    go_on(front, lambda: mode.phase == "off")
    go_on(front)
    assert "raven_left has arrived" in front._status.content
    np.testing.assert_allclose(front.console.tool("left")[:3, 3], world(found.Ts[-1, :3, 3]), atol=0.2 * MM)
    assert not panel._ghost.root.visible
    assert not panel._plot.visible
    assert panel._lines == {}
    assert usable(front) == {"targets"}


@pytest.mark.slow
def test_a_preview_keeps_the_hands_and_its_target_is_changed_or_cancelled(front):
    T = aim(front, (0.0, 0.0, 0.004))
    press(front, "Plan")
    go_on(front, lambda: front.console.planning.phase == "preview")
    at = front.pens.pens["left"].R.copy()
    for _ in range(round(6 / FRAME)):
        go_on(front)
    assert front.console.owner == "page 1", "idle hands are not released: a motion would stop without them"
    assert np.array_equal(front.pens.pens["left"].R, at), "a hand that rests is not turned to take an arm"
    press(front, "Plan")
    assert front.console.planning.phase == "aim"
    np.testing.assert_allclose(front.console.moved("left"), T, atol=1e-6)
    press(front, "Cancel")
    assert front.console.planning.phase == "off"
    assert not front._planning._ghost.root.visible
    go_on(front, lambda: np.allclose(front.arrows["left"].position, front.console.tool("left")[:3, 3], atol=1e-6))


def test_what_is_refused_is_told(front, monkeypatch):
    said = []
    monkeypatch.setattr("twin.ui.viewer.loop.tell", lambda server, title, text, bad: said.append((text, bad)))
    press(front, "Accept")
    assert said == [("there is no plan to accept: press Plan, and move the target", True)]
    press(front, "Target")
    press(front, "Plan")
    assert said[-1] == ("the target is where raven_left is: move the target away first", True)


@pytest.mark.slow
def test_a_target_stays_when_the_arm_had_not_reached_its_goal(scene):
    with opened(scene) as front:
        at = front._T_arrows["left"].copy()
        at[2, 3] -= 0.5
        front.ask("left", lambda: front._move("left", "page 1", at, True))
        go_on(front, lambda: front.console.reading["hands"]["left"]["wall"])
        assert not np.allclose(front.console.goal("left"), front.console.tool("left"), atol=1e-6)
        T = aim(front, (0.0, 0.002, 0.003))
        go_on(front, lambda: front._rest_time > 0.4)
        np.testing.assert_allclose(front.console.moved("left"), T, atol=1e-6)


STATE = {
    "phase": "aim",
    "hand": "left",
    "robot": "a",
    "said": "",
    "bad": False,
    "blocked": "",
    "ready": True,
    "done": 0.3,
}
PREVIEW = Preview(
    PlannedMotion(np.tile(np.eye(4), (2001, 1, 1)), np.arange(32.0).reshape(2, 1, 4, 4), ("x",), np.zeros(0))
)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"ready": False}, ("good", "Then plan a motion. The geometry is being loaded.")),
        ({"blocked": "b is near"}, ("warn", "Target of a (red): b is near.")),
        ({"phase": "plan"}, ("good", "Planning a motion of a: 30 %")),
        ({"phase": "run"}, ("good", "a follows the plan: 30 %")),
        ({"phase": "preview"}, ("good", "Motion of a, 2.0 s. The clearance is being computed. Accept it, or cancel.")),
        ({"said": "No plan: why", "bad": True}, ("bad", "No plan: why")),
        ({"said": "out of reach"}, ("warn", "out of reach")),
        ({"said": "a has arrived", "phase": "off"}, ("good", "a has arrived")),
    ],
)
def test_status_of_each_phase(changes, expected):
    tone, text = plan_view.status(STATE | changes, PREVIEW)
    assert tone == expected[0]
    assert text.endswith(expected[1])


def test_nothing_is_said_when_planning_mode_is_off():
    assert plan_view.status(None, None) is None
    assert [len(x) for x in plan_view.curve(PREVIEW)] == [0, 0]
