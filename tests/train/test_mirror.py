"""Mirror images of training clips."""

from dataclasses import replace

import pytest
import torch

from train.mirror import mirror_clips
from uvcloth.bodies.body import Body, load_body
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment
from uvcloth.garments.garment import Garment
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip

ACROSS = torch.tensor([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="module")
def dress(body: Body) -> Garment:
    return fit_template("dress", body)


def skinned_clip(body: Body, garment: Garment) -> SimulatedClip:
    """Four frames of the jump, the garment carried by the body's joints."""
    clip = load_clip("jump", body)
    transforms = clip.transforms()[[0, 12, 24, 36]]
    vertices = skin(garment.mesh.vertices, garment.weights, transforms)
    mesh, metadata = garment.mesh, {"clip": "jump", "garment": garment.name}
    return clip_of_garment(vertices, mesh.faces, mesh.vertices, transforms, clip.fps, 0, metadata)


def test_the_mirrored_garment_is_the_garment_on_the_mirrored_motion(body: Body, dress: Garment) -> None:
    clip = skinned_clip(body, dress)
    (image,) = mirror_clips([clip], body, [dress])
    torch.testing.assert_close(image.transforms, mirror_transforms(clip.transforms, body.skeleton))
    on_mirrored_motion = skin(dress.mesh.vertices, dress.weights, image.transforms)
    off = (image.vertices - on_mirrored_motion).norm(dim=2)
    moved = (clip.vertices - on_mirrored_motion).norm(dim=2)
    assert float(off.mean()) < 0.002
    assert float(moved.mean()) > 0.02


def test_the_image_of_the_image_is_the_clip(body: Body, dress: Garment) -> None:
    clip = skinned_clip(body, dress)
    again = mirror_clips(mirror_clips([clip], body, [dress]), body, [dress])
    off = (again[0].vertices - clip.vertices).norm(dim=2)
    assert float(off.mean()) < 0.002
    torch.testing.assert_close(again[0].transforms, clip.transforms)


def test_the_mirrored_transforms_place_the_mirrored_body(body: Body) -> None:
    transforms = skinned_clip(body, fit_template("tops", body)).transforms
    heads = torch.einsum("tjab,jb->tja", transforms[..., :3], body.skeleton.heads) + transforms[..., 3]
    image = mirror_transforms(transforms, body.skeleton)
    mirrored = torch.einsum("tjab,jb->tja", image[..., :3], body.skeleton.heads) + image[..., 3]
    left, right = (body.skeleton.names.index(f"{side}Foot") for side in ("Left", "Right"))
    torch.testing.assert_close(mirrored[:, left], heads[:, right] * ACROSS, atol=0.003, rtol=0)


def test_a_garment_that_is_not_symmetric_has_no_mirror_image(body: Body, dress: Garment) -> None:
    clip = skinned_clip(body, dress)
    one_sided = dress.mesh.vertices[dress.mesh.faces].mean(1)[:, 0] > -0.1
    cut = replace(dress, mesh=replace(dress.mesh, faces=dress.mesh.faces[one_sided]))
    assert mirror_clips([clip], body, [cut]) == []


@pytest.mark.parametrize(("aside", "symmetric"), [(0.001, True), (0.0025, False)])
def test_a_garment_may_lie_off_its_mirror_image_by_five_millimetres(
    body: Body, dress: Garment, aside: float, symmetric: bool
) -> None:
    there = dress.mesh.vertices + torch.tensor([aside, 0.0, 0.0])
    shifted = replace(dress, mesh=replace(dress.mesh, vertices=there))
    assert bool(mirror_clips([skinned_clip(body, dress)], body, [shifted])) is symmetric
