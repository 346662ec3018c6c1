"""Blender plays GLB, USD and USDZ."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.witness("bpy")


def test_blender_shows_every_link_where_it_is(case, foreign, judge, tmp_path):
    printed = foreign.read("bpy", "read_blender.py", case.job(tmp_path / "job.json", "glb", "usdz", "usd"), timeout=900)
    for name, found in printed.items():
        if name.startswith("glb"):
            assert found["clips"] == sorted(case.motions)
    judge(printed, case)
