"""Run by a Python that has bpy: python export_from_blender.py BENCHMARK.abc GARMENT FRAMES OUT.

Imports the benchmark as an artist would and exports its garment alone to OUT.abc and OUT.usdc.
"""

import sys

import bpy

file, garment, frames, out = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = 30
bpy.ops.wm.alembic_import(filepath=file)
for part in bpy.data.objects:
    part.select_set(part.name == garment)
scene.frame_start, scene.frame_end = 0, int(frames) - 1
bpy.ops.wm.alembic_export(filepath=f"{out}.abc", selected=True)
bpy.ops.wm.usd_export(filepath=f"{out}.usdc", selected_objects_only=True, export_animation=True)
