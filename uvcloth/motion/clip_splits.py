"""Clips to draw poses from, split into training, validation and test."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from uvcloth.errors import InputError
from uvcloth.motion.index import INDEX, clip_file, read_index
from uvcloth.motion.library import builtin_clips
from uvcloth.motion.poses import SPLITS

HELD_OUT = 0.15
"""Share of the clips without an index that validation and test get, each."""

AMASS = ("*_poses.npz", "*_stageii.npz")
"""Names of the motions in the folders of AMASS, older and newer; beside them lie shapes without a motion."""


@dataclass(frozen=True)
class SplitClip:
    """A clip to draw poses from.

    file: a path or the name of a built-in clip. split: train, validation or test. subject: the captured
    person, "" if unknown.
    """

    name: str
    file: str
    split: str
    subject: str = ""


def find_sources(
    clips: Sequence[str], windows: Path | None = None, clips_from: Path | None = None
) -> list[SplitClip]:
    """Find the clips of files, folders, built-in names and an index, sorted by name, each for one split.

    A folder gives its BVH and AMASS files (`AMASS`) and those of the folders in it. An index.csv in it
    decides instead: it assigns the splits, and clips that it calls unused or does not name are left out.
    windows: an index that decides in the same way for the clips of the folder `clips_from`. Of the clips
    without an index, validation and test get HELD_OUT each, evenly spread over the sorted names: of two the
    second is for validation, a single one is for training. With neither clips nor an index, the built-in
    clips are used.

    Raises InputError for a folder without clips, an index that is not one or whose clips are not there, one
    without its folder or the reverse, and two clips of one name.
    """
    loose: dict[str, str] = {}
    sources: list[SplitClip] = []
    if windows is not None and clips_from is not None:
        sources += _indexed(windows, clips_from)
    elif windows is not None or clips_from is not None:
        raise InputError(
            "poses: --windows and --clips-from go together, an index and the folder of its clips"
        )
    for clip in clips or ([] if sources else builtin_clips()):
        by_name = {Path(clip).stem: clip}
        if clip not in builtin_clips() and Path(clip).is_dir():
            if (Path(clip) / INDEX).is_file():
                sources += _indexed(Path(clip) / INDEX, Path(clip))
                continue
            by_name = _in_folder(Path(clip))
        for name in by_name.keys() & loose.keys():
            raise InputError(f"{by_name[name]}: another clip is also named {name} ({loose[name]})")
        loose |= by_name
    sources += [SplitClip(name, loose[name], split) for name, split in deal_splits(loose).items()]
    sources.sort(key=lambda source: source.name)
    for first, second in pairwise(sources):
        if first.name == second.name:
            raise InputError(f"{second.file}: another clip is also named {second.name} ({first.file})")
    return sources


def _in_folder(folder: Path) -> dict[str, str]:
    """Name -> file of the BVH and AMASS files of a folder and the folders in it."""
    patterns = ("*.bvh", *AMASS)
    files = [path for name in patterns for deep in (name, f"*/{name}") for path in sorted(folder.glob(deep))]
    if not files:
        raise InputError(f"{folder}: holds no motion files ({', '.join(patterns)})")
    named = {path.stem: str(path) for path in files}
    for path in files:
        if named[path.stem] != str(path):
            raise InputError(f"{path}: another clip is also named {path.stem} ({named[path.stem]})")
    return named


def _indexed(index: Path, folder: Path) -> list[SplitClip]:
    """The clips that an index gives to a split."""
    entries = [entry for entry in read_index(index).values() if entry.split in SPLITS]
    if not entries:
        raise InputError(f"{index}: assigns no clip to {', '.join(SPLITS)}")
    return [SplitClip(e.clip, str(clip_file(e, folder)), e.split, e.subject) for e in entries]


def deal_splits(names: Iterable[str]) -> dict[str, str]:
    """Split of each name: HELD_OUT each for validation and test, at least one where one remains to train."""
    names = sorted(names)
    splits = ["train"] * len(names)
    count = max(1, round(HELD_OUT * len(names)))
    for place, split in enumerate(("validation", "test")[: max(len(names) - 1, 0)]):
        for index in range(count):
            middle = int((index + 0.5) * len(names) / count)
            splits[(middle + place) % len(names)] = split
    return dict(zip(names, splits, strict=True))
