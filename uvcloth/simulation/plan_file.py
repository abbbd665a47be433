"""Plan files: tables of simulations, a row for each, from which one command reproduces all data."""

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from uvcloth.dataset.folder import MEMBERS, MEMBERS_FOLDER, NO_DATA, member_folder
from uvcloth.errors import InputError
from uvcloth.files.fields import LONGEST, is_file_name, require_file_name
from uvcloth.files.reading import require_file
from uvcloth.garments.templates import TEMPLATES
from uvcloth.motion.index import MOST_FRAMES, WHOLE, Entry
from uvcloth.motion.poses import SPLITS

PLAN = "plan.csv"
"""Name of the copy of its plan in a data folder."""

PLAN_FPS = 30
"""Frame rate of the frame numbers in a plan."""

LAYERED = "layered"
"""Data folder, in another one, of garments that are worn over one another."""

REQUIRED = ("clip", "start", "frames", "garments", "split", "subject", "action")
OPTIONAL = ("name", "hold", "body", "member")
"""Columns of a plan; the optional ones may also be empty."""

LONGEST_HOLD = 60.0
"""Seconds that a pose may be held."""


@dataclass(frozen=True)
class PlannedMotion:
    """A window of a clip, which moves the body in one or more rows of a plan.

    name: of the motion, in the sequences and the index. clip: a built-in clip, or one of a folder.
    start, frames: the window, at PLAN_FPS. hold: seconds that the body stands in its last pose, after it has
    come to rest. split: one of SPLITS. subject: the captured person.
    """

    name: str
    clip: str
    start: int
    frames: int
    hold: float
    split: str
    subject: str
    action: str

    @property
    def window(self) -> Entry:
        """The window as that of its clip."""
        return Entry(self.clip, self.subject, self.split, self.action, self.start, self.frames)

    @property
    def entry(self) -> Entry:
        """Its row in the index of a data folder, with the frames in which the pose is held."""
        return replace(self.window, clip=self.name, frames=self.frames + round(self.hold * PLAN_FPS))


@dataclass(frozen=True)
class PlanRow:
    """One simulation.

    number: of the row, the header being row 1. garments: templates or mesh files, worn over one another, the
    innermost first. body: file of the body, relative to the plan's folder; "" for the one in the package.
    member: of the ensemble of simulations of the same, 0 to MEMBERS - 1.
    """

    number: int
    motion: PlannedMotion
    garments: tuple[str, ...]
    body: str
    member: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the garments."""
        return tuple(name if name in TEMPLATES else PurePosixPath(name).stem for name in self.garments)

    @property
    def folder(self) -> Path:
        """Data folder of its sequences, relative to that of the plan: all in it are comparable."""
        parts = [PurePosixPath(self.body).stem] if self.body else []
        parts += [LAYERED] if len(self.garments) > 1 else []
        return member_folder(Path(*parts), self.member)

    @property
    def files(self) -> tuple[Path, ...]:
        """File of each garment's sequence, relative to the data folder of the plan."""
        return tuple(self.folder / f"{self.motion.name}_{garment}.npz" for garment in self.names)


def read_plan(path: Path) -> list[PlanRow]:
    """Read a plan, in the order of its rows.

    Raises InputError naming the row: for one that is not as PlanRow has it, for two that write one file, for
    a name or a data folder that stands for two things, and for a person in two splits. Also if the file is
    missing, no such table or empty.
    """
    require_file(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            table = csv.DictReader(stream, restval="")
            missing = [column for column in REQUIRED if column not in (table.fieldnames or ())]
            if missing:
                raise InputError(f"{path}: lacks the column {', '.join(missing)}")
            rows = [_row(path, number, row) for number, row in enumerate(table, 2)]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table of text") from error
    if not rows:
        raise InputError(f"{path}: plans nothing, it has no row")
    _require_consistent(path, rows)
    return rows


def plan_folders(rows: Iterable[PlanRow]) -> dict[Path, list[PlanRow]]:
    """Rows by the data folder of their sequences, relative to that of the plan; this one comes first."""
    folders: dict[Path, list[PlanRow]] = {}
    for row in rows:
        folders.setdefault(row.folder, []).append(row)
    return dict(sorted(folders.items()))


def _row(path: Path, number: int, row: Mapping[str, str]) -> PlanRow:
    where = f"{path}: row {number}"
    cells = {column: (row.get(column) or "").strip() for column in (*REQUIRED, *OPTIONAL)}
    for column, cell in cells.items():
        if not cell.isprintable() or len(cell) > LONGEST:
            raise InputError(f"{where}: the {column} is not printable text of at most {LONGEST} characters")
    for column in ("clip", "garments", "subject"):
        if not cells[column]:
            raise InputError(f"{where}: names no {column}")
    name = cells["name"] or cells["clip"]
    for each in (name, cells["clip"]):
        if not is_file_name(each):
            raise InputError(f"{where}: the clip {each!r:.40} cannot be part of a file's name")
    if cells["split"] not in SPLITS:
        raise InputError(f"{where}: the split is {cells['split']!r:.40}, expected {', '.join(SPLITS)}")
    motion = PlannedMotion(
        name=name,
        clip=cells["clip"],
        start=_whole(where, "start", cells["start"], 0, MOST_FRAMES),
        frames=_whole(where, "frames", cells["frames"], 1, MOST_FRAMES),
        hold=_hold(where, cells["hold"] or "0"),
        split=cells["split"],
        subject=cells["subject"],
        action=cells["action"],
    )
    garments = tuple(part.strip() for part in cells["garments"].split("+"))
    member = _whole(where, "member", cells["member"] or "0", 0, MEMBERS - 1)
    planned = PlanRow(number, motion, garments, cells["body"], member)
    for garment in planned.names:
        if not garment or planned.names.count(garment) > 1:
            raise InputError(f"{where}: {cells['garments']} names a garment twice, or one without a name")
    for file in planned.files:
        require_file_name(file.name, where)
    if planned.body:
        folder = planned.folder.parts[0]
        require_file_name(folder, where)
        if folder in (*NO_DATA, LAYERED, MEMBERS_FOLDER):
            raise InputError(
                f"{where}: a body cannot be named {folder}, which is a folder of the data; rename its file"
            )
    return planned


def _whole(where: str, column: str, cell: str, least: int, most: int) -> int:
    if not WHOLE.fullmatch(cell) or not least <= int(cell) <= most:
        raise InputError(f"{where}: the {column} is {cell!r:.40}, expected a whole number, {least} to {most}")
    return int(cell)


def _hold(where: str, cell: str) -> float:
    try:
        seconds = float(cell)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds <= LONGEST_HOLD:
        raise InputError(f"{where}: the hold is {cell!r:.40}, expected 0 to {LONGEST_HOLD:.0f} seconds")
    return seconds


def _require_consistent(path: Path, rows: Iterable[PlanRow]) -> None:
    """Raise InputError naming the first row that contradicts one above it."""
    people: dict[str, PlanRow] = {}
    motions: dict[str, PlanRow] = {}
    bodies: dict[str, PlanRow] = {}
    outfits: dict[tuple[Path, str], PlanRow] = {}
    files: dict[str, PlanRow] = {}
    for row in rows:
        where, motion = f"{path}: row {row.number}", row.motion
        other = people.setdefault(motion.subject, row)
        if other.motion.split != motion.split:
            raise InputError(
                f"{where}: person {motion.subject} is in two splits, {motion.split} here and "
                f"{other.motion.split} in row {other.number}"
            )
        other = motions.setdefault(motion.name.casefold(), row)
        if other.motion != motion:
            raise InputError(
                f"{where}: row {other.number} gives the name {motion.name} to another motion; change one of "
                "them in the column name"
            )
        other = bodies.setdefault(PurePosixPath(row.body).stem.casefold(), row)
        if other.body != row.body:
            raise InputError(f"{where}: its body has the same name as {other.body} in row {other.number}")
        for file in row.files:
            other = files.setdefault(str(file).casefold(), row)
            if other is not row:
                raise InputError(f"{where}: makes {file}, which row {other.number} already makes")
        for garment in row.names:
            other = outfits.setdefault((row.folder, garment), row)
            if other.names != row.names:
                raise InputError(
                    f"{where}: wears {garment} as {' under '.join(row.names)}, row {other.number} as "
                    f"{' under '.join(other.names)}; a data folder holds one outfit, plan the other in a "
                    "separate file"
                )
