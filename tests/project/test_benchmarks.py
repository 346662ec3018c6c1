"""The record that benchmarks are held to: what fell is named, what is missing is not a fault. Nothing is timed here."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import pytest


@pytest.fixture
def bench(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    race, pages = (importlib.import_module(n) for n in ("race", "pages"))
    monkeypatch.setattr(pages, "RECORD", tmp_path / "recorded.json")
    yield race, pages
    for name in ("race", "pages"):
        sys.modules.pop(name, None)


def results(race, ratio: float, error: float = 1e-15) -> dict:
    row = race.Row("twin: ours", 1.0, 0.1, 1.0, 1.0, 1.0, error, "", None, False)
    peer = race.Row("peer", ratio, 0.1, ratio, ratio, ratio, 1e-9, "9 of 10", 30.0, True, ratio)
    return {"loops": [race.Table("warm", "Some work", [row, peer], judge="gap in m", limit=1e-11)]}


def test_a_ratio_that_fell_is_named(bench):
    race, pages = bench
    pages.record(results(race, 50.0), pages.here(), short=True)
    assert pages.fallen(results(race, 31.0), short=True) == {}
    (said,) = pages.fallen(results(race, 29.0), short=True)["loops"]
    assert said.startswith("loops/warm/peer: ratio 29, more than 40 % below the recorded 50 of an ")


def test_what_is_not_installed_or_new_is_no_fault(bench):
    race, pages = bench
    pages.record(results(race, 50.0), pages.here(), short=True)
    other = results(race, 1.0)
    other["loops"][0].rows[1].name = "new"
    assert pages.fallen(other, short=True) == {}


def test_what_is_fast_but_wrong_is_named(bench):
    race, pages = bench
    pages.record(results(race, 50.0), pages.here(), short=True)
    assert pages.fallen(results(race, 50.0, 1e-10), short=True) == {
        "loops": ["loops/warm: error 1e-10 above 1e-11; gap in m"]
    }


def test_both_forms_are_kept_and_other_topics_stay(bench):
    race, pages = bench
    pages.record(results(race, 50.0), pages.here(), short=True)
    pages.record({"timing": results(race, 7.0)["loops"]}, pages.here(), short=True)
    pages.record(results(race, 60.0), pages.here(), short=False)
    kept = json.loads(pages.RECORD.read_text())
    assert kept["short"]["ratios"] == {"loops/warm/peer": 50.0, "timing/warm/peer": 7.0}
    assert kept["full"]["ratios"] == {"loops/warm/peer": 60.0}


def test_a_page_says_what_is_met(bench, tmp_path):
    race, pages = bench
    pages.write(results(race, 29.0), pages.here(), tmp_path / "bench.md", tmp_path / "bench.png", short=True)
    page = (tmp_path / "bench.md").read_text()
    assert "| loops: warm | peer | 29× | ≥ 30× | **not met** |" in page
    assert "| loops: warm, error | gap in m | 1.0e-15 | ≤ 1e-11 | met |" in page
    assert json.loads((tmp_path / "bench.json").read_text())["topics"]["loops"][0]["rows"][1]["ratio"] == 29.0
    assert (tmp_path / "bench.png").stat().st_size > 1000


def test_contenders_take_turns(bench):
    race, _ = bench
    order: list[str] = []
    table = race.race(
        race.Table("t", "Turns"),
        [race.Contender(n, lambda n=n: order.append(n)) for n in "ab"],
        race.Effort(short=True),
    )
    assert [r.name for r in table.rows] == ["a", "b"]
    turns = [n for n, before in zip(order, ["", *order], strict=False) if n != before]
    assert "".join(turns[-10:]) == "ab" * 5


def test_one_topic_is_put_into_the_page_and_the_others_stay(bench, monkeypatch, tmp_path):
    race, pages = bench
    page = tmp_path / "benchmarks.md"
    page.write_text("# Benchmarks\n\nBy hand.\n\n")
    monkeypatch.setattr(pages, "PAGE", page)
    with pytest.raises(AssertionError, match="no line with the date"):
        pages.head()
    page.write_text("# Benchmarks\n\nBy hand.\n\n2026-01-01, a machine\n")
    both = results(race, 50.0) | {"timing": results(race, 7.0)["loops"]}
    page.write_text(pages.markdown(both, pages.here(), "picture.png", short=False))
    before = page.read_text()
    pages.renew(results(race, 44.0), pages.here(), short=False)
    after = page.read_text()
    assert after.startswith("# Benchmarks\n\nBy hand.\n\n")
    assert "| loops: warm | peer | 44× |" in after
    assert "| loops: warm | peer | 50× |" not in after
    assert "| timing: warm | peer | 7× |" in after
    assert after[after.index("## timing") :] == before[before.index("## timing") :]
    pages.renew({"new": results(race, 3.0)["loops"]}, pages.here(), short=True)
    assert "## new\n\nRecorded apart from the other topics (short form" in page.read_text()
    assert page.read_text().count("| new: warm | peer | 3× |") == 1
