"""What the solver makes of cloth that touches itself at rest, of a body too fast and of broken numbers."""

import math

import numpy as np
import pytest
import torch
import trimesh

from tests.physics.cloth.stepping import crossing, frames, solver, still_frames
from tests.simulation.physics.scenes import sheet
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import edge_lengths, unique_edges
from uvcloth.physics.cloth.solver import start


def test_a_folded_sheet_whose_halves_lie_half_a_millimetre_apart_parts() -> None:
    """In free fall, so that nothing else parts them, and without a crossing."""
    flat, faces = sheet(0.4, 0.15, 41, 16)
    gap, radius = 0.0005, 0.0005 / 2
    half = 0.5 * (0.4 - math.pi * radius)
    angle = ((flat[:, 0] - half) / radius).clamp(0.0, math.pi)
    beyond = (flat[:, 0] - half - math.pi * radius).clamp(min=0.0)
    x = flat[:, 0].clamp(max=half) + radius * angle.sin() - beyond
    rest = torch.stack([x, flat[:, 1], radius * (1.0 - angle.cos())], 1)
    made = solver(rest, faces)
    states = still_frames(made, start(made, rest.numpy()), rest, 0.3)
    assert crossing(states, faces).max() == 0.0
    edges = unique_edges(faces)
    points = torch.stack([torch.from_numpy(s.vertices()).float() for s in states])
    assert float((edge_lengths(points, edges) / edge_lengths(rest, edges)).max()) < 1.5
    lower = (flat[:, 0] > 0.03) & (flat[:, 0] < 0.15)
    upper = (flat[:, 0] < 0.37) & (flat[:, 0] > 0.25)
    apart = points[-1, upper, 2].mean() - points[-1, lower, 2].mean()
    assert gap < 0.002 < float(apart)


def test_a_target_that_is_no_number_leaves_cloth_that_is_none() -> None:
    """Whoever steps looks for it, as `step` says: it may not come out as cloth that seems right."""
    rest, faces = sheet(0.3, 0.3, 31, 31)
    held = rest[:, 0] < 1e-6
    made = solver(rest, faces, held=held)
    targets = np.repeat(rest.numpy()[None], 3, 0)
    targets[1:, 0] = np.nan
    for state in frames(made, start(made, rest.numpy()), targets, np.zeros((3, 0, 3)), 30.0, held):
        assert not np.isfinite(state.vertices()).any()


@pytest.mark.parametrize(("speed", "words"), [(50.0, "moves at 50 m/s"), (np.nan, "is not a finite number")])
def test_a_body_that_is_too_fast_or_nowhere_is_refused(speed: float, words: str) -> None:
    rest, faces = sheet(0.4, 0.4, 21, 21)
    ball = trimesh.creation.icosphere(3, radius=0.08)
    made = solver(rest, faces, things=[ball])
    rise = speed / 30.0 * np.arange(2.0)
    centres = np.stack([0.0 * rise + 0.2, 0.0 * rise + 0.2, rise - 0.25], 1)
    bodies = ball.vertices + centres[:, None]
    targets = np.repeat(rest.numpy()[None], 2, 0)
    with pytest.raises(InputError, match=words):
        list(frames(made, start(made, rest.numpy()), targets, bodies, 30.0))
