"""Animation files of garments that move over a motion."""

from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.bodies.visible import visible_body
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.run.summary import Summary, Totals
from uvcloth.commands.run.view import live_audience
from uvcloth.commands.run.visible import visible_outfit
from uvcloth.commands.run.worn import load_wanted_method, load_worn
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.library import load_clip
from uvcloth.physics.cloth_exposure import ClothExposure
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.hidden_skin import HiddenSkin
from uvcloth.process.threads import limited_threads
from uvcloth.rollouts.ready import find_device, ready_rollout
from uvcloth.rollouts.rollout import BrokenRolloutError, RolloutFrame
from uvcloth.writers.pictures import SHEETS, sheet_interval
from uvcloth.writers.shot import Shot
from uvcloth.writers.size import announce
from uvcloth.writers.writer import close_together, open_writer


class Audience(Protocol):
    """Watcher of a rollout while it is computed."""

    def begin(self, title: str, body: Body, meshes: Sequence[Mesh], count: int, fps: float) -> None:
        """Receive the garments at rest on a body, and the number of frames to come."""
        ...

    def add(self, frame: RolloutFrame) -> None:
        """See the next frame."""
        ...


GO_ON = "--keep-going writes all frames, with linear blend skinning where a garment is torn"
"""Advice for a rollout that breaks."""

EVERY_IN_PREVIEW = 3
"""A preview shows one of this many frames."""


def run(command: Rollout) -> None:
    """Write the files and print a summary. Raises InputError for bad input."""
    audience = live_audience(command.port) if command.view else nullcontext()
    with limited_threads(command.threads), audience as watching:
        print("\n".join(animate(command, watching).lines()), flush=True)


def animate(command: Rollout, audience: Audience | None = None) -> Summary:
    """Roll methods out on a motion once and write every file in the format of its suffix.

    command: options of the rollout; its threads and view are left to the caller. audience: receives each
    frame. A motion of one frame, a pose, becomes a motion from the rest pose into it.

    Coarse garments are carried by proxies, unless there is no clearing. Raises InputError for bad input or a
    full disk; then, as after Ctrl-C, writes nothing. If the rollout breaks, the frames before are kept, and
    the InputError says where they are.
    """
    console = Console(stderr=True)
    body, out = load_body(command.body), command.out
    report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    with console.status("preparing"):
        outfit = load_worn(command.garment, command.fitting, body, report, command.template)
        place = find_device(command.device)
        method, clear, choice = load_wanted_method(command, outfit, command.finish, command.dynamics)
        ready = ready_rollout(
            method, outfit, load_clip(command.motion, body, command.options), clear, loop=command.loop
        )
        clip, transforms, proxied = ready.motion, ready.transforms, ready.proxied
        visible = visible_outfit(command, method, proxied)
        exposure = Exposure(body, visible.meshes)
        through = ClothExposure(body, visible.meshes) if len(visible.meshes) > 1 else None
        shown = visible_body(body)
        hidden = HiddenSkin(shown, visible.meshes, proxied.hides(shown)) if command.hide_skin else None
    every = _interval(out, len(clip)) if command.preview else 1
    fps = clip.fps / every
    sizes = [announce(path, len(transforms[::every]), visible.meshes, shown) for path in out]
    for line in filter(None, (choice, *ready.lines, *visible.lines, *sizes)):
        report(line)
    if audience:
        audience.begin(clip.name, body, visible.meshes, len(transforms[::every]), fps)
    totals, start = Totals(several=through is not None), perf_counter()
    with ExitStack() as stack:
        writers = [
            stack.enter_context(
                open_writer(
                    path,
                    visible.named(),
                    body,
                    fps,
                    transforms[::every].float(),
                    command.preview,
                    Shot.of(command.camera, command.size),
                )
            )
            for path in out
        ]
        progress = stack.enter_context(_progress(console))
        task = progress.add_task(clip.name, total=len(transforms[::every]), rate="")
        broken: BrokenRolloutError | None = None
        try:
            for frame in visible.frames(ready.frames(place, every, command.keep_going), fps):
                placed = frame.in_world()
                if audience:
                    audience.add(placed)
                totals.add(frame)
                with totals.timed("measuring"):
                    totals.add_shares(
                        exposure.percent(frame.vertices, frame.body_vertices),
                        through.percent(frame.vertices, frame.body_vertices) if through else 0.0,
                        frame.index,
                    )
                    if hidden:
                        hidden.add(frame.vertices, _posed(shown, frame))
                with totals.timed("writing"):
                    for writer in writers:
                        writer.add(placed.vertices, placed.transforms)
                progress.update(
                    task,
                    advance=1,
                    rate=f"{totals.frames / (perf_counter() - start):.1f} frames per second",
                )
        except BrokenRolloutError as error:
            if not totals.frames:
                raise InputError(f"{error}; nothing is written; {GO_ON}") from error
            broken = error
        with totals.timed("writing"):
            for writer in writers:
                if hidden:
                    writer.hide(hidden.faces())
            close_together(writers)
    written = tuple(path for writer in writers for path in writer.written)
    if broken:
        raise _kept_so_far(broken, totals.frames, written)
    return totals.summary(written, perf_counter() - start, every)


def _kept_so_far(broken: BrokenRolloutError, frames: int, written: Sequence[Path]) -> InputError:
    """The error for a broken rollout: where the earlier frames are, and how to get all."""
    names = ", ".join(map(str, written))
    return InputError(f"{broken}; the {frames} frames before it are in {names}; {GO_ON}")


def _posed(body: Body, frame: RolloutFrame) -> Tensor:
    """Vertices (V, 3) m of a body in a frame."""
    return posed_skin(body, frame.transforms[None])[0]


def _interval(out: Sequence[Path], frames: int) -> int:
    """Step between the frames that a preview needs."""
    if all(path.suffix.lower() in SHEETS for path in out):
        return max(EVERY_IN_PREVIEW, sheet_interval(frames, coarse=True))
    return EVERY_IN_PREVIEW


def _progress(console: Console) -> Progress:
    rate, left = TextColumn("{task.fields[rate]}"), TimeRemainingColumn()
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), rate, left, console=console
    )
