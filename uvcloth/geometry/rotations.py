"""Rotation matrices applied to vectors."""

from torch import Tensor


def rotate(frames: Tensor, vectors: Tensor) -> Tensor:
    """Local vectors to world: frames (..., 3, 3), vectors (..., 3)."""
    return (frames * vectors.unsqueeze(-2)).sum(-1)


def rotate_back(frames: Tensor, vectors: Tensor) -> Tensor:
    """World vectors to local: frames (..., 3, 3), vectors (..., 3)."""
    return (frames * vectors.unsqueeze(-1)).sum(-2)
