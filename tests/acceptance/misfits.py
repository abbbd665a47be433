"""Meshes that are no garment for the body, or are worn by nobody, with the words of their refusal.

Each is made at its place in metres, Z up. Those of WORN are garments, some in odd frames.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import torch
import trimesh
from torch import Tensor

from tests.acceptance.families import made_up
from uvcloth.bodies.body import REGIONS, Body
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh, join_meshes, vertex_normals

NO_UVS = torch.zeros(0, 2)

Maker = Callable[[Body], Mesh]


def plain(vertices: Tensor, faces: Tensor) -> Mesh:
    return Mesh(vertices.float(), faces.long(), NO_UVS, torch.zeros(0, 3, dtype=torch.int64))


def solid(mesh: trimesh.Trimesh) -> Mesh:
    return plain(torch.tensor(mesh.vertices), torch.tensor(mesh.faces.copy()))


def joined(*meshes: Mesh) -> Mesh:
    both = join_meshes((mesh.vertices, mesh.faces) for mesh in meshes)
    return plain(both.vertices, both.faces)


def stretched(mesh: Mesh, *factors: float) -> Mesh:
    """A mesh stretched about its middle; -1 turns an axis around."""
    middle = (mesh.vertices.amin(0) + mesh.vertices.amax(0)) / 2
    return replace(mesh, vertices=(mesh.vertices - middle) * torch.tensor(factors) + middle)


def shifted(mesh: Mesh, *shift: float) -> Mesh:
    return replace(mesh, vertices=mesh.vertices + torch.tensor(shift))


def lathed(radii: np.ndarray, heights: np.ndarray, middle: Tensor) -> Mesh:
    """A surface of revolution around a vertical axis, 40 corners around."""
    angles = np.arange(40) * (np.pi / 20)
    rings = [
        np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(40, height)], 1)
        for radius, height in zip(radii, heights, strict=True)
    ]
    here = np.arange(40)[None] + 40 * np.arange(len(radii) - 1)[:, None]
    aside = (np.arange(40)[None] + 1) % 40 + 40 * np.arange(len(radii) - 1)[:, None]
    faces = np.concatenate(
        [np.stack([here, aside, aside + 40], -1), np.stack([here, aside + 40, here + 40], -1)]
    )
    return plain(torch.tensor(np.concatenate(rings)) + middle, torch.tensor(faces.reshape(-1, 3)))


def sheet(first: float, second: float, upright: bool) -> Mesh:
    """A square grid, upright or level, around the origin."""
    steps = torch.linspace(-0.5, 0.5, 30)
    across, along = torch.cartesian_prod(steps, steps).unbind(1)
    flat = torch.zeros_like(across)
    rest = (flat, second * along) if upright else (second * along, flat)
    number = torch.arange(900).reshape(30, 30)
    corner, right, up, far = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
    faces = torch.cat([torch.stack([corner, right, far], -1), torch.stack([corner, far, up], -1)])
    return plain(torch.stack([first * across, *rest], 1), faces.reshape(-1, 3))


def skin(body: Body, *regions: str) -> Mesh:
    """The body's own skin of some regions, 4 mm off it."""
    normals = vertex_normals(body.mesh.vertices, body.mesh.faces)
    wanted = torch.isin(body.regions, torch.tensor([REGIONS.index(region) for region in regions]))
    used, faces = body.mesh.faces[wanted].unique(return_inverse=True)
    return plain((body.mesh.vertices + 0.004 * normals)[used], faces)


def hat(body: Body, radius: float) -> Mesh:
    head = body.mesh.vertices[body.mesh.faces[body.regions == REGIONS.index("head")]].reshape(-1, 3)
    turn = np.linspace(0.02, np.pi / 2, 12)
    radii, heights = np.append(radius * np.sin(turn), 1.5 * radius), np.append(radius * np.cos(turn), 0.0)
    return lathed(radii, heights, head.mean(0) + torch.tensor([0.0, 0.0, 0.05]))


def cup() -> Mesh:
    """A round pot around the hips, with a bottom that the thighs go through."""
    share = np.linspace(0.01, 1.0, 10)
    radii = 0.2 * np.concatenate([share, np.ones(10)])
    return lathed(radii, 0.5 * np.concatenate([np.zeros(10), share]), torch.tensor([0.0, 0.0, -0.25]))


def chair() -> Mesh:
    seat, back = sheet(0.45, 0.45, upright=False), sheet(0.45, 0.5, upright=True)
    return joined(shifted(seat, 0.0, 0.0, 0.45), shifted(back, 0.0, 0.225, 0.7))


def box(*size: float) -> Mesh:
    return solid(trimesh.creation.box(size).subdivide().subdivide().subdivide())


def rags(body: Body) -> Mesh:
    """A T-shirt whose vertices lie anywhere near."""
    mesh = fit_template("tops", body).mesh
    noise = torch.randn(mesh.vertices.shape, generator=torch.Generator().manual_seed(0))
    return replace(mesh, vertices=0.2 * mesh.vertices + 0.05 * noise)


def template(name: str, change: Callable[[Mesh], Mesh] = lambda mesh: mesh) -> Maker:
    return lambda body: change(fit_template(name, body).mesh)


REFUSED: Mapping[str, tuple[Maker, str]] = {
    "chair": (lambda _: chair(), "does not lie on the body as clothes lie"),
    "sphere": (lambda _: solid(trimesh.creation.icosphere(3, 0.4)), "closed all around"),
    "hat": (lambda body: hat(body, 0.11), "worn on the head"),
    "hat_far_too_small": (lambda body: hat(body, 0.03), "worn on the head|wholly inside the body"),
    "body": (lambda body: skin(body, *REGIONS), "it is a body, not a garment"),
    "ground": (
        lambda _: shifted(sheet(4.0, 4.0, upright=False), 0.0, 0.0, -0.95),
        "does not go around any part",
    ),
    "cube": (lambda _: box(1.0, 0.6, 1.9), "closed all around|it is a body"),
    "shirt_upside_down": (template("shirt", lambda mesh: stretched(mesh, 1, -1, -1)), "lies upside down"),
    "dress_upside_down": (template("dress", lambda mesh: stretched(mesh, 1, -1, -1)), "lies upside down"),
    "skirt_upside_down": (
        template("skirt", lambda mesh: stretched(mesh, 1, -1, -1)),
        r"its uppermost hem is 0\.\d\d m from the skin, perhaps it lies upside down",
    ),
    "sock": (lambda body: skin(body, "foot"), "worn on the foot"),
    "glove": (lambda body: skin(body, "hand"), "worn on the hand"),
    "two_pieces": (
        lambda body: joined(
            fit_template("tops", body).mesh, shifted(fit_template("bottoms", body).mesh, 1.0, 0.0, 0.0)
        ),
        r"a piece of the garment is 0\.\d\d m from the body",
    ),
    "three_times_as_deep": (
        template("tops", lambda mesh: stretched(mesh, 1, 3, 1)),
        "too wide for the body: its cloth over trunk and upper arms",
    ),
    "three_times_as_long": (template("tops", lambda mesh: stretched(mesh, 1, 1, 3)), "over the head"),
    "a_third_as_wide": (
        template("tops", lambda mesh: stretched(mesh, 0.33, 0.33, 1)),
        "does not go around any part of the body",
    ),
    "flag": (
        lambda _: shifted(sheet(1.0, 0.7, upright=True), 0.0, -0.3, 0.0),
        "far from the body|does not go around any part",
    ),
    "pot": (lambda _: cup(), "the body goes through the cloth of the garment"),
    "rags": (rags, "does not lie on the body as clothes lie"),
}
"""Meshes, by name, and what their refusal says."""

WORN: Mapping[str, Maker] = {
    "tops": template("tops"),
    "skirt": template("skirt"),
    "jacket": template("jacket"),
    "bottoms_in_centimetres": template("bottoms", lambda mesh: replace(mesh, vertices=100 * mesh.vertices)),
    "shirt_elsewhere": template("shirt", lambda mesh: shifted(mesh, 1.0, 2.0, 0.5)),
    "loose_tops": template("tops", lambda mesh: stretched(mesh, 1.25, 1.25, 1)),
    "doll_shirt": lambda body: made_up("doll", "shirt", body).garment,
    "vroid_bottoms": lambda body: made_up("vroid", "bottoms", body).garment,
    "unreal_dress": lambda body: made_up("unreal", "dress", body).garment,
}
"""Garments, by name, that are worn."""
