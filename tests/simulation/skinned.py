"""Sequences without an engine: garments that are simply skinned."""

from uvcloth.bodies.body import Body
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment
from uvcloth.garments.garment import Garment
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip


def skinned_sequence(garment: Garment, body: Body) -> SimulatedClip:
    """Four frames of the built-in walk, of which the first does not count: a small motion."""
    transforms = load_clip("walk", body).transforms()[:4]
    return clip_of_garment(
        vertices=skin(garment.mesh.vertices, garment.smooth_weights, transforms),
        faces=garment.mesh.faces,
        rest=garment.mesh.vertices,
        transforms=transforms,
        fps=30.0,
        warm_up=1,
        metadata={"clip": "walk", "garment": garment.name, "body": body.name},
    )
