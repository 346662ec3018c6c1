"""A procedure by hand: grippers close the jaws of tools, and the page is told what is passed, failed and next."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from made import organs as made
from twin.api.procedure import replay_procedure
from twin.cli import scenes
from twin.core import spatial
from twin.simulation import console_scene
from twin.simulation.controllers.tool_grip import HALF_GRIP, GripToTool
from twin.simulation.devices.received_hands import HandState
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.play import ProcedureGuide
from twin.simulation.world import Block, World
from twin.ui.session.exercise import Exercise
from twin.ui.session.live_console import LiveConsole

OPEN = 2 * HALF_GRIP


class Script(Block):
    """A device that plays rows of (grip in rad, whether the arm follows)."""

    def __init__(self, rows):
        self.rows = list(rows)
        self.outputs = {"right.grip": 0.0, "arm.follows": 0.0}

    def step(self, signals, t, dt):
        grip, follows = self.rows[round(t / dt)]
        return {"right.grip": float(grip), "arm.follows": float(follows)}


def jaws(*rows):
    """Return (opening, pedal) after each row."""
    world, out = World(devices=[Script(rows)], controllers=[GripToTool("right", "arm")]), []
    for _ in rows:
        world.step()
        out.append((world.signals["arm.opening"].item(), world.signals["arm.pedal"].item()))
    return out


def test_jaws_that_begin_open_wait_until_the_gripper_was_opened():
    assert jaws((0, 1), (0, 1), (OPEN, 1), (0, 1), (OPEN, 1)) == [(1, 0), (1, 0), (1, 1), (0, 0), (1, 1)]


def test_jaws_stay_as_they_are_while_the_hand_moves_no_tool_and_until_the_gripper_is_as_they_are():
    found = jaws((OPEN, 1), (0, 1), (OPEN, 0), (OPEN, 1), (0, 1), (OPEN, 1), (OPEN, 0), (0, 0), (0, 1))
    assert [o for o, _ in found] == [1, 0, 0, 0, 0, 1, 1, 1, 1]
    assert [p for _, p in found] == [1, 0, 0, 0, 0, 1, 0, 0, 0], "no energy without a hand"


def test_the_pull_of_a_trigger_that_takes_control_closes_no_clip_and_the_next_one_does():
    rows = [(0, 0), (OPEN, 0), (OPEN, 1), (OPEN, 1), (0, 1), (OPEN, 1), (0, 1)]
    assert jaws(*rows) == [(1, 0), (1, 0), (1, 0), (1, 0), (1, 0), (1, 1), (0, 0)]


def test_a_trigger_that_is_pulled_again_behind_the_clutch_keeps_the_jaws_open():
    rows = [(OPEN, 1), (OPEN, 0), (0, 0), (OPEN, 0), (OPEN, 1), (0, 1), (OPEN, 1), (0, 1)]
    assert [opening for opening, _ in jaws(*rows)] == [1, 1, 1, 1, 1, 1, 1, 0]


# -- what the page is told -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def vsrs():
    return twin.load_scene("vsrs")


class Told:
    """A guide of the cholecystectomy with signals that the test changes."""

    def __init__(self, scene):
        task, organ = scene.tasks["cholecystectomy"], made.abdomen()[1]
        p = task.goal
        clips = [f"clip_{k}.on" for k in range(1, 7)]
        self.guide = ProcedureGuide(Setup(scene, {}, task, organs=[organ]), clips, 0.016)
        names = [*scene.tools]
        self.now = {f"{r}.{what}": np.zeros(3) for r in p.start for what in ("tip", "pull", "lifted")}
        self.now |= {f"{r}.{what}": np.full(1, v) for r in p.start for what, v in (("slipped", 0.0), ("holds", -1.0))}
        self.now |= {f"{r}.carries": np.full(1, float(names.index(tool))) for r, tool in p.start.items()}
        self.now |= {f"{v.name}.cut": np.zeros(v.segments) for v in scene.vessels}
        self.now |= {"gallbladder.nodes": organ.nodes.ravel(), "liver.depth": np.zeros(1)}
        self.now |= {f"gallbladder.{what}": np.zeros(len(organ.pinned_nodes)) for what in ("energy", "freed")}
        self.now["cystic_duct.seen"] = np.zeros(1)
        self.now |= {f"{r}.follows": np.ones(1) for r in p.start}
        for clip in clips:
            self.now |= {clip: np.full(1, -2.0)}
            self.now |= {clip.replace("on", what): np.zeros(1) for what in ("at", "cover")}
        self.t = 0.0

    def run(self, seconds=1.0, **changes):
        """Change signals, and return what the page shows afterwards: (state of each check, next step)."""
        for name, value in changes.items():
            key = name.replace("__", ".")
            self.now[key] = np.broadcast_to(np.asarray(value, float), self.now[key].shape).copy()
        for _ in range(round(seconds / 0.016)):
            self.guide.see(self.now, self.t)
            self.t += 0.016
        shown = self.guide.content()
        return [state for _, state, _ in shown["stages"]], shown["next"]


def test_page_is_led_through_the_five_stages(vsrs):
    told, (done, todo) = Told(vsrs), ("done", "open")
    spared = [done, done]
    states, step = told.run()
    assert states == [todo] * 5 + spared
    assert step == "Grasper, left hand: bring its tip to the gallbladder; open its jaws, close them"
    states, step = told.run(lapbot__holds=0, lapbot__lifted=(0, 0, 0.003))
    assert step == "Lift the gallbladder with the left instrument: 3 of 8 mm"
    states, step = told.run(lapbot__lifted=(0, 0, 0.02))
    assert states == [done, *[todo] * 4, *spared]
    assert step.startswith("Hold the camera pedal")
    states, step = told.run(cystic_duct__seen=0.9)
    assert states == [done, done, *[todo] * 3, *spared]
    assert step.startswith("Clip applier, right hand: bring the cystic duct between its jaws, away from")
    for k, at in enumerate((0.021, 0.025, 0.010), 1):
        states, step = told.run(**{f"clip_{k}__at": at, f"clip_{k}__cover": 1, f"clip_{k}__on": 0})
    assert states == [done] * 3 + [todo] * 2 + spared
    assert step == "Choose Scissors for the right hand, and draw its tip back to at most 110 mm from the port"
    names = [*vsrs.tools]
    _, step = told.run(pa10__carries=names.index("scissors"))
    assert step.startswith("Scissors, right hand: bring the cystic duct between its blades")
    states, step = told.run(cystic_duct__cut=np.arange(len(told.now["cystic_duct.cut"])) == 10)
    assert states == [done] * 4 + [todo] + spared
    assert step.startswith("Choose Cautery hook for the right hand")
    _, step = told.run(pa10__carries=names.index("cautery"))
    assert "0 of 7 cells are free" in step
    _, step = told.run(gallbladder__freed=1, gallbladder__energy=20)
    assert step.startswith("Pull the gallbladder out with the left instrument")
    assert not told.guide.complete
    up = told.now["gallbladder.nodes"].reshape(-1, 3) + np.array([0, 0.05, 0.17])
    states, _ = told.run(gallbladder__nodes=up.ravel())
    assert states == [done] * 7
    assert told.guide.complete
    assert told.guide.ending == "The gallbladder is out. All checks are passed."


def test_the_clock_starts_with_the_first_motion_and_no_stage_is_passed_before_it(vsrs):
    told = Told(vsrs)
    states, step = told.run(3.0, cystic_duct__seen=0.9, pa10__follows=0, lapbot__follows=0)
    assert step.startswith("Drag an instrument to begin")
    assert states[1] == "open", "the camera sees the vessel, but nobody has moved anything"
    assert dict(told.guide.content()["rows"])["Time"] == "0.0 s"
    states, _ = told.run(1.0, pa10__follows=1)
    assert states[1] == "done"
    assert 0.8 < float(dict(told.guide.content()["rows"])["Time"].removesuffix(" s")) <= 1.0
    assert told.guide.measures().time == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("changes", "failed", "event"),
    [
        ({"cystic_duct__cut": 1}, {2, 3}, "0 clips closed the cystic duct before it was cut"),
        ({"clip_1__on": 0, "clip_1__cover": 1}, {0, 1}, "was 0.0 mm above its place when the first clip"),
        ({"clip_1__on": 1, "clip_1__cover": 1}, {0, 1, 6}, "a clip closes the common duct"),
        ({"liver__depth": 0.009}, {5}, "deepest tip 9.0 mm below"),
        ({"hepatic_artery__cut": 1}, {6}, "cuts of the hepatic artery"),
    ],
)
def test_mistake_is_shown_at_once_as_a_failed_check(vsrs, changes, failed, event):
    told = Told(vsrs)
    states, _ = told.run(0.3, **changes)
    assert {k for k, state in enumerate(states) if state == "failed"} == failed
    assert any(event in text and tone == "bad" for _, tone, text in told.guide.content()["events"])
    assert "Not passed" in told.guide.ending


# -- in the World --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_session_by_hand_is_replayed_with_the_same_bytes_and_judged(tmp_path, vsrs):
    task = vsrs.tasks["cholecystectomy"]
    live = LiveConsole(scenes.with_organs(scenes.load(vsrs), task), Exercise(task, tmp_path / "hands.session"))
    assert live.reading["hands"]["right"]["tool"] == "clip_applier"
    for k in range(60):
        pose = spatial.pose(spatial.rotation_z(0.1 * (k > 2)), [1e-4 * k, 0, -2e-4 * k])
        live.give("test", *[HandState(h, False, False, k, pose, OPEN * (k > 10)) for h in (0, 1)])
        live.advance(0.02)
    live.take_tool("test", "right", "cautery")
    live.advance(0.05)
    right = live.reading["hands"]["right"]
    assert (right["carries"], right["open"]) == ("clip_applier", True)
    assert "Cautery hook is not taken yet: draw the tip back to at most 110 mm from its port" in right["waits"]
    shown = live.feed.at(0.0).fields
    assert {"liver", "gallbladder", "cystic_duct", "gallbladder_bed"} <= set(shown)
    live.end("test")
    live.close()
    found = replay_procedure(tmp_path / "hands.session", vsrs)
    assert found.run.difference is None
    assert [c.name for c in found.measures.checks if c.done] == ["show", "organs", "vessels"]
    assert found.content()["surgeon"] == "person"


def test_settings_begin_with_the_tools_of_the_task(vsrs):
    names, task = [*vsrs.tools], vsrs.tasks["cholecystectomy"]
    found = console_scene.settings(vsrs, task=task)
    assert {n: names[int(found[f"{n}.tool"])] for n in task.goal.start} == task.goal.start
