"""Blender (bpy) reads a GLB and writes it again, with custom properties and one clip an NLA track.

    python resave_blender.py in.glb out.glb rate

`rate` is that of its frames, Hz: what it writes has keys at whole frames only.
"""

from __future__ import annotations

import json
import sys

import bpy

source, target, rate = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = round(float(rate))
bpy.ops.import_scene.gltf(filepath=source)
bpy.ops.export_scene.gltf(
    filepath=target, export_extras=True, export_animation_mode="NLA_TRACKS", export_force_sampling=True
)
print(json.dumps({"version": bpy.app.version_string}), flush=True)
