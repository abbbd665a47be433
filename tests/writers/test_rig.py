"""Rigs against what they stand for: blend shape weights, principal components and joint influences."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.small_body import small_body
from tests.writers.played import farthest, played, rolled_out
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.methods.method import Method
from uvcloth.methods.pbns.method import PBNS
from uvcloth.methods.rig import PoseRig, pose_vectors
from uvcloth.motion.clip import Clip
from uvcloth.rollouts.rollout import rollout
from uvcloth.writers.rig import rig_of


def test_the_rig_is_the_rollout(
    rolled: list[np.ndarray], pose_rig: PoseRig, outfit: Outfit, clip: Clip
) -> None:
    rigged = rig_of(pose_rig, outfit.body, clip)
    assert rigged.pruning == rigged.fewer == ()
    assert farthest(played(rigged.rig), rolled) < 1e-5
    still = replace(rigged.rig, weights=np.zeros_like(rigged.rig.weights))
    assert farthest(played(still), rolled) > 0.02  # The blend shapes matter here.


def test_every_weight_uses_the_whole_range(pbns: PBNS, outfit: Outfit, clip: Clip, practice: Clip) -> None:
    rigged = rig_of(pbns.as_rig(outfit.body), outfit.body, clip)
    known = torch.cat([pbns.network.poses, pose_vectors(pbns.garments.parents, clip.transforms())])
    with torch.no_grad():
        weights = rigged.code.weights(pbns.network.embed(known))
    np.testing.assert_allclose(weights.amin(0), 0.0, atol=1e-5)
    np.testing.assert_allclose(weights.amax(0), 1.0, atol=1e-5)
    practised = rig_of(pbns.as_rig(outfit.body), outfit.body, practice)
    assert rigged.code.scale.abs().sum() < 0.95 * practised.code.scale.abs().sum()  # The clip went further.


def test_shapes_that_nothing_moves_are_left_out(pbns: PBNS, outfit: Outfit) -> None:
    with torch.no_grad():
        embeddings = pbns.network.embed(pbns.network.poses)
    moving = int((embeddings.amax(0) > embeddings.amin(0)).sum())
    assert moving < pbns.config.width
    assert len(rig_of(pbns.as_rig(outfit.body), outfit.body).rig.resting) == moving


@pytest.mark.parametrize("count", [1, 4, 9])
def test_fewer_shapes_are_the_best_there_are(pbns: PBNS, outfit: Outfit, count: int) -> None:
    """The error that is left is what numpy's SVD of all deformations leaves (Eckart and Young)."""
    rigged = rig_of(pbns.as_rig(outfit.body), outfit.body, shapes=count)
    with torch.no_grad():
        embeddings = pbns.network.embed(pbns.network.poses)
        deformed = (embeddings @ pbns.network.shapes).double().numpy()
        restored = rigged.code.restored(rigged.code.weights(embeddings)) @ pbns.network.shapes
    left = np.linalg.norm(deformed - restored.numpy())
    values = np.linalg.svd(deformed - deformed.mean(0), compute_uv=False)
    assert left == pytest.approx(np.linalg.norm(values[count:]), rel=1e-3)
    apart = np.linalg.norm((deformed - restored.numpy()).reshape(len(deformed), -1, 3), axis=-1)
    (cost,) = rigged.fewer
    assert (cost.mean, cost.most) == pytest.approx((apart.mean(), apart.max()), rel=1e-3)


def test_the_cost_of_fewer_shapes_is_what_the_rig_misses(pbns: PBNS, outfit: Outfit, clip: Clip) -> None:
    rigged = rig_of(pbns.as_rig(outfit.body), outfit.body, clip, shapes=6)
    expected = rolled_out(pbns, outfit, clip)
    apart = [np.linalg.norm(a - b, axis=-1) for a, b in zip(played(rigged.rig), expected, strict=True)]
    cost = rigged.fewer[1]
    assert cost.over == "wave"
    # Blended joints shorten what they turn, so the posed error is a little below that at rest.
    assert np.concatenate(apart, axis=1).mean() == pytest.approx(cost.mean, rel=0.05)
    assert farthest(played(rigged.rig), expected) < 1.05 * cost.most


def test_the_cost_of_four_influences_is_what_the_rig_misses(
    make_pbns: Callable[..., PBNS], outfit: Outfit, clip: Clip
) -> None:
    many = make_pbns(influences=7)
    rigged = rig_of(many.as_rig(outfit.body), outfit.body, clip)
    assert all(garment.joints.shape[1] == 4 for garment in rigged.rig.garments)
    expected = rolled_out(many, outfit, clip)
    apart = [np.linalg.norm(a - b, axis=-1) for a, b in zip(played(rigged.rig), expected, strict=True)]
    trained, cost = rigged.pruning
    assert 0 < trained.mean < cost.mean
    # The cost is that of the skinned rest shape, without blend shapes.
    assert np.concatenate(apart, axis=1).mean() == pytest.approx(cost.mean, rel=0.3)
    assert farthest(played(rigged.rig), expected) == pytest.approx(cost.most, rel=0.3)


def test_the_rest_pose_is_held_without_a_motion(model: Method, pose_rig: PoseRig, outfit: Outfit) -> None:
    rig = rig_of(pose_rig, outfit.body).rig
    assert len(rig.transforms) == len(rig.weights) == 0
    still = torch.eye(3, 4).expand(1, len(rig.skeleton.names), 3, 4)
    posed = replace(rig, weights=rig.resting[None], transforms=still.numpy())
    frame = next(rollout(model, outfit, still, 30.0, clear=False))
    assert farthest(played(posed), [vertices[None].numpy() for vertices in frame.vertices]) < 1e-5


def test_normals_are_exact_in_the_usual_pose_and_close_around_it(pbns: PBNS, outfit: Outfit) -> None:
    rigged = rig_of(pbns.as_rig(outfit.body), outfit.body)
    garment = rigged.rig.garments[0]
    faces, changes = garment.mesh.faces, garment.normal_shapes()
    start = vertex_normals(garment.mesh.vertices, faces)
    with torch.no_grad():
        trained = rigged.code.weights(pbns.network.embed(pbns.network.poses))
    for weights, limit in ((garment.usual[None], 1e-4), (trained, 0.01)):
        surfaces = garment.mesh.vertices + torch.tensordot(weights, garment.shapes, 1)
        true = vertex_normals(surfaces, faces)
        written = torch.nn.functional.normalize(start + torch.tensordot(weights, changes, 1), dim=-1)
        assert (written - true).norm(dim=-1).mean() < limit
    assert (start - true).norm(dim=-1).mean() > 0.05


@pytest.mark.parametrize(
    ("shapes", "words"),
    [
        (0, "--shapes 0: has to be from 1 to 24"),
        (25, "--shapes 25: has to be from 1 to 24"),
        (24, "--shapes 24: the training poses need no more than"),
    ],
)
def test_impossible_numbers_of_shapes_are_refused(
    pbns: PBNS, outfit: Outfit, shapes: int, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        rig_of(pbns.as_rig(outfit.body), outfit.body, shapes=shapes)


def test_another_body_and_a_clip_on_another_rig_are_refused(pbns: PBNS, body: Body, clip: Clip) -> None:
    with pytest.raises(InputError, match="trained on another body than 'box'"):
        pbns.as_rig(small_body())
    skeleton = body.skeleton
    taller = replace(body, skeleton=replace(skeleton, heads=skeleton.heads * 1.1))
    with pytest.raises(InputError, match="trained on another body"):
        pbns.as_rig(taller)
    renamed = Skeleton(tuple(f"b{name}" for name in skeleton.names), skeleton.parents, skeleton.heads)
    with pytest.raises(InputError, match="clip wave: its skeleton is not"):
        rig_of(pbns.as_rig(body), body, replace(clip, skeleton=renamed))


def test_a_model_that_never_deforms_is_refused(pbns: PBNS, body: Body) -> None:
    sizes = (len(pbns.network.owner), len(pbns.network.strongest), len(body.skeleton.names))
    one = replace(pbns, network=type(pbns.network)(pbns.config, *sizes, 1))
    torch.nn.init.zeros_(one.network.shapes)
    with pytest.raises(InputError, match="none of its training poses moves"):
        rig_of(one.as_rig(body), body)
