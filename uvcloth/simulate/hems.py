"""Hems that hang in the air: cloth that an engine lets move as in honey stays up after a squat."""

import torch
from torch import Tensor

from uvcloth.garments.band import hems
from uvcloth.geometry.mesh import boundary_edges, weld
from uvcloth.physics.contact import ContactGarment, Obstacle

RISE = 0.1
"""Metres above the skinned hem, on average, from which on a hem has to be held up by something."""

STILL = 1.0
"""m/s among the garment, on average, under which a hem does not swing: at this speed it swings 5 cm up."""

SECONDS = 1.0
"""How long a hem may hang in the air, until it comes down: cloth falls 10 cm in 0.15 s."""

NEAR = 0.02
"""Metres from the skin within which cloth lies on it."""

BESIDE = 0.3
"""Metres at rest from a hem within which cloth that lies on the body holds it."""

FLAT = 0.5
"""Least upward part of a surface's normal on which cloth rests."""

RESTING = 0.02
"""Share of the cloth beside a hem that holds it, if it is raised and rests on the body."""

CLINGING = 0.5
"""Share of a hem that holds it, if it lies on the skin, as that of a sleeve does."""


def hanging_in_the_air(
    vertices: Tensor,
    skinned: Tensor,
    rest: Tensor,
    faces: Tensor,
    fps: float,
    obstacle: Obstacle,
    garment: ContactGarment,
    body_frames: Tensor,
) -> tuple[int, float] | None:
    """The first frame in which a hem is up that for a second in all nothing supports, and by how many metres.

    vertices, skinned: (F, N, 3) m, simulated and skinned. rest: (N, 3). faces: (M, 3).
    body_frames: (F, V, 3) m.

    A hem is up if it is RISE above the skinned one and still. The body supports it if raised cloth beside it
    rests on it, as a skirt does on the thighs in a squat, or if the hem clings to it. The second is counted
    over as long as the hem does not come down: legs that rise again do not excuse that it never fell.
    """
    for hem in hems(boundary_edges(weld(rest)[faces])):
        rise = (vertices - skinned)[..., 2]
        rising = rise[:, hem].mean(1)
        up = (rising > RISE) & (_speed(vertices, hem, fps) < STILL)
        beside = torch.cdist(rest, rest[hem]).amin(1) < BESIDE
        long = round(SECONDS * fps)
        for first, last in _runs(up):
            loose = []
            for frame in range(first, last if last - first >= long else first):
                obstacle.update(body_frames[frame])
                skin = obstacle.skin(vertices[frame], garment)
                near = skin.distance < NEAR
                resting = near & (skin.normals[:, 2] > FLAT) & (rise[frame] > RISE / 2)
                clings = near[hem].float().mean() > CLINGING
                if not clings and resting[beside].float().mean() <= RESTING:
                    loose.append(frame)
            if len(loose) >= long:
                return loose[0], float(rising[loose].mean())
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
