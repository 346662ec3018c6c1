"""The comparison with the truth bites: files that are wrong, each in one way, are wrong in every program.

The robot is a four-bar on a tilted base, small enough to be read in no time; its truth is a closed form.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from twin.exchange.formats.glb.write import glb_bytes
from twin.exchange.formats.usdz.write import package, write_usdz
from twin.exchange.write.clip import Clip, InterpolationErrors

pytestmark = pytest.mark.witness

from made import mechanisms as made
from made.glb_apart import Glb

RATE = 20.0


@pytest.fixture(scope="module")
def clip() -> Clip:
    times = np.arange(25) / RATE
    states = [made.four_bar_state(made.CRANK_AT_REST + 0.9 * np.sin(3 * t)) for t in times]
    links = {b: np.stack([s[0][b] for s in states]) for b in states[0][0]}
    joints = {j: np.array([s[1][j] for s in states]) for j in states[0][1]}
    active = ("crank_joint",)
    errors = InterpolationErrors(0.0, 0.0, 0.0)
    return Clip("swing", "Swing", times, links, joints, active, (("all", 0.0, 1.2),), RATE, errors)


# -- GLB: a defect edits the document and what its accessors hold ----------------------------------------


def no_root_rotation(glb: Any) -> None:
    del glb.node("bars")["rotation"]


def root_turned_the_other_way(glb: Any) -> None:
    glb.node("bars")["rotation"][0] *= -1


def millimetres(glb: Any) -> None:
    glb.node("bars")["scale"] = [1000.0] * 3


def mirrored(glb: Any) -> None:
    glb.node("bars")["scale"] = [1.0, -1.0, 1.0]


def swapped_channels(glb: Any) -> None:
    nodes = [n["name"] for n in glb.document["nodes"]]
    swap = {nodes.index("crank"): nodes.index("rocker"), nodes.index("rocker"): nodes.index("crank")}
    for channel, _ in glb.channels("rotation"):
        channel["target"]["node"] = swap.get(channel["target"]["node"], channel["target"]["node"])


def w_first(glb: Any) -> None:
    for _, sampler in glb.channels("rotation"):
        values = glb.numbers(sampler["output"])
        values[:] = np.roll(values, 1, axis=1)


def too_slow(glb: Any) -> None:
    for accessor in {s["input"] for _, s in glb.channels("rotation")}:
        glb.numbers(accessor)[:] *= 2
        glb.document["accessors"][accessor]["max"][0] *= 2


def ten_micrometres_aside(glb: Any) -> None:
    for _, sampler in glb.channels("translation"):
        glb.numbers(sampler["output"])[-1] += 1e-5


def names_swapped(glb: Any) -> None:
    crank, rocker = glb.node("crank"), glb.node("rocker")
    crank["name"], rocker["name"] = "rocker", "crank"


def name_twice(glb: Any) -> None:
    glb.node("rocker")["name"] = "crank"


def no_clip(glb: Any) -> None:
    glb.document["animations"][0]["name"] = "another"


GLB_DEFECTS: tuple[Callable[[Any], None], ...] = (
    *(no_root_rotation, root_turned_the_other_way, millimetres, mirrored, swapped_channels, w_first, too_slow),
    *(ten_micrometres_aside, names_swapped, name_twice, no_clip),
)


@pytest.mark.parametrize(("program", "script"), [("node", "read_three.mjs"), ("bpy", "read_blender.py")])
def test_wrong_glb_is_wrong(program, script, bundles, foreign, clip, tmp_path):
    motion = bundles.Motion(clip.times, clip.links, 1.2)
    clean = glb_bytes(made.four_bar(), [clip])
    assert Glb(clean).bytes()[-100:] == clean[-100:]
    tasks = []
    for defect in (None, *GLB_DEFECTS):
        glb = Glb(clean)
        if defect:
            defect(glb)
        name = defect.__name__ if defect else "clean"
        (tmp_path / f"{name}.glb").write_bytes(glb.bytes())
        tasks.append(bundles.task(name, tmp_path / f"{name}.glb", motion, "swing"))
    good = seen_good(bundles, foreign, motion, program, script, tasks, tmp_path)
    assert good == ["clean"]


def seen_good(bundles, foreign, motion, program, script, tasks, folder) -> list[str]:
    """Return the names of the tasks that a program shows as they should be."""
    (folder / "job.json").write_text(json.dumps(tasks))
    printed = foreign.read(program, script, folder / "job.json")
    return [t["id"] for t in tasks if bundles.compare(printed[t["id"]], motion).good]


# -- USDZ: a defect edits the stage, which is packed again -----------------------------------------------


def slow_time_codes(stage: Usd.Stage) -> None:
    stage.SetTimeCodesPerSecond(24)


def not_turned(stage: Usd.Stage) -> None:
    UsdGeom.Xformable(stage.GetDefaultPrim()).ClearXformOpOrder()


def hundredfold(stage: Usd.Stage) -> None:
    UsdGeom.Xformable(stage.GetDefaultPrim()).AddScaleOp().Set(Gf.Vec3f(100))


def another_axis(stage: Usd.Stage) -> None:
    attribute = stage.GetPrimAtPath("/bars/rocker").GetAttribute("xformOp:orient")
    for code in attribute.GetTimeSamples():
        w, (x, y, z) = attribute.Get(code).GetReal(), attribute.Get(code).GetImaginary()
        attribute.Set(type(attribute.Get(code))(w, y, x, z), code)


def order_of_operations(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/bars/coupler").GetAttribute("xformOpOrder").Set(["xformOp:orient", "xformOp:translate"])


def still(stage: Usd.Stage) -> None:
    for name in ("xformOp:orient", "xformOp:translate"):
        attribute = stage.GetPrimAtPath("/bars/coupler").GetAttribute(name)
        first = attribute.Get(0.0)
        attribute.Clear()
        attribute.Set(first)


USDZ_DEFECTS: tuple[Callable[[Usd.Stage], None], ...] = (
    *(slow_time_codes, not_turned, hundredfold, another_axis, order_of_operations, still),
)
THREE_MISSES = {"order_of_operations"}
"""three.js turns first and moves then, whatever the file says."""
BLENDER_MISSES = {"slow_time_codes"}
"""Blender does not take over the rate of a file; the witness tells it."""


@pytest.mark.parametrize(
    ("program", "script", "missed"),
    [
        ("node", "read_three.mjs", THREE_MISSES),
        ("bpy", "read_blender.py", BLENDER_MISSES),
        ("arkit", "read_usd.py", set()),
    ],
)
def test_wrong_usdz_is_wrong(program, script, missed, bundles, foreign, clip, tmp_path):
    motion = bundles.Motion(clip.times, clip.links, 1.2)
    clean = write_usdz(made.four_bar(), clip, tmp_path / "clean.usdz")
    tasks = [bundles.task("clean", clean, motion)]
    for defect in USDZ_DEFECTS:
        layer = Sdf.Layer.CreateAnonymous(".usdc")
        layer.TransferContent(Sdf.Layer.FindOrOpen(f"{clean}[bars.usdc]"))
        defect(Usd.Stage.Open(layer))
        inner = tmp_path / f"{defect.__name__}.usdc"
        layer.Export(str(inner))
        package(inner, inner.with_suffix(".usdz"))
        tasks.append(bundles.task(defect.__name__, inner.with_suffix(".usdz"), motion))
    good = seen_good(bundles, foreign, motion, program, script, tasks, tmp_path)
    assert good == ["clean", *(d.__name__ for d in USDZ_DEFECTS if d.__name__ in missed)]
