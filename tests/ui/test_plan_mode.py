"""Planning mode of a console: the arm rests while its target is moved, follows an accepted plan, and replays it."""

from __future__ import annotations

import base64
import json
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from made.dome_console import ABOVE, dome_console
from twin.api.machine import machine_parts
from twin.cli.scenes import load
from twin.core import spatial
from twin.core.errors import AssemblyError, CancelledError, TwinError, WorldError
from twin.core.units import DEG, MM
from twin.planning.obstacle_avoidance import NoPathError
from twin.simulation.controllers.plan_states import AIM, HELD, OFF, RUN
from twin.simulation.controllers.trainer_states import TrainerMode
from twin.simulation.devices.plans import PlannedArm, Plans
from twin.simulation.devices.received_hands import HandState
from twin.simulation.machine.levels import Level
from twin.simulation.machine.state_packets import State
from twin.simulation.session import session_run as sessions
from twin.simulation.session.session_file import read_session
from twin.simulation.setup import Setup
from twin.ui.headset.client_messages import RefusedError, parse_message
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session import plan_jobs, plan_mode
from twin.ui.session.exercise import Exercise
from twin.ui.session.live_console import HeldError, LiveConsole
from twin.ui.session.plan_jobs import CheckedTarget, Clear, PlanJob, PlannedMotion, Proven, Room, TargetCheck

ARM = "raven_left"


class Here:
    """The other process, in this one: a job is done in steps when it is asked for news."""

    def __init__(self, function, nice=0):
        self.function, self.job, self.jobs = function, None, []

    def start(self, job):
        self.job = self.function(job)
        self.jobs.append(job)

    def cancel(self):
        if self.job is not None:
            self.job.close()
        self.job = None

    close = cancel

    def poll(self):
        if self.job is None:
            return [], None
        try:
            return [next(self.job)], None
        except StopIteration:
            self.job = None
            return [], ""
        except TwinError as error:
            self.job = None
            return [], str(error)


def quick(job):
    """Yield as `plan_jobs.work` does, but a straight motion of 1.5 s up, without a search."""
    if isinstance(job, TargetCheck):
        if job.q is not None:
            yield CheckedTarget("")
        return
    yield 0.5
    T = twin.load(ARM).kinematics().forward(job.start)
    Ts = np.tile(T, (1501, 1, 1))
    Ts[:, 2, 3] += np.linspace(0, 6 * MM, 1501)
    yield PlannedMotion(Ts, np.tile(np.eye(4), (10, 2, 1, 1)), ("a", "b"), np.zeros((0, 2, 3)))


@pytest.fixture(scope="module")
def dome(tmp_path_factory):
    return load(dome_console(tmp_path_factory.mktemp("dome")))


@pytest.fixture
def console(dome, monkeypatch, tmp_path):
    """A console whose plans are made by the planner, in this process."""
    monkeypatch.setattr(plan_mode, "Stream", Here)
    made = Operator(LiveConsole(dome, Exercise(session=tmp_path / "hands.session")))
    yield made
    made.console.close()


@pytest.fixture
def planned(console):
    """A console whose plans are all the same; it loads no grids of distances, which may take a minute."""
    console.mode._stream = Here(quick)
    return console


class Operator:
    """A client that moves the left hand, and the right one where it is told."""

    def __init__(self, console):
        self.console, self.number, self.at, self.roll = console, 0, np.zeros(3), 0.0
        self.right = np.zeros(3)
        self.wait(2)
        self.roll = 0.2  # a person holds the handle
        self.wait(6)
        assert console.reading["hands"]["left"]["follows"]

    def wait(self, frames, *, clutch=False, camera=False, udp=False):
        """Let frames pass; `udp`: the hands are those of packets, which do not come through the console."""
        for _ in range(frames):
            self.number += 1
            hands = [spatial.pose(spatial.rotation_z(self.roll), p) for p in (self.right, self.at)]
            states = [HandState(k, clutch, camera, self.number, T, 0.0) for k, T in enumerate(hands)]
            if udp:
                for state in states:
                    self.console.device.give(state)
            else:
                self.console.give("me", *states)
            self.console.advance(1 / 60)

    def move(self, way, frames=30, **pedals):
        """Move the left hand by `way` (3,) in m in the World."""
        step = self.console.view[:3, :3].T @ np.asarray(way) / frames
        for _ in range(frames):
            self.at = self.at + step
            self.wait(1, **pedals)

    def ask(self, do, hand="left", client="me"):
        self.console.plan(client, do, hand)

    @property
    def mode(self):
        return self.console.planning

    @property
    def q(self):
        return self.console.world.signals[f"{ARM}.q"]

    def target(self):
        return self.console.world.signals[f"{ARM}.target"][1:].reshape(4, 4)

    def until(self, phase, frames=2000):
        for _ in range(frames):
            if self.mode.phase == phase:
                return
            self.wait(1)
        raise AssertionError(f"{self.mode.phase}, not {phase}: {self.mode.state()}")


def above():
    return np.append([x * (MM if i == 2 else DEG) for i, x in enumerate(ABOVE)], 0.0)


def aimed(console):
    """Move the target above the lid."""
    console.ask("aim")
    console.wait(4)
    goal = console.console.members[ARM].kin.forward(above())
    console.move((goal - console.target())[:3, 3], 15)
    console.wait(4)
    return goal


def lifted(console):
    """Move the target by a few mm."""
    console.ask("aim")
    console.wait(2)
    console.move([3 * MM, 0, -4 * MM], 5)
    console.wait(2)


def test_the_hand_moves_the_target_and_all_arms_rest(planned):
    at = {n: planned.console.world.signals[f"{n}.q"] for n in (ARM, "raven_right", "ecm")}
    goal = aimed(planned)
    assert planned.target()[:3, 3] == pytest.approx(goal[:3, 3], abs=1 * MM)
    for name, q in at.items():
        assert np.array_equal(planned.console.world.signals[f"{name}.q"], q), name
    assert planned.mode.ghost.keys() == {b.name for b in planned.console.members[ARM].mechanism.bodies}
    assert planned.console.reading["hands"]["left"] == {
        "robot": ARM, "follows": True, "wall": None, "jumps": 0
    }  # fmt: skip


@pytest.mark.slow
def test_a_target_in_the_dome_is_blocked_with_the_bodies_and_a_free_one_is_not(console):
    console.ask("aim")
    console.wait(10)
    assert console.mode.ready
    assert not console.mode.blocked
    console.move([0, 0, 18 * MM])  # into the lid
    console.wait(6)
    assert "props/dome" in console.mode.blocked
    assert "required: 2 mm" in console.mode.blocked
    console.ask("find")
    console.until("aim")
    console.wait(30)
    assert console.mode.is_error
    assert console.mode.message.startswith("No plan: at the goal, ")
    assert "props/dome" in console.mode.message
    assert "nearest free configuration" in console.mode.message
    assert console.mode.message.endswith("; move the target, or another arm that is in the way")
    assert "clearance_mm" not in console.mode.message, "the user of a console has no protocol to change"


@pytest.mark.slow
def test_an_accepted_plan_is_followed_and_its_session_replays_without_planning(console, dome, monkeypatch):
    scene, props = dome.scene, dome.props
    q0 = console.q
    lifted(console)
    goal = console.target()
    console.ask("find")
    assert console.mode.phase == "plan"
    console.until("preview")
    assert np.array_equal(console.q, q0), "nothing moves before the plan is accepted"
    found = console.mode.preview.motion
    T_first, T_last = found.Ts[0], found.Ts[-1]
    assert T_first == pytest.approx(console.console.members[ARM].kin.forward(q0), abs=1e-9)
    assert T_last[:3, 3] == pytest.approx(goal[:3, 3], abs=0.1 * MM)
    shown = console.mode.ghost[(tool := console.console.members[ARM].mechanism.frame("tool")).body] @ tool.T_body_frame
    assert T_last == pytest.approx(shown, abs=1e-6), "the motion ends where the ghost is shown"
    speeds = np.linalg.norm(np.diff(found.Ts[:, :3, 3], axis=0), axis=1) / plan_jobs.DT
    assert speeds.max() < 0.0601
    console.ask("accept")
    console.until("off")
    assert "has arrived" in console.mode.message
    assert not console.mode.is_error
    assert console.console.members[ARM].kin.forward(console.q) == pytest.approx(T_last, abs=1e-6)
    console.wait(5)
    assert console.console.reading["hands"]["left"]["follows"], "the hand moves the arm again"
    recorder = console.console.recorder
    console.console.close()
    monkeypatch.setattr(plan_jobs, "work", None)
    session = read_session(recorder.path)
    setup = Setup(scene, console.console.members, None, props, session.head.condition)
    run = sessions.replay(session, setup, lambda what, part: None)
    assert run.difference is None
    assert run.recording[f"{ARM}.q"][-1] == pytest.approx(console.q)


def test_a_target_at_rest_is_planned_before_the_pedal_is_released(planned):
    lifted(planned)
    planned.wait(30)
    jobs = planned.mode._stream.jobs
    assert isinstance(jobs[-1], PlanJob)
    assert (planned.mode.phase, planned.mode.preview) == ("aim", None), "nothing is shown before the release"
    count = len(jobs)
    planned.ask("find")
    assert planned.mode.phase == "preview"
    assert len(jobs) == count, "nothing is searched twice"


def test_a_target_that_moves_after_its_rest_is_planned_anew(planned):
    lifted(planned)
    planned.wait(30)
    early = planned.mode._stream.jobs[-1]
    planned.move([0, 2 * MM, 0], 5)
    planned.ask("find")
    late = planned.mode._stream.jobs[-1]
    assert planned.mode.phase == "plan"
    assert not np.array_equal(early.goal, late.goal)
    T = planned.console.members[ARM].kin.forward(late.goal)
    assert T[:3, 3] == pytest.approx(planned.target()[:3, 3], abs=0.1 * MM)


def test_a_hand_that_trembles_on_its_support_rests(planned):
    lifted(planned)
    for k in range(30):
        planned.move([0.03 * MM * (-1) ** k, 0, 0], 1)
    jobs = planned.mode._stream.jobs
    assert isinstance(jobs[-1], PlanJob)
    count = len(jobs)
    for k in range(10):
        planned.move([0.03 * MM * (-1) ** k, 0, 0], 1)
    planned.ask("find")
    assert planned.mode.phase == "preview"
    assert len(jobs) == count, "nothing is tested or searched twice"


@pytest.mark.parametrize(("by", "again"), [(5e-4, 0), (0.01, 1)])
def test_an_early_plan_is_accepted_from_where_it_starts(planned, by, again):
    lifted(planned)
    planned.wait(30)
    ahead, jobs = planned.mode._early_search, planned.mode._stream.jobs
    ahead.job = replace(ahead.job, start=ahead.job.start + by)  # as measured before: a machine trembles, too
    count = len(jobs)
    planned.ask("find")
    assert len(jobs) == count + again
    assert np.array_equal(planned.mode._start, jobs[-1].start if again else ahead.job.start)


def test_the_reason_why_a_resting_target_has_no_plan_is_told_after_the_release(planned):
    def fails(job):
        if isinstance(job, PlanJob):
            raise TwinError("no path")
        yield from quick(job)

    planned.mode._stream = Here(fails)
    lifted(planned)
    planned.wait(30)
    assert not planned.mode.message
    planned.ask("find")
    jobs = len(planned.mode._stream.jobs)
    planned.wait(30)
    assert (planned.mode.phase, planned.mode.message, planned.mode.is_error) == ("aim", "No plan: no path", True)
    assert len(planned.mode._stream.jobs) == jobs, "what has no plan is not searched again"
    planned.move([0, 0, -5 * MM], 5)
    assert (planned.mode.message, planned.mode.is_error) == ("", False), "the target is elsewhere"


def test_the_geometry_is_loaded_again_after_a_plan_that_came_before_it_and_failed(planned):
    def slow(job):
        if isinstance(job, PlanJob):
            raise TwinError("no path")
        yield from [0.0] * (60 if job.q is None else 0)

    planned.mode._stream = Here(slow)
    planned.ask("aim")
    planned.wait(2)
    planned.move([3 * MM, 0, -4 * MM], 5)
    assert not planned.mode.ready
    planned.ask("find")
    planned.until("aim")
    assert planned.mode.message == "No plan: no path"
    planned.wait(70)
    assert planned.mode.ready


def test_a_target_whose_loops_cannot_be_closed_keeps_the_last_ghost(planned):
    def links(q):
        raise AssemblyError("the loops cannot be closed")

    planned.ask("aim")
    planned.wait(4)
    members, ghost = planned.console.members, planned.mode.ghost
    members[ARM] = replace(members[ARM], links=links)
    planned.move([3 * MM, 0, -4 * MM], 5)
    assert planned.mode.message == "the loops cannot be closed; the ghost stays at the last pose within reach"
    assert planned.mode.ghost is ghost
    with pytest.raises(TwinError, match="the target is where"):
        planned.ask("find")


@pytest.mark.parametrize("phase", ["aim", "plan", "preview", "run"])
def test_cancel_leaves_the_arm_where_it_is(planned, phase):
    at = planned.q
    lifted(planned)
    for step, until in (("find", "plan"), (None, "preview"), ("accept", "run")):
        if planned.mode.phase == phase:
            break
        if step:
            planned.ask(step)
        planned.until(until)
    if phase == "run":
        planned.wait(30)
        began, at = at, planned.q
        assert apart(planned, began, at) > 1.5 * MM, "a third of the motion of 6 mm is made"
    planned.ask("cancel", client="another")
    planned.wait(1)
    assert planned.mode.phase == "off"
    assert apart(planned, at, planned.q) < (0.5 * MM if phase == "run" else 1e-9)
    at = planned.q
    planned.wait(20)
    assert planned.q == pytest.approx(at, abs=1e-9), "the hand is coupled again where the arm is"
    assert planned.console.planning.plans.state == OFF


def apart(operator, q, other):
    """Return the distance in m of the tips at two joint values."""
    forward = operator.console.members[ARM].kin.forward
    return float(np.linalg.norm((forward(q) - forward(other))[:3, 3]))


@pytest.mark.slow
def test_what_was_reported_of_a_motion_stays_after_another_cancel_and_goes_with_its_world(planned):
    lifted(planned)
    planned.ask("find")
    planned.until("preview")
    planned.ask("accept")
    planned.until("off")
    planned.ask("cancel")
    assert "has arrived" in planned.mode.state()["said"]
    planned.console.referee = object()  # as with a task
    planned.console.restart("me")
    assert planned.mode.state() is None
    planned.wait(2)
    assert planned.mode.state() is None


def test_a_new_attempt_in_the_middle_of_a_motion_says_nothing_of_it(planned):
    lifted(planned)
    planned.ask("find")
    planned.until("preview")
    planned.ask("accept")
    planned.wait(6)
    planned.console.referee = object()
    planned.console.restart("me")
    assert (planned.mode.state(), planned.mode.plans.state) == (None, OFF)


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda o: o.wait(30, clutch=True), f"The motion of {ARM} was stopped by the clutch; plan again"),
        (
            lambda o: [o.console.advance(1 / 60) for _ in range(100)],
            f"The motion of {ARM} was stopped: no state of the hands was received for 1 s; plan again",
        ),
    ],
)
def test_the_clutch_and_silent_hands_stop_the_arm(planned, act, said):
    lifted(planned)
    planned.ask("find")
    planned.until("preview")
    goal = planned.mode.preview.motion.Ts[-1]
    planned.ask("accept")
    planned.wait(6)
    act(planned)
    assert planned.mode.phase == "off"
    assert planned.mode.message == said
    assert planned.mode.is_error
    T = planned.console.members[ARM].kin.forward(planned.q)
    assert np.linalg.norm((T - goal)[:3, 3]) > 0.5 * MM


def test_what_cannot_be_asked_for_is_refused_with_the_way_out(planned):
    with pytest.raises(TwinError, match="there is no target yet: press Plan"):
        planned.ask("find")
    with pytest.raises(TwinError, match="there is no plan to accept"):
        planned.ask("accept")
    with pytest.raises(HeldError, match="me controls the hands"):
        planned.ask("aim", client="another")
    planned.ask("aim")
    planned.wait(3)
    with pytest.raises(TwinError, match=f"the target is where {ARM} is: move the target away first"):
        planned.ask("find")
    with pytest.raises(TwinError, match=f"a motion of {ARM} is being planned"):
        planned.ask("aim", hand="right")
    planned.ask("cancel")
    planned.console.planning._console_scene = planned.console.table.model_copy(update={"through": [ARM]})
    with pytest.raises(TwinError, match="kept in its port by software"):
        planned.ask("aim")


def test_an_arm_that_was_moved_since_the_plan_does_not_follow_it(planned):
    lifted(planned)
    planned.ask("find")
    planned.until("preview")
    planned.mode._start = planned.mode._start + 0.01
    said = r"raven_left has moved since the plan: shoulder by 0\.57 deg \(limit 0\.057 deg\); plan again"
    with pytest.raises(TwinError, match=said):
        planned.ask("accept")


def test_a_motion_is_refused_where_another_robot_was_moved_since_the_plan(planned):
    lifted(planned)
    planned.ask("find")
    planned.until("preview")
    stands, at = planned.mode._q_others, planned.mode._q_others["raven_right"]
    stands["raven_right"] = at + np.eye(7)[2] * 2 * MM
    said = r"raven_right has moved since the plan: insertion by 2 mm \(limit 1 mm\); plan again"
    with pytest.raises(TwinError, match=said):
        planned.ask("accept")
    planned.ask("aim")
    stands["raven_right"] = at
    planned.ask("find")
    planned.until("preview")
    planned.ask("accept")
    assert planned.mode.phase == "run"


@pytest.mark.slow
@pytest.mark.parametrize("udp", [False, True])
def test_the_camera_rests_from_the_plan_to_the_end_of_the_motion(planned, udp):
    def dragged():
        at = planned.console.world.signals["ecm.q"]
        planned.wait(2, camera=True, udp=udp)
        planned.move([0, 0, 10 * MM], 5, camera=True, udp=udp)
        moved = not np.array_equal(planned.console.world.signals["ecm.q"], at)
        planned.wait(2, udp=udp)
        return moved

    lifted(planned)
    assert dragged(), "the camera moves beside a target"
    planned.move([3 * MM, 0, -4 * MM], 5)
    planned.ask("find")
    planned.until("preview")
    assert not dragged()
    planned.ask("accept")
    planned.wait(2)
    assert not dragged()
    assert planned.mode.phase == "run"
    planned.ask("cancel")
    assert dragged()


class Linked:
    """A machine that is in PEDAL_UP and does not move."""

    problem, q = "", None

    def __init__(self, q):
        zero = np.zeros(len(q))
        self.state = State(Level.PEDAL_UP, False, 1, 0.0, 0, 0, 0, 0, 0, q, q, zero)
        self.reader = SimpleNamespace(press=lambda button: None)

    def send(self, packet):
        pass


@pytest.fixture
def rehearsing(monkeypatch):
    """A console with two machines, whose models move alone."""
    monkeypatch.setattr(plan_mode, "Stream", lambda *_, **__: Here(quick))
    raven = load(twin.load_scene("raven"))
    parts = {n: machine_parts(raven.robots[n]) for n in (ARM, "raven_right")}
    machines = SimpleNamespace(parts=parts, close=lambda: None)
    machines.links = {n: Linked(parts.home) for n, parts in machines.parts.items()}
    made = Operator(LiveConsole(replace(raven, machines=machines)))
    made.console.train("me", TrainerMode.REHEARSE)
    made.wait(4)
    yield made
    made.console.close()


@pytest.mark.slow
def test_in_a_rehearsal_the_models_follow_a_plan_and_the_machines_stay(rehearsing):
    signals = rehearsing.console.world.signals
    at = {n: (signals[f"{n}.q"], signals[f"{n}.encoder"]) for n in (ARM, "raven_right")}
    rehearsing.right = np.array([0, 0, 0.02])  # the model of the other arm goes elsewhere than its machine
    rehearsing.wait(20)
    lifted(rehearsing)
    with pytest.raises(TwinError, match="a motion of raven_left is being planned: accept or cancel it first"):
        rehearsing.console.train("me", TrainerMode.JUDGE)
    rehearsing.ask("find")
    rehearsing.until("preview")
    rehearsing.ask("accept")
    with pytest.raises(TwinError, match="raven_left follows a plan: wait until it has arrived, or cancel"):
        rehearsing.console.train("me", TrainerMode.JUDGE)
    rehearsing.until("off")
    assert "has arrived" in rehearsing.mode.message
    signals = rehearsing.console.world.signals
    for name, (machine, model) in at.items():
        assert np.array_equal(signals[f"{name}.q"], machine)
        assert not np.allclose(signals[f"{name}.encoder"], model, atol=1e-3)
    rehearsing.console.train("me", TrainerMode.JUDGE)


@pytest.mark.slow
def test_pages_get_ghost_motion_and_clearance_and_a_new_page_gets_all_of_them(dome, monkeypatch):
    monkeypatch.setattr(plan_mode, "Stream", Here)
    op = ConsoleStream(dome)
    documents, bodies = [], len(op.members[ARM].mechanism.bodies)
    op.send = documents.append
    client = Operator(op)
    op.ask("me", parse_message(json.dumps({"type": "plan", "do": "aim", "hand": "left"})))
    client.move([3 * MM, 0, -4 * MM], 5)
    op.frame(1, 0.0)
    with pytest.raises(RefusedError, match="there is no plan to accept"):
        op.ask("me", parse_message(json.dumps({"type": "plan", "do": "accept", "hand": "left"})))
    assert len(floats(next(d for d in documents if d["type"] == "target")["poses"])) == 7 * bodies
    op.ask("me", parse_message(json.dumps({"type": "plan", "do": "find", "hand": "left"})))
    for tick in range(2, 400):
        client.wait(1)
        op.frame(tick, 0.0)
        if documents[-1].get("proven"):
            break
    plan, clearance = op.welcome()[1:]
    assert documents[-1] == clearance
    assert plan in documents
    assert len(floats(plan["poses"])) % (7 * bodies) == 0
    assert plan["duration"] == pytest.approx(clearance["t"][-1], abs=2e-3)
    assert 2 * MM < clearance["proven"] <= min(clearance["distance"])
    assert op.state()["console"]["plan"]["phase"] == "preview"
    op.ask("another", parse_message(json.dumps({"type": "plan", "do": "cancel", "hand": "left"})))
    op.frame(400, 0.0)
    assert documents[-1]["poses"] == ""
    assert op.welcome() == []
    op.close()


def floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


# --------------------------------------------------------------------------------------------------- the device


class Kin:
    """Equations whose tip is at the first three joints."""

    def forward(self, q):
        return spatial.pose(p=q[:3])


def signals(q, silent=0.0, mode=0.0, level=None, model=3.0, phase=0.0):
    machine = {} if level is None else {"a.run": [1.0, level, 0, 0], "a.model": [model, 0, 0], "a.phase": [phase, 0, 0]}
    plain = {"a.encoder": q, "pedals.silent": [silent], "console.mode": [mode]} | machine
    return {name: np.asarray(x, float) for name, x in plain.items()}


def line(count=101):
    return np.array([spatial.pose(p=[0.01 * k / (count - 1), 0, 0]) for k in range(count)])


def running(machine=False):
    plans = Plans("pedals", {"a": PlannedArm(Kin(), machine), "b": PlannedArm(Kin())})
    plans.aim("a")
    assert {n: x[0] for n, x in plans.step(signals([0, 0, 0]), 0.0, 1e-3).items()} == {
        "a.planned": AIM,
        "b.planned": HELD,
    }
    plans.run(line())
    return plans


def test_the_device_writes_one_pose_a_tick_and_ends_where_the_arm_is():
    plans, q, poses = running(), np.zeros(3), []
    for k in range(200):
        out = plans.step(signals(q), 1e-3 * k, 1e-3)
        if "a.planned" in out and out["a.planned"][0] == RUN:
            poses.append(out["a.planned"][1:].reshape(4, 4))
            q = poses[-1][:3, 3]
    assert np.array_equal(poses, line())
    assert plans.arrived
    assert plans.state == OFF
    assert plans.off < 0.2 * MM


def test_a_tip_beside_its_path_stops_the_motion():
    plans = running()
    plans.step(signals([0, 0, 0]), 0.0, 1e-3)
    plans.step(signals([0, 3.5 * MM, 0]), 1e-3, 1e-3)
    assert plans.state == OFF
    assert plans.why.startswith("The motion was stopped: the tip of a was 3.5 mm from its path (limit 3 mm)")


def test_an_arm_that_stays_beside_the_end_of_its_path_has_not_arrived():
    plans, q = running(), np.zeros(3)
    for k in range(1300):
        out = plans.step(signals(q), 1e-3 * k, 1e-3)
        if out.get("a.planned", [OFF])[0] == RUN:
            q = out["a.planned"][1:].reshape(4, 4)[:3, 3] - [0.5 * MM, 0, 0]
    assert plans.state == OFF
    assert not plans.arrived
    assert plans.why.startswith(
        "a did not arrive: 1 s after the last pose, its tip is 0.50 mm from the end of its path (limit 0.2 mm)"
    )


@pytest.mark.parametrize(
    ("levels", "said"),
    [
        ([2.0] * 1600, "The motion did not begin: a is in PEDAL_UP, not in PEDAL_DN"),
        ([2.0, 3.0, 3.0, 0.0], "The motion was stopped: a is in E_STOP, not in PEDAL_DN"),
        ([1.0], "The motion did not begin: a is in INIT"),
    ],
)
def test_a_machine_waits_for_pedal_dn(levels, said):
    plans = running(machine=True)
    for k, level in enumerate(levels):
        plans.step(signals([0, 0, 0], level=level), 1e-3 * k, 1e-3)
    assert plans.state == OFF
    assert said in plans.why


def test_a_machine_that_does_not_answer_is_named_so():
    plans = running(machine=True)
    plans.step(signals([0, 0, 0], level=3.0) | {"a.run": np.array([0.0, 3.0, 0, 0])}, 0.0, 1e-3)
    assert plans.state == OFF
    assert plans.why == "The motion did not begin: a does not answer; wait until it does, and plan again"


def test_in_a_rehearsal_the_model_moves_alone():
    plans = running(machine=True)
    plans.step(signals([0, 0, 0], level=2.0, model=3.0, phase=1.0), 0.0, 1e-3)
    assert plans.fraction > 0


def test_poses_that_are_not_finite_or_an_unknown_arm_are_refused():
    plans = Plans("pedals", {"a": PlannedArm(Kin())})
    with pytest.raises(WorldError, match="there is no arm for a motion of 101 poses: call `aim` first"):
        plans.run(line())
    with pytest.raises(WorldError, match="there is no arm 'c'"):
        plans.aim("c")
    plans.aim("a")
    with pytest.raises(WorldError, match="the motion of a has 0 poses; give at least 1"):
        plans.run(np.zeros((0, 4, 4)))
    poses = line()
    poses[7, 0, 3] = np.nan
    with pytest.raises(WorldError, match="the motion of a: pose 7 of 101 is not finite"):
        plans.run(poses)


# --------------------------------------------------------------------------------------------------- the work


def room(scene, number=1):
    return Room(number, str(scene.file), ARM, {})


@pytest.mark.slow
def test_the_work_yields_progress_motion_clearance_and_a_proven_bound(dome):
    scene = dome.scene
    start = np.append([50 * DEG, 114 * DEG, 378 * MM, 0, -52 * DEG, 0], 0.0)
    pieces = list(plan_jobs.work(PlanJob(room(scene), start, above(), 0.06, 45 * DEG)))
    kinds = [type(p) for p in pieces]
    assert [k for k in dict.fromkeys(kinds) if k is not float] == [PlannedMotion, Clear, Proven]
    clear = np.concatenate([p.distance for p in pieces if isinstance(p, Clear)])
    proven = pieces[-1]
    assert 1 * MM < proven.bound <= proven.computed + 1e-12
    assert proven.bound <= clear.min()
    found = next(p for p in pieces if isinstance(p, PlannedMotion))
    assert len(found.tree) > 10
    assert found.shown.shape[1:] == (len(found.links), 4, 4)
    tool, ticks = (mechanism := twin.load(ARM).mechanism).frame(mechanism.tool), plan_jobs.PREVIEW_PERIOD / plan_jobs.DT
    pictures = found.shown[:-1, found.links.index(tool.body)] @ tool.T_body_frame
    assert pictures == pytest.approx(found.Ts[np.rint(ticks * np.arange(len(pictures))).astype(int)], abs=1e-9)


def test_the_work_says_why_a_configuration_is_not_free(dome):
    (checked,) = plan_jobs.work(
        TargetCheck(room(dome.scene), np.append([50 * DEG, 135 * DEG, 378 * MM, 0, -52 * DEG, 0], 0.0))
    )
    assert isinstance(checked, CheckedTarget)
    assert checked.why == "shaft and props/dome collide (required: 2 mm apart)"


@pytest.mark.parametrize(("at_start", "way_out"), [(True, "move the arm"), (False, "move the target")])
def test_of_no_path_the_way_out_is_that_of_the_end_that_is_not_free(dome, monkeypatch, at_start, way_out):
    def none(*_, **__):
        raise NoPathError("links collide", at_start=at_start)

    monkeypatch.setattr("twin.planning.obstacle_avoidance.around", none)
    job = PlanJob(room(dome.scene), above(), above(), 0.06, 45 * DEG)
    with pytest.raises(TwinError, match=rf"links collide; .*{way_out}, or another arm that is in the way"):
        list(plan_jobs.work(job))


@pytest.mark.slow
def test_from_a_start_in_the_dome_the_arm_is_to_be_moved_and_not_the_target(dome):
    inside = np.append([50 * DEG, 135 * DEG, 378 * MM, 0, -52 * DEG, 0], 0.0)
    with pytest.raises(TwinError, match=r"at the start, .* move the arm, or another arm that is in the way"):
        list(plan_jobs.work(PlanJob(room(dome.scene), inside, above(), 0.06, 45 * DEG)))


def test_a_plan_that_is_no_longer_wanted_ends_at_once(dome, monkeypatch):
    begun, ended = [], []

    def endless(space, start, goal, *, progress, cancelled, **_):
        begun.append(threading.current_thread())
        end = time.monotonic() + 60
        while time.monotonic() < end:
            progress(0.3)
            if cancelled():
                ended.append(True)
                raise CancelledError
            time.sleep(1e-3)

    monkeypatch.setattr("twin.planning.obstacle_avoidance.around", endless)
    start = np.append([50 * DEG, 114 * DEG, 378 * MM, 0, -52 * DEG, 0], 0.0)
    asked = PlanJob(room(dome.scene), start, above(), 0.06, 45 * DEG)
    plan_jobs.work(asked).close()  # before its first piece
    assert not begun
    job = plan_jobs.work(asked)
    while not begun or next(job) != 0.3:
        next(job)
    job.close()
    assert ended == [True]
    assert not begun[0].is_alive()
