"""The scripted operator: how the hand moves, what is measured of it, and the insertion task done by it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from made.lanes import nightly
from made.worlds import HOME, LIMITS, controller, goal_beside_home, sher_equations
from twin.cli import main
from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.units import MM
from twin.kinematics import compile_formula
from twin.robots import load_formula
from twin.simulation.controllers.pen_handle import PenToHandle
from twin.simulation.controllers.teleoperation import Gains, Teleoperation
from twin.simulation.devices.hand import Goal, HandMotion, ScriptedHand, Tremor, minimum_jerk
from twin.simulation.limits import JointLimits
from twin.simulation.operator_trials import Trial, _missed
from twin.simulation.trial import Record, measure, operate, remaining
from twin.simulation.world import Signals


@pytest.fixture(scope="module")
def kin():
    return sher_equations()


def test_minimum_jerk_starts_and_ends_at_rest():
    s = np.linspace(0, 1, 20001)
    x = minimum_jerk(s)
    assert (x[0], x[-1]) == (0, 1)
    speed = np.gradient(x, s)
    assert speed[[0, -1]] == pytest.approx(0, abs=1e-6)
    assert speed.max() == pytest.approx(1.875, rel=1e-6)  # Flash and Hogan: 1.875 times the mean
    assert np.gradient(speed, s)[[1, -2]] == pytest.approx(0, abs=0.01)


def test_tremor_keeps_its_band_and_its_size():
    hand, t = HandMotion(), np.arange(0, 40, 1 / 200)
    shake = Tremor(np.random.default_rng(3), hand, 1 / 200)
    x = np.array([shake.output(k) for k in range(len(t))])
    power = np.abs(np.fft.rfft(x * np.hanning(len(t))[:, None], axis=0)) ** 2
    f = np.fft.rfftfreq(len(t), 1 / 200)
    low, high = hand.tremor_band
    assert power[(f > low - 0.2) & (f < high + 0.2)].sum() > 0.999 * power.sum()
    assert np.sqrt((x**2).sum(axis=1).mean()) == pytest.approx(hand.tremor, rel=0.05)


@pytest.mark.slow
def test_the_same_seed_moves_the_same_hand(kin):
    goal = goal_beside_home(kin)
    first, again, other = (operate(kin, HOME, LIMITS, controller(), [goal], seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.handle, again.handle)
    np.testing.assert_array_equal(first.q, again.q)
    assert first.handle.shape != other.handle.shape or not np.array_equal(first.handle, other.handle)


def test_the_hand_brings_the_tool_to_its_goal(kin):
    goal = goal_beside_home(kin)
    record = operate(kin, HOME, LIMITS, controller(), [goal])
    assert not record.missed
    assert remaining(record, [goal])[-1] < goal.tolerance
    assert (np.abs(np.diff(record.q, axis=0)) <= LIMITS.max_speed / 200 * (1 + 1e-9)).all()


@pytest.mark.slow
def test_while_the_pedal_is_up_the_tool_stands(kin):
    goal = goal_beside_home(kin, (12, 0, 0))  # 120 mm of hand: more than its reach
    record = operate(kin, HOME, LIMITS, controller(), [goal])
    assert not record.missed
    assert measure(record, [goal], np.eye(4), np.array([0.0, 0, 1])).presses >= 3
    up = ~record.pedal[1:]
    assert np.abs(np.diff(record.q, axis=0)[up]).max() == 0
    assert np.abs(record.handle[:, 0]).max() < HandMotion().reach[0] * (1 + 3 * HandMotion().misjudge)


def test_the_handle_leaves_its_middle_also_for_a_long_way(kin):
    goal = goal_beside_home(kin, (12, 0, 0))
    hand = ScriptedHand("sher", kin, [goal], 0.01, 1 / 200)  # 1.2 m of hand: 24 times its reach
    handles = [hand.step({"sher.q": HOME}, k / 200, 1 / 200)["hand.handle"] for k in range(400)]
    assert max(handle[0] for handle in handles) > 0.8 * HandMotion().reach[0]


@pytest.mark.slow
def test_a_tool_half_a_turn_from_zero_reaches_its_goal():
    """The coordinates of a tool that points down are near pi or minus pi."""
    kin = compile_formula(load_formula("pa10"))
    poses = []
    for angle in (-0.01, 0.01):
        turn = spatial.exp_so3([angle, 0.0, angle])
        poses.append(spatial.pose(turn @ np.diag([1.0, -1.0, -1.0]), [0.31, 0.48, 0.16]))
    start = kin.inverse(poses[0])
    goal = Goal("there", poses[1], 50e-6)
    limits = JointLimits(np.full(7, -4.0), np.full(7, 4.0), np.ones(7))
    scale = np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    record = operate(kin, start, limits, Teleoperation(Gains(scale=scale), 1 / 200, coordinates=6), [goal])
    assert not record.missed
    assert np.abs(np.diff(record.q, axis=0)).max() < 2e-3


def test_a_pen_that_passes_half_a_turn_does_not_jump():
    kin = compile_formula(load_formula("pa10"))
    start = kin.inverse(spatial.pose(np.diag([1.0, -1.0, -1.0]), [0.31, 0.48, 0.16]))
    pen = PenToHandle("right", "pedals", kin, start, np.eye(3), 1 / 200)
    signals = {"pedals.clutch": np.ones(1)}
    handles = []
    for angle in np.linspace(-0.1, 0.1, 9):
        pose = spatial.pose(spatial.exp_so3([angle, 0.0, angle]))
        now = Signals({**signals, "right.pose": pose.ravel()})
        handles.append(pen.step(now, 0.0, 1e-3)["right.handle"])
    assert np.abs(np.diff(handles, axis=0)).max() < 0.1


@pytest.mark.nightly
def test_a_hand_with_the_printed_clutch_gives_up(kin):
    goals = [goal_beside_home(kin), Goal("never", kin.forward(HOME), 1e-4, True)]
    record = operate(kin, HOME, LIMITS, controller("printed"), goals)
    assert record.missed == "there"
    found = measure(record, goals, np.eye(4), np.array([0.0, 0, 1]))
    assert found.contacts == {"never": False}
    assert not found.success


def test_a_goal_beyond_the_freedoms_of_the_robot_is_named(kin):
    T = kin.forward(HOME)
    c, s = np.cos(0.1), np.sin(0.1)
    T[:3, :3] = T[:3, :3] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # the middle angle of five joints is 0
    with pytest.raises(KinematicsError, match="cannot express goal 'turned'"):
        operate(kin, HOME, LIMITS, controller(), [Goal("turned", T, 1e-4)])


def a_record(pedal, tip, spans):
    k = len(pedal)
    Ts = np.tile(np.eye(4), (k, 1, 1))
    Ts[:, :3, 3] = tip
    zero = np.zeros((k, 5))
    return Record(np.arange(k) * 0.1, zero, np.array(pedal, bool), zero, Ts, spans)


def test_measures_of_a_known_record():
    z = np.array([3.0, 3, 2, 1, 0, 0, 0, 1]) * MM
    tip = np.column_stack([[0, 0, 0.1 * MM, 0, 0, 0, 0, 0], np.zeros(8), z])
    T = np.eye(4)
    record = a_record([0, 1, 1, 0, 1, 1, 0, 1], tip, {"in": (0, 6), "out": (7, 7)})
    goals = [Goal("in", T, 1e-4, True), Goal("out", T, 1e-4)]
    found = measure(record, goals, np.eye(4), np.array([0.0, 0, -1]))
    assert found.presses == 3
    assert found.time == pytest.approx(0.6)
    assert found.path == pytest.approx((2 * np.hypot(1, 0.1) + 1 + 1) * MM)
    assert found.aside == {"in": pytest.approx(0.1 * MM)}
    assert found.nearest == {"in": 0}
    assert found.success


@pytest.mark.parametrize(
    ("end", "touches"),
    [((0, 0, 0.4), True), ((0, 0, 0.6), False), ((0.4, 0, 0), True), ((0.6, 0, 0), False), ((0, 0, -3), True)],
)
def test_contact_is_by_depth_and_by_the_distance_from_the_axis(end, touches):
    """The axis leads along -z: 0.6 mm too high or beside is not a contact, too deep is."""
    record = a_record([1, 1], [(0, 0, 9 * MM), np.array(end) * MM], {"in": (0, 1)})
    goal = Goal("in", np.eye(4), 1e-4, True)
    assert measure(record, [goal], np.eye(4), np.array([0.0, 0, -1])).contacts["in"] is touches


def test_a_goal_given_up_after_every_contact_is_a_disagreement():
    """The operator touches in 0.5 mm of the end, but gives the insertion up, or the retraction after it."""
    record = a_record([1, 1], [(0, 0, 9 * MM), (0, 0, 0.4 * MM)], {"in": (0, 1)})
    goal = Goal("in", np.eye(4), 1e-4, True)
    measures = measure(record, [goal], np.eye(4), np.array([0.0, 0, -1]))
    assert measures.success
    assert _missed([Trial(3, record, measures)]) == []
    record.missed = "out"
    (finding,) = _missed([Trial(3, record, measures)])
    assert finding.severity == "disagreement"
    assert (finding.where, finding.message) == ("out", "seed 3: the operator gave up at 'out'")


@pytest.mark.slow
@pytest.mark.parametrize("seed", nightly([0, 7], every=2))
def test_all_five_holes_are_touched(seed, tmp_path, capsys):
    out = tmp_path / "op"
    code = main(["operate", "sher", "phantom", "--seed", str(seed), "--json", "--out", str(out)])
    data = json.loads(capsys.readouterr().out)
    assert code == 0
    (trial,) = data["trials"]
    assert list(trial["contacts"].values()) == 5 * [True]
    assert max(trial["aside_um"].values()) < 250  # what the drawn hole leaves around the shaft
    assert trial["clutch_presses"] >= 2
    assert trial["path_mm"] > 80  # at least the way between the holes
    assert (out / "operate.png").stat().st_size > 10_000
    columns = (out / f"seed{seed}.csv").read_text(encoding="utf-8").splitlines()
    assert columns[0].startswith("t_s,pedal,handle_")
    assert len(columns) > 5000


@pytest.mark.slow
def test_the_printed_clutch_fails_with_the_size_of_its_jump(tmp_path, capsys):
    code = main(["operate", "sher", "phantom", "--clutch", "printed", "--json", "--out", str(tmp_path / "op")])
    data = json.loads(capsys.readouterr().out)
    assert code == 1
    jump = next(f for f in data["findings"] if f["code"] == "clutch.jump")
    assert jump["size"] == pytest.approx(3.0, rel=1e-3)
    assert any(f["code"] == "task.missed" for f in data["findings"])


def test_wrong_input_is_named(tmp_path, capsys):
    text = (Path(__file__).parents[2] / "trajectories/sher/phantom.toml").read_text(encoding="utf-8")
    phases, file = text.index("[[phases]]"), tmp_path / "over.toml"
    over = '[[phases]]\nname = "over1"\ntype = "positioning"\nto = "above1"\n'
    file.write_text(text[:phases].replace('name = "phantom"', 'name = "over"') + over, encoding="utf-8")
    assert main(["operate", "sher", str(file), "--out", str(tmp_path / "op")]) == 2
    assert "protocol 'over' has no insertion" in capsys.readouterr().err
    assert not (tmp_path / "op").exists()
    assert main(["operate", "sher", "--trials", "0"]) == 2
    assert "--trials 0: the number must be at least 1" in capsys.readouterr().err
    for scale in ("inf", "nan", "0"):
        assert main(["operate", "sher", "--scale", scale]) == 2
        assert f"--scale {scale}: the scale must be above 0 and finite" in capsys.readouterr().err
