"""The trainer of a machine: packets that follow a goal, rehearsal, judgement, replay with checks; links and states."""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import threading
import time
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twin
from made.lanes import nightly
from twin.api.machine import machine, machine_parts
from twin.api.scene_parts import members_of
from twin.cli.machines import running
from twin.core import spatial
from twin.core.errors import DescriptionError, DeviceError, TwinError
from twin.model.scene import load_scene
from twin.simulation import console_scene, machine_scene
from twin.simulation.controllers import trainer, trainer_states
from twin.simulation.controllers.cue import Cue
from twin.simulation.controllers.packet_smoother import PacketSmoother
from twin.simulation.controllers.plan_states import HELD, RUN
from twin.simulation.controllers.tip_comparison import TipComparison
from twin.simulation.controllers.trainer import Trainer
from twin.simulation.controllers.trainer_states import (
    LONGEST_RECORD,
    TrainerLimits,
    TrainerMode,
    TrainerPhase,
    TrainerReason,
    mode_setting,
    reason_text,
)
from twin.simulation.controllers.view_switch import ViewSwitch
from twin.simulation.devices import joint_packets
from twin.simulation.devices.joint_packets import JointPackets
from twin.simulation.devices.joint_packets import pack as pack_joints
from twin.simulation.machine import machine_link, state_packets
from twin.simulation.machine.itp import number_of, pack, sequence_of, unpack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import PATIENCE, Address, MachineLink, StateReader
from twin.simulation.machine.machine_model_plant import MachineModelPlant
from twin.simulation.machine.outbox import Outbox
from twin.simulation.machine.state_packets import State
from twin.simulation.session.training import measure
from twin.simulation.setup import Setup
from twin.simulation.world import Recording, Signals
from twin.ui.session import driven_machine
from twin.ui.session.mirror import Mirror

BOUNDS = TrainerLimits(0.04, 1.5, 0.05, 0.08, 2e-3, 0.05, 3e-3)
STILL = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0.0])


@pytest.fixture(scope="module")
def robot():
    return twin.load("raven_left")


@pytest.fixture(scope="module")
def parts(robot):
    return machine_parts(robot)


@pytest.fixture(scope="module")
def scene():
    return twin.load_scene("raven")


# -- packets -------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=2, deadline=None)
@given(
    way=st.tuples(*(st.floats(-0.01, 0.01) for _ in range(3))),
    turn=st.tuples(*(st.floats(-0.4, 0.4) for _ in range(3))),
    jaw=st.floats(0, 0.5),
)
def test_increments_lead_to_the_goal_within_the_limits(way, turn, jaw):
    start, goal = np.eye(4), spatial.pose(spatial.exp_so3(turn), way)
    smooth = PacketSmoother(BOUNDS, 1e-3, 1e-3)
    smooth.begin(start, 0.0)
    p, R, opened = np.zeros(3), np.eye(3), 0.0
    for _ in range(1000):
        v = unpack(pack(1, 0, smooth.values(goal, jaw)), 0, 0).values  # as the machine gets it
        assert np.linalg.norm(v[:3]) <= 40 + 2
        step = spatial.matrix_from_quat_wxyz(v[3:7])
        assert spatial.rotation_angle(step) <= 1.5e-3 + 1e-9
        p, R, opened = p + 1e-6 * v[:3], step @ R, opened + 1e-3 * v[7]
    assert np.abs(p - way).max() <= 1e-6
    assert spatial.rotation_angle(R @ goal[:3, :3].T) <= 1e-6
    assert abs(opened - jaw) <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("side", nightly(["raven_left", "raven_right"], every=2))
def test_a_goal_that_jumps_does_not_make_the_model_too_fast(scene, side):
    """As a hand does whose page stalls: no rehearsal is refused for the speed that this gives."""
    parts, bounds = machine_parts(twin.load(side)), machine_scene.trainer_limits(scene.trainer)
    model, random, fastest = MachineModelPlant("arm", parts, Cue(), parts.home), np.random.default_rng(1), 0.0
    at_rest = {
        "arm.phase": [TrainerPhase.REHEARSE, 0, 0],
        "arm.measured": parts.home,
        "arm.run": [1.0, Level.PEDAL_UP, 0, 0],
    }
    signals = Signals({"arm.given": np.append(STILL, 0.0), **at_rest, **model.outputs})
    start, smooth = parts.kin.forward(parts.home), PacketSmoother(bounds, 1e-3, 1e-3)
    smooth.begin(goal := start, 0.0)
    for k in range(3000):
        if k >= 300 and random.uniform() < 1 / 100:
            way = random.normal(size=3)
            goal = spatial.pose(start[:3, :3], start[:3, 3] + random.uniform(3e-3, 0.01) * way / np.linalg.norm(way))
        signals.view("arm.given")[:9] = smooth.values(goal, 0.0) if k >= 300 else np.append(STILL[:8], 1.0)
        _, speed, held = model.step(signals, 1e-3 * k, 1e-3)["arm.model"]
        fastest = max(fastest, speed)
    assert held == 0
    assert 0.03 < fastest < bounds.rehearsed


# -- the trainer ---------------------------------------------------------------------------------------


class MovableRobot:
    """A trainer with signals that a test sets, and the time."""

    def __init__(self, parts):
        self.q = parts.home
        kin = parts.kin
        angles = np.array([j.is_angle for j in parts.arm.mechanism.active])
        self.trainer = Trainer("arm", "pedals", BOUNDS, 1e-3, TipComparison(kin, angles), 1e-3)
        self.signals = Signals(
            {
                "pedals.training": 0.0,
                "pedals.silent": 0.0,
                "console.mode": 0.0,
                "arm.goal": kin.forward(self.q).ravel(),
                "arm.follows": 1.0,
                "arm.planned": np.zeros(17),
                "arm.jaw": 0.0,
                "arm.run": [1.0, Level.PEDAL_DN, 0, 0],
                "arm.measured": self.q,
                "arm.model": [float(Level.PEDAL_DN), 0.0, 0.0],
                "arm.deviation": [0.0, 0.0],
                "arm_model.q": self.q,
            }
        )
        self.t = 0.0

    def set(self, name, value, at: int | slice = slice(None)):
        self.signals.view(name)[at] = value

    def step(self, ticks=1):
        """Return phase, reason, value, and both packets of the last tick."""
        for _ in range(ticks):
            out = self.trainer.step(self.signals, self.t, 1e-3)
            self.t += 1e-3
        phase, why, value = np.asarray(out["arm.phase"])
        return TrainerPhase(int(phase)), TrainerReason(int(why)), float(value), out["arm.packet"], out["arm.given"]

    def ask(self, mode):
        self.set("pedals.training", mode)
        return self.step()

    def rehearse(self, way=0.01, fastest=0.01, ticks=400):
        """Rehearse a motion along x, and judge it."""
        self.ask(TrainerMode.REHEARSE)
        goal = self.signals["arm.goal"].reshape(4, 4).copy()
        goal[0, 3] += way
        self.set("arm.model", fastest, 1)
        self.set("arm.goal", goal.ravel())
        self.step(ticks)
        return self.ask(TrainerMode.JUDGE)


@pytest.fixture
def movable(parts):
    return MovableRobot(parts)


def test_both_get_the_same_packets_and_the_model_begins_where_the_machine_is(movable):
    _, _, _, machine_gets, model_gets = movable.step()
    assert model_gets[9] == 1
    np.testing.assert_array_equal(machine_gets, model_gets[:9])
    assert movable.step()[4][9] == 0


def test_a_plan_moves_both_without_a_hand(movable):
    movable.set("arm.follows", 0.0)
    assert np.array_equal(movable.step()[3], STILL)
    movable.set("arm.planned", RUN, 0)
    for goal in (0.0, 5e-3):
        T = movable.signals["arm.goal"].reshape(4, 4).copy()
        T[0, 3] += goal
        movable.set("arm.goal", T.ravel())
        machine_gets, model_gets = movable.step(10)[3:]
        assert machine_gets[8] == 1
        np.testing.assert_array_equal(machine_gets, model_gets[:9])
    assert machine_gets[0] > 0, "towards the goal"
    movable.set("arm.planned", HELD, 0)
    assert np.array_equal(movable.step()[3], STILL)


def test_increments_wait_until_both_are_ready(movable):
    movable.step()
    movable.set("arm.goal", (movable.signals["arm.goal"].reshape(4, 4) + np.diag([0, 0, 0, 0.0])).ravel())
    goal = movable.signals["arm.goal"].reshape(4, 4).copy()
    goal[1, 3] += 0.01
    movable.set("arm.goal", goal.ravel())
    movable.set("arm.run", Level.PEDAL_UP, 1)
    phase, _, _, machine_gets, _ = movable.step(100)
    assert phase == TrainerPhase.TELEOPERATE
    assert machine_gets[8] == 1
    assert not machine_gets[:3].any()
    movable.set("arm.run", Level.PEDAL_DN, 1)
    assert movable.step(50)[3][:3].any()


def test_a_rehearsal_moves_the_model_only(movable):
    movable.step()
    phase, why, _, machine_gets, _ = movable.rehearse()
    assert (phase, why) == (TrainerPhase.JUDGED, TrainerReason.NOTHING)
    np.testing.assert_array_equal(machine_gets, STILL)
    moved = sum(v[0] for v in movable.trainer._record)
    assert moved == pytest.approx(1e4, abs=30)


def test_a_rehearsal_is_stopped_at_the_longest_record(movable, monkeypatch):
    for module in (trainer, trainer_states):
        monkeypatch.setattr(module, "LONGEST_RECORD", 0.2)
    movable.step()
    movable.ask(TrainerMode.REHEARSE)
    goal = movable.signals["arm.goal"].reshape(4, 4).copy()
    goal[0, 3] += 0.05
    movable.set("arm.goal", goal.ravel())
    assert movable.step(199)[:2] == (TrainerPhase.REHEARSE, TrainerReason.NOTHING)
    found = movable.step()
    assert found[:3] == (TrainerPhase.REHEARSE, TrainerReason.FULL, 0.2)
    assert text_of(found).startswith("the rehearsal was stopped: the record of arm is 0.2 s long (limit 0.2). Press Ju")
    np.testing.assert_array_equal(found[4][:9], STILL)  # the model is at rest, where the record ends
    movable.set("arm.model", 3.0, 2)  # not a part of the record
    movable.step(300)
    movable.set("arm.model", 0.0, 2)
    assert len(movable.trainer._record) == 200
    assert movable.ask(TrainerMode.JUDGE)[:2] == (TrainerPhase.JUDGED, TrainerReason.NOTHING)
    assert movable.ask(TrainerMode.REPLAY)[0] == TrainerPhase.REPLAY


def test_a_good_record_is_replayed_as_it_was(movable):
    movable.step()
    movable.rehearse()
    record = [v.copy() for v in movable.trainer._record]
    phase, _, _, _, model_gets = movable.ask(TrainerMode.REPLAY)
    assert phase == TrainerPhase.REPLAY
    assert model_gets[9] == 1  # the model begins where the machine is
    sent = []
    while phase == TrainerPhase.REPLAY:
        phase, _, _, machine_gets, model_gets = movable.step()
        np.testing.assert_array_equal(machine_gets, model_gets[:9])
        sent.append(machine_gets)
    assert phase == TrainerPhase.DONE
    np.testing.assert_array_equal(sent[: len(record)], record)


def test_a_replay_waits_for_the_hands_and_then_gives_up(movable):
    """A page sends its hands again when the replay is asked for."""
    movable.step()
    movable.rehearse()
    movable.set("pedals.silent", 1)
    movable.ask(TrainerMode.REPLAY)
    assert movable.step(500)[0] == TrainerPhase.REPLAY
    assert movable.step(600)[:2] == (TrainerPhase.STOPPED, TrainerReason.OPERATOR)
    movable.set("pedals.silent", 0)
    movable.ask(mode_setting(TrainerMode.REPLAY, 1))  # asked for again
    assert movable.step(200)[0] == TrainerPhase.REPLAY


def test_a_replay_waits_for_the_machine_and_then_gives_up(movable):
    movable.step()
    movable.rehearse()
    movable.set("arm.run", Level.PEDAL_UP, 1)
    movable.ask(TrainerMode.REPLAY)
    phase, _, _, machine_gets, _ = movable.step(500)
    assert phase == TrainerPhase.REPLAY
    assert not machine_gets[:3].any()
    assert movable.step(600)[:2] == (TrainerPhase.STOPPED, TrainerReason.NOT_READY)


def text_of(found):
    return reason_text(found[1], found[2], BOUNDS, "arm")


@pytest.mark.parametrize(
    ("prepare", "expected"),
    [
        (lambda d: None, "there is no record of arm: rehearse first"),
        (lambda d: d.rehearse(fastest=0.09), "the record of arm has not passed its check"),
        (
            lambda d: (d.rehearse(), d.set("arm.measured", d.q[0] + 0.04, 0)),
            r"arm is \d\.\d mm from where the record begins \(limit 2\): move it to the start by teleoperation, or re",
        ),
        (
            lambda d: (d.rehearse(), d.set("arm.measured", d.q[3] + 0.1, 3)),
            r"a joint of arm is 5\.7 deg from where the record begins \(limit 2\.\d+\)",
        ),
        (
            lambda d: (d.rehearse(), d.set("arm.run", Level.E_STOP, 1)),
            r"arm is not ready \(run level E_STOP\): press its start button",
        ),
    ],
)
def test_a_replay_is_refused_with_what_to_do(movable, prepare, expected):
    movable.step()
    prepare(movable)
    found = movable.ask(TrainerMode.REPLAY)
    assert found[0] == TrainerPhase.STOPPED
    assert re.search(expected, text_of(found)), text_of(found)
    np.testing.assert_array_equal(found[3], STILL)


@pytest.mark.parametrize(
    ("signal", "value", "at", "expected"),
    [
        ("arm.deviation", 3.1e-3, 0, "was 3.1 mm from its model (limit 3)"),
        ("arm.deviation", 0.09, 1, "moved at 90 mm/s (limit 80)"),
        ("arm.run", Level.E_STOP, 1, "left PEDAL_DN (run level E_STOP)"),
        ("arm.run", 0.0, 0, "no state of arm was received for 0.5 s"),
        ("console.mode", 1.0, 0, "by the clutch"),
    ],
)
def test_a_replay_is_stopped(movable, signal, value, at, expected):
    movable.step()
    movable.rehearse()
    movable.ask(TrainerMode.REPLAY)
    movable.step(20)
    movable.set(signal, value, at)
    found = movable.step()
    assert found[0] == TrainerPhase.STOPPED
    assert expected in text_of(found)
    np.testing.assert_array_equal(found[3], STILL)


def test_hands_that_are_silent_for_long_stop_a_replay(movable):
    movable.step()
    movable.rehearse(ticks=1500)
    movable.ask(TrainerMode.REPLAY)
    movable.step(100)
    movable.set("pedals.silent", 1)
    movable.set("console.mode", 1)  # as the pedals say of silent hands
    assert movable.step(900)[0] == TrainerPhase.REPLAY
    assert "the hands were silent for 1 s" in text_of(movable.step(150))


def test_a_fast_record_and_one_out_of_reach_are_judged_bad(movable):
    movable.step()
    found = movable.rehearse(fastest=0.06)
    assert "moved at 60 mm/s (limit 50)" in text_of(found)
    movable.ask(TrainerMode.TELEOPERATE)
    movable.ask(TrainerMode.REHEARSE)
    movable.step(10)
    movable.set("arm.model", 3.0, 2)
    assert "3 packets had a target out of reach" in text_of(movable.ask(TrainerMode.JUDGE))


def test_a_tap_of_the_camera_pedal_changes_the_view():
    switch, signals, seen = ViewSwitch("pedals", 0.25), Signals({"pedals.camera": 0.0}), []
    for k in range(900):
        signals.view("pedals.camera")[0] = 100 <= k < 200 or 300 <= k < 700
        seen.append(switch.step(signals, k * 1e-3, 1e-3)["console.view"])
    assert seen[:200] == [0.0] * 200
    assert set(seen[200:]) == {1.0}  # the long press moves the camera


# -- model and cue -------------------------------------------------------------------------------------


@pytest.mark.parametrize("before", [0, 2**32 - 150])
def test_a_late_state_is_compared_with_the_model_after_the_same_packet(parts, before):
    """A machine that is its model, 30 ms away, does not deviate while it moves, nor after the largest number."""
    arm = machine(parts)
    arm.stand(parts.home)
    plant = MachineModelPlant("arm", parts, Cue(), parts.home)
    plant._sent = plant._given = before
    signals = Signals(
        {
            "arm.given": np.append(STILL, 0.0),
            "arm.phase": [0.0, 0, 0],
            "arm.measured": parts.home,
            "arm.run": [1.0, Level.PEDAL_UP, 0, 0],
            **plant.outputs,
        }
    )
    waiting, apart, far = [], [], 0.0
    for k in range(400):
        values = np.array([round(20 * np.sin(k / 60)), 0, 0, 1, 0, 0, 0, 0, 1.0]) if k > 10 else np.append(STILL[:8], 1)
        signals.view("arm.given")[:9] = values
        number = number_of(before + k + 1)
        waiting.append((number, pack(number, 0, values)))
        if k >= 15:
            number, data = waiting.pop(0)
            arm.step(k * 1e-3, [(data, "master")])
            signals.view("arm.measured")[:] = arm.q
            signals.view("arm.run")[:] = 1.0, arm.plc.level, number, k
        out = plant.step(signals, k * 1e-3, 1e-3)
        apart.append(out["arm.deviation"][0])
        far = max(far, np.abs(out["arm_model.q"] - arm.q).max())
        assert not out["arm.cue"].any()
    assert far > 1e-3  # the model is ahead
    assert max(apart) < 1e-5


def test_packets_are_numbered_beyond_the_largest_number(parts):
    outbox, signals = Outbox({"arm": parts}), Signals({"arm.packet": STILL})
    outbox._count = 2**32 - 2
    for k in range(2):
        outbox.step(signals, k * 1e-3, 1e-3)
    assert [sequence_of(data) for data in outbox.take()["arm"]] == [2**32 - 1, 1]


def test_the_cue_is_in_the_axes_of_the_picture():
    base = spatial.pose(spatial.rotation_z(0.3), [1, 2, 3])
    view = spatial.pose(spatial.exp_so3([0.2, -0.4, 0.1]), [0, 0, 1])
    signals = Signals({"haptics.on": 1.0, "arm.cue": [0.1, 0.2, -0.3], "camera.view": view.ravel()})
    hand = machine_scene.CueHand("left", "camera", {"arm": base})
    force = hand.step(signals, 0.0, 1e-3)["left.force"]
    np.testing.assert_allclose(view[:3, :3] @ force, base[:3, :3] @ [0.1, 0.2, -0.3], atol=1e-12)
    signals.view("haptics.on")[0] = 0
    assert not hand.step(signals, 0.0, 1e-3)["left.force"].any()


def test_an_arm_that_is_put_somewhere_stands_there(parts):
    arm = machine(parts)
    q = parts.home + np.array([0.1, -0.1, 0.01, 0, 0, 0, 0.1])
    arm.stand(q)
    for k in range(20):
        arm.step(k * 1e-3)
    assert arm.plc.level == arm.level == Level.PEDAL_UP
    assert np.abs(arm.plant.q - q).max() < 1e-6
    for k in range(20, 60):
        arm.step(k * 1e-3, [(pack(k, 0, np.append(STILL[:8], 1)), "master")])
    assert arm.level == Level.PEDAL_DN
    assert np.abs(arm.plant.q - q).max() < 1e-3


# -- the scene -----------------------------------------------------------------------------------------


def test_the_scene_has_a_model_beside_each_machine(scene):
    assert [p.name for p in scene.models] == ["raven_left_model", "raven_right_model"]
    assert {p.name for p in scene.parameters} >= {"trainer start", "trainer deviation", "trainer cue limit"}


BOTH = 'robots = ["raven_left", "raven_right"]'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (BOTH, 'robots = ["ecm"]', r"scene.toml:\d+: .*there is no robot of a hand 'ecm'"),
        (BOTH, 'robots = ["raven_left", "raven_left"]', "'raven_left' is listed twice"),
        ("start_mm = 2", "start_mm = 0", "start_mm"),
        ('name = "ecm"\nrobot', 'name = "raven_left_model"\nrobot', "reserved for the model of 'raven_left'"),
    ],
)
def test_a_wrong_trainer_is_refused(scene, tmp_path, old, new, message):
    text = scene.file.read_text()
    assert old in text
    text = text.replace(old, new)
    if "raven_left_model" in new:
        text = text.replace('robot = "ecm"', 'robot = "raven_left_model"')
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(DescriptionError, match=message):
        load_scene(tmp_path / "scene.toml")


def test_the_identity_has_the_limits_of_the_trainer(scene, robot):
    robots = {p.name: twin.load(p.robot) for p in console_scene.led_by(scene)}
    setup = Setup(scene, members_of(robots))
    other = replace(scene, trainer=scene.trainer.model_copy(update={"start_mm": 3.0}))
    assert console_scene.identity(setup) != console_scene.identity(replace(setup, scene=other))


# -- states and links ----------------------------------------------------------------------------------

Q = np.linspace(0.1, 0.7, 7)
STATE = State(Level.PEDAL_DN, True, 12, 0.012, 34, 30, 4, 1, 2, Q, Q + 0.01, 100 * Q)


def test_a_state_comes_back():
    data = state_packets.pack(STATE)
    assert len(data) == state_packets.size(7) == 216
    back = state_packets.unpack(data, 7)
    for name in ("level", "pedal", "tick", "t", "sequence", "accepted", "refused", "held", "late"):
        assert getattr(back, name) == getattr(STATE, name)
    for name in ("q", "wanted", "dac"):
        np.testing.assert_array_equal(getattr(back, name), getattr(STATE, name))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (lambda d: d[:40], "a state has 40 bytes; 216 are expected"),
        (lambda d: b"HTTP" + d[4:], r"begins with b'HTTP'.*is this the port of states\?"),
        (lambda d: d[:4] + b"\x02" + d[5:], "version 2; this twin reads version 1"),
        (lambda d: d[:7] + b"\x06" + d[8:], "the machine has 6 joints; the robot has 7"),
        (lambda d: d[:5] + b"\x09" + d[6:], "the run level is 9; it must be 0 to 3"),
        (lambda d: d[:48] + b"\xff" * 8 + d[56:], "not finite"),
        (lambda d: d + b"\x00", "217 bytes"),
    ],
)
def test_a_wrong_state_is_refused(data, message):
    with pytest.raises(DeviceError, match=message):
        state_packets.unpack(data(state_packets.pack(STATE)), 7)


def test_a_pedal_that_is_up_can_be_packed(parts):
    arm = machine(parts)
    arm.step(0.0, [(pack(1, 0, STILL), "master")])
    r = arm.receiver
    counts = (r.sequence, r.accepted, r.refused, arm.held, 0)
    packed = state_packets.pack(State(arm.plc.level, r.pedal(0.0), 1, 0.0, *counts, arm.q, arm.wanted, arm.dac))
    assert not state_packets.unpack(packed, 7).pedal


class Sender:
    """A listening port that sends what a test gives to the first connection."""

    def __enter__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port, self.peer, self.ready = self.listener.getsockname()[1], None, threading.Event()
        self.thread = threading.Thread(target=self._accept, daemon=True)
        self.thread.start()
        return self

    def _accept(self):
        with contextlib.suppress(OSError):  # nobody has connected until the end
            self.peer = self.listener.accept()[0]
            self.ready.set()

    def send(self, *sent):
        assert self.ready.wait(60)
        assert self.peer
        for state in sent:
            self.peer.sendall(state if isinstance(state, bytes) else state_packets.pack(state))

    def __exit__(self, *_):
        self.listener.shutdown(socket.SHUT_RDWR)  # ends `accept`, whose thread may not yet have stored the connection
        self.thread.join()
        self.listener.close()
        if self.peer is not None:
            self.peer.close()


@pytest.fixture
def patient(monkeypatch):
    """Readers of states, and of joint values, for which a pause of the computer is no silence."""
    monkeypatch.setattr(machine_link, "PATIENCE", 60.0)
    monkeypatch.setattr(joint_packets, "PATIENCE", 60.0)


def soon(condition):
    end = time.monotonic() + 60
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.002)
    return found


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (replace(STATE, tick=13, t=0.011), r"the clock of the machine went back from 0\.012 s"),
        (replace(STATE, tick=5, t=0.013), "the clock of the machine went back"),
        (b"\x00" * 216, "a state begins with"),
    ],
)
def test_a_reader_stops_at_a_wrong_state(second, message, patient):
    with Sender() as sender:
        reader = StateReader("127.0.0.1", sender.port, 7)
        sender.send(STATE)
        soon(lambda: reader.answers)
        sender.send(second)
        assert re.search(message, soon(lambda: reader.problem))
        assert not reader.answers
        reader.close()


def test_each_state_is_heard_once_and_in_order():
    """As tests/benchmarks/machine_cue.py does, whose times are those of every state, not only of the newest."""
    with Sender() as sender:
        reader, heard = StateReader("127.0.0.1", sender.port, 7), []
        reader.heard = lambda state: heard.append(state.tick)
        sent = [replace(STATE, tick=STATE.tick + k, t=STATE.t + 1e-3 * k) for k in range(4)]
        for state in sent:
            sender.send(state)
        soon(lambda: len(heard) == 4)
        assert heard == [state.tick for state in sent]
        reader.close()


def test_the_benchmarks_use_what_the_reader_of_states_has():
    """A benchmark that replaces an attribute which is not read measures nothing; it once did so."""
    text = (Path(__file__).parents[1] / "benchmarks/machine_cue.py").read_text(encoding="utf-8")
    used = set(re.findall(r"link\.reader\.(\w+)", text))
    assert used == {"heard", "press"}
    with Sender() as sender:
        reader = StateReader("127.0.0.1", sender.port, 7)
        assert not [name for name in used if not hasattr(reader, name)]
        reader.close()


def test_a_pause_of_the_reading_program_is_no_silence_of_the_machine(monkeypatch):
    """States that arrived in the pause are read after it, late; the machine sent them in time."""
    with Sender() as sender:
        reader = StateReader("127.0.0.1", sender.port, 7)
        sent = count()

        def answers(pause=0.0):
            """Whether the reader answers after a state; if this program really pauses, the next one is tried."""
            k = next(sent)
            sender.send(replace(STATE, tick=STATE.tick + k, t=STATE.t + 1e-3 * k))
            soon(lambda: reader.newest and reader.newest.tick == STATE.tick + k)
            with monkeypatch.context() as patch:
                late = time.monotonic() + pause
                patch.setattr(time, "monotonic", lambda: late)
                return reader.answers

        soon(lambda: answers(10 * PATIENCE))
        soon(lambda: not reader.answers)  # now it is really silent
        soon(answers)
        reader.close()


def test_a_machine_that_has_gone_and_one_that_was_never_there(patient):
    with Sender() as sender:
        reader = StateReader("127.0.0.1", sender.port, 7)
        sender.send(state_packets.pack(STATE)[:100], state_packets.pack(STATE)[100:])  # in two pieces
        soon(lambda: reader.answers)
        assert sender.peer
        sender.peer.close()
        assert "the machine has closed the connection" in soon(lambda: reader.problem)
        reader.close()
        port = sender.port
    with pytest.raises(DeviceError, match=rf"no machine sends states at 127.0.0.1:{port}: .*twin machine"):
        StateReader("127.0.0.1", port, 7)


def test_another_master_is_named(patient):
    """The machine accepts nothing of this master, and refuses each packet."""
    with Sender() as sender:
        link = MachineLink(Address("127.0.0.1", 9, sender.port), 7)
        sender.send(replace(STATE, tick=13, t=0.013))
        soon(lambda: link.state)
        assert link.problem == ""
        sender.send(replace(STATE, tick=14, t=0.014, refused=80))
        soon(lambda: link.reader.newest and link.reader.newest.tick == 14)
        assert re.search("another program controls it.*`master_timeout`", link.problem)
        link.close()


SO_TIMESTAMPNS = 35
"""Option of a socket of Linux: each packet has the time in ns at which it was sent to this machine."""


def received(udp):
    """Return (sequence number, time in s) of a packet; the time is the kernel's, as this program may be late."""
    data, ((_, _, stamp), *_), *_ = udp.recvmsg(200, socket.CMSG_SPACE(16))
    seconds, nanoseconds = struct.unpack("@ll", stamp)
    return unpack(data, 0, 0).sequence, seconds + 1e-9 * nanoseconds


def test_packets_go_out_one_each_millisecond():
    with Sender() as sender, socket.socket(type=socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        udp.settimeout(60)
        udp.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        link = MachineLink(Address("127.0.0.1", udp.getsockname()[1], sender.port), 7)
        for k in range(10):
            link.send(pack(k + 1, 0, STILL))
        came = [received(udp) for _ in range(10)]
        assert [n for n, _ in came] == list(range(1, 11))
        assert came[-1][1] - came[0][1] > 4e-3  # not all at once
        link.close()


def test_a_page_that_paused_leaves_room_so_that_no_two_packets_go_out_at_once(monkeypatch):
    """After a pause, a page may add `room` packets; the machine would move twice as fast by two in a millisecond."""
    with Sender() as sender, socket.socket(type=socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        link = MachineLink(Address("127.0.0.1", udp.getsockname()[1], sender.port), 7)
        link._ends.set()
        link._thread.join()

        class Master:
            def __init__(self, link, parts):
                self.rest = lambda: None

            def step(self, ticks):
                for _ in range(ticks):
                    link.send(pack(1, 0, STILL))

        monkeypatch.setattr(driven_machine, "MachineLink", lambda address, n: link)
        monkeypatch.setattr(driven_machine, "MachineMaster", Master)
        driven = driven_machine.DrivenMachine(None, SimpleNamespace(home=np.zeros(7)))
        sent = []
        monkeypatch.setattr(link, "_send_one", lambda: sent.append(link._waiting.popleft()))
        monkeypatch.setattr(time, "sleep", lambda seconds: link._ends.set())
        for passed in (1 / 60, 0.5, 0.5, 0.5):
            driven.advance(passed, None, False)
            link._ends.clear()
            link._run()  # one round of the sending thread
        assert len(sent) == 4
        assert len(link._waiting) > 10
        monkeypatch.undo()
        link.close()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("raven_left", "give ROBOT=HOST:PORT:STATEPORT"),
        ("raven_left=36000", "is not the address of a machine"),
        ("raven_left=a:b:c", "is not the address of a machine"),
        ("raven_left=127.0.0.1:0:5", "the port 0 must be 1 to 65535"),
        pytest.param(f"raven_left={'9' * 5000}:5", "is not the address of a machine", id="more digits than int reads"),
    ],
)
def test_a_wrong_address_is_refused(text, message):
    with pytest.raises(TwinError, match=message):
        running([text])


def test_addresses():
    found = running(["a=36000:36001", "b=10.0.0.7:1:2"])
    assert found == {"a": Address("127.0.0.1", 36000, 36001), "b": Address("10.0.0.7", 1, 2)}
    with pytest.raises(TwinError, match="given twice"):
        running(["a=1:2", "a=3:4"])


# -- joint packets, and a twin that follows ---------------------------------------------------------------


@pytest.fixture
def packets():
    source = JointPackets(0, 7)
    yield source
    source.close()


def test_joint_packets_are_read_in_order(packets):
    packets.read(pack_joints(5, 1.0, Q), "a", 0.0)
    assert np.array_equal(packets._state.wanted, Q)
    packets.read(pack_joints(6, 1.1, Q, Q + 1), "a", 0.1)
    assert np.array_equal(packets._state.wanted, Q + 1)
    packets.read(pack_joints(1, 0.0, Q), "b", 0.7)  # after silence, another sender may begin anew
    assert packets.accepted == 3


@pytest.mark.parametrize(
    ("data", "sender", "message"),
    [
        (b"TWNJ", "a", "the packet has 4 bytes"),
        (pack_joints(6, 1.1, Q)[:-8], "a", "the packet has 72 bytes; it must have 80"),
        (b"TWNX" + pack_joints(6, 1.1, Q)[4:], "a", "begins with b'TWNX'"),
        (b"TWNJ\x02" + pack_joints(6, 1.1, Q)[5:], "a", "the version is 2; it must be 1"),
        (pack_joints(6, 1.1, Q[:6]), "a", "the packet has 6 joints; the robot has 7"),
        (pack_joints(6, 1.1, Q * np.nan), "a", "not finite"),
        (pack_joints(5, 1.1, Q), "a", "the packet number 5 is not above the previous one, 5"),
        (pack_joints(6, 0.9, Q), "a", "the clock went back from 1 s to 0.9 s"),
        (pack_joints(6, 1.0, Q), "a", "the clock did not advance: 1 s was followed by 1 s"),
        (pack_joints(6, 1.1, Q), "b", "b is a second sender; a is followed until it has been silent for 0.5 s"),
    ],
)
def test_a_wrong_joint_packet_is_refused(packets, data, sender, message):
    packets.read(pack_joints(5, 1.0, Q), "a", 0.0)
    with pytest.raises(DeviceError, match=re.escape(message)):
        packets.read(data, sender, 0.1)
    assert packets.accepted == 1


def test_a_twin_follows_joint_packets(robot, patient):
    packets = JointPackets(0, 7)
    mirror = Mirror(robot, packets)
    mirror.step()
    assert mirror.level is None
    assert "no state of the machine arrives" in mirror.problem
    q = np.array(robot.mechanism.posture("home")) + 0.01
    off = np.array([0.1, 0, 0, 0, 0, 0, 0])
    with socket.socket(type=socket.SOCK_DGRAM) as out:
        out.sendto(b"nonsense", ("127.0.0.1", packets.port))
        soon(lambda: (mirror.step(), packets.refused)[1])
        assert "packets are refused: the packet has 8 bytes" in mirror.problem
        out.sendto(pack_joints(1, 0.0, q, q + off), ("127.0.0.1", packets.port))
        soon(lambda: (mirror.step(), mirror.level)[1])
    assert mirror.problem == ""
    np.testing.assert_allclose(mirror.deviation["joints"], off, atol=1e-12)
    tips = [robot.forward(x)[:3, 3] for x in (q, q + off)]
    assert mirror.deviation["tip"] == pytest.approx(np.linalg.norm(tips[1] - tips[0]), abs=1e-9)
    mirror.close()


class Given:
    """A machine whose joint values are given."""

    answers, problem, newest = True, "", None

    def close(self):
        """Do nothing."""


def test_a_twin_rests_at_joint_values_that_are_impossible():
    """A parallel robot whose loops stay open at the values that arrive, and values in another unit."""
    sils, source = twin.load("sils"), Given()
    mirror, home = Mirror(sils, source), np.array(sils.mechanism.posture("home"))
    for q, said in (
        (home + 0.3, "the loops cannot be closed at q = .*: check order and units of the machine's joints"),
        (home * 1e20, r"a joint value of the machine is .*e\+19 rad or m \(limit 10000\): check its unit"),
    ):
        source.newest = State(Level.PEDAL_DN, False, 1, 0.0, 1, 1, 0, 0, 0, q, home, np.zeros(6))
        before = mirror.links
        mirror.step()
        assert re.search(said, mirror.problem)
        assert mirror.links is before or mirror.deviation["tip"] == pytest.approx(0)
        source.newest = State(Level.PEDAL_DN, False, 1, 0.0, 1, 1, 0, 0, 0, home, home, np.zeros(6))
        mirror.step()
        assert mirror.problem == ""


# -- measures ------------------------------------------------------------------------------------------


def test_measures_of_a_session(scene, robot, parts):
    """A replay that is 50 ms later than its record, and 0.5 mm beside it."""
    n, dt, kin, home = 1000, 5e-3, robot.kinematics(), parts.home
    q, ghost = np.tile(home, (n, 1)), np.tile(home, (n, 1))
    s = np.clip(np.arange(100) / 60, 0, 1)
    path = home + np.outer(s, [0.1, 0, 0, 0, 0, 0, 0])
    ghost[300:400] = path
    ghost[400:500] = path[-1]
    q[510:610], q[610:] = path, path[-1]
    ghost[510:610], ghost[610:] = path, path[-1]
    phase = np.zeros((n, 3))
    phase[280:420, 0], phase[420:500, 0], phase[500:650, 0] = (
        TrainerPhase.REHEARSE,
        TrainerPhase.JUDGED,
        TrainerPhase.REPLAY,
    )
    phase[400:420, 1:] = TrainerReason.FULL, LONGEST_RECORD
    phase[800:850] = TrainerPhase.STOPPED, TrainerReason.START, 0.011
    tip = kin.forward_many(q)[:, :3, 3]
    apart = np.linalg.norm(tip - kin.forward_many(ghost)[:, :3, 3], axis=1)
    cue = np.zeros((n, 3))
    cue[100:110, 1] = 0.4
    rows = {
        "raven_left.phase": phase,
        "raven_left.run": np.tile([1.0, Level.PEDAL_DN, 0, 0], (n, 1)),
        "raven_left.cue": cue,
        "raven_left.deviation": np.column_stack([apart + 5e-4, apart]),
        "raven_left.q": q,
        "raven_left_model.q": ghost,
    }
    kept = Recording(dt, {k: v.shape[1] for k, v in rows.items()}, np.concatenate([*rows.values()], axis=1))
    found = measure(kept, scene.trainer, "raven_left", kin)
    assert [s.phase for s in found.steps] == [
        TrainerPhase.TELEOPERATE,
        TrainerPhase.REHEARSE,
        TrainerPhase.REHEARSE,
        TrainerPhase.JUDGED,
        TrainerPhase.REPLAY,
        TrainerPhase.TELEOPERATE,
        TrainerPhase.STOPPED,
        TrainerPhase.TELEOPERATE,
    ]
    assert found.steps[4].record < 1e-9
    assert found.steps[4].deviation == pytest.approx(5e-4)
    assert np.isnan(found.steps[1].deviation)
    assert "raven_left is 11.0 mm from where the record begins (limit 2)" in found.steps[6].text
    assert found.cue == pytest.approx((0.4, 0.05))
    assert [f.code for f in found.findings()] == ["training.cue", "training.record"]
    assert "the record of raven_left is 120 s long (limit 120)" in found.steps[2].text
    assert len(list(found.rows())) == 8
    assert found.stops == 0
    run = rows["raven_left.run"]
    run[:50, 1] = Level.E_STOP  # until the start button is pressed
    run[700:800, 1] = Level.E_STOP
    run[740:750, 0] = 0.0  # in which the machine does not answer
    kept = Recording(dt, {k: v.shape[1] for k, v in rows.items()}, np.concatenate([*rows.values()], axis=1))
    found = measure(kept, scene.trainer, "raven_left", kin)
    assert (found.stops, found.silent) == (1, pytest.approx(0.05))
