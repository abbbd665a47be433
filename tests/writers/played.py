"""Garments as `uvcloth rollout` makes them, and as the numbers of a rig say."""

import numpy as np
import torch

from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method
from uvcloth.motion.clip import Clip
from uvcloth.rollouts.rollout import rollout
from uvcloth.writers.rig import Rig


def rolled_out(method: Method, outfit: Outfit, clip: Clip) -> list[np.ndarray]:
    """Per garment (F, N, 3): what `uvcloth rollout` makes of the clip."""
    frames = [frame.vertices for frame in rollout(method, outfit, clip.transforms(), clip.fps, clear=False)]
    return [torch.stack(parts).numpy() for parts in zip(*frames, strict=True)]


def played(rig: Rig) -> list[np.ndarray]:
    """Per garment (F, N, 3): blend shapes, then skinning, written out."""
    made = []
    for garment in rig.garments:
        rest = garment.mesh.vertices.numpy() + np.einsum("fk,knc->fnc", rig.weights, garment.shapes.numpy())
        blended = np.einsum("ni,fniab->fnab", garment.weights, rig.transforms[:, garment.joints])
        made.append(np.einsum("fnab,fnb->fna", blended[..., :3], rest) + blended[..., 3])
    return made


def farthest(made: list[np.ndarray], expected: list[np.ndarray]) -> float:
    return max(float(np.linalg.norm(a - b, axis=-1).max()) for a, b in zip(made, expected, strict=True))
