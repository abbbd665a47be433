"""`uvcloth export`: a method that is a rig as a file for engines."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from rasterize.atomic import atomic_write
from rasterize.errors import InputError
from uvcloth.bodies.body import load_body
from uvcloth.export.embedding import write_embedding
from uvcloth.export.gltf_rig import write_rig_glb
from uvcloth.export.rig import Rig, Rigged, rig_of
from uvcloth.export.shapes import Cost
from uvcloth.export.usd_rig import write_rig_usd
from uvcloth.methods.registry import load_method
from uvcloth.methods.rig import PoseRig
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import DEFAULTS, load_clip
from uvcloth.motion.options import MotionOptions

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
            _line("four joints per garment vertex cost", cost.pruning),
            _line(f"{shapes} blend shapes cost", cost.fewer),
        ]


def export(
    model: str,
    out: Path,
    *,
    motion: str | None = None,
    shapes: int | None = None,
    body_file: Path | None = None,
    with_body: bool = True,
    options: MotionOptions = DEFAULTS,
) -> Exported:
    """Write a model as a rig that moves to a motion, or at rest with its pose embedding as .onnx beside it.

    model: a method that is a rig (pbns as it ships), or a checkpoint folder of one. out: .glb, .usdc or .usd.
    shapes: how many blend shapes, None for the model's own. options: how the motion is read; of one frame, a
    pose, the body moves into it from rest. Raises InputError for bad input and a full disk; then, as after
    Ctrl-C, writes nothing.
    """
    out = Path(out)
    if out.suffix.lower() not in RIG_WRITERS:
        supported = ", ".join(RIG_WRITERS)
        raise InputError(
            f"{out}: the format {out.suffix or '(none)'} is not supported, use one of {supported}"
        )
    body = load_body(body_file)
    method = load_method(model, body)
    if (pose_rig := method.as_rig(body)) is None:
        raise InputError(
            f"{model}: no rig of blend weights and blend shapes; `uvcloth rollout` writes any model's frames"
        )
    clip = pose_from_rest(load_clip(motion, body, options), body) if motion is not None else None
    with Console(stderr=True).status(f"{out.name} ..."):
        rigged = rig_of(pose_rig, body, clip, shapes, with_body)
        return Exported(_write(pose_rig, rigged, out), rigged)


def _write(model: PoseRig, rigged: Rigged, out: Path) -> tuple[Path, ...]:
    """Write the rig, and beside blend shapes without motion the embedding: all of these files or none."""
    embedded = len(model.shapes) and not len(rigged.rig.transforms)
    files = (out, out.with_suffix(".onnx")) if embedded else (out,)
    for path in files:
        if path.is_dir():
            raise InputError(f"{path}: cannot be written (is a folder)")
    with ExitStack() as stack:
        # They appear when the stack unwinds: only when all are whole.
        partial = [stack.enter_context(atomic_write(path)) for path in files]
        RIG_WRITERS[out.suffix.lower()](rigged.rig, partial[0])
        if embedded:
            write_embedding(model, rigged, partial[1])
    return files


def _line(what: str, costs: Sequence[Cost]) -> str:
    if not costs:
        return f"{what} nothing"
    numbers = [
        f"mean {1e3 * cost.mean:.2f} mm, most {1e3 * cost.most:.1f} mm over {cost.over}" for cost in costs
    ]
    return f"{what} {'; '.join(numbers)}"
