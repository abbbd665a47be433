"""`uvcloth train deepsd`: its settings and presets."""

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from tyro.conf import OmitArgPrefixes

from uvcloth.bodies.body import load_body
from uvcloth.commands.options import FOLDER, GARMENT, BodyFile
from uvcloth.errors import InputError
from uvcloth.files.options import NewFolder, Several
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.order import check_order
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.method import ENTRY as METHOD
from uvcloth.methods.method import require_fabric_read
from uvcloth.physics.fabric import FabricName

from ..loop import LoopConfig, check_run, fit, training_device
from ..pbns.poses import poses_for
from ..trainer import TrainerEntry
from .dataset import OutfitDataset, posed_outfit, read_outfits
from .losses import DataLosses, PhysicsLosses
from .mirror import mirror_outfit
from .objective import DataObjective, DeePSDObjective
from .physics import PhysicsObjective
from .start import load_start

LOSSES: dict[str, DataLosses] = {
    "default": DataLosses(),
    "paper": DataLosses(
        poses_per_outfit=1,
        points=1.0,
        error="squared",
        pose_dropout=0.0,
        edges=0.0,
        closest_weights=100.0,
        small_shapes=1.0,
        mirror=False,
    ),
    "tiny": DataLosses(poses_per_outfit=2),
}

PHYSICS: dict[str, PhysicsLosses] = {
    "default": PhysicsLosses(stretch=138.564065, collision=600.0, small=2.0),
    "paper": PhysicsLosses(stretch=2.3094011, roughness=5e-4, collision=20.0, layers=False, poses_drawn=1),
    "tiny": PhysicsLosses(poses_drawn=2),
}

LOOPS: dict[str, LoopConfig] = {
    "default": LoopConfig(steps=1500, batch=4, validate_every=150),
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
    """Train DeePSD on outfits in motion, then on physics; an outfit without data on physics alone."""

    out: Annotated[Path, NewFolder()]
    """Folder of the run: checkpoint, training state, TensorBoard."""
    data: Annotated[tuple[Path, ...], FOLDER, Several()] = ()
    """Folders made by `uvcloth simulate --outfits`, or in CLOTH3D's layout; in folders of other sequences
    each garment is an outfit."""
    start_from: Annotated[str | None, tyro.conf.arg(metavar="RUN|shipped")] = None
    """Train the network of this run further on --data, such as the fine sequences after settled outfits."""
    physics_only: Annotated[str | None, tyro.conf.arg(metavar="RUN|shipped")] = None
    """Continue from the network of this run: train only the branch of physics, all other weights stay fixed.
    """
    outfit: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME|FILE ..."), GARMENT, Several()] = ()
    """With --physics-only: train on these garments, the innermost first, instead of data."""
    poses: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="NPZ|DIR|CLIP ...", help_behavior_hint="(default: the built-in clips)"),
    ] = ()
    """Poses for --outfit, drawn by `uvcloth poses`, or the motion to draw them from."""
    preset: str = "default"
    """Preset of all settings below: default, paper or tiny."""
    resume: bool = False
    """Continue the run in `out`."""
    balanced: bool = True
    """Draw all outfits equally often; else all frames (paper)."""
    fabric: FabricName | None = None
    """Fabric of --outfit (default: jersey), for a model that reads fabrics."""
    body: BodyFile = None
    """Body of --outfit, made by `uvcloth body`."""
    network: OmitArgPrefixes[DeePSDConfig] = field(default_factory=DeePSDConfig)
    """The network; with --physics-only that of the run is used."""
    losses: OmitArgPrefixes[DataLosses] = field(default_factory=DataLosses)
    physics: OmitArgPrefixes[PhysicsLosses] = field(default_factory=PhysicsLosses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)

    def train(self) -> dict[str, float]:
        """Train; returns the validation scores of the network kept."""
        check_run(self.out, resume=self.resume)
        if self.loop.devices > 1:
            raise InputError("--devices: DeePSD is trained on one device, leave it out")
        if bool(self.data) == bool(self.outfit):
            raise InputError("name either --data, or --outfit to train on one outfit without data")
        if self.start_from is not None and self.physics_only is not None:
            raise InputError("--start-from: goes without --physics-only, which names the network itself")
        if self.outfit and self.physics_only is None:
            raise InputError(
                "--outfit: trains on physics alone, name a trained model with --physics-only RUN"
            )
        if self.fabric is not None and not self.outfit:
            raise InputError("--fabric: needs --outfit; data contain their fabric")
        return fit(self._objective(), self.out, self.loop, resume=self.resume)

    def _objective(self) -> DeePSDObjective:
        """The objective of the phase that is asked for."""
        device = training_device()
        if self.physics_only is None:
            dataset = self._outfits()
            if self.losses.mirror:
                mirrored = tuple(mirror_outfit(outfit) for outfit in dataset.training)
                dataset = replace(dataset, training=(*dataset.training, *mirrored))
            before = None if self.start_from is None else load_start(self.start_from, "--start-from")
            return DataObjective(self.network, self.losses, dataset, device, before)
        start = load_start(self.physics_only, "--physics-only")
        require_fabric_read(start.method, self.fabric)
        dataset = self._outfits() if self.data else self._posed_outfit()
        return PhysicsObjective(start, self.physics, dataset, self.loop.batch, device)

    def _outfits(self) -> OutfitDataset:
        """The outfits of the data."""
        return read_outfits(self.data, self.losses.rest_frames, balanced=self.balanced)

    def _posed_outfit(self) -> OutfitDataset:
        """The user's outfit in the poses named."""
        body = load_body(self.body)
        say = partial(Console(stderr=True).print, highlight=False, markup=False)
        garments = load_outfit(self.outfit, body, say, fabric=self.fabric)
        check_order(garments)
        return posed_outfit(Outfit(body, garments), poses_for(self.poses, body, self.out))


ENTRY = TrainerEntry(
    DeePSDRun,
    {
        name: {
            "network": network,
            "losses": LOSSES[name],
            "physics": PHYSICS[name],
            "loop": LOOPS[name],
            "balanced": name != "paper",
        }
        for name, network in METHOD.presets.items()
    },
)
