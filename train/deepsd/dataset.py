"""The training data of DeePSD: outfits as graphs, with frames of what they did and poses of their bodies."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from rich.progress import track
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.cloth3d import is_cloth3d, load_cloth3d
from uvcloth.dataset.reader import read_outfit_clips
from uvcloth.dataset.rows import joined_rows
from uvcloth.dataset.splits import TRAINING_SPLITS, captured_clips, cut_warm_up, of_split, training_data
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import first_of
from uvcloth.methods.deepsd.outfit_graph import OutfitGraph, outfit_graph
from uvcloth.methods.rig import pose_vectors
from uvcloth.motion.index import require_one_split

from ..pbns.poses import BodyPoses


@dataclass(frozen=True)
class OutfitFrames:
    """An outfit of U points in F scored frames.

    vertices: (F, U, 3) m, world, as simulated; none, (0, U, 3), where it is known in no pose. transforms:
    (F, J, 3, 4) of its body. vectors: (F, 3 J), the pose as the network sees it.
    """

    name: str
    outfit: Outfit
    graph: OutfitGraph
    vertices: Tensor
    transforms: Tensor
    vectors: Tensor

    @property
    def body(self) -> Body:
        """The body that it is on."""
        return self.outfit.body


@dataclass(frozen=True)
class OutfitDataset:
    """Outfits of training and validation, all on bodies of one mesh and skeleton.

    data: the record of files and clips for the checkpoint. balanced: whether outfits are drawn alike, however
    many frames there are of each; if not, frames are.
    """

    training: tuple[OutfitFrames, ...]
    held: tuple[OutfitFrames, ...]
    data: TrainingData
    balanced: bool = False

    @property
    def samples(self) -> Tensor:
        """The rows that a step may draw: numbers of outfits if they are balanced, otherwise of rows."""
        return torch.arange(len(self.training) if self.balanced else len(self.rows))

    def draw(self, samples: Tensor, each: int) -> tuple[list[OutfitFrames], list[Tensor]]:
        """The outfits of samples (B,), and `each` frames of each one at random, with the sample's own first.

        Where there is one outfit alone it is given once, with the frames of all.
        """
        if not self.balanced:
            pairs = self.rows[samples]
            outfits = [self.training[index] for index in pairs[:, 0].tolist()]
            first = pairs[:, 1:]
        else:
            outfits = [self.training[index] for index in samples.tolist()]
            first = torch.zeros(len(samples), 0, dtype=torch.int64)
        counts = torch.tensor([len(outfit.vectors) for outfit in outfits])
        others = (torch.rand(len(samples), each - first.shape[1]) * counts[:, None]).long()
        frames = torch.cat([first, others], dim=1)
        if len(self.training) == 1:
            return outfits[:1], [frames.flatten()]
        return outfits, list(frames)

    @cached_property
    def rows(self) -> Tensor:
        """The training frames (S, 2) int64: which outfit, and which frame of it."""
        return torch.cat(
            [
                torch.stack([torch.full((count,), index), torch.arange(count)], dim=1)
                for index, count in enumerate(len(outfit.vectors) for outfit in self.training)
            ]
        )

    @cached_property
    def vectors(self) -> Tensor:
        """The poses of all training frames (S, 3 J), in the order of `rows`."""
        return torch.cat([outfit.vectors for outfit in self.training])

    @cached_property
    def rotations(self) -> Tensor:
        """The joints' world rotations (S, J, 3, 3) in all training frames, in the order of `rows`."""
        return torch.cat([outfit.transforms[..., :3] for outfit in self.training])

    @property
    def body(self) -> Body:
        """The body of the first outfit."""
        return self.training[0].body


def read_outfits(folders: Sequence[Path], rest_frames: int, *, balanced: bool = False) -> OutfitDataset:
    """Read the training and validation outfits of some folders.

    rest_frames: first frames that training leaves out; validation leaves out the whole warm-up.
    balanced: as OutfitDataset has it. Raises InputError as `read_outfit_clips` does, if a split has no
    outfit, for a person in two splits, and if bodies differ in mesh or skeleton.
    """
    dressed = [each for folder in folders for each in _named(folder, len(folders) > 1)]
    clips = [clip for _, clip in dressed]
    source = " ".join(map(str, folders))
    require_one_split(source, captured_clips(clips))
    for split in TRAINING_SPLITS:
        if not of_split(clips, split):
            raise InputError(f"{source}: holds no outfit for {split}, training needs at least one")
    kinds = [outfit.body.identity.topology for outfit, _ in dressed]
    for kind, clip in zip(kinds, clips, strict=True):
        if kind != kinds[0]:
            raise InputError(
                f"{source}: outfit {clip.outfit} is on a body of another mesh or skeleton than outfit "
                f"{clips[0].outfit}; one model learns one kind of body"
            )
    cut = [(outfit, cut_warm_up(clip, rest_frames)) for outfit, clip in dressed]
    training, held = (_grouped(cut, split) for split in TRAINING_SPLITS)
    return OutfitDataset(training, held, training_data(clips), balanced)


def _named(folder: Path, among_others: bool) -> list[tuple[Outfit, SimulatedClip]]:
    """The clips of a folder; among others it is part of outfits' names, which two folders may share."""
    dressed = outfit_clips(folder)
    if not among_others:
        return dressed
    return [
        (outfit, clip.from_folder(folder.name).labelled(outfit=f"{folder.name}/{clip.outfit}"))
        for outfit, clip in dressed
    ]


def outfit_clips(folder: Path) -> list[tuple[Outfit, SimulatedClip]]:
    """The training and validation clips of a folder, simulated here or in the layout of CLOTH3D."""
    if is_cloth3d(folder):
        return load_cloth3d(folder, TRAINING_SPLITS)
    return read_outfit_clips(folder, TRAINING_SPLITS)


def posed_outfit(outfit: Outfit, poses: BodyPoses) -> OutfitDataset:
    """One outfit in the poses of a database alone, without a simulation: what physics needs."""
    skeleton = outfit.body.skeleton
    graph = outfit_graph(outfit)
    frames = []
    for split in TRAINING_SPLITS:
        transforms = poses.database.of(split).transforms(skeleton)
        vectors = pose_vectors(skeleton.parents, transforms)
        frames.append(OutfitFrames("outfit", outfit, graph, graph.points[:0, None], transforms, vectors))
    return OutfitDataset((frames[0],), (frames[1],), poses.data)


def _grouped(dressed: Sequence[tuple[Outfit, SimulatedClip]], split: str) -> tuple[OutfitFrames, ...]:
    """The outfits of a split, each with the scored frames of all its clips."""
    outfits: dict[str, tuple[Outfit, list[SimulatedClip]]] = {}
    for outfit, clip in dressed:
        if clip.split == split:
            outfits.setdefault(clip.outfit, (outfit, []))[1].append(clip)
    described = track(outfits.items(), f"{split} outfits", transient=True)
    return tuple(_frames(name, outfit, clips) for name, (outfit, clips) in described)


def _frames(name: str, outfit: Outfit, clips: Sequence[SimulatedClip]) -> OutfitFrames:
    """The scored frames of an outfit's clips."""
    graph = outfit_graph(outfit)
    kept, transforms = first_of(graph.owner), joined_rows(clips, 0).transforms
    return OutfitFrames(
        name=name,
        outfit=outfit,
        graph=graph,
        vertices=torch.cat([clip.vertices[clip.warm_up :, kept] for clip in clips]),
        transforms=transforms,
        vectors=pose_vectors(outfit.body.skeleton.parents, transforms),
    )
