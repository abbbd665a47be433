"""The training data of DeePSD: outfits as graphs, with frames of what they did and poses of their bodies."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch
from rich.progress import track
from torch import Tensor

from train.clips import TRAINING_SPLITS
from train.pbns.poses import Poses
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import first_of
from uvcloth.methods.deepsd.outfit_graph import OutfitGraph, outfit_graph
from uvcloth.methods.rig import pose_vectors
from uvcloth.motion.index import require_one_split
from uvcloth.simulate.cloth3d import is_cloth3d, load_cloth3d
from uvcloth.simulate.outfit_sequence import OutfitSequence, load_outfit_sequences


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
            chosen = self.rows[samples]
            outfits = [self.training[index] for index in chosen[:, 0].tolist()]
            first = chosen[:, 1:]
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
    balanced: as OutfitDataset has it. Raises InputError as `load_outfit_sequences` does, if a split has no
    outfit, for a person in two splits, and if bodies differ in mesh or skeleton.
    """
    sequences = [sequence for folder in folders for sequence in _named(folder, len(folders) > 1)]
    source = " ".join(map(str, folders))
    require_one_split(source, ((each.clip, each.subject, each.split) for each in sequences))
    for split in TRAINING_SPLITS:
        if not any(sequence.split == split for sequence in sequences):
            raise InputError(f"{source}: holds no outfit for {split}, training needs some")
    first = sequences[0].outfit.body
    for sequence in sequences:
        if sequence.outfit.body.identity.topology != first.identity.topology:
            raise InputError(
                f"{source}: outfit {sequence.name} is on a body of another mesh or skeleton than outfit "
                f"{sequences[0].name}; one model learns one kind of body"
            )
    data = TrainingData(
        files={name: digest for sequence in sequences for name, digest in sequence.files.items()},
        clips={
            split: {s.clip: s.subject for s in sequences if s.split == split} for split in TRAINING_SPLITS
        },
    )
    training, held = (_grouped(sequences, split, rest_frames) for split in TRAINING_SPLITS)
    return OutfitDataset(training, held, data, balanced)


def _named(folder: Path, among_others: bool) -> list[OutfitSequence]:
    """The sequences of a folder; among others it is part of their names, which two folders may share."""
    sequences = outfit_sequences(folder)
    if not among_others:
        return sequences
    return [
        replace(
            sequence,
            name=f"{folder.name}/{sequence.name}",
            files={f"{folder.name}/{name}": digest for name, digest in sequence.files.items()},
        )
        for sequence in sequences
    ]


def outfit_sequences(folder: Path) -> list[OutfitSequence]:
    """The training and validation sequences of a folder, simulated here or in the layout of CLOTH3D."""
    if is_cloth3d(folder):
        return load_cloth3d(folder, TRAINING_SPLITS)
    return load_outfit_sequences(folder, TRAINING_SPLITS)


def posed_outfit(outfit: Outfit, poses: Poses) -> OutfitDataset:
    """One outfit in the poses of a database alone, without a simulation: what physics needs."""
    skeleton = outfit.body.skeleton
    graph = outfit_graph(outfit)
    frames = []
    for split in TRAINING_SPLITS:
        transforms = poses.database.of(split).transforms(skeleton)
        vectors = pose_vectors(skeleton.parents, transforms)
        frames.append(OutfitFrames("outfit", outfit, graph, graph.points[:0, None], transforms, vectors))
    return OutfitDataset((frames[0],), (frames[1],), poses.data)


def _grouped(sequences: Sequence[OutfitSequence], split: str, rest_frames: int) -> tuple[OutfitFrames, ...]:
    """The outfits of a split, each with the scored frames of all its sequences."""
    own: dict[str, list[OutfitSequence]] = {}
    for sequence in sequences:
        if sequence.split == split:
            own.setdefault(sequence.name, []).append(sequence)
    teaches = split == TRAINING_SPLITS[0]
    described = track(own.items(), f"{split} outfits", transient=True)
    return tuple(_frames(name, parts, rest_frames if teaches else None) for name, parts in described)


def _frames(name: str, parts: Sequence[OutfitSequence], rest_frames: int | None) -> OutfitFrames:
    """The scored frames of an outfit's sequences; without `rest_frames` none of their warm-up."""
    outfit = parts[0].outfit
    graph = outfit_graph(outfit)
    kept = first_of(graph.owner)
    starts = [part.warm_up if rest_frames is None else min(part.warm_up, rest_frames) for part in parts]
    transforms = torch.cat([part.transforms[start:] for part, start in zip(parts, starts, strict=True)])
    return OutfitFrames(
        name=name,
        outfit=outfit,
        graph=graph,
        vertices=torch.cat([part.vertices[start:, kept] for part, start in zip(parts, starts, strict=True)]),
        transforms=transforms,
        vectors=pose_vectors(outfit.body.skeleton.parents, transforms),
    )
