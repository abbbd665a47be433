"""Garments with wrinkles in the runtime: what PyTorch has, off the skin, frame after frame."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
import trimesh
from torch import Tensor

from tests.small_body import small_body
from tests.wrinkles.in_torch import WrinkledInTorch
from tests.wrinkles.small_network import CONFIG, made_up_wrinkles
from tests.wrinkles.strip import garment, strip
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.refined import Refined
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.outfit_clearing import CLEARANCE
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.model import Wrinkles
from uvcloth.wrinkles.network import WrinkleConfig
from uvcloth.wrinkles.outfit import WrinkledOutfit, WrinkledSheets

FPS = 30.0


@pytest.fixture
def wrinkles() -> Wrinkles:
    return made_up_wrinkles()


def skin(away: float = 1.0) -> Tensor:
    """Vertices of the small body, so many metres beneath the strip."""
    return small_body().mesh.vertices - torch.tensor([0.0, 0.0, away])


def worn(wrinkles: Wrinkles, body: Body | None = None) -> WrinkledOutfit:
    """The strip on a body."""
    cloth = garment(strip())
    outfit = Outfit(body or small_body(), (cloth,))
    return WrinkledOutfit(wrinkles, outfit, [cloth.mesh], wrinkles.config.quality)


def played(
    wrinkles: Wrinkles, frames: Sequence[Tensor], body: Tensor | None = None, fps: float = FPS
) -> Tensor:
    """The strip with wrinkles in the last of some frames."""
    wrinkled = worn(wrinkles)
    for vertices in frames:
        (shown,) = wrinkled.shown((vertices,), skin() if body is None else body, fps)
    return shown


def bent(curvature: float, swing: float = 0.0) -> Tensor:
    """The strip on a cylinder, stretched, and moved by some metres along x and z."""
    vertices = strip(curvature).vertices * torch.tensor([1.0, 0.95, 1.0])
    return vertices + swing * torch.tensor([1.0, 0.0, 2.0]) * (vertices[:, 1:2] + 0.1)


@pytest.mark.parametrize("levels", [1, 2, 4])
def test_the_runtime_shows_what_the_network_makes_in_pytorch(levels: int) -> None:
    """Within 0.002 mm; folds are of centimetres here."""
    made = made_up_wrinkles(replace(CONFIG, levels=levels, width=5))
    frames = [bent(0.5 + 0.4 * k, 0.01 * k * k) for k in range(4)]
    reference, runtime = WrinkledInTorch(made, garment(strip())), worn(made)
    surface = BodySurface(skin(0.5), small_body().mesh.faces)
    for vertices in frames:
        expected = reference.wrinkled(vertices, FPS, surface)
        (shown,) = runtime.shown((vertices,), surface.points, FPS)
        assert float((expected - reference.sheet.refined.at(vertices)).norm(dim=1).max()) > 5e-3
        torch.testing.assert_close(shown, expected, atol=2e-6, rtol=0.0)


def test_an_untrained_network_leaves_the_smooth_surface() -> None:
    shown = played(Wrinkles.untrained(CONFIG), [bent(2.0)])
    torch.testing.assert_close(shown, Refined.of(strip()).at(bent(2.0)), atol=1e-6, rtol=0.0)


def test_wrinkles_turn_and_move_with_the_cloth(wrinkles: Wrinkles) -> None:
    """The inputs know no place: displacements of a body and cloth that are turned together are turned.

    But for gravity, around which the scene is turned.
    """
    vertices = strip(curvature=2.0).vertices
    turn = torch.tensor([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    shift = torch.tensor([1.0, -2.0, 0.5])
    here = played(wrinkles, [vertices])
    there = played(wrinkles, [vertices @ turn.T + shift], skin() @ turn.T + shift)
    smooth = Refined.of(strip()).at(vertices)
    assert float((here - smooth).norm(dim=1).max()) > 1e-3
    torch.testing.assert_close((there - shift) @ turn, here, atol=1e-4, rtol=0.0)


def test_a_frame_depends_on_the_one_before_until_it_begins_again(wrinkles: Wrinkles) -> None:
    first, second = strip(curvature=1.0).vertices, strip(curvature=2.0).vertices
    alone, after = played(wrinkles, [second]), played(wrinkles, [first, second])
    assert float((after - alone).norm(dim=1).max()) > 1e-5
    wrinkled = worn(wrinkles)
    wrinkled.shown((first,), skin(), FPS)
    wrinkled.begin()
    (again,) = wrinkled.shown((second,), skin(), FPS)
    assert torch.equal(again, alone)


def test_wrinkles_keep_off_the_skin(wrinkles: Wrinkles) -> None:
    """On a block whose top is 5 mm beneath the strip."""
    block = trimesh.creation.box((2.0, 2.0, 2.0))
    faces = torch.tensor(block.faces)
    strong = Wrinkles(replace(CONFIG, gain=3.0), wrinkles.net)

    def lowest(away: float) -> float:
        vertices = torch.tensor(block.vertices - [0.0, 0.0, 1.0 + away]).float()
        body = replace(small_body(), mesh=Mesh(vertices, faces, vertices[:, :2], faces))
        (shown,) = worn(strong, body).shown((strip().vertices,), vertices, FPS)
        return float(shown[:, 2].min())

    assert lowest(0.05) < -0.004
    assert lowest(0.005) > CLEARANCE - 0.005 - 1e-4


def test_no_wrinkles_where_cloth_lies_on_itself(wrinkles: Wrinkles) -> None:
    """The strip is folded in its middle, so that halves are 8 mm apart, or 40."""

    def shown(thick: float) -> tuple[Tensor, Tensor]:
        x, y, _ = strip().vertices.unbind(1)
        radius, along = 0.5 * thick, y - 0.5 * float(y.max())
        turn = (along / radius).clamp(0.0, math.pi)
        beyond = (along - math.pi * radius).clamp(min=0.0)
        folded = torch.stack(
            [x, along.clamp(max=0.0) + radius * turn.sin() - beyond, radius * (1.0 - turn.cos())], 1
        )
        moved = (played(wrinkles, [folded]) - Refined.of(strip()).at(folded)).norm(dim=1)
        return moved, Refined.of(strip()).mesh.vertices[:, 1] / float(y.max())

    moved, share = shown(0.008)
    assert float(moved[(share > 0.3) & (share < 0.4)].max()) < 1e-6
    moved, share = shown(0.04)
    assert float(moved[(share > 0.3) & (share < 0.4)].mean()) > 1e-3


def test_wrinkles_keep_off_a_garment_beside_them(wrinkles: Wrinkles) -> None:
    """Another strip lies 5 mm beneath."""
    cloth, under = garment(strip()), strip()
    under = replace(under, vertices=under.vertices - torch.tensor([0.0, 0.0, 0.005]))
    outfit = Outfit(small_body(), (garment(under, "dress"), cloth))
    strong = Wrinkles(replace(CONFIG, gain=3.0), wrinkles.net)
    wrinkled = WrinkledOutfit(strong, outfit, [outfit.garments[0].mesh, cloth.mesh], "default")
    _, shown = wrinkled.shown((under.vertices, cloth.mesh.vertices), skin(), FPS)
    assert float(played(strong, [strip().vertices])[:, 2].min()) < -0.01
    assert float(shown[:, 2].min()) > CLEARANCE - 0.005 - 1e-4


def test_what_is_shown_lags(wrinkles: Wrinkles) -> None:
    first, second = strip(curvature=1.0).vertices, strip(curvature=2.0).vertices

    def shown(lag: float) -> Tensor:
        return played(Wrinkles(replace(CONFIG, lag=lag), wrinkles.net), [first, second])

    # Displacements are on the axes of the surface, which turns little here.
    at_once, late, never = shown(0.0), shown(1.0 / FPS), shown(10.0)
    whole = (never - at_once).norm()
    assert float(whole) > 1e-3
    assert float((late - at_once).norm()) == pytest.approx(math.exp(-1.0) * float(whole), rel=0.05)


def test_the_gain_multiplies_what_is_shown(wrinkles: Wrinkles) -> None:
    vertices = strip(curvature=2.0).vertices
    smooth = Refined.of(strip()).at(vertices)
    more = Wrinkles(replace(CONFIG, gain=2.0), wrinkles.net)
    once, twice = (played(each, [vertices]) - smooth for each in (wrinkles, more))
    torch.testing.assert_close(twice, 2.0 * once, atol=1e-6, rtol=1e-3)


def test_no_wrinkles_beneath_another_garment(wrinkles: Wrinkles) -> None:
    """A second strip lies 1 cm over the first half of the strip."""
    cloth = garment(strip())
    over = strip()
    half = over.vertices[over.faces][..., 1].amax(1) < 0.24
    upper = replace(over, vertices=over.vertices + torch.tensor([0.0, 0.0, 0.01]), faces=over.faces[half])
    upper = replace(upper, face_uvs=over.face_uvs[half])
    silk = replace(garment(upper, "dress"), mesh=upper)
    outfit = Outfit(small_body(), (cloth, silk))
    wrinkled = WrinkledOutfit(wrinkles, outfit, [cloth.mesh, upper], "default")
    shown, other = wrinkled.shown((cloth.mesh.vertices, upper.vertices), skin(), FPS)
    smooth = Refined.of(strip()).at(cloth.mesh.vertices)
    height = (shown - smooth).norm(dim=1)
    assert torch.equal(other, upper.vertices)
    assert float(height[smooth[:, 1] < 0.15].max()) < 1e-6
    assert float(height[smooth[:, 1] > 0.35].mean()) > 1e-3


def test_a_refined_garment_follows_the_same_joints(wrinkles: Wrinkles) -> None:
    cloth = garment(strip())
    laid_out = WrinkledSheets.of(wrinkles, Outfit(small_body(), (cloth,)), "default")
    (shown,) = laid_out.refined()
    assert len(shown.mesh.faces) == 4 * len(cloth.mesh.faces)
    torch.testing.assert_close(shown.smooth_weights, torch.ones(len(shown.mesh.vertices), 1))


def test_what_the_runtime_cannot_read_is_said(wrinkles: Wrinkles) -> None:
    wide = Wrinkles.untrained(WrinkleConfig(size=256, width=160, levels=1))
    with pytest.raises(InputError, match="--wrinkles: the network of wrinkles takes too long"):
        worn(wide)
