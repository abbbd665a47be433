"""Batch simulation of random outfits: each on its body, over windows of its split."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.folder import Stored, is_finished, keep_refused, require_engine, stored_sequences
from uvcloth.errors import InputError
from uvcloth.files.fields import require_file_name
from uvcloth.garments.joined import join
from uvcloth.motion.index import Entry
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import find_fabric
from uvcloth.simulation.batch import LEAD_IN, Work, simulate_work
from uvcloth.simulation.engine import Engine
from uvcloth.simulation.options import USUAL, SimulationOptions
from uvcloth.simulation.plan import ClipSelection, Job, Source, batch_sources, load_motion
from uvcloth.simulation.run import RUN_UP
from uvcloth.wardrobe.outfit_file import OutfitFile, load_outfit_file, on_body, outfit_files


@dataclass(frozen=True)
class _Task:
    """An outfit and its candidate windows; the first one with a good capture is used."""

    outfit: OutfitFile
    windows: Sequence[Source]

    @property
    def frames(self) -> int:
        """Approximate number of frames to simulate."""
        window = self.windows[0].window
        return (window.frames if window else 0) + RUN_UP + len(LEAD_IN)


def simulate_outfits(
    folder: Path,
    selection: ClipSelection,
    out: Path,
    frames: int | None = None,
    options: SimulationOptions = USUAL,
) -> None:
    """Simulate every outfit of a folder over one window of its split, its garments together, on its body.

    The windows of a split are dealt to its outfits in turn. frames: most frames of a window to simulate.
    options: their fabric is that of all; None for each outfit's own. Written are OUT/<clip>_<garment>.npz and
    OUT/bodies; what is there already is kept. Outfits of a split without windows are left out.
    Raises InputError as `simulate_batch` does, for a folder without outfits, and if all are left out.
    """
    engine, fabric = replace(options, fabric=None).make_engine(), options.fabric
    if frames is not None and frames < 1:
        raise InputError(f"--most-frames {frames}: has to be 1 or more")
    outfits = [load_outfit_file(path) for path in outfit_files(folder)]
    if fabric is not None:
        made_of = find_fabric(fabric)
        outfits = [replace(outfit, fabric_name=fabric, fabric=made_of) for outfit in outfits]
    _require_fabrics(stored_sequences(out), outfits, engine)
    tasks = _deal(outfits, batch_sources(selection), frames)
    todo = [task for task in tasks if not _done(task, out)]
    expected = sum(task.frames for task in todo)
    simulate_work(Work(_jobs(todo, out), expected, [out]), engine, options.workers, out)


def _require_fabrics(stored: Sequence[Stored], outfits: Sequence[OutfitFile], engine: Engine) -> None:
    """Raise InputError if a sequence was made by another engine, with other settings or of another fabric."""
    fabrics = {outfit.name: outfit.fabric for outfit in outfits}
    for each in stored:
        fabric = fabrics.get(str(each.metadata.get("outfit")))
        require_engine([each], (engine if fabric is None else engine.with_fabric(fabric)).describe())


def _deal(outfits: Sequence[OutfitFile], sources: Sequence[Source], frames: int | None) -> list[_Task]:
    """Deal windows to outfits, in turn within a split; validation and test are spread among the training."""
    windows: dict[str, list[Source]] = {split: [] for split in SPLITS}
    for source in sources:
        if source.window is None:
            raise InputError("--outfits: name the windows with --windows, the table of clips")
        windows[source.window.split].append(replace(source, window=_cut(source.window, frames)))
    dealt = dict.fromkeys(SPLITS, 0)
    tasks = []
    for outfit in outfits:
        queue = windows[outfit.split]
        if not queue:
            continue
        first = dealt[outfit.split] % len(queue)
        dealt[outfit.split] += 1
        tasks.append(_Task(outfit, [*queue[first:], *queue[:first]]))
    if not tasks:
        raise InputError("--outfits: the table has no window for the splits of these outfits")
    return tasks


def _cut(window: Entry, frames: int | None) -> Entry:
    return replace(window, frames=min(window.frames, frames or window.frames))


def _done(task: _Task, out: Path) -> bool:
    """True if every garment of an outfit has a sequence over one of its windows, or is refused."""
    return any(all(map(is_finished, _targets(task.outfit, source, out))) for source in task.windows)


def _targets(outfit: OutfitFile, source: Source, out: Path) -> tuple[Path, ...]:
    names = [f"{source.clip}_{piece.file.stem}.npz" for piece in outfit.pieces]
    for name in names:
        require_file_name(name, f"outfit {outfit.name}")
    return tuple(out / name for name in names)


def _jobs(tasks: Sequence[_Task], out: Path) -> Iterator[Job]:
    """Yield a job for each outfit; garments and motion are read when it is its turn."""
    for task in tasks:
        job = _job(task, out)
        if job is not None:
            yield job


def _job(task: _Task, out: Path) -> Job | None:
    """The job of an outfit over the first of its windows with a good capture; None if there is none."""
    worn = on_body(task.outfit)
    body = worn.body
    keep_body(body, out)
    cloths = tuple(join(garment, body) for garment in worn.garments)
    for source in task.windows:
        motion, warm_up, fault = load_motion(source, body)
        if fault is not None:
            keep_refused({source.clip: fault}, out)
            continue
        assert source.window is not None
        return Job(
            motion,
            warm_up,
            body,
            cloths,
            _targets(task.outfit, source, out),
            task.outfit.fabric,
            labels={
                "outfit": task.outfit.name,
                "fabric": task.outfit.fabric_name,
                "types": {piece.file.stem: piece.design.kind for piece in task.outfit.pieces},
                "split": task.outfit.split,
                "subject": source.window.subject,
                "action": source.window.action,
            },
        )
    return None
