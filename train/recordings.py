"""Simulated sequences as training data: the garments of one clip side by side."""

from collections.abc import Sequence as List
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.progress import track
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.simulate.index import INDEX, read_index
from uvcloth.simulate.sequence import Sequence, load_sequence

SAME_MOTION = 1e-3
"""Largest difference (m, or of a rotation matrix) between the motions of two garments of one clip."""


@dataclass(frozen=True)
class Recording:
    """One clip with every garment that was simulated over it.

    transforms: (T, J, 3, 4). settling: leading frames that do not count. vertices: template -> (T, N, 3) m.
    rests: template -> (N, 3) m. files: file name -> content hash.
    """

    clip: str
    fps: float
    settling: int
    transforms: Tensor
    vertices: dict[str, Tensor]
    rests: dict[str, Tensor]
    files: dict[str, str]


def load_recordings(folder: Path, templates: List[str], body: Body) -> list[Recording]:
    """Read every sequence of a folder and group it by clip, sorted by name.

    Clips whose split is `test` in the folder's index.csv, if it has one, are left out. Raises InputError
    naming the file if one is damaged, of another rig, or of another motion than its clip's
    other garments, and naming the folder if it holds none of the templates.
    """
    paths = sorted(Path(folder).glob("*.npz"))
    if not paths:
        raise InputError(f"{folder}: no sequence (*.npz) made by `uvcloth simulate` in this folder")
    index = Path(folder) / INDEX
    unseen = {e.clip for e in read_index(index).values() if e.split == "test"} if index.is_file() else set()
    clips: dict[str, dict[Path, Sequence]] = {}
    for path in track(paths, "reading sequences", transient=True):
        sequence = load_sequence(path)
        if sequence.transforms.shape[1] != len(body.skeleton.names):
            raise InputError(
                f"{path}: simulated on a body with {sequence.transforms.shape[1]} joints, "
                f"body {body.name!r} has {len(body.skeleton.names)}"
            )
        if sequence.garment in templates and sequence.clip not in unseen:
            clips.setdefault(sequence.clip, {})[path] = sequence
    if not clips:
        raise InputError(f"{folder}: none of its sequences is a training clip of {', '.join(templates)}")
    return [_recording(clip, clips[clip]) for clip in sorted(clips)]


def _recording(clip: str, sequences: dict[Path, Sequence]) -> Recording:
    (first_path, first), *others = sequences.items()
    for path, other in others:
        same = other.transforms.shape == first.transforms.shape and other.settling == first.settling
        if not same or (other.transforms - first.transforms).abs().max() > SAME_MOTION:
            raise InputError(f"{path}: moves otherwise than {first_path.name} of the same clip {clip!r}")
    return Recording(
        clip=clip,
        fps=first.fps,
        settling=first.settling,
        transforms=first.transforms,
        vertices={s.garment: s.vertices for s in sequences.values()},
        rests={s.garment: s.rest for s in sequences.values()},
        files={path.name: str(s.metadata.get("hash", "")) for path, s in sequences.items()},
    )


@dataclass(frozen=True)
class Holdout:
    """Which clips validate."""

    holdout: int = 8
    """Every n-th clip validates and is not trained on."""
    validation: tuple[str, ...] = ()
    """The clips that do so, by name, instead."""

    def __post_init__(self) -> None:
        """Raises InputError if nothing would be left to train on."""
        if self.holdout < 2:
            raise InputError(f"--holdout {self.holdout}: has to be 2 or more")


def hold_out(recordings: list[Recording], chosen: Holdout) -> tuple[list[Recording], list[Recording]]:
    """Training and validation clips: the named, or every n-th, at least one where there are two or more.

    Raises InputError for a name that no clip has.
    """
    clips = [recording.clip for recording in recordings]
    for name in chosen.validation:
        if name not in clips:
            raise InputError(f"--validation {name}: not a training clip, expected some of {', '.join(clips)}")
    every = chosen.holdout
    held = list(chosen.validation) or clips[every - 1 :: every] or clips[1:][-1:]
    return [r for r in recordings if r.clip not in held], [r for r in recordings if r.clip in held]


def counted(recording: Recording) -> range:
    """The frames that count: those after settling."""
    return range(recording.settling, len(recording.transforms))


def frames_of(recordings: list[Recording]) -> int:
    """How many frames count in all."""
    return sum(len(counted(recording)) for recording in recordings)


def stacked(recordings: list[Recording], template: str) -> Tensor | None:
    """The counting frames of one template one after another (F, N, 3); None where every clip lacks it."""
    parts = [r.vertices[template][r.settling :] for r in recordings if template in r.vertices]
    return torch.cat(parts) if parts else None
