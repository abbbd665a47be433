"""A data folder: which sequences are in it, and that all of them are of one body, engine and outfit."""

import csv
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rasterize.atomic import atomic_write
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.motion.index import read_index
from uvcloth.motion.poses import rest_hash
from uvcloth.simulate.engine import Engine
from uvcloth.simulate.sequence import read_metadata

REPEAT, REJECTED = "repeat", "rejected"
"""Folders in a data folder: second simulations of windows, and sequences that were refused (of either)."""

REFUSED = "refused.csv"
"""Name of the table of captures that were refused before they were simulated, and why."""


@dataclass(frozen=True)
class Stored:
    """A sequence in a data folder: its file, its metadata, and whether it is a second simulation."""

    path: Path
    metadata: dict[str, Any]
    repeat: bool

    @property
    def reason(self) -> str | None:
        """Why it was refused; None if it was not."""
        if self.path.parent.name != REJECTED:
            return None
        return str(self.metadata.get("rejected", "kept apart"))


def rejected(target: Path) -> Path:
    """Where a sequence that is refused is kept instead."""
    return target.parent / REJECTED / target.name


def sequence_files(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Every sequence file in a data folder, and whether it is a second simulation."""
    for part in (folder, folder / REPEAT):
        for path in (*sorted(part.glob("*.npz")), *sorted((part / REJECTED).glob("*.npz"))):
            yield path, part != folder


def stored_sequences(folder: Path) -> list[Stored]:
    """What is in a data folder, by its metadata. Raises InputError for a file that is no sequence."""
    return [Stored(path, read_metadata(path), repeat) for path, repeat in sequence_files(folder)]


def require_same(
    stored: Sequence[Stored], body: Body, engine: Engine, outfits: Sequence[tuple[str, ...]]
) -> None:
    """Raise InputError if a sequence is of another body, engine or outfit than what would be made.

    engine: what makes sequences now. outfits: names of the garments that are simulated together.
    """
    shape = rest_hash(body)
    layers = {name: outfit for outfit in outfits for name in outfit}
    made = json.loads(json.dumps(engine.describe()))
    for each in stored:
        said = each.metadata
        if said.get("body_hash", shape) != shape:
            raise InputError(
                f"{each.path}: was simulated on another body ({said['body']}) than {body.name}, "
                "simulate into another folder"
            )
        if "engine" in said:
            _require_engine(each.path, said, made)
        found = tuple(said.get("layers", (said["garment"],)))
        expected = layers.get(said["garment"], found)
        if found != expected:
            raise InputError(
                f"{each.path}: was simulated as {' under '.join(found)}, not as {' under '.join(expected)}, "
                "simulate into another folder"
            )


def _require_engine(path: Path, said: Mapping[str, Any], made: Mapping[str, Any]) -> None:
    """Raise InputError if another engine made it, or other settings, which are then named."""
    if said["engine"] != made["engine"]:
        raise InputError(
            f"{path}: was simulated by {said['engine']}, not by {made['engine']}, "
            "simulate into another folder"
        )
    differences = _differences(said.get("settings", {}), made["settings"])
    if differences:
        raise InputError(
            f"{path}: was simulated with other settings ({', '.join(differences)}), "
            "simulate into another folder"
        )


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What differs between settings, by name; fabrics by what they are made of."""
    said = []
    for name in {**now, **before}:
        old, new = before.get(name), now.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            said += _differences(old, new)
        elif old != new:
            said.append(f"{name} {old} instead of {new}")
    return said


def keep_index(windows: Path, kept: Path) -> None:
    """Copy the windows, by which training and evaluation will go. Raises InputError if others are kept."""
    if not kept.exists():
        with atomic_write(kept) as partial:
            shutil.copyfile(windows, partial)
    elif read_index(kept) != read_index(windows):
        raise InputError(f"{kept}: holds other windows than {windows}, simulate them into another folder")


def refused_captures(folder: Path) -> dict[str, str]:
    """Why captures were refused, by clip. Raises InputError if the folder's table cannot be read."""
    path = folder / REFUSED
    if not path.exists():
        return {}
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return {row["clip"]: row["reason"] for row in csv.DictReader(stream)}
    except (OSError, UnicodeDecodeError, csv.Error, KeyError) as error:
        raise InputError(f"{path}: not a table with the columns clip and reason") from error


def keep_refused(refused: Mapping[str, str], folder: Path) -> None:
    """Add captures that were refused, and why, to the folder's table."""
    with (
        atomic_write(folder / REFUSED) as partial,
        partial.open("w", newline="", encoding="utf-8") as stream,
    ):
        rows = csv.writer(stream)
        rows.writerow(("clip", "reason"))
        rows.writerows(sorted((refused_captures(folder) | dict(refused)).items()))
