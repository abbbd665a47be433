"""Simulation of a plan: all rows of a file, each into the data folder where its readers look for it."""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from rich.progress import track

from uvcloth.bodies.body import Body, load_body
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.folder import (
    add_windows,
    is_finished,
    require_same,
    require_windows,
    stored_sequences,
)
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.files.reading import file_below
from uvcloth.garments.joined import EngineMesh, join
from uvcloth.garments.loading import load_garment_for_data
from uvcloth.garments.order import check_order
from uvcloth.garments.templates import TEMPLATES
from uvcloth.garments.untangling import untangle
from uvcloth.motion.clip import Clip
from uvcloth.motion.index import INDEX, clip_file
from uvcloth.motion.library import builtin_clips
from uvcloth.motion.stop import come_to_rest
from uvcloth.simulation.batch import Work, count_frames, simulate_work
from uvcloth.simulation.engine import Engine
from uvcloth.simulation.members import member_engine
from uvcloth.simulation.options import USUAL, SimulationOptions
from uvcloth.simulation.plan import Job, Source, interleaved, load_motion
from uvcloth.simulation.plan_file import PLAN, PlanRow, plan_folders, read_plan


def simulate_plan(
    plan: Path,
    out: Path,
    clips_from: Path | None = None,
    options: SimulationOptions = USUAL,
) -> None:
    """Simulate every row of a plan into OUT; what is there already is kept.

    clips_from: folder of the clips, by default the plan's. Each part of the plan, see `PlanRow.folder`, is a
    data folder with an index and a body of its own, OUT that of single garments on the body in the package;
    a copy of the plan lies in it. Raises InputError, before anything is simulated, as `simulate_batch` does,
    and as `read_plan` does, naming the faulty row.
    """
    engine = options.make_engine()
    rows = ordered(read_plan(plan))
    _require_members(plan, rows, engine)
    stock = _Stock(plan, clips_from or plan.parent)
    folders = plan_folders(rows)
    for folder, folder_rows in folders.items():
        outfits = [*{row.names: None for row in folder_rows}]
        made = member_engine(engine, folder_rows[0].member)
        require_same(stored_sequences(out / folder), stock.body(folder_rows[0]), made.describe(), outfits)
        require_windows((row.motion.entry for row in folder_rows), out / folder / INDEX)
    missing = [row for row in rows if not all(is_finished(out / file) for file in row.files)]
    clips = [stock.clip_file(row) for row in missing]
    dressed = [stock.cloths(row) for row in track(missing, "reading garments", transient=True)]
    todo: list[Job] = []
    refused: dict[Path, dict[str, str]] = {}
    for row, clip, cloths in track(
        [*zip(missing, clips, dressed, strict=True)], "reading clips", transient=True
    ):
        motion, warm_up, fault = stock.motion(row, clip)
        if fault is not None:
            refused.setdefault(out / row.folder, {})[row.motion.name] = fault
            continue
        targets, body = tuple(out / file for file in row.files), stock.body(row)
        todo.append(Job(motion, warm_up, body, cloths, targets, member=row.member, labels=_labels(row)))

    def keep() -> None:
        with atomic_write(out / PLAN) as partial:
            shutil.copyfile(plan, partial)
        for folder, folder_rows in folders.items():
            keep_body(stock.body(folder_rows[0]), out / folder)
            add_windows((row.motion.entry for row in folder_rows), out / folder / INDEX)

    work = Work(todo, count_frames(todo), [out / folder for folder in folders], refused, keep)
    simulate_work(work, engine, options.workers, out)


def ordered(rows: Sequence[PlanRow]) -> list[PlanRow]:
    """Order rows so that any first part is a good mixture.

    Single garments come before layered ones, ensemble members last; within each validation, test, training,
    as `interleaved` orders them, with all garments and bodies of a motion one after another.
    """
    motions = interleaved({row.motion.name: row.motion.entry for row in rows}.values())
    places = {entry.clip: place for place, entry in enumerate(motions)}
    return sorted(rows, key=lambda row: (row.member > 0, len(row.garments) > 1, places[row.motion.name]))


@dataclass
class _Stock:
    """Clips, bodies and garments that the rows of a plan name, each read once.

    plan: its file. clips: the folder of clips. Every method raises InputError that names the row.
    """

    plan: Path
    clips: Path
    bodies: dict[str, Body] = field(default_factory=dict)
    worn: dict[tuple[str, ...], tuple[EngineMesh, ...]] = field(default_factory=dict)
    motions: dict[tuple[str, str], tuple[Clip, int, str | None]] = field(default_factory=dict)

    def clip_file(self, row: PlanRow) -> str:
        """Name or file of the clip of a row's motion."""
        with self._named(row):
            if row.motion.clip in builtin_clips():
                return row.motion.clip
            return str(clip_file(row.motion.window, self.clips))

    def body(self, row: PlanRow) -> Body:
        if row.body not in self.bodies:
            with self._named(row):
                self.bodies[row.body] = load_body(self._file(row.body) if row.body else None)
        return self.bodies[row.body]

    def cloths(self, row: PlanRow) -> tuple[EngineMesh, ...]:
        """Garments of a row on its body, ready to simulate, untangled and checked to lie over one another."""
        key = (row.body, *row.garments)
        if key not in self.worn:
            body = self.body(row)
            with self._named(row):
                sources = [name if name in TEMPLATES else self._garment(name) for name in row.garments]
                worn = untangle([load_garment_for_data(name, body) for name in sources], body)
                self.worn[key] = tuple(join(garment, body) for garment in worn.garments)
                check_order([cloth.garment for cloth in self.worn[key]])
        return self.worn[key]

    def motion(self, row: PlanRow, file: str) -> tuple[Clip, int, str | None]:
        """Motion of a row on its body with its run-up, the frames of that, and the capture's fault, if any.

        file: name or file of the clip.
        """
        key = (row.body, row.motion.name)
        if key not in self.motions:
            body = self.body(row)
            with self._named(row):
                source = Source(file, row.motion.name, row.motion.window)
                motion, warm_up, fault = load_motion(source, body)
                if row.motion.hold:
                    motion = come_to_rest(motion, row.motion.hold)
                self.motions[key] = motion, warm_up, fault
        return self.motions[key]

    def _garment(self, name: str) -> str:
        """Path of a garment file."""
        if "." not in name:
            raise InputError(
                f"garment {name}: no such template, expected one of {', '.join(TEMPLATES)}, or a garment file"
            )
        return str(self._file(name))

    def _file(self, name: str) -> Path:
        folder = self.plan.parent
        path = file_below(folder, folder, name)
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        return path

    @contextmanager
    def _named(self, row: PlanRow) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise InputError(f"{self.plan}: row {row.number}: {error}") from error


def _require_members(plan: Path, rows: Sequence[PlanRow], engine: Engine) -> None:
    """Raise InputError naming the first row of an ensemble member that the engine cannot simulate."""
    for row in rows:
        try:
            member_engine(engine, row.member)
        except InputError as error:
            raise InputError(f"{plan}: row {row.number}: {error}") from error


def _labels(row: PlanRow) -> dict[str, str | int | float]:
    """Metadata of the sequences of a row, besides those of every simulation."""
    motion = row.motion
    return {
        "trial": motion.clip,
        "start": motion.start,
        "hold": motion.hold,
        "member": row.member,
        "split": motion.split,
        "subject": motion.subject,
        "action": motion.action,
    }
