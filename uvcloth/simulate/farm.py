"""Simulate many sequences in parallel processes, on this machine or on a dask cluster."""

import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from rasterize.atomic import atomic_write, make_folder
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.order import check_order
from uvcloth.garments.wardrobe import take_for_data
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.simulate.accept import examine
from uvcloth.simulate.cloth import Cloth, join
from uvcloth.simulate.engine import Engine
from uvcloth.simulate.engines import ENGINES
from uvcloth.simulate.index import INDEX, read_index
from uvcloth.simulate.lead_in import LeadIn
from uvcloth.simulate.run import run_up, simulate
from uvcloth.simulate.sequence import Sequence as Recording
from uvcloth.simulate.sequence import load_sequence, save_sequence

REPEAT_EARLIER = 20
"""Frames by which the second start of a window is earlier, for the repeatability floor."""

TOPIC = "uvcloth-frames"
PARTS = LeadIn()


@dataclass(frozen=True)
class Job:
    """One simulation: a motion (run-up included), how many of its leading frames do not count, and garments.

    Several cloths meet each other, the first is innermost; each has a target, the file of its sequence.
    """

    motion: Clip
    settling: int
    cloths: tuple[Cloth, ...]
    targets: tuple[Path, ...]

    @property
    def done(self) -> bool:
        return all(target.exists() or _rejected(target).exists() for target in self.targets)


def simulate_batch(
    clips: Sequence[str],
    garments: Sequence[str],
    out: Path,
    body: Body,
    windows: Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    repeat: bool = False,
    layered: bool = False,
    engine: str = "newton",
) -> None:
    """Simulate every clip with every garment into OUT/<clip>_<garment>.npz; what is there already is kept.

    garments: template names or mesh files, whose garment is named by the file's stem. layered: they are worn
    over one another, the first innermost, and simulated together; otherwise each alone.
    windows: an index of clips and windows, copied to OUT/index.csv.
    engine: one of ENGINES.
    repeat: start each window REPEAT_EARLIER frames earlier and write to OUT/repeat instead.
    Sequences that `examine` refuses go to OUT/rejected with the reason in their metadata, all layers of an
    outfit together.
    Raises InputError for unreadable clips, garments or windows, for garments that cannot be simulated or
    cross as layers, for sequences that would share a file, if OUT cannot be written or was made from other
    windows or layers, for a scheduler that does not answer, or if the engine or the `simulate` extra is
    missing.
    """
    if engine not in ENGINES:
        raise InputError(f"--engine {engine}: expected one of {', '.join(ENGINES)}")
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: expected at least 1")
    try:
        from dask.distributed import LocalCluster, as_completed
    except ModuleNotFoundError as error:
        raise InputError("simulating needs dask and Newton: install uvcloth[simulate]") from error
    cloths = _cloths(garments, body)
    outfits = [tuple(cloths)] if layered else [(cloth,) for cloth in cloths]
    for outfit in outfits:
        check_order([cloth.garment for cloth in outfit])
    planned = plan(clips, outfits, out / "repeat" if repeat else out, body, windows, repeat)
    _require_same_layers(planned)
    todo = [job for job in planned if not job.done]
    engines = [ENGINES[engine](job.cloths) for job in todo]
    make_folder(out)
    if windows is not None:
        _keep_index(windows, out / INDEX)
    if not todo:
        print(f"{out}: every sequence is there already")
        return
    frames = sum(len(job.motion) + len(PARTS) for job in todo)
    with ExitStack() as stack:
        cluster: Any = scheduler
        if scheduler is None:
            workers = min(jobs or os.cpu_count() or 1, len(todo))
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=50
            )
            stack.callback(_close, cluster)
        client = stack.enter_context(_connect(cluster))
        progress = stack.enter_context(_progress())
        bar = progress.add_task(f"{len(todo)} sequences", total=frames)
        client.subscribe_topic(TOPIC, lambda event: progress.advance(bar, event[1]))
        shared = client.scatter(body, broadcast=True)
        waiting = {
            client.submit(_work, job, shared, made_by, pure=False): job
            for job, made_by in zip(todo, engines, strict=True)
        }
        for future in as_completed(list(waiting)):
            job = waiting[future]
            recordings, reason = future.result()
            for recording, target in zip(recordings, job.targets, strict=True):
                progress.console.print(_keep(recording, reason, target), soft_wrap=True)
            future.release()


def _cloths(names: Sequence[str], body: Body) -> list[Cloth]:
    """The garments, ready to simulate. Raises InputError also if two of them have one name."""
    cloths: dict[str, Cloth] = {}
    for name in names:
        cloth = join(take_for_data(name, body, print), body)
        if cloth.garment.name in cloths:
            raise InputError(f"garment {name}: another one is also named {cloth.garment.name}")
        cloths[cloth.garment.name] = cloth
    return list(cloths.values())


def plan(
    clips: Sequence[str],
    outfits: Sequence[tuple[Cloth, ...]],
    out: Path,
    body: Body,
    windows: Path | None = None,
    earlier: bool = False,
) -> list[Job]:
    """The simulations to make, one per clip and outfit. Raises InputError as simulate_batch does."""
    table = read_index(windows) if windows is not None else {}
    made = []
    sources: dict[Path, str] = {}
    for name in clips:
        clip = load_clip(name, body)
        start, frames = 0, len(clip)
        if windows is not None:
            if clip.name not in table:
                raise InputError(f"{windows}: has no row for the clip {clip.name}")
            start, frames = table[clip.name].start, table[clip.name].frames
        if start + frames > len(clip):
            raise InputError(f"{name}: has {len(clip)} frames, the window ends at {start + frames}")
        motion, before = run_up(clip, start, frames, REPEAT_EARLIER if earlier else 0)
        for outfit in outfits:
            targets = tuple(out / f"{clip.name}_{cloth.garment.name}.npz" for cloth in outfit)
            for target in targets:
                if target in sources:
                    raise InputError(f"{target}: both {sources[target]} and {name} would be written there")
                sources[target] = name
            made.append(Job(motion, before, outfit, targets))
    return made


def _keep_index(windows: Path, kept: Path) -> None:
    """Copy the windows, by which training and evaluation will go. Raises InputError if others are kept."""
    if not kept.exists():
        with atomic_write(kept) as partial:
            shutil.copyfile(windows, partial)
    elif read_index(kept) != read_index(windows):
        raise InputError(f"{kept}: holds other windows than {windows}, simulate them into another folder")


def _require_same_layers(jobs: Sequence[Job]) -> None:
    """Raise InputError if the first sequence that is kept was simulated with other layers, or alone."""
    for job in jobs:
        layers = tuple(cloth.garment.name for cloth in job.cloths)
        for target in filter(Path.exists, job.targets):
            found = load_sequence(target).layers
            if found == layers:
                return
            raise InputError(
                f"{target}: was simulated as {' under '.join(found)}, not as {' under '.join(layers)}, "
                "simulate into another folder"
            )


def _connect(cluster: Any) -> Any:
    """A client of a local cluster, or of the scheduler at an address."""
    from dask.distributed import Client

    try:
        return Client(cluster)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {cluster}: no dask scheduler answers there ({error})") from error


def _work(job: Job, body: Body, engine: Engine) -> tuple[list[Recording], str | None]:
    """Runs in a worker process: one core, frames reported as they are made."""
    import torch
    from dask.distributed import get_worker

    torch.set_num_threads(1)
    report: Callable[[int], None] = lambda made: get_worker().log_event(TOPIC, made)  # noqa: E731
    made = simulate(job.motion, job.settling, job.cloths, body, engine, PARTS, report)
    examined = [examine(recording, body) for recording in made]
    reasons = [
        reason if len(made) == 1 else f"{recording.garment}: {reason}"
        for recording, reason in examined
        if reason is not None
    ]
    return [recording for recording, _ in examined], "; ".join(reasons) or None


def _keep(recording: Recording, reason: str | None, target: Path) -> str:
    """Write a finished sequence where it belongs and say so."""
    if reason is not None:
        apart = _rejected(target)
        save_sequence(replace(recording, metadata={**recording.metadata, "rejected": reason}), apart)
        return f"{apart}: kept apart, {reason}"
    save_sequence(recording, target)
    seconds = recording.metadata["wall_seconds"] / len(recording.vertices)
    said = [f"{seconds:.2f} s per frame", f"{recording.metadata['inside_percent']:.2f} % inside"]
    for name, share in recording.metadata.get("wrong_side_percent", {}).items():
        said.append(f"{share:.2f} % on the wrong side of {name}")
    return f"{target}: {', '.join(said)}"


def _close(cluster: Any) -> None:
    """End the workers; one that is slow to go, on a busy machine, is killed with this process."""
    with suppress(TimeoutError):
        cluster.close(timeout=30)


def _rejected(target: Path) -> Path:
    return target.parent / "rejected" / target.name


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    )
