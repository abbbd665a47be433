"""Sequences without an engine: garments that are simply skinned."""

from uvcloth.bodies.body import Body
from uvcloth.dataset.sequence import SimulatedSequence
from uvcloth.garments.garment import Garment
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip


def skinned_sequence(garment: Garment, body: Body) -> SimulatedSequence:
    """Four frames of the built-in walk, of which the first does not count: a small motion."""
    transforms = load_clip("walk", body).transforms()[:4]
    return SimulatedSequence(
        vertices=skin(garment.mesh.vertices, garment.smooth_weights, transforms),
        faces=garment.mesh.faces,
        rest=garment.mesh.vertices,
        transforms=transforms,
        fps=30.0,
        warm_up=1,
        metadata={"clip": "walk", "garment": garment.name, "body": body.name},
    )
