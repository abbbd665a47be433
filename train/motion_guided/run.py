"""`uvcloth train motion_guided`: its settings, presets and losses."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes

from uvcloth.commands.options import FOLDER
from uvcloth.errors import InputError
from uvcloth.files.options import AtLeast, NewFolder, Several
from uvcloth.methods.motion_guided.config import MotionGuidedConfig
from uvcloth.methods.motion_guided.method import ENTRY as METHOD

from ..loop import LoopConfig, check_run, fit, has_begun, training_device
from ..trainer import TrainerEntry
from .dataset import GarmentDataset
from .objective import (
    SHAPE,
    DynamicsObjective,
    MotionGuidedLosses,
    ShapeObjective,
    load_shape_space,
)

LOOPS: dict[str, LoopConfig] = {
    "fast": LoopConfig(steps=1200, validate_every=100, keep="last"),
    "gpu": LoopConfig(steps=10000, batch=32, average=0.999, validate_every=1000),
    "paper": LoopConfig(steps=30000, batch=4, learning_rate=1e-4, weight_decay=0.0, average=0.0),
    "tiny": LoopConfig(steps=8, batch=2, validate_every=4, average=0.9),
}
"""The loop of the dynamics, by preset."""

SHAPE_LOOPS: dict[str, LoopConfig] = {
    "fast": LoopConfig(steps=200, learning_rate=1e-4, weight_decay=0.0, validate_every=50),
    "gpu": LoopConfig(steps=1, learning_rate=1e-6, weight_decay=0.0),
    "paper": LOOPS["paper"],
    "tiny": LOOPS["tiny"],
}
"""The loop of the space of shapes, by preset.

A linear one is fitted before. The steps of "fast" take it off the body, and further from held-out garments:
6.6 mm before, 8.2 mm after. "gpu" leaves it as it was fitted.
"""

LOSSES: dict[str, MotionGuidedLosses] = {
    "fast": MotionGuidedLosses(),
    "gpu": MotionGuidedLosses(inside=0.0, unroll=8),
    "paper": MotionGuidedLosses(steady=0.0, mirror=False, past="true", unroll=1),
    "tiny": MotionGuidedLosses(),
}


@dataclass(frozen=True)
class MotionGuidedRun:
    """Train Motion-guided on one garment: a space of its shapes, then the dynamics in it."""

    data: Annotated[tuple[Path, ...], FOLDER, Several()]
    """Folders of sequences made by `uvcloth simulate`, all on one body."""
    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard; the first stage is in its subfolder
    shape."""
    preset: str = "fast"
    """Preset of all settings below: fast, gpu (larger batches, for a GPU), paper or tiny."""
    resume: bool = False
    """Continue the run in `out`, in either stage."""
    frames: Annotated[int | None, AtLeast(1)] = None
    """Train on the first N frames only, clip after clip."""
    network: OmitArgPrefixes[MotionGuidedConfig] = field(default_factory=MotionGuidedConfig)
    losses: OmitArgPrefixes[MotionGuidedLosses] = field(default_factory=MotionGuidedLosses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)
    """Training loop of the dynamics."""
    shape: LoopConfig = field(default_factory=LoopConfig)
    """Training loop of the space of shapes."""

    def train(self) -> dict[str, float]:
        """Train what is missing of both stages; returns the validation errors of the second."""
        if self.losses.past == "own" and self.loop.devices > 1:
            raise InputError("--past own: memory is trained on one device only, leave out --devices")
        first = self.out / SHAPE
        second_began = self.resume and has_begun(self.out)
        check_run(first, resume=self.resume)
        if not self.resume:
            check_run(self.out, resume=False)
        dataset = GarmentDataset(
            self.network,
            self.losses,
            self.data,
            self.frames,
            training_device(),
            mirror=self.losses.mirror,
        )
        if not second_began:
            fit(ShapeObjective(dataset, self.losses), first, self.shape, resume=self.resume)
        objective = DynamicsObjective(dataset, self.losses, load_shape_space(first, dataset.config))
        return fit(objective, self.out, self.loop, resume=second_began)


ENTRY = TrainerEntry(
    MotionGuidedRun,
    {
        name: {
            "network": network,
            "losses": LOSSES[name],
            "loop": LOOPS[name],
            "shape": SHAPE_LOOPS[name],
        }
        for name, network in METHOD.presets.items()
    },
)
