"""Overview of a data folder as text and a table: `uvcloth data`."""

from collections import Counter
from collections.abc import Iterable, Mapping, Set
from itertools import product
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from uvcloth.dataset.clip_file import read_metadata
from uvcloth.dataset.folder import (
    Stored,
    data_folders,
    is_finished,
    refused_captures,
    sequence_files,
)
from uvcloth.errors import InputError
from uvcloth.motion.index import INDEX, Entry, read_index
from uvcloth.motion.poses import SPLITS
from uvcloth.simulation.plan_file import PLAN, plan_folders, read_plan
from uvcloth.simulation.unfinished import unfinished_files, unfinished_frames

MAX_NAMED = 12
"""Number of missing clips to name per split."""


def overview(folder: Path) -> RenderableType:
    """Make a table of frames by split and garment, and lines on bodies, engines, refusals and missing clips.

    Each data folder of a plan, or of an ensemble, is listed. Only metadata are read. Raises InputError
    if the folder does not exist or holds nothing, and for an invalid index or plan; files that are not
    sequences of this version are listed.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder, expected one made by `uvcloth simulate`")
    if not (folder / PLAN).is_file():
        return Group(*(_overview(part, None) for part in dict.fromkeys([folder, *data_folders(folder)])))
    rows = read_plan(folder / PLAN)
    files = [folder / file for row in rows for file in row.files]
    there = sum(map(is_finished, files))
    parts = [
        _overview(folder / part, {(row.motion.name, name) for row in part_rows for name in row.names})
        for part, part_rows in plan_folders(rows).items()
    ]
    return Group(Text(f"{folder}: {there} of {len(files)} planned sequences are there or refused"), *parts)


def _overview(folder: Path, planned: Set[tuple[str, str]] | None) -> RenderableType:
    """Overview of one data folder. planned: clip and garment of each sequence, None without a plan."""
    stored, unreadable, size = [], [], 0
    for path in sequence_files(folder):
        size += path.stat().st_size
        try:
            stored.append(Stored(path, read_metadata(path)))
        except InputError as error:
            unreadable.append(str(error))
    begun = [file for file in unfinished_files(folder) if planned is None or file.parent == folder]
    unfinished = dict(map(unfinished_frames, begun))
    if planned is None and not stored and not unreadable and not unfinished:
        raise InputError(f"{folder}: no sequence (*.npz) made by `uvcloth simulate` in this folder")
    index = read_index(folder / INDEX) if (folder / INDEX).is_file() else {}
    kept = [each for each in stored if each.reason is None]
    captures = refused_captures(folder)
    lines = [
        f"{folder}: {len(kept)} sequences, {_frames(kept):,} scored frames, {size / 1e6:,.1f} MB on disk",
        *_counted("body", (_body(each) for each in kept)),
        *_counted("engine", (_engine(each) for each in kept)),
        *_counted("fabric", (str(each.metadata["fabric"]) for each in kept if "fabric" in each.metadata)),
    ]
    after = [
        *(f"refused: {each.path.relative_to(folder)}, {each.reason}" for each in stored if each.reason),
        *(f"refused before it was simulated: {clip}, {reason}" for clip, reason in captures.items()),
        *(f"unreadable: {sentence}" for sentence in unreadable),
        *_unfinished(unfinished),
        *_missing(index, stored, captures, planned),
    ]
    return Group(Text("\n".join(lines)), _table(index, kept), Text("\n".join(after)))


def _table(index: Mapping[str, Entry], kept: list[Stored]) -> Table:
    """Table of a row per split: people, clips, frames of each garment, or type of it."""
    garments = sorted({_garment(each) for each in kept})
    rows: dict[str, list[Stored]] = {split: [] for split in SPLITS if index}
    for each in kept:
        rows.setdefault(_split(index, each), []).append(each)
    table = Table("split", "people", "clips", *garments, "clips of the index", "frames of the index")
    for column in table.columns[1:]:
        column.justify = "right"
    for split, sequences in rows.items():
        clips = {sequence.metadata["clip"] for sequence in sequences}
        people = {_subject(index, each) for each in sequences} - {""}
        entries = [entry for entry in index.values() if entry.split == split]
        table.add_row(
            split,
            str(len(people)) if people or index else "",
            str(len(clips)),
            *(f"{_frames(s for s in sequences if _garment(s) == name):,}" for name in garments),
            str(len(entries)) if entries else "",
            f"{sum(entry.frames for entry in entries):,}" if entries else "",
        )
    return table


def _garment(each: Stored) -> str:
    """Name of the garment; of random outfits, which all differ, its type."""
    name = str(each.metadata["garment"])
    return str(each.metadata.get("types", {}).get(name, name))


def _subject(index: Mapping[str, Entry], each: Stored) -> str:
    entry = index.get(each.metadata["clip"])
    return entry.subject if entry else str(each.metadata.get("subject", ""))


def _split(index: Mapping[str, Entry], each: Stored) -> str:
    entry = index.get(each.metadata["clip"])
    return entry.split if entry else str(each.metadata.get("split", "without an index"))


def _frames(sequences: Iterable[Stored]) -> int:
    return sum(sequence.metadata.get("scored_frames", 0) for sequence in sequences)


def _body(each: Stored) -> str:
    shape = str(each.metadata.get("body_hash", ""))[:8]
    return f"{each.metadata.get('body', 'unknown')} ({shape or 'shape unknown'})"


def _engine(each: Stored) -> str:
    """Engine, versions and settings of a sequence as text, without the fabric of an outfit."""
    metadata = each.metadata
    versions = " ".join(f"{name} {number}" for name, number in metadata.get("versions", {}).items())
    settings = {**metadata.get("settings", {})}
    if "fabric" in metadata:
        settings.pop("fabric", None)
    told = ", ".join(f"{name} {value}" for name, value in settings.items())
    return f"{metadata.get('engine', 'unknown')} ({versions}; {told})"


def _counted(what: str, names: Iterable[str]) -> list[str]:
    return [f"{what}: {name}, {count} sequences" for name, count in Counter(names).most_common()]


def _unfinished(frames: Mapping[str, int]) -> list[str]:
    """Line on sequences that were interrupted or are in progress, with the number of their frames so far."""
    if not frames:
        return []
    named = [f"{name} {count}" for name, count in frames.items()][:MAX_NAMED]
    return [
        f"unfinished: {len(frames)} sequences, {sum(frames.values()):,} frames ({', '.join(named)}"
        f"{', ...' * (len(frames) > MAX_NAMED)}); the same `uvcloth simulate` command continues them"
    ]


def _missing(
    index: Mapping[str, Entry],
    stored: list[Stored],
    captures: Mapping[str, str],
    planned: Set[tuple[str, str]] | None,
) -> list[str]:
    """Lines, by split, on clips of which a garment is neither there nor refused.

    Without a plan, all clips of the index are to have all of the folder's garments.
    """
    garments = {each.metadata["garment"] for each in stored}
    present = {(each.metadata["clip"], each.metadata["garment"]) for each in stored}
    wanted = product(index, garments) if planned is None else sorted(planned)
    missing: dict[str, Counter[str]] = {split: Counter() for split in SPLITS}
    for clip, garment in wanted:
        entry = index.get(clip)
        if entry and entry.split in SPLITS and clip not in captures and (clip, garment) not in present:
            missing[entry.split][clip] += 1
    return [
        f"missing of {split}: {clips.total()} sequences of {len(clips)} clips "
        f"({', '.join(list(clips)[:MAX_NAMED])}{', ...' * (len(clips) > MAX_NAMED)})"
        for split, clips in missing.items()
        if clips
    ]
