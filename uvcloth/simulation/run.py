"""Simulation of garments over one motion, one alone or several together."""

from collections.abc import Callable, Sequence
from itertools import compress
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.opened import make_opening
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.garments.joined import EngineMesh
from uvcloth.geometry.mesh import join_meshes
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip import Clip
from uvcloth.motion.lead_in import LeadIn, lead_in
from uvcloth.physics.layer_thickness import outfit_thickness
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.simulation.engine import Engine, Scene
from uvcloth.simulation.unfinished import Place, move

RUN_UP = 15
"""Frames of the clip before a window that are simulated and not scored, while cloth forgets its start."""


def run_up(clip: Clip, start: int, frames: int) -> tuple[Clip, int]:
    """Cut a window from a clip with up to RUN_UP frames before it; returns their number too."""
    before = min(start, RUN_UP)
    return clip.window(start - before, frames + before), before


def simulate(
    clip: Clip,
    warm_up: int,
    cloths: Sequence[EngineMesh],
    body: Body,
    engine: Engine,
    parts: LeadIn,
    progress: Callable[[int], None] = lambda made: None,
    place: Place | None = None,
) -> SimulatedClip:
    """Simulate one garment or more, innermost first, from rest over a clip on the body's skeleton.

    warm_up: leading frames of the clip that are not scored (its run-up). parts: of the lead-in, which is
    added here. Several garments touch each other; the metadata then name the layers, and the percentage of
    each outer one's vertices that are on the wrong side of an inner one. progress: called with the number of
    frames so far. place: where these are kept, so that a later call can continue.
    """
    transforms = lead_in(clip, body, parts).transforms()
    references = [skin(c.garment.mesh.vertices, c.garment.smooth_weights, transforms) for c in cloths]
    scene = make_scene(cloths, references, transforms, body, clip.fps)
    made = move(engine, scene, place, progress)
    frames = len(made.vertices)
    shares = made.vertices.split([len(cloth.kept) for cloth in cloths], dim=1)
    vertices_of = [
        cloth.whole(share, skinned[:frames])
        for cloth, share, skinned in zip(cloths, shares, references, strict=True)
    ]
    warm_up += len(parts)
    scored = slice(warm_up, None if torch.isfinite(made.vertices[-1]).all() else -1)
    metadata: dict[str, Any] = {
        "clip": clip.name,
        "body": body.name,
        "body_hash": body.identity.shape,
        "seed": 0,
        "wall_seconds": round(made.seconds, 2),
        **engine.describe(),
    }
    if len(cloths) > 1:
        metadata["layers"] = [cloth.garment.name for cloth in cloths]
    garments = tuple(
        SimulatedGarment(
            name=cloth.garment.name,
            vertices=vertices,
            faces=cloth.garment.mesh.faces,
            rest=cloth.garment.mesh.vertices,
            metadata={
                "template": cloth.garment.template,
                "source": cloth.garment.source,
                **_sides(cloths[:index], [other[scored] for other in vertices_of], vertices[scored]),
            },
        )
        for index, (cloth, vertices) in enumerate(zip(cloths, vertices_of, strict=True))
    )
    return SimulatedClip(garments, transforms[:frames], clip.fps, warm_up, metadata)


def _sides(inner: Sequence[EngineMesh], inner_vertices: Sequence[Tensor], outer: Tensor) -> dict[str, Any]:
    """Metadata on a garment's vertices (F, N, 3) m over inner ones; none for the innermost."""
    if not inner:
        return {}
    sides = {
        cloth.garment.name: wrong_side_percent(outer, vertices, cloth.garment.mesh.faces)
        for cloth, vertices in zip(inner, inner_vertices, strict=False)
    }
    return {"wrong_side_percent": {name: round(share, 4) for name, share in sides.items()}}


def make_scene(
    cloths: Sequence[EngineMesh], references: Sequence[Tensor], transforms: Tensor, body: Body, fps: float
) -> Scene:
    """Make one scene of the cloths, one after another, with the opened parts that one may touch."""
    collider = make_collider(body)
    skinned = torch.cat([c[:, cloth.kept] for c, cloth in zip(references, cloths, strict=True)], dim=1)
    bands = [cloth.band.vertices[cloth.kept] for cloth in cloths]
    outfit = join_meshes((cloth.garment.mesh.vertices[cloth.kept], cloth.faces) for cloth in cloths)
    touches = collider.touches(outfit.vertices, body.mesh.vertices, outfit.faces)
    met = touches.any(1)
    opening = make_opening(collider.for_cloth(met), body.mesh.vertices)
    return Scene(
        rest=skinned[0],
        faces=outfit.faces,
        band=torch.cat(bands),
        mass_factor=torch.cat(
            [torch.where(band, cloth.band.mass, 1.0) for band, cloth in zip(bands, cloths, strict=True)]
        ),
        inner_thickness=outfit_thickness(
            [cloth.garment.mesh.vertices[cloth.kept] for cloth in cloths],
            [(cloth.garment.mesh.vertices, cloth.garment.mesh.faces) for cloth in cloths],
        ),
        skinned=skinned,
        collider=opening.opened(collider.vertices(posed_skin(body, transforms))),
        collider_parts=tuple(compress(collider.parts, met)),
        touches=touches[met],
        fps=fps,
    )
