"""Outfits on the joints of a character's file instead of those of our bodies."""

from dataclasses import replace

import torch
from torch import Tensor

from uvcloth.characters.joints import OwnJoints
from uvcloth.garments.garment import Garment, Outfit


def on_own_joints(outfit: Outfit, joints: OwnJoints) -> Outfit:
    """The outfit of a character on the joints of its file: those of ours that one of them moves are one.

    The body keeps its surface, and the joints our names, by which roles are told; it has no proxies and no
    appearance any more.
    """

    def merged(weights: Tensor) -> Tensor:
        """Weights (V, J) of our joints as those (V, U) of the character's."""
        count = len(joints.skeleton.names)
        return torch.zeros(len(weights), count).index_add(1, joints.mover, weights)

    def rebound(garment: Garment) -> Garment:
        weights, smooth = merged(garment.weights), merged(garment.smooth_weights)
        return replace(garment, weights=weights, smooth_weights=smooth)

    body = replace(
        outfit.body,
        skeleton=replace(joints.skeleton, names=joints.names),
        weights=merged(outfit.body.weights),
        proxies={},
        appearance=None,
    )
    return Outfit(body, tuple(map(rebound, outfit.garments)))
