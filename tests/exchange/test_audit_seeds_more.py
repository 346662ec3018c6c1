"""Seeded defects of what formats declare beside poses and masses are found by their cause, with and without a robot.

By default one kind on a small robot; `TWIN_SEEDS=all` seeds every kind, in turn in one of five real robots.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from made import audit_seeds, audit_seeds_more, bundle
from made.lanes import thinned
from twin.exchange.audit import audit

EVERY = os.environ.get("TWIN_SEEDS") == "all"
ROBOTS = ("pa10", "sils", "sher", "davinci_psm", "hibou")
LEAST = 0.98
"""Share of the seeded defects that must be found by their right cause."""

FEW = ("MJCF: joint damped", "USD: collider disabled", "USD: joint breaks", "MJCF: turn of a mesh")
"""Kinds that are seeded by default."""


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    return bundle.write_good(tmp_path_factory.mktemp("good") / "bars")


@pytest.mark.parametrize("name", thinned(FEW, every=4))
def test_a_seeded_defect_of_a_declaration_is_found_by_its_cause(name, bars, tmp_path):
    one = next(s for s in audit_seeds_more.MORE if s.name == name)
    assert audit_seeds_more.copied(bars, tmp_path / "spoilt", one), "this robot has nothing of the kind"
    report = audit(tmp_path / "spoilt")
    assert audit_seeds_more.found(report, one), [(f.code, f.where, f.message) for f in report.findings]


def test_the_kinds_are_many_and_stand_in_no_other_table():
    names = [s.name for s in audit_seeds_more.MORE]
    assert len(set(names)) == len(names) >= 80
    assert not set(names) & {s.name for s in audit_seeds.SEEDS}
    assert {*FEW, *audit_seeds_more.WARNED} <= set(names)


@pytest.fixture(scope="module")
def real(tmp_path_factory) -> dict[str, Path]:
    """Return exports of real robots with one protocol and few keys."""
    return audit_seeds.exported(ROBOTS, tmp_path_factory.mktemp("real"))


@pytest.mark.nightly
@pytest.mark.skipif(not EVERY, reason="minutes: set TWIN_SEEDS=all")
def test_every_kind_is_found_in_real_robots_with_and_without_the_mechanism(real, tmp_path):
    import twin

    count, missed = 0, []
    for i, one in enumerate(audit_seeds_more.MORE):
        order = (*ROBOTS[i % len(ROBOTS) :], *ROBOTS[: i % len(ROBOTS)])
        name = next((n for n in order if audit_seeds_more.copied(real[n], tmp_path / "spoilt", one)), None)
        assert name is not None, f"no robot has anything of the kind {one.name}"
        for mechanism in (None, name):
            count += 1
            report = twin.audit(tmp_path / "spoilt", mechanism)
            if not audit_seeds_more.found(report, one):
                told = [f"{f.code} {f.where}" for f in report.findings if f.severity != "info"]
                missed.append(f"{name}: {one.name}: {told[:3]}")
    print(f"{count - len(missed)} of {count} seeded defects found by their cause", *missed, sep="\n  ")
    assert 1 - len(missed) / count >= LEAST, missed
