"""t-SNE maps of the judged motion beside that of training (Motion-guided, Figure 5)."""

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.methods.motion_guided.seeds import pose_seeds, sample_seeds

from .candidates import Candidate
from .case import SHOWN
from .report import MotionMap
from .show import Shown

SEEDS = 581
"""Number of points on the body that describe a pose."""

PERPLEXITY = 30.0
"""Perplexity of t-SNE, about the number of neighbours of a frame; lower for few frames."""


def motion_maps(
    candidates: Sequence[Candidate], data: Path, shown: Sequence[Shown], body: Body
) -> list[MotionMap]:
    """One map for the methods of each training set, all from one t-SNE; none if nothing was trained.

    Training motion is that of the sequences in a checkpoint's record, as far as the data folder contains
    them. Test motion is that of the judged windows. Of each clip at most SHOWN frames are used, evenly
    spaced, without the warm-up. Raises InputError for a file of the folder that is not a sequence.
    """
    trained = [candidate for candidate in candidates if candidate.training_content]
    if not trained:
        return []
    known = _training_motion(
        data, frozenset[str]().union(*(candidate.training_content for candidate in trained))
    )
    motion = {("test", each.clip): each.transforms for each in shown}
    motion |= {("training", clip): transforms for clip, transforms in known.values()}
    poses = [seed_positions(body, transforms) for transforms in motion.values()]
    places = embedded(torch.cat(poses)).split([len(frames) for frames in poses])
    placed = dict(zip(motion, places, strict=True))
    of_action: dict[str, dict[str, None]] = {}
    for each in shown:
        of_action.setdefault(each.action, {})[each.clip] = None
    tests = {
        action: torch.cat([placed["test", clip] for clip in clips]) for action, clips in of_action.items()
    }
    maps = []
    for contents in dict.fromkeys(candidate.training_content for candidate in trained):
        clips_read = [known[content][0] for content in known if content in contents]
        frames = [placed["training", clip] for clip in dict.fromkeys(clips_read)]
        maps.append(
            MotionMap(
                methods=tuple(
                    candidate.name for candidate in trained if candidate.training_content == contents
                ),
                count=len(clips_read),
                of=len(contents),
                seeds=SEEDS,
                training=torch.cat([torch.zeros(0, 2), *frames]),
                tests=tests,
            )
        )
    return maps


def _training_motion(data: Path, contents: frozenset[str]) -> dict[str, tuple[str, Tensor]]:
    """By content hash in `contents`: the clip, and (F, J, 3, 4) of its frames."""
    motion = {}
    for path in sorted(Path(data).glob("*.npz")):
        clip = load_simulated(path)
        content = clip.files[path.name]
        if content in contents:
            transforms = clip.transforms[clip.warm_up :]
            motion[content] = (clip.name, transforms[:: max(1, -(-len(transforms) // SHOWN))])
    return motion


def seed_positions(body: Body, transforms: Tensor) -> Tensor:
    """Positions of SEEDS points of the posed body, seen from its root: (F, 3 SEEDS), m.

    The root's position is subtracted and its heading, the part of its rotation about the vertical, is undone:
    place and direction of the body have no effect. transforms: (F, J, 3, 4).
    """
    points = pose_seeds(sample_seeds(body, SEEDS), transforms).points
    root = body.skeleton.parents.index(-1)
    rotation = transforms[:, root, :, :3]
    position = rotation @ body.skeleton.heads[root] + transforms[:, root, :, 3]
    heading = torch.atan2(rotation[:, 1, 0] - rotation[:, 0, 1], rotation[:, 0, 0] + rotation[:, 1, 1])
    x, y, z = (points - position[:, None]).unbind(-1)
    cos, sin = heading.cos()[:, None], heading.sin()[:, None]
    return torch.cat([cos * x + sin * y, cos * y - sin * x, z], dim=1)


def embedded(poses: Tensor) -> Tensor:
    """t-SNE of poses (P, C): (P, 2) in the unit square, always the same for the same poses."""
    from sklearn.manifold import TSNE

    perplexity = min(PERPLEXITY, (len(poses) - 1) / 3)
    if perplexity < 1:
        return torch.full((len(poses), 2), 0.5)
    places = TSNE(perplexity=perplexity, init="pca", random_state=0).fit_transform(poses.numpy())
    low, high = places.min(0), places.max(0)
    return torch.from_numpy(0.5 + (places - (low + high) / 2) / (high - low).max())
