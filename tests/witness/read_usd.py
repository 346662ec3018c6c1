"""Another release of OpenUSD than the project's reads USD and USDZ and plays them.

    python read_usd.py job.json

    job: [{id, path, clip: name | "", times: [s, ...], links: [name, ...]}, ...]

Prints {id: {times, duration, links: {prim: [16 numbers, row-major T_world_prim, z up, m]}}}: prims directly below the
root prim.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from pxr import Gf, Usd, UsdGeom

Z_UP = {"Y": Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), 90)), "Z": Gf.Matrix4d(1)}


def main() -> None:
    out: dict[str, object] = {"version": "OpenUSD " + ".".join(map(str, Usd.GetVersion()[1:]))}
    for task in json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")):
        stage = Usd.Stage.Open(task["path"])
        turn, scale = Z_UP[UsdGeom.GetStageUpAxis(stage)], UsdGeom.GetStageMetersPerUnit(stage)
        cache, links = UsdGeom.XformCache(), {}
        for t in task["times"]:
            cache.SetTime(t * stage.GetTimeCodesPerSecond())
            for prim in stage.GetDefaultPrim().GetChildren():
                if prim.GetName() in task["links"]:
                    T = (cache.GetLocalToWorldTransform(prim) * turn).GetTranspose()  # USD has its vectors in rows
                    row = [x for r in range(3) for x in (*list(T.GetRow(r))[:3], T[r][3] * scale)]
                    links.setdefault(prim.GetName(), []).append([*row, 0.0, 0.0, 0.0, 1.0])
        span = stage.GetEndTimeCode() - stage.GetStartTimeCode()
        out[task["id"]] = {
            "times": task["times"],
            "duration": span / stage.GetTimeCodesPerSecond(),
            "links": links,
        }
    sys.stdout.write(json.dumps(out) + "\n")


main()
