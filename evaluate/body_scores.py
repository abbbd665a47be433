"""How a garment and the body under it get along, per frame: by vertices, by faces, by what shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.geometry.mesh import Mesh, join_meshes
from uvcloth.physics.contact import ContactGarment, Obstacle
from uvcloth.physics.exposure import CLOTH_POINTS, Exposure, SurfaceSample, spread


@dataclass(frozen=True)
class DressedBody:
    """A garment, or several as one mesh, on a body.

    dressed: its vertices, as contact meets them. sample: points spread over its faces, and loose: they as
    contact meets them. exposure: of the skin that it covers.
    """

    obstacle: Obstacle
    dressed: ContactGarment
    sample: SurfaceSample
    loose: ContactGarment
    exposure: Exposure


def put_on(body: Body, meshes: Sequence[Mesh]) -> DressedBody:
    """A garment, or several as one mesh, as they lie on a body at rest."""
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    outfit = join_meshes((mesh.vertices, mesh.faces) for mesh in meshes)
    sample = spread(outfit.vertices, outfit.faces, CLOTH_POINTS)
    return DressedBody(
        obstacle=obstacle,
        dressed=obstacle.dress(outfit.vertices, outfit.faces),
        sample=sample,
        loose=obstacle.dress(sample.points(outfit.vertices), outfit.faces[:0]),
        exposure=Exposure(body, meshes),
    )


def body_scores(worn: DressedBody, frames: Tensor, body_frames: Tensor) -> dict[str, Tensor]:
    """Percentages of a garment (F, N, 3) on the posed body (F, V, 3), m, per frame: (F,) each.

    inside_percent, squeezed_percent: vertices inside the body, and those between two parts of it that leave
    them no room, which do not count as inside. inside_faces_percent: of the cloth's area inside the body.
    skin_percent: of the skin that the garment covers at rest, by area, what shows through it.
    """
    skins = list(worn.obstacle.skins(frames, worn.dressed, body_frames))
    points = worn.sample.points(frames)
    exposed = [
        worn.exposure.percent([vertices], posed) for vertices, posed in zip(frames, body_frames, strict=True)
    ]
    return {
        "inside_percent": torch.tensor([100.0 * float(skin.inside.float().mean()) for skin in skins]),
        "squeezed_percent": torch.tensor([100.0 * float(skin.squeezed.float().mean()) for skin in skins]),
        "inside_faces_percent": worn.obstacle.inside_percent(points, worn.loose, body_frames),
        "skin_percent": torch.tensor(exposed),
    }
