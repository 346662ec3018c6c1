"""three.js in node plays GLB and USDZ; Khronos' validator finds nothing in a GLB."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.witness("node")


def test_three_shows_every_link_where_it_is(case, foreign, judge, tmp_path):
    printed = foreign.read("node", "read_three.mjs", case.job(tmp_path / "job.json", "glb", "usdz"))
    for name, found in printed.items():
        if name == "version":
            continue
        duration = case.motions[name.split()[-1]].duration
        assert found["duration"] == pytest.approx(duration, abs=1e-5), name
        if name.startswith("glb"):
            assert sorted(found["clips"]) == sorted(case.motions)
    judge(printed, case)


def test_khronos_finds_nothing(case, foreign, figures):
    printed = foreign.read("node", "check_glb.mjs", case.glb)
    found = printed[str(case.glb)]
    counts = [found[k] for k in ("errors", "warnings", "infos", "hints")]
    figures.add(printed["version"], case.robot, case.glb.name, float("nan"), float("nan"), "/".join(map(str, counts)))
    assert counts == [0, 0, 0, 0], found["messages"]
