"""Two hands on a console: when they may begin, that nothing moves by surprise, and that a session happens again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twin
from made import consoles
from made.alone import Alone
from made.lanes import one_of_a_kind
from twin.core import spatial
from twin.core.errors import KinematicsError, TwinError, WorldError
from twin.core.units import DEG, MM
from twin.simulation import console_scene
from twin.simulation.controllers.camera import CameraDrag, CameraDragging, view
from twin.simulation.controllers.console_equations import READINGS, console
from twin.simulation.controllers.jaw import Jaw
from twin.simulation.controllers.pedals import CAMERA, FREE, TOOLS, Pedals
from twin.simulation.controllers.pose_to_joints import PoseToJoints
from twin.simulation.controllers.tool_following import (
    SCALE_RANGE,
    FollowingArm,
    FollowingControl,
    HandPace,
    HandToPose,
    is_held,
)
from twin.simulation.devices.recorded import Recorded
from twin.simulation.hazards.fault import Fault
from twin.simulation.limits import JointLimits

DT = 1e-3
TOOL = spatial.pose(spatial.exp_so3(np.array([0.2, -0.4, 0.3])), (0.02, 0.03, -0.1))
T = spatial.pose(spatial.exp_so3(np.array([0.5, 0.4, -0.9])), (0.2, 0, 0.1))
HAND = spatial.pose(spatial.exp_so3(np.array([-0.1, 0.2, 0.6])), (0.1, 0.05, 0.0))
ALIGNED = spatial.pose(T[:3, :3].T @ TOOL[:3, :3], HAND[:3, 3])
"""A handle that is turned as the tool is."""


def moved(hand, way=(0, 0, 0), turn=(0, 0, 0)):
    return spatial.pose(spatial.exp_so3(np.array(turn, float)) @ hand[:3, :3], hand[:3, 3] + way)


def guided(hand=HAND, **more):
    """A law that has begun to follow a hand at rest."""
    law = FollowingControl(TOOL, DT, **more)
    for grip in (0.0, 45 * DEG, 0.0):
        law.step(hand, grip, TOOL, T, 0.5)
    assert law.follows
    assert np.allclose(law.goal, TOOL, atol=1e-15)
    return law


def play(law, hands, scale=0.5, T=T, guided=True):
    """Return the goals (k, 4, 4); the tool is where it is asked to be."""
    if not guided:
        law.release()
        return np.array([law.goal] * len(hands))
    return np.array([law.step(W, 0.0, law.goal, T, scale) for W in hands])


def along(hand, way, turn=(0, 0, 0), k=50):
    return [moved(hand, np.multiply(way, i / k), np.multiply(turn, i / k)) for i in range(1, k + 1)]


# -- start ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grip", "roll", "begins"),
    [
        (0, 0, False),
        (35, 0, False),
        (40, 0, True),
        (0, 3.9, False),
        (0, 4, True),
        (34, 1.1, False),
        (34, 1.3, True),
        (31, 3.9, False),
        (33, 3, True),
    ],
)
@pytest.mark.parametrize("apart", [4.9, 5.1])
def test_truth_table_of_the_start(grip, roll, begins, apart):
    """Thresholds 40 and 4 deg, together more than 0.8 of their sum, 35.2 deg; and the attitude within 5 deg."""
    axis = ALIGNED[:3, 2]
    off = spatial.exp_so3(apart * DEG * np.cross(axis, [1, 0, 0]) / np.linalg.norm(np.cross(axis, [1, 0, 0])))
    law = FollowingControl(TOOL, DT, aligns=True)
    hand = spatial.pose(off @ ALIGNED[:3, :3], HAND[:3, 3])
    # The handle rolls there and back: what was seen counts, where it is counts for the attitude.
    for part in (0.0, 1.0, 0.0):
        rolled = spatial.pose(hand[:3, :3] @ spatial.rotation_z(part * roll * DEG), hand[:3, 3])
        law.step(rolled, part * grip * DEG, TOOL, T, 0.5)
    assert law.follows == (begins and apart < 5)
    assert is_held(grip * DEG, roll * DEG + 1e-12) == begins


def test_a_hand_that_nobody_holds_never_begins():
    law = FollowingControl(TOOL, DT)
    goals = play(law, along(HAND, (0.1, 0, 0)))
    assert not law.started
    assert np.array_equal(goals, np.tile(TOOL, (50, 1, 1)))


def test_a_device_without_motors_begins_at_any_attitude():
    assert guided(moved(HAND, turn=(1.0, 0, 0))).follows


# -- following ------------------------------------------------------------------------------------------------------


def test_the_attitude_between_hand_and_tool_is_kept():
    """R = R_H A0, with A0 of the start: 4 deg of misalignment stay 4 deg, and are not turned away."""
    start = spatial.pose(spatial.exp_so3(np.array([4 * DEG, 0, 0])) @ ALIGNED[:3, :3], HAND[:3, 3])
    law = guided(start, aligns=True)
    end = along(start, (0.02, 0.01, 0), (0.3, -0.5, 0.2), k=200)
    goal = play(law, end)[-1]
    A0 = (T[:3, :3] @ start[:3, :3]).T @ TOOL[:3, :3]
    assert np.allclose(goal[:3, :3], T[:3, :3] @ end[-1][:3, :3] @ A0, atol=1e-13)
    off = spatial.rotation_angle(T[:3, :3] @ end[-1][:3, :3] @ goal[:3, :3].T)
    assert off == pytest.approx(4 * DEG, abs=1e-9)


@pytest.mark.parametrize("aligns", [False, True])
def test_clutch_and_regrip_move_nothing(aligns):
    law = guided(ALIGNED, aligns=aligns)
    before = play(law, along(ALIGNED, (0.01, 0, 0)))[-1]
    away = along(moved(ALIGNED, (0.01, 0, 0)), (0.05, 0.02, 0), (0.01, 0.01, 0))
    assert np.array_equal(play(law, away, guided=False)[-1], before)
    assert not law.follows
    again = play(law, [away[-1]] * 3)
    assert law.follows
    assert np.allclose(again, before, atol=1e-15)
    goal = play(law, along(away[-1], (0, 0.02, 0)))[-1]
    assert np.allclose(goal[:3, 3] - before[:3, 3], 0.5 * T[:3, :3] @ (0, 0.02, 0), atol=1e-15)


def test_after_a_clutch_a_handle_with_motors_must_be_turned_within_two_degrees():
    law = guided(ALIGNED, aligns=True)
    play(law, [ALIGNED], guided=False)
    turned = moved(ALIGNED, turn=(2.5 * DEG, 0, 0))
    play(law, [turned] * 3)
    assert not law.follows
    play(law, [moved(ALIGNED, turn=(1.5 * DEG, 0, 0))])
    assert law.follows


def test_another_scale_while_moving_does_not_jump():
    law = guided()
    path = along(HAND, (0.04, 0, 0), k=100)
    scales = [0.5] * 50 + [0.05] * 25 + [1.0] * 25
    goals = np.array([law.step(W, 0.0, law.goal, T, s) for W, s in zip(path, scales, strict=True)])
    steps = np.linalg.norm(np.diff(goals[:, :3, 3], axis=0), axis=1) / 0.0004
    assert np.allclose(steps, scales[1:], atol=1e-9)


@pytest.mark.parametrize(("asked", "used"), [(0.0, SCALE_RANGE[0]), (-1.0, SCALE_RANGE[0]), (7.0, SCALE_RANGE[1])])
def test_the_scale_keeps_its_range(asked, used):
    law = FollowingControl(TOOL, DT)
    for grip in (0.0, 45 * DEG, 0.0):
        law.step(HAND, grip, TOOL, T, asked)
    goal = [law.step(W, 0.0, law.goal, T, asked) for W in along(HAND, (0.01, 0, 0))][-1]
    assert np.allclose(goal[:3, 3] - TOOL[:3, 3], used * T[:3, :3] @ (0.01, 0, 0), atol=1e-14)


def test_a_camera_that_moves_leaves_the_tool_at_rest():
    law = guided()
    before = play(law, along(HAND, (0.01, 0, 0)))[-1]
    here = moved(HAND, (0.01, 0, 0))
    other = T @ spatial.pose(spatial.exp_so3(np.array([0, 0, 0.4])), (0.05, 0, 0))
    for k in range(20):
        turning = T @ spatial.pose(spatial.exp_so3(np.array([0, 0, 0.02 * (k + 1)])), (0.0025 * (k + 1), 0, 0))
        assert np.allclose(law.step(here, 0, law.goal, turning, 0.5), before, atol=1e-15)
    goal = play(law, along(here, (0, 0.01, 0)), T=other)[-1]
    assert np.allclose(goal[:3, 3] - before[:3, 3], 0.5 * other[:3, :3] @ (0, 0.01, 0), atol=1e-14)


def test_ten_thousand_ticks_round_a_loop_come_back():
    law = guided()
    phase = np.linspace(0, 2 * np.pi, 10_001)[1:]
    for a in phase[9::10]:  # what is asked for depends on the hand, not on the way there
        law.step(
            moved(HAND, (0.02 * np.sin(a), 0.02 * (np.cos(a) - 1), 0), (0.3 * np.sin(a), 0, 0)), 0, law.goal, T, 0.5
        )
    assert np.allclose(law.goal, TOOL, atol=1e-14)


@pytest.mark.parametrize("way", [(0.05, 0, 0), (0, 0, 0)])
def test_a_hand_that_jumps_moves_nothing_and_is_counted(way):
    law = guided()
    before = play(law, along(HAND, (0.01, 0, 0)))[-1]
    there = moved(HAND, np.add((0.01, 0, 0), way), (0, 0, 0) if any(way) else (0.9, 0, 0))
    assert np.allclose(play(law, [there] * 3), before, atol=1e-15)
    assert law.jumps == 1
    assert law.follows


def spoilt(row, column, value):
    bad = HAND.copy()
    bad[row, column] = value
    return bad


@pytest.mark.parametrize(
    "bad",
    [
        np.full((4, 4), np.nan),
        np.zeros((4, 4)),
        np.diag([1.0, 1, -1, 1]),
        1.01 * HAND,
        spoilt(0, 3, np.nan),
        spoilt(1, 3, -np.inf),
        spoilt(2, 1, np.nan),
        spoilt(3, 0, 0.1),
        *(spoilt(i, j, HAND[i, j] + 1e-3) for i in range(3) for j in range(3)),
    ],
)
def test_what_is_no_pose_moves_nothing(bad):
    law = guided()
    before = play(law, along(HAND, (0.01, 0, 0)))[-1]
    goals = play(law, [bad, bad, moved(HAND, (0.03, 0, 0)), moved(HAND, (0.03, 0, 0))])
    assert np.allclose(goals, before, atol=1e-15)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(*6 * [st.floats(-0.02, 0.02)]), min_size=2, max_size=30), st.floats(0.05, 1))
def test_no_hand_moves_the_tool_faster_than_its_pace(steps, scale):
    pace = HandPace(speed=0.2, turn=3.0)
    law, hand = guided(pace=pace), HAND
    last = law.goal
    for step in steps:
        hand = moved(hand, step[:3], np.multiply(step[3:], 10))
        goal = law.step(hand, 0.0, law.goal, T, scale)
        assert np.linalg.norm(goal[:3, 3] - last[:3, 3]) <= pace.speed * DT + 1e-12
        assert spatial.rotation_angle(goal[:3, :3] @ last[:3, :3].T) <= pace.turn * DT + 1e-9
        last = goal


def test_a_tool_that_was_slow_arrives():
    law = guided(pace=HandPace(speed=0.1, turn=1.0))
    hand = moved(HAND, (0.01, 0, 0), (0.1, 0, 0))
    goal = play(law, [hand] * 400)[-1]
    assert np.allclose(goal[:3, 3] - TOOL[:3, 3], 0.5 * T[:3, :3] @ (0.01, 0, 0), atol=1e-14)


def test_the_printed_equations_can_be_felt():
    """With eqs (1), (2) as printed, the tool leaves while the hand is still."""
    law = FollowingControl(TOOL, DT, laws=console(READINGS["paper"]), pace=HandPace(speed=0.5))
    for grip in (0.0, 45 * DEG, 0.0, 0.0, 0.0):
        law.step(HAND, grip, law.goal, T, 0.5)
    assert np.linalg.norm(law.goal[:3, 3] - TOOL[:3, 3]) > 0.4 * MM


# -- pedals ---------------------------------------------------------------------------------------------------------


def pedals(script, dt=0.01):
    """Return modes and taps for (clutch, camera) pairs."""
    block, out = Alone(Pedals("pedals"), pedals__clutch=0, pedals__camera=0), []
    for k, (clutch, camera) in enumerate(script):
        wrote = block.step(k * dt, dt, pedals__clutch=clutch, pedals__camera=camera)
        out.append((wrote["console.mode"], wrote["console.taps"]))
    return out


def test_the_clutch_wins():
    assert [m for m, _ in pedals([(0, 0), (1, 0), (0, 1), (1, 1), (0, 1)])] == [TOOLS, FREE, CAMERA, FREE, CAMERA]


@pytest.mark.parametrize(("ticks", "taps"), [(1, 1), (25, 1), (26, 0), (100, 0)])
def test_a_quick_tap_is_counted_and_a_long_one_not(ticks, taps):
    assert pedals([(0, 0), *[(1, 0)] * ticks, (0, 0), (0, 0)])[-1][1] == taps


# -- jaw ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("high", [np.inf, -0.1])
def test_a_jaw_that_no_upper_limit_opens_is_refused(high):
    kin = twin.load("raven_left").kinematics()
    arm = FollowingArm("left", kin, np.eye(4))
    n = len(kin.joints)
    limits = JointLimits(np.full(n, -1.0), np.full(n, high), np.ones(n))
    with pytest.raises(TwinError, match=f"left: the upper limit of the jaw's joint 'jaw' is {high:g} rad"):
        list(console_scene._jaws("left", [arm], {"left": limits}, {"left": np.zeros(n)}, DT))


def jaw(offset=0.0):
    """A jaw whose gripper was closed at `offset` before it moved the jaw, and has moved it to 30 deg."""
    law = Jaw(0.0, 60 * DEG, 0.0, DT)
    for grip in (20 * DEG, 0.0, 10 * DEG):
        law.step(grip + offset, False)
    for _ in range(1000):
        law.step(30 * DEG + offset, True)
    return law


@pytest.mark.parametrize("offset", [0.0, 7 * DEG, -12 * DEG])
def test_the_offset_of_a_gripper_is_calibrated(offset):
    assert jaw(offset).angle == pytest.approx(30 * DEG)


def test_the_lower_limit_alone_is_clamped():
    law = jaw()
    for _ in range(500):
        law.step(-20 * DEG, True)
    assert law.angle == 0.0
    for _ in range(500):
        law.step(70 * DEG, True)
    assert law.angle == pytest.approx(70 * DEG)


def test_after_a_clutch_the_jaw_comes_slowly_and_then_follows():
    law = jaw()
    for _ in range(10):
        assert law.step(50 * DEG, False) == pytest.approx(30 * DEG)
    angles = np.array([law.step(50 * DEG, True) for _ in range(600)])
    rates = np.diff(np.concatenate([[30 * DEG], angles])) / DT / DEG
    slow = angles < 48 * DEG - 1e-9
    assert np.allclose(rates[slow], 36.0)
    assert slow.sum() == pytest.approx(18 / 36 / DT, abs=2)
    assert angles[-1] == pytest.approx(50 * DEG)
    back = np.array([law.step(10 * DEG, True) for _ in range(20)])
    assert np.allclose(np.diff(back) / DT / DEG, -720.0)


# -- camera ---------------------------------------------------------------------------------------------------------

RIGHT, LEFT = np.array([0.08, 0, 0]), np.array([-0.08, 0, 0])
FREE_DRAG = CameraDrag(lower=(-9, -9, 0, -9), upper=(9, 9, 9, 9), rate=(1e9, 1e9, 1e9, 1e9))


def dragged(right, left, at=(0.0, 0.0, 0.1, 0.0), origin=(0, 0, 0), drag=FREE_DRAG):
    law = CameraDragging(np.array(at), DT, drag)
    law.step(RIGHT + origin, LEFT + origin)
    return law.step(RIGHT + right + origin, LEFT + left + origin)


@pytest.mark.parametrize("origin", [(0, 0, 0), (0.2, 0, 0), (-0.3, 5, 1)])
def test_opposed_hands_roll_and_nothing_else(origin):
    at = dragged((0, 5 * MM, 0), (0, -5 * MM, 0), origin=origin)
    assert at[3] == pytest.approx(-np.arctan2(5, 80))  # the scene turns with the hands, the camera against it
    assert -at[3] / DEG == pytest.approx(3.576, abs=5e-4)
    assert np.allclose(at[:3], (0, 0, 0.1), atol=1e-15)


def test_both_hands_up_tilt_and_do_not_roll():
    at = dragged((0, 5 * MM, 0), (0, 5 * MM, 0))
    assert at[1] < 0
    assert np.allclose(at[[0, 2, 3]], (0, 0.1, 0), atol=1e-15)


@settings(max_examples=40, deadline=None)
@given(st.tuples(*3 * [st.floats(-1, 1)]), st.floats(-1.2, 1.2), st.floats(-0.5, 0.5), st.floats(0.05, 0.2))
def test_the_scene_goes_with_the_hands(way, roll, pan, depth):
    """A point before the lens moves in the picture as the hands do, whatever the camera's pan, depth and roll."""
    d = np.array(way) * 0.1 * MM
    start = np.array([pan, 0.0, depth, roll])
    before, after = view(start), view(dragged(d, d, start))
    point = before @ [0, 0, -FREE_DRAG.lever, 1]
    seen = (spatial.inverse(after) @ point)[:3] - [0, 0, -FREE_DRAG.lever]
    # Beside the axis of pan the point is nearer to it: with tilt 0 it is not.
    assert np.allclose(seen, FREE_DRAG.scale * d, atol=2e-7)


def test_the_camera_keeps_its_limits_and_its_rate():
    drag = CameraDrag()
    law = CameraDragging(np.array([0.0, 0, 0.1, 0]), DT, drag)
    law.step(RIGHT, LEFT)
    last = law.at
    for k in range(4000):
        at = law.step(np.add(RIGHT, [0, 1e-3 * k, 1e-3 * k]), np.add(LEFT, [0, -1e-3 * k, 1e-3 * k]))
        assert (np.abs(at - last) <= np.array(drag.rate) * DT + 1e-15).all()
        last = at
    assert at[2] == drag.upper[2]
    assert (at >= drag.lower).all()
    assert (at <= drag.upper).all()


def test_a_pedal_that_is_pressed_again_drags_from_there():
    law = CameraDragging(np.array([0.0, 0, 0.1, 0]), DT, FREE_DRAG)
    law.step(RIGHT, LEFT)
    there = law.step(np.add(RIGHT, [0.01, 0, 0]), np.add(LEFT, [0.01, 0, 0]))
    law.release()
    assert np.allclose(law.step(RIGHT, LEFT), there, atol=1e-15)


# -- in the World ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def session():
    world = consoles.world(consoles.Hands(consoles.moving), taps=True)
    world.step(700)
    return world.recording()


def poses(recording, name):
    return recording[name].reshape(-1, 4, 4)


def test_a_session_happens_again(session):
    again = consoles.world(Recorded(session, "right", "left", "pedals"), taps=True).run()
    assert again.to_bytes() == session.to_bytes()


def test_a_session_with_a_pedal_that_sticks_happens_again():
    def made(device):
        return consoles.world(device, hazards=(Fault("pedals.clutch", 0.05, 0.2, "hold"),))

    world = made(consoles.Hands(consoles.moving))
    world.step(250)
    first = world.recording()
    assert made(Recorded(first, "right", "left", "pedals")).run().to_bytes() == first.to_bytes()


def test_instruments_stand_while_the_clutch_or_the_camera_is_led(session):
    mode = session["console.mode"][:, 0]
    for arm in ("one", "two"):
        goals, follows = session[f"{arm}.goal"], session[f"{arm}.follows"][:, 0]
        still = (mode[1:] != TOOLS) & (mode[:-1] != TOOLS)
        assert still.sum() > 100
        assert np.array_equal(goals[1:][still], goals[:-1][still])
        assert not follows[mode != TOOLS].any()
        assert np.linalg.norm(goals[-1] - goals[0]) > 1e-4
    at = session["camera.at"]
    dragged = mode == CAMERA
    assert np.ptp(at[dragged], axis=0).max() > 1e-4
    assert np.array_equal(at[mode != CAMERA][:300], np.tile(at[0], (300, 1)))


def test_a_quick_tap_gives_the_hand_the_other_arm(session):
    """The clutch was down for 0.07 s: from then on the right hand moves the third arm, and the first stands."""
    taps = session["console.taps"][:, 0]
    after = taps == 1
    assert after.any()
    assert not session["three.follows"][~after].any()
    assert session["three.follows"][after].any()
    assert not session["one.follows"][after].any()


def test_tools_go_where_the_picture_shows_the_hands(session):
    """After the camera was dragged: displacement of hand in the picture = displacement of the tool in it, scaled."""
    k = np.flatnonzero(session["two.follows"][:, 0])
    last = k[k > 620]
    a, b = last[0], last[-1]
    hand = poses(session, "left.pose")
    T_world_view = poses(session, "camera.view")[b]
    shown = consoles.T_VIEW_HAND[:3, :3] @ (hand[b] - hand[a])[:3, 3]
    went = (poses(session, "two.goal")[b] - poses(session, "two.goal")[a])[:3, 3]
    assert np.allclose(T_world_view[:3, :3].T @ went, 0.2 * shown, atol=1e-14)
    assert np.linalg.norm(went) > 1e-5


def test_the_arms_follow_their_goals(session):
    kin = twin.load(consoles.ROBOT).kinematics()
    for arm in ("one", "two", "three"):
        T = kin.forward(session[f"{arm}.q"][-1])
        assert np.linalg.norm((T - poses(session, f"{arm}.goal")[-1])[:3, 3]) < 0.1 * MM


@pytest.fixture(scope="module")
def operation():
    world = consoles.davinci(consoles.Hands(consoles.moving))
    world.step(620)
    return world.recording()


def test_two_instruments_and_an_endoscope_go_where_they_are_asked_to(operation):
    for arm, robot in (("psm1", "davinci_psm"), ("psm2", "davinci_psm"), ("ecm", "davinci_ecm")):
        kin = twin.load(robot).kinematics()
        q, goals = operation[f"{arm}.q"][::20], poses(operation, f"{arm}.goal")[::20]
        assert max(np.abs(kin.forward(x) - T).max() for x, T in zip(q, goals, strict=True)) < 1e-12
        assert np.ptp(q, axis=0)[:4].min() > 1e-4, "every joint of the arm has moved"


def test_the_jaws_open_while_the_hands_move_the_tools(operation):
    jaw = operation["psm1.jaw"][:, 0]
    assert np.array_equal(operation["psm1.q"][:, -1], jaw)
    assert np.ptp(jaw) > 1 * DEG
    assert not np.diff(jaw)[operation["psm1.follows"][1:, 0] == 0].any()


def test_an_operation_happens_again(operation):
    assert consoles.davinci(Recorded(operation, "right", "left", "pedals")).run().to_bytes() == operation.to_bytes()


def test_an_arm_at_its_limit_stops_there_and_comes_back():
    """The goal goes 100 mm further than the instrument can be inserted, and back: the limit is a wall."""
    kin, limits = twin.load("davinci_psm").kinematics(), JointLimits.of(twin.load("davinci_psm").mechanism)
    first = q = consoles.start(kin)
    T = kin.forward(q)
    block = Alone(PoseToJoints("arm", kin, q, limits), arm__goal=T.ravel(), arm__encoder=q)
    shaft = T[:3, 3] / np.linalg.norm(T[:3, 3])
    deeper = limits.upper[2] - q[2] + 0.1
    path = []
    for part in np.concatenate([np.linspace(0, 1, 150), np.linspace(1, 0, 150), np.zeros(5)]):
        goal = spatial.pose(T[:3, :3], T[:3, 3] + part * deeper * shaft)
        q = block.step(dt=0.01, arm__goal=goal.ravel(), arm__encoder=q)["arm.command"]
        path.append(q)
    path = np.array(path)
    assert path[:, 2].max() == pytest.approx(limits.upper[2], abs=1e-12)
    assert (path >= limits.lower - 1e-12).all()
    assert (path <= limits.upper + 1e-12).all()
    assert (np.abs(np.diff(path, axis=0)) <= limits.max_speed * 0.01 + 1e-12).all()
    assert np.allclose(q, first, atol=1e-9)


def can_take(kin, T, q):
    """Whether the equations take a pose that the tool can have; a planar arm has none above its plane."""
    try:
        return np.linalg.norm(kin.forward(kin.inverse(T), T)[:3, 3] - T[:3, 3]) < 1e-9
    except KinematicsError:
        return False


@pytest.mark.parametrize("name", one_of_a_kind())
def test_any_robot_reaches_what_is_near(name):
    """A goal 0.2 mm beside is reached, by a closed inverse or by Jacobians; joints keep their rates on the way."""
    robot = twin.load(name)
    kin, limits = robot.kinematics(), JointLimits.of(robot.mechanism)
    program, at = kin.program, np.array(kin.formula.seeds[0], float)
    q = kin.inverse(program.pose_of_coordinates.one(at))
    beside = (program.pose_of_coordinates.one(at + 0.2 * MM * np.eye(len(at))[i]) for i in (2, 1, 0) if i < len(at))
    goal = next(T for T in beside if can_take(kin, T, q))
    block = Alone(PoseToJoints("arm", kin, q, limits), arm__goal=goal.ravel(), arm__encoder=q)
    for _ in range(60):
        after = block.step(dt=DT, arm__encoder=q)["arm.command"]
        assert (np.abs(after - q) <= np.minimum(limits.max_speed * DT, 0.1) + 1e-12).all()
        q = after
    assert np.linalg.norm(kin.forward(q, goal)[:3, 3] - goal[:3, 3]) < 1e-8


def test_a_hand_without_an_arm_is_refused():
    with pytest.raises(WorldError, match="hand 'right' has no arm"):
        HandToPose("right", "pedals", (), (), np.eye(4), view=np.eye(4))
