"""Parts of garments, so that a test computes little."""

from dataclasses import replace

from uvcloth.garments.garment import Garment


def cropped(garment: Garment, low: float, high: float) -> Garment:
    """The part of a garment between two heights, m."""
    heights = garment.mesh.vertices[garment.mesh.faces][..., 2]
    kept = ((heights > low) & (heights < high)).all(1)
    rows, faces = garment.mesh.faces[kept].unique(return_inverse=True)
    mesh = replace(
        garment.mesh,
        vertices=garment.mesh.vertices[rows],
        faces=faces,
        face_uvs=garment.mesh.face_uvs[kept],
    )
    return replace(
        garment,
        name=f"part of {garment.name}",
        mesh=mesh,
        weights=garment.weights[rows],
        smooth_weights=garment.smooth_weights[rows],
    )
