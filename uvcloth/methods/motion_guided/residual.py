"""Collisions resolved by a residual displacement map, optimized frame by frame (Motion-guided, 5.1)."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.physics.obstacle import ContactGarment, Obstacle

ITERATIONS = 50
"""Optimizer steps in a frame, at most."""

LEARNING_RATE = 1e-3
"""Adam's learning rate, metres."""

TARGET_DEPTH = 5e-6
"""Metres of mean depth at which the optimization stops."""

DEPTH_WEIGHT = 100.0
"""Weight of the mean depth (lambda_3)."""

SEARCH_EVERY = 10
"""Steps after which the closest skin is searched again."""


@dataclass(frozen=True)
class Resolver:
    """A garment among the closed parts of the body. laplacian: (N, N) sparse, of its vertices."""

    obstacle: Obstacle
    garment: ContactGarment
    laplacian: Tensor

    def resolve(
        self,
        vertices: Tensor,
        turns: Tensor,
        sample: Callable[[Tensor], Tensor],
        residual: Tensor,
        body_vertices: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Move a garment (N, 3) m out of the body (V, 3); returns it and the residual map (H W, 3) after it.

        turns: (N, 3, 3), how displacements in the local frames at rest move the posed vertices. sample: reads
        maps (1, H W, 3) at the vertices. residual: (1, H W, 3) m, of the frame before.
        """
        self.obstacle.update(body_vertices)
        with torch.enable_grad():
            residual = residual.clone().requires_grad_()
            optimizer = torch.optim.Adam([residual], lr=LEARNING_RATE)
            for step in range(ITERATIONS):
                move = (turns @ sample(residual)[0][..., None]).squeeze(-1)
                if step % SEARCH_EVERY == 0:
                    skin = self.obstacle.skin((vertices + move).detach(), self.garment)
                depth = (skin.offsets - ((vertices + move) * skin.normals).sum(1)).clamp(min=0.0)
                mean_depth = torch.where(skin.squeezed, 0.0, depth).mean()
                if mean_depth < TARGET_DEPTH:
                    break
                loss = move.abs().mean() + (self.laplacian @ move).abs().mean() + DEPTH_WEIGHT * mean_depth
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
            move = (turns @ sample(residual)[0][..., None]).squeeze(-1)
        return (vertices + move).detach(), residual.detach()[0]
