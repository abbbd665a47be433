"""Visibility of points on a dressed body to a person who walks around it."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.physics.shell import Shell

RISES = (-10.0, 10.0, 40.0, 75.0)
"""Degrees above the horizon from which a person looks."""

TURNS = 12
"""Directions around the body."""

START = 0.001
"""Metres in front of a point from where its rays start."""

FAR_ENOUGH = 3.0
"""Metres that rays are followed."""

ROUNDS = 8
"""Parts of the directions that are looked from in turn: most points are seen from one of the first."""

FEW = 8
"""Points that are looked at from all directions at once: a turn takes as long as some hundred rays."""


class VisibilityTest:
    """A person who walks around a body and its garments, the shells that hide points."""

    def __init__(self, shells: Sequence[Shell]) -> None:
        self._shells = shells
        turns = torch.arange(TURNS) * (2.0 * math.pi / TURNS)
        rises = torch.tensor(RISES).deg2rad()[:, None]
        level = torch.stack([turns.cos(), turns.sin()], 1)
        flat = (rises.cos()[:, None] * level).reshape(-1, 2)
        up = rises.sin().expand(-1, TURNS).reshape(-1, 1)
        self._directions = torch.cat([flat, up], 1)

    def update(self, meshes: Sequence[Tensor]) -> None:
        """Move the shells to new vertex positions, (V, 3) m of each."""
        for shell, vertices in zip(self._shells, meshes, strict=True):
            shell.update(vertices)

    def sees_any(self, points: Tensor) -> bool:
        """True if one of the points (P, 3) m is seen from any side."""
        return any(bool(self._sees_along(points, turn).any()) for turn in self._turns(points))

    def sees(self, points: Tensor) -> Tensor:
        """Mask (P,) of the points (P, 3) m that are seen from any side."""
        visible = torch.zeros_like(points[:, 0], dtype=torch.bool)
        for directions in self._turns(points):
            hidden = torch.nonzero(~visible).squeeze(1)
            if not len(hidden):
                break
            visible[hidden] = self._sees_along(points[hidden], directions)
        return visible

    def _turns(self, points: Tensor) -> list[Tensor]:
        """Directions (D, 3) that points (P, 3) m are looked at from, turn after turn."""
        rounds = ROUNDS if len(points) > FEW else 1
        return [self._directions[turn::rounds].to(points) for turn in range(rounds)]

    def _sees_along(self, points: Tensor, directions: Tensor) -> Tensor:
        """Mask (P,) of the points (P, 3) m that are seen from any of some directions (D, 3)."""
        owner = torch.arange(len(points), device=points.device).repeat(len(directions))
        ways = directions.repeat_interleave(len(points), dim=0)
        starts = points[owner] + START * ways
        for shell in self._shells:
            distance, _ = shell.first_hit(starts, ways, FAR_ENOUGH)
            owner, starts, ways = (rays[distance >= FAR_ENOUGH] for rays in (owner, starts, ways))
        visible = torch.zeros_like(points[:, 0], dtype=torch.bool)
        visible[owner] = True
        return visible
