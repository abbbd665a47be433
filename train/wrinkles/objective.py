"""The objective of wrinkles: losses on displacement maps, validation and checkpoints."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
from rich.console import Console
from torch import Tensor, nn

from rasterize.bake import scatter_map
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.files.options import Between
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.wrinkles.inputs import input_maps
from uvcloth.wrinkles.model import Wrinkles, wrinkles_checkpoint
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet, dealt
from uvcloth.wrinkles.sheet import Sheet

from ..loop import Objective
from ..physxnet.patchgan import PatchGAN, discriminator_loss, generator_loss
from .frames import TexelFrames, load_frames, run_files

STATISTICS_STRIDE = 16
"""Every n-th frame enters the statistics."""

PADDED_AT_ONCE = 16
"""Frames whose maps are padded at once."""

VALIDATED = 4
"""Every n-th frame is validated, with the one before it."""

JUDGED = (*range(12), 18)
"""Input channels that a discriminator sees beside displacements: forms, their rates, distance."""


@dataclass(frozen=True)
class WrinkleLosses:
    """Weights of the losses."""

    l1: Annotated[float, Between(0, 1e9)] = 1.0
    """Weight of the error of displacements, over their deviation."""
    slope: Annotated[float, Between(0, 1e9)] = 1.0
    """Weight of the error of the differences between neighbouring texels, over their deviation."""
    change: Annotated[float, Between(0, 1e9)] = 0.5
    """Weight of the error of the change from the frame before, over its deviation: against popping."""
    adversarial: Annotated[float, Between(0, 1e9)] = 0.0
    """Weight of a PatchGAN discriminator of inputs and displacements; 0: none."""


@dataclass(frozen=True)
class SheetFrames:
    """Frames as maps, which padding across seams takes longer to make than a network to read.

    inputs: (R, CHANNELS, H / 2, W / 2) half. wrinkles: (R, 12, H / 2, W / 2) half, m. later: (R,) bool, see
    TexelFrames.
    """

    inputs: Tensor
    wrinkles: Tensor
    later: Tensor

    @classmethod
    def of(cls, sheet: Sheet, frames: TexelFrames) -> "SheetFrames":
        """The maps of frames."""
        inputs = [input_maps(sheet, rows.float()).half() for rows in frames.inputs.split(PADDED_AT_ONCE)]
        wrinkles = scatter_map(frames.wrinkles.flatten(2), sheet.texels)
        return cls(torch.cat(inputs), wrinkles, frames.later)


class WrinkleObjective(Objective):
    """Losses and validation of one network on runs of one garment, held in memory."""

    def __init__(
        self,
        config: WrinkleConfig,
        losses: WrinkleLosses,
        data: Sequence[Path],
        body: Body,
        device: torch.device,
    ) -> None:
        """Read the runs. Raises InputError if there are none, or if they do not fit the config."""
        self.config, self.weights, self.body, self.device = config, losses, body, device
        if len(config.garments) != 1:
            raise InputError(f"--garments {' '.join(config.garments)}: wrinkles are trained for one garment")
        (name,) = config.garments
        garment = load_garment(name, body)
        self.sheet = Sheet.of(garment, config.size)
        files = {split: run_files(data, split) for split in ("train", "validation")}
        for split, each in files.items():
            if not each:
                folders = " ".join(map(str, data))
                raise InputError(
                    f"{folders}: has no run of the split {split}, see train.wrinkles.tracked_runs"
                )
        frames, people = load_frames(files["train"], garment, body, self.sheet)
        self.frames = SheetFrames.of(self.sheet, frames)
        frames, others = load_frames(files["validation"], garment, body, self.sheet)
        self.held = SheetFrames.of(self.sheet, frames)
        if shared := {*people.values()} & {*others.values()}:
            raise InputError(f"person {min(shared)}: is in training and validation")
        self.data = TrainingData(
            files={path.name: fingerprint(path.read_bytes()) for each in files.values() for path in each},
            clips={"train": people, "validation": others},
        )
        Console().print(
            f"{len(self.frames.inputs)} training frames of {len(people)} clips, "
            f"{len(self.held.inputs)} validation frames of {len(others)}"
        )
        self.samples_at = torch.nonzero(self.frames.later).flatten()
        islands = torch.full((config.size // 2, config.size // 2), -1)
        islands.view(-1)[self.sheet.texels.pixels] = self.sheet.texels.islands
        self.texels = (islands >= 0).float().to(device)
        islands = islands.repeat_interleave(2, 0).repeat_interleave(2, 1)
        mask = islands >= 0
        # Neighbours in one chart.
        across = (islands[:, 1:] == islands[:, :-1]) & mask[:, 1:]
        down = (islands[1:] == islands[:-1]) & mask[1:]
        self.mask, self.across, self.down = (each.float().to(device) for each in (mask, across, down))

    @property
    def samples(self) -> Tensor:
        """Frames with one before them."""
        return self.samples_at

    def networks(self) -> dict[str, nn.Module]:
        """The network, scaled to the training data, and the discriminator if there is one."""
        net, pixels = WrinkleNet(self.config), self.sheet.texels.pixels
        rows = self.frames.inputs[::STATISTICS_STRIDE].flatten(2)[..., pixels].float()
        net.input_shift.copy_(rows.mean((0, 2))[:, None, None])
        net.input_scale.copy_(1.0 / rows.std((0, 2)).clamp(min=1e-4)[:, None, None])
        # The mask says where cloth is.
        net.input_shift[-1], net.input_scale[-1] = 0.0, 1.0
        wrinkles = self.frames.wrinkles[::STATISTICS_STRIDE].float()
        scale = wrinkles.flatten(2)[..., pixels].unflatten(1, (3, 4)).std((0, 2, 3)).clamp(min=1e-5)
        net.output_scale.copy_(scale.repeat_interleave(4)[:, None, None])
        with torch.no_grad():
            net.mean[0] = wrinkles.mean(0) / net.output_scale
        if not self.weights.adversarial:
            return {"net": net}
        return {"net": net, "discriminator": PatchGAN(len(JUDGED) + 12, self.config.width)}

    def maps(self, frames: "SheetFrames", rows: Tensor) -> tuple[Tensor, Tensor]:
        """Input maps (B, CHANNELS, H / 2, W / 2) and displacements, alike, of frames (B,)."""
        inputs, wrinkles = (maps[rows].float().to(self.device) for maps in (frames.inputs, frames.wrinkles))
        return inputs.contiguous(memory_format=torch.channels_last), wrinkles

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The losses of one batch of frames, each with the one before it."""
        rows = torch.cat([rows, rows - 1]).cpu()
        inputs, wrinkles = self.maps(self.frames, rows)
        net = networks["net"]
        made, real = net(inputs) / net.output_scale * self.texels, wrinkles / net.output_scale
        parts = self.parts(dealt(made), dealt(real))
        total = torch.stack(list(parts.values())).sum()
        if self.weights.adversarial:
            judged = (inputs - net.input_shift * self.texels) * net.input_scale
            beside = judged.clamp(-self.config.reach, self.config.reach)[:, list(JUDGED)] * self.texels
            discriminator = networks["discriminator"]
            loss = discriminator_loss(
                discriminator(torch.cat([beside, real], dim=1)),
                discriminator(torch.cat([beside, made.detach()], dim=1)),
            )
            yield "discriminator", loss, {"discriminator": loss}
            fooled = self.weights.adversarial * generator_loss(
                discriminator(torch.cat([beside, made], dim=1))
            )
            total, parts = total + fooled, {**parts, "adversarial": fooled}
        yield "net", total, parts

    def parts(self, made: Tensor, real: Tensor) -> dict[str, Tensor]:
        """Weighted losses of scaled displacements (2 B, 3, H, W): frames, then the ones before them."""
        wrong = (made - real).abs()
        error = wrong.sum() / (3 * len(made) * self.mask.sum())
        slopes = [
            ((made.diff(dim=axis) - real.diff(dim=axis)).abs() * valid).sum() / (3 * len(made) * valid.sum())
            for axis, valid in ((3, self.across), (2, self.down))
        ]
        now, before = (made - real).chunk(2)
        change = ((now - before).abs() * self.mask).sum() / (3 * len(now) * self.mask.sum())
        return {
            "l1": self.weights.l1 * error,
            "slope": self.weights.slope * torch.stack(slopes).sum(),
            "change": self.weights.change * change,
        }

    @torch.no_grad()
    def validate(self, net: nn.Module) -> dict[str, float]:
        """Shares of what is there at the texels of validation frames.

        unexplained: root mean square error of displacements over theirs; 1 for a network that makes none.
        slopes: error of the differences between neighbouring texels over them. strength: predicted
        differences over the true ones. popping: error of the change from frame to frame over it.
        """
        sums: dict[str, float] = {}
        rows = torch.nonzero(self.held.later).flatten()[::VALIDATED]
        for some in rows.split(8):
            inputs, wrinkles = self.maps(self.held, torch.cat([some, some - 1]))
            made, real = dealt(net(inputs) * self.texels), dealt(wrinkles)

            def slopes(maps: Tensor) -> Tensor:
                return torch.cat(
                    [(maps.diff(dim=3) * self.across).flatten(), (maps.diff(dim=2) * self.down).flatten()]
                )

            changed = [maps.chunk(2)[0] - maps.chunk(2)[1] for maps in (made, real)]
            for name, value in {
                "error": made - real,
                "real": real,
                "slope_error": slopes(made - real),
                "slope": slopes(real),
                "slope_made": slopes(made),
                "change_error": changed[0] - changed[1],
                "change": changed[1],
            }.items():
                sums[name] = sums.get(name, 0.0) + float(value.double().square().sum())

        def ratio(one: str, other: str) -> float:
            return float((sums[one] / max(sums[other], 1e-30)) ** 0.5)

        return {
            "unexplained": ratio("error", "real"),
            "slopes": ratio("slope_error", "slope"),
            "strength": ratio("slope_made", "slope"),
            "popping": ratio("change_error", "change"),
        }

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of the network."""
        save_checkpoint(wrinkles_checkpoint(Wrinkles(self.config, net), self.body, self.data, notes), run)

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run."""
        return {
            "method": asdict(self.config),
            "losses": asdict(self.weights),
            "data": asdict(self.data),
        }
