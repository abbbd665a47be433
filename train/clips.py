"""Simulated sequences as training data: the garments of one clip side by side."""

from collections.abc import Mapping
from collections.abc import Sequence as List
from dataclasses import dataclass, replace
from pathlib import Path

from rich.progress import track
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData
from uvcloth.errors import InputError
from uvcloth.motion.index import INDEX, Entry, read_index, require_one_split
from uvcloth.simulate.bodies import sequence_body
from uvcloth.simulate.sequence import (
    REST_TOLERANCE,
    SimulatedSequence,
    load_sequence,
    require_same_motion,
)

TRAINING_SPLITS = ("train", "validation")
"""The splits of an index that training sees: training, and validation, which chooses the network to keep."""


@dataclass(frozen=True)
class TrainingClip:
    """One clip with every garment that was simulated over it.

    subject, split: the captured person, and train or validation, by the folder's index; "" without one.
    body: that it was simulated on. transforms: (T, J, 3, 4). warm_up: leading frames that do not count.
    vertices: template -> (T, N, 3) m. rests: template -> (N, 3) m. files: folder/file -> content hash.
    """

    clip: str
    subject: str
    split: str
    body: Body
    fps: float
    warm_up: int
    transforms: Tensor
    vertices: dict[str, Tensor]
    rests: dict[str, Tensor]
    files: dict[str, str]


def load_training_clips(folders: List[Path], templates: List[str]) -> list[TrainingClip]:
    """Read every sequence of some folders, each of one body, and group it by clip, sorted by name.

    If a folder has an index.csv, only the clips whose split in it is train or validation are read. Raises
    InputError naming the file if one is damaged, on a body that its folder lacks, or of another motion than
    its clip's other garments, naming the folder if it holds none of the templates, and naming the person who
    is in two splits, each in another folder.
    """
    if not folders:
        raise InputError("--data: names no folder of sequences")
    clips = [clip for folder in folders for clip in _clips_of(Path(folder), templates)]
    require_one_split(" ".join(map(str, folders)), ((each.clip, each.subject, each.split) for each in clips))
    return clips


def _clips_of(folder: Path, templates: List[str]) -> list[TrainingClip]:
    """The clips of one folder, see `load_training_clips`."""
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(f"{folder}: no sequence (*.npz) made by `uvcloth simulate` in this folder")
    index = folder / INDEX
    entries = read_index(index) if index.is_file() else None
    chosen = {clip: e for clip, e in (entries or {}).items() if e.split in TRAINING_SPLITS}
    clips: dict[str, dict[Path, SimulatedSequence]] = {}
    moved: dict[str, Body] = {}
    bodies: dict[str, Body] = {}
    for path in track(paths, "reading sequences", transient=True):
        sequence = load_sequence(path)
        body = sequence_body(path, sequence.metadata, bodies)
        if sequence.transforms.shape[1] != len(body.skeleton.names):
            raise InputError(
                f"{path}: simulated on a body with {sequence.transforms.shape[1]} joints, "
                f"body {body.name!r} has {len(body.skeleton.names)}"
            )
        if sequence.garment in templates and (entries is None or sequence.clip in chosen):
            clips.setdefault(sequence.clip, {})[path] = sequence
            moved[sequence.clip] = body
    if not clips:
        raise InputError(f"{folder}: none of its sequences is a training clip of {', '.join(templates)}")
    return [_training_clip(clip, clips[clip], moved[clip], chosen.get(clip)) for clip in sorted(clips)]


def _training_clip(
    clip: str, sequences: dict[Path, SimulatedSequence], body: Body, entry: Entry | None
) -> TrainingClip:
    """Join the sequences of one clip. Raises InputError naming the file of another motion."""
    require_same_motion(sequences, f"clip {clip!r}")
    first = next(iter(sequences.values()))
    return TrainingClip(
        clip=clip,
        subject=entry.subject if entry else "",
        split=entry.split if entry else "",
        body=body,
        fps=first.fps,
        warm_up=first.warm_up,
        transforms=first.transforms,
        vertices={s.garment: s.vertices for s in sequences.values()},
        rests={s.garment: s.rest for s in sequences.values()},
        files={f"{p.parent.name}/{p.name}": str(s.metadata.get("hash", "")) for p, s in sequences.items()},
    )


def check_rests(rests: Mapping[str, Tensor], clips: List[TrainingClip]) -> None:
    """Raise InputError naming the clip if it was simulated with another garment or on another body.

    rests: template -> (N, 3) m, its vertices at rest on the body of the clips.
    """
    for clip in clips:
        for name, rest in clip.rests.items():
            expected = rests[name]
            if rest.shape != expected.shape or (rest - expected).norm(dim=1).max() > REST_TOLERANCE:
                raise InputError(
                    f"{clip.clip}_{name}: at rest not the garment {name} on body {clip.body.name!r}; "
                    "it was simulated with another garment or body"
                )


def by_body(clips: List[TrainingClip]) -> list[tuple[Body, list[TrainingClip]]]:
    """The clips of each body, in the order in which these come. Raises InputError if two share a name."""
    found: dict[str, tuple[Body, list[TrainingClip]]] = {}
    for clip in clips:
        body, own = found.setdefault(clip.body.identity.shape, (clip.body, []))
        own.append(replace(clip, body=body))
    names = [body.name for body, _ in found.values()]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--data: two bodies are called {name}, simulate one of them under another name")
    return list(found.values())


@dataclass(frozen=True)
class Holdout:
    """The choice of validation clips where the data has no index, and of the training frames."""

    holdout: int = 8
    """Without an index.csv, every N-th clip is for validation, not for training."""
    rest_frames: int = 15
    """Warm-up frames to leave out of training, in which cloth comes down from the rest shape. Validation
    leaves out the whole warm-up."""

    def __post_init__(self) -> None:
        """Raises InputError if nothing would be left to train on."""
        if self.holdout < 2:
            raise InputError(f"--holdout {self.holdout}: has to be 2 or more")
        if self.rest_frames < 0:
            raise InputError(f"--rest-frames {self.rest_frames}: has to be 0 or more")


def hold_out(
    clips: list[TrainingClip], chosen: Holdout, data: str
) -> tuple[list[TrainingClip], list[TrainingClip]]:
    """Training and validation clips, as their index has it; the former's warm-up is cut short.

    data: the folders that they come from, in words.

    Without an index every n-th validates, at least one where there are two or more. Raises InputError if the
    index leaves none of either.
    """
    splits = [clip.split for clip in clips]
    if not any(splits):
        validating = range(len(splits))[chosen.holdout - 1 :: chosen.holdout] or range(len(splits))[1:][-1:]
        splits = ["validation" if place in validating else "train" for place in range(len(splits))]
    else:
        for split in TRAINING_SPLITS:
            if split not in splits:
                raise InputError(
                    f"{data}: holds no sequence for {split}; simulate clips that {INDEX} calls {split}"
                )
    training, held = (
        [r for r, own in zip(clips, splits, strict=True) if own == split] for split in TRAINING_SPLITS
    )
    return [replace(r, warm_up=min(r.warm_up, chosen.rest_frames)) for r in training], held


def training_data(training: list[TrainingClip], held: list[TrainingClip]) -> TrainingData:
    """The record of the clips that a model was trained on and chosen by, for its checkpoint."""
    return TrainingData(
        files={name: digest for r in (*training, *held) for name, digest in r.files.items()},
        clips={
            "train": {r.clip: r.subject for r in training},
            "validation": {r.clip: r.subject for r in held},
        },
    )


def frames_of(clips: list[TrainingClip]) -> int:
    """The number of scored frames of all clips."""
    return sum(max(len(clip.transforms) - clip.warm_up, 0) for clip in clips)
