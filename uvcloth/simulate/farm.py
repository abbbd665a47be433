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
from uvcloth.garments.templates import wear
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.simulate.accept import examine
from uvcloth.simulate.index import INDEX, read_index
from uvcloth.simulate.lead_in import LeadIn
from uvcloth.simulate.newton import Style3D
from uvcloth.simulate.run import run_up, simulate
from uvcloth.simulate.sequence import Sequence as Recording
from uvcloth.simulate.sequence import save_sequence

REPEAT_EARLIER = 20
"""Frames by which the second start of a window is earlier, for the repeatability floor."""

TOPIC = "uvcloth-frames"
PARTS = LeadIn()
ENGINES = {
    "tops": Style3D(),
    "bottoms": Style3D(),
    # Stiff contact presses hard for an instant, and with friction walks a skirt up the thighs.
    "dress": Style3D(contact_stiffness=1e3, friction=0.15),
}


@dataclass(frozen=True)
class Job:
    """One sequence to make: a motion (run-up included) and how many of its leading frames do not count."""

    motion: Clip
    settling: int
    garment: str
    target: Path


def simulate_batch(
    clips: Sequence[str],
    garments: Sequence[str],
    out: Path,
    body: Body,
    windows: Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    repeat: bool = False,
) -> None:
    """Simulate every clip with every garment into OUT/<clip>_<garment>.npz; what is there already is kept.

    windows: an index of clips and windows, copied to OUT/index.csv.
    repeat: start each window REPEAT_EARLIER frames earlier and write to OUT/repeat instead.
    Sequences that `examine` refuses go to OUT/rejected with the reason in their metadata.
    Raises InputError for unreadable clips or windows, for clips that would share a file, if OUT cannot be
    written or was made from other windows, for a scheduler that does not answer, or if the `simulate` extra
    is missing.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: expected at least 1")
    try:
        from dask.distributed import LocalCluster, as_completed
    except ModuleNotFoundError as error:
        raise InputError("simulating needs dask and Newton: install uvcloth[simulate]") from error
    todo = [
        job
        for job in plan(clips, garments, out / "repeat" if repeat else out, body, windows, repeat)
        if not (job.target.exists() or _rejected(job.target).exists())
    ]
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
        waiting = {client.submit(_work, job, shared, pure=False): job for job in todo}
        for future in as_completed(list(waiting)):
            job = waiting[future]
            recording, reason = future.result()
            progress.console.print(_keep(recording, reason, job))
            future.release()


def plan(
    clips: Sequence[str],
    garments: Sequence[str],
    out: Path,
    body: Body,
    windows: Path | None = None,
    earlier: bool = False,
) -> list[Job]:
    """The sequences to make, one per clip and garment. Raises InputError as simulate_batch does."""
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
        for garment in garments:
            target = out / f"{clip.name}_{garment}.npz"
            if target in sources:
                raise InputError(f"{target}: both {sources[target]} and {name} would be written there")
            sources[target] = name
            made.append(Job(motion, before, garment, target))
    return made


def _keep_index(windows: Path, kept: Path) -> None:
    """Copy the windows, by which training and evaluation will go. Raises InputError if others are kept."""
    if not kept.exists():
        with atomic_write(kept) as partial:
            shutil.copyfile(windows, partial)
    elif read_index(kept) != read_index(windows):
        raise InputError(f"{kept}: holds other windows than {windows}, simulate them into another folder")


def _connect(cluster: Any) -> Any:
    """A client of a local cluster, or of the scheduler at an address."""
    from dask.distributed import Client

    try:
        return Client(cluster)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {cluster}: no dask scheduler answers there ({error})") from error


def _work(job: Job, body: Body) -> tuple[Recording, str | None]:
    """Runs in a worker process: one core, frames reported as they are made."""
    import torch
    from dask.distributed import get_worker

    torch.set_num_threads(1)
    report: Callable[[int], None] = lambda made: get_worker().log_event(TOPIC, made)  # noqa: E731
    garment = wear(job.garment, body)
    recording = simulate(job.motion, job.settling, garment, body, ENGINES[job.garment], PARTS, report)
    return examine(recording, body)


def _keep(recording: Recording, reason: str | None, job: Job) -> str:
    """Write a finished sequence where it belongs and say so."""
    if reason is None:
        save_sequence(recording, job.target)
        seconds = recording.metadata["wall_seconds"] / len(recording.vertices)
        inside = recording.metadata["inside_percent"]
        return f"{job.target}: {seconds:.2f} s per frame, {inside:.2f} % inside"
    target = _rejected(job.target)
    save_sequence(replace(recording, metadata={**recording.metadata, "rejected": reason}), target)
    return f"{target}: kept apart, {reason}"


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
