"""Unsupported hems: overdamped cloth stays raised after a squat."""

from collections.abc import Callable

import torch
from torch import Tensor

from uvcloth.garments.places import hems
from uvcloth.geometry.mesh import boundary_edges, weld
from uvcloth.physics.obstacle import Skin

LEAST_RISE = 0.1
"""Mean height over the skinned hem, m, from which a hem needs support."""

STILL_SPEED = 1.0
"""Mean speed relative to the garment, m/s, below which a hem counts as still: at it, a hem swings 5 cm up."""

HANGING_SECONDS = 1.0
"""Seconds that a hem may be unsupported: cloth falls 10 cm in 0.15 s."""

LYING_DISTANCE = 0.02
"""Metres from the skin within which cloth lies on it."""

HEM_NEIGHBOURHOOD = 0.3
"""Metres at rest from a hem within which cloth that lies on the body supports it."""

SUPPORT_COSINE = 0.5
"""Least upward part of a surface's normal on which cloth rests."""

RESTING_SHARE = 0.02
"""Share of the cloth beside a hem that supports it, if it is raised and rests on the body."""

CLINGING_SHARE = 0.5
"""Share of a hem that supports it, if it lies on the skin, as that of a sleeve does."""


def unsupported_hem(
    vertices: Tensor, skinned: Tensor, rest: Tensor, faces: Tensor, fps: float, skin_at: Callable[[int], Skin]
) -> tuple[int, float] | None:
    """First frame in which a hem is up without support, for a second in all, and its mean rise, m, or None.

    vertices, skinned: (F, N, 3) m, simulated and skinned. rest: (N, 3) m. faces: (M, 3). skin_at: the skin
    nearest to the garment's vertices in a frame.

    A hem is up if it is LEAST_RISE above the skinned one and still. The body supports it if raised cloth
    beside it rests on it, as a skirt does on the thighs in a squat, or if the hem clings to it. The second is
    the sum until the hem comes down: support in between, as of legs that rise again, does not reset it.
    """
    for hem in hems(boundary_edges(weld(rest)[faces])):
        rise = (vertices - skinned)[..., 2]
        rising = rise[:, hem].mean(1)
        up = (rising > LEAST_RISE) & (_speed(vertices, hem, fps) < STILL_SPEED)
        beside = torch.cdist(rest, rest[hem]).amin(1) < HEM_NEIGHBOURHOOD
        long = round(HANGING_SECONDS * fps)
        for first, last in _runs(up):
            unsupported = []
            for frame in range(first, last if last - first >= long else first):
                skin = skin_at(frame)
                near = skin.distance < LYING_DISTANCE
                resting = near & (skin.normals[:, 2] > SUPPORT_COSINE) & (rise[frame] > LEAST_RISE / 2)
                clings = near[hem].float().mean() > CLINGING_SHARE
                if not clings and resting[beside].float().mean() <= RESTING_SHARE:
                    unsupported.append(frame)
            if len(unsupported) >= long:
                return unsupported[0], float(rising[unsupported].mean())
    return None


def _speed(vertices: Tensor, hem: Tensor, fps: float) -> Tensor:
    """Mean speed of a hem's vertices relative to the garment as a whole: (F,) m/s."""
    moves = vertices.diff(dim=0, prepend=vertices[:1])
    return fps * (moves[:, hem] - moves.mean(1, keepdim=True)).norm(dim=-1).mean(1)


def _runs(holds: Tensor) -> list[tuple[int, int]]:
    """First frame and end of every run of frames (F,) that hold."""
    padded = torch.nn.functional.pad(holds.int(), (1, 1)).diff()
    starts, ends = (torch.nonzero(padded == step).flatten().tolist() for step in (1, -1))
    return list(zip(starts, ends, strict=True))
