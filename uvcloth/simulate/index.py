"""The index of a benchmark: which window of which clip is trained on or tested, and what it shows."""

import csv
from dataclasses import dataclass
from pathlib import Path

from rasterize.errors import InputError

INDEX = "index.csv"
"""Name of the index in a data folder."""

COLUMNS = ("trial", "split", "action", "window_start", "window_frames")


@dataclass(frozen=True)
class Entry:
    """One window of a clip. split: train, test or any other word. start, frames: at 30 frames per second."""

    clip: str
    split: str
    action: str
    start: int
    frames: int


def read_index(path: Path) -> dict[str, Entry]:
    """The windows of an index by clip.

    Raises InputError if it is missing or not such a table, for a clip that it names twice, and for a window
    that starts before the clip or is empty.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = csv.DictReader(stream)
            missing = [column for column in COLUMNS if column not in (rows.fieldnames or ())]
            if missing:
                raise InputError(f"{path}: lacks the column {', '.join(missing)}")
            entries: dict[str, Entry] = {}
            for row in rows:
                entry = _entry(path, row)
                if entry.clip in entries:
                    raise InputError(f"{path}: has two rows for the clip {entry.clip}")
                entries[entry.clip] = entry
            return entries
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table of text") from error


def _entry(path: Path, row: dict[str, str]) -> Entry:
    try:
        start, frames = int(row["window_start"]), int(row["window_frames"])
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: the window of {row['trial']} is not given in whole frames") from error
    if start < 0 or frames < 1:
        raise InputError(
            f"{path}: the window of {row['trial']} starts at {start} and has {frames} frames, "
            "expected a start of at least 0 and at least 1 frame"
        )
    return Entry(row["trial"], row["split"], row["action"], start, frames)
