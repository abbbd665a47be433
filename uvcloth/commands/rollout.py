"""`uvcloth rollout`: a motion and garments to an animation file."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from rasterize.errors import InputError
from uvcloth.bodies.body import load_body
from uvcloth.export.writer import open_writer
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.records import CPU, to_device
from uvcloth.methods.method import Method
from uvcloth.methods.registry import DEFAULT, load_methods
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import DEFAULTS, load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.exposure import Exposure
from uvcloth.rollout import BrokenRolloutError, RolloutFrame, rollout


@dataclass(frozen=True)
class Summary:
    """Summary of a rollout.

    written: the files. seconds: wall time of all frames. milliseconds: per frame, by stage. skin: percent of
    the skin that the garments cover at rest that shows through them in what was written. inside_before,
    inside_after: percent of the garment vertices inside the body before contact (and after what it carries
    over from frame to frame) and after it, but for those squeezed between parts of the body; squeezed:
    percent of those. None without contact.
    """

    written: tuple[Path, ...]
    frames: int
    seconds: float
    milliseconds: dict[str, float]
    skin: float
    inside_before: float | None
    inside_after: float | None
    squeezed: float | None

    def lines(self) -> list[str]:
        """The summary as text for a terminal."""
        stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in self.milliseconds.items())
        rate = self.frames / self.seconds
        lines = [
            *(str(path) for path in self.written),
            f"{self.frames} frames in {self.seconds:.1f} s, {rate:.1f} frames per second",
            f"ms per frame: {stages}",
        ]
        if self.inside_before is not None:
            inside = f"{self.inside_before:.2f} %, after contact {self.inside_after:.2f} %"
            squeezed = f"squeezed between its parts {self.squeezed:.2f} %"
            lines.append(f"vertices inside the body: {inside}; {squeezed}")
        lines.append(f"skin shows through {self.skin:.2f} % of the cloth that covers it")
        return lines


@dataclass
class _Totals:
    """Sums over the frames of a rollout so far; counts are of vertices."""

    frames: int = 0
    inside_before: int = 0
    inside_after: int = 0
    squeezed: int = 0
    skin: float = 0.0
    milliseconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, frame: RolloutFrame) -> None:
        """Add what the rollout measured in a frame."""
        self.frames += 1
        for stage, milliseconds in frame.milliseconds.items():
            self.milliseconds[stage] += milliseconds
        for contacts in frame.contacts:
            self.inside_before += contacts.inside_before
            self.inside_after += contacts.inside_after
            self.squeezed += contacts.squeezed

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the time that the block takes to a stage."""
        begun = perf_counter()
        yield
        self.milliseconds[stage] += 1e3 * (perf_counter() - begun)


def animate(
    models: Sequence[str],
    motion: str,
    garments: Sequence[str],
    out: Sequence[Path],
    *,
    body_file: Path | None = None,
    contact: bool = True,
    device: str = "cpu",
    options: MotionOptions = DEFAULTS,
) -> Summary:
    """Roll a method out on a motion once and write every file of `out`, each as its suffix says.

    models: a checkpoint folder or a baseline's name for all garments, or one for each in order; none for the
    model in the package. garments: template names or mesh files, the innermost first; contact keeps each out
    of the body and off what is beneath. device: as torch names it. options: how the motion is read; of one
    frame, a pose, the body moves into it from rest. Raises InputError for bad input or a full disk; then, as
    after Ctrl-C, writes nothing. Of a rollout that breaks the frames before it are kept, and an InputError
    says so.
    """
    console = Console(stderr=True)
    body = load_body(body_file)
    report = partial(console.print, highlight=False, markup=False)
    outfit = Outfit(body, tuple(load_garment(name, body, report) for name in garments))
    clip = pose_from_rest(load_clip(motion, body, options), body)
    place = _device(device)
    method = _load(models, outfit)
    meshes = [(garment.name, garment.mesh) for garment in outfit.garments]
    exposure = Exposure(body, [mesh for _, mesh in meshes])
    totals = _Totals()
    start = perf_counter()
    with ExitStack() as stack:
        writers = [stack.enter_context(open_writer(path, meshes, body, clip.fps)) for path in out]
        progress = stack.enter_context(_progress(console))
        task = progress.add_task(clip.name, total=len(clip), rate="")
        broken: BrokenRolloutError | None = None
        try:
            for predicted in rollout(method, outfit, clip.transforms(), clip.fps, contact, device=place):
                frame = to_device(predicted, CPU)
                totals.add(frame)
                with totals.timed("measuring"):
                    totals.skin += exposure.percent(frame.vertices, frame.body_vertices)
                with totals.timed("writing"):
                    for writer in writers:
                        writer.add(frame.vertices, frame.transforms)
                rate = totals.frames / (perf_counter() - start)
                progress.update(task, advance=1, rate=f"{rate:.1f} frames per second")
        except BrokenRolloutError as error:
            if not totals.frames:
                raise
            broken = error
        # Only when every file is whole may the first of them appear.
        with totals.timed("writing"):
            for writer in writers:
                writer.finish()
    written = tuple(path for writer in writers for path in writer.written)
    if broken:
        names = ", ".join(map(str, written))
        raise InputError(f"{broken}; the {totals.frames} frames before it are in {names}")
    vertices = totals.frames * sum(len(mesh.vertices) for _, mesh in meshes)
    return _summary(totals, written, perf_counter() - start, vertices if contact else None)


def _device(name: str) -> torch.device:
    """The device of a name. Raises InputError if this machine has none such."""
    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"--device {name}: not on this machine") from error
    return device


def _load(models: Sequence[str], outfit: Outfit) -> Method:
    """Load the method that the models make. Raises InputError if it cannot dress the outfit."""
    models = models or [DEFAULT]
    method = load_methods(models, outfit.body)
    if reason := method.unsupported_reason(outfit):
        several = len(models) == 1 < len(outfit.garments)
        hint = "; each garment may have a model of its own, as in --model A B" if several else ""
        raise InputError(reason + hint)
    return method


def _summary(totals: _Totals, written: tuple[Path, ...], seconds: float, vertices: int | None) -> Summary:
    """Summary of a whole rollout; vertices: of all frames together, None without contact."""

    def percent(count: int) -> float | None:
        return None if vertices is None else 100.0 * count / vertices

    return Summary(
        written=written,
        frames=totals.frames,
        seconds=seconds,
        milliseconds={stage: total / totals.frames for stage, total in totals.milliseconds.items()},
        skin=totals.skin / totals.frames,
        inside_before=percent(totals.inside_before),
        inside_after=percent(totals.inside_after),
        squeezed=percent(totals.squeezed),
    )


def _progress(console: Console) -> Progress:
    rate = TextColumn("{task.fields[rate]}")
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), rate, console=console
    )
