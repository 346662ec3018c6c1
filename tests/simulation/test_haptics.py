"""Forces on the hands: the law, local planes, passivity, and what is felt of real contacts in a World."""

from __future__ import annotations

import os
from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from made.haptics import DT, Touch, observed, plane, random_hand, turned
from twin.core import spatial
from twin.core.errors import TwinError, WorldError
from twin.formula import symbolic
from twin.formula.evaluator import attach
from twin.simulation import proxy
from twin.simulation.condition import randomised
from twin.simulation.controllers import passivity
from twin.simulation.controllers.hand_force import ForceParameters
from twin.simulation.controllers.haptics import GraspPulse, HapticHand
from twin.simulation.controllers.passivity import needed_damping, require_passive
from twin.simulation.local_plane import PLANE_COUNT, PLANE_SIZE, LocalPlane, rows

MM = 1e-3
FLOOR = plane([0, 0, 1])
UP = np.array([0.0, 0, 1])


def slow(*ends, speed=0.05):
    """Return positions (k, 3) of a hand that goes from one point to the next at a speed in m/s."""
    parts = []
    for a, b in pairwise(ends):
        count = round(float(np.linalg.norm(np.subtract(b, a))) / speed / DT)
        parts.append(np.linspace(a, b, max(2, count + 1)))
    return np.concatenate(parts)


# -- the law ----------------------------------------------------------------------------------------------------------


def test_a_depth_of_1_mm_gives_06_newton():
    hands = np.concatenate([slow([0, 0, 5 * MM], [0, 0, -1 * MM]), np.tile([0, 0, -1 * MM], (400, 1))])
    np.testing.assert_allclose(Touch().among(FLOOR).play(hands)[-1], [0, 0, 0.6], atol=1e-9)


def test_a_rate_of_10_mm_per_s_adds_01_newton():
    hands = slow([0, 0, 5 * MM], [0, 0, -2 * MM], speed=0.01)
    f = Touch().among(FLOOR).play(hands)
    depth = -hands[:, 2]
    late = depth > 0.5 * MM  # the filter of the rate has settled
    np.testing.assert_allclose(f[late, 2] - 600 * depth[late], 0.1, atol=1e-4)


def test_the_force_is_clipped():
    hands = np.concatenate([slow([0, 0, 5 * MM], [0, 0, -20 * MM]), np.tile([0, 0, -20 * MM], (100, 1))])
    f = Touch().among(FLOOR, plane([1, 0, 0], 20 * MM)).play(hands)
    assert np.linalg.norm(f, axis=1).max() == pytest.approx(3.3, abs=1e-9)


@pytest.mark.slow
def test_nothing_is_felt_outside_without_the_switch_or_with_the_clutch():
    touch = Touch().among(FLOOR)
    hands = slow([0, 0, 50 * MM], [30 * MM, 0, 0.001 * MM], [0, 20 * MM, 30 * MM])
    assert not touch.play(hands).any()
    inside = slow([0, 0, 5 * MM], [0, 0, -2 * MM])
    for off in ("on", "follows"):
        touch = Touch().among(FLOOR)
        getattr(touch, off)[0] = 0
        assert not touch.play(inside).any()
    assert Touch().among(FLOOR).play(inside).any()


points = st.tuples(*[st.floats(-6 * MM, 6 * MM)] * 3)


@pytest.mark.nightly
@settings(max_examples=50, deadline=None)
@given(st.lists(points, min_size=2, max_size=12), st.integers(0, 2**32 - 1), st.integers(1, PLANE_COUNT), st.booleans())
def test_no_surface_pulls_inwards_and_no_force_exceeds_the_clip(hands, seed, count, bounds):
    rng = np.random.default_rng(seed)
    planes = [plane(turned(rng) @ UP, rng.uniform(-3, 3) * MM) for _ in range(count)]
    touch = _shared(bounds).among(*planes)
    touch.state[:] = 0
    touch.start(hands[0])
    for p in hands:
        f = touch.at(p)
        depths = [x.depth(spatial.pose(p=p)) for x in planes]
        assert np.linalg.norm(f) <= 3.3 + 1e-9
        if max(depths) <= 0:
            assert not f.any()
        inward = [f @ x.normal for x in planes]
        assert max(inward) >= -1e-12 or not f.any(), "out of at least one surface"
        if count == 1:
            assert inward[0] >= 0


_TOUCH: dict[bool, Touch] = {}


def _shared(bounds):
    return _TOUCH.setdefault(bounds, Touch(bounds=bounds))


# -- local planes and the proxy --------------------------------------------------------------------------------------


def test_the_same_surface_found_twice_counts_once_and_a_corner_has_two():
    hands = np.concatenate([slow([0, 5 * MM, 5 * MM], [0, -1 * MM, -1 * MM]), np.tile([0, -MM, -MM], (400, 1))])
    np.testing.assert_allclose(
        Touch().among(FLOOR, FLOOR, plane([0, 0, 1], -0.5 * MM)).play(hands)[-1], 0.6 * UP, atol=1e-9
    )
    corner = Touch().among(FLOOR, plane([0, 1, 0])).play(hands)[-1]
    np.testing.assert_allclose(corner, [0, 0.6, 0.6], atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_plane_goes_on_with_the_tool_until_the_next_one(seed):
    """The plane found at one pose gives, at another one, the depth that is measured there."""
    rng = np.random.default_rng(seed)
    normal, through = turned(rng) @ UP, rng.standard_normal(3) * 10 * MM
    arm = rng.standard_normal(3) * 10 * MM  # a point of the tool
    T, T_new = (spatial.pose(turned(rng), rng.standard_normal(3) * 10 * MM) for _ in range(2))
    point, point_new = (X[:3, :3] @ arm + X[:3, 3] for X in (T, T_new))
    found = LocalPlane.at_tool(T, point, normal, float(normal @ (through - point)))
    assert found.depth(T_new) == pytest.approx(normal @ (through - point_new), abs=1e-15)
    row = rows([found], T).reshape(PLANE_COUNT, -1)
    assert (row[1:] == 0).all()
    np.testing.assert_array_equal(row[0], [*found.lever, *found.normal, *found.arm, found.offset])


def test_of_many_planes_the_deepest_are_kept():
    many = [plane([0, 0, 1], x * MM) for x in range(7)]
    kept = rows(many, np.eye(4)).reshape(PLANE_COUNT, -1)[:, 9]
    np.testing.assert_allclose(kept, [6 * MM, 5 * MM, 4 * MM, 3 * MM])


def test_a_surface_at_60_hz_is_felt_at_1_khz():
    """A plane that is renewed every 16 ms gives the same forces as one that is renewed in each tick."""
    hands = np.tile([0.0, 0, 0], (300, 1))
    hands[:, 2] = 3 * MM * np.cos(np.arange(300) * 0.03)
    often, seldom = Touch(bounds=False), Touch(bounds=False)
    for touch in (often, seldom):
        touch.start(hands[0])
    fs = []
    for k, p in enumerate(hands):
        found = LocalPlane.at_tool(spatial.pose(p=p), p, UP, -p[2])
        often.among(found)
        if k % 16 == 0:
            seldom.among(found)
        fs.append((often.at(p), seldom.at(p)))
    fs = np.array(fs)
    np.testing.assert_allclose(fs[:, 0], fs[:, 1], atol=1e-12)
    assert len(np.unique(fs[:, 1, 2])) > 120, "it changes in each tick"


class Proxy:
    """The way to the proxy among at most five planes of a tool at the origin."""

    def __init__(self):
        planes = ca.SX.sym("planes", 5 * PLANE_SIZE)
        way = ca.vertcat(*proxy.proxy(symbolic.unflat(planes, 5, PLANE_SIZE), ca.SX.eye(4)))
        self._rows = np.zeros((5, PLANE_SIZE))
        self._out, self._compute = attach(ca.Function("way", [planes], [ca.densify(way)]), self._rows)

    def way(self, normals, depths, order=None):
        """Return the way (3,) among planes with normals (k, 3) and depths (k,) in m; order: the rows in use."""
        self._rows[:] = 0
        place = np.arange(len(depths)) if order is None else order
        self._rows[place, :3] = self._rows[place, 3:6] = normals
        self._rows[place, 9] = depths
        self._compute()
        np.testing.assert_array_equal(self._out[:3], self._out[3:])  # levers equal to normals
        return self._out[:3].copy()


@pytest.fixture(scope="module")
def among():
    return Proxy()


def unoptimal(way, normals, depths):
    """Return by how many m a way violates the conditions of Karush, Kuhn and Tucker, which only the optimum satisfies.

    There must be pushes p >= 0 of the planes at which the largest depth s remains, with sum p n = way and sum p =
    REACH; while s = 0, the sum may be smaller.
    """
    s = max(0.0, float(np.max(depths - normals @ way)))
    at = normals[depths - normals @ way > s - 1e-9]
    pushes = np.vstack([at.T, np.ones(len(at))])
    if s < 1e-9:
        pushes = np.column_stack([pushes, [0, 0, 0, 1]])
    return nnls(pushes, np.append(way, proxy.REACH))[1]


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 5),
    st.sampled_from([None, 1.0, -1.0]),
    st.sampled_from([0, 1e-9, 1e-6, 1e-4, 1e-3, 0.1]),
)
def test_the_proxy_is_the_exact_optimum(among, seed, count, like, tilt):
    """Random planes; the second may be parallel or opposite to the first, but for a tilt in rad."""
    rng = np.random.default_rng(seed)
    normals = rng.standard_normal((count, 3))
    if like is not None and count > 1:
        normals[1] = like * normals[0] / np.linalg.norm(normals[0]) + tilt * normals[1]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    depths = rng.uniform(-3, 3, count) * MM
    way = among.way(normals, depths, rng.permutation(5)[:count])
    assert unoptimal(way, normals, depths) < 1e-12
    if depths.max() <= 0:
        assert not way.any()


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_up_to_three_planes_that_face_each_other_little_are_left_completely(among, seed, count):
    """The smallest displacement that leaves all planes, by Lawson and Hanson's problem LDP."""
    rng = np.random.default_rng(seed)
    normals = UP + 0.9 * turned(rng)[:count]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    depths = rng.uniform(-1, 3, count) * MM
    u = nnls(np.vstack([normals.T, depths / MM]), [0, 0, 0, 1])[0]
    r = np.vstack([normals.T, depths / MM]) @ u - [0, 0, 0, 1]
    np.testing.assert_allclose(among.way(normals, depths), -r[:3] / r[3] * MM, atol=1e-12)


def test_in_a_slot_the_proxy_is_in_the_middle_and_does_not_jump(among):
    """A slot that is 1 mm narrower than the tool, whose walls are parallel or not quite."""
    depths = np.array([0.8, 0.2]) * MM
    for angle in (0, 1e-6, 1e-4, 1e-3, 1e-2):
        walls = np.array([[0.0, 0, 1], [0, np.sin(angle), -np.cos(angle)]])
        way = among.way(walls, depths)
        np.testing.assert_allclose(way, [0, 0, 0.3 * MM], atol=proxy.REACH * angle + 1e-15)
        corner = among.way(np.vstack([walls, [1, 0, 0]]), [*depths, 2 * MM])  # for a tool that is 0.5 mm smaller
        np.testing.assert_allclose(corner - way, [1.5 * MM, 0, 0], atol=2 * proxy.REACH * angle + 1e-15)


def test_planes_of_another_side_are_kept_beside_many_of_one_side():
    floors = [plane([1e-3 * k, 0, 1], (3 - 0.1 * k) * MM) for k in range(6)]
    kept = rows([*floors, plane([0, 1, 0], 0.5 * MM)], np.eye(4)).reshape(PLANE_COUNT, -1)
    np.testing.assert_allclose(kept[:2, 9], [3 * MM, 0.5 * MM])


# -- passivity --------------------------------------------------------------------------------------------------------


def scenes(rng, ticks):
    """Yield (name, planes for tick k): a box around the hand, one renewed at 60 Hz, one that moves."""
    walls = [plane(s * n, -2 * MM) for n in np.eye(3)[1:] for s in (1, -1)]
    yield "box", lambda k: walls if k == 0 else None
    tilts = [plane(turned(rng) @ UP, rng.uniform(-2, 1) * MM) for _ in range(64)]
    yield "60 Hz", lambda k: [tilts[k // 16 % 64]] if k % 16 == 0 else None
    yield "moving", lambda k: [plane(UP, 2 * MM * np.sin(0.02 * k))] if k % 2 == 0 else None


def play(touch, hands, planes):
    """Return the forces (k, 3) among planes that change."""
    touch.start(hands[0])
    out = np.zeros_like(hands)
    for k, p in enumerate(hands):
        if (new := planes(k)) is not None:
            touch.among(*new)
        out[k] = touch.at(p)
    return out


def passive_for(seconds, seed):
    """Return, by hand and scene: smallest energy in J, smallest energy after the first touch, largest force in N."""
    rng, least = np.random.default_rng(seed), {}
    ticks = round(seconds / DT)
    for hand, cut, size in (("person", 8, 3 * MM), ("tremor", 40, 2 * MM), ("noise", 500, 1 * MM)):
        for name, planes in scenes(rng, ticks):
            touch = Touch(scale=rng.choice([0.2, 0.5, 1.0]))
            hands = random_hand(rng, ticks, cut, size / touch.scale[0])
            forces = play(touch, hands, planes)
            felt = np.linalg.norm(forces, axis=1)
            assert 0.05 < (felt > 0).mean() < 1, (hand, name)
            energy = observed(hands, forces, ForceParameters().device_damping)
            least[hand, name] = energy.min(), energy[np.argmax(felt > 0) :].min(), felt.max()
    return least


@pytest.mark.slow
def test_random_hands_take_no_energy_out():
    for what, (energy, _, largest) in passive_for(2, seed=1).items():
        assert energy >= 0, what
        assert largest > 0.5, what


@pytest.mark.nightly
def test_random_hands_take_no_energy_out_for_long():
    """Each of nine hands for 67 s, 10 minutes together; TWIN_HAPTICS_SECONDS=600: each of them for 10 minutes."""
    for what, (energy, touched, largest) in passive_for(float(os.environ.get("TWIN_HAPTICS_SECONDS", "67")), 2).items():
        print(f"{' '.join(what)}: smallest energy {energy:.3g} J, after the first touch {touched:.3g} J")
        assert energy >= 0, what
        assert largest > 0.5, what


@pytest.mark.slow
def test_the_hands_of_a_person_need_no_bound():
    """The bound on the force is for the worst case: below 8 Hz it is never reached after the first touch."""
    rng = np.random.default_rng(3)
    hands = random_hand(rng, 20_000, 8, 3 * MM)
    hands += [0, 0, 2 * MM] - hands[0]
    both = [play(Touch(bounds=b), hands, lambda k: [FLOOR] if k == 0 else None) for b in (True, False)]
    off = np.linalg.norm(both[0] - both[1], axis=1)
    assert np.linalg.norm(both[1], axis=1).max() > 2
    assert (off > 1e-9).mean() < 0.001
    assert observed(hands, both[1], 0.0).min() > -1e-5, "the work of the hand alone"


UNDAMPED = ForceParameters(damping=0, device_damping=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surface", "late", "active"),
    [(ForceParameters(), 0, False), (ForceParameters(damping=-12), 0, True), (UNDAMPED, 1, True), (UNDAMPED, 16, True)],
    ids=["correct", "negative damping", "a tick late", "a plane at 60 Hz that does not know where the tool is"],
)
def test_the_observer_finds_an_active_surface(surface, late, active):
    """Seeded defects: without the bound the energy is negative; with it the same surface is passive."""
    hands = random_hand(np.random.default_rng(4), 5000, 3, 4 * MM)
    hands += [0, 0, 1 * MM] - hands[0]
    for bounds in (False, True):
        touch = Touch(surface, bounds=bounds)
        touch.start(hands[0])
        forces = np.zeros_like(hands)
        for k, p in enumerate(hands):
            depth = -hands[max(0, k - late)][2]
            touch.among(plane(UP, p[2] + depth))  # the depth of the tool a while ago, wherever it is now
            forces[k] = touch.at(p)
        least = observed(hands, forces, surface.device_damping).min()
        assert (least < -1e-5) == (active and not bounds), f"{least:.2e} J"
        assert least >= 0 or not bounds


@pytest.mark.slow
@pytest.mark.parametrize(("hz", "stiffness", "damping"), [(500, 600, 10), (500, 2000, 0), (250, 600, 10)])
def test_the_needed_damping_is_the_limit_of_a_vibrating_hand(hz, stiffness, damping):
    """A hand that vibrates inside of a surface, at the worst frequency, gains energy just below this damping."""
    k = np.arange(4000)
    hands = np.zeros((4000, 3))
    hands[:, 2] = -1 * MM + 0.01 * MM * np.cos(2 * np.pi * hz * DT * k + 0.3)
    surface = ForceParameters(stiffness, damping)
    forces = play(Touch(surface, bounds=False), hands, lambda k: [FLOOR] if k == 0 else None)
    least = needed_damping(stiffness, damping, DT)
    gain = [observed(hands, forces, b)[-1] - observed(hands, forces, b)[1001] for b in (0.97 * least, 1.03 * least)]
    assert gain[1] > 0
    assert (gain[0] < 0) == (hz == 500), "the worst frequency is the highest one"


def test_the_needed_damping_without_a_filter_is_that_of_colgate(monkeypatch):
    monkeypatch.setattr(passivity, "FILTER_HZ", 1e9)
    assert needed_damping(600, 10, DT) == pytest.approx(600 * DT / 2 + 10)
    assert needed_damping(600, 0, DT) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"stiffness": -1.0}, r"stiffness is -1 N/m; it must be finite and above 0"),
        ({"damping": -0.1}, r"damping is -0.1 N s/m; it must be finite and at least 0"),
        ({"largest": 0.0}, r"largest force is 0 N; it must be finite and above 0"),
        ({"device_damping": np.nan}, r"damping of the device is nan N s/m; it must be finite and above 0"),
        (
            {"damping": 30.0},
            r"damping of the device is 2 N s/m; a surface with 600 N/m and 30 N s/m at ticks of 1 ms needs at least "
            r"3.12 N s/m. Lower the damping to at most 18.09 N s/m, or use shorter ticks",
        ),
        ({"stiffness": 9000.0}, r"is 2 N s/m; a surface with 9000 N/m .* at least 5.44 N s/m. Lower the stiffness"),
    ],
)
def test_bad_numbers_are_named(change, said):
    good = {"stiffness": 600.0, "damping": 10.0, "largest": 3.3, "device_damping": 2.0}
    require_passive(**good, dt=DT)
    with pytest.raises(WorldError, match=said):
        require_passive(**(good | change), dt=DT)


def test_the_limit_that_is_named_is_accepted():
    require_passive(600.0, 18.09, 3.3, 2.0, DT)
    with pytest.raises(WorldError):
        require_passive(600.0, 18.11, 3.3, 2.0, DT)


# -- the order in a study ---------------------------------------------------------------------------------------------


def test_each_participant_has_one_run_with_forces_and_half_begin_with_them():
    first = []
    for n in range(1, 41):
        one, two = (randomised(n, run) for run in (1, 2))
        assert one.haptics != two.haptics
        assert (one.participant, one.run, two.run) == (n, 1, 2)
        assert one == randomised(n, 1)
        first.append(one.haptics)
    assert all(sum(first[k : k + 4]) == 2 for k in range(0, 40, 4))
    assert len({tuple(first[k : k + 4]) for k in range(0, 40, 4)}) > 2, "in random order"
    for wrong in ((0, 1), (3, 3)):
        with pytest.raises(TwinError, match=r"give a number|there is no run 3"):
            randomised(*wrong)


# -- the pulse of a grasp ---------------------------------------------------------------------------------------------


def test_taps_that_leave_a_holding_arm_and_return_to_it_give_no_second_pulse():
    holder = np.array([-1.0])
    hand = object.__new__(HapticHand)  # without the law of the forces, which takes seconds to compile
    hand._arms = [SimpleNamespace(index=0), SimpleNamespace(index=1), SimpleNamespace(index=-1)]
    hand._grasps = [GraspPulse() for _ in hand._arms]
    hand._holders = [holder]

    def pulses(arm, begin, end):
        return sum(hand._is_pulsing(arm, t) for t in np.arange(round(begin / DT), round(end / DT)) * DT)

    assert pulses(0, 0.0, 0.5) == 0
    holder[0] = 0
    assert pulses(0, 0.5, 0.6) == 3
    assert pulses(1, 0.6, 1.0) == 0
    assert pulses(0, 1.0, 1.2) == 0, "the arm has held the object all the time"
    assert pulses(2, 1.2, 1.6) == 0
    holder[0] = -1
    assert pulses(1, 1.6, 2.0) == 0
    holder[0] = 0
    assert pulses(0, 2.0, 2.1) == 3, "the object was lost while another arm was controlled"
