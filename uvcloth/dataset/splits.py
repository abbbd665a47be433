"""Splits of clips: those for training, those that choose the network to keep, and the record of both."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

from uvcloth.checkpoint import TrainingData
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.motion.index import INDEX

TRAINING_SPLITS = ("train", "validation")
"""The splits of an index that training uses: training, and validation, which chooses the network to keep."""


@dataclass(frozen=True)
class Holdout:
    """The choice of validation clips where the data has no index, and of the training frames."""

    holdout: Annotated[int, Between(2, 10**6)] = 8
    """Without an index.csv, every N-th clip is for validation, not for training."""
    rest_frames: Annotated[int, Between(0, 10**6)] = 15
    """Warm-up frames to leave out of training, in which cloth comes down from the rest shape. Validation
    leaves out the whole warm-up."""

    def __post_init__(self) -> None:
        """Raises InputError for a holdout below 2, and for a negative number of frames."""
        if self.holdout < 2:
            raise InputError(f"--holdout {self.holdout}: has to be 2 or more")
        if self.rest_frames < 0:
            raise InputError(f"--rest-frames {self.rest_frames}: has to be 0 or more")


def hold_out(clips: Sequence[SimulatedClip], holdout: Holdout, data: str) -> list[SimulatedClip]:
    """The clips with their splits, as their index has them; the warm-up of those to train on is cut short.

    Without an index every n-th validates, at least one where there are two or more. data: the folders that
    they come from, in words. Raises InputError if the index leaves none of either.
    """
    splits = [clip.split for clip in clips]
    if not any(splits):
        validating = range(len(clips))[holdout.holdout - 1 :: holdout.holdout] or range(len(clips))[1:][-1:]
        splits = ["validation" if place in validating else "train" for place in range(len(clips))]
    else:
        for split in TRAINING_SPLITS:
            if split not in splits:
                raise InputError(
                    f"{data}: holds no sequence for {split}; simulate clips of this split in {INDEX}"
                )
    return [
        cut_warm_up(clip.labelled(split=split), holdout.rest_frames)
        for clip, split in zip(clips, splits, strict=True)
    ]


def cut_warm_up(clip: SimulatedClip, rest_frames: int) -> SimulatedClip:
    """The clip; one of the split train gets a warm-up of at most `rest_frames`."""
    return replace(clip, warm_up=min(clip.warm_up, rest_frames)) if clip.split == "train" else clip


def of_split(clips: Iterable[SimulatedClip], split: str) -> list[SimulatedClip]:
    """The clips of a split."""
    return [clip for clip in clips if clip.split == split]


def captured_clips(clips: Iterable[SimulatedClip]) -> Iterator[tuple[str, str, str]]:
    """Yield name, person and split of each captured clip that the poses of some clips are from."""
    return ((name, person, clip.split) for clip in clips for name, person in clip.captured.items())


def training_data(clips: Sequence[SimulatedClip]) -> TrainingData:
    """The record of the clips that a model was trained on and chosen by, for its checkpoint."""
    subset = [clip for split in TRAINING_SPLITS for clip in of_split(clips, split)]
    return TrainingData(
        files={name: content for clip in subset for name, content in clip.files.items()},
        clips={
            split: {name: person for name, person, _ in captured_clips(of_split(subset, split))}
            for split in TRAINING_SPLITS
        },
    )
