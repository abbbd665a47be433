"""Mirror images of outfits in motion."""

import torch

from train.deepsd.dataset import OutfitDataset
from train.deepsd.mirror import mirror_outfit
from uvcloth.geometry.skinning import skin


def test_a_mirrored_outfit_moves_as_its_own_weights_and_poses_say(dataset: OutfitDataset) -> None:
    """Skinned with its own weights in its own poses it is the mirror image of the other, skinned."""
    for frames in dataset.training:
        mirrored = mirror_outfit(frames)
        across = torch.tensor([-1.0, 1.0, 1.0])
        as_it_is = skin(frames.graph.points, frames.graph.smooth, frames.transforms)
        as_seen = skin(mirrored.graph.points, mirrored.graph.smooth, mirrored.transforms)
        assert (as_seen - as_it_is * across).abs().max() < 1e-5
        assert torch.allclose(mirrored.vertices, frames.vertices * across)
        assert torch.allclose(mirrored.graph.normals, frames.graph.normals * across, atol=1e-5)


def test_mirrored_twice_is_the_outfit(dataset: OutfitDataset) -> None:
    for frames in dataset.training:
        again = mirror_outfit(mirror_outfit(frames))
        assert torch.equal(again.graph.points, frames.graph.points)
        assert torch.equal(again.graph.faces[0], frames.graph.faces[0])
        assert torch.equal(again.graph.smooth, frames.graph.smooth)
        assert torch.allclose(again.vectors, frames.vectors, atol=1e-6)
