"""The training frames of PhysXNet as maps in memory: posing and baking happen once, not in every step."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from rich.progress import track
from torch import Tensor

from rasterize.bake import scatter_map
from uvcloth.bodies.frames import HISTORY, body_frames, with_lead
from uvcloth.dataset.reader import BodyClips
from uvcloth.dataset.rows import Rows, joined_rows, led_in
from uvcloth.geometry.records import to_device
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.maps import motion_values, pose_values, template_offsets

from .prepare import Correspondences, SharedTexels

BAKED_AT_ONCE = 16
"""Frames that are posed at once."""


@dataclass(frozen=True)
class Frames:
    """The frames of every clip, body after body, each clip led in by HISTORY - 1 frames of its warm-up.

    rows: R of them. motion: (R, 6, H, W) and pose: (R, 3, H, W) float16 maps; of what the network does not
    see, motion has no channels, and pose is empty.
    offsets: per template (R, U, 3) float16, m, of its shared texels, zero in those that a body does not see.
    present: (R, templates) bool. bodies: (R,) int64 which body.
    """

    rows: Rows
    motion: Tensor
    pose: Tensor
    offsets: tuple[Tensor, ...]
    present: Tensor
    bodies: Tensor

    def inputs(self, rows: Tensor) -> Tensor:
        """The network's motion channels, oldest frame first: (B, C, H, W)."""
        before = torch.arange(HISTORY - 1, -1, -1, device=rows.device)
        motion = self.motion[rows[:, None] - before].flatten(1, 2)
        return (torch.cat([motion, self.pose[rows]], dim=1) if len(self.pose) else motion).float()


def load_frames(
    config: PhysXNetConfig,
    worn: Sequence[BodyClips],
    prepared: Sequence[Correspondences],
    shared: Sequence[SharedTexels],
    title: str,
) -> Frames:
    """Pose each body over its clips and take its texels' values, on the device of the bodies.

    prepared: for each body. shared: of each template. Both are on that device; the clips need not be.
    """
    device = shared[0].pixels.device
    motion, pose, present, bodies = [], [], [], []
    offsets: list[list[Tensor]] = [[] for _ in config.templates]
    owners = [which for which, (_, clips) in enumerate(worn) for _ in clips]
    clips = [clip for _, clips in worn for clip in clips]
    cut = zip(owners, led_in(clips, HISTORY - 1), strict=True)
    for which, (clip, first) in track(cut, title, len(clips), transient=True):
        body, ready = worn[which][0], prepared[which]
        led = with_lead(clip.transforms.to(device))
        lead = len(led) - len(clip.transforms)
        for begin in range(first, len(clip.transforms), BAKED_AT_ONCE):
            end = min(begin + BAKED_AT_ONCE, len(clip.transforms))
            frames = body_frames(body, led[begin : end + lead], clip.fps)
            now = frames.transforms[:, -1]
            vertices = frames.vertices[:, -1]
            values = motion_values(
                config, ready.texels, frames.velocity[:, -1], frames.acceleration[:, -1], now
            )
            motion.append(sheet_of(values, ready))
            if config.pose:
                pose.append(sheet_of(pose_values(ready.texels, vertices, now), ready))
            for part, name, texels in zip(offsets, config.templates, shared, strict=True):
                values = now.new_zeros(len(now), len(texels.pixels), 3, dtype=torch.float16)
                if name in clip.by_name:
                    simulated = clip.by_name[name].vertices[begin:end].to(device)
                    values[:, texels.slots[which]] = _offsets(config, ready, name, simulated, vertices, now)
                part.append(values)
        count = len(clip.transforms) - first
        has = torch.tensor([name in clip.by_name for name in config.templates])
        present.append(has.expand(count, -1))
        bodies.append(torch.full((count,), which))
    return Frames(
        rows=to_device(joined_rows(clips, HISTORY - 1), device),
        motion=torch.cat(motion),
        pose=torch.cat(pose) if pose else torch.zeros(0),
        offsets=tuple(torch.cat(part) for part in offsets),
        present=torch.cat(present).to(device),
        bodies=torch.cat(bodies).to(device),
    )


def _offsets(
    config: PhysXNetConfig,
    prepared: Correspondences,
    name: str,
    simulated: Tensor,
    body_vertices: Tensor,
    transforms: Tensor,
) -> Tensor:
    """Values (T, Q, 3) of a template's offset map, m, float16."""
    return template_offsets(
        config,
        prepared.texels,
        prepared.templates[name],
        prepared.decoders[name],
        vertices=simulated,
        body_vertices=body_vertices,
        transforms=transforms,
    ).half()


def sheet_of(values: Tensor, prepared: Correspondences) -> Tensor:
    """Texel values (T, C, P) as float16 maps (T, C, H, W)."""
    return scatter_map(values.half().transpose(1, 2), prepared.texels.sheet)
