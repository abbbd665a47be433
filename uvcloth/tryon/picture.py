"""Pictures over a photograph: garments that its person wears, and the body that was fitted to it."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.mesh import Mesh
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, draw_line, render_over
from uvcloth.rollouts.rollout import RolloutFrame
from uvcloth.tryon.fit import FittedPerson
from uvcloth.tryon.keypoints import Keypoints

MEASURED, FITTED = (220, 30, 30), (30, 200, 60)
"""Colours of keypoints of the photograph, and of the fitted body."""


def dressed_picture(
    photograph: np.ndarray, person: FittedPerson, body: Body, meshes: Sequence[Mesh], frame: RolloutFrame
) -> np.ndarray:
    """Draw garments over a photograph (H, W, 3) uint8, except where the person is in front of them.

    meshes: of the garments of the frame, whose last pose is that of the person.
    """
    garments = [
        Surface(vertices, mesh.faces, GARMENT_COLORS[index % len(GARMENT_COLORS)])
        for index, (vertices, mesh) in enumerate(zip(frame.vertices, meshes, strict=True))
    ]
    skin = Surface(posed_skin(body, frame.transforms[None])[0], body.mesh.faces, BODY_COLOR)
    return render_over(photograph, garments, [skin], person.camera)


def fitted_picture(
    photograph: np.ndarray, person: FittedPerson, body: Body, keypoints: Keypoints
) -> np.ndarray:
    """Draw the fitted body over a photograph, its keypoints as crosses, and those of the photograph."""
    skin = posed_skin(body, person.clip.transforms())[0]
    drawn = render_over(photograph, [Surface(skin, body.mesh.faces, BODY_COLOR)], [], person.camera)
    arm = max(3, round(max(photograph.shape) / 120))
    for points, color in ((keypoints.points, MEASURED), (person.joints, FITTED)):
        _draw_crosses(drawn, points, arm, color)
    return drawn


def _draw_crosses(picture: np.ndarray, points: Tensor, arm: int, color: tuple[int, int, int]) -> None:
    """Draw a cross of the arm's length in pixels at each of the points (K, 2), x and y."""
    for x, y in torch.nan_to_num(points).round().int().tolist():
        draw_line(picture, (y - arm, x - arm), (y + arm, x + arm), color)
        draw_line(picture, (y - arm, x + arm), (y + arm, x - arm), color)
