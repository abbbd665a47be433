"""`python -m train METHOD --out RUN`: fit a method to simulated sequences, or PBNS to physics alone."""

import sys
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from tyro.conf import OmitArgPrefixes

from rasterize.command import run_command
from rasterize.errors import InputError
from train.loop import LOOPS, LoopConfig, check_run, fit, format_scores, has_begun
from train.motion_guided.dataset import GarmentDataset
from train.motion_guided.objective import LOOPS as MOTION_GUIDED_LOOPS
from train.motion_guided.objective import LOSSES as MOTION_GUIDED_LOSSES
from train.motion_guided.objective import (
    SHAPE,
    SHAPE_LOOPS,
    DynamicsObjective,
    MotionGuidedLosses,
    ShapeObjective,
    load_shape_space,
)
from train.pbns.objective import LOOPS as PBNS_LOOPS
from train.pbns.objective import PRESETS as PBNS_PRESETS
from train.pbns.objective import AttachmentConfig, ClothMaterial, PBNSObjective, held_vertices
from train.pbns.poses import poses_for
from train.physxnet.objective import LOSSES, Losses, PhysXNetObjective
from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.motion_guided import method as motion_guided
from uvcloth.methods.motion_guided.method import MotionGuidedConfig
from uvcloth.methods.pbns.method import PBNSConfig
from uvcloth.methods.physxnet import method as physxnet
from uvcloth.methods.physxnet.method import PhysXNetConfig


@dataclass(frozen=True)
class PhysXNetRun:
    """Train PhysXNet: body motion maps in, garment offset maps out."""

    data: Path
    """Folder of sequences made by `uvcloth simulate`."""
    out: Path
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """default, paper or tiny: where every setting below starts from."""
    resume: bool = False
    """Continue the run in `out` where it stopped."""
    body: Path | None = None
    """The body that the sequences were simulated on; default: the one in the package."""
    network: OmitArgPrefixes[PhysXNetConfig] = field(default_factory=PhysXNetConfig)
    losses: OmitArgPrefixes[Losses] = field(default_factory=Losses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)

    def train(self) -> dict[str, float]:
        """Train; returns the validation errors of the network kept."""
        check_run(self.out, resume=self.resume)
        if self.network.history and self.loop.devices > 1:
            raise InputError(
                "--history: what a network remembers is trained on one device, leave out --devices"
            )
        body = load_body(self.body) if self.body else None
        objective = PhysXNetObjective(self.network, self.losses, self.data, self.out, body)
        return fit(objective, self.out, self.loop, resume=self.resume)


@dataclass(frozen=True)
class MotionGuidedRun:
    """Train Motion-guided on one garment: a space of its shapes, then the dynamics in it."""

    data: Path
    """Folder of sequences made by `uvcloth simulate`."""
    out: Path
    """Folder of the run: checkpoint, training state, TensorBoard; in its folder shape, the first stage."""
    preset: str = "fast"
    """fast, paper or tiny: where every setting below starts from."""
    resume: bool = False
    """Continue the run in `out` where it stopped, at either stage."""
    body: Path | None = None
    """The body that the sequences were simulated on; default: the one in the package."""
    frames: int | None = None
    """Train on the first so many frames only, clip after clip."""
    network: OmitArgPrefixes[MotionGuidedConfig] = field(default_factory=MotionGuidedConfig)
    losses: OmitArgPrefixes[MotionGuidedLosses] = field(default_factory=MotionGuidedLosses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)
    """How long and how fast to train the dynamics."""
    shape: LoopConfig = field(default_factory=LoopConfig)
    """The same for the space of shapes."""

    def train(self) -> dict[str, float]:
        """Train what is missing of both stages; returns the validation errors of the second."""
        if self.losses.past == "own" and self.loop.devices > 1:
            raise InputError(
                "--past own: what a network remembers is trained on one device, leave out --devices"
            )
        first = self.out / SHAPE
        second_began = self.resume and has_begun(self.out)
        check_run(first, resume=self.resume)
        if not self.resume:
            check_run(self.out, resume=False)
        body = load_body(self.body) if self.body else None
        dataset = GarmentDataset(self.network, self.losses, self.data, body, self.frames)
        if not second_began:
            fit(ShapeObjective(dataset, self.losses), first, self.shape, resume=self.resume)
        objective = DynamicsObjective(dataset, self.losses, load_shape_space(first, dataset.config))
        return fit(objective, self.out, self.loop, resume=second_began)


@dataclass(frozen=True)
class PBNSRun:
    """Train PBNS on a garment or an outfit: physics alone teaches, no sequence is needed."""

    garment: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME|FILE ...")]
    """Templates (tops, bottoms, dress) or garment files, the innermost first."""
    out: Path
    """Folder of the run: checkpoint, training state, TensorBoard, and the poses if they are drawn here."""
    poses: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="NPZ|DIR|CLIP ...", help_behavior_hint="(default: the built-in clips)"),
    ] = ()
    """Poses drawn by `uvcloth poses`, or the motion to draw them from."""
    preset: str = "default"
    """default, paper or tiny: where every setting below starts from."""
    resume: bool = False
    """Continue the run in `out` where it stopped."""
    body: Path | None = None
    """A body made by `uvcloth body`; default: the one in the package."""
    network: OmitArgPrefixes[PBNSConfig] = field(default_factory=PBNSConfig)
    material: OmitArgPrefixes[ClothMaterial] = field(default_factory=ClothMaterial)
    attachment: OmitArgPrefixes[AttachmentConfig] = field(default_factory=AttachmentConfig)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=lambda: PBNS_LOOPS["default"])

    def train(self) -> dict[str, float]:
        """Train; returns the validation scores of the network kept."""
        check_run(self.out, resume=self.resume)
        if not self.garment:
            raise InputError("--garment: name at least one garment")
        body = load_body(self.body)
        say = partial(Console(stderr=True).print, highlight=False, markup=False)
        outfit = Outfit(body, tuple(load_garment(name, body, say) for name in self.garment))
        # To draw poses takes minutes: what cannot hang is refused before.
        held_vertices(outfit, self.attachment)
        poses = poses_for(self.poses, body, self.out)
        objective = PBNSObjective(
            self.network, self.material, self.attachment, outfit, poses, self.loop.batch
        )
        return fit(objective, self.out, self.loop, resume=self.resume)


def _of(presets: Mapping[str, Any], name: str) -> Any:
    if name not in presets:
        raise InputError(f"--preset {name}: expected one of {', '.join(presets)}")
    return presets[name]


def physxnet_preset(name: str) -> dict[str, Any]:
    """The settings of a preset, as defaults of PhysXNetRun. Raises InputError for an unknown name."""
    network = _of(physxnet.PRESETS, name)
    return {"preset": name, "network": network, "losses": LOSSES[name], "loop": LOOPS[name]}


def motion_guided_preset(name: str) -> dict[str, Any]:
    """The settings of a preset, as defaults of MotionGuidedRun. Raises InputError for an unknown name."""
    network = _of(motion_guided.PRESETS, name)
    loop = MOTION_GUIDED_LOOPS[name]
    return {
        "preset": name,
        "network": network,
        "losses": MOTION_GUIDED_LOSSES[name],
        "loop": loop,
        "shape": SHAPE_LOOPS[name],
    }


def pbns_preset(name: str) -> dict[str, Any]:
    """The settings of a preset, as defaults of PBNSRun. Raises InputError for an unknown name."""
    return {"preset": name, **_of(PBNS_PRESETS, name), "loop": PBNS_LOOPS[name]}


METHODS: dict[str, tuple[type[PhysXNetRun] | type[MotionGuidedRun] | type[PBNSRun], str, Any]] = {
    "physxnet": (PhysXNetRun, "default", physxnet_preset),
    "motion_guided": (MotionGuidedRun, "fast", motion_guided_preset),
    "pbns": (PBNSRun, "default", pbns_preset),
}
"""What can be trained: its settings, and the presets they start from, the usual one by name."""


def main() -> None:
    """Parse the command line and train."""
    method, *arguments = sys.argv[1:] or ["--help"]
    if method not in METHODS:
        if method in ("-h", "--help"):
            print(f"usage: python -m train {{{','.join(METHODS)}}} --out RUN [--help]")
            return
        raise InputError(f"{method}: cannot be trained, expected one of {', '.join(METHODS)}")
    kind, usual, preset = METHODS[method]
    needed = [part.name for part in fields(kind) if part.default is part.default_factory is MISSING]
    asked: Any = {name: tyro.MISSING for name in needed}
    default = replace(kind(**asked), **preset(_preset_of(arguments) or usual))
    run = tyro.cli(kind, args=arguments, default=default, prog=f"python -m train {method}")
    if find_spec("lightning") is None:
        raise InputError("training needs Lightning: install uvcloth[train]")
    scores = run.train()
    Console().print(f"{run.out}: kept that of step {scores['step']:.0f}, validation: {format_scores(scores)}")


def _preset_of(arguments: list[str]) -> str | None:
    for index, argument in enumerate(arguments):
        if argument == "--preset" and index + 1 < len(arguments):
            return arguments[index + 1]
        if argument.startswith("--preset="):
            return argument.partition("=")[2]
    return None


if __name__ == "__main__":
    sys.exit(run_command("train", main))
