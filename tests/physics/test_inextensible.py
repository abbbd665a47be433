"""Projection onto rest edge lengths: what it must leave alone, and what it must undo."""

import torch

from uvcloth.mesh import unique_edges
from uvcloth.physics.inextensible import Inextensible


def sheet(count: int = 12) -> tuple[torch.Tensor, torch.Tensor]:
    x, y = torch.meshgrid(torch.arange(count), torch.arange(count), indexing="ij")
    corner = (x[:-1, :-1] * count + y[:-1, :-1]).reshape(-1)
    a, b, c, d = corner, corner + count, corner + count + 1, corner + 1
    vertices = torch.stack([x, y, 0 * x], dim=-1).reshape(-1, 3) * 0.02
    return vertices, torch.cat([torch.stack([a, b, c], 1), torch.stack([a, c, d], 1)])


def stretch(vertices: torch.Tensor, rest: torch.Tensor, faces: torch.Tensor) -> float:
    edges = unique_edges(faces)
    length = (vertices[..., edges[:, 0], :] - vertices[..., edges[:, 1], :]).norm(dim=-1)
    return float((length - (rest[edges[:, 0]] - rest[edges[:, 1]]).norm(dim=-1)).abs().mean())


def test_a_rigid_motion_stays_as_it_is() -> None:
    rest, faces = sheet()
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = torch.stack([rest @ turn.T + 1.0, rest - 2.0])
    projected = Inextensible(rest, faces, stiffness=50.0, passes=4).project(moved)
    torch.testing.assert_close(projected, moved, atol=2e-5, rtol=0)


def test_stretch_and_noise_are_undone_about_the_same_middle() -> None:
    rest, faces = sheet()
    noise = torch.randn(1, *rest.shape, generator=torch.Generator().manual_seed(0))
    broken = 1.2 * rest + 0.003 * noise
    projected = Inextensible(rest, faces, stiffness=300.0, passes=20).project(broken)
    assert stretch(projected, rest, faces) < 0.2 * stretch(broken, rest, faces)
    torch.testing.assert_close(projected.mean(1), broken.mean(1), atol=1e-5, rtol=0)


def test_more_passes_keep_lengths_better_and_frames_do_not_mix() -> None:
    rest, faces = sheet()
    noise = torch.randn(1, *rest.shape, generator=torch.Generator().manual_seed(0))
    frames = torch.cat([rest + 0.004 * noise, rest + 5.0 - 0.003 * noise])
    few, many = (Inextensible(rest, faces, 50.0, passes).project(frames) for passes in (1, 8))
    assert stretch(many, rest, faces) <= stretch(few, rest, faces)
    alone = Inextensible(rest, faces, 50.0, 8).project(frames[1:])
    torch.testing.assert_close(many[1:], alone, atol=1e-5, rtol=0)


def test_seam_copies_stay_together() -> None:
    rest, faces = sheet()
    doubled = torch.cat([rest, rest[:12]])
    faces = faces.clone()
    faces[:5][faces[:5] < 12] += len(rest)
    broken = 1.1 * doubled[None]
    broken[0, 0] += 0.01
    projected = Inextensible(doubled, faces, 50.0, 4).project(broken)
    torch.testing.assert_close(projected[0, :12], projected[0, len(rest) :], atol=0, rtol=0)
