import numpy as np
import pytest
import torch
import trimesh

from uvcloth.errors import InputError
from uvcloth.rendering.render import Camera, Surface, contact_sheet, render, render_frames, three_quarter

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def ball(centre: tuple[float, float, float], radius: float, color: tuple[float, float, float]) -> Surface:
    mesh = trimesh.creation.icosphere(4, radius)
    return Surface(
        torch.tensor(mesh.vertices + centre, dtype=torch.float32),
        torch.tensor(mesh.faces, dtype=torch.int64),
        color,
    )


def is_red(image: np.ndarray) -> np.ndarray:
    return image[..., 0].astype(int) - image[..., 2] > 25


def is_blue(image: np.ndarray) -> np.ndarray:
    return image[..., 2].astype(int) - image[..., 0] > 25


def test_a_ball_covers_its_projected_disc() -> None:
    camera = Camera((0.0, -5.0, 3.0), (0.0, 0.0, 3.0), view=28.0)
    image = render([ball((0, 0, 3), 0.5, RED)], camera, (200, 300))
    assert image.shape == (300, 200, 3)
    # The outline of a ball at distance d is a circle of half angle asin(r / d).
    radius = np.tan(np.arcsin(0.5 / 5)) / np.tan(np.radians(14)) * 150
    rows, columns = np.nonzero(is_red(image))
    assert len(rows) == pytest.approx(np.pi * radius**2, rel=0.02)
    assert (rows.mean(), columns.mean()) == pytest.approx((149.5, 99.5), abs=0.3)


def test_the_nearer_surface_hides_the_farther_and_left_is_left() -> None:
    camera = Camera((0.0, -5.0, 3.0), (0.0, 0.0, 3.0))
    image = render([ball((0, 1, 3), 0.3, BLUE), ball((0, 0, 3), 0.5, RED)], camera, (100, 100))
    assert not is_blue(image).any()
    image = render([ball((-0.6, 0, 3.4), 0.2, BLUE), ball((0.6, 0, 2.6), 0.2, RED)], camera, (100, 100))
    (blue_rows, blue_columns), (red_rows, red_columns) = np.nonzero(is_blue(image)), np.nonzero(is_red(image))
    assert blue_columns.max() < red_columns.min()
    assert blue_rows.max() < red_rows.min()


def test_the_floor_hides_what_is_below_it_and_takes_a_shadow() -> None:
    camera = Camera((0.0, -4.0, 1.0), (0.0, 0.0, 0.3))
    assert not is_red(render([ball((0, 0, -0.6), 0.5, RED)], camera, (100, 100))).any()
    lit = render([ball((0, 0, 9.0), 0.01, RED)], camera, (100, 100))
    shaded = render([ball((0, 0, 0.3), 0.3, RED)], camera, (100, 100))
    floor = ~is_red(shaded)
    assert (lit.astype(int) - shaded).max(2)[floor].max() > 25


def test_cloth_is_lit_alike_on_both_sides() -> None:
    sheet = torch.tensor([[-0.5, 0.0, 2.5], [0.5, 0.0, 2.5], [0.5, 0.0, 3.5], [-0.5, 0.0, 3.5]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    camera = Camera((0.0, -4.0, 3.0), (0.0, 0.0, 3.0))
    outer, inner = (render([Surface(sheet, each, RED)], camera, (60, 60)) for each in (faces, faces.flip(1)))
    assert is_red(outer).any()
    assert np.abs(outer.astype(int) - inner).max() < 8


def test_skin_beside_a_hem_is_as_light_as_skin_far_from_it() -> None:
    """A hem lies between the vertices of the skin, 4 mm in front of it."""
    steps = torch.linspace(-0.5, 0.5, 8)
    x, z = torch.meshgrid(steps, steps + 3.0, indexing="ij")
    skin = torch.stack([x, torch.zeros_like(x), z], 2).reshape(-1, 3)
    first = torch.arange(49) + torch.arange(49) // 7
    faces = torch.stack([first, first + 8, first + 9, first, first + 9, first + 1], 1).view(-1, 3)
    cloth = torch.tensor([[-0.5, 0.0, 2.5], [0.0, 0.0, 2.5], [0.0, 0.0, 3.5], [-0.5, 0.0, 3.5]])
    cloth[:, 1] -= 0.004
    sheets = [Surface(skin, faces, RED), Surface(cloth, torch.tensor([[0, 1, 2], [0, 2, 3]]), BLUE)]
    image = render(sheets, Camera((0.0, -4.0, 3.0), (0.0, 0.0, 3.0)), (200, 200))
    row = image[100].astype(int).sum(1)[is_red(image)[100]]
    assert len(row) > 40
    assert row[:4].min() > 0.95 * row[25:35].mean()


def test_pictures_repeat_exactly() -> None:
    surfaces = [ball((0, 0, 0.5), 0.4, RED)]
    camera = three_quarter(surfaces[0].vertices)
    assert np.array_equal(render(surfaces, camera, (80, 80)), render(surfaces, camera, (80, 80)))


def test_the_camera_holds_and_follows_what_moves() -> None:
    balls = [ball((step, 2 * step, 0.5), 0.4, RED) for step in (0.0, 1.0, 7.0)]
    for image in render_frames([[each] for each in balls], size=(90, 120)):
        rows, columns = np.nonzero(is_red(image))
        assert (columns.mean(), rows.mean()) == pytest.approx((44.5, 59.5), abs=2)
        assert 0 < rows.min() < rows.max() < 119
        assert 0 < columns.min() < columns.max() < 89


def test_a_vertex_that_is_not_finite_is_refused() -> None:
    surface = ball((0, 0, 1), 0.5, RED)
    surface.vertices[3, 1] = torch.nan
    with pytest.raises(InputError, match="not a finite number"):
        render([surface], three_quarter(torch.zeros(1, 3)), (20, 20))


def test_contact_sheet_sets_pictures_in_rows() -> None:
    images = [np.full((4, 6, 3), value, np.uint8) for value in (10, 20, 30)]
    sheet = contact_sheet(images, columns=2, gap=1)
    assert sheet.shape == (9, 13, 3)
    assert (sheet[:4, :6] == 10).all()
    assert (sheet[:4, 7:] == 20).all()
    assert (sheet[5:, :6] == 30).all()
    assert (sheet[5:, 7:] == 255).all()
