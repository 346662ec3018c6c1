"""Blender (bpy) reads a GLB or USD of deformables and plays it.

    python read_bends.py file 0.25,0.5,...

Prints {version, meshes: {object: [[x, y, z, ...] at each time]}}, vertices in the World, z up, m.
"""

from __future__ import annotations

import json
import os
import sys

import bpy

FPS = 60
path, times = sys.argv[1], [float(t) for t in sys.argv[2].split(",")]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.render.fps_base = FPS, 1.0
if path.endswith(".glb"):
    bpy.ops.import_scene.gltf(filepath=path)
else:
    bpy.ops.wm.usd_import(filepath=path, merge_parent_xform=False, set_frame_range=True)
for thing in bpy.data.objects:  # the reader stores the clip as a strip of an NLA track, which may be muted
    keys = thing.data.shape_keys if thing.type == "MESH" else None
    if keys is not None and keys.animation_data is not None:
        for track in list(keys.animation_data.nla_tracks):
            keys.animation_data.action = track.strips[0].action
            if hasattr(keys.animation_data, "action_slot"):
                keys.animation_data.action_slot = track.strips[0].action_slot
            keys.animation_data.nla_tracks.remove(track)
meshes: dict[str, list[list[float]]] = {}
for t in times:
    frame = t * FPS
    scene.frame_set(int(frame), subframe=frame - int(frame))
    graph = bpy.context.evaluated_depsgraph_get()
    for thing in bpy.data.objects:
        if thing.type == "MESH":
            shown = thing.evaluated_get(graph)
            at = [x for v in shown.to_mesh().vertices for x in shown.matrix_world @ v.co]
            meshes.setdefault(thing.name.split(".")[0], []).append(at)
print("\n" + json.dumps({"version": f"Blender {bpy.app.version_string}", "meshes": meshes}), flush=True)
os._exit(0)
