"""Hanging a garment on a body at rest: rays along its normals, and the blend weights that carry it."""

import torch
from torch import Tensor

from rasterize.raycast import Hits, closest_points, garment_to_body
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Attachment, Garment
from uvcloth.mesh import Mesh, vertex_normals, weld
from uvcloth.skinning import diffuse_weights

REACH = 0.3
"""Metres from the garment within which a ray has to meet the body."""

DIFFUSION = {"tops": 0.06, "bottoms": 0.06, "dress": 0.15}
"""Metres over which blend weights spread; far enough in a skirt that left and right leg blend."""


def attach(mesh: Mesh, body: Body) -> Attachment:
    """Where each vertex of a garment at rest hangs on the body (PhysXNet section 4.3, T^XB).

    A ray runs along each vertex normal, both ways, to the nearest body point within REACH; a vertex whose
    ray misses, or that has no normal, takes the closest surface point and is marked as missed.
    """
    owner = weld(mesh.vertices)
    normals = vertex_normals(mesh.vertices, owner[mesh.faces])[owner]
    lonely = normals.norm(dim=1) < 0.5
    normals = torch.where(lonely[:, None], normals.new_tensor([0.0, 0.0, 1.0]), normals)
    hits = garment_to_body(mesh.vertices, normals, body.mesh.vertices, body.mesh.faces, REACH)
    missed = ~hits.found | lonely
    nearest = closest_points(mesh.vertices[missed], body.mesh.vertices, body.mesh.faces)
    hung = Hits(
        hits.face.masked_scatter(missed, nearest.face),
        hits.barycentrics.masked_scatter(missed[:, None], nearest.barycentrics),
        hits.distance.masked_scatter(missed, nearest.distance),
    )
    offset = mesh.vertices - hung.carry(body.mesh.vertices, body.mesh.faces)
    return Attachment(hung.face, hung.barycentrics, offset, missed)


def make_garment(name: str, template: str, mesh: Mesh, body: Body, diffusion: float | None = None) -> Garment:
    """A garment on a body, from its mesh (N vertices) at rest on the body's rest pose.

    diffusion: metres over which the carrier's blend weights spread; None takes the template's.
    """
    weights = body.weights[_closest_vertices(mesh.vertices, body.mesh.vertices)]
    distance = DIFFUSION[template] if diffusion is None else diffusion
    return Garment(
        name=name,
        template=template,
        mesh=mesh,
        attachment=attach(mesh, body),
        weights=weights,
        carrier_weights=_diffused(weights, mesh, distance),
    )


def _closest_vertices(points: Tensor, vertices: Tensor) -> Tensor:
    from scipy.spatial import KDTree

    _, nearest = KDTree(vertices.numpy()).query(points.numpy())
    return torch.from_numpy(nearest)


def _diffused(weights: Tensor, mesh: Mesh, distance: float) -> Tensor:
    owner = weld(mesh.vertices)
    moving = torch.nonzero(weights.any(dim=0)).squeeze(1)
    diffused = diffuse_weights(weights[:, moving], mesh.vertices, owner[mesh.faces], distance)
    return torch.zeros_like(weights).index_copy(1, moving, diffused[owner])
