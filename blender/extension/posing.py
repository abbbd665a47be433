"""Cloth that goes on while the timeline stands and an armature is posed by hand; off by default."""

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

from . import live

SETTLING = 2.0
"""Seconds that cloth goes on after the last change of the pose."""

IDLE = 0.25
"""Seconds from one look to the next while nothing follows."""

STILL = 1e-6
"""Difference of joints, m, below which a pose is the same."""


@dataclass(frozen=True)
class Stand:
    """A pose that an armature has at a frame while the timeline stands, and steps since it came to it."""

    frame: int
    joints: NDArray[np.float64]
    steps: int


STANDS: dict[int, Stand] = {}
"""Poses by the armature's session_uid."""


@persistent
def follow() -> float:
    """Move the cloth of armatures that are posed by hand one frame on; returns seconds to the next look."""
    context = bpy.context
    scene = context.scene
    is_playing = any(window.screen.is_animation_playing for window in context.window_manager.windows)
    followed = False
    for armature in live.characters():
        if is_playing or not (armature.uvcloth.live and armature.uvcloth.posing):
            STANDS.pop(armature.session_uid, None)
        elif step(armature, scene, context.evaluated_depsgraph_get()):
            followed = True
    return scene.render.fps_base / scene.render.fps if followed else IDLE


def step(armature: Any, scene: Any, graph: Any) -> bool:
    """Move the cloth of an armature one frame on, unless it has come to rest in a pose that stays.

    The pose of the frame itself is left as it was played until it is changed. Tells whether it moved it.
    """
    key = armature.session_uid
    try:
        moment, scale = live.moment_of(armature, scene, graph)
        joints = moment.joints
        before = STANDS.get(key)
        if before is None or before.frame != scene.frame_current:
            STANDS[key] = Stand(scene.frame_current, joints, _settled(scene))
            return False
        is_same = bool(np.abs(joints - before.joints).max() < STILL)
        steps = before.steps + 1 if is_same else 0
        STANDS[key] = Stand(scene.frame_current, joints, min(steps, _settled(scene)))
        if steps >= _settled(scene):
            return False
        live.follow(armature, scene, graph, moment, scale)
    except (ValueError, OSError) as error:
        live.FAULTS[key] = str(error)
        return False
    live.FAULTS.pop(key, None)
    return True


def _settled(scene: Any) -> int:
    """Steps after which cloth has come to rest."""
    return round(SETTLING * scene.render.fps / scene.render.fps_base)


def register() -> None:
    """Begin to look."""
    bpy.app.timers.register(follow, first_interval=IDLE, persistent=True)


def unregister() -> None:
    """Stop it."""
    STANDS.clear()
    if bpy.app.timers.is_registered(follow):
        bpy.app.timers.unregister(follow)
