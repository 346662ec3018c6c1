"""Sessions at a console: written second by second, replayed byte for byte."""

from __future__ import annotations

import json
import logging
import re
import shutil
import struct
import subprocess
import sys
import zlib
from dataclasses import replace

import numpy as np
import pytest

import twin
from made.consoles import with_near_targets
from made.scene_text import refused
from twin.api.console_runs import operate_console, replay_session
from twin.api.procedure import is_procedure
from twin.api.scene_parts import members_of
from twin.cli import main
from twin.core import spatial
from twin.core.errors import DescriptionError, OutputError, TwinError, WorldError
from twin.core.units import DEG, MM
from twin.model.scene import load_scene
from twin.simulation.devices.received_hands import HandState
from twin.simulation.devices.surgeon_hands import Habits, Seat, SeenArm
from twin.simulation.session import session_file, session_run
from twin.simulation.session.session_file import CHUNK, SessionWriter, read_session
from twin.simulation.setup import Setup
from twin.simulation.tasks.target.play import ScriptedSurgeon
from twin.simulation.world import Signals
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session.exercise import Exercise
from twin.ui.session.timeline import TICK_RATE


@pytest.fixture(scope="module")
def davinci():
    return twin.load_scene("davinci")


@pytest.fixture(scope="module")
def setup(theatre, near):
    return Setup(near, members_of(theatre.robots), near.tasks["near"])


@pytest.fixture(scope="module")
def near(davinci):
    return with_near_targets(davinci)


@pytest.fixture(scope="module")
def performed(near):
    return operate_console(near, seed=4)


@pytest.fixture(scope="module")
def recorded(performed, tmp_path_factory):
    path = tmp_path_factory.mktemp("session") / "hands.session"
    path.write_bytes(performed.recorded)
    return path


@pytest.fixture(scope="module")
def replayed(recorded, near):
    return replay_session(recorded, near)


# -- the simulated surgeon ------------------------------------------------------------------------------------------


STEP = 5e-3


class Free:
    """In place of an arm and its equations: a point whose joints are its position."""

    def forward(self, q, seed=None):
        return spatial.pose(None, q)


def test_a_surgeon_with_one_arm_is_told_that_two_are_needed():
    arms = {"right": SeenArm("psm1", Free(), np.eye(4), np.eye(4))}
    with pytest.raises(WorldError, match=r"one arm \(right\).*give an arm for the right hand and one for the left"):
        ScriptedSurgeon(Seat("pedals", arms, "ecm", 70 * DEG, 0.5), [], 1 * MM, 0.1)


class Room:
    """In place of a console: hands move points at a scale, the camera pedal drags the picture; no limits."""

    def __init__(self, *targets, seed=0, habits=None):
        self.q = {"right": np.array([0.01, 0, 0]), "left": np.array([-0.01, 0, 0])}
        self.T = spatial.pose(None, (0, 0, 0.08))
        eyes = {hand: SeenArm(hand, Free(), np.eye(4), np.eye(4)) for hand in self.q}
        named = [(f"t{i}", {h: np.array(p) * MM for h, p in t.items()}) for i, t in enumerate(targets)]
        seat = Seat("pedals", eyes, "ecm", 70 * DEG, 0.5, STEP, seed)
        self.surgeon = ScriptedSurgeon(seat, named, 1 * MM, 0.1, habits)
        self.log = []

    def run(self, stuck=False):
        last = None
        for k in range(round(120 / STEP)):
            state = {f"{h}.q": q for h, q in self.q.items()} | {"ecm.view": self.T.ravel()}
            said = self.surgeon.step(Signals(state), k * STEP, STEP)
            if said is None:
                return self
            self.log.append(said)
            hands = {h: said[f"{h}.pose"].reshape(4, 4)[:3, 3] for h in self.q}
            if last is not None and not said["pedals.clutch"] and not stuck:
                moved = {h: hands[h] - last[h] for h in hands}
                if said["pedals.camera"]:
                    self.T[:3, 3] -= 0.2 * np.mean(list(moved.values()), axis=0)
                else:
                    self.q = {h: q + 0.5 * moved[h] for h, q in self.q.items()}
            last = hands
        raise AssertionError("the surgeon does not come to an end")

    def column(self, name):
        return np.array([np.ravel(said[name]) for said in self.log])

    def presses(self, name):
        return int(np.count_nonzero(np.diff(self.column(name)[:, 0]) > 0))


def test_the_surgeon_brings_both_tips_to_every_target():
    room = Room({"right": (20, 5, -3), "left": (-15, 2, 4)}, {"left": (-5, 0, 0)}).run()
    assert not room.surgeon.missed
    assert np.linalg.norm(room.q["left"] - np.array([-5, 0, 0]) * MM) < 1 * MM
    assert np.linalg.norm(room.q["right"] - np.array([20, 5, -3]) * MM) < 1 * MM
    assert room.presses("pedals.clutch") == room.presses("pedals.camera") == 0
    assert room.presses("right.grip") > 0


def test_what_is_out_of_reach_takes_the_clutch_and_hands_stay_in_their_range():
    room = Room({"right": (60, 0, 0), "left": (-60, 0, 0)}, habits=Habits(central=2.0)).run()
    assert not room.surgeon.missed
    assert room.presses("pedals.clutch") >= 1, "50 mm of the tip are 100 mm of the hand, whose range is 50 mm"
    assert room.presses("pedals.camera") == 0
    for hand, x in (("right", 0.08), ("left", -0.08)):
        p = room.column(f"{hand}.pose").reshape(-1, 4, 4)[:, :3, 3]
        assert np.abs(p - (x, 0, 0)).max() < 0.05 + 6 * Habits().hand.tremor


def test_what_is_aside_in_the_picture_takes_the_camera():
    room = Room({"right": (50, 0, 0), "left": (30, 0, 0)}).run()
    assert not room.surgeon.missed
    assert room.presses("pedals.camera") == 1
    assert room.T[0, 3] > 0.02, "the camera has gone to the right"
    assert abs(room.q["right"][0] - 0.05) < 1 * MM


def test_hands_shake_in_the_band_of_tremor_and_by_their_seed():
    one, same, other = (Room({"right": (12, 0, 0)}, seed=s).run() for s in (1, 1, 2))
    assert np.array_equal(one.column("right.pose"), same.column("right.pose"))
    assert not np.array_equal(one.column("left.pose"), other.column("left.pose")[: len(one.log)])
    still = one.column("left.pose").reshape(-1, 4, 4)[:, :3, 3] - (-0.08, 0, 0)  # the left hand has nothing to do
    assert np.sqrt((still**2).sum(axis=1).mean()) == pytest.approx(Habits().hand.tremor, rel=0.3)
    power = (np.abs(np.fft.rfft(still, axis=0)) ** 2).sum(axis=1)
    f = np.fft.rfftfreq(len(still), STEP)
    assert power[(f > 7) & (f < 13)].sum() > 0.9 * power.sum()


def test_the_surgeon_gives_up_what_does_not_follow():
    room = Room({"right": (12, 0, 0)}, {"left": (-12, 0, 0)}).run(stuck=True)
    assert room.surgeon.missed == ["t0", "t1"]


@pytest.mark.parametrize("target", [{}, {"third": (0, 0, 0)}])
def test_a_target_for_no_hand_is_refused(target):
    with pytest.raises(WorldError, match="target 't0' is for"):
        Room(target)


def test_the_task_is_done_in_the_scene(performed):
    assert performed.verdict == "agree"
    (target,) = performed.outcome.touched
    assert target.name == "there"
    assert 1.0 < target.t < 3.0
    assert [h.robot for h in performed.arm_measures] == ["psm1", "psm2"]
    for hand, start in zip(performed.arm_measures, ([9.73, 43.01, 916.8], [-9.73, 43.01, 916.8]), strict=True):
        way = np.linalg.norm(performed.task.goal.targets[0].p_world[hand.hand] / MM - start)
        assert way - 1 < hand.path / MM < 3 * way
        assert 0.5 < hand.economy <= 1
        assert -3 < hand.smoothness < -1.3
        assert hand.grasps == 1
        assert hand.moving + hand.idle == pytest.approx(performed.console.duration, abs=0.01)


@pytest.mark.slow
def test_the_task_of_the_scene_needs_clutch_and_camera_and_is_done(davinci):
    found = operate_console(davinci, seed=1)
    assert found.verdict == "agree", found.findings
    assert len(found.outcome.touched) == len(davinci.tasks["touch"].goal.targets)
    assert found.console.clutches > 2
    assert found.console.camera_moves >= 2
    assert not found.console.silent


# -- the file -------------------------------------------------------------------------------------------------------

SIZES = {"hand.pose": 3, "pedals.clutch": 1}
WORLD = {"arm.q": 2, **SIZES}
DIGEST = "sha256:" + 64 * "0"


def written(path, count, closes=True):
    """A session of `count` ticks with random rows, given piece by piece."""
    rows = np.random.default_rng(count).normal(size=(count, 6))
    writer = SessionWriter(path, session_file.head("room", DIGEST, 1e-3, SIZES, WORLD, None, 7))
    for k in range(0, count, 37):
        writer.add(rows[k : k + 37])
    writer.close() if closes else writer.abandon()
    return rows


def test_a_session_that_ends_before_its_first_chunk_leaves_no_file(tmp_path, monkeypatch):
    """Nothing could be replayed from such a file, but it would keep the next session from its name."""
    head = session_file.head("room", DIGEST, 1e-3, SIZES, WORLD, None, 7)
    writer = SessionWriter(tmp_path / "a.session", head)
    writer.add(np.zeros((CHUNK - 1, sum(WORLD.values()))))
    writer.abandon()
    assert not list(tmp_path.iterdir())

    def full(self, data):
        raise OutputError("cannot write: No space left on device")

    monkeypatch.setattr(SessionWriter, "_put", full)
    with pytest.raises(OutputError, match="No space left"):
        SessionWriter(tmp_path / "a.session", head)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("count", [1, CHUNK - 1, CHUNK, 3 * CHUNK + 5])
def test_a_session_is_read_as_it_was_written(tmp_path, count):
    path = tmp_path / "new/a.session"
    rows = written(path, count)
    found = read_session(path)
    assert not found.lost
    assert (found.head.scene, found.head.seed, found.head.task) == ("room", 7, None)
    assert np.array_equal(found.device, rows[:, 2:])
    at = 0
    for chunk in found.chunks:
        part = rows[at : at + len(chunk.device)]
        assert session_file.digest(part) == chunk.digest
        assert np.array_equal(chunk.last, part[-1])
        at += len(part)
    assert at == count
    assert [p.name for p in path.parent.iterdir()] == ["a.session"]


def test_a_crash_loses_at_most_a_second(tmp_path):
    path = tmp_path / "a.session"
    rows = written(path, 2 * CHUNK + 900, closes=False)  # as if the process were killed
    assert not path.exists()
    found = read_session(tmp_path / "a.session.part")
    assert np.array_equal(found.device, rows[: 2 * CHUNK, 2:])
    assert found.lost == "it ends after 2.000 s without its end mark: the recording was interrupted"


def test_a_file_cut_anywhere_gives_its_whole_seconds_or_says_that_there_are_none(tmp_path):
    path, cut = tmp_path / "a.session", tmp_path / "b.session"
    rows = written(path, 2 * CHUNK + 10)
    data = path.read_bytes()
    line = data.index(b"\n") + 1
    first = line + 44 + struct.unpack("<I", data[line + 8 : line + 12])[0]
    for end in (0, 5, line - 1, line, line + 3, line + 44, first - 1):
        cut.write_bytes(data[:end])
        with pytest.raises(WorldError, match=r"b\.session: (not a twin-session file|the file has no complete chunk)"):
            read_session(cut)
    for end in (first, first + 20, first + 100, len(data) - 45):
        cut.write_bytes(data[:end])
        found = read_session(cut)
        assert "the recording was interrupted" in found.lost
        assert np.array_equal(found.device, rows[: len(found.device), 2:])
        assert len(found.device) in (CHUNK, 2 * CHUNK)


def with_head(data, **changes):
    head = json.loads(data[: data.index(b"\n")])
    return json.dumps(head | changes).encode() + data[data.index(b"\n") :]


def swapped(data, at, value):
    return data[:at] + bytes([value]) + data[at + 1 :]


def bomb(data):
    """The first second unpacks to a gigabyte."""
    packed = zlib.compress(bytes(40_000_000))
    line = data.index(b"\n") + 1
    return data[:line] + struct.pack("<4sII32s", b"TWNS", 1000, len(packed), bytes(32)) + packed


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda d: with_head(d, version=2), "not a twin-session file of version 1: version"),
        (lambda d: with_head(d, schema="twin-world"), "not a twin-session file of version 1: schema"),
        (lambda d: with_head(d, dt=-1.0), "dt"),
        (lambda d: with_head(d, more=1), "more"),
        (lambda d: with_head(d, device=[]), "device"),
        (lambda d: with_head(d, device=[{"name": "a.b", "size": 4}]), "'a.b' of the device is not among the signals"),
        (lambda d: with_head(d, device=2 * [{"name": "hand.pose", "size": 3}]), "two signals have the same name"),
        (lambda d: with_head(d, world=[{"name": "hand.pose", "size": 10**6}]), "not among|a row has"),
        (lambda d: b"{}\n" + d, "not a twin-session file of version 1"),
        (lambda d: swapped(d, d.index(b"\n") + 1, 0), "damaged after 0.000 s: there is no valid chunk"),
        (lambda d: swapped(d, d.index(b"\n") + 60, 255), "damaged after 0.000 s"),
        (lambda d: swapped(d, len(d) - 1, d[-1] ^ 1), "end mark does not match the 1010 ticks in the file"),
        (lambda d: d + b"x", "end mark"),
        (bomb, "damaged after 0.000 s"),
    ],
)
def test_a_damaged_file_is_named_with_its_fault(tmp_path, change, text):
    path = tmp_path / "a.session"
    written(path, CHUNK + 10)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(WorldError, match=text) as found:
        read_session(path)
    assert str(path) in str(found.value)


def test_a_small_file_that_unpacks_to_a_huge_session_is_refused(tmp_path, monkeypatch):
    """The duration of a session does not limit the number of its ticks: they can be as short as the file says."""
    path = tmp_path / "a.session"
    written(path, 3 * CHUNK)
    path.write_bytes(with_head(path.read_bytes(), dt=1e-300))
    row = sum(SIZES.values())
    monkeypatch.setattr(session_file, "LARGEST", 8 * (2 * CHUNK * row + 3 * sum(WORLD.values())), raising=False)
    with pytest.raises(WorldError, match=r"a\.session: the session has more than 64,\d{3} unpacked bytes, the limit"):
        read_session(path)
    writer = SessionWriter(tmp_path / "b.session", session_file.head("room", DIGEST, 1e-300, SIZES, WORLD))
    while not writer.full:
        writer.add(np.zeros((100, sum(WORLD.values()))))
    writer.close()
    assert CHUNK <= len(read_session(tmp_path / "b.session").device) < 2 * CHUNK


def test_no_file_is_overwritten(tmp_path, capsys):
    path = tmp_path / "a.session"
    written(path, 10)
    before = path.read_bytes()
    with pytest.raises(OutputError, match="exists; sessions are not overwritten: choose another name"):
        written(path, 20)
    assert path.read_bytes() == before
    path.rename(tmp_path / "a.session.part")
    with pytest.raises(OutputError, match=r"a\.session\.part is left from a session that was interrupted: rename it"):
        written(path, 20)
    assert (tmp_path / "a.session.part").read_bytes() == before
    with pytest.raises(OutputError, match="cannot write to"):
        written(tmp_path / "a.session.part/b.session", 20)


def test_a_session_without_a_tick_leaves_no_file(tmp_path):
    written(tmp_path / "a.session", 0)
    assert not list(tmp_path.iterdir())


def test_missing_file_is_named(tmp_path, capsys):
    assert main(["session", str(tmp_path / "no.session")]) == 2
    assert "no.session: cannot be read: No such file or directory" in capsys.readouterr().err


# -- replay ---------------------------------------------------------------------------------------------------------


def test_a_session_replays_with_the_same_bytes(replayed, performed):
    assert replayed.run.difference is None
    assert replayed.verdict == "agree"
    assert np.array_equal(replayed.run.recording.rows, performed.run.recording.rows)
    assert replayed.content() == performed.content() | {"replay": "same"}
    assert replayed.word == "The replay gives the same bytes"
    assert f"the same bytes in all {replayed.run.ticks} ticks" in "\n".join(
        p for p in replayed.text() if type(p) is str
    )


def test_a_hand_that_was_a_little_elsewhere_is_found_with_signal_and_second(recorded, replayed, setup):
    session = read_session(recorded)
    chunk = session.chunks[1]
    changed = chunk.device.copy()
    names = [s.name for s in session.head.device]
    column = sum(s.size for s in session.head.device[: names.index("right.pose")]) + 3
    changed[500:, column] += 1e-9
    chunks = (session.chunks[0], replace(chunk, device=changed), *session.chunks[2:])
    run = session_run.replay(replace(session, chunks=chunks), setup, lambda label, part: None)
    found = run.difference
    assert (found.t0, found.t1) == (1.0, 2.0)
    assert found.signal in ("right.pose", "psm1.goal", "psm1.q", "psm1.command", "psm1.encoder")
    assert 0 < found.size < 1e-6
    told = replace(replayed, run=run)
    (finding,) = told.findings
    assert (finding.code, finding.severity, finding.when) == ("session.differs", "disagreement", "1 .. 2 s")
    assert told.exit_code == 1


def test_an_interrupted_session_is_replayed_as_far_as_it_goes(recorded, near, tmp_path):
    data = recorded.read_bytes()
    (tmp_path / "cut.session").write_bytes(data[:-50])
    found = replay_session(tmp_path / "cut.session", near)
    assert found.run.difference is None
    assert found.run.ticks == CHUNK * (len(read_session(recorded).chunks) - 1)
    assert "session.interrupted" in {f.code for f in found.findings if f.severity == "warning"}


def test_a_session_of_another_scene_is_refused(recorded, near, davinci, tmp_path):
    with pytest.raises(TwinError, match="scene 'davinci' has no task 'near', the task of the session"):
        replay_session(recorded)
    with pytest.raises(WorldError, match="the session was recorded in scene 'davinci', not in 'other'"):
        replay_session(recorded, replace(near, name="other"))
    first = near.places[0]
    nudged = replace(first, T_world_base=first.T_world_base @ spatial.pose(None, (1e-6, 0, 0)))
    with pytest.raises(WorldError, match="scene 'davinci' has changed since this session"):
        replay_session(recorded, replace(near, places=(nudged, *near.places[1:])))
    with pytest.raises(TwinError, match="scene 'vsrs' has no"):
        replay_session(recorded, "vsrs")
    strange = tmp_path / "a.session"
    strange.write_bytes(with_head(recorded.read_bytes(), dt=0.002))
    with pytest.raises(WorldError, match=r"has changed since .* or the first line .* \(a tick of 0.002 s\)"):
        replay_session(strange, near)
    strange.write_bytes(with_head(recorded.read_bytes(), scene="nowhere"))
    with pytest.raises(TwinError, match="scene 'nowhere' is not built in: give its folder with --scene"):
        replay_session(strange)
    with pytest.raises(TwinError, match="scene 'nowhere' is not built in: give its folder with --scene"):
        is_procedure(strange)


def test_a_session_of_a_world_with_other_signals_is_refused(recorded, setup):
    session = read_session(recorded)
    signals = session.head.world
    for others in (signals[1:], signals[::-1]):
        head = session.head.model_copy(update={"world": others, "twin": "0.0.9"})
        with pytest.raises(WorldError, match=r"written by twin 0\.0\.9, whose World has other signals"):
            session_run.replay(replace(session, head=head), setup, lambda label, part: None)


# -- a person's hands -----------------------------------------------------------------------------------------------


def guide(stream, seconds, begin=0):
    """Both hands show that somebody is there, then move for some seconds; the clutch is pressed once."""
    for k in range(begin, begin + round(seconds * TICK_RATE)):
        s = k / TICK_RATE
        for hand, x in ((0, 0.08), (1, -0.08)):
            pose = spatial.pose(spatial.rotation_z(min(s / 0.1, 1) * 5 * DEG), (x + 0.01 * np.sin(3 * s), 0.01 * s, 0))
            stream.device.give(HandState(hand, 0.6 < s < 0.7, False, k + 1, pose, 0.3 * np.sin(5 * s) ** 2))
        stream.frame(k, 0.0)


@pytest.fixture(scope="module")
def person(theatre, tmp_path_factory):
    """The file of a session of a person, through what `twin serve` runs."""
    path = tmp_path_factory.mktemp("person") / "hands.session"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.ui.session.live_console._STEPPING_TIME", np.inf)
        stream = ConsoleStream(theatre, Exercise(session=path))
        stream.frame(0, 0.0)
        guide(stream, 1.1)
        stream.close()
        stream.close()  # the server and the command both close it
    return path


@pytest.mark.nightly
def test_the_hands_of_a_person_replay_in_another_process(person):
    told = subprocess.run(
        [sys.executable, "-m", "twin", "session", str(person), "--json"], capture_output=True, text=True, check=True
    )
    found = json.loads(told.stdout)
    assert found["schema"] == "twin/session/1"
    assert found["replay"] == "same"
    assert found["surgeon"] == "person"
    assert found["clutches"] == 1
    assert found["hands"][0]["path_mm"] > 1
    assert found["verdict"] == "agree"
    assert "folder" not in found


def test_what_is_served_is_written_as_it_runs(bare_theatre, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("twin.ui.session.live_console._STEPPING_TIME", np.inf)
    monkeypatch.setattr(session_file, "CHUNK", 200)
    path = tmp_path / "hands.session"
    stream = ConsoleStream(bare_theatre, Exercise(session=path))
    stream.frame(0, 0.0)
    guide(stream, 0.3)
    found = read_session(tmp_path / "hands.session.part")  # the server is still running
    assert len(found.device) == 200

    def full(self, data):
        raise OutputError("cannot write to hands.session.part: No space left on device")

    monkeypatch.setattr(SessionWriter, "_put", full)
    with caplog.at_level(logging.ERROR):
        guide(stream, 0.3, begin=18)
        stream.close()
    assert "the session is no longer recorded: cannot write to hands.session.part" in caplog.text
    assert stream.world.tick > 500, "the World goes on"
    assert len(read_session(tmp_path / "hands.session.part").device) == 200


def test_a_session_ends_at_its_maximum(tmp_path, bare_theatre, monkeypatch, caplog):
    monkeypatch.setattr("twin.ui.session.live_console._STEPPING_TIME", np.inf)
    monkeypatch.setattr(session_file, "LONGEST", 0.1)
    stream = ConsoleStream(bare_theatre, Exercise(session=tmp_path / "a.session"))
    stream.frame(0, 0.0)
    guide(stream, 0.3)
    stream.close()
    assert "its maximum of" in caplog.text
    assert 100 <= len(read_session(tmp_path / "a.session").device) < 150


# -- wrong requests -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "text"),
    [
        (["operate", "davinci", "table2"], "davinci is a scene: give a task by --task instead of the protocol"),
        (["operate", "davinci", "--task", "tuch"], "there is no task 'tuch'. Did you mean 'touch'?"),
        (["operate", "davinci", "--trials", "2"], "--trials can be used only with a single robot"),
        (["operate", "davinci", "--clutch", "printed"], "--clutch can be used only with a single robot"),
        (["operate", "davinci", "--scale", "3"], "--scale 3: give 0.05 to 1"),
        (["operate", "vsrs", "scan"], "vsrs is a scene: give a task by --task instead of the protocol"),
        (["operate", "sher", "--task", "touch"], "--task applies to a scene; sher is a robot"),
        (["serve", "sils", "--session", "a.session"], "--session requires a scene with a console, such as davinci"),
        (
            ["serve", "vsrs", "--protocols", "--session", "a.session"],
            "--session and --protocols cannot be combined",
        ),
        (["serve", "davinci", "--session", "a", "--replay", "b"], "--session and --replay cannot be combined"),
    ],
)
def test_a_wrong_request_is_named(argv, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(argv) == 2
    assert text in capsys.readouterr().err
    assert not [p for p in tmp_path.iterdir() if p.name != "twin-out"]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("tolerance_mm = 1.0", "tolerance_mm = 0", "task.touch.tolerance_mm"),
        ("hold_s = 0.2", "hold_s = -1", "task.touch.hold_s"),
        (", right_mm = [22, 45, 912], left_mm = [-22, 45, 912]", "", "a target needs `right_mm`, `left_mm`, or both"),
        ("right_mm = [22, 45, 912]", "right_mm = [22, 45]", "right_mm"),
        ("[task.touch]", "[task.Touch]", "task"),
    ],
)
def test_a_wrong_task_is_named(davinci, tmp_path, old, new, text):
    assert re.search(text, refused(davinci, tmp_path, old, new))


def test_a_task_needs_a_console(tmp_path, davinci):
    """The scene `vsrs` without its console, and with a task of the scene `davinci`."""
    vsrs = twin.load_scene("vsrs").file
    shutil.copytree(vsrs.parent, tmp_path / "vsrs")
    shutil.copytree(vsrs.parents[1] / "organs", tmp_path / "organs")
    body, touch = vsrs.read_text(encoding="utf-8"), davinci.file.read_text(encoding="utf-8")
    without = re.sub(r"^\[console\]\n(?:.+\n)*", "", body, flags=re.MULTILINE)
    assert without != body
    task = touch[touch.index("[task.touch]") : touch.index("[contact]")]
    (tmp_path / "vsrs/scene.toml").write_text(f"{without}\n{task}", encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"a task needs a console: add a section \[console\]"):
        load_scene(tmp_path / "vsrs/scene.toml")
