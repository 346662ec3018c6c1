"""The self-test: faults are drawn as meant, equivalent ones are told from missed ones, and the score counts."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from made.arm import arm
from twin.analysis.mutation import cad, formula, trajectory_faults, units, usd
from twin.analysis.mutation.bench import Bench
from twin.analysis.mutation.equivalent import MatrixKinematics, same_equations, same_motion, same_samples
from twin.analysis.mutation.fault import FAMILIES, Detection, SeededFault
from twin.analysis.mutation.score import Score
from twin.analysis.mutation.trials import SHARES, bench_of, random_faults, shared_out
from twin.cli import main
from twin.core import spatial
from twin.core.findings import Finding
from twin.core.provenance import Parameter
from twin.core.units import MM
from twin.ui.report.selftest_score import HEADING, with_selftest


@pytest.fixture(scope="module")
def bench():
    with bench_of("sils", None) as made:
        yield made


def outcome(family, state, code="x"):
    return Detection(family, "k", "what", state, code if state in ("caught", "warned") else "", "", "", 0.1)


def test_the_score_counts_what_is_a_fault():
    some = [outcome("cad", "caught")] * 18 + [outcome("usd", "warned"), outcome("usd", "equivalent")]
    score = Score("r", "p", "s", 0, 1.0, tuple(some), ())
    assert (score.counted, score.caught, score.share, score.passed) == (19, 19, 1.0, True)
    worse = replace(score, outcomes=(*some, outcome("cad", "missed")))
    assert worse.share == pytest.approx(0.95)
    assert worse.passed
    assert not replace(worse, outcomes=(*worse.outcomes, outcome("cad", "missed"))).passed
    accused = replace(score, false_alarms=(Finding("point.differs", "disagreement", "no"),))
    assert (accused.passed, accused.exit_code) == (False, 1)
    said = json.loads(json.dumps(accused.as_dict()))
    assert [f["state"] for f in said["faults"]] == [o.state for o in some]
    assert [f["code"] for f in said["false_alarms"]] == ["point.differs"]
    assert [r["family"] for r in score.families()] == ["cad", "usd"]
    assert score.families()[1]["equivalent"] == 1


@pytest.mark.nightly
def test_a_draw_is_the_same_for_the_same_seed_and_another_for_another(bench):
    one, two, other = (random_faults(bench, ("cad", "timing"), 40, s) for s in (3, 3, 4))
    assert [f.what for f in one] == [f.what for f in two] != [f.what for f in other]
    alone = random_faults(bench, ("timing",), 18, 3)
    beside = random_faults(bench, FAMILIES[3:], 34, 3)
    assert {f.what for f in alone} <= {f.what for f in beside} | {f.what for f in one}


def _with(*parameters):
    return SimpleNamespace(formula=SimpleNamespace(parameters=parameters), parameters={})


def test_a_unit_fault_is_of_a_parameter_with_a_unit():
    rng = np.random.default_rng(0)
    ratio = Parameter("ratio", 2.0, "1", 2.0, "ASSUMED", "")
    length = Parameter("length", 0.1, "mm", 100.0, "ASSUMED", "")
    none = Parameter("none", 0.0, "mm", 0.0, "ASSUMED", "")
    assert units._parameter_fault(_with(ratio, none), rng) is None
    for _ in range(5):
        assert units._parameter_fault(_with(ratio, none, length), rng).what.startswith("length with m")


def test_a_fault_of_the_speed_does_not_depend_on_the_order_of_the_file():
    for keys in (("tip_speed_mm_s", "tip_acceleration_mm_s2"), ("tip_acceleration_mm_s2", "tip_speed_mm_s")):
        changed = set()
        for seed in range(8):
            document = {"limits": {"pivot": dict.fromkeys(keys, 40.0)}}
            what = units._limits_fault(document, np.random.default_rng(seed), name="tip", factor=1e-3, unit="m/s")
            limits = document["limits"]["pivot"]
            assert limits["tip_speed_mm_s"] == 0.04
            assert (limits["tip_acceleration_mm_s2"] == 0.04) is ("speed and acceleration" in what)
            changed.add(what)
        assert len(changed) == 2


@pytest.mark.nightly
def test_every_family_and_kind_is_drawn(bench):
    rng = np.random.default_rng(0)
    written = bench.case().written
    assert written is not None
    for made, kinds in (
        (list(formula.faults(bench.robot, rng, 16)), formula.KINDS),
        (list(cad.faults(bench.robot.mechanism, rng, 12)), set(cad.KINDS)),
        (list(usd.faults(written, rng, len(usd.KINDS))), set(usd.KINDS)),
        (
            list(trajectory_faults.faults(bench.trajectory, bench.protocol, bench.planned, rng, 10)),
            trajectory_faults.KINDS,
        ),
    ):
        assert {f.kind for f in made} == set(kinds)
    some = list(units.faults(bench.robot, bench.protocol_file, rng, 14))
    assert {f.kind for f in some} == {"parameter", "position", "angles", "speed", "depth", "turning"}
    assert len({f.what for f in some}) == 14


@pytest.mark.slow
def test_seeded_faults_of_the_formula_are_edits_that_run(bench, tmp_path):
    for i, fault in enumerate(formula.faults(bench.robot, np.random.default_rng(5), 8)):
        folder = tmp_path / str(i)
        folder.mkdir()
        assert fault.robot(folder).kinematics(parameters={}).joints == bench.kin.joints


@pytest.mark.slow
def test_equations_that_say_the_same_are_told_from_those_that_do_not(bench, tmp_path):
    source = bench.robot.files.formula.read_text(encoding="utf-8")
    assert source.count("(L_V - Z_S2)**2") >= 1
    made = {}
    for name, new in (("same", "(Z_S2 - L_V) ** 2"), ("other", "(L_V + Z_S2) ** 2")):
        path = tmp_path / f"{name}.py"
        path.write_text(source.replace("(L_V - Z_S2)**2", new), encoding="utf-8")
        made[name] = formula.with_formula(bench.robot, path).kinematics(parameters={})
    rng = np.random.default_rng(0)
    assert "are equal" in same_equations(bench.kin, made["same"], bench.trajectory, rng)
    assert same_equations(bench.kin, made["other"], bench.trajectory, rng) == ""


@pytest.mark.slow
def test_the_plain_chain_is_the_mechanism(bench):
    """Plain matrices and scipy place every body where Pinocchio does."""
    m = bench.robot.mechanism
    chain, model = MatrixKinematics(m), bench.robot.reference()
    q = bench.trajectory.q[0]
    mine = chain.bodies(q, chain.close(q, chain.start))
    theirs = model.solve(q).link_poses
    assert max(np.abs(mine[n] - theirs[n]).max() for n in theirs) < 1e-8


def changed(mechanism, name, **values):
    return cad._with_joints(mechanism, replace(mechanism.joint(name), **values))


def test_a_ball_whose_frame_is_turned_is_the_same_mechanism_and_one_that_is_moved_is_not(bench):
    m = bench.robot.mechanism
    for step, same in ((spatial.pose(spatial.exp_so3([0.01, 0, 0])), True), (spatial.pose(p=[0.1 * MM, 0, 0]), False)):
        joint = m.joint("s3")
        other = changed(m, "s3", T_child_joint=joint.T_child_joint @ step)
        assert bool(same_motion(m, other, bench.trajectory, places=2)) is same


@pytest.mark.nightly
def test_the_correct_robot_is_left_in_peace(bench):
    assert bench.correct_report.verdict == "agree"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("maker", "code"),
    [
        (lambda b: b.robot.mechanism, ""),
        (
            lambda b: changed(b.robot.mechanism, "q3", limits=(-10.0, 600.0)),
            "limit.implausible",
        ),
        (lambda b: changed(b.robot.mechanism, "q3", limits=(0.5, 0.6)), "limit.hard"),
    ],
)
def test_outcomes_of_faults_of_the_mechanism(bench, maker, code):
    out = bench.outcome(SeededFault("cad", "limit", "made", mechanism=lambda: maker(bench)))
    assert (out.state, out.code) == ("caught" if code else "equivalent", code)


@pytest.mark.nightly
def test_a_validator_that_is_deaf_misses(bench, monkeypatch):
    """The score is of the validator: with a check taken out, its faults are missed."""
    slow = next(f for f in random_faults(bench, ("timing",), 10, 0) if f.kind == "slower")
    assert bench.outcome(slow).code == "timing.claimed"
    monkeypatch.setattr("twin.validation.sampled_timing._false_claims", lambda *_: ())
    monkeypatch.setattr("twin.validation.equation_checks._check_rates", lambda *_: None)
    monkeypatch.setattr("twin.planning.check._speeds_match_slopes", lambda *_: [])
    monkeypatch.setattr(
        "twin.validation.trajectory_checks.retimed", lambda *_: ([], {}, [])
    )  # the second solver of the timing
    monkeypatch.setattr("twin.analysis.mutation.bench.PARTS", frozenset(("protocol", "equations")))
    monkeypatch.setattr(Bench, "_part_findings", lambda self, fault, *_: iter([self._new_finding(_thin(self, fault))]))
    assert bench.outcome(slow).state == "missed"


def _thin(bench, fault):
    from twin.validation.judge import judge

    return judge(bench.case(trajectory=fault.trajectory()), parts=frozenset(("protocol", "equations")))


@pytest.mark.slow
def test_the_report_takes_the_score_of_this_robot_and_no_other(bench, tmp_path):
    path = tmp_path / "selftest.json"
    report = bench.correct_report
    assert with_selftest(report, path) is report
    source = bench.robot.mechanism.source
    score = Score("sils", "table2", source, 0, 1.0, (outcome("cad", "caught"), outcome("cad", "missed")), ())
    path.write_text(json.dumps(score.as_dict()), encoding="utf-8")
    facts = with_selftest(report, path).facts[HEADING]
    assert facts["seeded faults found"].startswith("1 of 2 (50.0 %")
    assert facts["missed"] == "cad: what"
    path.write_text(json.dumps(replace(score, source="another state").as_dict()), encoding="utf-8")
    assert with_selftest(report, path) is report
    path.write_text("{", encoding="utf-8")
    assert with_selftest(report, path) is report


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--family", "colour"], "there is no family 'colour'"),
        (["--count", "0"], "--count 0"),
        (["--seed", "-1"], "--seed: -1 is too small"),
        (["--protocol", "nowhere"], "nowhere"),
    ],
)
def test_bad_input_is_told(argv, says, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["selftest", "sils", *argv]) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_stage_has_no_equations_to_spoil(capsys):
    from twin.core import assets

    assert main(["selftest", str(assets.files("sils").stage)]) == 2
    assert "equations" in capsys.readouterr().err


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7, 15, 118, 1000])
@pytest.mark.parametrize("families", [*combinations(SHARES, 1), *combinations(SHARES, 2), tuple(SHARES)])
def test_as_many_faults_are_drawn_as_were_asked_for(count, families):
    shares = {f: SHARES[f] for f in families}
    out = shared_out(count, shares)
    assert sum(out.values()) == count
    assert set(out) <= set(families)
    assert len(out) == min(count, len(families))
    whole = sum(shares.values())
    assert all(n == 1 or abs(n - count * shares[f] / whole) < len(families) for f, n in out.items())


def test_the_whole_draw_is_what_it_was():
    assert shared_out(sum(SHARES.values()), SHARES) == SHARES


def test_a_slide_with_another_axis_slides_along_it():
    mechanism = arm(2)
    slide = replace(mechanism.joints[0], type="prismatic", limits=(-0.1, 0.1))
    both = replace(mechanism, joints=(slide, mechanism.joints[1]))
    told = set()
    for seed in range(8):
        what, _ = cad._wrong_axis(both, np.random.default_rng(seed))
        told.add(what)
    assert told == {
        "joint q0 slides along another axis of its frame",
        "joint q1 turns about another axis of its frame",
    }


def test_a_value_that_only_one_trajectory_has_is_an_effect():
    """As where a fault removes the RCM of a phase: the distance from it is NaN, and no number differs."""
    full = SimpleNamespace(phases=(), rcm_error=np.zeros(4))
    missing = SimpleNamespace(phases=full.phases, rcm_error=np.array([0.0, 0.0, np.nan, np.nan]))
    assert same_samples(full, full)
    assert not same_samples(full, missing)
