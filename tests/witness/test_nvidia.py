"""NVIDIA's validator finds nothing in the stages for engines, their motions and the USDZ."""

from __future__ import annotations

import pytest
from pxr import Usd, UsdGeom

from twin.usd.write import write_stage

pytestmark = pytest.mark.witness("nvidia")

from made import mechanisms as made


def test_nvidia_finds_nothing(case, foreign, figures):
    files = [case.usd(), *map(case.usd, case.motions), *map(case.usdz, case.motions)]
    printed = foreign.read("nvidia", "check_nvidia.py", files[0], "--same-meshes", *files[1:], timeout=900)
    for file in files:
        found = printed[str(file)]
        nan = float("nan")
        figures.add(printed["version"], case.robot, file.name, nan, nan, f"{len(found)} issues")
    assert not any(printed[str(f)] for f in files), {f.name: printed[str(f)] for f in files}


@pytest.mark.parametrize("asked", ["first", "again"])
def test_nvidia_sees_what_is_wrong(foreign, tmp_path, asked):
    root = write_stage(made.four_bar(), tmp_path, *made.four_bar_state(made.CRANK_AT_REST)).root
    option = [] if asked == "first" else ["--same-meshes"]
    assert foreign.read("nvidia", "check_nvidia.py", *option, root)[str(root)] == []
    stage = Usd.Stage.Open(str(root))
    mesh = next(UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))
    mesh.GetExtentAttr().Set([(-9, -9, -9), (9, 9, 9)])
    stage.GetRootLayer().pseudoRoot.ClearInfo("metersPerUnit")
    stage.GetRootLayer().Save()
    rules = {i["rule"] for i in foreign.read("nvidia", "check_nvidia.py", *option, root)[str(root)]}
    assert {"ExtentsChecker", "StageMetadataChecker"} <= rules
