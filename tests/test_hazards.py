"""Campaigns of faults: drawn by a seed, logged, interrupted and continued, judged against the model."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.api.hazards import FILE, Share, hazards, outcomes
from twin.api.machine import machine_parts
from twin.core.errors import DescriptionError, OutputError
from twin.simulation.hazards.attacked import Arena
from twin.simulation.hazards.campaign import FREE, load
from twin.simulation.hazards.fault import Fault
from twin.simulation.hazards.log import Log
from twin.simulation.hazards.summary import Hazards
from twin.simulation.machine.itp import FIELDS

TABLE = Path(__file__).parents[1] / "cad/raven_left/campaigns/table1.toml"
MOTORS = tuple(f"motor_{n}" for n in ("shoulder", "elbow", "insertion", "roll", "wrist", "jaw1", "jaw2"))
PLACES = {"packet": FIELDS, "encoder": MOTORS, "dac": MOTORS}
HEAD = {"log": "twin-hazards", "version": 1, "robot": "r", "campaign": "c"}


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("raven_left"))


@pytest.fixture(scope="module")
def arena(parts):
    return Arena(parts)


def test_a_campaign_is_drawn_by_its_seed_and_within_its_ranges():
    plan, again = load(TABLE, PLACES), load(TABLE, PLACES)
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
    (fault,) = plan.faults(next(d for d in drawn if d.target == "motor_elbow" and d.signal == "dac"))
    assert fault.target == [1]


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('targets = [["grasp"]]', 'targets = [["grsap"]]', r"target of packet 'grsap'. Did you mean 'grasp'"),
        ('signal = "dac"', 'signal = "adc"', "signal"),
        ('name = "wrong grasp"', 'name = "wrong pedal"', "'wrong pedal' is there twice"),
        ("value = [-200, 200]", "value = [200, -200]", "the range"),
        ("whole = true\n", "", "a delay needs whole = true"),
        ("seed = 1", "seed = -1", "seed"),
        ("mass = [0.9, 1.1]", "mass = [0, 1.1]", "mass"),
    ],
)
def test_a_wrong_campaign_is_refused(tmp_path, before, after, message):
    text = TABLE.read_text()
    assert before in text
    (tmp_path / "mine.toml").write_text(text.replace(before, after, 1))
    with pytest.raises(DescriptionError, match=message):
        load(tmp_path / "mine.toml", PLACES)


def test_an_unknown_campaign_is_named():
    with pytest.raises(DescriptionError, match=r"table2\.toml: the file does not exist; campaigns .*: table1"):
        load(TABLE.with_name("table2.toml"), PLACES)


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
    ],
)
def test_another_log_is_refused_and_kept(tmp_path, text, message):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(OutputError, match=message):
        Log(tmp_path / FILE, HEAD)
    assert (tmp_path / FILE).read_text() == text


def test_a_jump_is_felt_in_the_tick_after_3_mm(arena):
    fault = Fault("dac", 320, 420, "overwrite", 2500.0, target=0, counts=True)
    found = arena.run([fault], 320, 100, 1.0, 1.0)
    assert found.peak > 3
    assert 0 < found.harm < found.beyond <= found.cue <= found.beyond + 2
    assert 80 < found.beyond < 110  # 92 ms on the motion of the published table


def test_a_fault_that_a_check_sees_stops_the_arm_before_harm(arena):
    fault = Fault("packet", 320, 321, "add", [5000.0, *[0.0] * 8], counts=True)
    found = arena.run([fault], 320, 1, 1.0, 1.0)
    assert found.stop is not None
    assert found.harm is None
    assert "counts of the DAC (limit 20000)" in found.check


def test_without_a_fault_there_is_no_cue(arena):
    for mass, friction in ((0.9, 1.3), (1.1, 0.7)):
        found = arena.run([], 320, 100, mass, friction)
        assert (found.cue, found.beyond, found.stop) == (None, None, None)
        assert 0 < found.peak < 1


def test_the_summary_counts_by_class():
    none = {"harm": None, "beyond": None, "cue": None, "stop": None, "peak": 0.1}
    rows = [
        {"index": 0, "kind": "a", **none},
        {"index": 1, "kind": "a", **none, "harm": 5, "beyond": 9, "cue": 11, "peak": 4.0},
        {"index": 2, "kind": FREE, **none},
    ]
    found = Hazards("r", "c", 3, rows, {"a": "jump", "b": "-", FREE: "no fault"}, [])
    assert found.verdict == "agree"
    first = found.classes[0]
    assert (first.sessions, first.harmed, first.beyond, first.felt, first.stopped) == (2, 1, 1, 1, 0)
    assert (first.peak_max, first.delay) == (4.0, 2.0)
    assert [c.kind for c in found.classes] == ["a", FREE]
    (unfinished,) = Hazards("r", "c", 4, rows, {}, []).findings
    assert (unfinished.code, unfinished.severity) == ("hazards.unfinished", "warning")
    false = [*rows[:2], rows[2] | {"cue": 3}]
    assert Hazards("r", "c", 3, false, {}, []).verdict == "disagree"


# ------------------------------------------------------------------------------------------- several processes


@pytest.fixture
def short(tmp_path):
    """A campaign of 12 sessions."""
    text = TABLE.read_text().replace("faults = 2000", "faults = 10").replace("free = 100", "free = 2")
    path = tmp_path / "short.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
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


def test_nothing_left_needs_no_process(short, tmp_path):
    robot = twin.load("raven_left")
    first = hazards(robot, short, tmp_path / "out", sessions=0)
    assert not first.rows
    assert [f.code for f in first.findings] == ["hazards.unfinished"]
