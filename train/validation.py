"""Validation by rollout: errors of predictions over whole clips, side by side, before the finish."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.records import to_device
from uvcloth.methods.method import Method
from uvcloth.rollouts.rollout import roll_out_together

ROLLOUT_FRAMES = 150
"""Scored frames of a clip that are rolled out, at most."""


@torch.no_grad()
def rollout_distances(
    method: Method,
    prepared: Any,
    body: Body,
    garments: Sequence[str],
    clips: Sequence[SimulatedClip],
    device: torch.device,
    under: str = "",
) -> dict[str, list[Tensor]]:
    """Mean vertex distance, mm, of each garment in every scored frame of validation clips.

    The rollout is that of evaluation, from the first warm-up frame on, of clips of one frame rate together,
    until the shortest of these ends. prepared: by the method for the garments, on the device. clips: on the
    body. under: the garment worn beneath, as simulated, for a method that needs it.
    """
    outfit = Outfit(to_device(body, device), ())
    errors: dict[str, list[Tensor]] = {name: [] for name in garments}
    for fps in sorted({clip.fps for clip in clips}):
        together = [clip for clip in clips if clip.fps == fps]
        motions = [clip.transforms[: clip.warm_up + ROLLOUT_FRAMES].to(device) for clip in together]
        beneath = [clip.by_name[under].vertices.to(device) for clip in together] if under else []
        frames = roll_out_together(method, prepared, outfit, motions, fps, beneath)
        for index, predicted in enumerate(frames):
            for name, vertices in zip(garments, predicted, strict=True):
                for clip, points in zip(together, vertices, strict=True):
                    if name in clip.by_name and index >= clip.warm_up:
                        truth = clip.by_name[name].vertices[index].to(points)
                        errors[name].append(1000.0 * (points - truth).norm(dim=1).mean())
    return errors


def mean_errors(distances: Mapping[str, Sequence[Tensor]]) -> dict[str, float]:
    """Means over the frames of each garment, mm, and their mean first."""
    means = {f"{name}_mm": float(torch.stack([*each]).mean()) for name, each in distances.items() if each}
    return {"mean_mm": sum(means.values()) / len(means), **means}
