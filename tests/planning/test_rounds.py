"""Rounds of a search: from the planner to text, files, report and pictures; files have no times."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from api.test_multi_robot_plan import Robot, protocol_of
from made import reports
from made.arm import arm, post, space_of
from twin.core.result import TextTable, as_json
from twin.planning.costs import COSTS
from twin.planning.plan import plan
from twin.planning.plan_result import Planned
from twin.planning.rounds import UNITS, SearchRound, SearchRounds
from twin.ui.report import search_figures, write_report
from twin.ui.report.figure_output import png

ENDS = np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1])
INF = float("inf")
MANY = SearchRounds("length", [SearchRound(60, INF, INF, 0.1, 0.2), SearchRound(200, 0.41, 0.33, 0.3, 0.6)])
ONE = SearchRounds("length_and_stops", [SearchRound(60, 4.1, 3.3, 0.1, 0.2)])


def test_every_cost_has_a_unit():
    assert UNITS.keys() == COSTS.keys()


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A plan with a phase that needs a search and one that does not."""
    protocol = protocol_of(tmp_path_factory.mktemp("plan"), *ENDS, ENDS[1] + 0.05)
    first = replace(protocol.phases[0], samples=300)
    protocol = replace(protocol, phases=(first, *protocol.phases[1:]))
    kinematics = replace(Robot(arm()).path_kinematics(), space=lambda *_: space_of(arm(), post(0.52, 0)))
    return [Planned(plan(protocol, kinematics, T_tool_frame=np.eye(4))) for _ in range(2)]


@pytest.mark.slow
def test_a_plan_has_the_rounds_of_each_search_and_its_files_are_the_same_each_time(planned, tmp_path):
    first, again = planned
    assert list(first.rounds) == ["to_w1"], "the second path is straight"
    found = first.rounds["to_w1"]
    assert (found.cost, found.unit, [r.samples for r in found.rounds]) == ("length", "m", [60, 200, 300])
    data = json.loads(as_json(first.as_dict()))
    assert data["phases"][0]["rounds"] == found.as_dict()
    assert data["phases"][0]["rounds"]["best"][0] is None
    assert data["phases"][1]["rounds"] is None
    assert data["search_times"] == {"to_w1": found.times()}
    for name, result in (("a", first), ("b", again)):
        (tmp_path / name).mkdir()
        result.write(tmp_path / name)
    assert first.rounds["to_w1"].times() != again.rounds["to_w1"].times()
    for file in ("trajectory.json", "trajectory.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert png(search_figures.figure("x", first.rounds)) == png(search_figures.figure("x", again.rounds))


@pytest.mark.slow
def test_the_text_of_a_plan_tells_costs_and_times(planned):
    (table,) = (t for t in planned[0].text() if isinstance(t, TextTable) and t.header[0] == "search for")
    assert [row[:2] for row in table.rows] == [("to_w1", "60"), ("to_w1", "200"), ("to_w1", "300")]
    assert table.rows[0][2:4] == ("no path", "no path")
    assert all(row[3].endswith(" mm") for row in table.rows[1:])


@pytest.mark.nightly
def test_the_report_has_the_rounds_without_times_and_their_plot(tmp_path):
    report = reports.make_report("agree", 50)
    phases = tuple(replace(p, rounds=r) for p, r in zip(report.phases, (MANY, None, ONE, None, None), strict=True))
    out = write_report(replace(report, phases=phases), tmp_path)
    read = json.loads(out["json"].read_text("utf-8"))["phases"]
    assert [p["rounds"] for p in read] == [MANY.as_dict(), None, ONE.as_dict(), None, None]
    assert "Cost of each path around obstacles" in out["html"].read_text("utf-8")
    with Image.open(out["plots/path_cost"]) as image:
        assert image.width >= 900


@pytest.mark.parametrize("searches", [{"out": MANY}, {"home": ONE}, {"out": MANY, "again": MANY, "home": ONE}])
def test_a_ring_marks_the_path_of_the_plan_and_nothing_is_cut_off(searches):
    out = search_figures.figure("Paths", searches)
    kinds = dict.fromkeys(s.cost for s in searches.values())
    assert [ax.get_ylabel() for ax in out.axes] == [
        {"length": "length [mm]", "length_and_stops": "length and stops"}[k] for k in kinds
    ]
    assert sum(len(ax.get_legend_handles_labels()[1]) for ax in out.axes) == len(searches)
    for ax in out.axes:
        (low, high), (left, right) = ax.get_ylim(), ax.get_xlim()
        points = np.concatenate([line.get_xydata() for line in ax.lines if len(line.get_xdata())])
        points = points[np.isfinite(points).all(axis=1)]
        assert np.all((left < points[:, 0]) & (points[:, 0] < right))
        assert np.all((low <= points[:, 1]) & (points[:, 1] < high))
    rings = [line for ax in out.axes for line in ax.lines if line.get_markersize() == 9]
    last = [s.rounds[-1] for s in searches.values()]
    scale = [1e3 if s.unit == "m" else 1.0 for s in searches.values()]
    seen = sorted((line.get_xdata()[0], line.get_ydata()[0]) for line in rings)
    np.testing.assert_allclose(seen, sorted((r.samples, r.best * f) for r, f in zip(last, scale, strict=True)))
