"""Files for engines of methods that are rigs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console

from uvcloth.bodies.body import load_body
from uvcloth.commands.export import Export
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_files
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.capabilities import Riggable, with_dynamics
from uvcloth.methods.method import Method, require_fabric_read
from uvcloth.methods.recurrent.rig import RecurrentRig
from uvcloth.methods.registry import load_method
from uvcloth.methods.rig import BlendRig, PoseRig
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import load_clip
from uvcloth.writers.embedding import write_embedding
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.recurrent import write_recurrent
from uvcloth.writers.rig import Rig, Rigged, rig_of
from uvcloth.writers.shapes import Cost
from uvcloth.writers.usd_rig import write_rig_usd
from uvcloth.writers.writer import require_own_names

RIG_WRITERS: dict[str, Callable[[Rig, Path], None]] = {
    ".glb": write_rig_glb,
    ".usdc": write_rig_usd,
    ".usd": write_rig_usd,
}
"""Writers by suffix."""


@dataclass(frozen=True)
class Exported:
    """Result of an export."""

    written: tuple[Path, ...]
    rigged: Rigged

    def lines(self) -> list[str]:
        """Text of the result for a terminal, line by line."""
        rig, cost = self.rigged.rig, self.rigged
        frames, shapes = len(rig.transforms), len(rig.resting)
        parts = [garment.name for garment in rig.garments] + (["body"] if rig.body else [])
        motion = f"{frames} frames at {rig.fps:g} per second" if frames else "no motion"
        return [
            *(f"{path}: {path.stat().st_size / 1e6:.1f} MB" for path in self.written),
            f"{', '.join(parts)}; {len(rig.skeleton.names)} joints, {shapes} blend shapes, {motion}",
            *(self._costs() if cost.measured else ()),
        ]

    def _costs(self) -> Iterator[str]:
        yield _line("four joints per garment vertex cost", self.rigged.pruning)
        yield _line(f"{len(self.rigged.rig.resting)} blend shapes cost", self.rigged.fewer)


def run(command: Export) -> None:
    """Write the rig and print what it costs. Raises InputError for bad input."""
    print("\n".join(export(command).lines()))


def export(command: Export) -> Exported:
    """Write a model as a rig that moves to a motion, or at rest with its pose embedding as .onnx beside it.

    Materials of garment files go along, for .usdc with their textures beside it. For a motion of one frame, a
    pose, the body moves into it from rest. Raises InputError for bad input and a full disk; then, as after
    Ctrl-C, writes nothing.
    """
    out, fabric = command.out, command.fabric
    if out.suffix.lower() not in RIG_WRITERS:
        supported = ", ".join(RIG_WRITERS)
        raise InputError(
            f"{out}: the format {out.suffix or '(none)'} is not supported, use one of {supported}"
        )
    body = load_body(command.body)
    method = load_method(command.model, body)
    require_fabric_read(method, fabric)
    if command.dynamics is not None:
        method = with_dynamics(method, command.dynamics)
    console = Console(stderr=True)
    with console.status("preparing"):
        report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
        worn = load_outfit(command.garment, body, report, fabric=fabric)
        pose_rig = _riggable(method).as_rig(body, worn)
        require_own_names(out, [name for name, _ in pose_rig.garments])
        clip = None
        if command.motion is not None:
            clip = pose_from_rest(load_clip(command.motion, body, command.options), body)
    with console.status(f"{out.name} ..."):
        rigged = rig_of(pose_rig, body, clip, command.shapes, command.with_body)
        return Exported(_write(pose_rig, rigged, out), rigged)


def _riggable(method: Method) -> Riggable:
    """A method as a rig. Raises InputError if it cannot be exported as one."""
    riggable = method.capability(Riggable)
    if riggable is None:
        raise InputError(
            f"model {method.name}: has no blend weights and blend shapes to export; "
            "`uvcloth rollout` writes the frames of any model"
        )
    return riggable


def _write(model: BlendRig, rigged: Rigged, out: Path) -> tuple[Path, ...]:
    """Write the rig, beside it its textures and, of blend shapes without motion, the network.

    All of these files appear or none.
    """
    with atomic_files(out) as folder:
        unfinished = folder / out.name
        RIG_WRITERS[out.suffix.lower()](rigged.rig, unfinished)
        if len(model.shapes) and not len(rigged.rig.transforms):
            onnx = unfinished.with_suffix(".onnx")
            if isinstance(model, RecurrentRig):
                write_recurrent(model, rigged, onnx)
            elif isinstance(model, PoseRig):
                write_embedding(model, rigged, onnx)
        names = sorted((part.name for part in folder.iterdir()), key=lambda name: (name != out.name, name))
    return tuple(out.with_name(name) for name in names)


def _line(what: str, costs: Sequence[Cost]) -> str:
    if not costs:
        return f"{what} nothing"
    numbers = [
        f"mean {1e3 * cost.mean:.2f} mm, most {1e3 * cost.most:.1f} mm over {cost.over}" for cost in costs
    ]
    return f"{what} {'; '.join(numbers)}"
