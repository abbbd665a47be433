"""Which clips there are, and which of them poses for training, validation and test come from."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from rasterize.errors import InputError
from uvcloth.motion.library import builtin_clips
from uvcloth.simulate.index import INDEX, read_index

HELD_OUT = 0.15
"""Share of the clips that is for validation, and of those without an index also for the test."""


@dataclass(frozen=True)
class Source:
    """A clip. file: a path or the name of a built-in clip. split: train, validation or test."""

    name: str
    file: str
    split: str


def find_sources(clips: Sequence[str], extra: bool = False) -> list[Source]:
    """The clips of files, folders and built-in names, sorted by name, each for one split.

    A folder gives its BVH files and those of the folders in it. If an index.csv lies in it, that decides: its
    test clips are for the test, HELD_OUT of its train clips for validation and the others for training; its
    other clips, and those that it does not name, are for training with `extra` and left out without. Of the
    clips without an index, HELD_OUT each are for validation and for the test. Whole clips are held out,
    evenly spread over the names: of two the second is for validation, a single one is for training.
    No clips at all are the built-in ones.

    Raises InputError for a folder without clips, an index that is not one, and two clips of one name.
    """
    loose: dict[str, str] = {}
    sources: list[Source] = []
    for clip in clips or builtin_clips():
        found = {Path(clip).stem: clip}
        if clip not in builtin_clips() and Path(clip).is_dir():
            found = _in_folder(Path(clip))
            if (Path(clip) / INDEX).is_file():
                sources += _indexed(Path(clip) / INDEX, found, extra)
                continue
        for name in found.keys() & loose.keys():
            raise InputError(f"{found[name]}: another clip is also named {name} ({loose[name]})")
        loose |= found
    sources += _deal(loose, ("validation", "test"))
    sources.sort(key=lambda source: source.name)
    for first, second in pairwise(sources):
        if first.name == second.name:
            raise InputError(f"{second.file}: another clip is also named {second.name} ({first.file})")
    return sources


def _in_folder(folder: Path) -> dict[str, str]:
    """Name -> file of the BVH files of a folder and the folders in it."""
    files = [path for pattern in ("*.bvh", "*/*.bvh") for path in sorted(folder.glob(pattern))]
    if not files:
        raise InputError(f"{folder}: holds no BVH files")
    named = {path.stem: str(path) for path in files}
    for path in files:
        if named[path.stem] != str(path):
            raise InputError(f"{path}: another clip is also named {path.stem} ({named[path.stem]})")
    return named


def _indexed(index: Path, files: dict[str, str], extra: bool) -> list[Source]:
    entries = read_index(index)
    splits = {name: entries[name].split if name in entries else "extra" for name in files}
    train, test = ({n: files[n] for n in files if splits[n] == split} for split in ("train", "test"))
    sources = [*_deal(train, ("validation",)), *(Source(name, file, "test") for name, file in test.items())]
    if extra:
        others = files.keys() - train.keys() - test.keys()
        sources += [Source(name, files[name], "train") for name in others]
    if not sources:
        raise InputError(f"{index}: names no train or test clip of which there is a file")
    return sources


def _deal(files: dict[str, str], held_out: tuple[str, ...]) -> list[Source]:
    """Clips by name, HELD_OUT of them (at least one, if one for training remains) for each of some splits."""
    names = sorted(files)
    splits = ["train"] * len(names)
    count = max(1, round(HELD_OUT * len(names)))
    for place, split in enumerate(held_out[: max(len(names) - 1, 0)]):
        for index in range(count):
            middle = int((index + 0.5) * len(names) / count)
            splits[(middle + place) % len(names)] = split
    return [Source(name, files[name], split) for name, split in zip(names, splits, strict=True)]
