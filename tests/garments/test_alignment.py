"""Alignment of garments with a body: what is given is kept, the rest is found, or the garment refused."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.alignment import Known, align
from uvcloth.garments.boundaries import boundaries
from uvcloth.garments.fit import Fitting, place_on_body
from uvcloth.garments.judge import UnwearableError
from uvcloth.garments.relaxation import CLEARANCE, settle
from uvcloth.garments.templates import fit_template
from uvcloth.garments.transfer import transfer
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.physics.surface import BodySurface
from uvcloth.writers.obj import save_obj

TURN, SCALE, SHIFT = 37.0, 0.29, (-0.55, 1.2, -0.3)


def displaced(mesh: Mesh) -> Mesh:
    """A mesh whose alignment is TURN, SCALE and SHIFT."""
    turn = from_axis_angles(torch.tensor([[0.0, 0.0, math.radians(TURN)]]))[0]
    return replace(mesh, vertices=(mesh.vertices - torch.tensor(SHIFT)) / SCALE @ turn)


def test_a_shift_a_scale_and_a_turn_are_found(body: Body) -> None:
    mesh = fit_template("tops", body).mesh
    found = align(displaced(mesh), body)
    assert found.up == "Z"
    assert found.turn == pytest.approx(TURN, abs=4.0)
    assert found.scale == pytest.approx(SCALE, rel=0.06)
    apart = (found.apply(displaced(mesh).vertices) - mesh.vertices).norm(dim=1)
    assert float(apart.mean()) < 0.03
    assert f"scale {found.scale:.4g}, turn {found.turn:.0f} degrees" in found.text()


def test_what_is_given_is_not_searched(body: Body) -> None:
    mesh = fit_template("bottoms", body).mesh
    placed = place_on_body(Path("it.obj"), displaced(mesh), body, Fitting(known=Known(SHIFT, SCALE, TURN)))
    assert float((placed.mesh.vertices - mesh.vertices).norm(dim=1).mean()) < 0.005
    assert "shift -0.550 1.200 -0.300 m, scale 0.29, turn 37 degrees" in placed.diagnosis.lines()[1]
    with pytest.raises(UnwearableError, match=r"it\.obj: the garment lies nowhere on the body"):
        place_on_body(Path("it.obj"), displaced(mesh), body, Fitting(known=Known(shift=(0.0, 0.0, 3.0))))


@pytest.mark.parametrize(
    ("known", "reason"),
    [(Known(scale=0.0), "--scale 0: expected metres"), (Known(turn=math.nan), "expected finite numbers")],
)
def test_what_cannot_be_is_refused(known: Known, reason: str, body: Body) -> None:
    with pytest.raises(InputError, match=reason):
        place_on_body(Path("it.obj"), fit_template("tops", body).mesh, body, Fitting(known=known))


@pytest.mark.thorough
def test_a_mesh_that_is_no_body_is_named(body: Body, tmp_path: Path) -> None:
    mesh = fit_template("bottoms", body).mesh
    save_obj(mesh, tmp_path / "trousers.obj")
    with pytest.raises(InputError, match=r"trousers\.obj: is no body like ours"):
        transfer(mesh, tmp_path / "trousers.obj", body)


def test_settled_cloth_is_outside_and_as_long_as_it_was(body: Body) -> None:
    mesh = fit_template("tops", body).mesh
    inside = mesh.vertices + torch.tensor([0.0, 0.02, 0.0])
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    assert float((surface.closest(inside).signed_distance < -0.005).float().mean()) > 0.1
    settled = settle(inside, mesh.faces, mesh.vertices, body)
    assert float(surface.closest(settled.vertices).signed_distance.min()) > 0.9 * CLEARANCE
    assert settled.off < 0.06


def test_openings_are_those_that_hold_a_limb(body: Body) -> None:
    for name, count in (("tops", 4), ("shirt", 4), ("bottoms", 3), ("skirt", 2), ("jacket", 2)):
        mesh = fit_template(name, body).mesh
        assert len(boundaries(mesh.vertices, mesh.faces).radii) == count, name
