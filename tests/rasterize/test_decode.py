"""Decoding: exact on linear fields, seams averaged, small representation floor, differentiable."""

import pytest
import torch

from rasterize.bake import bake, scatter_map
from rasterize.decode import Sampler, decode, nearest_sampler, sample_points
from rasterize.layout import Layout
from rasterize.raycast import body_to_garment
from rasterize.texels import Texels, rasterize_layout
from uvcloth.bodies.body import Body
from uvcloth.bodies.layout import load_body_layout
from uvcloth.geometry.mesh import vertex_normals

# Two squares side by side in space, joined along x = 1, but far apart on the sheet.
FACES = torch.tensor([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
VERTICES = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]])
LOW, HIGH = 0.02, 0.42
SPLIT = Layout(
    faces=torch.arange(4),
    uvs=torch.tensor(
        [[LOW, LOW], [HIGH, LOW], [HIGH, HIGH], [LOW, HIGH], [0.5, 0.5], [0.9, 0.5], [0.9, 0.9], [0.5, 0.9]]
    ),
    face_uvs=torch.tensor([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]),
    islands=torch.tensor([0, 0, 1, 1]),
)


def test_bilinear_is_exact_on_linear_fields_inside_a_chart() -> None:
    texels = rasterize_layout(SPLIT, 64)
    maps = scatter_map(bake(VERTICES.double(), FACES, texels), texels)
    face = torch.tensor([0, 1, 1, 2, 3])
    barycentrics = torch.tensor(
        [[0.3, 0.3, 0.4], [0.4, 0.35, 0.25], [0.3, 0.7, 0.0], [0.2, 0.5, 0.3], [0.3, 0.4, 0.3]]
    )
    expected = (VERTICES[FACES[face]] * barycentrics[..., None]).sum(1)
    sampler = sample_points(SPLIT, texels, FACES, face, barycentrics)
    assert (decode(maps, sampler) - expected).abs().max() < 1e-5


def test_at_the_border_of_the_sheet_the_texels_of_that_border_count() -> None:
    """A chart over the whole sheet has texels beyond every border, were rows and columns to wrap around."""
    uvs = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    whole = Layout(torch.arange(2), uvs, faces, torch.zeros(2, dtype=torch.int64))
    texels = rasterize_layout(whole, 8)
    maps = scatter_map(texels.uvs, texels)
    places = torch.tensor([[0.02, 0.4], [0.98, 0.4], [0.4, 0.02], [0.4, 0.98], [0.4, 0.9]])
    x, y = places.unbind(1)
    below = x > y
    barycentrics = torch.where(
        below[:, None], torch.stack([1 - x, x - y, y], 1), torch.stack([1 - y, x, y - x], 1)
    )
    sampler = sample_points(whole, texels, faces, (~below).long(), barycentrics)
    expected = places.clamp(0.5 / 8, 1 - 0.5 / 8)
    assert (decode(maps, sampler) - expected).abs().max() < 1e-5


def test_points_on_a_seam_average_both_sides_equally() -> None:
    texels = rasterize_layout(SPLIT, 64)
    sides = (texels.islands == 1).float()[:, None]
    face, on_edge = torch.tensor([0, 3, 0]), torch.tensor([[0.0, 0.5, 0.5], [0.4, 0.0, 0.6], [0.0, 1.0, 0.0]])
    sampler = sample_points(SPLIT, texels, FACES, face, on_edge)
    assert decode(scatter_map(sides, texels), sampler).flatten().tolist() == pytest.approx([0.5, 0.5, 0.5])
    assert sampler.pixels.shape == (3, 2 * 4)
    inside = sample_points(SPLIT, texels, FACES, torch.tensor([0]), torch.tensor([[0.34, 0.33, 0.33]]))
    assert decode(scatter_map(sides, texels), inside).item() == 0.0


def test_pruned_faces_cannot_be_sampled() -> None:
    texels = rasterize_layout(SPLIT, 16)
    faces = torch.cat([FACES, torch.tensor([[0, 1, 5]])])
    with pytest.raises(ValueError, match="pruned"):
        sample_points(SPLIT, texels, faces, torch.tensor([4]), torch.tensor([[0.3, 0.3, 0.4]]))


@pytest.fixture(scope="module")
def shell(body: Body) -> tuple[torch.Tensor, Texels, torch.Tensor]:
    """A shell 2 cm off the skin, the texels, and the shell point that each sees at rest (nan: none)."""
    normals = vertex_normals(body.mesh.vertices, body.mesh.faces)
    shell = body.mesh.vertices + 0.02 * normals
    texels = rasterize_layout(load_body_layout(), 128)
    points, rays = (bake(values, body.mesh.faces, texels) for values in (body.mesh.vertices, normals))
    hits = body_to_garment(points, rays, shell, body.mesh.faces, max_distance=0.1)
    seen = hits.interpolate(shell, body.mesh.faces)
    return shell, texels, torch.where(hits.hit[:, None], seen, torch.nan)


def torso(body: Body) -> torch.Tensor:
    layout = load_body_layout()
    return body.mesh.faces[layout.faces[layout.islands >= 4]].unique()


def test_nearest_texels_reproduce_linear_fields(body: Body, shell: tuple) -> None:
    surface, texels, points = shell
    queries = surface[torso(body)]
    sampler = nearest_sampler(points, texels, queries)
    turn = torch.tensor([[0.9, 0.2, -0.1], [0.0, 1.3, 0.4], [0.3, -0.2, 0.8]])
    seen = points.nan_to_num() @ turn.T
    error = (decode(scatter_map(seen, texels), sampler) - queries @ turn.T).norm(dim=1)
    assert error.median() < 1e-4
    assert error.mean() < 1e-3


def test_representation_floor_of_a_waving_shell(body: Body, shell: tuple) -> None:
    """A wave of 10 cm length and 1 cm height, decoded with the fixed rest residual: below 2 mm on average."""
    surface, texels, points = shell
    queries = surface[torso(body)]
    sampler = nearest_sampler(points, texels, queries)

    def waving(rest: torch.Tensor) -> torch.Tensor:
        phase = 2 * torch.pi * rest.sum(1, keepdim=True) / 0.1
        return rest + 0.01 * torch.cat([phase.sin(), phase.cos(), phase.sin()], dim=1)

    maps = scatter_map(torch.stack([points.nan_to_num(), waving(points.nan_to_num())]), texels)
    rest, moved = decode(maps, sampler)
    error = (moved + queries - rest - waving(queries)).norm(dim=1)
    assert error.mean() < 2e-3


def test_decoding_is_differentiable() -> None:
    sampler = Sampler(torch.tensor([[0, 3], [2, 2]]), torch.tensor([[0.25, 0.75], [1.0, 0.0]]))
    maps = torch.rand(2, 3, 2, 2, dtype=torch.float64, requires_grad=True)
    assert decode(maps, sampler).shape == (2, 2, 3)
    assert torch.autograd.gradcheck(lambda m: decode(m, sampler), (maps,))
