"""Whole protocols on the SILS robot, with an inverse kinematics that only these tests know.

Closed form: facts of the PUBLISHED paper (Rom. J. Techn. Sci. - Appl. Mech. 68(1), 2023), mode N.
"""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import ProtocolError, TimingError
from twin.core.findings import verdict
from twin.planning.check import check
from twin.planning.path_kinematics import Gap, PathKinematics
from twin.planning.plan import plan
from twin.planning.protocol import Insertion, Pivot, Retraction, Waypoint, load_protocol

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "trajectories" / "sils"
OFFSET, STRUT, BAR, PLATFORM, WIDTH, HEIGHT = 0.05, 0.182, 0.574, 0.135, 0.612, 0.657
SIDE = np.array([1.0, -1.0, 1.0])
RAIL = np.array([[0, 0, 1.0], [0, 1.0, 0], [0, 0, 1.0]])
BALLS = PLATFORM * np.array([[3**0.5 / 6, -0.5, 0], [-(3**0.5) / 3, 0, 0], [3**0.5 / 6, 0.5, 0]])
MM, RCM_TOLERANCE = 1e-3, 1e-9
T_TOOL_TIP = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, -0.3], [0, 0, 0, 1.0]])  # 300 mm endoscope


def limbs(Ts):
    """Ball centres (k, 3, 3), distances from the rails (k, 3), radial vectors (k, 3, 3) and places along."""
    S = Ts[:, None, :3, 3] + BALLS @ np.swapaxes(Ts[:, :3, :3], 1, 2)
    from_rail = S - np.array([[0, 0, 0], [0, 0, HEIGHT], [0, WIDTH, 0]])
    along = np.sum(from_rail * RAIL, axis=2)
    radial = from_rail - along[..., None] * RAIL
    rho = np.linalg.norm(radial, axis=2)
    return S, rho, radial / rho[..., None], along


def bar_heights(rho):
    with np.errstate(invalid="ignore"):
        return np.sqrt(BAR**2 - (rho - OFFSET) ** 2)


def inverse(Ts):
    _, rho, _, along = limbs(Ts)
    h = bar_heights(rho)
    even = along + SIDE * h
    return np.stack([even - 2 * SIDE * STRUT * h / BAR, even], axis=2).reshape(-1, 6)


def velocity(Ts, q, twists):
    S, rho, radial, _ = limbs(Ts)
    v = twists[:, None, :3] + np.cross(twists[:, None, 3:], S - Ts[:, None, :3, 3])
    along = np.sum(v * RAIL, axis=2)
    out = SIDE * (rho - OFFSET) / bar_heights(rho) * np.sum(v * radial, axis=2)
    return np.stack([along - (BAR - 2 * STRUT) / BAR * out, along - out], axis=2).reshape(-1, 6)


def singularity(Ts, q):
    S, rho, radial, _ = limbs(Ts)
    t = np.cross(RAIL, radial)
    u = (S - np.roll(S, -1, axis=1)) / PLATFORM  # u12, u23, u31
    ahead = np.sum(u * np.roll(t, -1, axis=1), axis=2)
    behind = np.sum(u * t, axis=2)
    measures = {"type2": np.prod(ahead, axis=1) - np.prod(behind, axis=1)}
    return measures | {f"type1_limb{i + 1}": bar_heights(rho)[:, i] / BAR for i in range(3)}


def reach(Ts):
    rho = limbs(Ts)[1]
    return {f"limb{i + 1}": BAR - np.abs(rho[:, i] - OFFSET) for i in range(3)}


SILS = PathKinematics(
    joint_names=("q1", "q2", "q3", "q4", "q5", "q6"),
    inverse=inverse,
    reach=reach,
    singularity=singularity,
    singularity_alarm={"type2": 0.15, "type1": 0.1},
    branch=lambda Ts, q: np.sign(q[:, 1] - q[:, 0]).astype(int),
    lower=np.array([20, 20, -10, -10, 20, 20]) * MM,
    upper=np.array([580, 580, 600, 600, 580, 580]) * MM,
    soft_lower=np.zeros(6),
    soft_upper=np.full(6, 612 * MM),
    max_speed=np.full(6, 0.1),
    max_acceleration=np.full(6, 0.5),
    gaps=(Gap(0, 1, 40 * MM, "rail1"), Gap(2, 3, 40 * MM, "rail2"), Gap(4, 5, 40 * MM, "rail3")),
)

# DERIVED in the project's fact sheet from Table 2 (PUBLISHED), mode N, nine digits, mm
JOINTS = {
    "c": (312.498356767, 524.843287564, 183.986838951, -4.84215325, 345.305837665, 575.267953963),
    "b": (328.226409619, 576.485519625, 183.904456795, 17.338848572, 317.430227422, 546.975954952),
    "i": (288.226409619, 536.485519625, 213.499968931, 98.233248411, 277.430227422, 506.975954952),
    "t": (233.410331864, 446.183276389, 224.903233553, 110.259880562, 272.064914145, 513.655971409),
    "t_prime": (265.881475, 512.433284, 171.623015, 11.042153, 291.460458, 544.166007),
}
JOINT_TOLERANCE_MM = 1e-6

CASES = {"table2": np.eye(4), "table2_printed": np.eye(4), "lowered_patient": T_TOOL_TIP}


@pytest.fixture(scope="module")
def planned():
    """Every shipped protocol, planned once."""
    protocols = {name: load_protocol(FOLDER / f"{name}.toml") for name in CASES}
    return {n: (p, plan(p, SILS, T_tool_frame=CASES[n])) for n, p in protocols.items()}


def by_code(trajectory, code):
    return [f for f in trajectory.findings if f.code == code]


@pytest.mark.parametrize("name", CASES)
def test_joint_coordinates_at_the_waypoints_are_the_published_ones(planned, name):
    trajectory = planned[name][1]
    for waypoint, rows in trajectory.waypoints.items():
        for k in rows if waypoint in JOINTS else ():
            np.testing.assert_allclose(trajectory.q[k] / MM, JOINTS[waypoint], atol=JOINT_TOLERANCE_MM, rtol=0)


@pytest.mark.parametrize("name", CASES)
def test_every_limit_holds_at_every_sample(planned, name):
    protocol, trajectory = planned[name]
    assert np.max(np.abs(trajectory.qd)) <= 0.1 * (1 + 1e-6)
    assert np.max(np.abs(trajectory.qdd)) <= 0.5 * (1 + 1e-6)
    for span in trajectory.phases:
        limits, rows = protocol.limits[span.type], slice(span.start + 1, span.stop + 1)
        for values, limit in (
            (trajectory.tip_velocity, limits.tip_speed),
            (trajectory.tip_acceleration, limits.tip_acceleration),
            (trajectory.angular_velocity, limits.rotation_speed),
            (trajectory.angular_acceleration, limits.rotation_acceleration),
        ):
            assert np.max(np.linalg.norm(values[rows], axis=1)) <= limit * (1 + 1e-6)
    assert np.min(trajectory.limit_margin) > 0
    assert not [f for f in trajectory.findings if f.code.startswith(("limit.s", "limit.t")) and f.where != "q4"]


@pytest.mark.parametrize("name", CASES)
def test_samples_are_uniform_and_every_phase_rests_at_both_ends(planned, name):
    trajectory = planned[name][1]
    np.testing.assert_allclose(trajectory.t, np.arange(len(trajectory.t)) * 1e-3, atol=1e-12)
    assert 5 < trajectory.duration < 60
    for before, after in zip(trajectory.phases, trajectory.phases[1:], strict=False):
        assert before.stop == after.start
    for span in trajectory.phases:
        for k in (span.start, span.stop):
            np.testing.assert_allclose(trajectory.qd[k], 0, atol=1e-9)
        assert span.optimal <= span.t1 - span.t0 <= span.optimal * 1.02 + 1e-3


@pytest.mark.parametrize("name", CASES)
def test_joints_between_samples_follow_their_speeds_and_are_those_of_sample(planned, name, rng):
    trajectory = planned[name][1]
    t = rng.uniform(0, trajectory.duration, 50)
    q = trajectory.joints(t)
    np.testing.assert_array_equal(q, [trajectory.sample(x)[0] for x in t])
    np.testing.assert_allclose(trajectory.joints(trajectory.t), trajectory.q, atol=1e-15)
    h = 1e-7
    k = rng.integers(1, len(trajectory.t) - 1, 50)
    ahead, behind = trajectory.joints(trajectory.t[k] + h), trajectory.joints(trajectory.t[k] - h)
    np.testing.assert_allclose((ahead - behind) / (2 * h), trajectory.qd[k], atol=1e-6)


@pytest.mark.parametrize("name", CASES)
def test_speeds_and_accelerations_are_those_of_the_positions(planned, name):
    """Between the switches of the path acceleration, where differences are meaningful."""
    trajectory = planned[name][1]
    q, qd, qdd, dt = trajectory.q, trajectory.qd, trajectory.qdd, 1e-3
    calm = np.ones(len(q) - 4, bool)
    jumps = np.max(np.abs(np.diff(qdd, axis=0)), axis=1) > 1e-3
    for shift in range(4):
        calm &= ~jumps[shift : len(jumps) - 3 + shift]
    slope = (8 * (q[3:-1] - q[1:-3]) - (q[4:] - q[:-4])) / (12 * dt)
    bend = (8 * (qd[3:-1] - qd[1:-3]) - (qd[4:] - qd[:-4])) / (12 * dt)
    assert np.mean(calm) > 0.5
    np.testing.assert_allclose(slope[calm], qd[2:-2][calm], atol=1e-6 * np.max(np.abs(qd)))
    assert np.percentile(np.abs(bend - qdd[2:-2])[calm], 95) < 1e-5 * np.max(np.abs(qdd))
    twists = np.column_stack([np.gradient(trajectory.Ts_base_tool[:, :3, 3], dt, axis=0), trajectory.angular_velocity])
    np.testing.assert_allclose(velocity(trajectory.Ts_base_tool, q, twists)[2:-2][calm], qd[2:-2][calm], atol=1e-6)


@pytest.mark.parametrize("name", ["table2", "lowered_patient"])
def test_an_enforced_rcm_is_kept_from_registration_to_withdrawal(planned, name):
    trajectory = planned[name][1]
    inside = np.isfinite(trajectory.rcm_error)
    assert inside.any()
    assert not inside[0]
    assert np.nanmax(trajectory.rcm_error) < RCM_TOLERANCE
    (kept,) = by_code(trajectory, "rcm.kept")
    assert kept.severity == "info"
    assert verdict(trajectory.findings) == "agree"
    assert np.nanmin(trajectory.depth) > -RCM_TOLERANCE


def test_the_printed_target_misses_the_rcm_by_45_78_mm(planned):
    trajectory = planned["table2_printed"][1]
    (missed,) = by_code(trajectory, "rcm.missed")
    assert (missed.severity, missed.unit, missed.limit) == ("disagreement", "mm", pytest.approx(0.1))
    assert missed.size == pytest.approx(45.780, abs=5e-4)
    assert missed.where == "RCM at (380.00, 280.00, 185.00) mm"
    assert "phase 'sweep'" in missed.when
    assert "waypoint 't'" in missed.when
    assert verdict(trajectory.findings) == "disagree"
    span, k = trajectory.phase("sweep"), trajectory.waypoints["t"][0]
    assert k == span.stop
    # a quarter, half and three quarters of the way (DERIVED, coordinates linear in s)
    path = trajectory.Ts_base_frame[span.start : span.stop + 1, :3, 3]
    s = np.linalg.norm(path - path[0], axis=1) / np.linalg.norm(path[-1] - path[0])
    at = np.interp([0.25, 0.5, 0.75], s, trajectory.rcm_error[span.start : span.stop + 1])
    np.testing.assert_allclose(at / MM, [10.598, 21.844, 33.632], atol=0.01)


def test_q4_leaves_the_frame_at_c(planned):
    for name in ("table2", "table2_printed"):
        (soft,) = by_code(planned[name][1], "limit.soft")
        assert (soft.severity, soft.where, soft.unit) == ("warning", "q4", "mm")
        assert soft.size == pytest.approx(4.84215325, abs=1e-6)
        assert "waypoint 'c'" in soft.when


def test_insertions_are_straight(planned):
    for name in CASES:
        (straight,) = by_code(planned[name][1], "insertion.straight")
        assert straight.size < 1e-9


def test_planning_twice_gives_the_same_numbers(planned):
    protocol, first = planned["table2_printed"]
    second = plan(protocol, SILS, T_tool_frame=np.eye(4))
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.qdd, second.qdd)


def table2(*phases, **waypoints):
    """C -> B -> I of Table 2, then other phases."""
    protocol = load_protocol(FOLDER / "table2.toml")
    extra = {
        n: Waypoint(n, np.deg2rad(a), None if p is None else np.array(p) * MM, d, n, "ASSUMED", "test")
        for n, (p, d, a) in waypoints.items()
    }
    return replace(protocol, phases=(*protocol.phases[:2], *phases), waypoints={**protocol.waypoints, **extra})


def refusal(protocol, kinematics=SILS, frame=np.eye(4)):  # noqa: B008 - never changed
    with pytest.raises(ProtocolError) as caught:
        plan(protocol, kinematics, T_tool_frame=frame)
    return str(caught.value)


def test_out_of_stroke_says_where_how_much_and_what_would_do():
    message = refusal(table2(Pivot("sweep", "t_prime", "enforced"), Retraction("withdraw")))
    assert "phase 'withdraw' (retraction)" in message
    assert "joint q4 would go 24.30 mm below its lower limit of -10.00 mm" in message
    assert "from 43.2 % of the phase on" in message
    depth = float(message.split("retraction to a depth of ")[1].split(" mm")[0])
    plan(
        table2(Pivot("sweep", "t_prime", "enforced"), Retraction("withdraw", (depth + 0.01) * MM)),
        SILS,
        T_tool_frame=np.eye(4),
    )


def test_out_of_reach_names_the_limb_and_the_largest_depth():
    protocol = table2()
    deep = replace(protocol, phases=(protocol.phases[0], Insertion("insert", 0.3)))
    wide = replace(SILS, lower=np.full(6, -9.0), upper=np.full(6, 9.0), gaps=())
    message = refusal(deep, wide)
    assert "limb2 is too short by" in message
    depth = float(message.split("insertion to a depth of ")[1].split(" mm")[0])
    T = np.repeat(np.eye(4)[None], 2, axis=0)
    T[:, :3, 3] = [[0.38, 0.28, 0.185 - (depth + d) * MM] for d in (0.0, 0.2)]
    assert reach(T)["limb2"][0] > 0 > reach(T)["limb2"][1]


def test_too_much_tilt_says_how_far_it_goes():
    message = refusal(table2(Pivot("over", "steep", "enforced"), steep=(None, 0.04, (0, 60, 0))))
    assert "phase 'over' (pivot)" in message
    assert ", tilted by " in message
    assert " deg from the start of the phase" in message


def test_a_singularity_on_the_way_is_an_error():
    wide = replace(SILS, lower=np.full(6, -9.0), upper=np.full(6, 9.0), gaps=())
    message = refusal(table2(Pivot("roll", "rolled", "enforced"), rolled=(None, 0.0, (0, 0, 110))), wide)
    assert "phase 'roll'" in message
    assert "singularity: the measure type2 changes its sign" in message or "too short" in message


def test_carriages_on_one_rail_keep_their_distance():
    message = refusal(table2(), replace(SILS, gaps=(Gap(2, 3, 0.12, "rail2"),)))
    assert "gap rail2 would shrink to 115.27 mm, 4.73 mm less than the required 120 mm" in message


def test_an_unreachable_start_says_so():
    message = refusal(table2(), replace(SILS, upper=np.full(6, 0.5)))
    assert "already at the start of the phase" in message
    assert "No part of the phase is reachable" in message


def test_a_change_of_working_mode_is_an_error():
    mode = replace(SILS, branch=lambda Ts, q: (Ts[:, 2, 3] > 0.17).astype(int))
    assert "the working mode changes" in refusal(table2(), mode)


def test_an_inverse_that_jumps_is_not_taken_for_a_motion():
    def jumping(Ts):
        return inverse(Ts) + 0.001 * (Ts[:, 2:3, 3] > 0.17)

    assert "not a smooth function of the path" in refusal(table2(), replace(SILS, inverse=jumping))


def test_an_inverse_without_an_answer_is_an_error():
    def holes(Ts):
        return np.where(Ts[:, 2:3, 3] < 0.17, np.nan, inverse(Ts))

    assert "the inverse kinematics has no solution" in refusal(table2(), replace(SILS, inverse=holes))


def test_a_frame_that_is_no_pose_is_refused():
    assert "T_tool_frame of 'tool' is not a pose" in refusal(table2(), frame=np.zeros((4, 4)))


def test_timing_errors_name_the_phase(planned):
    with pytest.raises(TimingError, match="phase 'approach'"):
        plan(planned["table2"][0], replace(SILS, max_speed=np.zeros(6)), T_tool_frame=np.eye(4))


def test_a_waypoint_beside_the_insertion_is_found():
    protocol = table2(side=((381, 280, 145), None, (0, 0, 0)))
    protocol = replace(protocol, phases=(protocol.phases[0], Insertion("insert", 0.04, "side")))
    (missed,) = by_code(plan(protocol, SILS, T_tool_frame=np.eye(4)), "waypoint.missed")
    assert missed.size == pytest.approx(1.0)
    assert missed.severity == "disagreement"


def spoil(trajectory, name, rows, amount):
    values = getattr(trajectory, name).copy()
    values[rows] += amount
    return replace(trajectory, **{name: values})


def test_the_check_finds_every_seeded_defect(planned):
    protocol, good = planned["table2"]
    middle = slice(5000, 5001)  # inside the insertion
    shift = np.zeros((4, 4))
    shift[0, 3] = 0.5 * MM
    defects = {
        "limit.hard": spoil(good, "q", middle, [0, 1.0, 0, 0, 0, 0]),
        "limit.speed": spoil(good, "qd", middle, 0.2),
        "limit.acceleration": spoil(good, "qdd", middle, 1.0),
        "limit.tip_speed": spoil(good, "tip_velocity", middle, 0.1),
        "limit.tip_acceleration": spoil(good, "tip_acceleration", middle, 1.0),
        "limit.rotation_speed": spoil(good, "angular_velocity", middle, 1.0),
        "limit.rotation_acceleration": spoil(good, "angular_acceleration", middle, 9.0),
        "trajectory.inconsistent": spoil(good, "q", middle, 1e-5),
        "rcm.missed": spoil(good, "Ts_base_frame", middle, shift),
        "insertion.bent": spoil(good, "Ts_base_frame", middle, shift),
        "waypoint.missed": spoil(good, "Ts_base_frame", slice(good.phases[0].stop, good.phases[0].stop + 1), shift),
        "limit.gap": spoil(good, "q", middle, [0.23, 0, 0, 0, 0, 0]),
        "branch.changed": spoil(good, "q", middle, [0.4, 0, 0, 0, 0, 0]),
    }
    before = {f.code for f in check(good, protocol, SILS)}
    for code, bad in defects.items():
        assert code not in before
        found = [f for f in check(bad, protocol, SILS) if f.code == code]
        assert found, code
        assert found[0].severity in ("disagreement", "error")
        if code.startswith(("limit.tip", "limit.rotation")):  # the phase sets these limits, not the robot
            assert "[limits.insertion]" in found[0].suggestion
        if code == "limit.speed":
            assert "raise the limit of the robot" in found[0].suggestion


def test_the_check_warns_near_a_singularity_and_fails_across(planned):
    protocol, good = planned["table2"]
    near = replace(SILS, singularity_alarm={"type2": 0.9})
    assert [f.where for f in check(good, protocol, near) if f.code == "singularity.near"] == ["type2"]
    across = replace(SILS, singularity=lambda Ts, q: {"type2": Ts[:, 2, 3] - 0.17})
    (crossed,) = [f for f in check(good, protocol, across) if f.code == "singularity.crossed"]
    assert crossed.severity == "error"
    short = replace(SILS, reach=lambda Ts: {"limb1": np.full(len(Ts), -1e-3)})
    assert "error" in {f.severity for f in check(good, protocol, short) if f.code == "margin.reach"}


def test_a_trajectory_answers_for_any_time(planned):
    trajectory = planned["table2"][1]
    for t in (0.0, 1.2345, 7.0001, trajectory.duration, trajectory.duration + 1):
        q, T = trajectory.sample(t)
        assert spatial.is_pose(T, 1e-12)
        np.testing.assert_allclose(q, inverse(T[None])[0], atol=2e-6)
    assert trajectory.phase("insert").type == "insertion"
    assert trajectory.phase(0.0).name == "approach"
    with pytest.raises(ProtocolError, match="Did you mean 'insert'"):
        trajectory.phase("inset")
    with pytest.raises(ProtocolError, match="outside"):
        trajectory.phase(1e9)


def test_plain_data_is_strict_json(planned):
    trajectory = planned["table2_printed"][1]
    data = json.loads(json.dumps(trajectory.as_dict(), allow_nan=False))
    assert (data["samples"], len(data["q"]), len(data["q"][0])) == (len(trajectory.t), len(trajectory.t), 6)
    assert data["rcm_error"][0] is None
    assert data["phases"][1]["rcm"] == pytest.approx([0.38, 0.28, 0.185])
    assert "q" not in trajectory.as_dict(arrays=False)


def test_progress_hears_of_every_phase(planned):
    heard = []
    plan(planned["table2_printed"][0], SILS, T_tool_frame=np.eye(4), progress=heard.append)
    assert heard == ["approach", "insert", "sweep"]


def test_a_micrometre_insertion_is_planned(planned):
    protocol = table2()
    tiny = replace(protocol, phases=(protocol.phases[0], Insertion("insert", 1e-6)))
    trajectory = plan(tiny, SILS, T_tool_frame=np.eye(4))
    span = trajectory.phase("insert")
    assert 0 < span.t1 - span.t0 < 0.05
    assert not by_code(trajectory, "limit.acceleration")


def test_toppra_is_loaded_only_when_something_is_timed():
    heavy = "('toppra', 'scipy', 'matplotlib')"
    code = f"import sys, twin.planning.plan; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
