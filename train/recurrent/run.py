"""`uvcloth train recurrent`: its settings and presets."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes

from uvcloth.bodies.body import load_body
from uvcloth.commands.options import FOLDER, BodyFile
from uvcloth.files.options import NewFolder, Several
from uvcloth.methods.recurrent.method import ENTRY as METHOD
from uvcloth.methods.recurrent.network import RecurrentConfig

from ..loop import LoopConfig, check_run, fit
from ..trainer import TrainerEntry
from .objective import RecurrentLosses, RecurrentObjective

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(steps=2000, batch=12, weight_decay=0.01, validate_every=250, keep="last"),
    "tiny": LoopConfig(steps=4, batch=2, validate_every=2, average=0.9),
}

LOSSES: dict[str, RecurrentLosses] = {
    "default": RecurrentLosses(),
    "tiny": RecurrentLosses(window=12, unscored=4),
}


@dataclass(frozen=True)
class RecurrentRun:
    """Train recurrent rigs: the body's motion in, weights of blend shapes out."""

    data: Annotated[tuple[Path, ...], FOLDER, Several()]
    """Folders made by `python -m train.recurrent.cage_runs`, each of one garment."""
    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """Preset of all settings below: default or tiny."""
    resume: bool = False
    """Continue the run in `out`."""
    body: BodyFile = None
    """The body of the data, made by `uvcloth body`."""
    network: OmitArgPrefixes[RecurrentConfig] = field(default_factory=RecurrentConfig)
    losses: OmitArgPrefixes[RecurrentLosses] = field(default_factory=RecurrentLosses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=lambda: LOOPS["default"])

    def train(self) -> dict[str, float]:
        """Train; returns the validation errors of the network kept."""
        check_run(self.out, resume=self.resume)
        objective = RecurrentObjective(self.network, self.losses, self.data, load_body(self.body))
        return fit(objective, self.out, self.loop, resume=self.resume)


ENTRY = TrainerEntry(
    RecurrentRun,
    {
        name: {"network": network, "losses": LOSSES[name], "loop": LOOPS[name]}
        for name, network in METHOD.presets.items()
    },
)
