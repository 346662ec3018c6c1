"""The audit of a motion: each check is silent on what was planned, and bites on a defect that is seeded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.planning.plan import plan
from twin.validation import margins, rcm_between_samples, rcm_fixes, sampled_timing
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import SampleClock


@pytest.fixture(scope="module")
def sils():
    return twin.load("sils")


@pytest.fixture(scope="module")
def planned(sils):
    """The protocol and its plan in steps of 5 ms."""
    protocol = sils.protocol("table2")
    T = sils.mechanism.frame_in_tool(protocol.frame)
    return protocol, plan(protocol, sils.path_kinematics(), T_tool_frame=T, dt=5e-3)


@pytest.fixture(scope="module")
def printed(sils):
    protocol = sils.protocol("table2_printed")
    T = sils.mechanism.frame_in_tool(protocol.frame)
    return protocol, plan(protocol, sils.path_kinematics(), T_tool_frame=T, dt=0.01)


def thinned(trajectory, every):
    """Every so many samples, and the ends of phases moved to the next that is left."""
    rows = np.unique([*range(0, len(trajectory.t) - every, every)])
    kept = {
        n: getattr(trajectory, n)[rows]
        for n in ("t", "q", "qd", "qdd", "Ts_base_tool", "Ts_base_frame", "tip_velocity", "angular_velocity")
    }
    spans, start = [], 0
    for s in trajectory.phases:
        stop = int(np.argmin(np.abs(rows - s.stop)))
        spans.append(replace(s, start=start, stop=stop, t0=kept["t"][start], t1=kept["t"][stop]))
        start = stop
    return replace(trajectory, **kept, phases=tuple(spans))


def codes(findings):
    return {f.code for f in findings}


# -- timing


def test_what_was_planned_is_within_its_limits_by_its_samples_alone(sils, planned):
    protocol, trajectory = planned
    facts, found = sampled_timing.check_rates(trajectory, sils.mechanism, protocol)
    assert found == []
    assert facts["tip speed"].startswith("tip speed of tool in phase 'withdraw': 14.98 of 15")
    assert facts["speed"].startswith("joint q4: 38.2")
    assert "mm/s3" in facts["jerk, maximum in mm/s3"]


def _faster(t):
    return replace(t, t=0.8 * t.t, phases=tuple(replace(p, t0=0.8 * p.t0, t1=0.8 * p.t1) for p in t.phases))


def _slower(t):
    return replace(t, t=1.25 * t.t, phases=tuple(replace(p, t0=1.25 * p.t0, t1=1.25 * p.t1) for p in t.phases))


def _bump(t):
    q = t.q.copy()
    q[1000, 2] += 0.05 * MM
    return replace(t, q=q)


def _tip_bump(t):
    Ts = t.Ts_base_frame.copy()
    Ts[1000, 0, 3] += 0.01 * MM
    return replace(t, Ts_base_frame=Ts)


def _turn(t):
    Ts = t.Ts_base_frame.copy()
    Ts[1000, :3, :3] = spatial.exp_so3([0, 0, 0.01 * DEG]) @ Ts[1000, :3, :3]
    return replace(t, Ts_base_frame=Ts)


def _uneven(t):
    times = t.t.copy()
    times[500] += 1e-4
    return replace(t, t=times)


def _backwards(t):
    times = t.t.copy()
    times[500] = times[498]
    return replace(t, t=times)


def _in_motion(t):
    first = t.phases[0]
    cut = slice(200, None)
    names = ("t", "q", "qd", "qdd", "Ts_base_tool", "Ts_base_frame", "tip_velocity", "angular_velocity")
    spans = [replace(p, start=max(p.start - 200, 0), stop=p.stop - 200) for p in t.phases]
    spans[0] = replace(spans[0], t0=float(t.t[200]))
    assert first.stop > 200
    return replace(t, **{n: getattr(t, n)[cut] for n in names}, phases=tuple(spans))


def _boastful(t):
    return replace(t, qd=1.3 * t.qd)


def _gap_in_phases(t):
    return replace(t, phases=(*t.phases[:2], *t.phases[3:]))


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (_faster, "timing.tip_speed"),
        (_faster, "timing.tip_acceleration"),
        (_slower, "timing.claimed"),
        (_bump, "timing.acceleration"),
        (_tip_bump, "timing.tip_acceleration"),
        (_turn, "timing.rotation_acceleration"),
        (_uneven, "timing.clock"),
        (_backwards, "timing.clock"),
        (_in_motion, "timing.rest"),
        (_boastful, "timing.claimed"),
        (_gap_in_phases, "timing.phases"),
    ],
)
def test_a_defect_of_the_timing_is_found_without_the_planners_word(sils, planned, spoil, code):
    protocol, trajectory = planned
    _, found = sampled_timing.check_rates(spoil(trajectory), sils.mechanism, protocol)
    assert code in codes(found)
    assert all(f.severity == "disagreement" for f in found)


@pytest.mark.nightly
def test_the_whole_judgement_does_not_believe_a_trajectory_its_own_findings(sils, planned):
    _, trajectory = planned
    report = twin.validate(sils, _faster(trajectory), protocol="table2")
    assert report.verdict == "disagree"
    assert "timing.tip_speed" in codes(report.findings)
    moved = {
        p.rcm_mode: replace(p, rcm=p.rcm + np.array([1 * MM, 0, 0])) for p in trajectory.phases if p.rcm is not None
    }
    other = replace(
        trajectory, phases=tuple(moved.get(p.rcm_mode, p) if p.name == "sweep" else p for p in trajectory.phases)
    )
    report = twin.validate(sils, other, protocol="table2")
    assert {"rcm.missed", "rcm.mechanism"} & codes(report.findings)  # its own findings still say rcm.kept


# -- the RCM between samples


def test_between_samples_the_shaft_keeps_the_rcm(sils, planned):
    _, trajectory = planned
    found = rcm_between_samples.passages(sils.reference(), trajectory)
    assert [p.phase for p in found] == ["insert", "sweep", "straighten", "withdraw"]
    assert max(p.between for p in found) < 1e-9
    assert all(p.bound >= p.between for p in found)


def test_samples_that_are_right_can_hide_a_path_that_is_not(sils, planned):
    """Half a second between samples: each keeps the RCM exactly, the joints on their cubics do not."""
    _, trajectory = planned
    coarse = thinned(trajectory, 100)
    clock = SampleClock(coarse.t, ())
    out = EquationsComparison()
    rcm_between_samples.between_samples(sils.reference(), coarse, 0.01 * MM, out, clock)
    at = {r.name.split(",")[0]: r.worst for r in out.residuals}
    assert max(at["sweep"], at["straighten"]) > 0.01 * MM
    assert "rcm.between" in codes(out.findings)
    sampled = {p.phase: p.at_samples for p in rcm_between_samples.passages(sils.reference(), coarse)}
    assert max(sampled["sweep"], sampled["straighten"]) < 1e-9
    finer = thinned(trajectory, 10)
    rcm_between_samples.between_samples(
        sils.reference(), finer, 0.01 * MM, out := EquationsComparison(), SampleClock(finer.t, ())
    )
    assert out.findings == []


def test_the_maximum_between_samples_is_that_of_a_dense_look(sils, planned):
    _, trajectory = planned
    coarse = thinned(trajectory, 100)
    span = coarse.phase("sweep")
    found = next(p for p in rcm_between_samples.passages(sils.reference(), coarse) if p.phase == "sweep")
    x = np.linspace(span.start, span.stop, 40 * (span.stop - span.start) + 1)
    dense = np.linalg.norm(
        rcm_between_samples.shaft_to_rcm(
            rcm_between_samples._poses_between(sils.reference(), coarse, x), coarse.shaft_axis, span.rcm
        ),
        axis=1,
    )
    assert found.between == pytest.approx(dense.max(), rel=1e-3)


# -- consistent poses


def test_the_printed_target_and_what_would_keep_the_rcm(sils, printed):
    protocol, trajectory = printed
    T = sils.mechanism.frame_in_tool(protocol.frame)
    facts, found = rcm_fixes.rcm_fixes(protocol, trajectory, sils.path_kinematics(), T)
    move = facts["sweep: move the tip, keep the angles"]
    assert "by 45.78 mm" in move
    assert "the robot can do the protocol" in move
    assert "would still miss the RCM by 0.9" in move  # both ends right, the straight way between not
    turn = facts["sweep: turn the shaft, keep the tip"]
    assert "by 47.96°" in turn
    assert "out of reach" in turn
    assert "gap q4-q3" in turn
    least = facts["sweep: the smallest move and turn of the tool"]
    assert "26.6" in least
    assert "22.3" in least
    assert "skew" in facts["sweep: move the RCM"]
    assert facts["sweep: other interpretations of the angles"].startswith("none: every order and sign misses the RCM")
    assert codes(found) == {"rcm.fix"}
    assert len(found) == 2


def test_a_fix_states_no_size_of_zero():
    kept = rcm_fixes.Fix("move the tip, keep the angles", "t", 0.0, 0.0, "(1, 2, 3) mm", True, "no joint has limits")
    assert kept.text.startswith("move the tip, keep the angles: (1, 2, 3) mm; ")
    assert ", by 0.002 mm: " in replace(kept, moved=2e-6).text  # not 0.00 mm
    assert ", by 1 mm and 57.3°: " in replace(kept, moved=1e-3, turned=1.0).text


def test_a_protocol_that_keeps_its_rcm_needs_no_fix(sils, planned):
    protocol, trajectory = planned
    T = sils.mechanism.frame_in_tool(protocol.frame)
    assert rcm_fixes.rcm_fixes(protocol, trajectory, sils.path_kinematics(), T) == ({}, [])


def test_a_wrong_sign_of_an_angle_is_recognised(sils, printed):
    """The pose that keeps the RCM, written with its first angle turned round: the reading that is meant is named."""
    protocol, trajectory = printed
    w = protocol.waypoints["t"]
    span = trajectory.phase("sweep")
    from twin.planning.protocol.course import rotation

    R = rotation(w.angles, "zyx")
    right = span.rcm + 40 * MM * (R @ trajectory.shaft_axis)
    wrong = replace(w, position=right, angles=w.angles * [1, -1, 1])
    other = replace(protocol, waypoints={**protocol.waypoints, "t": wrong})
    assert "signs +, -, +: the shaft passes through the RCM" in rcm_fixes._other_angle_conventions(
        other, trajectory, span
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_pose_keeps_the_rcm_and_none_beside_it_is_nearer(seed):
    rng = np.random.default_rng(seed)
    T = spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3) * 0.1)
    axis, rcm, lever = np.array([0, 0, -1.0]), rng.normal(size=3) * 0.1, 0.08
    best = rcm_fixes.nearest_pose_through_rcm(T, axis, rcm, lever)

    def cost(X):
        turn = spatial.rotation_angle(T[:3, :3].T @ X[:3, :3])
        return np.sum((X[:3, 3] - T[:3, 3]) ** 2) + lever**2 * turn**2

    assert spatial.point_to_line(rcm, best[:3, 3], best[:3, :3] @ axis) < 1e-12
    for _ in range(50):
        R = spatial.exp_so3(rng.normal(size=3) * 0.02) @ best[:3, :3]
        u = R @ axis
        p = best[:3, 3] + rng.normal(size=3) * 1e-3
        p += (np.eye(3) - np.outer(u, u)) @ (rcm - p)
        assert cost(spatial.pose(R, p)) >= cost(best) * (1 - 1e-9)


# -- margins


def test_margins_name_each_joint_and_when(sils, planned):
    _, trajectory = planned
    clock = SampleClock(trajectory.t, ())
    left = margins.margin_texts(trajectory, sils.mechanism, sils.path_kinematics(), clock)
    assert left["joint q4"].startswith("5.16 mm to its lower limit")
    assert left["joint q2"].startswith("3.51 mm to its upper limit")
    assert left["singularity type2"].startswith("-0.72")
    assert left["working mode"].endswith("throughout")


def test_the_mechanism_tells_its_own_singularity_and_a_jump(sils, planned):
    _, trajectory = planned
    model = sils.reference()
    rows = np.arange(0, len(trajectory.t), 40)
    posed = model.run_poses(trajectory.Ts_base_tool[rows])
    clock = SampleClock(trajectory.t, ())
    facts, found, curves = margins.mechanism_margins(model, posed, rows, clock)
    assert found == []
    assert curves["conditioning.type1"].min() > 0.05
    assert "1: best" in facts["mechanism, drives at rest (type 2)"]
    name = model.mechanism.passive[0].name
    other = posed.q_passive[name].copy()
    other[30:] += 0.5
    _, found, _ = margins.mechanism_margins(
        model, replace(posed, q_passive={**posed.q_passive, name: other}), rows, clock
    )
    assert [(f.code, f.where) for f in found] == [("branch.jump", name)]


def test_a_stretched_bar_is_a_singularity_of_the_mechanism(sils):
    """Towards h1 = 0 the bar stands across its rail: the carriages move and the platform does not."""
    from twin.reference.conditioning import conditioning

    model = sils.reference()
    home = model.home()
    kin = sils.kinematics()
    worst = []
    for height in (0.0, 60.0, 105.0):
        T = home.T_base_tool.copy()
        T[:3, 3] += [height * MM, 0, 0]
        worst.append(float(conditioning(model, model.solve(kin.inverse(T)).x[None], 0.1).type1[0]))
    assert worst[0] > worst[1] > worst[2]
