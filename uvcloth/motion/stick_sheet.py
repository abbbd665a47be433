"""Stick figures of a motion, front and left side: the file's joints in grey, the body's over them."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import MotionSource
from uvcloth.motion.retarget import in_body_axes, leg_length, resample
from uvcloth.rendering.render import contact_sheet, draw_line

COLUMNS = 8
"""Frames on a sheet, spread evenly over the motion."""

WIDTH, HEIGHT = 220, 320
"""Pixels of a figure."""

REACH = 1.25
"""Metres from the middle of the hips to the upper and lower edge."""

GREY, MIDDLE, LEFT, RIGHT = (190, 190, 190), (40, 40, 40), (30, 90, 200), (205, 60, 40)


def stick_sheet(source: MotionSource, clip: Clip) -> np.ndarray:
    """Draw a motion and the clip retargeted from it: above from the front, below from the left.

    The body's left is blue, its right red; front is where its hips point to. Returns (h, w, 3) uint8.
    """
    roles = clip.skeleton.roles
    recorded = in_body_axes(resample(source.rest.clip, clip.fps), source.roles)
    scale = leg_length(clip.skeleton.heads, roles) / leg_length(recorded.skeleton.heads, source.roles)
    frames = torch.linspace(0, len(clip) - 1, min(COLUMNS, len(clip))).round().long()
    body = _facing(clip.positions()[frames], clip.positions()[frames], roles, roles)
    grey = _facing(scale * recorded.positions()[frames], clip.positions()[frames], source.roles, roles)
    pictures = []
    for axis in (0, 1):
        for joints, others in zip(body, grey, strict=True):
            picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
            _draw(picture, others[:, [axis, 2]], source.clip.skeleton, {})
            _draw(picture, joints[:, [axis, 2]], clip.skeleton, roles)
            pictures.append(picture)
    return contact_sheet(pictures, columns=len(frames))


def _facing(positions: Tensor, body: Tensor, roles: Mapping[str, int], on_body: Mapping[str, int]) -> Tensor:
    """Joints (K, J, 3) about the middle of the hips, turned so that the body's hips face -Y."""
    thighs = [roles["left_thigh"], roles["right_thigh"]]
    left = body[:, on_body["left_thigh"]] - body[:, on_body["right_thigh"]]
    left = torch.nn.functional.normalize(left * torch.tensor([1.0, 1.0, 0.0]), dim=-1)
    back = torch.stack([-left[:, 1], left[:, 0], torch.zeros(len(left))], dim=-1)
    up = torch.tensor([0.0, 0.0, 1.0]).expand_as(left)
    axes = torch.stack([left, back, up], dim=1)
    return (positions - positions[:, thighs].mean(1, keepdim=True)) @ axes.mT


def _draw(picture: np.ndarray, points: Tensor, skeleton: Skeleton, roles: Mapping[str, int]) -> None:
    """Draw the bones between points (J, 2), metres, in grey where no roles are given."""
    pixel = HEIGHT / (2 * REACH)
    across = (WIDTH / 2 + pixel * points[:, 0]).round().long().tolist()
    down = (HEIGHT / 2 - pixel * points[:, 1]).round().long().tolist()
    side_of = {joint: role.partition("_")[0] for role, joint in roles.items()}
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            color = {"left": LEFT, "right": RIGHT}.get(side_of.get(joint, ""), MIDDLE) if roles else GREY
            draw_line(picture, (down[parent], across[parent]), (down[joint], across[joint]), color)
