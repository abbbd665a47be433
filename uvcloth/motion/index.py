"""Index of a benchmark: windows of clips, their subjects, and their splits (training, validation, test)."""

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from glob import escape
from pathlib import Path

from uvcloth.errors import InputError
from uvcloth.files.fields import LONGEST, is_file_name
from uvcloth.files.reading import file_below, require_file
from uvcloth.motion.poses import SPLITS

INDEX = "index.csv"
"""Name of the index in a data folder."""

UNUSED = "unused"
"""Split of clips that are neither for training, nor for validation, nor for the test."""

COLUMNS = ("trial", "subject", "split", "action", "window_start", "window_frames")


WHOLE = re.compile(r"\s*[+-]?[0-9]{1,18}\s*")
"""A whole number as it is written in a table; `int` reads others, too."""

MOST_FRAMES = 100_000_000
"""Greatest start and length of a window."""


@dataclass(frozen=True)
class Entry:
    """One window of a clip.

    subject: the captured person. split: one of SPLITS, or UNUSED. start, frames: at 30 frames per second.
    file: the clip's file, relative to a folder of clips; "" where the index does not say.
    """

    clip: str
    subject: str
    split: str
    action: str
    start: int
    frames: int
    file: str = ""


def read_index(path: Path) -> dict[str, Entry]:
    """Read the windows of an index, by clip.

    Raises InputError if it is missing or not such a table, for a clip that it names twice, for an unknown
    split, for a person in two of SPLITS, and for a window that starts before the clip or is empty.
    """
    require_file(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.DictReader(stream, restval="")
            _require_columns(path, rows.fieldnames or ())
            entries: dict[str, Entry] = {}
            for row in rows:
                entry = _entry(path, row)
                if entry.clip in entries:
                    raise InputError(f"{path}: has two rows for the clip {entry.clip}")
                entries[entry.clip] = entry
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table of text") from error
    require_one_split(str(path), ((e.clip, e.subject, e.split) for e in entries.values()))
    return entries


def require_one_split(source: str, clips: Iterable[tuple[str, str, str]]) -> None:
    """Raise InputError naming a person who is in two splits, and a clip of each.

    clips: name, person ("" where unknown) and split of each. source: description for the message.
    """
    first: dict[str, tuple[str, str]] = {}
    for clip, subject, split in clips:
        if split == UNUSED or not subject:
            continue
        other, known = first.setdefault(subject, (clip, split))
        if known != split:
            raise InputError(
                f"{source}: person {subject} is in two splits, {known} (clip {other}) and {split} "
                f"(clip {clip}); keep one and set the split of the other clips to {UNUSED}"
            )


def clip_file(entry: Entry, folder: Path) -> Path:
    """The file of an entry's clip in a folder of clips.

    That is what the index names, else FOLDER/CLIP.bvh or the CLIP.bvh of a folder in it. Raises InputError
    if there is none, or several of one name.
    """
    name = f"{entry.clip}.bvh"
    if entry.file:
        paths = [file_below(folder, folder, entry.file)]
    else:
        patterns = (escape(name), f"*/{escape(name)}")
        paths = [path for pattern in patterns for path in sorted(folder.glob(pattern))]
    if len(paths) > 1:
        raise InputError(f"{folder}: holds two clips {entry.clip} ({paths[0]} and {paths[1]})")
    if not paths or not paths[0].is_file():
        raise InputError(f"{folder}: lacks the clip {entry.clip} ({entry.file or name})")
    return paths[0]


def _require_columns(path: Path, columns: Iterable[str]) -> None:
    missing = [column for column in COLUMNS if column not in columns]
    if "subject" in missing:
        raise InputError(
            f"{path}: lacks the column subject; add one that names the captured person, "
            f"so that no person is in two of {', '.join(SPLITS)}"
        )
    if missing:
        raise InputError(f"{path}: lacks the column {', '.join(missing)}")


def _entry(path: Path, row: dict[str, str]) -> Entry:
    clip = row["trial"]
    if not is_file_name(clip):
        raise InputError(f"{path}: the trial {clip!r:.40} cannot be part of a file's name")
    for column in ("subject", "action", "file"):
        if not row.get(column, "").isprintable() or len(row.get(column, "")) > LONGEST:
            raise InputError(
                f"{path}: the {column} of {clip} is not printable text of at most {LONGEST} characters"
            )
    if not row["subject"]:
        raise InputError(f"{path}: does not name the person of {clip} (column subject)")
    if row["split"] not in (*SPLITS, UNUSED):
        raise InputError(
            f"{path}: the split of {clip} is {row['split']!r:.40}, expected {', '.join(SPLITS)} or {UNUSED}"
        )
    window = (row["window_start"], row["window_frames"])
    if not all(WHOLE.fullmatch(number) for number in window):
        raise InputError(f"{path}: the window of {clip} is not given in whole frames")
    start, frames = map(int, window)
    if not 0 <= start <= MOST_FRAMES or not 1 <= frames <= MOST_FRAMES:
        raise InputError(
            f"{path}: the window of {clip} starts at {start} and has {frames} frames, "
            f"expected a start of at least 0 and at least 1 frame, {MOST_FRAMES} at most"
        )
    return Entry(clip, row["subject"], row["split"], row["action"], start, frames, row.get("file", ""))
