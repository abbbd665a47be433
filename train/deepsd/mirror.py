"""Mirror images of outfits in motion, which double the data, since any mesh may be read."""

from dataclasses import replace

import torch

from uvcloth.geometry.mirror import counterparts, mirror_transforms
from uvcloth.methods.rig import pose_vectors

from .dataset import OutfitFrames


def mirror_outfit(frames: OutfitFrames) -> OutfitFrames:
    """The outfit across x = 0 with its frames, left and right joints changed, on a body taken as symmetric.

    Raises InputError naming a joint whose counterpart the skeleton lacks.
    """
    skeleton, graph = frames.body.skeleton, frames.graph
    across = torch.tensor([-1.0, 1.0, 1.0])
    other = counterparts(skeleton)
    transforms = mirror_transforms(frames.transforms, skeleton)
    return replace(
        frames,
        name=f"{frames.name}, mirrored",
        graph=replace(
            graph,
            points=graph.points * across,
            faces=tuple(faces.flip(1) for faces in graph.faces),
            offsets=graph.offsets * across,
            smooth=graph.smooth[:, other],
            closest=graph.closest[:, other],
            joint_areas=graph.joint_areas[other],
        ),
        vertices=frames.vertices * across,
        transforms=transforms,
        vectors=pose_vectors(skeleton.parents, transforms),
    )
