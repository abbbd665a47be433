"""`uvcloth train pbns`: its settings and presets."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from tyro.conf import OmitArgPrefixes

from uvcloth.bodies.body import load_body
from uvcloth.commands.options import GARMENT, BodyFile
from uvcloth.errors import InputError
from uvcloth.files.options import Between, NewFolder, Several
from uvcloth.garments.band import unheld_reason
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.pbns.method import ENTRY as METHOD
from uvcloth.methods.pbns.network import PBNSConfig

from ..loop import LoopConfig, check_run, fit, training_device
from ..trainer import TrainerEntry
from .energy import EnergyConfig, FabricOptions
from .objective import SMOOTHING, AttachmentConfig, PBNSObjective, held_vertices
from .poses import poses_for
from .supervision import SupervisionConfig, settle_poses

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(steps=2500, batch=16, weight_decay=0.0, validate_every=500, keep="last"),
    "paper": LoopConfig(
        steps=6000,
        batch=16,
        schedule="constant",
        weight_decay=0.0,
        average=0.0,
        validate_every=500,
        keep="last",
    ),
    "tiny": LoopConfig(steps=8, batch=4, weight_decay=0.0, validate_every=4, average=0.9),
}


@dataclass(frozen=True)
class PBNSRun:
    """Train PBNS on a garment or an outfit, on physics and on the outfit at rest, without sequences."""

    garment: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME|FILE ..."), GARMENT, Several(least=1)]
    """Templates (tops, bottoms, dress) or garment files, the innermost first."""
    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard, and the poses if they are drawn here."""
    poses: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="NPZ|DIR|CLIP ...", help_behavior_hint="(default: the built-in clips)"),
    ] = ()
    """Poses drawn by `uvcloth poses`, or motion to draw them from."""
    preset: str = "default"
    """Preset of all settings below: default, paper or tiny."""
    resume: bool = False
    """Continue the run in `out`."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    network: OmitArgPrefixes[PBNSConfig] = field(default_factory=PBNSConfig)
    fabric: OmitArgPrefixes[FabricOptions] = field(default_factory=FabricOptions)
    energy: OmitArgPrefixes[EnergyConfig] = field(default_factory=EnergyConfig)
    smoothing: Annotated[float, Between(0, 1)] = SMOOTHING
    """Share of the blend shapes' gradient that is smoothed over the garment (paper: 0)."""
    attachment: OmitArgPrefixes[AttachmentConfig] = field(default_factory=AttachmentConfig)
    supervision: OmitArgPrefixes[SupervisionConfig] = field(default_factory=SupervisionConfig)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=lambda: LOOPS["default"])

    def train(self) -> dict[str, float]:
        """Train; returns the validation scores of the network kept."""
        check_run(self.out, resume=self.resume)
        fabric, body = self.fabric.resolved(), load_body(self.body)
        say = partial(Console(stderr=True).print, highlight=False, markup=False)
        outfit = Outfit(body, tuple(load_garment(name, body, say) for name in self.garment))
        # Drawing poses takes minutes: a garment without a hem that holds it is refused before.
        held_vertices(outfit, self.attachment)
        if self.supervision.settled and (reason := unheld_reason(outfit)):
            raise InputError(f"{reason}; --settled 0 trains it on physics alone")
        poses = poses_for(self.poses, body, self.out)
        supervision = settle_poses(self.supervision, outfit, fabric, poses.database, self.out)
        objective = PBNSObjective(
            self.network,
            fabric,
            self.energy,
            self.attachment,
            outfit,
            poses,
            self.loop.batch,
            self.smoothing,
            training_device(),
            supervision,
        )
        return fit(objective, self.out, self.loop, resume=self.resume)


ENTRY = TrainerEntry(
    PBNSRun,
    {
        "default": {
            "network": METHOD.presets["default"],
            "energy": EnergyConfig(),
            "attachment": AttachmentConfig(),
            "supervision": SupervisionConfig(),
            "loop": LOOPS["default"],
        },
        "paper": {
            "network": METHOD.presets["paper"],
            "energy": EnergyConfig(collision=50.0, thickness=0.004, pin=2000.0, plane="vertex"),
            "smoothing": 0.0,
            "attachment": AttachmentConfig(weights="closest"),
            "supervision": SupervisionConfig(settled=0),
            "loop": LOOPS["paper"],
        },
        "tiny": {
            "network": METHOD.presets["tiny"],
            "energy": EnergyConfig(),
            "attachment": AttachmentConfig(),
            "supervision": SupervisionConfig(settled=2),
            "loop": LOOPS["tiny"],
        },
    },
)
