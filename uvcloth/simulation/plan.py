"""Plan of a batch: windows of clips, in an order in which any first part is a good mixture."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rich.progress import track

from uvcloth.bodies.body import Body
from uvcloth.dataset.folder import is_finished
from uvcloth.errors import InputError
from uvcloth.files.fields import require_file_name
from uvcloth.garments.joined import EngineMesh
from uvcloth.motion.capture import find_jump, find_standstill
from uvcloth.motion.clip import Clip
from uvcloth.motion.index import Entry, clip_file, read_index
from uvcloth.motion.library import DEFAULTS, load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import Fabric
from uvcloth.simulation.run import run_up


@dataclass(frozen=True)
class Job:
    """One simulation: a motion (run-up included), the number of its warm-up frames, and garments.

    Several cloths touch each other, the first is innermost; each has a target, the file of its sequence.
    fabric: of its cloths; None for the engine's. member: of an ensemble, as `member_engine` has it. labels:
    metadata that the sequences of all cloths get besides.
    """

    motion: Clip
    warm_up: int
    body: Body
    cloths: tuple[EngineMesh, ...]
    targets: tuple[Path, ...]
    fabric: Fabric | None = None
    member: int = 0
    labels: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """Source of a clip: a file or a built-in clip's name, a window (None for all), and how it is read."""

    name: str
    clip: str
    window: Entry | None
    options: MotionOptions = DEFAULTS


@dataclass(frozen=True)
class ClipSelection:
    """Clips of a batch: those that are named, or all that an index has in some splits.

    clips: files or names of built-in clips. windows: an index of clips and windows. clips_from: the folder of
    its clips, by default its own. splits: by default all of SPLITS; both only where no clip is named.
    options: how every clip is read.
    """

    clips: Sequence[str] = ()
    windows: Path | None = None
    clips_from: Path | None = None
    splits: Sequence[str] | None = None
    options: MotionOptions = DEFAULTS


def batch_sources(selection: ClipSelection) -> list[Source]:
    """Find the clips of a batch, in order.

    Raises InputError for an index that is invalid or lacks a named clip, and for a clip without a file.
    """
    clips, windows = selection.clips, selection.windows
    clips_from, splits, options = selection.clips_from, selection.splits, selection.options
    if windows is None:
        if clips_from is not None or splits is not None:
            raise InputError("--clips-from and --split go with --windows, the index of the clips")
        return [Source(name, Path(name).stem, None, options) for name in clips]
    if options.frames is not None:
        raise InputError("--frames and --windows both choose frames: give one of them")
    table = read_index(windows)
    if clips:
        if clips_from is not None or splits is not None:
            raise InputError("--clips-from and --split choose the clips: do not name clips as well")
        for name in clips:
            if Path(name).stem not in table:
                raise InputError(f"{windows}: has no row for the clip {Path(name).stem}")
        return [Source(name, Path(name).stem, table[Path(name).stem], options) for name in clips]
    wanted = tuple(splits or SPLITS)
    for split in wanted:
        if split not in SPLITS:
            raise InputError(f"--split {split}: expected some of {', '.join(SPLITS)}")
    folder = clips_from or windows.parent
    entries = [entry for entry in table.values() if entry.split in wanted]
    if not entries:
        raise InputError(f"{windows}: has no clip of the split {', '.join(wanted)}")
    return [Source(str(clip_file(e, folder)), e.clip, e, options) for e in interleaved(entries)]


def interleaved(entries: Iterable[Entry]) -> list[Entry]:
    """Order entries: validation, test, training; each begins with its share of all people and actions."""
    rows = sorted(entries, key=lambda entry: entry.clip)
    parts = [[row for row in rows if row.split == split] for split in ("validation", "test", "train")]
    return [
        entry for part in parts for entry in _spread(_spread(part, lambda e: e.action), lambda e: e.subject)
    ]


def _spread(entries: Sequence[Entry], group: Callable[[Entry], Hashable]) -> list[Entry]:
    """Entries of each group, in their order, evenly over the whole."""
    places: list[tuple[float, int]] = []
    counts: dict[Hashable, int] = {}
    sizes: dict[Hashable, int] = {}
    for entry in entries:
        sizes[group(entry)] = sizes.get(group(entry), 0) + 1
    for index, entry in enumerate(entries):
        before = counts.get(group(entry), 0)
        counts[group(entry)] = before + 1
        places.append(((before + 0.5) / sizes[group(entry)], index))
    return [entries[index] for _, index in sorted(places)]


def plan(
    sources: Sequence[Source],
    outfits: Sequence[tuple[EngineMesh, ...]],
    folders: Sequence[Path],
    body: Body,
) -> tuple[list[Job], dict[str, str]]:
    """Plan the simulations still to make, all outfits of a clip together, and the reasons of refused clips.

    folders: of the ensemble's members, which come one after another. Clips are read only if a sequence of
    theirs is missing. Raises InputError for unreadable clips, windows that do not fit and sequences that
    would share a file or have names that no file can have everywhere.
    """
    todo: list[Job] = []
    refused: dict[str, str] = {}
    written: dict[str, str] = {}
    for source in track(sources, "reading clips", transient=True):
        files = [tuple(f"{source.clip}_{c.garment.name}.npz" for c in outfit) for outfit in outfits]
        for file in (file for each in files for file in each):
            require_file_name(file, source.name)
            if file.casefold() in written:
                raise InputError(
                    f"{folders[0] / file}: both {written[file.casefold()]} and {source.name} would be "
                    "written there"
                )
            written[file.casefold()] = source.name
        missing = [
            (member, outfit, targets)
            for member, folder in enumerate(folders)
            for outfit, each in zip(outfits, files, strict=True)
            if not all(map(is_finished, targets := tuple(folder / file for file in each)))
        ]
        if missing:
            motion, warm_up, fault = load_motion(source, body)
            if fault is not None:
                refused[source.clip] = fault
            else:
                todo += [Job(motion, warm_up, body, outfit, to, member=m) for m, outfit, to in missing]
    return sorted(todo, key=lambda job: job.member), refused


def load_motion(source: Source, body: Body) -> tuple[Clip, int, str | None]:
    """Load the motion of a source with its run-up, the frames of that, and the capture's fault, if any."""
    clip = replace(load_clip(source.name, body, source.options), name=source.clip)
    start, frames = 0, len(clip)
    if source.window is not None:
        start, frames = source.window.start, source.window.frames
    clip.require_frames(start + frames, source.name)
    motion, before = run_up(clip, start, frames)
    fault = find_jump(motion, start - before) or find_standstill(motion.window(before, frames), start)
    return motion, before, fault
