"""Data folders: their sequences, all of one body, engine and outfit, and the refused ones."""

import csv
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import BODIES
from uvcloth.dataset.clip_file import read_metadata
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.files.reading import require_file
from uvcloth.motion.index import COLUMNS, Entry, read_index

REJECTED, MEMBERS_FOLDER = "rejected", "members"
"""Folders in a data folder: of sequences that were refused, and of the other members of an ensemble."""

MESHES, MOTIONS = "meshes", "motions"
"""Folders in a packed data folder: of the garments' meshes, and of the motions."""

NO_DATA = (BODIES, REJECTED, MESHES, MOTIONS)
"""Folders in a data folder that hold other files than its sequences."""

MEMBERS = 4
"""Members of an ensemble of simulations of one motion and garment, the usual simulation included."""

REFUSED = "refused.csv"
"""Name of the table of captures that were refused before they were simulated, and why."""


@dataclass(frozen=True)
class Stored:
    """A sequence in a data folder: its file and its metadata."""

    path: Path
    metadata: dict[str, Any]

    @property
    def reason(self) -> str | None:
        """Reason why it was refused; None if it was not."""
        if self.path.parent.name != REJECTED:
            return None
        return str(self.metadata.get("rejected", "kept apart"))


def rejected(target: Path) -> Path:
    """Path of a sequence if it is refused."""
    return target.parent / REJECTED / target.name


def is_finished(target: Path) -> bool:
    """True if a sequence exists, finished or refused."""
    return target.exists() or rejected(target).exists()


def member_folder(folder: Path, member: int) -> Path:
    """Data folder of an ensemble member of the sequences of a data folder; the same one for member 0."""
    return folder / MEMBERS_FOLDER / str(member) if member else folder


def usual_folder(folder: Path) -> Path:
    """Data folder of the usual simulations, of which a data folder holds an ensemble member; or itself."""
    return folder.parent.parent if folder.parent.name == MEMBERS_FOLDER else folder


def data_folders(folder: Path) -> list[Path]:
    """List the folders with sequences in a data folder: its own, of other bodies, layers and members."""
    holding = {path.parent for path in folder.rglob("*.npz")}
    return sorted(each for each in holding if not set(each.relative_to(folder).parts) & set(NO_DATA))


def sequence_files(folder: Path) -> list[Path]:
    """List every sequence file in a data folder, refused ones last."""
    return [*sorted(folder.glob("*.npz")), *sorted((folder / REJECTED).glob("*.npz"))]


def stored_sequences(folder: Path) -> list[Stored]:
    """Read the metadata of all sequences in a data folder.

    Raises InputError for a file that is no sequence.
    """
    return [Stored(path, read_metadata(path)) for path in sequence_files(folder)]


def require_same(
    stored: Sequence[Stored], body: Body, made: Mapping[str, Any], outfits: Sequence[tuple[str, ...]]
) -> None:
    """Raise InputError if a sequence has another body, engine or outfit than the new ones would have.

    made: description of the engine that makes sequences now. outfits: names of the garments that are
    simulated together.
    """
    shape = body.identity.shape
    layers = {name: outfit for outfit in outfits for name in outfit}
    require_engine(stored, made)
    for each in stored:
        metadata = each.metadata
        if metadata.get("body_hash", shape) != shape:
            raise InputError(
                f"{each.path}: was simulated on another body ({metadata['body']}) than {body.name}, "
                "simulate into another folder"
            )
        actual = tuple(metadata.get("layers", (metadata["garment"],)))
        expected = layers.get(metadata["garment"], actual)
        if actual != expected:
            raise InputError(
                f"{each.path}: was simulated as {' under '.join(actual)}, not as {' under '.join(expected)}, "
                "simulate into another folder"
            )


def require_engine(stored: Sequence[Stored], made: Mapping[str, Any]) -> None:
    """Raise InputError if a sequence was made by another engine, or with other settings.

    made: description of the engine that makes sequences now, as `Engine.describe` gives it.
    """
    expected = json.loads(json.dumps(made))
    for each in stored:
        if "engine" in each.metadata:
            _require_engine(each.path, each.metadata, expected)


def _require_engine(path: Path, metadata: Mapping[str, Any], made: Mapping[str, Any]) -> None:
    """Raise InputError if it was made by another engine, or with other settings, which the message names."""
    if metadata["engine"] != made["engine"]:
        raise InputError(
            f"{path}: was simulated by {metadata['engine']}, not by {made['engine']}, "
            "simulate into another folder"
        )
    differences = _differences(metadata.get("settings", {}), made["settings"])
    if differences:
        raise InputError(
            f"{path}: was simulated with other settings ({', '.join(differences)}), "
            "simulate into another folder"
        )


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Differences between settings as text, by name; of a fabric its own fields."""
    differences = []
    for name in {**now, **before}:
        old, new = before.get(name), now.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            differences += _differences(old, new)
        elif old != new:
            differences.append(f"{name} {old} instead of {new}")
    return differences


def keep_index(windows: Path, kept: Path) -> None:
    """Copy the index of windows, which training and evaluation read.

    Raises InputError if the copy exists and differs.
    """
    if not kept.exists():
        with atomic_write(kept) as partial:
            shutil.copyfile(windows, partial)
    elif read_index(kept) != read_index(windows):
        raise InputError(f"{kept}: holds other windows than {windows}, simulate them into another folder")


def require_windows(entries: Iterable[Entry], kept: Path) -> None:
    """Raise InputError if a data folder has an index with another window for an entry."""
    if not kept.exists():
        return
    table = read_index(kept)
    for entry in entries:
        if entry.clip in table and replace(table[entry.clip], file="") != entry:
            raise InputError(
                f"{kept}: holds another window of {entry.clip}, simulate this one into another folder"
            )


def add_windows(entries: Iterable[Entry], kept: Path) -> None:
    """Add entries to the index of a data folder; those that are there stay.

    Raises InputError as `require_windows` does.
    """
    entries = list(entries)
    require_windows(entries, kept)
    table = (read_index(kept) if kept.exists() else {}) | {entry.clip: entry for entry in entries}
    with atomic_write(kept) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(COLUMNS)
        rows.writerows((e.clip, e.subject, e.split, e.action, e.start, e.frames) for e in table.values())


def refused_captures(folder: Path) -> dict[str, str]:
    """Read the reasons why captures were refused, by clip.

    Raises InputError if the folder's table cannot be read.
    """
    path = folder / REFUSED
    if not path.exists():
        return {}
    require_file(path)
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return {row["clip"]: row["reason"] for row in csv.DictReader(stream, restval="")}
    except (OSError, UnicodeDecodeError, csv.Error, KeyError) as error:
        raise InputError(f"{path}: not a table with the columns clip and reason") from error


def keep_refused(refused: Mapping[str, str], folder: Path) -> None:
    """Add refused captures, with the reason by clip, to the folder's table.

    Raises InputError if it cannot be read or written.
    """
    with (
        atomic_write(folder / REFUSED) as partial,
        partial.open("w", newline="", encoding="utf-8") as stream,
    ):
        rows = csv.writer(stream)
        rows.writerow(("clip", "reason"))
        rows.writerows(sorted((refused_captures(folder) | dict(refused)).items()))
