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
from .finer import shown
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
    """Armatures with garments."""
    for armature in bpy.data.objects:
        if armature.type == "ARMATURE" and armature.uvcloth.garments:
            yield armature


def garments_of(armature: Any) -> dict[int, Any]:
    """Objects of a character's garments by their places in its file. Raises ValueError if one is gone."""
    baked = {entry.row: shown(entry) for entry in armature.uvcloth.garments if entry.row >= 0}
    if not baked or not all(part is not None and part.type == "MESH" for part in baked.values()):
        raise ValueError(f"a garment of {armature.name} is gone: take it off, or open the character again")
    return baked


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
    """Move the garments of a character to the scene's frame, or after it as motion blur asks.

    Raises ValueError; they stay as they were then.

    graph: evaluated at this frame.
    """
    session, garments = session_of(armature, scene), sourced_garments(armature, scene)
    moment, scale = moment_of(armature, scene, graph)
    if scene.frame_subframe:
        session.timeline.between(moment, scene.frame_subframe)
    else:
        session.timeline.show(moment)
    _move(session, garments, scale, graph)


def follow(armature: Any, scene: Any, graph: Any, moment: Moment, scale: float) -> None:
    """Move the garments of a character one frame on, towards a moment of `moment_of`. Raises ValueError."""
    session, garments = session_of(armature, scene), sourced_garments(armature, scene)
    session.timeline.pose(moment, scene.render.fps_base / scene.render.fps)
    _move(session, garments, scale, graph)


def sourced_garments(armature: Any, scene: Any) -> list[tuple[int, Any, NDArray[np.int32]]]:
    """Garments of a character: their places in the file, their objects, and the runtime's vertices of these.

    Raises ValueError for one that has changed since it went live.
    """
    sizes = session_of(armature, scene).outfit.garments
    garments = [(row, part, surface.source_of(part)) for row, part in garments_of(armature).items()]
    for row, garment, source in garments:
        if (
            row >= len(sizes)
            or source.min(initial=0) < 0
            or source.max(initial=0) >= sizes[row]
            or surface.PLACES not in garment.data.attributes
        ):
            raise ValueError(
                f"{garment.name} is not as it was when it went live: dress or open the character again"
            )
    return garments


def moment_of(armature: Any, scene: Any, graph: Any) -> tuple[Moment, float]:
    """What moves cloth to the scene's frame, and how often the armature is its size. Raises ValueError."""
    rig, skin = rig_of(armature), session_of(armature, scene).baked.skin
    if len(rig.bones) != len(skin.nodes):
        raise ValueError(
            f"{armature.uvcloth.file} is of another skeleton than {armature.name}: dress or open the "
            "character again"
        )
    evaluated = armature.evaluated_get(graph)
    worlds, scale = rig.worlds(np.array(evaluated.matrix_world, np.float64), poses_of(evaluated, rig.bones))
    turn = skin.axes[:3, :3] @ TO_Z_UP[:3, :3].T
    turn /= np.cbrt(np.linalg.det(turn))
    settings = armature.uvcloth
    gravity = np.array(scene.gravity if scene.use_gravity else (0.0, 0.0, 0.0)) * settings.gravity
    wind = np.array(settings.wind, np.float64)
    joints = skin.transforms(worlds[None])[0]
    return Moment(scene.frame_current, joints, turn @ wind, turn @ gravity), scale


def _move(
    session: Session, garments: list[tuple[int, Any, NDArray[np.int32]]], scale: float, graph: Any
) -> None:
    """Move garments to where the cloth is."""
    for row, garment, source in garments:
        scene_places = session.baked.in_scene(session.cloth.vertices(row)[source])
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
    parts = [shown(entry) for entry in settings.garments if shown(entry) is not None]
    if not settings.live:
        SESSIONS.pop(armature.session_uid, None)
        for garment in parts:
            surface.take_off(garment)
        return
    try:
        for garment in garments_of(armature).values():
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
