"""The objectives of Motion-guided: first a space of shapes, then the encoder that moves through it."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
from rich.progress import track
from torch import Tensor, nn

from uvcloth.checkpoint import load_checkpoint, save_checkpoint
from uvcloth.dataset.splits import Holdout
from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.methods.method import for_inference
from uvcloth.methods.motion_guided.config import MotionGuidedConfig
from uvcloth.methods.motion_guided.dynamics_input import (
    MEMORY,
    DynamicsInput,
    GarmentHistory,
    dynamics_features,
    motion_of,
    posed_shape,
    rest_shape,
    state_features,
)
from uvcloth.methods.motion_guided.latent import LinearSpace, Space
from uvcloth.methods.motion_guided.method import (
    MotionGuided,
    MotionGuidedPrepared,
    faces_hash,
    motion_guided_checkpoint,
)

from ..loop import Objective
from ..validation import mean_errors, rollout_distances
from .dataset import FRAMES_AT_ONCE, GarmentDataset, GarmentFrames, offsets_of
from .linear_space import fit_linear


@dataclass(frozen=True)
class MotionGuidedLosses(Holdout):
    """Weights of the losses of both stages (sections 4.2 and 5), and how they are trained."""

    laplacian: Annotated[float, Between(0, 1e9)] = 1.0
    """Error of the mesh Laplacian, in addition to that of the vertices."""
    random: Annotated[float, Between(0, 1e9)] = 0.1
    """Edge lengths of shapes decoded from random codes."""
    inside: Annotated[float, Between(0, 1e9)] = 100.0
    """Depth in the body at rest, of training shapes and random shapes."""
    settled: Annotated[float, Between(0, 1e9)] = 0.02
    """Error in metres below which `random` and `inside` are used, with full weight at zero."""
    regular: Annotated[float, Between(0, 1e9)] = 0.001
    """Distance of the mean square of codes from 1."""
    code: Annotated[float, Between(0, 1e9)] = 0.01
    """Error of the predicted codes (paper: 1, with errors of vertices summed)."""
    steady: Annotated[float, Between(0, 1e9)] = 1.0
    """Error of the change since the last frame, against jitter (paper: 0)."""
    mirror: bool = True
    """Also train on mirror images of the clips, if the garment is symmetric (paper: no)."""
    still: bool = True
    """Also train on the virtual sample in which nothing changes: E_t = 0."""
    past: Literal["own", "true"] = "own"
    """Past garments in training: the network's latest predictions, or simulated ones (paper)."""
    unroll: Annotated[int, Between(1, 1000)] = 4
    """Consecutive frames that a step predicts, each from the last, with gradients through all (paper: 1)."""


SHAPE = "shape"
"""The folder in a run that holds the first stage."""


class ShapeObjective(Objective):
    """Stage one: an autoencoder of the simulated garments."""

    def __init__(self, dataset: GarmentDataset, losses: MotionGuidedLosses) -> None:
        self.dataset, self.losses = dataset, losses

    @property
    def samples(self) -> Tensor:
        """The scored rows of all training clips."""
        return self.dataset.training.rows.samples

    def networks(self) -> dict[str, nn.Module]:
        """The space, its inputs scaled to the data; a linear one is fitted."""
        dataset, net = self.dataset, self.dataset.config.shape_space().to(self.dataset.device)
        offsets = dataset.training.offsets[dataset.training.rows.samples[::4]]
        maps = dataset.maps.map(offsets)
        net.shift.copy_(maps.mean(0))
        net.scale.copy_((maps - net.shift).std().clamp(min=1e-3))
        if isinstance(net, LinearSpace):
            fit_linear(net, dataset)
        return {"net": net}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The losses of a batch (section 4.2)."""
        dataset, losses = self.dataset, self.losses
        space = networks["net"]
        codes = dataset.codes(space, dataset.training, rows)
        random = torch.randn_like(codes[: max(1, len(codes) // 2)])
        resting = rest_shape(space, dataset.maps, torch.cat([codes, random]), dataset.sample)
        posed = posed_shape(space, dataset.maps, resting[: len(rows)], dataset.training.pose[rows])
        lengths = dataset.edges(resting[len(rows) :]).norm(dim=2)
        wrong = posed - dataset.training.vertices[rows]
        shape = wrong.abs().mean() + losses.laplacian * dataset.laplacian(wrong).abs().mean()
        # From the start, they would train the decoder to ignore its codes.
        settled = (1.0 - shape.detach() / losses.settled).clamp(min=0.0)
        parts = {
            "shape": shape,
            "random": settled * losses.random * (lengths - dataset.lengths).abs().mean(),
            "inside": settled * losses.inside * dataset.depth(resting) if losses.inside else 0.0 * settled,
            "regular": losses.regular * _regular(codes),
        }
        yield "net", torch.stack(list(parts.values())).sum(), parts

    @torch.no_grad()
    def validate(self, net: Any) -> dict[str, float]:
        """Mean vertex error of held-out garments encoded and decoded, mm."""
        net.eval()
        dataset, errors = self.dataset, []
        for rows in dataset.held.rows.samples[::2].split(8):
            codes = dataset.codes(net, dataset.held, rows)
            resting = rest_shape(net, dataset.maps, codes)
            posed = posed_shape(net, dataset.maps, resting, dataset.held.pose[rows])
            errors.append((posed - dataset.held.vertices[rows]).norm(dim=2).mean(1) * 1000.0)
        net.train()
        return {"mean_mm": float(torch.cat(errors).mean())}

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of the first stage."""
        self._save({"space": net}, run, notes)

    def _save(self, stages: dict[str, nn.Module], run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of some stages."""
        dataset = self.dataset
        tensors = {f"{s}.{name}": t for s, net in stages.items() for name, t in net.state_dict().items()}
        notes = {**notes, "training_frames": dataset.frames}
        notes |= {"garment_topology": faces_hash(dataset.garment)}
        save_checkpoint(
            motion_guided_checkpoint(dataset.config, tensors, dataset.body, dataset.data, notes), run
        )

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run."""
        dataset = self.dataset
        return {
            "method": asdict(dataset.config),
            "losses": asdict(self.losses),
            "data": {**asdict(dataset.data), "frames": dataset.frames},
        }


class DynamicsObjective(ShapeObjective):
    """Stage two: the dynamic encoder, the shape space being fixed."""

    def __init__(self, dataset: GarmentDataset, losses: MotionGuidedLosses, space: Space) -> None:
        super().__init__(dataset, losses)
        self.space = for_inference(space, dataset.device)
        self.past, self.past_offsets = dataset.training.vertices.clone(), dataset.training.offsets.clone()
        with torch.no_grad():
            self.codes = torch.cat(
                [
                    dataset.codes(self.space, dataset.training, rows)
                    for rows in track(
                        torch.arange(len(self.past)).split(FRAMES_AT_ONCE), "codes", transient=True
                    )
                ]
            )

    @property
    def samples(self) -> Tensor:
        """First rows of clip parts that are as long as the unrolled frames."""
        return self.dataset.training.rows.windows(self.losses.unroll)

    def networks(self) -> dict[str, nn.Module]:
        """The dynamic encoder, its inputs scaled to the data."""
        net = self.dataset.config.dynamics()
        dataset = self.dataset
        motions = [
            motion_of(dataset.config.local_offsets, dataset.maps, self._input(dataset.training, rows))
            for rows in dataset.training.rows.samples[::8].split(FRAMES_AT_ONCE)
        ]
        scale = torch.cat(motions).square().mean((0, 1)).sqrt()
        net.motion_scale.copy_(scale.clamp(min=1e-3)[:, None, None])
        return {"net": net}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The losses of a batch, unrolled over several frames (section 5)."""
        dataset, losses = self.dataset, self.losses
        past, last = (
            self._input(dataset.training, rows, (self.past, self.past_offsets)).past,
            self.past[rows - 1],
        )
        frames: list[dict[str, Tensor]] = []
        for now in (rows + frame for frame in range(losses.unroll)):
            inputs = self._after(dataset.training, now, past)
            parts, last = self._losses(networks["net"], inputs, now, last)
            frames.append(parts)
            past = past.followed_by(dataset.maps, last, inputs.pose.transforms)
            if losses.past == "own":
                self.past[now], self.past_offsets[now] = last.detach(), past.offsets[:, 0].detach()
        parts = {name: torch.stack([each[name] for each in frames]).mean() for name in frames[0]}
        yield "net", torch.stack(list(parts.values())).sum(), parts

    def _losses(
        self, net: Any, inputs: DynamicsInput, rows: Tensor, last: Tensor
    ) -> tuple[dict[str, Tensor], Tensor]:
        """The parts of the loss on rows (B,), and the garments (B, N, 3) predicted; last: those before."""
        dataset, losses = self.dataset, self.losses
        features, change = dynamics_features(self.space, net, dataset.maps, inputs, dataset.config.sigma)
        if losses.still:
            features = torch.cat([features, self._unchanged(rows - 1)])
            change = torch.cat([change, torch.zeros_like(change)])
            wanted = torch.cat([rows, rows - 1])
        else:
            wanted = rows
        codes = net(features, change)
        resting = rest_shape(self.space, dataset.maps, codes, dataset.sample)
        posed = posed_shape(self.space, dataset.maps, resting, dataset.training.pose[wanted])
        wrong = posed - dataset.training.vertices[wanted]
        before = last - dataset.training.vertices[rows - 1]
        parts = {
            "shape": wrong.abs().mean(),
            "steady": losses.steady * (wrong[: len(rows)] - before).abs().mean(),
            "code": losses.code * (codes - self.codes[wanted]).abs().mean(),
            "regular": losses.regular * _regular(codes),
        }
        return parts, posed[: len(rows)]

    def _unchanged(self, rows: Tensor) -> Tensor:
        """Features beside E_t = 0 where garment and body stay as they are in rows (B,).

        The garment is the simulated one whatever the histories are: from another, it would have to change.
        """
        clips, maps = self.dataset.training, self.dataset.maps
        pose = clips.pose[rows]
        texels, offsets = maps.positions(clips.vertices[rows]), clips.offsets[rows]
        return state_features(self.space, maps, texels, offsets, pose.seeds.points, pose.transforms)

    def _input(
        self, frames: GarmentFrames, rows: Tensor, past: tuple[Tensor, Tensor] | None = None
    ) -> DynamicsInput:
        """The encoder's input for chosen rows (B,). past: garments (R, N, 3) and their offsets."""
        vertices, offsets = past or (frames.vertices, frames.offsets)
        back = rows[:, None] - torch.arange(1, MEMORY + 1, device=rows.device)
        history = GarmentHistory(self.dataset.maps.positions(vertices[back]), offsets[back])
        return self._after(frames, rows, history)

    def _after(self, frames: GarmentFrames, rows: Tensor, past: GarmentHistory) -> DynamicsInput:
        """The encoder's input for chosen rows (B,) after a history."""
        now = rows[:, None] - torch.arange(MEMORY, device=rows.device)
        return DynamicsInput(
            past=past,
            transforms=frames.pose.transforms[now],
            seeds_before=frames.pose.seeds[rows - 1],
            seeds=frames.pose.seeds[rows],
            fps=frames.rows.fps[rows],
        )

    def validate(self, net: Any) -> dict[str, float]:
        """Mean vertex error over rollouts of the held-out clips, side by side, before the finish, mm."""
        dataset = self.dataset
        config, network = dataset.config, for_inference(net, dataset.device)
        method = MotionGuided(config, self.space, network)
        prepared = MotionGuidedPrepared(self.space, network, (dataset.maps,), ())
        names = (config.garment,)
        return mean_errors(
            rollout_distances(
                method, prepared, dataset.body, names, dataset.clips, dataset.device, config.under
            )
        )

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of both stages."""
        self._save({"space": self.space, "dynamics": net}, run, notes)

    def memory(self) -> dict[str, Tensor]:
        """The latest predictions, which an exact resume needs."""
        return {"past": self.past} if self.losses.past == "own" else {}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Restore the state that `memory` gave."""
        if self.losses.past == "own":
            self.past.copy_(memory["past"])
            self.past_offsets = offsets_of(
                self.dataset.maps, self.past, self.dataset.training.pose.transforms
            )


def _regular(codes: Tensor) -> Tensor:
    """L_reg of codes (B, Z)."""
    return (codes.square().mean(1) - 1.0).abs().mean()


def load_shape_space(folder: Path, config: MotionGuidedConfig) -> Space:
    """The space of shapes that the first stage saved. Raises InputError if it is of another config."""
    checkpoint = load_checkpoint(folder)
    space = config.shape_space()
    try:
        space.load_state_dict({name.removeprefix("space."): t for name, t in checkpoint.tensors.items()})
    except RuntimeError as error:
        raise InputError(f"{folder}: was trained with other settings of the network") from error
    return space
