"""Batch simulation: many sequences in parallel processes, on this machine or on a dask cluster."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.dataset.folder import (
    MEMBERS,
    keep_index,
    keep_refused,
    member_folder,
    rejected,
    require_same,
    stored_sequences,
)
from uvcloth.errors import InputError
from uvcloth.files.atomic import require_there, sole_writer
from uvcloth.garments.garment import Garment
from uvcloth.garments.joined import EngineMesh, join
from uvcloth.garments.loading import load_garment_for_data
from uvcloth.garments.order import check_order
from uvcloth.garments.untangling import untangle
from uvcloth.motion.index import INDEX
from uvcloth.motion.lead_in import LeadIn
from uvcloth.simulation.engine import Engine
from uvcloth.simulation.members import member_engine
from uvcloth.simulation.options import USUAL, SimulationOptions
from uvcloth.simulation.plan import ClipSelection, Job, batch_sources, plan
from uvcloth.simulation.progress import FramesBar
from uvcloth.simulation.quality_check import examine
from uvcloth.simulation.run import simulate
from uvcloth.simulation.unfinished import Place, clear_finished
from uvcloth.simulation.workers import Workers, connected, results

LOGGER = logging.getLogger(__name__)

FRAMES_TOPIC = "uvcloth-frames"
"""Topic under which workers report frames."""

LEAD_IN = LeadIn()


@dataclass(frozen=True)
class Work:
    """Simulations of a command, whose sequences go into its folder, or folders in it.

    jobs: the missing ones, in order; the next one is taken when a worker is free. frames: approximate number
    for all. folders: data folders of the targets. refused: by folder, captures that are not simulated, and
    the reason of each. keep: writes the files that belong to the sequences, such as bodies and the index.
    """

    jobs: Iterable[Job]
    frames: int
    folders: Sequence[Path]
    refused: Mapping[Path, Mapping[str, str]] = field(default_factory=dict)
    keep: Callable[[], None] = lambda: None


def simulate_batch(
    selection: ClipSelection,
    outfits: Sequence[Sequence[str]],
    out: Path,
    body: Body,
    ensemble: bool = False,
    options: SimulationOptions = USUAL,
) -> None:
    """Simulate every clip with every outfit into OUT/<clip>_<garment>.npz; what is there already is kept.

    selection: its index, if any, is copied to OUT/index.csv. body: is kept in OUT/bodies. outfits: garments
    that are simulated together, each outfit by itself, the innermost garment first: template names or mesh
    files, whose garment is named by the file's stem. ensemble: simulate everything MEMBERS times, as
    `member_engine` has it, and write the other members to OUT/members/<member>.

    Sequences that `examine` refuses go to OUT/rejected with the reason in their metadata, all layers of an
    outfit together. Faulty captures are not simulated, but named in OUT/refused.csv, as are sequences that
    the engine cannot simulate.
    Raises InputError for unreadable clips, garments or windows, for garments that cannot be simulated or
    cross as layers, for sequences that would share a file, if OUT cannot be written, is written by another
    process, or was made from other windows, layers, settings or on another body, for a scheduler that does
    not answer, or if the engine or the `simulate` extra is missing.
    """
    engine = options.make_engine()
    cloths = _cloths(outfits, body)
    for outfit in cloths:
        check_order([cloth.garment for cloth in outfit])
    sources = batch_sources(selection)
    names = [tuple(cloth.garment.name for cloth in outfit) for outfit in cloths]
    folders = [member_folder(out, member) for member in range(MEMBERS if ensemble else 1)]
    for member, folder in enumerate(folders):
        made = member_engine(engine, member)
        require_same(stored_sequences(folder), body, made.describe(), names)
    todo, refused = plan(sources, cloths, folders, body)

    def keep() -> None:
        for folder in folders:
            keep_body(body, folder)
            if selection.windows is not None:
                keep_index(selection.windows, folder / INDEX)

    work = Work(todo, count_frames(todo), folders, {out: refused} if refused else {}, keep)
    simulate_work(work, engine, options.workers, out)


def simulate_work(work: Work, engine: Engine, workers: Workers, out: Path) -> None:
    """Write the files that belong to the sequences, and simulate as `simulate_all` does, if anything is
    missing.

    out: the command's folder, which only one process may write.
    """
    with sole_writer(out):
        for folder in work.folders:
            clear_finished(folder)
        work.keep()
        for folder, reasons in work.refused.items():
            keep_refused(reasons, folder)
            for clip, reason in reasons.items():
                LOGGER.warning("%s: refused, %s", clip, reason)
        if work.frames:
            simulate_all(work.jobs, work.frames, engine, workers, out)
        else:
            LOGGER.info("%s: every sequence is there already", out)


def simulate_all(todo: Iterable[Job], frames: int, engine: Engine, workers: Workers, folder: Path) -> None:
    """Simulate in order, as many at a time as there are cores, and keep each sequence as it is done.

    todo: is asked for the next job when there is room for it. frames: of all jobs. folder: of their targets.
    Raises InputError without dask, as soon as the folder is gone, and as `results` does.
    """
    count = len(todo) if isinstance(todo, Sized) else None
    with connected(workers, count) as client, FramesBar(frames) as bar:
        client.subscribe_topic(FRAMES_TOPIC, lambda event: bar.report(*event[1]))
        work, look = (
            partial(_simulate_job, engine=engine, folder=folder, here=Path.cwd()),
            partial(require_there, folder),
        )
        for job, (clip, reason) in results(client, todo, work, look):
            bar.advance(count_frames([job]) - (len(clip.transforms) if clip else 0))
            lines = _store(reason, clip, job.targets) if clip else [_refuse(reason, job.targets)]
            bar.print("\n".join(lines))
            clear_finished(job.targets[0].parent)
            bar.print_progress()


def _cloths(outfits: Sequence[Sequence[str]], body: Body) -> list[tuple[EngineMesh, ...]]:
    """Load the garments, untangled and ready to simulate. Raises InputError also if two have one name.

    Names that differ only in capitals count as the same: on Windows and macOS their files are the same.
    """
    taken: dict[str, str] = {}

    def load(name: str) -> Garment:
        garment = load_garment_for_data(name, body, LOGGER.info)
        same = garment.name.casefold()
        if same in taken:
            raise InputError(f"garment {name}: another one is also named {taken[same]}")
        taken[same] = garment.name
        return garment

    worn = [untangle([load(name) for name in outfit], body) for outfit in outfits]
    for line in chain.from_iterable(outfit.lines for outfit in worn):
        LOGGER.info(line)
    return [tuple(join(garment, body) for garment in outfit.garments) for outfit in worn]


def _simulate_job(
    job: Job, engine: Engine, folder: Path, here: Path
) -> tuple[SimulatedClip | None, str | None]:
    """Simulate and examine a job in a worker process, on one core, and report frames as they are made.

    folder: of its targets. here: the folder that paths are relative to; workers may run in another. Returns
    the clip, and the reasons why it is refused, None if it is not; no clip, and the reason, for a job that
    the engine cannot simulate.
    """
    import torch
    from dask.distributed import get_worker

    torch.set_num_threads(1)
    if job.fabric is not None:
        engine = engine.with_fabric(job.fabric)
    engine = member_engine(engine, job.member)
    # The last of the targets is written last: if it exists, all do.
    place = Place(here / folder, here / job.targets[-1])

    name = place.target.relative_to(place.folder).with_suffix("").as_posix()

    def report(made: int) -> None:
        get_worker().log_event(FRAMES_TOPIC, (name, made))

    try:
        made = simulate(job.motion, job.warm_up, job.cloths, job.body, engine, LEAD_IN, report, place)
    except InputError as error:
        return None, str(error)
    examined, reason = examine(made, [cloth.garment for cloth in job.cloths], job.body)
    return examined.labelled(**job.labels), reason


def _refuse(reason: str | None, targets: Sequence[Path]) -> str:
    """Name sequences that cannot be simulated in their folder's table, and return a line of text on them."""
    for target in targets:
        keep_refused({target.stem: str(reason)}, target.parent)
    return f"{targets[-1]}: refused, {reason}"


def _store(reason: str | None, clip: SimulatedClip, targets: Sequence[Path]) -> list[str]:
    """Write a finished clip, a refused one to the folder of refused ones; a line of text on each garment."""
    if reason is not None:
        elsewhere = [rejected(target) for target in targets]
        save_simulated(clip.labelled(rejected=reason), *elsewhere)
        return [f"{target}: kept apart, {reason}" for target in elsewhere]
    save_simulated(clip, *targets)
    seconds = clip.metadata["wall_seconds"] / len(clip.transforms)
    lines = []
    for garment, target in zip(clip.garments, targets, strict=True):
        figures = [f"{seconds:.2f} s per frame", f"{garment.metadata['inside_percent']:.2f} % inside"]
        for name, share in garment.metadata.get("wrong_side_percent", {}).items():
            figures.append(f"{share:.2f} % on the wrong side of {name}")
        lines.append(f"{target}: {', '.join(figures)}")
    return lines


def count_frames(jobs: Iterable[Job]) -> int:
    """Number of frames that jobs simulate, lead-in included."""
    return sum(len(job.motion) + len(LEAD_IN) for job in jobs)
