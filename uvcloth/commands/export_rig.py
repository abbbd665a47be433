"""`uvcloth export`: a method that is a rig as a file for engines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console

from uvcloth.bodies.body import load_body
from uvcloth.errors import InputError
from uvcloth.export.embedding import write_embedding
from uvcloth.export.gltf_rig import write_rig_glb
from uvcloth.export.rig import Rig, Rigged, rig_of
from uvcloth.export.shapes import Cost
from uvcloth.export.usd_rig import write_rig_usd
from uvcloth.export.writer import require_own_names
from uvcloth.files.atomic import atomic_files
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.method import require_fabric_read
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
    garments: Sequence[str] = (),
    garment_pose: str | None = None,
    fabric: str | None = None,
    motion: str | None = None,
    shapes: int | None = None,
    body_file: Path | None = None,
    with_body: bool = True,
    options: MotionOptions = DEFAULTS,
) -> Exported:
    """Write a model as a rig that moves to a motion, or at rest with its pose embedding as .onnx beside it.

    model: a method that is a rig (pbns as it ships), or a checkpoint folder of one. out: .glb, .usdc or .usd.
    garments: template names or mesh files, the innermost first, for a model that rigs any outfit, and
    garment_pose: what files were modelled in, as `load_outfit` has it. fabric: of the garments, for a model
    that reads it. Materials of files go along, for .usdc with their textures beside it. shapes: how many
    blend shapes, None for the model's own. options: how the motion is read; of one frame, a pose, the body
    moves into it from rest. Raises InputError for bad input and a full disk; then, as after Ctrl-C, writes
    nothing.
    """
    out = Path(out)
    if out.suffix.lower() not in RIG_WRITERS:
        supported = ", ".join(RIG_WRITERS)
        raise InputError(
            f"{out}: the format {out.suffix or '(none)'} is not supported, use one of {supported}"
        )
    body = load_body(body_file)
    method = load_method(model, body)
    require_fabric_read(method, fabric)
    console = Console(stderr=True)
    with console.status("preparing"):
        report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
        worn = load_outfit(garments, body, report, pose=garment_pose, fabric=fabric)
        pose_rig = method.as_rig(body, worn)
        if pose_rig is None:
            raise InputError(
                f"{model}: no rig of blend weights and blend shapes; "
                "`uvcloth rollout` writes any model's frames"
            )
        require_own_names(out, [name for name, _ in pose_rig.garments])
        clip = pose_from_rest(load_clip(motion, body, options), body) if motion is not None else None
    with console.status(f"{out.name} ..."):
        rigged = rig_of(pose_rig, body, clip, shapes, with_body)
        return Exported(_write(pose_rig, rigged, out), rigged)


def _write(model: PoseRig, rigged: Rigged, out: Path) -> tuple[Path, ...]:
    """Write the rig, beside it its textures and, of blend shapes without motion, the embedding.

    All of these files appear or none.
    """
    with atomic_files(out) as folder:
        unfinished = folder / out.name
        RIG_WRITERS[out.suffix.lower()](rigged.rig, unfinished)
        if len(model.shapes) and not len(rigged.rig.transforms):
            write_embedding(model, rigged, unfinished.with_suffix(".onnx"))
        names = sorted((part.name for part in folder.iterdir()), key=lambda name: (name != out.name, name))
    return tuple(out.with_name(name) for name in names)


def _line(what: str, costs: Sequence[Cost]) -> str:
    if not costs:
        return f"{what} nothing"
    numbers = [
        f"mean {1e3 * cost.mean:.2f} mm, most {1e3 * cost.most:.1f} mm over {cost.over}" for cost in costs
    ]
    return f"{what} {'; '.join(numbers)}"
