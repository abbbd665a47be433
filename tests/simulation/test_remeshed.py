"""Another mesh of a garment, and the simulation on it that comes back to the garment's own vertices."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

import pytest
import torch

from rasterize.charts import boundary_loops
from tests.simulation.physics.scenes import sheet
from uvcloth.bodies.body import Body
from uvcloth.dataset.folder import MEMBERS
from uvcloth.errors import InputError
from uvcloth.garments.cage import Cage
from uvcloth.garments.joined import EngineMesh, join
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import boundary_edges, edge_lengths, join_meshes, unique_edges
from uvcloth.physics.fabric import FABRICS, Fabric
from uvcloth.simulation.blender import Blender
from uvcloth.simulation.engine import Frame, Scene
from uvcloth.simulation.members import member_engine
from uvcloth.simulation.remeshed import Remeshed, other_mesh

pytest.importorskip("pyacvd")


@dataclass(frozen=True)
class Falling:
    """An engine under which cloth falls off the skinned garment, faster and faster, and remembers how far."""

    fabric: Fabric = FABRICS["jersey"]
    substeps: float = 8.0

    def describe(self) -> dict[str, Any]:
        return {"engine": "falling", "versions": {}, "settings": {"substeps": self.substeps}}

    def with_fabric(self, fabric: Fabric) -> Self:
        return replace(self, fabric=fabric)

    def with_more_substeps(self, share: float) -> Self:
        return replace(self, substeps=(1.0 + share) * self.substeps)

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        fallen = (
            torch.zeros_like(scene.rest)
            if after is None or after.memory is None
            else after.memory.view(-1, 3)
        )
        for index in range(0 if after is None else after.index + 1, len(scene.skinned)):
            fallen = fallen - torch.tensor([0.0, 0.0, 0.001]) * index
            yield Frame(index, scene.skinned[index] + fallen, fallen.flatten())


@pytest.fixture(scope="module")
def dress(body: Body) -> EngineMesh:
    return join(fit_template("dress", body), body)


@pytest.fixture(scope="module")
def rest(dress: EngineMesh) -> torch.Tensor:
    return dress.garment.mesh.vertices[dress.kept]


@pytest.fixture(scope="module")
def mesh(dress: EngineMesh, rest: torch.Tensor) -> Cage:
    return other_mesh(rest, dress.faces)


@pytest.fixture
def scene(dress: EngineMesh, rest: torch.Tensor) -> Scene:
    """Four frames in which the skinned dress goes forwards and widens."""
    skinned = torch.stack([(1.0 + 0.1 * frame) * rest for frame in range(4)])
    return Scene(
        rest=rest,
        faces=dress.faces,
        band=dress.band.vertices[dress.kept],
        mass_factor=torch.ones(len(rest)),
        inner_thickness=torch.zeros(len(rest)),
        skinned=skinned,
        collider=torch.zeros(4, 0, 3),
        collider_parts=(),
        touches=torch.zeros(0, len(rest), dtype=torch.bool),
        fps=30.0,
    )


def test_it_is_another_mesh_of_the_same_surface(dress: EngineMesh, rest: torch.Tensor, mesh: Cage) -> None:
    points = mesh.at_cage(rest)
    assert 0.97 * len(rest) < len(points) <= len(rest)
    own, other = (edge_lengths(v, unique_edges(f)) for v, f in ((rest, dress.faces), (points, mesh.faces)))
    assert float(other.median()) == pytest.approx(float(own.median()), rel=0.1)
    assert float(torch.cdist(points, rest).amin(1).median()) > 0.002
    back = (mesh.at_garment(points) - rest).norm(dim=1)
    assert float(back.mean()) < 0.001
    assert float(back.max()) < 0.01


def test_edges_have_the_length_that_is_asked_for() -> None:
    """Also where the surface has fewer and larger triangles; its four corners are cut off."""
    vertices, faces = sheet(0.3, 0.2, 7, 5)
    mesh = other_mesh(vertices, faces, 0.012)
    lengths = edge_lengths(mesh.vertices, unique_edges(mesh.faces))
    assert float(lengths.mean()) == pytest.approx(0.012, rel=0.1)
    off = (mesh.at_garment(mesh.at_cage(vertices)) - vertices).norm(dim=1).sort().values
    assert float(off[-5]) < 1e-3
    assert float(off[-1]) < 0.012


def test_hems_lie_on_hems(dress: EngineMesh, rest: torch.Tensor, mesh: Cage) -> None:
    assert len(boundary_loops(mesh.faces.numpy())) == len(boundary_loops(dress.faces.numpy()))
    start, end = rest[boundary_edges(dress.faces)].unbind(1)
    rim = mesh.at_cage(rest)[boundary_edges(mesh.faces).unique()]
    along = end - start
    share = ((rim[:, None] - start) * along).sum(-1) / along.square().sum(-1)
    on_line = start + share.clamp(0, 1)[..., None] * along
    assert float((on_line - rim[:, None]).norm(dim=-1).amin(1).max()) < 0.001


def test_the_same_surface_gives_the_same_mesh(dress: EngineMesh, rest: torch.Tensor, mesh: Cage) -> None:
    again = other_mesh(rest, dress.faces)
    assert torch.equal(again.faces, mesh.faces)
    assert torch.equal(again.weights, mesh.weights)


def test_each_piece_stays_a_piece(dress: EngineMesh, rest: torch.Tensor) -> None:
    """Layers of an outfit are not mixed, however near."""
    both = join_meshes([(rest, dress.faces), (1.002 * rest, dress.faces)])
    mesh = other_mesh(both.vertices, both.faces)
    inner = (mesh.corners < len(rest)).all(1)
    assert bool((inner | (mesh.corners >= len(rest)).all(1)).all())
    assert torch.equal(
        inner[mesh.own_corners], torch.arange(2 * len(rest))[:, None].expand(-1, 3) < len(rest)
    )


def test_cloth_comes_back_to_the_vertices_of_the_scene(scene: Scene) -> None:
    frames = list(Remeshed(Falling()).simulate(scene))
    fallen = torch.tensor([0.0, 0.001, 0.003, 0.006])
    expected = scene.skinned - fallen[:, None, None] * torch.tensor([0.0, 0.0, 1.0])
    assert (torch.stack([frame.vertices for frame in frames]) - expected).abs().max() < 1e-5


def test_it_goes_on_from_what_a_frame_remembers(scene: Scene) -> None:
    engine = Remeshed(Falling())
    frames = list(engine.simulate(scene))
    assert frames[1].memory is not None
    for again, frame in zip(engine.simulate(scene, frames[1]), frames[2:], strict=True):
        assert torch.equal(again.vertices, frame.vertices)


def test_members_differ_in_substeps_and_mesh() -> None:
    usual, stepped, meshed, both = (member_engine(Falling(), member) for member in range(MEMBERS))
    assert (usual, stepped) == (Falling(), Falling(substeps=12.0))
    assert (meshed, both) == (Remeshed(Falling()), Remeshed(Falling(substeps=12.0)))
    assert both.describe()["settings"] == {"substeps": 12.0, "mesh": "remeshed"}
    assert both.with_fabric(FABRICS["silk"]) == Remeshed(Falling(FABRICS["silk"], 12.0))
    even = Remeshed(Falling(), 0.012)
    assert member_engine(even, 1) == Remeshed(Falling(substeps=12.0), 0.012)
    assert member_engine(even, 3) == Remeshed(Falling(substeps=12.0), 0.95 * 0.012)
    assert even.describe()["settings"] == {"substeps": 8.0, "mesh": "remeshed", "edge": 0.012}
    with pytest.raises(InputError, match=r"members need the explicit engine, blender\.cloth cannot change"):
        member_engine(Blender("python", "4.5.15"), 1)
