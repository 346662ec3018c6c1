"""The timing of a plan, judged by the solver that did not make it; and public inputs on which solvers fail."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import twin
from made.lanes import alike
from twin.core.errors import TimingError
from twin.planning import demands, toppra_solver
from twin.planning.plan import plan
from twin.planning.timing import Timing, time_path
from twin.validation import retiming as judge
from twin.validation.case import Case
from twin.validation.checked_plan import retimed
from twin.validation.judge import judge as judged_by_parts
from twin.validation.residual_rows import Tolerances

ROOT = Path(__file__).resolve().parents[2]
PROTOCOLS = sorted((ROOT / "trajectories").glob("*/*.toml"))


def plan_of(name, protocol, **more):
    robot = twin.load(name)
    read = robot.protocol(protocol)
    return twin.plan(robot, read, **more), robot.mechanism, read


def worst(rows, quantity="duration", name="phases"):
    (found,) = [r for r in rows if (r.quantity, r.name) == (quantity, name)]
    assert found.pair == "P-T"
    return found.worst


LONG = alike(twin.names()) | {"raven_left", "sher"}
"""Robots whose protocols take seconds, and those like another robot."""


def all_protocols():
    for path in PROTOCOLS:
        robot = path.relative_to(ROOT / "trajectories").parts[0]
        usual = (robot, path.stem) in (("sils", "table2"), ("davinci_ecm", "look_around"))
        lane = pytest.mark.nightly if robot in LONG else pytest.mark.slow
        yield pytest.param(robot, path, marks=() if usual else lane, id=f"{robot}-{path.stem}")


@pytest.mark.parametrize(("robot", "path"), list(all_protocols()))
def test_toppra_confirms_every_phase_of_every_protocol(robot, path):
    trajectory, mechanism, protocol = plan_of(robot, str(path))
    rows, facts, findings = retimed(trajectory, mechanism, protocol)
    assert not findings
    assert list(facts) == [span.name for span in trajectory.phases]
    judged = [span for span in trajectory.phases if span.solver is not None]
    assert all("toppra" in facts[span.name] for span in judged)
    if judged:
        assert {r.samples for r in rows} == {len(judged)}
        assert worst(rows) < 1e-6
        assert worst(rows, "limit", "speed") < 1e-3
        assert worst(rows, "limit", "acceleration") < 1e-3


def test_a_plan_by_toppra_is_judged_by_the_passes():
    trajectory, mechanism, protocol = plan_of("sils", "table2_printed", timing="toppra")
    assert {span.solver for span in trajectory.phases} == {"toppra"}
    rows, facts, findings = retimed(trajectory, mechanism, protocol)
    assert not findings
    assert worst(rows) < 1e-6
    assert all("passes" in text for text in facts.values())


@pytest.mark.parametrize(("tip", "turn"), [(1.0, 10.0), (0.005, 0.02)], ids=["averaged", "also slowed down"])
def test_a_plan_within_jerk_limits_is_not_accused(tip, turn):
    robot = twin.load("sils")
    protocol = robot.protocol("table2_printed")
    limits = {kind: replace(of, tip_jerk=tip, rotation_jerk=turn) for kind, of in protocol.limits.items()}
    protocol = replace(protocol, limits=limits)
    trajectory = twin.plan(robot, protocol)
    assert all(span.smoothing > 0 for span in trajectory.phases)
    assert any(span.for_jerk > 1 for span in trajectory.phases) == (tip < 0.1)
    rows, _, findings = retimed(trajectory, robot.mechanism, protocol)
    assert not findings
    assert worst(rows) < 1e-6


# -- seeded defects ---------------------------------------------------------------------------------------


def stretched(timing: Timing, factor: float) -> Timing:
    """Return a timing with the same path in a duration that is `factor` times as long."""
    steps, dt = len(timing.t) - 1, timing.t[1]
    new = round(steps * factor)
    rate = steps / new
    t = dt * np.arange(new + 1)
    along = CubicHermiteSpline(timing.t, timing.s, timing.sd)
    at = np.minimum(t * rate, timing.t[-1])
    sdd = np.interp(at, timing.t, timing.sdd)
    return replace(timing, t=t, s=along(at), sd=rate * along(at, 1), sdd=rate**2 * sdd, duration=float(t[-1]))


DEFECTS = {
    "0.1 % too long": lambda timing: stretched(timing, 1.001),
    "0.1 % too short": lambda timing: stretched(timing, 0.999),
    "one sample too long": lambda timing: stretched(timing, 1 + 1 / len(timing.t)),
    "stated optimum 0.1 % too long": lambda timing: replace(timing, optimal=1.001 * timing.optimal),
    "stated optimum 0.1 % too short": lambda timing: replace(timing, optimal=0.999 * timing.optimal),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_phase_that_lasts_too_long_or_too_short_is_found(defect, monkeypatch):
    timings = []

    def spoilt(*args, **more):
        found = time_path(*args, **more)
        timings.append(found)
        return DEFECTS[defect](found) if len(timings) == 2 else found

    monkeypatch.setattr(demands, "time_path", spoilt)
    trajectory, mechanism, protocol = plan_of("sils", "table2_printed")
    rows, _, findings = retimed(trajectory, mechanism, protocol)
    assert [(f.code, f.where, f.severity) for f in findings] == [("timing.duration", "insert", "disagreement")]
    assert f"is too {defect.split()[-1]}" in findings[0].message
    size = 1 / len(timings[1].t) if "sample" in defect else 1e-3
    assert worst(rows) == pytest.approx(size, rel=0.3)  # up to one sample is rounding
    (row,) = [r for r in rows if r.quantity == "duration"]
    assert (row.phase, row.agrees) == ("insert", False)


def test_a_phase_that_exceeds_limits_is_found_at_the_grid(monkeypatch):
    monkeypatch.setattr(demands, "time_path", lambda *args, **more: stretched(time_path(*args, **more), 0.99))
    trajectory, mechanism, protocol = plan_of("sils", "table2_printed")
    rows, _, findings = retimed(trajectory, mechanism, protocol)
    assert {f.code for f in findings} == {"timing.duration", "timing.grid_speed", "timing.grid_acceleration"}
    assert worst(rows, "limit", "speed") == pytest.approx(1 / 0.99 - 1, abs=2e-3)
    assert worst(rows, "limit", "acceleration") == pytest.approx(1 / 0.99**2 - 1, abs=2e-3)


def without(kinematics, protocol, limit):
    """Return kinematics and protocol without a limit of the planner; `limit` is a limit of the frame or the joints."""
    if limit in ("tip_speed", "tip_acceleration", "rotation_speed", "rotation_acceleration"):
        limits = {kind: replace(of, **{limit: 1e3}) for kind, of in protocol.limits.items()}
        return kinematics, replace(protocol, limits=limits)
    if limit == "motors":
        none = np.full(len(kinematics.motors.max_speed), np.inf)
        return replace(kinematics, motors=replace(kinematics.motors, max_speed=none)), protocol
    return replace(kinematics, **{limit: np.full(len(kinematics.joint_names), 1e3)}), protocol


def slowed(mechanism, factor):
    """Return a mechanism whose joints and motors are slower by a factor, so that their limits determine the timing."""
    joints = [
        replace(j, max_speed=j.max_speed and j.max_speed / factor, max_acceleration=j.max_acceleration)
        if j.active
        else j
        for j in mechanism.joints
    ]
    actuators = [replace(a, max_speed=a.max_speed and a.max_speed / factor) for a in mechanism.actuators]
    return replace(mechanism, joints=tuple(joints), actuators=tuple(actuators))


FORGOTTEN = {
    "tip_speed": ("sils", "table2_printed", 1),
    "tip_acceleration": ("sils", "table2_printed", 1),
    "rotation_speed": ("sils", "table2_printed", 1),
    "rotation_acceleration": ("sher", "sclerotomy", 1),
    "max_speed": ("sils", "table2_printed", 20),
    "max_acceleration": ("davinci_ecm", "look_around", 1),
    "motors": ("davinci_psm", "reach", 30),
}


@pytest.mark.slow
@pytest.mark.parametrize("limit", FORGOTTEN)
def test_a_limit_that_the_planner_forgets_is_found(limit):
    name, path, factor = FORGOTTEN[limit]
    robot = twin.load(name)
    protocol = robot.protocol(path)
    robot = robot.bound(protocol)
    robot = robot.with_mechanism(slowed(robot.mechanism, factor))
    T = robot.mechanism.frame_in_tool(protocol.frame)
    kinematics = robot.path_kinematics()
    if limit == "motors":  # the joints alone would be as slow
        kinematics = replace(kinematics, max_speed=factor * kinematics.max_speed)
        robot = robot.with_mechanism(replace(robot.mechanism, joints=twin.load(name).mechanism.joints))
    _, _, none = retimed(plan(protocol, kinematics, T_tool_frame=T), robot.mechanism, protocol)
    assert not none
    kinematics, changed = without(kinematics, protocol, limit)
    rows, _, findings = retimed(plan(changed, kinematics, T_tool_frame=T), robot.mechanism, protocol)
    bitten = {f.code for f in findings}
    assert "timing.duration" in bitten
    assert {"timing.grid_speed", "timing.grid_acceleration"} & bitten
    assert worst(rows) > 1e-2


# -- where no judgment is possible ------------------------------------------------------------------------


def test_what_the_other_solver_cannot_time_is_unchecked_with_its_reason(monkeypatch):
    def refuse(*_):
        raise TimingError("the solver returned ERR_X")

    trajectory, mechanism, protocol = plan_of("sils", "table2_printed")
    rows, facts, findings = judge.judge_durations(trajectory, mechanism, protocol, {"passes": ("toppra", refuse)})
    assert {(f.code, f.severity) for f in findings} == {("timing.unchecked", "error")}
    assert all("ERR_X" in f.message for f in findings)
    assert [f.where for f in findings] == [span.name for span in trajectory.phases]
    assert all(text.startswith("unchecked: toppra") for text in facts.values())
    (row,) = rows
    assert np.isnan(row.worst)
    assert row.tolerance is None
    assert row.note == "unchecked: approach; unchecked: insert; unchecked: sweep"


def test_one_phase_that_is_unchecked_does_not_hide_the_others():
    trajectory, mechanism, protocol = plan_of("sils", "table2_printed")
    calls = []

    def refuse_second(*problem):
        calls.append(problem)
        if len(calls) == 2:
            raise TimingError("no")
        return toppra_solver.fastest(*problem)

    rows, _, findings = judge.judge_durations(trajectory, mechanism, protocol, {"passes": ("toppra", refuse_second)})
    assert [(f.code, f.where) for f in findings] == [("timing.unchecked", "insert")]
    assert {r.samples for r in rows} == {2}
    assert all("unchecked: insert" in r.note for r in rows)


# -- the choice of the solver -----------------------------------------------------------------------------


def test_a_protocol_an_argument_and_a_robot_choose_the_solver(tmp_path):
    robot = twin.load("sils")
    text = robot.files.protocol("table2_printed").read_text(encoding="utf-8")
    file = tmp_path / "by_toppra.toml"
    file.write_text(text.replace('robot = "sils"', 'robot = "sils"\ntiming = "toppra"'), encoding="utf-8")
    assert robot.protocol("table2_printed").timing == "passes"
    assert robot.protocol(file).timing == "toppra"
    assert robot.with_timing("toppra").protocol("table2_printed").timing == "toppra"
    assert robot.with_timing("passes").protocol(file).timing == "passes"
    assert robot.with_timing(None).protocol(file).timing == "toppra"
    chosen = twin.plan(robot, file, timing="passes")
    assert {span.solver for span in chosen.phases} == {"passes"}
    with pytest.raises(twin.TwinError, match=r"solver of the timing 'topra'.*toppra"):
        robot.with_timing("topra")
    with pytest.raises(twin.TwinError, match=r"solver of the timing 'topra'.*toppra"):
        twin.plan(robot, file, timing="topra")
    file.write_text(text.replace('robot = "sils"', 'robot = "sils"\ntiming = "topra"'), encoding="utf-8")
    with pytest.raises(twin.TwinError, match="timing"):
        robot.protocol(file)


# -- in reports and commands ------------------------------------------------------------------------------


@pytest.mark.nightly
def test_plan_check_prints_the_rows_and_names_the_solver(tmp_path, capsys):
    from twin.cli import main

    for solver, other in (("passes", "toppra"), ("toppra", "passes")):
        argv = ["plan", "sils", "table2", "--check", "--timing", solver, "--out", str(tmp_path)]
        assert main([*argv, "--json"]) == 0
        data = json.loads(capsys.readouterr().out)
        assert {p["solver"] for p in data["phases"]} == {solver}
        assert [(r["quantity"], r["name"], r["agrees"]) for r in data["residuals"]] == [
            ("duration", "phases", True),
            ("limit", "speed", True),
            ("limit", "acceleration", True),
        ]
        assert main([*argv, "--quiet"]) == 0
        text = capsys.readouterr().out
        assert f"by {other}" in text


def test_a_report_names_solver_judge_and_what_was_used(sils_report):
    assert {p.solver for p in sils_report.phases} == {"passes"}
    assert {r.quantity for r in sils_report.residuals if r.pair == "P-T"} == {"duration", "limit"}
    assert all(r.agrees for r in sils_report.residuals if r.pair == "P-T")
    used = sils_report.environment
    assert used["timing"] == "by passes, judged by toppra"
    assert used["toppra"] == version("toppra")
    assert {"numpy", "pin", "casadi", "llvmlite", "cascadio"} <= used.keys()
    assert not {"coal", "usd-core"} & used.keys(), "the baked motion, the clearances and the stage were not looked at"


@pytest.mark.slow
def test_a_report_without_a_judge_of_the_timing_does_not_list_toppra(sils_case):
    report = judged_by_parts(sils_case, parts=frozenset({"equations"}))
    assert "toppra" not in report.environment
    assert report.environment["timing"] == "by passes"


@pytest.fixture(scope="module")
def sils_case():
    robot = twin.load("sils")
    protocol = robot.protocol("table2_printed")
    robot = robot.bound(protocol)
    trajectory = twin.plan(robot, protocol)
    tolerances = Tolerances().widened(10 * robot.cad.placement_loss, robot.mechanism.link_length)
    return Case(robot.kinematics(), robot.cad, protocol, trajectory, Path("no.usda"), tolerances)


@pytest.fixture(scope="module")
def sils_report(sils_case):
    return judged_by_parts(sils_case, parts=frozenset({"protocol", "equations"}))
