"""`uvcloth train recurrent`: its settings and presets."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes

from uvcloth.bodies.body import Body, load_body
from uvcloth.checkpoint import load_checkpoint
from uvcloth.commands.options import FOLDER, BodyFile
from uvcloth.errors import InputError
from uvcloth.files.options import NewFolder, Several
from uvcloth.methods.recurrent.method import ENTRY as METHOD
from uvcloth.methods.recurrent.method import load_recurrent
from uvcloth.methods.recurrent.network import RecurrentConfig
from uvcloth.methods.registry import model_folder

from ..loop import LoopConfig, check_run, fit
from ..trainer import TrainerEntry
from .cage_runs import load_run, run_files
from .objective import RecurrentLosses, RecurrentObjective, WarmStart

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(steps=2000, batch=12, weight_decay=0.01, validate_every=250, keep="last"),
    "gpu": LoopConfig(
        steps=7800, batch=192, learning_rate=1.5e-3, weight_decay=0.01, validate_every=400, keep="best"
    ),
    "tiny": LoopConfig(steps=4, batch=2, validate_every=2, average=0.9),
}

LOSSES: dict[str, RecurrentLosses] = {
    "default": RecurrentLosses(),
    "gpu": RecurrentLosses(window=90, unscored=20, speed=15.0),
    "tiny": RecurrentLosses(window=12, unscored=4),
}


@dataclass(frozen=True)
class RecurrentRun:
    """Train recurrent rigs: the body's motion in, weights of blend shapes out."""

    data: Annotated[tuple[Path, ...], FOLDER, Several()]
    """Folders made by `python -m train.recurrent.cage_runs` or `fine_runs`, each of one garment."""
    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """Preset of all settings below: default, gpu (larger batches, for a GPU), or tiny."""
    start_from: str | None = None
    """Run folder or shipped model of the same sizes and garments, whose weights are trained further."""
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
        body = load_body(self.body)
        start = None if self.start_from is None else self._start(self.start_from, body)
        objective = RecurrentObjective(self.network, self.losses, self.data, body, start)
        return fit(objective, self.out, self.loop, resume=self.resume)

    def _start(self, model: str, body: Body) -> WarmStart:
        """The model to go on from. Raises InputError if it is another method, or of other sizes."""
        folder = model_folder(model)
        checkpoint = None if folder is None else load_checkpoint(folder, body)
        if folder is None or checkpoint is None or checkpoint.method != "recurrent":
            raise InputError(f"--start-from {model}: is no recurrent model")
        method = load_recurrent(checkpoint, folder)
        if method.config != self.network or not {*self._garments()} <= {*method.networks}:
            raise InputError(f"--start-from {model}: is of other sizes, or lacks a garment of the data")
        return WarmStart(method, checkpoint.data)

    def _garments(self) -> Iterator[str]:
        for folder in self.data:
            yield from (load_run(path).garment for path in run_files(folder)[:1])


ENTRY = TrainerEntry(
    RecurrentRun,
    {
        name: {"network": network, "losses": LOSSES[name], "loop": LOOPS[name]}
        for name, network in METHOD.presets.items()
    },
)
