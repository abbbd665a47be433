"""The objective of recurrent rigs: weights of blend shapes over windows of cage runs, and their change."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
from torch import Tensor, nn

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData, body_record, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.files.options import AtLeast, Between
from uvcloth.methods.recurrent.method import Recurrent, recurrent_checkpoint
from uvcloth.methods.recurrent.network import RecurrentConfig, RecurrentNetwork, RecurrentNetworks

from ..loop import Objective, training_device
from .windows import SKIN_EVERY, GarmentRuns, RunStatistics, Windows

SLOW = 1.0
"""Speed, mm per frame, that errors of the speed are a share of where cloth is slower."""

MARGIN = 0.004
"""Metres off the skin where cloth is not pushed away any more: faces are flat, the body is round."""


@dataclass(frozen=True)
class RecurrentLosses:
    """Windows of the runs, and the weights of the losses."""

    window: Annotated[int, AtLeast(2)] = 60
    """Consecutive frames that a step predicts, with gradients through all."""
    unscored: Annotated[int, AtLeast(0)] = 15
    """First frames of a window, in which the hidden state comes to know the motion."""
    change: Annotated[float, Between(0, 1e9)] = 2.0
    """Error of the change since the last frame, beside that of the shape."""
    speed: Annotated[float, Between(0, 1e9)] = 0.0
    """Error of how fast cloth moves, whichever way, as a share of its speed: without it cloth stands still
    after a slow stop, where nobody knows which way it swings."""
    skin: Annotated[float, Between(0, 1e9)] = 10.0
    """Depth of the cloth in a layer of 4 mm on the skin, of which a rig has no other cure."""
    noise: Annotated[float, Between(0, 10)] = 0.05
    """Standard deviation of noise on the inputs, in theirs."""
    mirror: bool = True
    """Also train on mirror images of the runs, where the garment is symmetric."""

    def __post_init__(self) -> None:
        """Raises InputError for a window that scores nothing."""
        if self.unscored >= self.window - 1:
            raise InputError(f"--unscored {self.unscored}: has to be less than --window less one")


@dataclass(frozen=True)
class WarmStart:
    """A model whose weights are trained further, and what it was made from."""

    method: Recurrent
    data: TrainingData

    def fitted(self) -> dict[str, RunStatistics]:
        """The statistics of its garments."""
        networks = self.method.networks
        return {name: RunStatistics.of(networks.of(name)) for name in networks}


class RecurrentObjective(Objective):
    """Networks of several garments, each on runs of its own."""

    def __init__(
        self,
        config: RecurrentConfig,
        losses: RecurrentLosses,
        folders: Sequence[Path],
        body: Body,
        start: WarmStart | None = None,
    ) -> None:
        self.config, self.losses, self.body, self.start = config, losses, body, start
        self.device = training_device()
        windows = Windows(losses.window, losses.unscored, losses.mirror)
        before = {} if start is None else start.fitted()
        made = [GarmentRuns(path, body, windows, config.shapes, self.device, before) for path in folders]
        self.runs = {runs.name: runs for runs in made}
        self._samples = torch.arange(max(map(len, made)))
        self._measure_units()

    @property
    def samples(self) -> Tensor:
        """A row for each place where a window may start."""
        return self._samples

    def networks(self) -> dict[str, nn.Module]:
        """A network for each garment, with its shapes, and inputs scaled to the data."""
        joints = len(self.body.skeleton.heads)
        nets: dict[str, nn.Module] = {}
        for name, runs in self.runs.items():
            net = RecurrentNetwork(self.config, joints, len(runs.fitted.mean), *runs.corners.shape)
            for key, value in vars(runs.fitted).items():
                getattr(net, key).copy_(value)
            net.extremes.copy_(runs.extremes())
            net.corners.copy_(runs.corners)
            net.shares.copy_(runs.shares)
            if self.start is not None:
                net.load_state_dict(self.start.method.networks.of(name).state_dict())
            nets[name] = net
        return {"net": RecurrentNetworks(nets)}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The losses of a batch of windows, mm."""
        parts: dict[str, Tensor] = {}
        # Windows may start anywhere between the places of two rows, in runs that came later as well.
        places = (rows + torch.rand(len(rows), device=rows.device)) / len(self._samples)
        for name, runs in self.runs.items():
            some = runs.draw(places.to(self.device))
            inputs = some.inputs + self.losses.noise * torch.randn_like(some.inputs)
            weights = networks["net"](name, inputs, some.conditions)
            scored = slice(self.losses.unscored, None)
            predicted, truth = (
                1000.0 * self._units[name] * each[:, scored] for each in (weights, some.weights)
            )
            wrong = predicted - truth
            parts[f"{name}_shape"] = _length(wrong)
            parts[f"{name}_change"] = self.losses.change * _length(wrong.diff(dim=1))
            if self.losses.speed > 0:
                parts[f"{name}_speed"] = self.losses.speed * speed_error(predicted, truth)
            if self.losses.skin > 0:
                inside = runs.fitted.inside(weights[:, scored][:, ::SKIN_EVERY].float(), some.skin, MARGIN)
                parts[f"{name}_skin"] = 1000.0 * self.losses.skin * inside.mean()
        yield "net", torch.stack(list(parts.values())).sum(), parts

    @torch.no_grad()
    def validate(self, net: Any) -> dict[str, float]:
        """Mean distance of the cages to those of held-out runs, mm; then takes in runs that came since."""
        net.eval()
        errors = {f"{name}_mm": self._error(net.of(name), runs) for name, runs in self.runs.items()}
        net.train()
        for runs in self.runs.values():
            runs.take_in()
        return {"mean_mm": sum(errors.values()) / len(errors), **errors}

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint."""
        notes = {**notes, "losses": asdict(self.losses)}
        notes["frames"] = {name: runs.frames for name, runs in self.runs.items()}
        method = Recurrent(self.config, net)
        save_checkpoint(recurrent_checkpoint(method, self.body, self._data(), notes), run)

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run; runs of cages may come."""
        return {
            "method": "recurrent",
            "network": asdict(self.config),
            "losses": asdict(self.losses),
            "body": body_record(self.body),
            "garments": {name: runs.quality for name, runs in self.runs.items()},
        }

    def memory(self) -> dict[str, Tensor]:
        """Statistics fitted to the first runs of each garment: later ones would give other shapes."""
        return {
            f"{name}.{key}": value
            for name, runs in self.runs.items()
            for key, value in vars(runs.fitted).items()
        }

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Restore what was fitted."""
        for name, runs in self.runs.items():
            runs.restore(RunStatistics(**{key: memory[f"{name}.{key}"] for key in vars(runs.fitted)}))
        self._measure_units()

    def _measure_units(self) -> None:
        self._units = {name: runs.fitted.unit() for name, runs in self.runs.items()}

    def _error(self, net: RecurrentNetwork, runs: GarmentRuns) -> float:
        """Mean distance, mm, of a garment's cage to those of held-out runs."""
        errors = []
        for run in runs.held_out():
            inputs = runs.inputs(run)
            still = inputs[:1].expand(self.losses.unscored, -1)
            weights = net(torch.cat([still, inputs])[None], run.condition[None])[0, len(still) :]
            resting = runs.fitted.mean + torch.einsum("tk,knc->tnc", weights, runs.fitted.shapes)
            errors.append(run.posed(resting - run.resting).norm(dim=2).flatten())
        return 1000.0 * float(torch.cat(errors).mean())

    def _data(self) -> TrainingData:
        before = {} if self.start is None else self.start.data.clips
        clips = {kind: dict(before.get(kind, {})) for kind in ("train", "validation")}
        for runs in self.runs.values():
            clips["train"] |= runs.clips(held_out=False)
            clips["validation"] |= runs.clips(held_out=True)
        return TrainingData(clips=clips)


def speed_error(predicted: Tensor, truth: Tensor) -> Tensor:
    """Mean relative error of the speed of weights (B, T, K), mm; below SLOW it is the share of that."""
    ours, true = (each.diff(dim=1).square().sum(-1).add(1e-2).sqrt() for each in (predicted, truth))
    return ((ours - true).abs() / true.clamp(min=SLOW)).mean()


def _length(values: Tensor) -> Tensor:
    """Mean length of vectors (..., K), without a kink at zero."""
    return values.square().sum(-1).add(1e-4).sqrt().mean()
