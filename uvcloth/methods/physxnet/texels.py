"""Texels and the points of body and template that they see: the paper's T^UB, T^BC and T^XB (section 4).

Everything here depends only on shapes at rest. It is made once per body (ray casting) and is plain tensors
afterwards, so that training on another machine needs neither rays nor meshes.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.bake import bake
from rasterize.decode import nearest_sampler
from rasterize.gather import gather
from rasterize.raycast import body_to_garment
from rasterize.sheet import GARMENT_RAY_LENGTH
from rasterize.texels import Texels, rasterize_layout
from uvcloth.bodies.body import Body
from uvcloth.bodies.joined_legs import joined_rays, leg_faces, leg_slices
from uvcloth.bodies.layout import layout_of
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import Mesh, vertex_normals, weld

SKIRT_REACH = 0.6
"""Metres within which rays from the joined legs may meet cloth; for others GARMENT_RAY_LENGTH."""

SKIRTS = ("dress", "skirt")
"""Templates whose lower part is seen from the joined legs."""


@dataclass(frozen=True)
class BodyTexels:
    """T^UB: the P texels of a sheet that see the body.

    corners: (P, 3) int64 body vertices around each. points: (P, 3) at rest, m. weights: (P, J) blend weights.
    """

    sheet: Texels
    corners: Tensor
    points: Tensor
    weights: Tensor

    def gather(self, vertices: Tensor) -> Tensor:
        """Values of body vertices (..., V, C) at the texels: (..., P, C)."""
        return gather(vertices, self.corners, self.sheet.barycentrics)


@dataclass(frozen=True)
class TemplateTexels:
    """T^BC: the Q texels that see a template.

    texels: (Q,) int64 into the body's P texels, ascending; pixels: (Q,) the same into the flattened sheet.
    corners: (Q, 3) int64 template vertices and barycentrics: (Q, 3) of the point that each sees.
    points, normals: (Q, 3) of that point at rest, m.
    """

    texels: Tensor
    pixels: Tensor
    corners: Tensor
    barycentrics: Tensor
    points: Tensor
    normals: Tensor

    def gather(self, vertices: Tensor) -> Tensor:
        """Values of template vertices (..., N, C) at the texels: (..., Q, C)."""
        return gather(vertices, self.corners, self.barycentrics)


@dataclass(frozen=True)
class GarmentDecoder:
    """A garment that is decoded from a template's texels (T^XB).

    samples: (N, S) int64 into the template's Q texels, shares: (N, S) their weights.
    points: (N, 3) garment vertices at rest, m. residual: (N, 3) what they lie beside the sampled template
    points at rest, m: a garment's own style. weights, smooth_weights: (N, J) as in Garment.
    """

    samples: Tensor
    shares: Tensor
    points: Tensor
    residual: Tensor
    weights: Tensor
    smooth_weights: Tensor

    def sample(self, values: Tensor) -> Tensor:
        """Values at the template's texels (..., Q, C) -> at the garment's vertices (..., N, C)."""
        return gather(values, self.samples, self.shares)


def body_texels(body: Body, size: int) -> BodyTexels:
    """The body's texels on a size x size sheet of its UV layout."""
    sheet = rasterize_layout(layout_of(body), size)
    return BodyTexels(
        sheet=sheet,
        corners=body.mesh.faces[sheet.face],
        points=bake(body.mesh.vertices, body.mesh.faces, sheet),
        weights=bake(body.weights, body.mesh.faces, sheet),
    )


def template_texels(template: str | None, mesh: Mesh, body: Body, texels: BodyTexels) -> TemplateTexels:
    """Cast a ray from every texel along the body's normal, or out of the joined legs under a skirt.

    A texel whose ray misses, or meets the cloth from outside (it then covers another limb), sees no template.
    template: whose rays serve the mesh, None where none does. Raises InputError if no texel sees it.
    """
    face = texels.sheet.face
    origins = texels.points
    directions = texels.gather(vertex_normals(body.mesh.vertices, body.mesh.faces))
    reach = torch.full((len(origins),), GARMENT_RAY_LENGTH)
    if template in SKIRTS:
        legs = leg_faces(body)[face]
        around = texels.sheet.uvs[legs, 0]
        origins, directions = origins.clone(), directions.clone()
        origins[legs], directions[legs] = joined_rays(
            leg_slices(body), texels.points[legs], body.sides[face[legs]], around
        )
        reach = torch.where(legs, SKIRT_REACH, reach)
    hits = body_to_garment(origins, directions, mesh.vertices, mesh.faces, SKIRT_REACH)
    rows = torch.nonzero(hits.distance <= reach).squeeze(1)
    if not len(rows):
        raise InputError(f"template {template}: no ray from a texel of body {body.name!r} meets it")
    corners, barycentrics = mesh.faces[hits.face[rows]], hits.barycentrics[rows]
    return TemplateTexels(
        texels=rows,
        pixels=texels.sheet.pixels[rows],
        corners=corners,
        barycentrics=barycentrics,
        points=gather(mesh.vertices, corners, barycentrics),
        normals=gather(vertex_normals(mesh.vertices, mesh.faces), corners, barycentrics),
    )


def build_decoder(garment: Garment, template: TemplateTexels, texels: BodyTexels) -> GarmentDecoder:
    """Decode a garment from the texels whose template points lie nearest to its vertices at rest.

    Nearest on the template and not on the body, so that a skirt's vertex is never torn between two legs.
    """
    missed = torch.full_like(texels.points, torch.nan)
    points, normals = missed.clone(), missed
    points[template.texels], normals[template.texels] = template.points, template.normals
    vertices = garment.mesh.vertices
    # Vertices at one place (UV seams) have one normal, or they would come apart.
    owner = weld(vertices)
    facing = (normals, vertex_normals(vertices, owner[garment.mesh.faces])[owner])
    sampler = nearest_sampler(points, texels.sheet, vertices, normals=facing)
    samples = torch.searchsorted(template.pixels, sampler.pixels)
    shares = sampler.weights
    return GarmentDecoder(
        samples=samples,
        shares=shares,
        points=vertices,
        residual=vertices - gather(template.points, samples, shares),
        weights=garment.weights,
        smooth_weights=garment.smooth_weights,
    )
