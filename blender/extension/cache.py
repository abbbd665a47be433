"""Caches: the cloth of the scene's frames as PC2 files, which the modifier Mesh Cache plays."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import bpy

from . import live, surface
from .errands import sentence_of
from .finer import shown
from .pc2 import Pc2File
from .selection import character_of

FOLDER = "uvcloth_cache"
"""Folder of caches beside the .blend."""


class WriteCache(bpy.types.Operator):
    """Write the cloth of all frames of the scene into files; Esc stops"""

    bl_idname = "uvcloth.cache"
    bl_label = "Cache"
    bl_options = {"UNDO"}  # noqa: RUF012

    _timer: Any = None
    _frames: Generator[float, None, None] | None = None

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Offer it for live clothes."""
        armature = character_of(context)
        return armature is not None and armature.uvcloth.live

    def execute(self, context: Any) -> set[str]:
        """Write all frames at once."""
        try:
            for _ in cached(context, character_of(context)):
                pass
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, sentence_of(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Write a frame at each tick of a timer, so that one sees it and can stop it."""
        self._frames = cached(context, character_of(context))
        manager = context.window_manager
        self._timer = manager.event_timer_add(0.0, window=context.window)
        manager.progress_begin(0.0, 1.0)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Write the next frame, or stop."""
        assert self._frames is not None
        if event.type == "ESC":
            self._frames.close()
            return self._end(context, "CANCELLED")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            share = next(self._frames)
        except StopIteration:
            return self._end(context, "FINISHED")
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, sentence_of(error))
            return self._end(context, "CANCELLED")
        context.window_manager.progress_update(share)
        return {"RUNNING_MODAL"}

    def _end(self, context: Any, how: str) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        return {how}


class DropCache(bpy.types.Operator):
    """Take the caches off the garments; the files stay"""

    bl_idname = "uvcloth.drop_cache"
    bl_label = "Take Cache Off"
    bl_options = {"UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Offer it for garments with a cache."""
        armature = character_of(context)
        return armature is not None and is_cached(armature)

    def execute(self, context: Any) -> set[str]:
        """Remove the modifiers."""
        for part in _cached_parts(character_of(context)):
            part.modifiers.remove(part.modifiers[surface.CACHE])
        return {"FINISHED"}


def is_cached(armature: Any) -> bool:
    """Tell whether a garment of a character has a cache."""
    return bool(_cached_parts(armature))


def _cached_parts(armature: Any) -> list[Any]:
    parts = map(shown, armature.uvcloth.garments)
    return [part for part in parts if part is not None and surface.CACHE in part.modifiers]


def cached(context: Any, armature: Any) -> Generator[float, None, None]:
    """Write the frames of the scene, yielding the share that is done; then files replace live cloth.

    Raises ValueError for a .blend without a place, and with the runtime's sentence; OSError. Then, and where
    it is closed before the end, nothing is changed.
    """
    if not bpy.data.filepath:
        raise ValueError("save the .blend first: caches are written beside it")
    scene, garments = context.scene, list(live.garments_of(armature).values())
    first, frames, shown = scene.frame_start, scene.frame_end + 1 - scene.frame_start, scene.frame_current
    folder = Path(bpy.path.abspath(f"//{FOLDER}"))
    files: list[Pc2File] = []
    try:
        for garment in garments:
            name = bpy.path.clean_name(f"{Path(bpy.data.filepath).stem}-{garment.name}")
            files.append(Pc2File(folder / f"{name}.pc2", len(garment.data.vertices), frames))
        for frame in range(first, first + frames):
            scene.frame_set(frame)
            if fault := live.FAULTS.get(armature.session_uid):
                raise ValueError(f"frame {frame}: {fault}")
            for garment, file in zip(garments, files, strict=True):
                file.write(surface.places(garment))
            yield (frame + 1 - first) / frames
        for file in files:
            file.finish()
    except BaseException:
        for file in files:
            file.discard()
        scene.frame_set(shown)
        raise
    armature.uvcloth.live = False
    for garment, file in zip(garments, files, strict=True):
        _play(garment, file.path, first)
    scene.frame_set(shown)


def _play(garment: Any, path: Path, first: int) -> None:
    """Let a garment play a cache from a frame on, where live cloth had its modifier."""
    earlier = garment.modifiers.get(surface.CACHE)
    if earlier is not None:
        garment.modifiers.remove(earlier)
    place = surface.place_of_cloth(garment)
    modifier = garment.modifiers.new(surface.CACHE, "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "PC2", bpy.path.relpath(str(path))
    modifier.frame_start, modifier.interpolation = first, "LINEAR"
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    garment.modifiers.move(len(garment.modifiers) - 1, place)
