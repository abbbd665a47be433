"""Simulate one garment over one motion."""

import time
from collections.abc import Callable
from typing import Any

import torch

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.garments.garment import Garment
from uvcloth.garments.templates import load_template
from uvcloth.motion.clip import Clip
from uvcloth.simulate.engine import Engine, Scene
from uvcloth.simulate.lead_in import LeadIn, lead_in
from uvcloth.simulate.sequence import Sequence
from uvcloth.skinning import skin

BAND_MASS = {"tops": 11.0, "bottoms": 31.0, "dress": 11.0}
"""How many times heavier the holding band is, so that it can carry the rest; its own weight is cancelled."""

RUN_UP = 15
"""Frames of the clip before a window that are played, not counted: how long cloth remembers its start."""


def run_up(clip: Clip, start: int, frames: int, earlier: int = 0) -> tuple[Clip, int]:
    """A window of a clip with up to RUN_UP + earlier of the frames before it; returns how many those are."""
    before = min(start, RUN_UP + earlier)
    return clip.window(start - before, frames + before), before


def simulate(
    clip: Clip,
    settling: int,
    garment: Garment,
    body: Body,
    engine: Engine,
    parts: LeadIn,
    progress: Callable[[int], None] = lambda frames: None,
) -> Sequence:
    """Play a clip (already on the body's skeleton) under a template garment, starting from rest.

    settling: leading frames of the clip that do not count (its run-up). The lead-in is added here.
    """
    started = time.perf_counter()
    motion = lead_in(clip, body, parts)
    transforms = motion.transforms()
    collider = make_collider(body)
    carrier = skin(garment.mesh.vertices, garment.carrier_weights, transforms)
    scene = Scene(
        rest=carrier[0],
        faces=garment.mesh.faces,
        band=load_template(garment.template).band,
        band_mass=BAND_MASS[garment.template],
        carrier=carrier,
        collider=collider.vertices(skin(body.mesh.vertices, body.weights, transforms)),
        collider_parts=collider.parts,
        touches=collider.touches(garment.mesh.vertices, body.mesh.vertices),
        fps=clip.fps,
    )
    frames = []
    for vertices in engine.simulate(scene):
        frames.append(vertices)
        progress(1)
        if not torch.isfinite(vertices).all():
            break
    metadata: dict[str, Any] = {
        "clip": clip.name,
        "garment": garment.template,
        "body": body.name,
        "seed": 0,
        "wall_seconds": round(time.perf_counter() - started, 2),
        **engine.describe(),
    }
    return Sequence(
        vertices=torch.stack(frames),
        faces=garment.mesh.faces,
        rest=garment.mesh.vertices,
        transforms=transforms[: len(frames)],
        fps=clip.fps,
        settling=len(parts) + settling,
        metadata=metadata,
    )
