"""`uvcloth rollout`: a motion and garments to an animation file."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.bodies.seen import seen
from uvcloth.commands.summary import Summary, Totals
from uvcloth.errors import InputError
from uvcloth.export.pictures import SHEETS, sheet_interval
from uvcloth.export.size import announce
from uvcloth.export.writer import close_together, open_writer
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.lbs import LBSConfig, create_lbs
from uvcloth.methods.method import Method, require_fabric_read
from uvcloth.methods.physics.finish import Finished, Settled
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.methods.registry import DEFAULT, load_methods
from uvcloth.motion.library import DEFAULTS, load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.hidden_skin import HiddenSkin
from uvcloth.ready import find_device, ready_rollout
from uvcloth.rollout import BrokenRolloutError, RolloutFrame


class Audience(Protocol):
    """Watcher of a rollout while it is computed."""

    def begin(self, title: str, body: Body, meshes: Sequence[Mesh], count: int, fps: float) -> None:
        """Learn what comes: garments at rest on a body, over so many frames."""
        ...

    def add(self, frame: RolloutFrame) -> None:
        """See the next frame."""
        ...


EVERY_IN_PREVIEW = 3
"""A preview shows every so-many-th frame."""


def animate(
    models: Sequence[str],
    motion: str,
    garments: Sequence[str],
    out: Sequence[Path],
    *,
    templates: Sequence[str] = (),
    garment_pose: str | None = None,
    fabric: str | None = None,
    quality: str = "default",
    finish: str = "contact",
    body_file: Path | None = None,
    contact: bool = True,
    hide_skin: bool = False,
    device: str = "cpu",
    preview: bool = False,
    keep_going: bool = False,
    audience: Audience | None = None,
    options: MotionOptions = DEFAULTS,
) -> Summary:
    """Roll a method out on a motion once and write every file of `out`, each as its suffix says.

    models: a checkpoint folder or a baseline's name for all garments, or one for each in order; none for the
    model in the package. garments: template names or mesh files, the innermost first; contact keeps each out
    of the body and off what is beneath. templates: whose motion they take, and garment_pose: what files were
    modelled in, as `load_outfit` has both. fabric: of the garments, for a model that reads it.
    quality: of the cages that the solver moves, a key of QUALITIES. finish: "contact"; or the solver moves
    the garments, pulled to what the model predicts, "dynamic"; or lets them come to rest in each pose,
    "static". hide_skin: leave out the faces of the body that garments cover
    closely in every frame, or whose files say that they hide them. device: as torch names it. preview: every
    third frame, in coarse pictures; a contact sheet alone needs fewer. keep_going: a garment that is torn is
    replaced in that frame. audience: is shown each frame. options: how the motion is read; of one frame, a
    pose, the body moves into it from rest.

    Coarse garments are carried by proxies, unless there is no contact.
    Raises InputError for bad input or a full disk; then, as after Ctrl-C, writes nothing. Of a rollout that
    breaks the frames before it are kept, and an InputError says so.
    """
    console = Console(stderr=True)
    body = load_body(body_file)
    report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    with console.status("preparing"):
        outfit = Outfit(body, load_outfit(garments, body, report, templates, garment_pose, fabric))
        place = find_device(device)
        method = _load(models, body, fabric, Physics(PhysicsConfig(quality)), finish)
        ready = ready_rollout(method, outfit, load_clip(motion, body, options), contact)
        clip, transforms, proxied = ready.motion, ready.transforms, ready.proxied
        meshes = proxied.named()
        exposure = Exposure(body, [mesh for _, mesh in meshes])
        shown = seen(body)
        hidden = HiddenSkin(shown, proxied.meshes, proxied.hides(shown)) if hide_skin else None
    every = _interval(out, len(clip)) if preview else 1
    fps = clip.fps / every
    sizes = [announce(path, len(transforms[::every]), proxied.meshes, shown) for path in out]
    for line in filter(None, (*proxied.lines, *sizes)):
        report(line)
    if audience:
        audience.begin(clip.name, body, [mesh for _, mesh in meshes], len(transforms[::every]), fps)
    totals, start = Totals(), perf_counter()
    with ExitStack() as stack:
        writers = [
            stack.enter_context(open_writer(path, meshes, body, fps, transforms[::every].float(), preview))
            for path in out
        ]
        progress = stack.enter_context(_progress(console))
        task = progress.add_task(clip.name, total=len(transforms[::every]), rate="")
        broken: BrokenRolloutError | None = None
        try:
            for frame in ready.frames(place, every, keep_going):
                placed = frame.in_world()
                if audience:
                    audience.add(placed)
                totals.add(frame)
                with totals.timed("measuring"):
                    totals.add_skin(exposure.percent(frame.vertices, frame.body_vertices), frame.index)
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
                raise InputError(f"{error}; nothing is written; --keep-going goes on") from error
            broken = error
        with totals.timed("writing"):
            for writer in writers:
                if hidden:
                    writer.hide(hidden.faces())
            close_together(writers)
    written = tuple(path for writer in writers for path in writer.written)
    if broken:
        raise _kept_so_far(broken, totals.frames, written)
    vertices = sum(len(garment.mesh.vertices) for garment in proxied.outfit.garments)
    return totals.summary(written, perf_counter() - start, vertices if contact else None, every)


def _kept_so_far(broken: BrokenRolloutError, frames: int, written: Sequence[Path]) -> InputError:
    """The error that says where the frames before the broken one are, and how to have all."""
    names = ", ".join(map(str, written))
    way_on = "--keep-going writes all, with linear blend skinning where a garment is torn"
    return InputError(f"{broken}; the {frames} frames before it are in {names}; {way_on}")


def _posed(body: Body, frame: RolloutFrame) -> Tensor:
    """Vertices (V, 3) m of a body in a frame."""
    return posed_skin(body, frame.transforms[None])[0]


def _interval(out: Sequence[Path], frames: int) -> int:
    """Frames from one that a preview needs to the next."""
    if all(path.suffix.lower() in SHEETS for path in out):
        return max(EVERY_IN_PREVIEW, sheet_interval(frames, coarse=True))
    return EVERY_IN_PREVIEW


def _load(models: Sequence[str], body: Body, fabric: str | None, physics: Physics, finish: str) -> Method:
    """Load the method that the models make, with a finish, for a fabric that was asked for."""
    method = load_methods(models or [DEFAULT], body)
    if isinstance(method, Physics):
        settled = replace(Settled.of(create_lbs(LBSConfig(smooth=True)), physics, 0.0), name=physics.name)
        method = settled if finish == "static" else physics
    elif finish == "dynamic":
        method = Finished.of(method, physics)
    elif finish == "static":
        method = Settled.of(method, physics)
    require_fabric_read(method, fabric)
    return method


def _progress(console: Console) -> Progress:
    rate, left = TextColumn("{task.fields[rate]}"), TimeRemainingColumn()
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), rate, left, console=console
    )
