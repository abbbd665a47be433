"""A garment on its own UV sheet: strain, bending and tangents of its smooth surface at texels, and back."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.sparse import coo_array, csr_array, vstack
from torch import Tensor

from rasterize.decode import sample_points
from rasterize.gather import gather
from rasterize.layout import layout_of_uvs
from rasterize.texels import Texels, rasterize_layout
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.refined import Refined
from uvcloth.geometry.mesh import Mesh, WeldedMesh, face_normals, first_of, vertex_normals, welded
from uvcloth.wrinkles.seams import SeamPadding, seam_padding

FEWEST_TEXELS = 4
"""Texels of the smallest chart on which wrinkles can lie."""

MOST_VERTICES = 4
"""Vertices of the refined mesh for each texel of displacements at most: edges of half a texel."""


@dataclass(frozen=True)
class Sheet:
    """A garment, and its refined mesh, on its UV layout.

    Inputs are at texels of half the size, P of them; displacements at the four quarters of each. mesh: the
    garment's, welded: U points. refined: of the garment. texels: those of the inputs. quarters: (P, 4, 3) m,
    a place at rest for each. places: sparse (P, U), the texels' places. slopes: sparse (2 P, U) 1/m,
    derivatives along u, then along v, at rest right-angled, the mean of the faces around each texel in its
    chart. sides: (P,) +1 where u, v and the outward normal are right-handed, or -1. rest_bend: (P, 3) 1/m.
    back: sparse (n, 4 P), the vertices of the refined mesh from the quarters. padding: across seams.
    """

    size: int
    mesh: WeldedMesh
    refined: Refined
    texels: Texels
    quarters: Tensor
    places: Tensor
    slopes: Tensor
    sides: Tensor
    rest_bend: Tensor
    back: Tensor
    padding: SeamPadding

    @classmethod
    def of(cls, garment: Garment, size: int) -> "Sheet":
        """Lay a garment out; displacements are on H = W = size texels, inputs on half as many each way.

        Raises InputError for a garment without texture coordinates, for one with a chart of fewer than
        FEWEST_TEXELS texels, and for one with more than MOST_VERTICES vertices for each texel.
        """
        mesh = garment.mesh
        if not len(mesh.uvs):
            raise InputError(f"garment {garment.name}: has no texture coordinates, on which wrinkles lie")
        joined = welded(mesh.vertices, mesh.faces)
        layout = layout_of_uvs(mesh.uvs, mesh.face_uvs)
        fine = rasterize_layout(layout, size)
        charts = int(layout.islands.max()) + 1
        small = int((torch.bincount(fine.islands, minlength=charts) < FEWEST_TEXELS).sum())
        if small:
            raise InputError(
                f"garment {garment.name}: {small} of the {charts} charts of its texture coordinates have "
                f"fewer than {FEWEST_TEXELS} texels at {size} x {size}, wrinkles need more"
            )
        texels, quarters = _halved(fine)
        refined = Refined.of(mesh)
        vertices = len(refined.mesh.vertices)
        if vertices > MOST_VERTICES * len(fine):
            raise InputError(
                f"garment {garment.name}: its mesh is finer than the maps, {vertices} vertices with wrinkles "
                f"for {len(fine)} texels at {size} x {size}"
            )
        face, barycentrics = _refined_places(joined, refined)
        sampler = sample_points(layout, fine, joined.faces, face, barycentrics)
        slopes, sides = _slopes(joined, mesh, texels)
        flat = cls(
            size=size,
            mesh=joined,
            refined=refined,
            texels=texels,
            quarters=gather(joined.points, joined.faces[fine.face], fine.barycentrics)[quarters],
            places=_sparse(texels.barycentrics, joined.faces[texels.face], len(joined.points)),
            slopes=slopes,
            sides=sides[texels.face],
            rest_bend=torch.zeros(len(texels), 3),
            back=_sparse(sampler.weights, _quarter_of(sampler.pixels, texels), 4 * len(texels)),
            padding=seam_padding(layout, joined.faces, texels),
        )
        return replace(flat, rest_bend=flat.forms(joined.points)[0][:, 3:])

    def forms(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Forms (P, 6) at the texels of the garment at points (U, 3) m, and tangents (P, 3, 2) along u and v.

        Forms are strain, the first fundamental form minus the unit matrix, and bending, 1/m, the second one
        minus that at rest, as entries 00, 11, 01 on the sheet's axes. The unit tangents are right-angled, and
        turned from the surface's own axes as little as can be (polar decomposition).
        """
        along = self.slopes @ torch.cat([points, vertex_normals(points, self.mesh.faces)], dim=1)
        (u, normal_u), (v, normal_v) = (each.split(3, dim=1) for each in along.split(len(self.texels)))

        def tensor(uu: Tensor, vv: Tensor, uv: Tensor) -> Tensor:
            return torch.stack([uu.sum(1), vv.sum(1), uv.sum(1)], dim=1)

        strain = tensor(u * u, v * v, u * v) - torch.tensor([1.0, 1.0, 0.0])
        bend = -tensor(u * normal_u, v * normal_v, 0.5 * (u * normal_v + v * normal_u))
        return torch.cat([strain, bend - self.rest_bend], dim=1), right_angled(torch.stack([u, v], dim=2))

    def axes(self, tangents: Tensor) -> Tensor:
        """Axes (P, 3, 3), in columns: tangents (P, 3, 2) along u and v, and the outward normal."""
        normal = torch.linalg.cross(tangents[..., 0], tangents[..., 1]) * self.sides[:, None]
        return torch.cat([tangents, normal[..., None]], dim=-1)

    def at_vertices(self, values: Tensor) -> Tensor:
        """Values (..., n, C) at the refined mesh's vertices from values (..., P, C, 4) at the quarters of the
        texels, the same on both sides of a seam.
        """
        rows = values.movedim(-1, -2).flatten(-3, -2).movedim(-2, 0)
        flat = self.back.to(rows.dtype) @ rows.reshape(len(rows), -1)
        return flat.view(-1, *rows.shape[1:]).movedim(0, -2)

    def padded(self, rows: Tensor, tensors: slice, vectors: slice) -> Tensor:
        """Maps (..., C, H / 2, W / 2) of rows (..., P, C), with the pixels beside charts filled across seams.

        tensors, vectors: channels, see `SeamPadding.beside`. In memory, channels lie side by side.
        """
        filled = torch.cat([rows, self.padding.beside(rows, tensors, vectors)], dim=-2)
        half = self.texels.width
        maps = rows.new_zeros(*rows.shape[:-2], half * half, rows.shape[-1])
        maps.index_copy_(-2, torch.cat([self.texels.pixels, self.padding.pixels]), filled)
        return maps.unflatten(-2, (half, half)).movedim(-1, -3)


def right_angled(slopes: Tensor) -> Tensor:
    """Right-angled unit columns that are nearest to (..., 3, 2): F (F^T F)^(-1/2)."""
    u, v = slopes.unbind(-1)
    a, b, c = ((one * other).sum(-1, keepdim=True) for one, other in ((u, u), (u, v), (v, v)))
    # The root of a symmetric 2 x 2 matrix M is (M + root(det M)) / root(tr M + 2 root(det M)).
    root = (a * c - b * b).clamp(min=1e-12).sqrt()
    scale = 1.0 / (root * (a + c + 2.0 * root).clamp(min=1e-12).sqrt())
    return torch.stack([(u * (c + root) - v * b) * scale, (v * (a + root) - u * b) * scale], dim=-1)


def _halved(fine: Texels) -> tuple[Texels, Tensor]:
    """Texels of half the size that hold fine ones, P of them, at the place of the first that they hold.

    Also (P, 4) the fine texel in each of their quarters, row by row; that first one where there is none.
    """
    half = fine.width // 2
    row, column = fine.pixels // fine.width, fine.pixels % fine.width
    pixels, texel = torch.unique(row // 2 * half + column // 2, return_inverse=True)
    first = first_of(texel)
    texels = Texels(
        height=half,
        width=half,
        face=fine.face[first],
        barycentrics=fine.barycentrics[first],
        pixels=pixels,
        islands=fine.islands[first],
        uvs=torch.stack([pixels % half + 0.5, half - pixels // half - 0.5], dim=1) / half,
    )
    quarters = first[:, None].repeat(1, 4)
    quarters[texel, row % 2 * 2 + column % 2] = torch.arange(len(fine))
    return texels, quarters


def _quarter_of(pixels: Tensor, texels: Texels) -> Tensor:
    """Quarter, of 4 P, of the texels of half the size that fine pixels are."""
    row, column = pixels // (2 * texels.width), pixels % (2 * texels.width)
    slot = torch.full((texels.height * texels.width,), -1)
    slot[texels.pixels] = torch.arange(len(texels))
    return 4 * slot[row // 2 * texels.width + column // 2] + row % 2 * 2 + column % 2


def _slopes(joined: WeldedMesh, mesh: Mesh, texels: Texels) -> tuple[Tensor, Tensor]:
    """Derivatives, see Sheet.slopes, and the sides (M,) of the faces."""
    points, uvs = joined.points[joined.faces].double(), mesh.uvs[mesh.face_uvs].double()
    edges = torch.stack([points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], 2)
    on_sheet = torch.stack([uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]], 2)
    area = torch.linalg.det(on_sheet)
    # A face without an area on the sheet has no texel; any axes do.
    flat = area.abs() < 1e-12
    slopes = edges @ torch.linalg.inv(torch.where(flat[:, None, None], torch.eye(2).double(), on_sheet))
    inverse = torch.linalg.pinv(right_angled(slopes).mT @ edges, rtol=1e-6)
    of_corners = torch.cat([-inverse.sum(1, keepdim=True), inverse], dim=1)
    average, count = _average(joined, mesh, texels), len(joined.points)
    along = [average @ _matrix(of_corners[..., axis], joined.faces, count) for axis in (0, 1)]
    return _torch_csr(vstack(along, format="csr")), torch.where(area < 0, -1.0, 1.0).float()


def _average(joined: WeldedMesh, mesh: Mesh, texels: Texels) -> csr_array:
    """Matrix (P, M): the mean of the faces around each corner of a texel's face in its chart, by area."""
    areas = face_normals(joined.points, joined.faces).norm(dim=1).double()
    around = _matrix(areas[:, None].expand(-1, 3), mesh.face_uvs, len(mesh.uvs)).T.tocsr()
    sums = np.maximum(np.asarray(around.sum(1)).ravel(), 1e-300)
    corners = mesh.face_uvs[texels.face]
    shares = texels.barycentrics.double() / torch.from_numpy(sums)[corners]
    return _matrix(shares, corners, len(mesh.uvs)) @ around


def _matrix(weights: Tensor, columns: Tensor, count: int) -> csr_array:
    """Matrix (R, count) with weights (R, K) in columns (R, K) of each row."""
    rows = np.repeat(np.arange(len(columns)), columns.shape[1])
    entries = weights.double().flatten().numpy(), (rows, columns.flatten().numpy())
    return csr_array(coo_array(entries, shape=(len(columns), count)))


def _sparse(weights: Tensor, columns: Tensor, count: int) -> Tensor:
    """`_matrix` as a tensor."""
    return _torch_csr(_matrix(weights, columns, count))


def _torch_csr(matrix: csr_array) -> Tensor:
    matrix.eliminate_zeros()
    return torch.sparse_csr_tensor(
        torch.from_numpy(matrix.indptr.astype(np.int64)),
        torch.from_numpy(matrix.indices.astype(np.int64)),
        torch.from_numpy(matrix.data).float(),
        size=matrix.shape,
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
