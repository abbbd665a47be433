"""The training frames of PhysXNet as maps in memory: posing and baking happen once, not in every step."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from rich.progress import track
from torch import Tensor

from rasterize.bake import scatter_map
from train.clips import TrainingClip
from train.physxnet.prepare import Prepared, SharedTexels
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import HISTORY, body_frames, with_lead
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.maps import motion_values, pose_values, template_offsets

BAKED_AT_ONCE = 16
"""Frames that are posed at once."""


@dataclass(frozen=True)
class Frames:
    """R rows: the scored frames of every clip, each clip led in by HISTORY - 1 more, body after body.

    motion: (R, 6, H, W) and pose: (R, 3, H, W) float16 maps; of what the network does not see, motion has no
    channels, and pose is empty.
    offsets: per template (R, U, 3) float16, m, of its shared texels, zero in those that a body does not see.
    present: (R, templates) bool. transforms: (R, J, 3, 4). bodies: (R,) int64 which body. samples: (S,) int64
    rows that count. starts: (R,) int64 first row of the row's clip.
    """

    motion: Tensor
    pose: Tensor
    offsets: tuple[Tensor, ...]
    present: Tensor
    transforms: Tensor
    bodies: Tensor
    samples: Tensor
    starts: Tensor

    def inputs(self, rows: Tensor) -> Tensor:
        """The network's motion channels, oldest frame first: (B, C, H, W)."""
        before = torch.arange(HISTORY - 1, -1, -1, device=rows.device)
        motion = self.motion[rows[:, None] - before].flatten(1, 2)
        return (torch.cat([motion, self.pose[rows]], dim=1) if len(self.pose) else motion).float()


def load_frames(
    config: PhysXNetConfig,
    worn: Sequence[tuple[Body, list[TrainingClip]]],
    prepared: Sequence[Prepared],
    shared: Sequence[SharedTexels],
    title: str,
) -> Frames:
    """Pose each body over its clips and take its texels' values.

    prepared: for each body. shared: of each template.
    """
    motion, pose, present, transforms, bodies, samples, starts = [], [], [], [], [], [], []
    offsets: list[list[Tensor]] = [[] for _ in config.templates]
    row = 0
    clips = [(which, clip) for which, (_, own) in enumerate(worn) for clip in own]
    for which, clip in track(clips, title, transient=True):
        body, seen = worn[which][0], prepared[which]
        first = max(0, clip.warm_up - (HISTORY - 1))
        led = with_lead(clip.transforms)
        lead = len(led) - len(clip.transforms)
        for begin in range(first, len(clip.transforms), BAKED_AT_ONCE):
            end = min(begin + BAKED_AT_ONCE, len(clip.transforms))
            frames = body_frames(body, led[begin : end + lead], clip.fps)
            now = frames.transforms[:, -1]
            vertices = frames.vertices[:, -1]
            values = motion_values(
                config, seen.texels, frames.velocity[:, -1], frames.acceleration[:, -1], now
            )
            motion.append(sheet_of(values, seen))
            if config.pose:
                pose.append(sheet_of(pose_values(seen.texels, vertices, now), seen))
            for part, name, texels in zip(offsets, config.templates, shared, strict=True):
                values = torch.zeros(len(now), len(texels.pixels), 3, dtype=torch.float16)
                if name in clip.vertices:
                    simulated = clip.vertices[name][begin:end]
                    values[:, texels.slots[which]] = _offsets(config, seen, name, simulated, vertices, now)
                part.append(values)
        count = len(clip.transforms) - first
        has = torch.tensor([name in clip.vertices for name in config.templates])
        present.append(has.expand(count, -1))
        transforms.append(clip.transforms[first:])
        bodies.append(torch.full((count,), which))
        skip = max(HISTORY - 1, clip.warm_up - first)
        samples.append(torch.arange(row + skip, row + count))
        starts.append(torch.full((count,), row))
        row += count
    return Frames(
        motion=torch.cat(motion),
        pose=torch.cat(pose) if pose else torch.zeros(0),
        offsets=tuple(torch.cat(part) for part in offsets),
        present=torch.cat(present),
        transforms=torch.cat(transforms),
        bodies=torch.cat(bodies),
        samples=torch.cat(samples),
        starts=torch.cat(starts),
    )


def _offsets(
    config: PhysXNetConfig,
    prepared: Prepared,
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


def sheet_of(values: Tensor, prepared: Prepared) -> Tensor:
    """Texel values (T, C, P) as float16 maps (T, C, H, W)."""
    return scatter_map(values.half().transpose(1, 2), prepared.texels.sheet)
