"""Scores of a garment against the body under it: vertices and faces inside, skin that shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.geometry.mesh import Mesh, join_meshes
from uvcloth.physics.exposure import CLOTH_POINTS, Exposure, SurfaceSample, covered_skin, spread
from uvcloth.physics.obstacle import ContactGarment, Obstacle

from .metrics import sampled_frames
from .pixels import Sight, make_sight, pixel_scores


@dataclass(frozen=True)
class DressedBody:
    """A garment, or several as one mesh, on a body.

    garment: its vertices, prepared for contact. sample: points spread over its faces. with_sample: its
    vertices and then these points, prepared for contact. exposure: of the skin that it covers. sight: all of
    it in pictures.
    """

    obstacle: Obstacle
    garment: ContactGarment
    sample: SurfaceSample
    with_sample: ContactGarment
    exposure: Exposure
    sight: Sight


def dressed_body(body: Body, meshes: Sequence[Mesh]) -> DressedBody:
    """A garment, or several as one mesh, as they lie on a body at rest."""
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    outfit = join_meshes((mesh.vertices, mesh.faces) for mesh in meshes)
    sample = spread(outfit.vertices, outfit.faces, CLOTH_POINTS)
    points = torch.cat([outfit.vertices, sample.points(outfit.vertices)])
    return DressedBody(
        obstacle=obstacle,
        garment=obstacle.contact_garment(outfit.vertices),
        sample=sample,
        with_sample=obstacle.contact_garment(points),
        exposure=Exposure(body, meshes),
        sight=make_sight(body, meshes, covered_skin(body, meshes)),
    )


def body_scores(dressed: DressedBody, frames: Tensor, body_frames: Tensor) -> dict[str, Tensor]:
    """Percentages of a garment (F, N, 3) on the posed body (F, V, 3), m, in `sampled_frames`: (S,) each.

    inside_percent: vertices inside the body. squeezed_percent: vertices between two parts of it that leave no
    room; they do not count as inside. inside_faces_percent: the cloth's area inside the body. skin_percent:
    of the skin that the garment covers at rest, the area that shows through it. Those of `pixel_scores`, in
    fewer frames.
    """
    some = sampled_frames(len(frames))
    frames, body_frames = frames[some], body_frames[some]
    points = torch.cat([frames, dressed.sample.points(frames)], dim=1)
    skins = list(dressed.obstacle.skins(points, dressed.with_sample, body_frames))
    inside, squeezed = (
        torch.stack([getattr(skin, which) for skin in skins]) for which in ("inside", "squeezed")
    )
    count = frames.shape[1]
    exposed = [
        dressed.exposure.percent([vertices], posed)
        for vertices, posed in zip(frames, body_frames, strict=True)
    ]
    return {
        "inside_percent": 100.0 * inside[:, :count].float().mean(1),
        "squeezed_percent": 100.0 * squeezed[:, :count].float().mean(1),
        "inside_faces_percent": 100.0 * inside[:, count:].float().mean(1),
        "skin_percent": torch.tensor(exposed),
        **pixel_scores(dressed.sight, frames, body_frames),
    }
