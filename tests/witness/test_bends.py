"""Deformables in files: programs that nobody here wrote play the simulated vertices."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from made import organs as made
from twin.exchange.formats.glb.write import bends_glb
from twin.usd.write.deformables import write_deformables
from unity import mono

pytestmark = pytest.mark.witness
LIMIT = 10e-6
TIMES = (0.0, 0.25, 0.5, 0.7, 1.0, 1.5)
"""Times of frames: Blender shows no time between two of them in USD."""


@pytest.fixture(scope="module", params=[made.bends, made.abdomen_bends], ids=["small", "abdomen"])
def bends(request):
    """Two small bodies; liver, gallbladder, stomach and abdominal wall of the scene."""
    return request.param()


@pytest.fixture(scope="module")
def files(bends, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bends")
    (folder / "organs.glb").write_bytes(bends_glb("organs", bends))
    write_deformables("organs", bends, folder / "organs.usdc")
    return folder


def judge(printed, bends, file, figures):
    worst = 0.0
    assert sorted(printed["meshes"]) == sorted(b.name for b in bends)
    for bend in bends:
        for t, flat in zip(TIMES, printed["meshes"][bend.name], strict=True):
            seen, there = np.reshape(flat, (-1, 3)), made.at_time(bend, t)
            assert seen.shape == there.shape, bend.name
            worst = max(worst, float(np.abs(seen - there).max()))
    figures.add(
        printed["version"], ", ".join(b.name for b in bends), file.name, worst, float("nan"), f"{len(TIMES)} times"
    )
    assert worst < LIMIT


def at():
    return ",".join(map(str, TIMES))


@pytest.mark.witness("node")
def test_three_plays_the_vertices(files, bends, foreign, figures):
    judge(foreign.read("node", "read_bends.mjs", files / "organs.glb", at()), bends, files / "organs.glb", figures)


def test_openusd_plays_the_vertices(files, bends, figures):
    stage = Usd.Stage.Open(str(files / "organs.usdc"))
    points = {b.name: UsdGeom.Mesh(stage.GetPrimAtPath(f"/organs/{b.name}")).GetPointsAttr() for b in bends}
    meshes = {n: [np.array(p.Get(t * stage.GetTimeCodesPerSecond()), float) for t in TIMES] for n, p in points.items()}
    version = "OpenUSD " + ".".join(map(str, Usd.GetVersion()[1:]))
    judge({"version": version, "meshes": meshes}, bends, files / "organs.usdc", figures)


@pytest.mark.witness("node")
def test_khronos_finds_nothing_in_deformables(files, foreign):
    (found,) = (v for k, v in foreign.read("node", "check_glb.mjs", files / "organs.glb").items() if k != "version")
    assert [found[k] for k in ("errors", "warnings")] == [0, 0], found["messages"]


@pytest.mark.witness("bpy")
@pytest.mark.parametrize("name", ["organs.glb", "organs.usdc"])
def test_blender_plays_the_vertices(files, bends, foreign, figures, name):
    judge(foreign.read("bpy", "read_bends.py", files / name, at()), bends, files / name, figures)


@pytest.mark.parametrize("convention", mono.CONVENTIONS)
def test_unity_package_plays_the_vertices(files, bends, build, figures, convention):
    """On a stub of the engine, which is ours; the triangles are reversed with the coordinates."""
    program = build.folder / "PlayBends.exe"
    done = mono.run(["mono", str(program), str(files / "organs.glb"), convention, *map(str, TIMES)])
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    meshes = {
        name: [mono.turned_back(convention, np.reshape(flat, (-1, 3))) for flat in mesh["frames"]]
        for name, mesh in found.items()
    }
    version = f"Unity package on {mono.version()}, stub of the engine, {convention}"
    judge({"version": version, "meshes": meshes}, bends, files / "organs.glb", figures)
    for bend in bends:
        seen = np.reshape(found[bend.name]["triangles"], (-1, 3))
        np.testing.assert_array_equal(seen, bend.mesh.triangles[:, ::-1])
