"""Residual maps push a garment out of the body, smoothly."""

from dataclasses import replace

import torch

from tests.physics.test_obstacle import dressed, ellipsoid, grid, obstacle
from tests.train.simulated import swaying
from uvcloth.bodies.body import load_body
from uvcloth.bodies.collider import make_collider
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import laplacian
from uvcloth.methods.motion_guided.config import PRESETS
from uvcloth.methods.motion_guided.method import MotionGuided
from uvcloth.methods.motion_guided.residual import Resolver
from uvcloth.physics.obstacle import Obstacle
from uvcloth.rollouts.rollout import rollout


def test_a_sheet_leaves_a_sphere_and_the_next_frame_begins_there() -> None:
    x, y = torch.meshgrid(*[torch.linspace(-0.2, 0.2, 31)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((31 * 31,), 0.29)], dim=1)
    faces = grid(31, 31)
    sphere = ellipsoid(0.3, 0.3, 0.3)
    ball, surface = obstacle(sphere), torch.from_numpy(sphere.vertices).float()
    resolver = Resolver(ball, dressed(sheet), laplacian(faces, len(sheet)))
    turns, nothing = torch.eye(3).expand(len(sheet), 3, 3), torch.zeros(1, len(sheet), 3)
    before = (0.3 - sheet.norm(dim=1)).clamp(min=0).mean()
    moved, residual = resolver.resolve(sheet, turns, lambda maps: maps, nothing, surface)
    after = (0.3 - moved.norm(dim=1)).clamp(min=0).mean()
    assert before > 1e-4
    assert after < 0.05 * before
    torch.testing.assert_close(moved, sheet + residual)
    again, _ = resolver.resolve(sheet, turns, lambda maps: maps, residual[None], surface)
    assert (0.3 - again.norm(dim=1)).clamp(min=0).mean() <= after + 1e-6


def test_a_rollout_with_residual_maps_has_less_inside() -> None:
    torch.manual_seed(2)
    body = load_body()
    outfit, motion = Outfit(body, (fit_template("dress", body),)), swaying(3, seed=3).transforms()
    plain = MotionGuided.untrained(replace(PRESETS["tiny"], linear=False))
    resolving = replace(plain, config=replace(plain.config, residual=True))
    measured = Obstacle(make_collider(body), body.mesh.vertices)
    dress = measured.contact_garment(outfit.garments[0].mesh.vertices)
    inside = [
        sum(
            float(measured.inside_percent(frame.raw[0][None], dress, frame.body_vertices[None]))
            for frame in rollout(method, outfit, motion, 30.0, clear=False)
        )
        for method in (plain, resolving)
    ]
    assert inside[1] < 0.5 * inside[0]
