"""Live clothes: after each change of the frame the runtime moves the garments to the evaluated armature.

Only plain values are kept between frames, by `session_uid`: undo replaces all objects.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray
from uvcloth_core.baked import BakedFile, open_baked
from uvcloth_core.outfit import Cloth, Outfit

from . import surface
from .rig import TO_Z_UP, Rig
from .timeline import Moment, Timeline

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Session:
    """Cloth of one character while Blender runs.

    key: what it was opened by; another file, or another frame rate, makes a new session.
    """

    key: tuple[Any, ...]
    baked: BakedFile
    outfit: Outfit
    cloth: Cloth
    timeline: Timeline


SESSIONS: dict[int, Session] = {}
"""Sessions by the armature's session_uid."""

FAULTS: dict[int, str] = {}
"""What went wrong at the last frame, in one sentence, by the same."""


def open_outfit(path: Path) -> tuple[BakedFile, Outfit]:
    """Open a baked file and what the runtime reads of it. Raises ValueError naming the file."""
    baked = open_baked(path)
    try:
        outfit = Outfit(baked.content)
    except ValueError as error:
        raise baked.file.error(str(error)) from error
    baked.require_fit(outfit.joints, outfit.garments)
    return baked, outfit


def characters() -> Iterator[Any]:
    """Armatures with baked clothes."""
    for armature in bpy.data.objects:
        if armature.type == "ARMATURE" and armature.uvcloth.file:
            yield armature


def garments_of(armature: Any) -> list[Any]:
    """Objects of a character's garments, the innermost first. Raises ValueError if one is gone."""
    parts = [entry.part for entry in armature.uvcloth.garments]
    if not parts or not all(part is not None and part.type == "MESH" for part in parts):
        raise ValueError(f"a garment of {armature.name} is gone: open the character again")
    return parts


def session_of(armature: Any, scene: Any) -> Session:
    """The session of a character, opened if there is none. Raises ValueError."""
    path = Path(bpy.path.abspath(armature.uvcloth.file))
    fps = scene.render.fps / scene.render.fps_base
    changed = path.stat().st_mtime_ns if path.exists() else 0
    key = (path, changed, fps)
    session = SESSIONS.get(armature.session_uid)
    if session is None or session.key != key:
        baked, outfit = open_outfit(path)
        cloth = Cloth(outfit)
        session = SESSIONS[armature.session_uid] = Session(key, baked, outfit, cloth, Timeline(cloth, fps))
    return session


def show(armature: Any, scene: Any, graph: Any) -> None:
    """Move the garments of a character to the scene's frame. Raises ValueError; they stay as they were then.

    graph: evaluated at this frame.
    """
    session = session_of(armature, scene)
    garments = garments_of(armature)
    sources = [surface.source_of(garment) for garment in garments]
    for garment, source, size in zip(garments, sources, session.outfit.garments, strict=True):
        if (
            source.min(initial=0) < 0
            or source.max(initial=0) >= size
            or surface.PLACES not in garment.data.attributes
        ):
            raise ValueError(f"{garment.name} is not as it was when it went live: open the character again")
    rig, skin = rig_of(armature), session.baked.skin
    evaluated = armature.evaluated_get(graph)
    worlds, scale = rig.worlds(np.array(evaluated.matrix_world, np.float64), poses_of(evaluated, rig.bones))
    turn = skin.axes[:3, :3] @ TO_Z_UP[:3, :3].T
    turn /= np.cbrt(np.linalg.det(turn))
    settings = armature.uvcloth
    gravity = np.array(scene.gravity if scene.use_gravity else (0.0, 0.0, 0.0)) * settings.gravity
    wind = np.array(settings.wind, np.float64)
    session.timeline.show(
        Moment(scene.frame_current, skin.transforms(worlds[None])[0], turn @ wind, turn @ gravity)
    )
    for index, (garment, source) in enumerate(zip(garments, sources, strict=True)):
        scene_places = session.baked.in_scene(session.cloth.vertices(index)[source])
        world = scale * scene_places @ TO_Z_UP[:3, :3].T
        back = np.linalg.inv(np.array(garment.evaluated_get(graph).matrix_world, np.float64))
        surface.move(garment, world @ back[:3, :3].T + back[:3, 3])


def rig_of(armature: Any) -> Rig:
    """The bones that a character keeps. Raises ValueError if one is gone."""
    entries = armature.uvcloth.bones
    names = tuple(entry.bone for entry in entries)
    for name in names:
        if name not in armature.pose.bones:
            raise ValueError(f"bone {name} of {armature.name} is gone: cloth cannot follow it")
    to_nodes = np.array([entry.to_node for entry in entries], np.float64).reshape(-1, 4, 4)
    return Rig(names, to_nodes, armature.uvcloth.size)


def poses_of(armature: Any, bones: tuple[str, ...]) -> Floats:
    """Transforms (J, 4, 4) of bones to an armature."""
    pose = armature.pose.bones
    return np.array([pose[name].matrix for name in bones], np.float64)


def refresh(scene: Any, graph: Any) -> None:
    """Move all live clothes to the scene's frame; faults are kept for the panel."""
    if scene.frame_subframe:
        return  # Cloth has whole frames; motion blur asks for what is between.
    for armature in characters():
        if armature.uvcloth.live:
            try:
                show(armature, scene, graph)
                FAULTS.pop(armature.session_uid, None)
            except (ValueError, OSError) as error:
                FAULTS[armature.session_uid] = str(error)


def change(armature: Any, context: Any) -> None:
    """Put cloth on a character's garments, or take it off, as its switch says; a fault switches it off."""
    settings = armature.uvcloth
    FAULTS.pop(armature.session_uid, None)
    parts = [entry.part for entry in settings.garments if entry.part is not None]
    if not settings.live:
        SESSIONS.pop(armature.session_uid, None)
        for garment in parts:
            surface.take_off(garment)
        return
    try:
        for garment in garments_of(armature):
            surface.put_on(garment)
        show(armature, context.scene, context.evaluated_depsgraph_get())
    except (ValueError, OSError) as error:
        settings.live = False
        FAULTS[armature.session_uid] = str(error)


@persistent
def _on_frame(scene: Any, graph: Any) -> None:
    refresh(scene, graph)


@persistent
def _on_load(_path: Any) -> None:
    SESSIONS.clear()
    FAULTS.clear()


@persistent
def _on_undo(scene: Any) -> None:
    refresh(scene, bpy.context.evaluated_depsgraph_get())


HANDLERS = {
    "frame_change_post": _on_frame,
    "load_post": _on_load,
    "undo_post": _on_undo,
    "redo_post": _on_undo,
}


def register() -> None:
    """Listen to Blender."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Stop listening."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    SESSIONS.clear()
    FAULTS.clear()
