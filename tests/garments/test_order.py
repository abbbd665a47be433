"""Layers lie over one another at rest, or are refused: sheets of known height, and the templates."""

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.order import check_order
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh


def sheet(name: str, height: float, lowered: int = 0) -> Garment:
    """A square of 20 x 20 vertices at a height, m, of which the first few lie 1 cm lower."""
    steps = 0.01 * torch.arange(20.0)
    vertices = torch.cartesian_prod(steps, steps, torch.tensor([height]))
    vertices[:lowered, 2] -= 0.01
    corners = torch.arange(400).view(20, 20)
    a, b, c, d = (
        x.flatten() for x in (corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:])
    )
    faces = torch.cat([torch.stack([a, b, d], 1), torch.stack([a, d, c], 1)])
    return Garment(name, name, Mesh(vertices, faces, vertices[:, :2], faces), *[torch.ones(400, 1)] * 2)


def test_the_innermost_comes_first() -> None:
    shirt, coat, far = sheet("shirt", 0.0), sheet("coat", 0.005), sheet("far", -0.5)
    check_order([shirt])
    check_order([shirt, coat])
    check_order([shirt, far])
    with pytest.raises(InputError, match=r"garment shirt: cannot be worn over the garment coat, .* 100 %"):
        check_order([coat, shirt])


def test_every_pair_is_looked_at() -> None:
    shirt, coat, far = sheet("shirt", 0.0), sheet("coat", 0.005), sheet("far", -0.5)
    with pytest.raises(InputError, match="garment shirt: cannot be worn over the garment coat"):
        check_order([far, coat, shirt])
    with pytest.raises(InputError, match="garment shirt: cannot be worn over the garment coat"):
        check_order([coat, far, shirt])


def test_a_garment_is_worn_once() -> None:
    with pytest.raises(InputError, match="garment shirt: is named twice"):
        check_order([sheet("shirt", 0.0), sheet("coat", 0.005), sheet("shirt", 0.01)])


def test_a_few_crossed_vertices_are_let_through() -> None:
    shirt = sheet("shirt", 0.0)
    check_order([shirt, sheet("coat", 0.005, lowered=3)])
    with pytest.raises(InputError, match=r"at rest it is below it in 5 % of the places"):
        check_order([shirt, sheet("coat", 0.005, lowered=20)])


def test_the_shirt_is_worn_over_the_trousers(body: Body) -> None:
    tops, bottoms = fit_template("tops", body), fit_template("bottoms", body)
    check_order([bottoms, tops])
    with pytest.raises(InputError, match="garment bottoms: cannot be worn over the garment tops"):
        check_order([tops, bottoms])
