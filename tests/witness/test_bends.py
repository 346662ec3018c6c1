"""Deformables in files: programs that nobody here wrote play the simulated vertices."""

from __future__ import annotations

import numpy as np
import pytest

from made import organs as made
from twin.exchange.write.glb import bends_glb
from twin.usd.write.bends import write_bends

pytestmark = pytest.mark.witness
LIMIT = 10e-6
TIMES = (0.0, 0.25, 0.5, 0.7, 1.0, 1.5)
"""Times of frames: Blender shows no time between two of them in USD."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bends")
    (folder / "organs.glb").write_bytes(bends_glb("organs", made.bends()))
    write_bends("organs", made.bends(), folder / "organs.usdc")
    return folder


def judge(printed, file, figures):
    worst = 0.0
    for bend in made.bends():
        for t, flat in zip(TIMES, printed["meshes"][bend.name], strict=True):
            seen, there = np.reshape(flat, (-1, 3)), made.at_time(bend, t)
            assert seen.shape == there.shape, bend.name
            worst = max(worst, float(np.abs(seen - there).max()))
    figures.add(printed["version"], "organs", file.name, worst, float("nan"), f"{len(TIMES)} times")
    assert worst < LIMIT


def at():
    return ",".join(map(str, TIMES))


@pytest.mark.witness("node")
def test_three_plays_the_vertices(files, foreign, figures):
    judge(foreign.read("node", "read_bends.mjs", files / "organs.glb", at()), files / "organs.glb", figures)


@pytest.mark.witness("node")
def test_khronos_finds_nothing_in_deformables(files, foreign):
    (found,) = (v for k, v in foreign.read("node", "check_glb.mjs", files / "organs.glb").items() if k != "version")
    assert [found[k] for k in ("errors", "warnings")] == [0, 0], found["messages"]


@pytest.mark.witness("bpy")
@pytest.mark.parametrize("name", ["organs.glb", "organs.usdc"])
def test_blender_plays_the_vertices(files, foreign, figures, name):
    judge(foreign.read("bpy", "read_bends.py", files / name, at()), files / name, figures)
