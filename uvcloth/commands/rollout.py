"""`uvcloth rollout`: a motion and garments to an animation file."""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from rasterize.errors import InputError
from uvcloth.bodies.body import load_body
from uvcloth.export.writer import open_writer
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.registry import DEFAULT, load_methods
from uvcloth.motion.library import load_clip
from uvcloth.physics.exposure import Exposure
from uvcloth.rollout import BrokenRolloutError, rollout


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


def animate(
    models: Sequence[str],
    motion: str,
    garments: Sequence[str],
    out: Sequence[Path],
    *,
    body_file: Path | None = None,
    contact: bool = True,
) -> Summary:
    """Roll a method out on a motion once and write every file of `out`, each as its suffix says.

    models: a checkpoint folder or a baseline's name for all garments, or one for each in order; none for the
    model in the package. garments: template names or mesh files, the innermost first; contact keeps each out
    of the body and off what is beneath. Raises InputError for bad input or a full disk; then, as after
    Ctrl-C, writes nothing. Of a rollout that breaks the frames before it are kept, and an InputError says so.
    """
    console = Console(stderr=True)
    body = load_body(body_file)
    say = partial(console.print, highlight=False, markup=False)
    outfit = Outfit(body, tuple(load_garment(name, body, say) for name in garments))
    clip = load_clip(motion, body)
    models = models or [DEFAULT]
    method = load_methods(models, body)
    if unsupported_reason := method.unsupported_reason(outfit):
        several = len(models) == 1 < len(outfit.garments)
        hint = "; each garment may have a model of its own, as in --model A B" if several else ""
        raise InputError(unsupported_reason + hint)
    exposure = Exposure(body, [garment.mesh for garment in outfit.garments])
    counted = {"before": 0, "after": 0, "squeezed": 0}
    shown = 0.0
    spent: dict[str, float] = defaultdict(float)
    start = perf_counter()
    meshes = [(garment.name, garment.mesh) for garment in outfit.garments]
    with ExitStack() as stack:
        writers = [stack.enter_context(open_writer(path, meshes, body, clip.fps)) for path in out]
        progress = stack.enter_context(_progress(console))
        task = progress.add_task(clip.name, total=len(clip), rate="")
        frames = 0
        broken: BrokenRolloutError | None = None
        try:
            for frame in rollout(method, outfit, clip.transforms(), clip.fps, contact):
                frames += 1
                for stage, milliseconds in frame.milliseconds.items():
                    spent[stage] += milliseconds
                for found in frame.contacts:
                    counted["before"] += found.inside_before
                    counted["after"] += found.inside_after
                    counted["squeezed"] += found.squeezed
                begun = perf_counter()
                shown += exposure.percent(frame.vertices, frame.body_vertices)
                spent["measuring"] += 1e3 * (perf_counter() - begun)
                begun = perf_counter()
                for writer in writers:
                    writer.add(frame.vertices, frame.transforms)
                spent["writing"] += 1e3 * (perf_counter() - begun)
                rate = frames / (perf_counter() - start)
                progress.update(task, advance=1, rate=f"{rate:.1f} frames per second")
        except BrokenRolloutError as error:
            if not frames:
                raise
            broken = error
        begun = perf_counter()
        # Only when every file is whole may the first of them appear.
        for writer in writers:
            writer.finish()
    spent["writing"] += 1e3 * (perf_counter() - begun)
    if broken:
        names = ", ".join(str(path) for writer in writers for path in writer.written)
        raise InputError(f"{broken}; the {frames} frames before it are in {names}")
    vertices = len(clip) * sum(len(garment.mesh.vertices) for garment in outfit.garments)
    return Summary(
        written=tuple(path for writer in writers for path in writer.written),
        frames=len(clip),
        seconds=perf_counter() - start,
        milliseconds={stage: total / len(clip) for stage, total in spent.items()},
        skin=shown / len(clip),
        inside_before=100.0 * counted["before"] / vertices if contact else None,
        inside_after=100.0 * counted["after"] / vertices if contact else None,
        squeezed=100.0 * counted["squeezed"] / vertices if contact else None,
    )


def _progress(console: Console) -> Progress:
    rate = TextColumn("{task.fields[rate]}")
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), rate, console=console
    )
