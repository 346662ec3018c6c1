"""The console with one hand that moves the SHER by rates: law, pedal, holes, trials."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest

import twin
from twin.api.console_runs import operate_console
from twin.api.scene_parts import members_of, robots_at
from twin.core import atomic, spatial
from twin.core.errors import OutputError, TwinError
from twin.model.scene import load_scene
from twin.simulation import console_scene, rate_console
from twin.simulation.devices.hand import ScriptedHand
from twin.simulation.devices.received_hands import HandState, ReceivedHands
from twin.simulation.limits import JointLimits
from twin.simulation.session import session_run
from twin.simulation.session.task_play import play_of
from twin.simulation.session.trial_table import TrialTable
from twin.simulation.setup import Setup
from twin.simulation.tasks.holes.geometry import Hole, hole_goals
from twin.simulation.tasks.holes.referee import HoleJudge
from twin.simulation.trial import world
from twin.validation.rank_tests import compare

TICKS = 1500


@pytest.fixture(scope="module")
def scene():
    return twin.load_scene("sher_phantom")


@pytest.fixture(scope="module")
def setup(scene):
    members = members_of(robots_at(console_scene.led_by(scene)))
    return Setup(scene, members, scene.tasks["phantom"])


def test_the_operator_of_the_console_moves_the_robot_as_the_operator_of_the_robot(setup):
    """The same bytes: handle, pedal and joints, for the first seconds; `slow` compares the whole task."""
    goals = hole_goals(setup, setup.task)
    member = setup.members["sher"]
    law = rate_console.law_of(setup.scene.console.teleoperation, member.kin, 0.1, 1e-3)
    hand = ScriptedHand("sher", member.kin, goals.goals, law.gains.scale, law.dt, seed=4)
    alone = world(member.kin, goals.start, JointLimits.of(member.mechanism), law, hand)
    alone.step(TICKS)
    at_console = console_scene.world(setup, session_run.surgeon(setup, seed=4))
    at_console.step(TICKS)
    single, console = alone.recording(), at_console.recording()
    for name, same in (("sher.q", "sher.q"), ("right.handle", "hand.handle"), ("right.pedal", "hand.pedal")):
        assert console[name].tobytes() == single[same].tobytes()
    assert np.ptp(single["sher.q"], axis=0).max() > 1e-4  # the robot has moved


TOUCH = """
[task.touch]
title = "one target"
tolerance_mm = 1.0
hold_s = 0.1
provenance = "ASSUMED"
note = "a test"
target = [{ name = "middle", right_mm = [370, 0, 1128] }]
"""


def test_targets_are_judged_by_the_hands_that_the_console_has(scene, setup, tmp_path):
    arms = {"sher": Mock(tip=np.tile([0.370, 0, 1.128], (50, 1)))}
    for text in (TOUCH, TOUCH.replace("right_mm", "left_mm")):
        (tmp_path / "scene.toml").write_text(scene.file.read_text() + text)
        one_hand = load_scene(tmp_path / "scene.toml")
        task = one_hand.tasks["touch"]
        ready = Setup(one_hand, setup.members, task)
        if text == TOUCH:
            found = play_of(task).outcome(ready, task, Mock(t=np.arange(50) * 5e-3), arms)
            assert found.touched[0].t == pytest.approx(0.1)
        else:
            with pytest.raises(TwinError, match=r"target 'middle' is for the left hand, but .* by the right hand only"):
                play_of(task).outcome(ready, task, Mock(t=np.arange(50) * 5e-3), arms)


@pytest.mark.slow
def test_the_whole_task_has_the_bytes_of_twin_operate_sher_phantom(setup, scene):
    at_console = console_scene.world(setup, session_run.surgeon(setup, seed=0)).run()
    robot = twin.load("sher")
    record = twin.api.operate(robot, robot.protocol("phantom"), trials=1, seed=0).trials[0].record
    last_ticks = slice(4, None, 5)
    assert at_console["sher.q"][last_ticks].tobytes() == record.q.tobytes()
    assert at_console["right.handle"][last_ticks].tobytes() == record.handle.tobytes()
    found = operate_console(scene, "phantom", seed=0)
    assert found.verdict == "agree"
    assert found.outcome.judge.presses == 10  # until the last hole; the way home takes two more
    assert len(found.outcome.judge.touched) == 5


class Hand:
    """A person's right hand at the console of a setup; `p` is its position in m in {H}."""

    def __init__(self, setup):
        self.device = ReceivedHands(console_scene.PEDALS, console_scene.HANDS, scale=0.1, moving=(0,))
        self.world = console_scene.world(setup, self.device, records=False)
        self.kin = setup.members["sher"].kin
        self.p, self.R, self.pedal, self.number = np.zeros(3), np.eye(3), False, 0

    def go(self, to=None, seconds=2.5, R=None, says=True):
        """Move the hand evenly to a position in half of the time, then wait; return the tool pose."""
        start, R_start = self.p, self.R
        ticks = round(seconds * 1000)
        for k in range(ticks):
            part = min(1.0, 2 * (k + 1) / ticks)
            if to is not None:
                self.p = start + part * (np.asarray(to, float) - start)
            if R is not None:
                self.R = R_start @ spatial.exp_so3(part * spatial.log_so3(R_start.T @ R))
            if says:
                self.device.give(HandState(0, self.pedal, False, self.number, spatial.pose(self.R, self.p), 0.0))
                self.number += 1
            self.world.step()
        return self.tool

    @property
    def tool(self):
        return self.kin.forward(self.world.signals["sher.q"])


def test_ten_millimetres_of_the_hand_are_one_of_the_tool_in_the_axes_of_the_picture(setup):
    hand = Hand(setup)
    before = hand.go(seconds=0.1)
    hand.pedal = True
    after = hand.go((10e-3, -20e-3, 30e-3), 3)
    # the picture's right is -x of the base, its up is -y, towards the lens is z
    np.testing.assert_allclose(1e3 * (after - before)[:3, 3], [-1, 2, 3], atol=3e-3)  # a lag of 0.2 s, 1.5 s after
    assert spatial.rotation_angle(after[:3, :3].T @ before[:3, :3]) < 1e-8
    signals = hand.world.signals
    assert (signals["console.mode"][0], signals["sher.follows"][0]) == (0, 1)


@pytest.mark.slow
def test_the_pen_turns_the_tool_in_its_two_angles(setup):
    hand = Hand(setup)
    hand.pedal = True
    before = hand.go(seconds=0.1)
    # about y of the base: the tilt of the linkage, whose plane is upright at home; {H} has -y of the base upwards
    after = hand.go(R=spatial.exp_so3([0, 0.1, 0]), seconds=6)
    turned = spatial.log_so3(after[:3, :3] @ before[:3, :3].T)
    np.testing.assert_allclose(turned, [0, -0.1, 0], atol=1e-6)
    np.testing.assert_allclose(after[:3, 3], before[:3, 3], atol=1e-8)  # about the point where the tool enters the eye


@pytest.mark.slow
@pytest.mark.parametrize("clutch", ["corrected", "printed"])
def test_the_clutch_of_eq_7_as_corrected_and_as_printed(scene, setup, clutch, tmp_path):
    text = scene.file.read_text().replace('clutch = "corrected"', f'clutch = "{clutch}"')
    (tmp_path / "scene.toml").write_text(text)
    other = Setup(load_scene(tmp_path / "scene.toml"), setup.members)
    hand = Hand(other)
    hand.go(seconds=0.1)
    before = hand.tool
    hand.go((0, 30e-3, 0), 0.5)
    np.testing.assert_array_equal(hand.tool, before)  # the pedal is up
    hand.pedal = True
    after = hand.go(seconds=0.05)
    hand.go(seconds=4)
    if clutch == "corrected":
        np.testing.assert_allclose(hand.tool, before, atol=1e-9)
        return
    # As printed, the offset acts for one step only: then the tool goes to the coordinates of the handle itself.
    assert np.linalg.norm((after - before)[:3, 3]) > 1e-4
    assert np.linalg.norm((hand.tool - before)[:3, 3]) > 3e-3


@pytest.mark.slow
def test_another_scale_does_not_move_the_tool(setup):
    hand = Hand(setup)
    hand.pedal = True
    before = hand.go((20e-3, 0, 0), 4)
    hand.device.rescale(0.5)
    np.testing.assert_allclose(hand.go(seconds=2), before, atol=1e-8)
    after = hand.go((30e-3, 0, 0), 4)
    np.testing.assert_allclose(1e3 * (after - before)[:3, 3], [-5, 0, 0], atol=1e-4)


@pytest.mark.slow
def test_a_silent_hand_and_a_jump_do_not_move_the_tool(setup):
    hand = Hand(setup)
    hand.pedal = True
    hand.go((10e-3, 0, 0), 4)
    before = hand.go(seconds=0.5, says=False)  # silent after 0.25 s
    hand.p = np.array([-60e-3, 40e-3, 0])  # the pen was put elsewhere meanwhile
    np.testing.assert_allclose(hand.go(seconds=2), before, atol=1e-8)
    hand.p = np.array([60e-3, 40e-3, 0])
    np.testing.assert_allclose(hand.go(seconds=2), before, atol=1e-8)
    assert hand.world.signals["sher.jumps"][0] == 1
    after = hand.go((70e-3, 40e-3, 0), 4)
    np.testing.assert_allclose(1e3 * (after - before)[:3, 3], [-1, 0, 0], atol=1e-4)


def holes():
    """Return three holes with axes downwards, 5 mm apart."""
    down = np.array([0.0, 0, -1])
    return [Hole(f"hole{k + 1}", np.array([5e-3 * k, 0, 0]), np.array([5e-3 * k, 0, 4e-3]), down) for k in range(3)]


def test_presses_path_and_time_begin_with_the_first_press_and_end_with_the_last_hole():
    judge = HoleJudge(holes(), 0.5e-3, 5e-3)
    points_mm = [(0, 9), (0, 3), (0.3, 0.3), (2, 3), (5, 0), (7, 3), (10, -0.4), (10, 9)]
    pedal = [False, True, True, False, True, True, False, True]
    for (x, z), down in zip(points_mm, pedal, strict=True):
        judge.see(1e-3 * np.array([x, 0, z]), down)
    assert [round(t, 6) for t in judge.touched] == [0.01, 0.02, 0.03]
    assert (judge.presses, judge.wrong, judge.complete) == (2, 0, True)  # the third press is after the end
    assert judge.time == pytest.approx(0.03 - 0.005)
    lengths = [np.hypot(0.3, 2.7), np.hypot(1.7, 2.7), np.hypot(3, 3), np.hypot(2, 3), np.hypot(3, 3.4)]
    assert judge.path == pytest.approx(1e-3 * sum(lengths))


@pytest.mark.parametrize(
    ("tip_mm", "touches"),
    [
        ((0.49, 0, 0), True),
        ((0.51, 0, 0), False),
        ((0, 0, 0.49), True),
        ((0, 0, 0.51), False),
        ((0.3, 0.39, 0.4), True),  # 0.492 mm beside
        ((0, 0, -0.51), False),  # beyond the bottom
    ],
)
def test_a_hole_is_touched_within_half_a_millimetre_of_axis_and_bottom(tip_mm, touches):
    judge = HoleJudge(holes(), 0.5e-3, 5e-3)
    judge.see(1e-3 * np.array(tip_mm), True)
    assert (len(judge.touched), judge.contact) == (int(touches), touches)


def test_a_later_hole_is_wrong_and_counted_once_while_the_tip_stays():
    judge = HoleJudge(holes(), 0.5e-3, 5e-3)
    for x in (10, 10, 10, 7, 10):
        judge.see(1e-3 * np.array([x, 0, 0]), True)
    assert (judge.wrong, judge.touched) == (2, [])
    assert judge.measures()["holes_touched"] == 0


def test_trials_are_rows_which_study_averages_by_user(tmp_path):
    file = tmp_path / "study.csv"
    for user, group, times in (("1", "physical", (46, 47)), ("2", "physical", (38,)), ("1", "simulation", (47, 48))):
        table = TrialTable(file, user, group)
        for t in times:
            table.add({"time_s": t, "clutches": 3, "path_mm": 100.0 + t})
    table = TrialTable(file, "1", "simulation")
    assert table.trial == 2
    table.add({"time_s": None, "clutches": None, "path_mm": None, "holes_touched": 4})  # not all holes
    lines = file.read_text().splitlines()
    assert lines[0] == "user,group,trial,time_s,clutches,path_mm,holes_touched"
    assert lines[1] == "1,physical,1,46,3,146,"
    assert lines[-1] == "1,simulation,3,,,,4"
    TrialTable(file, "2", "simulation").add({"time_s": 40, "clutches": 4, "path_mm": 90})
    found = compare(file)
    by_measure = {c.measure: c for c in found.comparisons}
    assert by_measure["time_s"].counts == (2, 2)
    assert by_measure["time_s"].medians == (42.25, 43.75)  # means 46.5, 38 and 47.5, 40
    assert [f.message for f in found.findings if f.code == "study.trials"] == [
        "a value of a user is the mean of the user's trials: 7 trials of 4 users"
    ]


@pytest.mark.parametrize(("user", "group"), [("", "simulation"), ("a,b", "simulation"), ("1", "x\ny")])
def test_names_that_would_break_the_table_are_refused(user, group, tmp_path):
    with pytest.raises(TwinError, match="without commas"):
        TrialTable(tmp_path / "a.csv", user, group)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("user,group,trial,a,a\n1,x,1,2,3\n", "two columns are named 'a'; rename one"),
        ("user,group,trial,a\n1,x,1," + 140000 * "9" + "\n", "is no table: field larger than field limit"),
        ("user,group,trial,a\n1,x,1\n", "t.csv:2: 3 cells; the header has 4"),
    ],
    ids=["two columns", "large cell", "few cells"],
)
def test_a_table_that_cannot_be_kept_is_refused(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(TwinError, match=said):
        TrialTable(tmp_path / "t.csv", "1", "x")


def test_blank_lines_are_skipped_and_a_failed_write_takes_no_number(tmp_path, monkeypatch):
    file = tmp_path / "t.csv"
    file.write_text("user,group,trial,a\n1,x,1,2\n\n")
    table = TrialTable(file, "1", "x")
    with monkeypatch.context() as patch:
        patch.setattr(atomic, "write_text", Mock(side_effect=OutputError("the disk is full")))
        with pytest.raises(OutputError):
            table.add({"a": 3.0})
    assert table.trial == 1
    table.add({"a": 3.0})
    assert file.read_text() == "user,group,trial,a\n1,x,1,2\n1,x,2,3\n"


def test_answers_before_a_trial_are_written_at_once_and_the_trial_completes_their_row(tmp_path):
    file = tmp_path / "t.csv"
    table = TrialTable(file, "1", "x")
    table.add({"a": 2.0})
    table.add_to_next({"before_a": 1.0})
    assert file.read_text() == "user,group,trial,a,before_a\n1,x,1,2,\n1,x,,,1\n"
    assert table.trial == 1
    # the command was ended before the trial; the next one asks again, and another user is in between
    TrialTable(file, "2", "y").add({"a": 9.0})
    again = TrialTable(file, "1", "x")
    assert again.trial == 1
    assert not again.has_values(["before_a"])
    again.add_to_next({"before_a": 5.0})
    again.add({"a": 3.0})
    assert file.read_text() == "user,group,trial,a,before_a\n1,x,1,2,\n1,x,2,3,5\n2,y,1,9,\n"
    again.add({"a": 4.0})
    assert file.read_text().endswith("1,x,3,4,\n")
    again.add_to_next({"before_a": 6.0})
    for user, group in (("3", "x"), ("4", "y")):
        TrialTable(file, user, group).add({"a": 1.0})
    said = [f.message for f in compare(file).findings if f.code == "study.trials"]
    counted = "a value of a user is the mean of the user's trials: 6 trials of 4 users"
    assert said == [f"{counted}; rows without a number in the column 'trial', which do not count: 1"]
    # the row was removed meanwhile: its answers are still there
    file.write_text("user,group,trial,a,before_a\n1,x,3,4,\n")
    again.add({"a": 8.0})
    assert file.read_text() == "user,group,trial,a,before_a\n1,x,3,4,\n1,x,4,8,6\n"


def test_a_console_with_teleoperation_has_one_hand_one_robot_and_a_camera_on_the_base(scene, setup, tmp_path):
    def scene_of(*changes):
        text = scene.file.read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "scene.toml").write_text(text)
        return load_scene(tmp_path / "scene.toml")

    with pytest.raises(TwinError, match="one hand: one robot in `right`"):
        scene_of(('right = ["sher"]', 'right = ["sher"]\nleft = ["sher"]'))
    text = "[console.teleoperation]"
    law = scene.file.read_text()
    law = law[law.index(text) : law.index("[task.phantom]")]
    with pytest.raises(TwinError, match="only a console with `teleoperation` has one hand"):
        scene_of((law, ""))
    moved = Setup(scene_of(('frame = "base"', 'frame = "tool"')), setup.members)
    with pytest.raises(TwinError, match="does not move: give a frame on base, the base of sher"):
        console_scene.world(moved, ReceivedHands("pedals", moving=(0,)))
    with pytest.raises(TwinError, match="no robot 'psm'"):
        scene_of(('robot = "sher"\nprotocol = "phantom"\ncontact', 'robot = "psm"\nprotocol = "phantom"\ncontact'))
