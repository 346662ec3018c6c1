"""Measures of a session on motions whose measures are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import twin
from twin.core.units import MM
from twin.model.task import ConsoleTask
from twin.simulation.controllers.pedals import CAMERA, FREE, TOOLS
from twin.simulation.devices.hand import minimum_jerk
from twin.simulation.session import measures, movement
from twin.simulation.tasks.target.play import touched
from twin.simulation.tasks.target.task import KIND, Target, Targets
from twin.simulation.world import Recording

DT = 5e-3


def times(seconds):
    return np.arange(round(seconds / DT)) * DT


def stroke(seconds, way=0.02):
    """Positions (k, 3) of a minimum-jerk motion along a slanted line."""
    s = minimum_jerk(np.clip(times(seconds) / seconds, 0, 1))
    return s[:, None] * way * np.array([2.0, 1.0, 2.0]) / 3


# -- smoothness -----------------------------------------------------------------------------------------------------


def test_smoothness_is_that_which_its_authors_print():
    """The example of the authors' own program: exp(-5 t^2) from -1 s to 1 s at 100 Hz gives -1.41403."""
    t = np.arange(-1, 1, 0.01)
    assert movement.spectral_arc_length(np.exp(-5 * t**2), 0.01) == pytest.approx(-1.41403, abs=5e-6)


@pytest.mark.parametrize("a", [3.0, 5.0, 20.0, 100.0])
def test_smoothness_of_a_gaussian_is_the_arc_length_of_its_transform(a):
    """The amplitude spectrum of exp(-a t^2) is exp(-pi^2 f^2 / a)."""
    t = np.arange(-5, 5, 2e-3)
    end = min(np.sqrt(a * np.log(20)) / np.pi, 10.0)

    def arc(f):
        slope = -2 * np.pi**2 * f / a * np.exp(-((np.pi * f) ** 2) / a)
        return np.hypot(1 / end, slope)

    assert movement.spectral_arc_length(np.exp(-a * t**2), 2e-3) == pytest.approx(-quad(arc, 0, end)[0], abs=3e-3)


def test_smoothness_depends_neither_on_size_nor_on_pace():
    v = movement.speed(stroke(1.0), DT)
    one = movement.spectral_arc_length(v, DT)
    assert movement.spectral_arc_length(7 * v, DT) == pytest.approx(one, abs=1e-12)
    slow = movement.speed(stroke(2.0), DT)
    assert movement.spectral_arc_length(slow, DT) == pytest.approx(one, abs=0.02)


def test_a_motion_in_pieces_is_less_smooth_and_tremor_as_well():
    one = movement.spectral_arc_length(movement.speed(stroke(1.0), DT), DT)
    halves = np.concatenate([stroke(0.5), stroke(0.5)[-1] + stroke(0.5)])
    assert movement.spectral_arc_length(movement.speed(halves, DT), DT) < one - 0.3
    shaken = stroke(1.0) + 5e-4 * np.sin(2 * np.pi * 6 * times(1.0))[:, None]
    assert movement.spectral_arc_length(movement.speed(shaken, DT), DT) < one - 0.3


@pytest.mark.parametrize("rate", [60, 30])
@pytest.mark.parametrize("seconds", [0.5, 1.0, 2.0])
def test_measures_are_those_of_the_hand_and_not_of_the_rate_of_its_device(seconds, rate):
    """A browser tells where a hand is 30 to 60 times per second, and the tip goes there in steps."""
    t = np.arange(-1, seconds + 1, DT)

    def measured(t):
        v = movement.speed(minimum_jerk(np.clip(t / seconds, 0, 1))[:, None] * np.array([0.02, 0, 0]), DT)
        ((a, b),) = movement.movements(v, DT)
        return movement.spectral_arc_length(v[a : b + 1], DT), (b - a) * DT, v.max()

    smooth, held = measured(t), measured(np.floor(t * rate + 1e-9) / rate)
    assert held == pytest.approx(smooth, rel=0.06)
    assert held[0] == pytest.approx(smooth[0], abs=5e-3)


def test_what_does_not_move_has_no_smoothness():
    with pytest.raises(ValueError, match="smoothness is undefined"):
        movement.spectral_arc_length(np.zeros(100), DT)


# -- speed, path, movements -----------------------------------------------------------------------------------------


def test_path_and_speed_of_a_circle():
    angle = 2 * np.pi * times(2.0) / (2.0 - DT)
    p = 0.03 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    assert movement.path_length(p) == pytest.approx(2 * np.pi * 0.03, rel=1e-4)
    v, expected = movement.speed(p, DT), 2 * np.pi * 0.03 / (2.0 - DT)
    assert np.allclose(v[20:-20], expected, rtol=1e-3)
    assert np.allclose(v, expected, rtol=0.02), "the filter knows nothing beyond the ends"


@pytest.mark.parametrize(("turn", "economy"), [(1e-3, 1.0), (np.pi, 2 / np.pi), (np.pi / 2, 2 * np.sqrt(2) / np.pi)])
def test_economy_of_an_arc_is_its_chord_over_its_length(turn, economy):
    angle = turn * np.linspace(0, 1, 400)
    p = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    assert movement.economy(p, [(0, 399)]) == pytest.approx(economy, rel=1e-4)


def test_economy_sums_over_movements_and_is_unknown_without_one():
    there = np.linspace(0, 1, 50)[:, None] * np.array([1.0, 0, 0])
    p = np.concatenate([there, there[::-1]])
    assert movement.economy(p, [(0, 49), (50, 99)]) == pytest.approx(1.0)
    assert movement.economy(p, [(0, 99)]) == 0.0
    assert np.isnan(movement.economy(p, []))


def test_movements_are_between_rests():
    rest = np.zeros((200, 3))
    a, b = stroke(1.0), stroke(0.6)
    p = np.concatenate([rest, a, a[-1] + rest, a[-1] + b, a[-1] + b[-1] + rest])
    v = movement.speed(p, DT)
    found = movement.movements(v, DT)
    assert len(found) == 2
    for (first, last), begin, seconds in zip(found, (1.0, 3.0), (1.0, 0.6), strict=True):
        assert begin <= first * DT < begin + 0.15 * seconds
        assert begin + 0.85 * seconds < last * DT <= begin + seconds
        assert (v[first : last + 1] > movement.RESTS).all()


def test_short_rests_belong_to_a_movement_and_short_movements_are_none():
    v = np.zeros(400)
    v[100:200] = v[210:250] = 0.02  # 0.05 s apart
    v[300:310] = 0.02  # 0.05 s
    assert movement.movements(v, DT) == [(100, 249)]
    v[200:210], v[210:250] = 0.0, 0.0
    v[225:275] = 0.02  # 0.125 s apart
    assert movement.movements(v, DT) == [(100, 199), (225, 274)]


@pytest.mark.parametrize(
    ("flags", "expected"),
    [([], []), ([0, 0], []), ([1], [(0, 0)]), ([0, 1, 1, 0, 1], [(1, 2), (4, 4)]), ([1, 1, 0], [(0, 1)])],
)
def test_runs(flags, expected):
    assert movement.runs(np.array(flags, bool)) == expected


# -- a session ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def table():
    return twin.load_scene("davinci").console


def kept(seconds, **signals):
    """A recording at rest, except for the given signals (k,) or (k, n)."""
    k = len(times(seconds))
    at_rest = {"console.mode": TOOLS, "console.taps": 0.0, "pedals.clutch": 0.0, "pedals.camera": 0.0}
    at_rest |= {"pedals.scale": 0.5, "pedals.silent": 0.0, "psm1.follows": 1.0, "psm2.follows": 1.0}
    at_rest |= {"right.grip": 0.0, "left.grip": 0.0}
    columns = {n: np.full((k, 1), v) for n, v in at_rest.items()} | {"ecm.at": np.zeros((k, 4))}
    columns |= {n.replace("__", "."): np.reshape(v, (k, -1)) for n, v in signals.items()}
    return Recording(DT, {n: v.shape[1] for n, v in columns.items()}, np.hstack([*columns.values()]))


def pressed(seconds, *spans):
    t = times(seconds)
    return np.any([(t >= a - 1e-9) & (t < b - 1e-9) for a, b in spans], axis=0).astype(float)


def test_pedals_and_camera_are_counted(table):
    clutch = pressed(10, (1, 2), (3, 3.2), (7, 8))
    camera = pressed(10, (4, 6), (8.5, 9))
    silent = pressed(10, (7, 8))
    mode = np.where(clutch + silent > 0, FREE, np.where(camera > 0, CAMERA, TOOLS))
    at = np.zeros((2000, 4))
    at[:, 0] = np.clip(times(10) - 4.5, 0, 1)  # in the second press the camera stays
    found = measures.of_console(
        kept(
            10,
            pedals__clutch=clutch,
            pedals__camera=camera,
            pedals__silent=silent,
            console__mode=mode,
            console__taps=np.cumsum(pressed(10, (3.2, 3.205))),
            ecm__at=at,
            pedals__scale=0.5 + 0.2 * pressed(10, (5, 10)),
            psm1__follows=pressed(10, (0.5, 10)),
            psm2__follows=pressed(10, (2, 10)),
        ),
        table,
        "ecm",
        10.0,
    )
    assert (found.clutches, found.camera_moves, found.taps) == (2, 1, 1), "what is pressed in silence does not count"
    assert found.clutched == pytest.approx(1.2)
    assert found.camera_time == pytest.approx(2.5)
    assert found.silent == pytest.approx(1.0)
    assert found.scale == (0.5, 0.7)
    assert found.time == pytest.approx(9.5)
    assert found.duration == 10.0


def test_silence_within_a_press_does_not_make_two_presses(table):
    at = np.zeros((2000, 4))
    at[:, 0] = np.where(times(10) < 4, 0, np.where(times(10) < 5.5, times(10), 5.5))
    silent = pressed(10, (1.5, 1.8), (4.5, 4.8))
    signals = {"pedals__clutch": pressed(10, (1, 2)), "pedals__camera": pressed(10, (4, 6)), "ecm__at": at}
    found = measures.of_console(kept(10, pedals__silent=silent, **signals), table, "ecm", 10.0)
    assert (found.clutches, found.camera_moves) == (1, 1)


def test_a_session_that_nobody_leads_has_no_time(table):
    nobody = kept(2, psm1__follows=np.zeros(400), psm2__follows=np.zeros(400))
    assert measures.of_console(nobody, table, "ecm", 2.0).time == 0.0


def test_an_arm_is_measured_by_its_tip(table):
    still = np.tile([0.1, 0.2, 0.9], (200, 1))
    p = np.concatenate([still, still[-1] + stroke(1.0, 0.03), still[-1] + stroke(1.0, 0.03)[-1] + 0 * still])
    mode = np.where(pressed(3, (2.5, 3)) > 0, FREE, TOOLS)
    grip = 0.5 * pressed(3, (0.2, 0.6), (1, 2)) + 0.1
    right, left = measures.of_arms(
        kept(3, console__mode=mode, right__grip=grip), table, {"psm1": p, "psm2": np.tile([0.0, 0, 0], (600, 1))}
    )
    assert (right.hand, right.robot, left.hand, left.robot) == ("right", "psm1", "left", "psm2")
    assert right.path == pytest.approx(0.03, rel=1e-3)
    assert (right.movements, right.grasps) == (1, 2)
    assert right.economy == pytest.approx(1.0)
    assert 0.8 < right.moving < 1.0
    assert right.moving + right.idle == pytest.approx(2.5), "the clutch is neither motion nor idleness"
    v = movement.speed(p, DT)
    ((a, b),) = movement.movements(v, DT)
    assert right.smoothness == movement.spectral_arc_length(v[a : b + 1], DT)
    assert (left.path, left.movements, left.moving, left.grasps) == (0.0, 0, 0.0, 0)
    assert left.idle == pytest.approx(2.5)
    assert np.isnan(left.economy)
    assert np.isnan(left.smoothness)


# -- a task ---------------------------------------------------------------------------------------------------------

HERE, THERE = np.array([10, 0, 900.0]) * MM, np.array([40, 0, 900.0]) * MM


def task(*targets, tolerance=1.0, hold=0.2):
    named = [Target(f"t{i}", points) for i, points in enumerate(targets)]
    return ConsoleTask("touch", "", tolerance * MM, hold, KIND, Targets(tuple(named)))


def along(*spans):
    """Tip (1000, 3) that is far away except for spans (from s, to s, point, mm beside it)."""
    p = np.tile([1.0, 1.0, 1.0], (1000, 1))
    for a, b, point, beside in spans:
        p[round(a / DT) : round(b / DT)] = point + np.array([0, beside * MM, 0])
    return p


def test_a_target_is_touched_when_the_tip_has_been_there_long_enough():
    t = times(5)
    (one,) = touched(task({"right": HERE}), t, {"right": along((1, 1.5, HERE, 0.6))})
    assert one.t == pytest.approx(1.2)
    assert one.nearest == pytest.approx(0.6 * MM)
    for span in ((1, 1.15, HERE, 0.6), (1, 2, HERE, 1.1)):  # too short, too far
        (one,) = touched(task({"right": HERE}), t, {"right": along(span)})
        assert one.t is None
        assert one.nearest == pytest.approx(span[3] * MM)


def test_both_tips_must_be_there_at_once():
    t, both = times(5), task({"right": HERE, "left": THERE})
    apart = {"right": along((1, 2, HERE, 0)), "left": along((2, 3, THERE, 0))}
    assert touched(both, t, apart)[0].t is None
    together = {"right": along((1, 2, HERE, 0)), "left": along((1.5, 3, THERE, 0))}
    assert touched(both, t, together)[0].t == pytest.approx(1.7)


def test_targets_count_in_their_order_and_a_missed_one_does_not_end_the_task():
    t, two = times(5), task({"right": HERE}, {"right": THERE})
    first, second = touched(two, t, {"right": along((1, 2, THERE, 0), (3, 4, HERE, 0))})
    assert first.t == pytest.approx(3.2)
    assert second.t is None
    missed, second = touched(two, t, {"right": along((1, 2, THERE, 0))})
    assert missed.t is None
    assert second.t == pytest.approx(1.2)
