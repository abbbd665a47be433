"""Texels against scikit-image's polygon fill."""

import numpy as np
import torch
from skimage.draw import polygon

from rasterize.layout import Layout
from rasterize.texels import rasterize_layout
from uvcloth.bodies.layout import load_body_layout

SIZE = 64


def soup(count: int, seed: int) -> Layout:
    """Small triangles scattered over the sheet, one to each cell of a grid, so that none overlap."""
    side = int(np.ceil(np.sqrt(count)))
    generator = torch.Generator().manual_seed(seed)
    corner = torch.rand(count, 3, 2, generator=generator)
    cell = torch.stack([torch.arange(count) % side, torch.arange(count) // side], dim=1)
    uvs = (cell[:, None] + corner).reshape(-1, 2) / side
    return Layout(
        torch.arange(count) + 7,
        uvs,
        torch.arange(3 * count).view(-1, 3),
        torch.zeros(count, dtype=torch.int64),
    )


def test_agrees_with_polygon_fill_but_for_the_boundary() -> None:
    layout = soup(25, seed=1)
    texels = rasterize_layout(layout, SIZE)
    drawn = torch.full((SIZE * SIZE,), -1)
    drawn[texels.pixels] = texels.face
    checked = 0
    for face, corners in zip(
        layout.faces.tolist(), layout.uvs[layout.face_uvs].double().numpy(), strict=True
    ):
        columns, rows = corners[:, 0] * SIZE - 0.5, (1 - corners[:, 1]) * SIZE - 0.5
        expected = np.zeros((SIZE, SIZE), dtype=bool)
        expected[polygon(rows, columns, (SIZE, SIZE))] = True
        differing = expected != (drawn.view(SIZE, SIZE) == face).numpy()
        for row, column in np.argwhere(differing):
            assert distance_to_outline(np.array([column, row]), np.stack([columns, rows], axis=1)) < 1e-3
        checked += int(expected.sum())
    assert checked > 200


def distance_to_outline(point: np.ndarray, corners: np.ndarray) -> float:
    starts, sides = corners, np.roll(corners, -1, axis=0) - corners
    along = np.clip(((point - starts) * sides).sum(1) / (sides**2).sum(1), 0, 1)
    return float(np.linalg.norm(starts + along[:, None] * sides - point, axis=1).min())


def test_barycentrics_lead_back_to_the_texel_centre() -> None:
    layout = load_body_layout()
    texels = rasterize_layout(layout, 100)
    slot = torch.full((int(layout.faces.max()) + 1,), -1)
    slot[layout.faces] = torch.arange(len(layout.faces))
    uvs = (layout.uvs[layout.face_uvs[slot[texels.face]]] * texels.barycentrics[..., None]).sum(1)
    assert (uvs - texels.uvs).abs().max() < 1e-5
    assert texels.barycentrics.min() >= 0
    assert (texels.pixels.diff() > 0).all()
    expected_u = (texels.pixels % 100 + 0.5) / 100
    expected_v = 1 - (texels.pixels // 100 + 0.5) / 100
    assert torch.allclose(texels.uvs, torch.stack([expected_u, expected_v], 1))


def test_a_square_of_two_faces_has_no_hole_along_their_common_edge() -> None:
    uvs = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    texels = rasterize_layout(Layout(torch.arange(2), uvs, faces, torch.zeros(2, dtype=torch.int64)), 33)
    assert len(texels) == 33 * 33


def test_of_faces_at_one_place_the_first_wins() -> None:
    layout = soup(25, seed=1)
    faces = torch.cat([layout.faces, layout.faces + 25])
    twice = Layout(faces, layout.uvs, layout.face_uvs.repeat(2, 1), layout.islands.repeat(2))
    assert torch.equal(rasterize_layout(twice, SIZE).face, rasterize_layout(layout, SIZE).face)
