"""A garment on its sheet: forms of known surfaces, seams, and values back at the vertices."""

from dataclasses import replace

import pytest
import torch

from tests.wrinkles.strip import SEAM, SPACING, garment, strip
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.wrinkles.inputs import CHANNELS, VECTORS, input_maps
from uvcloth.wrinkles.sheet import Sheet, right_angled

SIZE = 64
HALF = SIZE // 2

PLACE = slice(CHANNELS - 4, CHANNELS - 1)
"""Channels of the place at rest."""


@pytest.fixture(scope="module")
def sheet() -> Sheet:
    return Sheet.of(garment(strip()), SIZE)


def places(sheet: Sheet) -> torch.Tensor:
    """Places (P, 3) m of the texels at rest."""
    return sheet.places @ sheet.mesh.points


def inner(sheet: Sheet) -> torch.Tensor:
    """Mask (P,) of the texels whose faces have whole rings around them in their chart."""
    x, y, _ = places(sheet).unbind(1)
    off = torch.stack([x, (x - SEAM * SPACING).abs(), 0.24 - x, y, 0.48 - y]).amin(0)
    return off > 2.2 * SPACING


def test_a_rigid_motion_has_no_strain_and_does_not_bend(sheet: Sheet) -> None:
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0)))[0]
    turn = turn * turn.det()
    forms, tangents = sheet.forms(sheet.mesh.points @ turn.T + 1.0)
    assert float(forms[:, :3].abs().max()) < 1e-4
    assert float(forms[:, 3:].abs().max()) < 1e-2
    _, at_rest = sheet.forms(sheet.mesh.points)
    torch.testing.assert_close(tangents, turn @ at_rest, atol=1e-4, rtol=0.0)


def test_a_stretch_is_seen_along_the_axes_of_each_chart(sheet: Sheet) -> None:
    stretched = sheet.mesh.points * torch.tensor([1.1, 1.0, 1.0])
    strain = sheet.forms(stretched)[0][:, :3]
    first = places(sheet)[:, 0] < SEAM * SPACING
    torch.testing.assert_close(strain[first].mean(0), torch.tensor([0.21, 0.0, 0.0]), atol=2e-3, rtol=0.0)
    # The second chart is a quarter turn away: its u runs along y.
    torch.testing.assert_close(strain[~first].mean(0), torch.tensor([0.0, 0.21, 0.0]), atol=2e-3, rtol=0.0)


def test_a_cylinder_bends_by_its_curvature(sheet: Sheet) -> None:
    bend = sheet.forms(strip(curvature=2.0).vertices)[0][inner(sheet), 3:]
    first = places(sheet)[inner(sheet)][:, 0] < SEAM * SPACING
    along, across = torch.where(first[:, None], bend[:, :2], bend[:, :2].flip(1)).unbind(1)
    torch.testing.assert_close(along.abs(), torch.full_like(along, 2.0), atol=0.1, rtol=0.0)
    assert float(across.abs().max()) < 0.05
    # A cylinder that opens the other way bends the other way.
    other = sheet.forms(strip(curvature=-2.0).vertices)[0][inner(sheet), 3:]
    torch.testing.assert_close(other, -bend, atol=0.05, rtol=0.0)


def test_the_normal_is_that_of_the_surface_on_every_chart(sheet: Sheet) -> None:
    axes = sheet.axes(sheet.forms(sheet.mesh.points)[1])
    torch.testing.assert_close(
        axes[..., 2], torch.tensor([0.0, 0.0, 1.0]).expand(len(axes), 3), atol=1e-4, rtol=0.0
    )


def test_padding_goes_on_across_a_seam(sheet: Sheet) -> None:
    """A field of the strip, its place and a direction in it, goes on beyond the seam, and stops at hems."""
    axes = sheet.axes(sheet.forms(sheet.mesh.points)[1])
    rows = torch.zeros(len(axes), CHANNELS)
    direction = torch.tensor([0.6, 0.8, 0.0])
    rows[:, VECTORS] = (axes * direction[:, None]).sum(1)[:, :2]
    stretched = sheet.mesh.points * torch.tensor([1.1, 1.0, 1.0])
    rows[:, :3] = sheet.forms(stretched)[0][:, :3]
    rows[:, PLACE] = places(sheet)
    maps = input_maps(sheet, rows).flatten(1)
    beyond = sheet.padding.pixels
    assert 20 < len(beyond) < 500
    assert not torch.isin(beyond, sheet.texels.pixels).any()
    off = maps[PLACE.start, beyond] - SEAM * SPACING
    assert float(off.abs().max()) < 6.0 / HALF
    # Pixels right of the first chart's edge have its axes.
    first = beyond % HALF < 0.13 * HALF + 6
    assert bool(first.any())
    torch.testing.assert_close(
        maps[VECTORS][:, beyond[first]],
        torch.tensor([0.6, 0.8])[:, None].expand(-1, int(first.sum())),
        atol=1e-3,
        rtol=0.0,
    )
    torch.testing.assert_close(
        maps[:3, beyond[first]].mean(1), torch.tensor([0.21, 0.0, 0.0]), atol=5e-3, rtol=0.0
    )


def test_values_come_back_at_the_vertices(sheet: Sheet) -> None:
    back = sheet.at_vertices(sheet.quarters.transpose(1, 2))
    middle = (sheet.refined.mesh.vertices - back).norm(dim=1)
    assert float(middle.median()) < 1e-4
    assert float(middle.max()) < 0.016  # A texel at hems: there is none beyond.


def test_both_sides_of_a_seam_get_the_same_values() -> None:
    mesh = strip()
    doubled = Mesh(torch.cat([mesh.vertices, mesh.vertices]), mesh.face_uvs, mesh.uvs, mesh.face_uvs)
    sheet = Sheet.of(garment(doubled), SIZE)
    assert len(sheet.mesh.points) == len(mesh.vertices)
    assert sheet.refined.at(doubled.vertices).shape == sheet.refined.mesh.vertices.shape


def test_right_angled_columns_are_the_nearest() -> None:
    slopes = torch.randn(20, 3, 2, generator=torch.Generator().manual_seed(1)).double()
    made = right_angled(slopes)
    u, _, v = torch.linalg.svd(slopes, full_matrices=False)
    torch.testing.assert_close(made, u @ v)


def test_a_garment_without_texture_coordinates_is_refused() -> None:
    mesh = strip()
    bare = Mesh(mesh.vertices, mesh.faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64))
    with pytest.raises(InputError, match="garment tops: has no texture coordinates"):
        Sheet.of(garment(bare), SIZE)


def test_a_chart_that_is_too_small_is_refused() -> None:
    mesh = strip()
    small = replace(mesh, uvs=mesh.uvs * 0.04)
    with pytest.raises(InputError, match=r"2 of the 2 charts .* fewer than 4 texels at 64 x 64"):
        Sheet.of(garment(small), SIZE)


def test_a_mesh_that_is_finer_than_the_maps_is_refused() -> None:
    with pytest.raises(InputError, match=r"finer than the maps, 1225 vertices .* for \d+ texels at 16 x 16"):
        Sheet.of(garment(strip()), 16)
