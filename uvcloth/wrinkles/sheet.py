"""A garment on its own UV sheet: strain, bending and tangents of its smooth surface at texels, and back."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.sparse import coo_array
from torch import Tensor

from rasterize.bake import scatter_map
from rasterize.decode import Sampler, sample_points
from rasterize.gather import gather
from rasterize.layout import layout_of_uvs
from rasterize.texels import Texels, rasterize_layout
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.refined import Refined
from uvcloth.geometry.mesh import Mesh, WeldedMesh, face_normals, vertex_normals, welded
from uvcloth.wrinkles.seams import SeamPadding, seam_padding

FEWEST_TEXELS = 4
"""Texels of the smallest chart on which wrinkles can lie."""


@dataclass(frozen=True)
class Forms:
    """Fundamental forms of a surface, (..., P, 3) each, as entries 00, 11, 01 on the sheet's axes.

    strain: of the first one, minus the unit matrix. bend: 1/m, of the second one, minus that at rest.
    """

    strain: Tensor
    bend: Tensor


@dataclass(frozen=True)
class Sheet:
    """A garment, and its refined mesh, on its UV layout.

    size: H = W. mesh: the garment's, welded: U points. refined: of the garment. texels: P of them. inverse:
    (M, 4) 1/m, entries 00, 01, 10, 11 of the inverse of the rest edges in axes along u and v. average: sparse
    (P, M), faces around each texel in its chart. sides: (P,) +1 where u, v and the outward normal are
    right-handed, or -1. rest_bend: (P, 3) 1/m. sampler: of the vertices of the refined mesh. padding: across
    seams.
    """

    size: int
    mesh: WeldedMesh
    refined: Refined
    texels: Texels
    inverse: Tensor
    average: Tensor
    sides: Tensor
    rest_bend: Tensor
    sampler: Sampler
    padding: SeamPadding

    @classmethod
    def of(cls, garment: Garment, size: int) -> "Sheet":
        """Lay a garment out, H = W = size texels.

        Raises InputError for a garment without texture coordinates, and for one with a chart of fewer than
        FEWEST_TEXELS texels.
        """
        mesh = garment.mesh
        if not len(mesh.uvs):
            raise InputError(f"garment {garment.name}: has no texture coordinates, on which wrinkles lie")
        joined = welded(mesh.vertices, mesh.faces)
        layout = layout_of_uvs(mesh.uvs, mesh.face_uvs)
        texels = rasterize_layout(layout, size)
        charts = int(layout.islands.max()) + 1
        small = int((torch.bincount(texels.islands, minlength=charts) < FEWEST_TEXELS).sum())
        if small:
            raise InputError(
                f"garment {garment.name}: {small} of the {charts} charts of its texture coordinates have "
                f"fewer than {FEWEST_TEXELS} texels at {size} x {size}, wrinkles need more"
            )
        inverse, sides = _rest_axes(joined, mesh)
        refined = Refined.of(mesh)
        face, barycentrics = _refined_places(joined, refined)
        flat = cls(
            size=size,
            mesh=joined,
            refined=refined,
            texels=texels,
            inverse=inverse,
            average=_average(joined, mesh, texels),
            sides=sides[texels.face],
            rest_bend=torch.zeros(len(texels), 3),
            sampler=sample_points(layout, texels, joined.faces, face, barycentrics),
            padding=seam_padding(layout, joined.faces, texels),
        )
        return replace(flat, rest_bend=flat.forms(joined.points)[0].bend)

    def forms(self, points: Tensor) -> tuple[Forms, Tensor]:
        """Forms at the texels of the garment at points (U, 3) m, and tangents along u and v: (P, 3, 2), unit.

        The tangents are right-angled, and turned from the surface's own axes as little as can be (polar
        decomposition).
        """
        faces = self.mesh.faces
        values = torch.cat([points, vertex_normals(points, faces)], dim=1)
        first = values[faces[:, 0]]
        one, two = values[faces[:, 1]] - first, values[faces[:, 2]] - first
        i00, i01, i10, i11 = self.inverse[..., None].unbind(1)
        along_u, along_v = one * i00 + two * i10, one * i01 + two * i11
        u, v = along_u[:, :3], along_v[:, :3]
        normal_u, normal_v = along_u[:, 3:], along_v[:, 3:]

        def dots(a: Tensor, b: Tensor) -> Tensor:
            return (a * b).sum(1)

        per_face = torch.stack(
            [
                dots(u, u) - 1.0,
                dots(v, v) - 1.0,
                dots(u, v),
                -dots(u, normal_u),
                -dots(v, normal_v),
                -0.5 * (dots(u, normal_v) + dots(v, normal_u)),
                *u.unbind(1),
                *v.unbind(1),
            ],
            dim=1,
        )
        at_texels = self.average @ per_face
        slopes = torch.stack([at_texels[:, 6:9], at_texels[:, 9:]], dim=2)
        return Forms(at_texels[:, :3], at_texels[:, 3:6] - self.rest_bend), right_angled(slopes)

    def axes(self, tangents: Tensor) -> Tensor:
        """Axes (P, 3, 3), in columns: tangents (P, 3, 2) along u and v, and the outward normal."""
        normal = torch.linalg.cross(tangents[..., 0], tangents[..., 1]) * self.sides[:, None]
        return torch.cat([tangents, normal[..., None]], dim=-1)

    def at_texels(self, values: Tensor) -> Tensor:
        """Values (..., P, C) at the texels from values (..., U, C) at the welded garment's points."""
        return gather(values, self.mesh.faces[self.texels.face], self.texels.barycentrics)

    def at_vertices(self, values: Tensor) -> Tensor:
        """Values (..., P', C) at the refined mesh's vertices from values at the texels, the same on both
        sides of a seam.
        """
        sheet = scatter_map(values, self.texels).flatten(-2).transpose(-1, -2)
        return gather(sheet, self.sampler.pixels, self.sampler.weights)

    def padded(self, maps: Tensor, tensors: tuple[slice, ...], vectors: tuple[slice, ...]) -> Tensor:
        """Maps (..., C, H, W) with the pixels beside charts filled across seams.

        tensors: channels of entries 00, 11, 01; vectors: channels of u and v, which turn with the sheet.
        """
        flat = maps.flatten(-2)
        filled = flat[..., self.padding.sources].clone()
        (xx, xy), (yx, yy) = ((row[:, 0], row[:, 1]) for row in self.padding.turns.unbind(1))
        for part in vectors:
            u, v = filled[..., part, :].unbind(-2)
            filled[..., part, :] = torch.stack([xx * u + xy * v, yx * u + yy * v], dim=-2)
        for part in tensors:
            uu, vv, uv = filled[..., part, :].unbind(-2)
            filled[..., part, :] = torch.stack(
                [
                    xx * xx * uu + xy * xy * vv + 2.0 * xx * xy * uv,
                    yx * yx * uu + yy * yy * vv + 2.0 * yx * yy * uv,
                    xx * yx * uu + xy * yy * vv + (xx * yy + xy * yx) * uv,
                ],
                dim=-2,
            )
        return flat.index_copy(-1, self.padding.pixels, filled).view_as(maps)


def right_angled(slopes: Tensor) -> Tensor:
    """Right-angled unit columns that are nearest to (..., 3, 2): F (F^T F)^(-1/2)."""
    u, v = slopes.unbind(-1)
    a, b, c = ((one * other).sum(-1, keepdim=True) for one, other in ((u, u), (u, v), (v, v)))
    # The root of a symmetric 2 x 2 matrix M is (M + root(det M)) / root(tr M + 2 root(det M)).
    root = (a * c - b * b).clamp(min=1e-12).sqrt()
    scale = 1.0 / (root * (a + c + 2.0 * root).clamp(min=1e-12).sqrt())
    return torch.stack([(u * (c + root) - v * b) * scale, (v * (a + root) - u * b) * scale], dim=-1)


def _rest_axes(joined: WeldedMesh, mesh: Mesh) -> tuple[Tensor, Tensor]:
    """Inverse (M, 4) 1/m of the rest edges in axes along u and v, and the sides (M,) of the faces."""
    points, uvs = joined.points[joined.faces].double(), mesh.uvs[mesh.face_uvs].double()
    edges = torch.stack([points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], 2)
    on_sheet = torch.stack([uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]], 2)
    area = torch.linalg.det(on_sheet)
    # A face without an area on the sheet has no texel; any axes do.
    flat = area.abs() < 1e-12
    slopes = edges @ torch.linalg.inv(torch.where(flat[:, None, None], torch.eye(2).double(), on_sheet))
    inverse = torch.linalg.pinv(right_angled(slopes).mT @ edges, rtol=1e-6)
    return inverse.flatten(1).float(), torch.where(area < 0, -1.0, 1.0).float()


def _average(joined: WeldedMesh, mesh: Mesh, texels: Texels) -> Tensor:
    """Sparse (P, M): the mean of the faces around each corner of a texel's face in its chart, by area."""
    count, faces = len(mesh.uvs), len(mesh.faces)
    areas = face_normals(joined.points, joined.faces).norm(dim=1).double().numpy()
    corner, owner = mesh.face_uvs.flatten().numpy(), np.repeat(np.arange(faces), 3)
    around = coo_array((areas[owner], (corner, owner)), shape=(count, faces)).tocsr()
    sums = np.maximum(np.asarray(around.sum(1)).ravel(), 1e-300)
    rows = np.repeat(np.arange(len(texels)), 3)
    columns = mesh.face_uvs[texels.face].flatten().numpy()
    shares = texels.barycentrics.double().flatten().numpy() / sums[columns]
    product = (coo_array((shares, (rows, columns)), shape=(len(texels), count)).tocsr() @ around).tocsr()
    return torch.sparse_csr_tensor(
        torch.from_numpy(product.indptr.astype(np.int64)),
        torch.from_numpy(product.indices.astype(np.int64)),
        torch.from_numpy(product.data).float(),
        size=product.shape,
        check_invariants=False,
    )


def _refined_places(joined: WeldedMesh, refined: Refined) -> tuple[Tensor, Tensor]:
    """Face (n,) of the garment that each vertex of its refined mesh lies on, and barycentrics (n, 3) there.

    Vertices lie at corners or, those that halve edges, in the middle of edges.
    """
    # Of the four faces of each the last is in the middle: its corners halve the edges 0-1, 1-2 and 2-0.
    places = torch.cat([joined.faces, refined.mesh.faces.view(-1, 4, 3)[:, 3]], dim=1)
    slot = torch.zeros(len(refined.mesh.vertices), dtype=torch.int64)
    slot[places.flatten()] = torch.arange(places.numel())
    halves = torch.tensor([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
    return slot // 6, torch.cat([torch.eye(3), halves])[slot % 6]
