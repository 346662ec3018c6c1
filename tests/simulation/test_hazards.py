"""Campaigns of faults: drawn by a seed, logged, interrupted and continued, judged against the model."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from twin.api.hazards import FILE, Share, _require_same_campaign, campaign_file, hazards, outcomes
from twin.api.machine import machine_parts
from twin.cli import main
from twin.core.errors import DescriptionError, OutputError, TwinError
from twin.core.spatial import pose
from twin.simulation.campaigns.adaptive_limit import AdaptiveLimit
from twin.simulation.campaigns.attacked_session import AttackedSession, Outcome, SessionRunner
from twin.simulation.campaigns.campaign import load
from twin.simulation.campaigns.campaign_log import Log
from twin.simulation.campaigns.campaign_table import FREE
from twin.simulation.campaigns.hazard_trainee import Reaction
from twin.simulation.campaigns.roc import curves
from twin.simulation.campaigns.summary import Hazards
from twin.simulation.campaigns.traced_run import SETTLED
from twin.simulation.campaigns.trends import trends, with_cables, with_servo
from twin.simulation.campaigns.trends_table import HandTable
from twin.simulation.campaigns.trends_table import load as load_trends
from twin.simulation.campaigns.unbraked_deviation import UnbrakedDeviation
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_faults import LOCATIONS
from twin.ui.report.report_folder import write_result

TABLE = Path(__file__).parents[2] / "cad/raven_left/campaigns/table1.toml"
HEAD = {"log": "twin-hazards", "version": 1, "robot": "r", "campaign": "c"}


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("raven_left"))


@pytest.fixture(scope="module")
def runner(parts):
    return SessionRunner(parts, AdaptiveLimit(1e-4, 3.3e-3))


@pytest.fixture(scope="module")
def plan(parts):
    return load(TABLE, parts.places)


def session(*faults, length, start=320, **more):
    """A session in which faults (signal, operation, value, more) act from packet `start` on."""
    made = [partial(Fault, n, start, start + length, op, value, counts=True, **kw) for n, op, value, kw in faults]
    return AttackedSession(lambda: [m() for m in made], start, length, **more)


def test_a_campaign_is_drawn_by_its_seed_and_within_its_ranges(plan, parts):
    again = load(TABLE, parts.places)
    drawn = [plan.draw(i) for i in range(len(plan))]
    assert [again.draw(i) for i in (7, 3, 2050)] == [drawn[i] for i in (7, 3, 2050)]
    assert len(drawn) >= 2100
    kinds = Counter(d.kind for d in drawn)
    assert kinds[FREE] == 100
    total = sum(c.weight for c in plan.table.class_)
    for c in plan.table.class_:
        assert kinds[c.name] == pytest.approx(2000 * c.weight / total, rel=0.25)
        mine = [d for d in drawn if d.kind == c.name]
        assert all(c.value[0] - 0.5 <= d.value <= c.value[1] + 0.5 for d in mine)
        assert {d.length for d in mine} == set(c.length)
        assert {d.operation for d in mine} == set(c.operations)
        assert {d.target for d in mine} == {" ".join(t) for t in c.targets}
    assert all(0.9 <= d.mass <= 1.1 and 0.7 <= d.friction <= 1.3 and d.start >= 300 for d in drawn)
    assert {d.scale for d in drawn} == set(plan.table.scales)
    (fault,) = plan.faults(next(d for d in drawn if d.target == "motor_elbow" and d.signal == "dac"))
    assert fault.target == [1]
    locations = Counter(LOCATIONS[d.signal] for d in drawn if d.kind != FREE)
    assert set(locations) == {"network", "USB read", "USB write", "control state"}
    assert min(locations.values()) > 200


def test_the_scenarios_are_those_of_the_paper(plan):
    """Table 1: three hazards, with the numbers of the reports."""
    incidents = {s.name: s.incidents for s in plan.table.scenario}
    assert incidents == {
        "temporarily unavailable": ["MAUDE 3293519"],
        "permanently unavailable": ["MAUDE 2663924", "MAUDE 3275500"],
        "sudden jump": ["MAUDE 1590517", "MAUDE 2120175"],
    }
    for scenario in incidents:
        assert any(c.scenario == scenario for c in plan.table.class_)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["raven_right", "pa10"])
def test_every_campaign_that_comes_with_twin_is_valid(name):
    robot = twin.load(name)
    assert len(load(campaign_file(robot, "table1"), machine_parts(robot).places)) == 2100


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('targets = [["grasp"]]', 'targets = [["grsap"]]', r"target of packet 'grsap'. Did you mean 'grasp'"),
        ('targets = [["motor_shoulder"], ["motor_elbow"]]', 'targets = [["motor_5"]]', r"target of dac 'motor_5'"),
        ('signal = "dac"', 'signal = "adc"', "signal"),
        ('scenario = "sudden jump"', 'scenario = "jump"', r"scenario 'jump'"),
        ('responses = ["slow down"', 'responses = ["run away"', "responses"),
        (
            'operations = ["overwrite", "add", "hold"]',
            'operations = ["skip"]',
            "skip and duplicate are possible for packets only",
        ),
        ("trained = 200", "trained = -1", "trained"),
        ('name = "wrong grasp"', 'name = "wrong pedal"', "'wrong pedal' is defined twice"),
        ("value = [-200, 200]", "value = [200, -200]", "the range"),
        ("whole = true\n", "", "a delay needs whole = true"),
        ("seed = 1", "seed = -1", "seed"),
        ("mass = [0.9, 1.1]", "mass = [0, 1.1]", "mass"),
        ("mass = [0.9, 1.1]", "mass = [1.1, 0.9]", r"mass: the range \(1.1, 0.9\) goes down"),
        ("friction = [0.7, 1.3]", "friction = [1.3, 0.7]", r"friction: the range \(1.3, 0.7\) goes down"),
        ("value = [-200, 200]", "value = [-1e308, 1e308]", r"value: the range .* is too wide"),
        ("weight = ", "weight = 1e308 # ", "weight"),
    ],
)
def test_a_wrong_campaign_is_refused(parts, tmp_path, before, after, message):
    text = TABLE.read_text()
    assert before in text
    (tmp_path / "mine.toml").write_text(text.replace(before, after, 1))
    with pytest.raises(DescriptionError, match=message):
        load(tmp_path / "mine.toml", parts.places)


@pytest.mark.slow
def test_an_unknown_target_ends_the_command_before_anything_is_written(tmp_path, capsys):
    text = TABLE.read_text().replace('targets = [["grasp"]]', 'targets = [["grsap"]]', 1)
    (tmp_path / "mine.toml").write_text(text)
    out = tmp_path / "out"
    assert main(["hazards", "raven_left", "--campaign", str(tmp_path / "mine.toml"), "--out", str(out), "--quiet"]) == 2
    assert "target of packet 'grsap'. Did you mean 'grasp'" in capsys.readouterr().err
    assert not (out / FILE).exists()


@pytest.mark.parametrize("option", ["--campaign", "--sessions", "--processes"])
def test_the_trends_refuse_the_options_of_a_campaign(option, capsys):
    assert main(["hazards", "raven_left", "--trends", option, "1"]) == 2
    assert f"{option} has no effect with --trends" in capsys.readouterr().err


def test_an_unknown_campaign_is_named(parts):
    with pytest.raises(DescriptionError, match=r"table2\.toml: the file does not exist; campaigns .*: table1"):
        load(TABLE.with_name("table2.toml"), parts.places)


def test_a_log_goes_on_after_a_line_that_was_cut(tmp_path):
    log = Log(tmp_path / FILE, HEAD)
    log.add({"index": 3, "peak": 1.0})
    log.add({"index": 5, "peak": 2.0})
    log.close()
    with (tmp_path / FILE).open("ab") as file:
        file.write(b'{"index": 9, "pea')
    log = Log(tmp_path / FILE, HEAD)
    assert sorted(log.rows) == [3, 5]
    log.add({"index": 9, "peak": 3.0})
    log.close()
    assert [json.loads(line).get("index") for line in (tmp_path / FILE).read_text().splitlines()] == [None, 3, 5, 9]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (json.dumps(HEAD | {"campaign": "other"}) + "\n", r"log of another campaign \(other campaign\)"),
        ("[1]\n", "another campaign"),
        ("nonsense\n", "not the log of a campaign"),
        (json.dumps(HEAD) + "\n{}\n", "not the log of a campaign"),
        (json.dumps(HEAD) + '\n{"index": Infinity}\n', "not the log of a campaign"),
        (json.dumps(HEAD) + "\n" + "[" * 200_000 + "\n", "not the log of a campaign"),
        (json.dumps(HEAD | {"more": 1}) + "\n", r"log of another campaign \(other more\)"),
        ("notes without an end of line", "not the log of a campaign"),
    ],
)
def test_another_log_is_refused_and_kept(tmp_path, text, message):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(OutputError, match=message):
        Log(tmp_path / FILE, HEAD)
    assert (tmp_path / FILE).read_text() == text


def test_a_log_has_one_writer_at_a_time(tmp_path):
    log = Log(tmp_path / FILE, HEAD)
    with pytest.raises(OutputError, match="another campaign is running with the log"):
        Log(tmp_path / FILE, HEAD)
    log.add({"index": 3})
    log.close()
    again = Log(tmp_path / FILE, HEAD)
    assert again.rows == {3: {"index": 3}}
    again.close()


def test_a_log_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / FILE).mkdir()
    with pytest.raises(OutputError, match=f"cannot write to .*{FILE}: Is a directory; give another --out"):
        Log(tmp_path / FILE, HEAD)


def test_a_log_on_a_full_disk_is_named(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    log = Log(tmp_path / FILE, HEAD)
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match=f"cannot write to .*{FILE}: No space left on device"):
        log.add({"index": 3})
    assert not log.rows, "a session counts as done only if its line is on the disk"
    log.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"index": 5000}, r"session 5000: index is 5000; expected '0 to 2099'\. Delete the line of this session"),
        ({"value": 7.5}, r"session 3: value is 7.5; expected "),
        ({"peak": None}, r"session 3: peak is missing\. Delete the line .* again, or give another --out"),
    ],
)
def test_a_log_with_a_line_of_another_session_is_refused(tmp_path, plan, change, message):
    row = asdict(plan.draw(3)) | dict.fromkeys((f.name for f in fields(Outcome)), 0) | {"response": None} | change
    log = Log(tmp_path / FILE, HEAD)
    log.add({k: v for k, v in row.items() if v is not None or k == "response"})
    with pytest.raises(OutputError, match=message):
        _require_same_campaign(plan, log)
    log.close()


@pytest.mark.slow
def test_a_jump_is_felt_in_the_tick_after_3_mm(runner):
    found = runner.run(session(("dac", "overwrite", 2500.0, {"target": 0}), length=100))
    assert found.peak > 3
    assert 0 < found.harm < found.beyond <= found.cue <= found.beyond + 2
    assert found.jump is not None
    assert 0 < found.adaptive < found.harm
    assert 80 < found.beyond < 110  # 92 ms on the motion of the published table


def test_a_fault_that_a_check_sees_stops_the_arm_before_harm(runner):
    found = runner.run(session(("packet", "add", [5000.0, *[0.0] * 8], {}), length=1))
    assert found.stop is not None
    assert found.harm is None
    assert "DAC counts (limit 20000)" in found.check
    assert found.noticeable


def test_without_a_fault_there_is_no_cue_and_nothing_to_notice(runner):
    for mass, friction in ((0.9, 1.3), (1.1, 0.7)):
        found = runner.run(session(length=100, mass=mass, friction=friction))
        assert (found.cue, found.beyond, found.stop, found.jump, found.noticeable) == (None,) * 4 + (False,)
        assert 0 < found.peak < 1
        assert 0 < found.ratio < 1


def test_an_arm_that_only_stays_behind_has_not_jumped(runner):
    """Half a second without packets: behind the model on its path, by 3 mm at 6 mm/s, then aside of it."""
    found = runner.run(session(("wire", "skip", 0.0, {}), length=300))
    assert 100 < found.harm < 300
    assert found.jump is None or found.jump >= 300
    assert found.refused == 1  # the first packet after the gap, as released


def test_a_failed_read_hides_the_deviation_from_the_cue(runner):
    """The software keeps its old encoder counts, so true and measured deviation part."""
    found = runner.run(session(("usb", "overwrite", -19.0, {}), length=400, mass=1.1))
    assert found.beyond is not None
    assert found.cue is None or found.cue >= 400
    assert found.seen < 1.5


@pytest.mark.slow
def test_a_trainee_slows_down_and_releases_the_pedal(runner):
    """A fault of half a second that the cue shows: he acts after his reaction time, and the arm follows again."""
    fault = ("packet", "overwrite", [30.0, *[0.0] * 8], {"target": [0]})
    found = runner.respond(session(fault, length=1500), Reaction(0.3, 0.5, 0.2))
    assert found.acted == found.noticed + 300
    assert found.responses[:4] == ["slow down", "release pedal", "troubleshoot", "restart"]
    alone = runner.run(session(fault, length=1500))
    assert found.noticed == pytest.approx(alone.cue, abs=2)
    assert found.response_peak < 0.7 * alone.peak


@pytest.mark.slow
def test_a_trainee_restarts_after_a_stop_and_converts_after_the_second(runner):
    fault = ("packet", "add", [5000.0, *[0.0] * 8], {})
    found = runner.respond(session(fault, length=1), Reaction(0.3, 0.5, 0.2))
    assert (found.noticed, found.acted) == (pytest.approx(0, abs=4), pytest.approx(500, abs=5))
    assert found.responses == ["release pedal", "troubleshoot", "restart", "report"]
    assert found.works
    assert not found.response_harm
    again = runner.respond(session(fault, length=9000), Reaction(0.3, 0.5, 0.2))
    assert again.responses == ["release pedal", "troubleshoot", "restart", "convert", "report"]
    assert not again.works


def test_a_fault_in_the_first_packet_has_an_outcome(runner):
    found = runner.run(session(("dac", "overwrite", 0.0, {"target": 0}), length=2, start=1))
    assert found.residual == found.ratio == 0.0, "nothing was measured before the fault"


@pytest.mark.nightly
def test_a_trainee_slower_than_a_session_has_no_response(runner):
    jump = session(("joints", "add_once", 0.3, {"target": 0}), length=100)
    assert runner.run(jump).noticeable
    assert runner.respond(jump, Reaction(30.0, 30.0, 30.0)) is None


def test_a_trainee_without_an_event_does_nothing(runner):
    assert runner.respond(session(length=10), Reaction(0.3, 0.5, 0.2)) is None


class StubPair:
    """Machine and model in one coordinate: their tips are at x in m, and the machine is at a run level."""

    def __init__(self):
        self.machine = SimpleNamespace(plant=SimpleNamespace(q=0.0), plc=SimpleNamespace(level=Level.PEDAL_UP))
        self.model = SimpleNamespace(plant=SimpleNamespace(q=0.0))

    def at(self, level, machine, model):
        self.machine.plc.level = level
        self.machine.plant.q = machine
        self.model.plant.q = model


def test_the_deviation_counts_only_while_no_brake_holds_the_arm():
    pair = StubPair()
    deviation = UnbrakedDeviation(pair, lambda x: pose(p=[x, 0, 0]))

    def step(level, machine, model, ticks=1):
        pair.at(level, machine, model)
        for _ in range(ticks):
            deviation.step()
        return deviation.peak

    assert step(Level.PEDAL_UP, 0.05, 0.0) == 0, "it has not followed yet"
    assert step(Level.PEDAL_DN, 0.001, 0.0) == pytest.approx(1)
    # after a stop, the machine drops: its tip is compared with that of the model at the stop, not with the present one
    assert step(Level.E_STOP, 0.002, 0.009) == pytest.approx(2)
    step(Level.E_STOP, 0.002, 0.009, ticks=SETTLED - 2)
    assert step(Level.E_STOP, 0.05, 0.0) == pytest.approx(2), "the brakes hold the arm by now"
    deviation.restart()
    assert step(Level.PEDAL_UP, 0.05, 0.0) == pytest.approx(2), "it has not followed since the restart"
    # the tips are 10 mm apart after the restart, which is not counted
    assert step(Level.PEDAL_DN, 0.01, 0.0) == pytest.approx(2)
    assert step(Level.PEDAL_DN, 0.014, 0.001) == pytest.approx(3)
    assert step(Level.E_STOP, 0.016, 0.0) == pytest.approx(5)


def row(index, kind, **more):
    none = dict.fromkeys(("harm", "jump", "beyond", "cue", "adaptive", "stop", "response"))
    scores = {"peak": 0.1, "residual": 0.1, "ratio": 0.2, "seen": 0.1, "seen_ratio": 0.2}
    return {"index": index, "kind": kind} | scores | none | more


@pytest.fixture
def table(plan):
    first = plan.table.class_[0]
    classes = [first.model_copy(update={"name": "a"}), first.model_copy(update={"name": "b"})]
    return plan.table.model_copy(update={"class_": classes})


def test_the_summary_counts_by_class(table):
    response = {"noticed": 11, "acted": 300, "responses": ["troubleshoot", "restart", "report"]}
    response |= {"response_peak": 3.0, "response_harm": True, "works": True}
    felt = {"harm": 5, "jump": 6, "beyond": 9, "cue": 11, "adaptive": 3, "peak": 4.0, "seen": 0.9, "seen_ratio": 2.0}
    rows = [
        row(0, "a"),
        row(1, "a", **felt, response=response),
        row(2, "a", stop=2, seen_ratio=0.5),
        row(3, FREE),
    ]
    found = Hazards("r", table, 4, rows, [])
    assert found.verdict == "agree"
    first = found.classes[0]
    assert (first.sessions, first.harmed, first.beyond, first.felt, first.stopped) == (3, 1, 1, 1, 1)
    assert (first.peak_max, first.delay, first.location) == (4.0, 2.0, "network")
    assert (first.jumped, first.unseen_checks, first.unseen_fixed, first.unseen_adaptive) == (1, 1, 1, 0)
    assert (first.danger, first.in_time, first.seen_adaptive, first.early) == (2, 1, 1, 1)
    assert [c.kind for c in found.classes] == ["a", FREE]
    (trained,) = found.responses
    assert (trained.noticed, trained.acted, trained.peak, trained.peak_alone) == (11, 300, 3.0, 4.0)
    assert trained.trained == pytest.approx(2 / 3)  # the scenario asks for the release of the pedal too
    (unfinished,) = Hazards("r", table, 5, rows, []).findings
    assert (unfinished.code, unfinished.severity) == ("hazards.unfinished", "warning")
    false = [*rows[:3], rows[3] | {"cue": 3}]
    assert Hazards("r", table, 4, false, []).verdict == "disagree"
    assert found.word == "No cue without a fault"
    assert Hazards("r", table, 4, rows[:3], []).word == ""


def test_a_roc_curve_has_known_points():
    """Two dangerous sessions with scores 0.5 and 2, one of them stopped in time; false scores 0.1, 0.1, 0.8, 0.1."""
    rows = [row(0, "a", harm=3, seen=0.5), row(1, "a", stop=4, seen=2.0), row(2, "a", residual=0.8), row(3, FREE)]
    fixed, _, checked, _ = curves(rows, 3.0)
    assert fixed.at(3.0) == (0, 0)
    assert fixed.at(1.0) == (0.5, 0)
    assert fixed.at(0.6) == (0.5, 0.25)
    assert fixed.at(0.3) == (1, 0.25)
    assert fixed.area == pytest.approx(0.5 * 0.25 + 0.75)
    assert checked.at(3.0) == (0.5, 0)
    assert curves([row(0, FREE)], 3.0) == []


def test_the_adaptive_limit_grows_with_the_speed():
    tips = np.outer(np.arange(1000) * 1e-3 * 0.01, [1.0, 0, 0])  # 10 mm/s
    limits = AdaptiveLimit(1e-4, 0.02).limits(tips)
    assert limits[0] == pytest.approx(1e-4)
    assert limits[-1] == pytest.approx(1e-4 + 0.02 * 0.01)
    assert (np.diff(limits) >= -1e-15).all()


# ------------------------------------------------------------------------------------- the paper's experiments, pages


TRENDS = TABLE.with_name("trends.toml")


@pytest.fixture(scope="module")
def brief(parts):
    """Short forms of both experiments: 2.5 s without a fault, two faults of 300 cycles."""
    table = load_trends(TRENDS)
    hands = [HandTable(seed=1, shares=[0.0, 1.0])]
    stuck = table.stuck.model_copy(update={"every": 700, "times": 2, "watched": 300, "hand": hands})
    short = table.model_copy(update={"free": 2500, "scales": [0.05, 0.2], "stuck": stuck})
    return trends("raven_left", parts, short, lambda text, fraction: None)


@pytest.mark.slow
def test_the_trends_of_the_paper(brief):
    found = brief
    assert found.grows
    assert [r.counts for r in found.stuck] == [0, 2500]
    calm, strong = found.stuck
    assert calm.stopped is None
    assert calm.peaks[0] < strong.peaks[0]
    assert strong.peaks[0] > 5
    assert strong.jumps == 1
    assert set(found.by_servo) == {"released", "paper"}
    assert found.within, "cables that stretch and have play make the deviation as large as the published one"
    assert "trends, not numbers" in next(found.text())
    assert found.as_published == []


@pytest.mark.nightly
@pytest.mark.parametrize(("cables", "share"), [(True, 0.35), (False, 0.3)])
def test_four_jumps_and_a_stop_at_the_last(parts, cables, share):
    """The paper's events, by the runs whose arm is fastest at the last fault, with cables and without."""
    table = load_trends(TRENDS)
    hands = [HandTable(seed=2, shares=[share])]
    stuck = table.stuck.model_copy(update={"hand": hands})
    table = table.model_copy(update={"free": 100, "scales": [0.1], "stuck": stuck, "paper_servo": None})
    if not cables:
        table = table.model_copy(update={"cable": []})
    found = trends("raven_left", parts, table, lambda text, fraction: None)
    (row,) = found.as_published
    assert (row.counts, row.jumps, row.stopped) == (2500 * share, 4, 4)
    assert min(row.peaks) > 5
    assert "the command for motor_shoulder is" in row.check
    assert any("four jumps and a stop at the last, as in the paper: hand 2" in str(part) for part in found.text())


@pytest.mark.nightly
def test_the_deviation_of_every_scale_is_within_the_published_one(parts):
    """2.43 ± 1.72 mm over motion scales from 0.05 to 0.2; it grows with the scale, with the servo of the paper too."""
    table = load_trends(TRENDS)
    hands = [HandTable(seed=1, shares=[0.0])]
    stuck = table.stuck.model_copy(update={"hand": hands, "times": 2, "every": 700, "watched": 300})
    found = trends("raven_left", parts, table.model_copy(update={"stuck": stuck}), lambda text, fraction: None)
    assert found.grows
    assert found.within
    rigid = trends(
        "raven_left", parts, table.model_copy(update={"stuck": stuck, "cable": []}), lambda text, fraction: None
    )
    assert not rigid.within
    assert all(peak < 3 for row in rigid.stuck for peak in row.peaks), "without cables, a weak fault is not felt"
    assert max(row.mean for row in rigid.scales) < 0.2


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("cycles = 300", "cycles = 8000", "cycles = 8000 must be below the period, every = 8000 packets"),
        ("shares = [0.2, 0.25", "shares = [2, 0.25", "shares"),
        ("scale = 0.10", "scale = 0", "scale"),
        ("stiffness = 200.0", "stiffness = 0", "stiffness"),
    ],
)
def test_wrong_experiments_are_refused(tmp_path, before, after, message):
    (tmp_path / "mine.toml").write_text(TRENDS.read_text().replace(before, after, 1))
    with pytest.raises(DescriptionError, match=message):
        load_trends(tmp_path / "mine.toml")
    with pytest.raises(DescriptionError, match="the file does not exist"):
        load_trends(tmp_path / "no.toml")


def test_cables_and_servo_name_joints_and_motors(parts):
    table = load_trends(TRENDS)
    physics = parts.plant.physics
    for cables, words in (
        (table.cable[1:], r"no \[\[cable\]\] for shoulder"),
        ([*table.cable, table.cable[0]], r"two \[\[cable\]\]"),
        ([table.cable[0].model_copy(update={"joint": "sholder"})], "sholder"),
    ):
        with pytest.raises(DescriptionError, match=words):
            with_cables(parts, physics, cables)
    with pytest.raises(DescriptionError, match="motor_insertio"):
        with_servo(parts, table.paper_servo.model_copy(update={"motor": "motor_insertio"}))
    gains = [motor.ki for motor in with_servo(parts, table.paper_servo).settings.of_motors(parts.arm.mechanism)]
    assert gains == [0, 0, 0.083, 0, 0, 0, 0]


def test_arms_share_one_file():
    right = twin.load("raven_right")
    assert campaign_file(right, "table1").samefile(TABLE)
    assert campaign_file(right, "trends").samefile(TRENDS)


@pytest.mark.parametrize("text", ["same_as = [", "same_as = 3", "\xff"])
def test_a_malformed_campaign_of_a_robots_folder_is_named_by_its_reader(tmp_path, text):
    folder = tmp_path / "campaigns"
    folder.mkdir()
    (folder / "mine.toml").write_text(text, encoding="latin-1")
    path = campaign_file(SimpleNamespace(files=SimpleNamespace(cad=tmp_path)), "mine")
    assert path == folder / "mine.toml"
    with pytest.raises(DescriptionError, match=r"mine\.toml"):
        load(path, {})


@pytest.mark.slow
def test_the_pages_of_campaign_and_trends(table, brief, tmp_path):
    response = {"noticed": 11, "acted": 300, "responses": ["restart"], "works": True}
    response |= {"response_peak": 3.0, "response_harm": True}
    rows = [row(0, "a", harm=5, jump=5, seen=0.9, response=response), row(1, "b", stop=0), row(2, FREE)]
    found = Hazards("r", table, 3, rows, ["  ASSUMED x = 1"])
    assert write_result(found, tmp_path) == ["hazards.html", "hazards.png"]
    page = (tmp_path / "hazards.html").read_text()
    assert "MAUDE 1590517" in page
    assert "ASSUMED x" in page
    data = json.loads((tmp_path / "hazards.json").read_text())
    assert data["schema"] == "twin/hazards/1"
    assert [d["name"] for d in data["detectors"]] == [
        "fixed limit",
        "adaptive limit",
        "fixed limit or checks",
        "adaptive limit or checks",
    ]
    write_result(Hazards("r", table, 3, [], []), tmp_path)  # nothing done yet
    shown = write_result(brief, tmp_path)
    assert shown == ["trends.html", "trends.png"]


# ------------------------------------------------------------------------------------------- several processes


@pytest.fixture
def short(tmp_path):
    """A campaign of 12 sessions."""
    text = TABLE.read_text().replace("faults = 2000", "faults = 10").replace("free = 100", "free = 2")
    text = text.replace("2500, 25000]", "300]").replace("trained = 200", "trained = 3")
    path = tmp_path / "short.toml"
    path.write_text(text)
    return path


@pytest.mark.nightly
def test_processes_and_a_kill_change_no_outcome(short, tmp_path):
    """A command that is killed goes on; the log has every session once, equal to those of one process."""
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "twin", "hazards", "raven_left", "--campaign", str(short), "--out", str(folder)]
    process = subprocess.Popen([*command, "--quiet", "--processes", "2"], stdout=subprocess.DEVNULL)
    end = time.monotonic() + 120
    while not (folder / FILE).is_file() or len((folder / FILE).read_text().splitlines()) < 4:
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    kept = (folder / FILE).read_text().splitlines()
    assert len(kept) < 13
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert (found["verdict"], found["sessions"]) == ("agree", 12)
    lines = (folder / FILE).read_text().splitlines()
    assert lines[: len(kept) - 1] == kept[:-1]
    rows = {row["index"]: row for row in map(json.loads, lines[1:])}
    assert len(lines) == 13
    assert sorted(rows) == list(range(12))
    alone = {row["index"]: row for row in outcomes(Share("raven_left", str(short), tuple(range(12))))}
    for index, row in alone.items():
        for name, value in row.items():
            if isinstance(value, float):
                np.testing.assert_allclose(rows[index][name], value, rtol=1e-9)
            else:
                assert rows[index][name] == value


@pytest.mark.slow
@pytest.mark.parametrize("stopped", ["by hand", "by a failure"])
def test_a_stopped_campaign_says_what_is_kept_and_how_to_go_on(short, tmp_path, monkeypatch, stopped):
    def poll(stream):
        if stopped == "by hand":
            raise KeyboardInterrupt
        return [], "the worker process has ended"

    monkeypatch.setattr("twin.core.jobs.Stream.start", lambda stream, job: None)
    monkeypatch.setattr("twin.core.jobs.Stream.poll", poll)
    with pytest.raises((KeyboardInterrupt, TwinError)) as caught:
        hazards(twin.load("raven_left"), short, tmp_path / "out", processes=1)
    kept = f"0 sessions are in {tmp_path / 'out' / FILE}; run the same command again to go on"
    failed = f"a process of the campaign failed: the worker process has ended; {kept}"
    assert str(caught.value) == (kept if stopped == "by hand" else failed)


@pytest.mark.parametrize("source", [None, "raven_left"])
def test_a_robot_that_is_not_as_filed_is_refused(short, tmp_path, source):
    changed = twin.load("raven_left").with_transmission("coupled")
    with pytest.raises(TwinError, match="raven_left differs from its files, by which other processes load it, in: the"):
        hazards(changed, short, tmp_path / "out", source=source)


def test_nothing_left_needs_no_process(short, tmp_path):
    robot = twin.load("raven_left")
    first = hazards(robot, short, tmp_path / "out", sessions=0)
    assert not first.rows
    assert [f.code for f in first.findings] == ["hazards.unfinished"]
