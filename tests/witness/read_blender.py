"""Blender (bpy) reads GLB, USD and USDZ, each in an empty file, and plays them.

    python read_blender.py job.json

    job: [{id, path, clip: name | "", times: [s, ...], links: [name, ...]}, ...]

Prints {id: {times, clips, links: {object: [16 numbers, row-major T_world_object, z up, m]}}}. Blender is z up.
"""

from __future__ import annotations

import json
import math
import sys

import bpy
from mathutils import Matrix

FPS = 60
"""Blender does not take the frame rate of a USD file over; it is set by hand."""

FROM_GLTF = Matrix.Rotation(math.pi / 2, 4, "X")
"""The GLB reader turns every local frame along, not only the root: its objects have T_world_node @ inverse of this."""


def load(path: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = FPS
    bpy.context.scene.render.fps_base = 1.0
    if path.endswith(".glb"):
        bpy.ops.import_scene.gltf(filepath=path)
    else:
        # Otherwise the transform above a lone mesh is swallowed, and the link with it.
        bpy.ops.wm.usd_import(filepath=path, merge_parent_xform=False, set_frame_range=True)


def choose(clip: str) -> list[str]:
    """Let every object play its part of a clip of a GLB; return the names of all clips.

    The reader makes one NLA track a clip in each object. What its strip holds is played itself: strips begin and end
    on whole frames.
    """
    clips: set[str] = set()
    for thing in bpy.data.objects:
        data = thing.animation_data
        if data is None:
            continue
        data.action = None
        for track in data.nla_tracks:
            clips.add(track.name)
            track.mute = True
            if track.name == clip:
                data.action = track.strips[0].action
                data.action_slot = track.strips[0].action_slot
    return sorted(clips)


def poses(wanted: list[str], turned: bool) -> dict[str, list[float]]:
    out = {}
    evaluated = bpy.context.evaluated_depsgraph_get()
    for thing in bpy.context.scene.objects:
        if thing.name not in wanted:
            continue
        T = thing.evaluated_get(evaluated).matrix_world
        T = T @ FROM_GLTF if turned else T
        out[thing.name] = [T[r][c] for r in range(4) for c in range(4)]
    return out


def main() -> None:
    with open(sys.argv[1]) as file:  # noqa: PTH123 - as it would be typed in Blender
        job = json.load(file)
    out: dict[str, object] = {"version": f"Blender {bpy.app.version_string}"}
    for task in job:
        load(task["path"])  # each time: what a clip does not move must not stay where another clip has left it
        glb = task["path"].endswith(".glb")
        clips = choose(task["clip"]) if glb else []
        links: dict[str, list[list[float]]] = {}
        for t in task["times"]:
            # The GLB reader puts time 0 at frame 0; in USD a time code is a frame.
            frame = math.floor(t * FPS)
            bpy.context.scene.frame_set(frame, subframe=t * FPS - frame)
            for name, pose in poses(task["links"], glb).items():
                links.setdefault(name, []).append(pose)
        out[task["id"]] = {"times": task["times"], "clips": clips, "links": links}
    sys.stdout.write("\n" + json.dumps(out) + "\n")


main()
