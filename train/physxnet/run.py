"""`uvcloth train physxnet`: its settings, presets and losses."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes

from uvcloth.commands.options import FOLDER
from uvcloth.errors import InputError
from uvcloth.files.options import NewFolder, Several
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.method import ENTRY as METHOD

from ..loop import LoopConfig, check_run, fit, training_device
from ..trainer import TrainerEntry
from .objective import Losses, PhysXNetObjective

LOSSES: dict[str, Losses] = {
    "default": Losses(),
    "gpu": Losses(),
    "paper": Losses(l1=100.0, edge=0.0, bend=0.0, adversarial=True, mirror=False),
    "tiny": Losses(),
}

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(),
    "gpu": LoopConfig(steps=20000, batch=64, learning_rate=1.5e-3, average=0.999, validate_every=2000),
    "paper": LoopConfig(steps=20000, learning_rate=2e-4, schedule="constant", weight_decay=0.0, average=0.0),
    "tiny": LoopConfig(steps=30, validate_every=15, average=0.9),
}


@dataclass(frozen=True)
class PhysXNetRun:
    """Train PhysXNet: body motion maps in, garment offset maps out."""

    data: Annotated[tuple[Path, ...], FOLDER, Several()]
    """Folders of sequences made by `uvcloth simulate`, each on one body."""
    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """Preset of all settings below: default, gpu (larger batches, for a GPU), paper or tiny."""
    resume: bool = False
    """Continue the run in `out`."""
    network: OmitArgPrefixes[PhysXNetConfig] = field(default_factory=PhysXNetConfig)
    losses: OmitArgPrefixes[Losses] = field(default_factory=Losses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)

    def train(self) -> dict[str, float]:
        """Train; returns the validation errors of the network kept."""
        check_run(self.out, resume=self.resume)
        if self.network.history and self.loop.devices > 1:
            raise InputError("--history: memory is trained on one device only, leave out --devices")
        objective = PhysXNetObjective(self.network, self.losses, self.data, self.out, training_device())
        return fit(objective, self.out, self.loop, resume=self.resume)


ENTRY = TrainerEntry(
    PhysXNetRun,
    {
        name: {"network": network, "losses": LOSSES[name], "loop": LOOPS[name]}
        for name, network in METHOD.presets.items()
    },
)
