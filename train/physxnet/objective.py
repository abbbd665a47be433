"""The objective of PhysXNet: losses, validation and checkpoints."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import torch
from rich.console import Console
from torch import Tensor, nn

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.checkpoint import save_checkpoint
from uvcloth.dataset.clip import SimulatedClip, count_frames
from uvcloth.dataset.reader import read_clips, require_rests
from uvcloth.dataset.splits import Holdout, hold_out, of_split, training_data
from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.geometry.mesh import edge_lengths
from uvcloth.geometry.operators import Operator, differences, sampling
from uvcloth.geometry.records import CPU, to_device
from uvcloth.methods.lbs import LinearBlendSkinning, SkinnedGarment
from uvcloth.methods.method import Method, for_inference
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.maps import garment_vertices
from uvcloth.methods.physxnet.method import PhysXNet, PhysXNetPrepared, offsets_of, physxnet_checkpoint
from uvcloth.methods.physxnet.network import GarmentNet, mirror

from ..loop import Objective
from ..validation import mean_errors, rollout_distances
from .frames import Frames, load_frames
from .patchgan import PatchGAN, discriminator_loss, generator_loss
from .prepare import Correspondences, SharedTexels, prepare, share_texels

STATISTICS_STRIDE = 4
"""Every n-th training frame enters the statistics."""

GEOMETRY_STRIDE = 4
"""Every n-th row of a batch is decoded for the edge and bend losses, which cost as much as the network."""


@dataclass(frozen=True)
class Losses(Holdout):
    """Weights of the losses, and how they are trained."""

    l1: Annotated[float, Between(0, 1e9)] = 1.0
    """Weight of the L1 error over each template's valid texels (paper: 100, against the discriminator)."""
    edge: Annotated[float, Between(0, 1e9)] = 4.0
    """Weight of the edge length error of the decoded garment, as a share of the rest length."""
    bend: Annotated[float, Between(0, 1e9)] = 1.0
    """Weight of the error of the offsets' differences along edges, as a share of the rest length."""
    adversarial: bool = False
    """Train against a PatchGAN discriminator (paper)."""
    mirror: bool = True
    """Mirror half of the samples left to right."""


@dataclass(frozen=True)
class TrainingBody:
    """A body that training clips are on.

    clips: those that validate. geometry: of each template, see `_geometry`.
    """

    body: Body
    prepared: Correspondences
    clips: tuple[SimulatedClip, ...]
    geometry: tuple[tuple[Operator, Operator, Tensor], ...]


class PhysXNetObjective(Objective):
    """Losses and validation of one network on one set of clips, on any bodies, all held in memory."""

    def __init__(
        self,
        config: PhysXNetConfig,
        losses: Losses,
        data: Sequence[Path],
        run: Path,
        device: torch.device = CPU,
    ) -> None:
        """Read the data and prepare everything on the device.

        data: folders, each of sequences on one body. Raises InputError if bodies and templates do not fit.
        """
        self.config, self.weights, self.device = config, losses, device
        folders = " ".join(map(str, data))
        worn = read_clips(data, config.templates)
        prepared = [prepare(run, body, config.templates, config.size) for body, _ in worn]
        _require_one_layout([body for body, _ in worn], prepared)
        for (body, clips), ready in zip(worn, prepared, strict=True):
            require_rests({name: decoder.points for name, decoder in ready.decoders.items()}, clips, body)
        dealt = hold_out([clip for _, clips in worn for clip in clips], losses, folders)
        training, held = of_split(dealt, "train"), of_split(dealt, "validation")
        for name in config.templates:
            if not any(name in clip.by_name for clip in training):
                raise InputError(
                    f"{folders}: no training sequence of {name}; simulate some or set --templates"
                )
        self.data = training_data(dealt)
        validating = "validation" if held else "train"
        held = held or training
        on = f" on {len(worn)} bodies" if len(worn) > 1 else ""
        Console().print(
            f"{count_frames(training)} training frames of {len(training)} clips{on}, "
            f"{count_frames(held)} validation frames ({', '.join(clip.name for clip in held)})"
        )
        shared = [share_texels(prepared, name) for name in config.templates]
        self.shared: list[SharedTexels] = to_device(shared, device)
        rest = iter(dealt)
        worn = [(body, list(islice(rest, len(clips)))) for body, clips in worn]
        self.wearers = [
            to_device(
                TrainingBody(
                    body,
                    ready,
                    tuple(of_split(clips, validating)),
                    tuple(_geometry(ready, name) for name in config.templates),
                ),
                device,
            )
            for (body, clips), ready in zip(worn, prepared, strict=True)
        ]
        self.frames = load_frames(
            config,
            [
                (each.body, of_split(clips, "train"))
                for each, (_, clips) in zip(self.wearers, worn, strict=True)
            ],
            [wearer.prepared for wearer in self.wearers],
            self.shared,
            "training frames",
        )
        self.past = _new_past(config, self.frames) if config.history else torch.zeros(0)
        if config.anchor == "smooth_lbs":
            errors = {name: f"{error:.1f}" for name, error in self._skinning_errors().items()}
            Console().print(f"smooth skinning alone: {errors}")

    @property
    def samples(self) -> Tensor:
        """The rows that a step may ask for."""
        return self.frames.rows.samples

    def networks(self) -> dict[str, nn.Module]:
        """The network, scaled to the training data, and the discriminator if there is one."""
        net = GarmentNet(self.config).to(self.device)
        set_statistics(net, self.config, self.wearers[0].prepared, self.shared, self.frames)
        if not self.weights.adversarial:
            return {"net": net}
        channels = self.config.inputs + 3 * len(self.config.templates)
        return {"net": net, "discriminator": PatchGAN(channels, self.config.width)}

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The losses of one batch: which network each trains, and its parts for the log."""
        maps = self.frames.inputs(rows)
        if self.config.history:
            maps = torch.cat([maps, self._history(rows)], dim=1)
        mirrored = len(rows) // 2 if self.weights.mirror else 0
        predicted = networks["net"](torch.cat([mirror(maps[:mirrored]), maps[mirrored:]]))
        predicted = torch.cat([mirror(predicted[:mirrored]), predicted[mirrored:]])
        if self.config.history:
            self.past[rows] = predicted.detach().half()
        parts = self._parts(networks["net"], predicted, rows)
        total = torch.stack(list(parts.values())).sum()
        if self.weights.adversarial:
            inputs, real, made = self._discriminator_inputs(networks["net"], maps, predicted, rows)
            discriminator = networks["discriminator"]
            loss = discriminator_loss(
                discriminator(torch.cat([inputs, real], dim=1)),
                discriminator(torch.cat([inputs, made.detach()], dim=1)),
            )
            yield "discriminator", loss, {"discriminator": loss}
            fooled = generator_loss(discriminator(torch.cat([inputs, made], dim=1)))
            total, parts = total + fooled, {**parts, "adversarial": fooled}
        yield "net", total, parts

    def _parts(self, net: GarmentNet, predicted: Tensor, rows: Tensor) -> dict[str, Tensor]:
        """Weighted losses over the templates; a template that a row lacks weighs nothing in it."""
        scales = net.output_scale.flatten()
        parts = {
            "l1": predicted.new_zeros(()),
            "edge": predicted.new_zeros(()),
            "bend": predicted.new_zeros(()),
        }
        present = self.frames.present[rows].float()
        total = present.sum().clamp(min=1.0)
        some = slice(None, None, GEOMETRY_STRIDE)
        bodies, share = self.frames.bodies[rows], present[some] / present[some].sum().clamp(min=1.0)
        decoded: list[tuple[Tensor, Tensor]] = []
        for index, texels in enumerate(self.shared):
            visible = texels.visible[bodies, :, None]
            offsets = offsets_of(predicted, index, texels.pixels)
            wrong = (offsets - self.frames.offsets[index][rows].float()) * visible
            means = wrong.abs().sum(1) / visible.sum(1)
            error = (means / scales[3 * index : 3 * index + 3]).mean(1)
            parts["l1"] = parts["l1"] + self.weights.l1 * (present[:, index] * error).sum() / total
            decoded.append((offsets[some], wrong[some]))
        for which, places in self._by_body(bodies[some]):
            wearer, transforms = self.wearers[which], self.frames.rows.transforms[rows[some][places]]
            posed = posed_skin(wearer.body, transforms) if self.config.anchor == "body" else transforms
            for index, texels in enumerate(self.shared):
                offsets, wrong = (values[places][:, texels.slots[which]] for values in decoded[index])
                stretch, turned = self._edges(wearer, index, offsets, wrong, posed, transforms)
                parts["edge"] = parts["edge"] + self.weights.edge * (share[places, index] * stretch).sum()
                parts["bend"] = parts["bend"] + self.weights.bend * (share[places, index] * turned).sum()
        return parts

    def _by_body(self, bodies: Tensor) -> Iterator[tuple[int, Tensor]]:
        """Yield each of the bodies (B,) with the places that it has among them.

        Where there are several, a GPU is waited for.
        """
        if len(self.wearers) == 1:
            yield 0, torch.arange(len(bodies), device=bodies.device)
            return
        for which in bodies.unique().tolist():
            yield which, torch.nonzero(bodies == which).squeeze(1)

    def _edges(
        self,
        wearer: TrainingBody,
        index: int,
        offsets: Tensor,
        wrong: Tensor,
        posed: Tensor,
        transforms: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Errors of a template's edges on one body, as shares of their rest lengths: two of (B,).

        offsets, wrong: (B, Q, 3) m of the texels that the body sees, and what they are off. posed: (B, V, 3)
        its vertices, where offsets are from these. Of the edges' lengths, and of the differences of what is
        wrong along them. Zero where the loss weighs nothing.
        """
        name = self.config.templates[index]
        sample, edges, rest = wearer.geometry[index]
        stretch = turned = offsets.new_zeros(len(offsets))
        if self.weights.edge:
            vertices = garment_vertices(
                self.config,
                wearer.prepared.texels,
                wearer.prepared.templates[name],
                wearer.prepared.decoders[name],
                offsets=offsets,
                body_vertices=posed,
                transforms=transforms,
                sample=sample,
            )
            stretch = (edges(vertices).norm(dim=2) / rest - 1.0).abs().mean(1)
        if self.weights.bend:
            turned = (edges(sample(wrong)).norm(dim=2) / rest).mean(1)
        return stretch, turned

    def _history(self, rows: Tensor) -> Tensor:
        """The latest predictions of the frames before: (B, history * templates * 3, H, W), oldest first."""
        before, known = self.frames.rows.before(rows, self.config.history)
        past = self.past[before.clamp(min=0)].float() * known[..., None, None, None]
        return past.flatten(1, 2)

    def _discriminator_inputs(
        self, net: GarmentNet, maps: Tensor, predicted: Tensor, rows: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Inputs of the discriminator: normalized inputs, real and made maps, zero off the cloth."""
        real, mask = torch.zeros_like(predicted), torch.zeros_like(predicted)
        for index, texels in enumerate(self.shared):
            part = slice(3 * index, 3 * index + 3)
            true = self.frames.offsets[index][rows].float().transpose(1, 2)
            visible = texels.visible[self.frames.bodies[rows]] & self.frames.present[rows][:, index, None]
            real[:, part].flatten(2)[:, :, texels.pixels] = true
            mask[:, part].flatten(2)[:, :, texels.pixels] = visible[:, None].float()
        real, made = (mask * (values - net.output_shift) / net.output_scale for values in (real, predicted))
        return net.scaled(maps), real, made

    def validate(self, net: nn.Module) -> dict[str, float]:
        """Mean vertex error in mm of each template over the validation clips, and their mean."""
        method = PhysXNet(self.config, net)  # type: ignore[arg-type]
        network = for_inference(net, self.device)

        def on(ready: Correspondences) -> PhysXNetPrepared:
            garments = tuple((name, ready.decoders[name]) for name in self.config.templates)
            return PhysXNetPrepared(network, ready.texels, ready.templates, garments)

        return self._rollout_errors(method, on)

    def _skinning_errors(self) -> dict[str, float]:
        """Mean vertex errors, mm, of a garment that never leaves the smooth LBS reference, see `validate`."""

        def on(ready: Correspondences) -> tuple[SkinnedGarment, ...]:
            decoders = (ready.decoders[name] for name in self.config.templates)
            return tuple(SkinnedGarment(decoder.points, decoder.smooth_weights) for decoder in decoders)

        return self._rollout_errors(LinearBlendSkinning("lbs_smooth", smooth=True), on)

    def _rollout_errors(self, method: Method, on: Callable[[Correspondences], Any]) -> dict[str, float]:
        """Mean vertex errors, mm, of a method over the validation clips; on: prepares it for a body."""
        names, distances = self.config.templates, defaultdict[str, list[Tensor]](list)
        for wearer in self.wearers:
            errors = rollout_distances(
                method, on(wearer.prepared), wearer.body, names, wearer.clips, self.device
            )
            for name, values in errors.items():
                distances[name] += values
        return mean_errors(distances)

    def save(self, net: GarmentNet, run: Path, notes: dict[str, Any]) -> None:
        """Write the trained method to the run's folder."""
        method = PhysXNet(self.config, net)
        save_checkpoint(physxnet_checkpoint(method, self.wearers[0].body, self.data, notes), run)

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run."""
        return {
            "method": asdict(self.config),
            "losses": asdict(self.weights),
            "data": asdict(self.data),
        }

    def memory(self) -> dict[str, Tensor]:
        """The latest predictions, which an exact resume needs."""
        return {"past": self.past} if self.config.history else {}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Restore the state that `memory` gave."""
        if self.config.history:
            self.past.copy_(memory["past"])


def _geometry(prepared: Correspondences, name: str) -> tuple[Operator, Operator, Tensor]:
    """Operators from a template's texels to vertices and from these to edge vectors; rest lengths, m."""
    decoder, edges = prepared.decoders[name], prepared.edges[name]
    sample = sampling(decoder.samples, decoder.shares, len(prepared.templates[name].texels))
    return sample, differences(edges, len(decoder.points)), edge_lengths(decoder.points, edges)


def set_statistics(
    net: GarmentNet,
    config: PhysXNetConfig,
    prepared: Correspondences,
    shared: Sequence[SharedTexels],
    frames: Frames,
) -> None:
    """Take the scales of inputs and outputs from the training frames."""
    samples = frames.rows.samples
    rows = samples[::STATISTICS_STRIDE]
    body = prepared.texels.sheet.pixels

    def values(maps: Tensor) -> Tensor:
        return maps[rows].flatten(2)[:, :, body].float().transpose(1, 2).flatten(0, 1)

    motion = _scales(config, values(frames.motion))
    shifts, scales = [motion[0].repeat(3)], [motion[1].repeat(3)]
    if config.pose:
        pose = _scales(config, values(frames.pose))
        shifts.append(pose[0])
        scales.append(pose[1])
    net.output_shift.zero_()
    for index, texels in enumerate(shared):
        rows = samples[frames.present[samples, index]][::STATISTICS_STRIDE]
        if not len(rows):
            continue
        channels = slice(3 * index, 3 * index + 3)
        offsets = frames.offsets[index][rows].float()
        visible = texels.visible[frames.bodies[rows]]
        if config.centre == "texel":
            mean = offsets.sum(0) / visible.sum(0).clamp(min=1)[:, None]
            net.output_shift[channels].flatten(1)[:, texels.pixels] = mean.t()
            offsets = offsets - mean
        shift, scale = _scales(config, offsets[visible])
        if config.centre == "channel":
            net.output_shift[channels] = shift[:, None, None]
        net.output_scale[channels] = scale[:, None, None]
    means = net.output_shift.mean((1, 2))
    shifts += [means] * config.history
    scales += [net.output_scale.flatten()] * config.history
    net.input_shift.copy_(torch.cat(shifts)[:, None, None])
    net.input_scale.copy_(torch.cat(scales)[:, None, None])


def _scales(config: PhysXNetConfig, values: Tensor) -> tuple[Tensor, Tensor]:
    """Shift and scale (C,) that bring values (P, C) to [-1, 1] or to zero mean and unit deviation."""
    if config.scaling == "min_max":
        low, high = values.amin(0), values.amax(0)
        return (high + low) / 2, ((high - low) / 2).clamp(min=1e-6)
    return values.mean(0), values.std(0).clamp(min=1e-6)


def _require_one_layout(bodies: Sequence[Body], prepared: Sequence[Correspondences]) -> None:
    """Raise InputError naming the first body whose maps, or joints, are not those of the first one."""
    for body, ready in zip(bodies, prepared, strict=True):
        same = ready.texels.sheet.pixels.equal(prepared[0].texels.sheet.pixels)
        if not same or body.skeleton.names != bodies[0].skeleton.names:
            raise InputError(f"--data: body {body.name} has another layout or skeleton than {bodies[0].name}")


def _new_past(config: PhysXNetConfig, frames: Frames) -> Tensor:
    """Zeros in place of the predictions of all rows (R, C, H, W), half precision."""
    sheet = (3 * len(config.templates), config.size, config.size)
    return frames.rows.transforms.new_zeros(len(frames.rows.starts), *sheet, dtype=torch.float16)
