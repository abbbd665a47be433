"""Scores of predictions before and after the finish; inside shares agree with those of the obstacle."""

from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
import trimesh

from evaluate.actions import Window
from evaluate.body_scores import body_scores, dressed_body
from evaluate.candidates import Candidate
from evaluate.case import make_case
from evaluate.judge import judge, score
from tests.dataset.altered import altered
from tests.evaluate.test_compare import capsule_body, simulated, tube_garment
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.methods.capabilities import FinishAware
from uvcloth.methods.method import Method


def test_inside_counts_what_lies_within_the_body() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.2)
    shape, faces = torch.tensor(ball.vertices).float(), torch.tensor(ball.faces).long()
    flat = torch.zeros(len(faces), dtype=torch.long)
    mesh = Mesh(shape, faces, shape[:, :2], faces)
    body = Body(
        "ball", mesh, Skeleton(("hips",), (-1,), torch.zeros(1, 3)), torch.ones(len(shape), 1), flat, flat, {}
    )

    generator = torch.Generator().manual_seed(0)
    points = 0.4 * torch.rand(2, 300, 3, generator=generator) - 0.2
    sheet = torch.arange(300).view(-1, 3)
    cloth = Mesh(points[0], sheet, points[0, :, :2], sheet)
    garment = Garment("g", "tops", cloth, torch.ones(300, 1), torch.ones(300, 1))
    transforms = torch.eye(3, 4).expand(2, 1, 3, 4)
    corners = torch.arange(300)[:, None].expand(-1, 3)
    case = make_case(
        (Window("a", "a", "", "g", None),),  # type: ignore[arg-type]
        clip_of_garment(points, sheet, points[0], transforms, 30.0, 0, {"clip": "a", "garment": "g"}),
        Outfit(body, (garment,)),
        {"g": (corners, torch.full((300, 3), 1 / 3))},
    )
    outside = 3.0 * points
    outside[outside.norm(dim=-1) < 0.25] = 1.0
    scores = score(case, points, outside).parts["g"]
    for frame in range(2):
        expected = 100.0 * float((points[frame].norm(dim=1) < 0.199).float().mean())
        assert float(scores["inside_percent_raw"][frame]) == pytest.approx(expected, abs=1.0)
    assert scores["inside_percent"].max() == 0.0
    assert (scores["squeezed_percent"] + scores["crossing_edges_percent"]).isfinite().all()


@dataclass(frozen=True)
class Raised(Method, FinishAware):
    """Its garment 40 cm above rest, where clearing leaves it alone, and 1 cm higher where none follows."""

    name: str = "raised"
    height: float = 0.41

    def before_finish(self) -> "Raised":
        return replace(self, height=0.4)

    def prepare(self, outfit: Outfit, device: torch.device) -> torch.Tensor:
        return outfit.garments[0].mesh.vertices + torch.tensor([0.0, 0.0, self.height])

    def step(
        self, prepared: torch.Tensor, state: Any, frames: BodyFrames
    ) -> tuple[Any, tuple[torch.Tensor, ...]]:
        return state, (prepared.expand(len(frames), -1, -1),)


def test_figures_before_the_finish_are_of_the_method_without_it() -> None:
    moved, garment = simulated(tube_garment("tops"), "02_04", torch.zeros(3)), tube_garment("tops")
    still = torch.eye(3, 4).expand_as(moved.transforms)
    moved = altered(moved, transforms=still, vertices=garment.mesh.vertices.expand_as(moved.vertices))
    window = Window("a", "02_04", "", "tops", None)  # type: ignore[arg-type]
    case = make_case((window,), moved, Outfit(capsule_body(), (garment,)), {})
    scores = judge(case, Candidate("raised", Raised(), 0.0, "", frozenset())).parts["tops"]
    assert scores["vertex_mean_mm_raw"].mean() == pytest.approx(410.0, abs=0.1)
    assert scores["vertex_mean_mm"].mean() == pytest.approx(400.0, abs=0.1)


def test_a_coarse_garment_is_inside_by_its_faces_while_no_vertex_is(body: Body) -> None:
    """Four flat sides around a torso: corners out of the body, sides through it."""
    shape = trimesh.creation.cylinder(radius=0.3, height=0.2, sections=4)
    shape.update_faces(abs(shape.face_normals[:, 2]) < 0.5)
    shape.remove_unreferenced_vertices()
    shape.apply_transform(trimesh.transformations.rotation_matrix(0.25 * torch.pi, [0, 0, 1]))
    shape.apply_translation([0.0, -0.05, 0.3])
    corners, faces = torch.tensor(shape.vertices).float(), torch.tensor(shape.faces).long()
    mesh = Mesh(corners, faces, corners[:, :2], faces)
    dressed = dressed_body(body, [mesh])
    tight = corners.clone()
    tight[:, :2] = corners.mean(0)[:2] + 0.55 * (corners - corners.mean(0))[:, :2]
    found = body_scores(dressed, torch.stack([corners, tight]), body.mesh.vertices.expand(2, -1, -1))
    assert found["inside_percent"].tolist() == [0.0, 0.0]
    assert found["inside_faces_percent"][0] == found["skin_percent"][0] == 0.0
    assert found["inside_faces_percent"][1] > 10.0
    assert found["skin_percent"][1] > 10.0


def test_forces_are_those_of_the_simulated_fabric() -> None:
    """Twice as heavy as the jersey of 0.2 kg/m2; numbers that are none are refused in one sentence."""
    garment = tube_garment("tops")
    window = Window("a", "02_04", "", "tops", None)  # type: ignore[arg-type]

    def mass(**settings: Any) -> float:
        clip = simulated(garment, "02_04", torch.zeros(3)).labelled(settings=settings)
        case = make_case((window,), clip, Outfit(capsule_body(), (garment,)), {})
        balance = case.looks["tops"].balance
        assert balance is not None
        return float(balance.energies.masses.sum())

    assert mass(fabric={"density": 0.4}) == pytest.approx(2.0 * mass())
    with pytest.raises(InputError, match=r"02_04_tops: .*fabric"):
        mass(fabric={"density": "heavy"})
