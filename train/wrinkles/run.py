"""`uvcloth train wrinkles`: its settings and presets."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes

from uvcloth.bodies.body import load_body
from uvcloth.commands.options import FOLDER, BodyFile
from uvcloth.files.options import NewFolder, Several
from uvcloth.wrinkles.network import WrinkleConfig

from ..loop import LoopConfig, check_run, fit, training_device
from ..trainer import TrainerEntry
from .objective import WrinkleLosses, WrinkleObjective

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(
        steps=4000, batch=2, learning_rate=2e-3, weight_decay=0.01, average=0.995, validate_every=250
    ),
    "gpu": LoopConfig(steps=30_000, batch=32, learning_rate=1e-3, weight_decay=0.01, validate_every=2000),
    "tiny": LoopConfig(steps=4, batch=2, validate_every=2, average=0.9),
}


@dataclass(frozen=True)
class WrinklesRun:
    """Train wrinkles: maps of a garment's smooth surface in, displacement maps out."""

    data: Annotated[tuple[Path, ...], FOLDER, Several()]
    """Folders made by `python -m train.wrinkles.tracked_runs`."""
    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """Preset of all settings below: default, gpu (larger maps and batches, for a GPU), or tiny."""
    resume: bool = False
    """Continue the run in `out`."""
    body: BodyFile = None
    """The body of the data, made by `uvcloth body`."""
    network: OmitArgPrefixes[WrinkleConfig] = field(default_factory=WrinkleConfig)
    losses: OmitArgPrefixes[WrinkleLosses] = field(default_factory=WrinkleLosses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=lambda: LOOPS["default"])

    def train(self) -> dict[str, float]:
        """Train; returns the validation scores of the network kept."""
        check_run(self.out, resume=self.resume)
        objective = WrinkleObjective(
            self.network, self.losses, self.data, load_body(self.body), training_device()
        )
        return fit(objective, self.out, self.loop, resume=self.resume)


NETWORKS = {
    "default": WrinkleConfig(),
    "gpu": WrinkleConfig(size=512, width=32, levels=6),
    "tiny": WrinkleConfig(size=64, width=8, levels=2),
}

ENTRY = TrainerEntry(
    WrinklesRun, {name: {"network": NETWORKS[name], "loop": loop} for name, loop in LOOPS.items()}
)
