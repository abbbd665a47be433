"""`python -m train deepsd`: its settings and presets."""

from dataclasses import dataclass, field
from pathlib import Path

from tyro.conf import OmitArgPrefixes

from rasterize.errors import InputError
from train.deepsd.dataset import read_outfits
from train.deepsd.losses import DataLosses
from train.deepsd.objective import DataObjective
from train.loop import LoopConfig, check_run, fit, training_device
from train.trainer import TrainerEntry
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.method import ENTRY as METHOD

LOSSES: dict[str, DataLosses] = {
    "default": DataLosses(),
    "paper": DataLosses(poses_per_outfit=1, points=1.0, closest_weights=100.0),
    "tiny": DataLosses(poses_per_outfit=2),
}

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(steps=5000, batch=4),
    "paper": LoopConfig(
        steps=60000,
        batch=4,
        double_every=0.2,
        schedule="constant",
        weight_decay=0.0,
        average=0.0,
        validate_every=2000,
    ),
    "tiny": LoopConfig(steps=8, batch=2, validate_every=4, average=0.9),
}


@dataclass(frozen=True)
class DeePSDRun:
    """Train DeePSD: the meshes of outfits in, blend weights and blend shapes out."""

    data: Path
    """Folder of the outfits that `uvcloth simulate --outfits` moved."""
    out: Path
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """default, paper or tiny: where every setting below starts from."""
    resume: bool = False
    """Continue the run in `out` where it stopped."""
    network: OmitArgPrefixes[DeePSDConfig] = field(default_factory=DeePSDConfig)
    losses: OmitArgPrefixes[DataLosses] = field(default_factory=DataLosses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)

    def train(self) -> dict[str, float]:
        """Train; returns the validation scores of the network kept."""
        check_run(self.out, resume=self.resume)
        if self.loop.devices > 1:
            raise InputError("--devices: DeePSD is trained on one device, leave it out")
        dataset = read_outfits(self.data, self.losses.rest_frames)
        objective = DataObjective(self.network, self.losses, dataset, training_device())
        return fit(objective, self.out, self.loop, resume=self.resume)


ENTRY = TrainerEntry(
    DeePSDRun,
    {
        name: {"network": network, "losses": LOSSES[name], "loop": LOOPS[name]}
        for name, network in METHOD.presets.items()
    },
)
