"""Places that hold garments up, found from their meshes and named by a person."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.band import held_by, holding_band
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.holds import Hold, held_at
from uvcloth.garments.places import places
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import boundary_edges
from uvcloth.methods.physics.outfit import PhysicsConfig, make_caged_outfit


@pytest.fixture(scope="module")
def shirt(body: Body) -> Garment:
    """A long-sleeved shirt as if it came from a file."""
    return replace(fit_template("shirt", body), source="file")


@pytest.fixture(scope="module")
def skirt(body: Body) -> Garment:
    return replace(fit_template("skirt", body), source="file")


def test_places_of_garments_are_found_from_their_meshes(body: Body, shirt: Garment, skirt: Garment) -> None:
    trousers = replace(fit_template("bottoms", body), source="file")
    assert set(places(shirt.mesh, body)) == {"collar", "cuffs", "waist", "shoulders"}
    assert set(places(trousers.mesh, body)) == {"waist", "cuffs"}
    assert set(places(skirt.mesh, body)) == {"waist"}
    assert (held_by(shirt, body), held_by(trousers, body)) == (("collar",), ("waist",))


def test_a_named_place_holds_instead_of_the_one_that_is_found(
    body: Body, shirt: Garment, skirt: Garment
) -> None:
    held, other = held_at([shirt, skirt], [Hold.parse("top"), Hold.parse("shirt:cuffs")], body)
    assert (held.holds, other.holds) == (("top", "cuffs"), ("top",))
    both, found = holding_band(held, body).vertices, holding_band(shirt, body).vertices
    wrists = shirt.mesh.vertices[both & ~found]
    assert bool(found[both].any())
    assert float(wrists[:, 0].abs().min()) > 0.25
    assert torch.equal(holding_band(other, body).vertices, holding_band(skirt, body).vertices)


def test_a_garment_that_is_closed_at_its_top_hangs_from_the_shoulders(body: Body, shirt: Garment) -> None:
    """The neck is closed by a fan to a point above it, as a hood is."""
    mesh = shirt.mesh
    rims = boundary_edges(mesh.faces)
    neck = rims[(mesh.vertices[rims][..., 2] > mesh.vertices[:, 2].max() - 0.15).all(1)]
    tip = len(mesh.vertices)
    fan = torch.cat([neck.flip(1), torch.full((len(neck), 1), tip)], dim=1)
    top = mesh.vertices[neck].mean((0, 1)) + torch.tensor([0.0, 0.0, 0.3])
    hooded = replace(
        mesh,
        vertices=torch.cat([mesh.vertices, top[None]]),
        faces=torch.cat([mesh.faces, fan]),
        face_uvs=mesh.face_uvs[:0],
    )
    held = hooded.vertices[holding_band(replace(shirt, mesh=hooded), body).vertices]
    assert len(held) > 50
    shoulder = body.skeleton.heads[body.skeleton.names.index("LeftArm")]
    assert float(held[:, 0].abs().max()) < float(shoulder[0]) + 0.04
    assert float(held[:, 2].min()) > float(shoulder[2]) - 0.05


def test_unknown_places_and_garments_are_named(body: Body, skirt: Garment) -> None:
    with pytest.raises(
        InputError, match=r"--hold belt: expected PLACE, GARMENT:PLACE or GARMENT:FILE\.txt, with top"
    ):
        Hold.parse("belt")
    with pytest.raises(InputError, match="--hold coat:waist: coat is not worn; worn are skirt"):
        held_at([skirt], [Hold("waist", "coat")], body)
    with pytest.raises(InputError, match="--hold collar: no collar is found; skirt has top, waist"):
        held_at([skirt], [Hold("collar")], body)


def test_vertices_that_a_file_names_hold_instead_or_beside(
    body: Body, skirt: Garment, tmp_path: Path
) -> None:
    path = tmp_path / "pins.txt"
    path.write_text("3 5\n8\n", encoding="utf-8")
    (pinned,) = held_at([skirt], [Hold.parse(f"skirt:{path}")], body)
    band = holding_band(pinned, body)
    assert torch.nonzero(band.vertices)[:, 0].tolist() == [3, 5, 8]
    assert band.mass < 100.0
    (both,) = held_at([skirt], [Hold.parse(f"skirt:{path}"), Hold.parse("top")], body)
    expected = holding_band(skirt, body).vertices | band.vertices
    assert torch.equal(holding_band(both, body).vertices, expected)
    assert held_by(both, body) == ("top", "pins")


def test_a_file_of_pins_that_is_empty_or_of_no_garment_is_refused(
    body: Body, skirt: Garment, tmp_path: Path
) -> None:
    path = tmp_path / "pins.txt"
    path.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"--hold skirt:.*pins\.txt: names no vertex of skirt"):
        held_at([skirt], [Hold.parse(f"skirt:{path}")], body)
    with pytest.raises(InputError, match=r"--hold .*pins\.txt: expected PLACE"):
        Hold.parse("pins.txt")
    path.write_text("999999", encoding="utf-8")
    with pytest.raises(InputError, match=r"pins\.txt: vertex 999999 is not one of the"):
        held_at([skirt], [Hold.parse(f"skirt:{path}")], body)


def test_pins_too_few_for_the_cage_are_refused(body: Body, skirt: Garment) -> None:
    hem = int(skirt.mesh.vertices[:, 2].argmin())
    pins = torch.zeros(len(skirt.mesh.vertices), dtype=torch.bool)
    pins[hem] = True
    near = (skirt.mesh.vertices - skirt.mesh.vertices[hem]).norm(dim=1) < 0.05
    with pytest.raises(InputError, match="garment skirt: what holds it up falls between the vertices"):
        make_caged_outfit(Outfit(body, (replace(skirt, pins=pins),)), PhysicsConfig("fast"))
    make_caged_outfit(Outfit(body, (replace(skirt, pins=near),)), PhysicsConfig("fast"))
