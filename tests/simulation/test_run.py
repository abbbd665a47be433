"""Simulating whole meshes with an engine that only carries: seams, layers, and what is said of them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.joined import join
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip import Clip
from uvcloth.motion.lead_in import LeadIn
from uvcloth.motion.library import load_clip
from uvcloth.physics.layer_thickness import LAYER_THICKNESS, inner_thickness
from uvcloth.simulation.engine import Frame, Scene
from uvcloth.simulation.run import simulate

PARTS = LeadIn(rest=1, blend=2, ramp=1)


@dataclass(frozen=True)
class Carrying:
    """Cloth that goes where the body carries it, `up` metres higher."""

    up: float = 0.0

    def describe(self) -> dict[str, Any]:
        return {"engine": "carrying"}

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        assert (
            scene.touches.shape[1] == len(scene.rest) == len(scene.mass_factor) == len(scene.inner_thickness)
        )
        assert int(scene.faces.max()) == len(scene.rest) - 1
        assert torch.equal(scene.mass_factor > 1.0, scene.band)
        for index, vertices in enumerate(scene.skinned):
            yield Frame(index, vertices + torch.tensor([0.0, 0.0, self.up]))


@pytest.fixture(scope="module")
def clip(body: Body) -> Clip:
    return load_clip("walk", body).window(0, 3)


@pytest.fixture(scope="module")
def cut(body: Body) -> Garment:
    """Trousers whose triangles share no vertex, with one vertex more that no face uses."""
    whole = fit_template("bottoms", body)
    order = torch.cat([whole.mesh.faces.reshape(-1), torch.tensor([5])])
    vertices = whole.mesh.vertices[order]
    vertices[-1] += 0.01
    mesh = replace(whole.mesh, vertices=vertices, faces=torch.arange(len(order) - 1).reshape(-1, 3))
    return Garment("slacks", "bottoms", mesh, whole.weights[order], whole.smooth_weights[order])


def test_a_mesh_that_is_cut_at_seams_is_simulated_whole(cut: Garment, body: Body, clip: Clip) -> None:
    cloth = join(cut, body)
    assert len(cloth.kept) == len(fit_template("bottoms", body).mesh.vertices)
    made = simulate(clip, 0, (cloth,), body, Carrying(up=0.02), PARTS)
    (garment,) = made.garments
    moved = skin(cut.mesh.vertices, cut.smooth_weights, made.transforms)
    lifted = torch.full((len(moved[0]),), 0.02)
    lifted[-1] = 0.0
    torch.testing.assert_close(garment.vertices[..., 2], moved[..., 2] + lifted, atol=1e-6, rtol=0)
    assert torch.equal(garment.faces, cut.mesh.faces)
    assert (garment.name, garment.template, made.layers) == ("slacks", "bottoms", ("slacks",))
    assert garment.metadata["source"] == "file"
    assert "layers" not in made.metadata


def test_layers_are_simulated_as_one_and_come_back_apart(body: Body, clip: Clip) -> None:
    layers = tuple(join(fit_template(name, body), body) for name in ("bottoms", "tops"))
    made = simulate(clip, 0, layers, body, Carrying(), PARTS)
    assert made.layers == ("bottoms", "tops")
    under, over = made.garments
    for simulated, cloth in ((under, layers[0]), (over, layers[1])):
        garment = cloth.garment
        moved = skin(garment.mesh.vertices, garment.smooth_weights, made.transforms)
        torch.testing.assert_close(simulated.vertices, moved)
    assert over.metadata["wrong_side_percent"]["bottoms"] < 10.0
    assert "wrong_side_percent" not in under.metadata


def test_an_outer_layer_leaves_room_where_it_covers(body: Body) -> None:
    under, over = (join(fit_template(name, body), body) for name in ("bottoms", "tops"))
    points = over.garment.mesh.vertices[over.kept]
    room, heights = (
        inner_thickness(points, [(under.garment.mesh.vertices, under.garment.mesh.faces)]),
        points[:, 2],
    )
    top = float(under.garment.mesh.vertices[:, 2].max())
    assert not room[heights > top + 0.03].any()
    torch.testing.assert_close(room[heights < top - 0.03].median(), torch.tensor(LAYER_THICKNESS))
    assert not inner_thickness(points, ()).any()


def test_a_face_without_an_area_is_refused(body: Body) -> None:
    garment = fit_template("tops", body)
    vertices = garment.mesh.vertices.clone()
    a, b, c = garment.mesh.faces[0]
    vertices[c] = (vertices[a] + vertices[b]) / 2
    flat = replace(garment, mesh=replace(garment.mesh, vertices=vertices))
    with pytest.raises(InputError, match="garment tops: 1 faces have no area"):
        join(flat, body)
