"""Garments over a photograph: hidden by what is in front of them, the photograph elsewhere unchanged."""

import numpy as np
import torch

from uvcloth.rendering.lighting import COARSE
from uvcloth.rendering.render import Camera, Surface, render_over

AHEAD = Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 90.0)


def sheet(depth: float, left: float, right: float) -> Surface:
    """A blue rectangle across the view at a depth, m, between two places across."""
    corners = torch.tensor(
        [[left, depth, -0.5], [right, depth, -0.5], [right, depth, 0.5], [left, depth, 0.5]]
    )
    return Surface(corners, torch.tensor([[0, 1, 2], [0, 2, 3]]), (0.1, 0.2, 0.9))


def test_what_is_in_front_hides_the_garment() -> None:
    """The arm's half of the sheet shows the photograph, and so does all around it."""
    photograph = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    picture = render_over(photograph, [sheet(1.0, -0.5, 0.5)], [sheet(0.9, 0.0, 0.8)], AHEAD, COARSE)
    changed = (picture != photograph).any(2)
    assert changed[11:29, 21:29].all()
    assert not changed[:, 32:].any()
    assert not changed[:, :19].any()
    assert not changed[:9].any()
    assert not changed[31:].any()
    blue = picture[15:25, 22:28].reshape(-1, 3).mean(0)
    assert blue[2] > 2 * blue[0]


def test_a_garment_out_of_view_leaves_the_photograph() -> None:
    photograph = np.full((20, 30, 3), 77, np.uint8)
    picture = render_over(photograph, [sheet(1.0, 5.0, 6.0)], [], AHEAD, COARSE)
    assert np.array_equal(picture, photograph)
