"""Garments in the conventions of families of bodies: on a made-up body of their shape, unit, axes and origin.

Nothing here is anyone's: the bodies are ours, stretched, and the garments are our templates, fitted to them,
or random ones, sewn on them.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import Body, resized
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Garment
from uvcloth.garments.pose import Stance, limbs_held, posed_body
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skinning import skin
from uvcloth.wardrobe.make import make_outfit
from uvcloth.writers.obj import save_obj

VERTICES = (2500, 4500)
"""Least and most vertices of a random garment."""

TRUNK = ("Hips", "LHipJoint", "RHipJoint", "LowerBack", "Spine", "Spine1", "LeftShoulder", "RightShoulder")
Y_UP = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
Z_UP = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
Z_UP_TURNED = ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Family:
    """Convention of a family of bodies.

    height: m, before a doll is made of it. unit: metres of that body in one unit. axes: rows of the file's
    axes in the body's. floor: whether the origin is between the feet, not at the hips. trunk: width, depth
    and length over ours; arms, legs: length and girth; head: size.
    """

    height: float
    unit: float
    axes: tuple[tuple[float, ...], ...]
    floor: bool
    stance: Stance
    trunk: tuple[float, float, float] = (1.0, 1.0, 1.0)
    arms: tuple[float, float] = (1.0, 1.0)
    legs: tuple[float, float] = (1.0, 1.0)
    head: float = 1.0


FAMILIES = {
    "smpl": Family(1.66, 1.0, Y_UP, False, Stance(0.0, 0.0), (0.92, 1.05, 1.06), (0.96, 1.05), (0.95, 1.0)),
    "smpl_a": Family(1.74, 1.0, Y_UP, False, Stance(45.0), (1.05, 1.12, 1.04), (1.0, 1.1), (0.97, 1.08)),
    "vroid": Family(
        1.5, 1.0, Y_UP, True, Stance(0.0, 0.0), (0.88, 0.85, 0.92), (0.95, 0.75), (1.1, 0.82), 1.3
    ),
    "vroid_a": Family(1.5, 1.0, Y_UP, True, Stance(78.0), (0.88, 0.85, 0.92), (0.95, 0.75), (1.1, 0.82), 1.3),
    "makehuman": Family(1.72, 0.1, Y_UP, True, Stance(), (1.06, 1.08, 1.0), (1.0, 1.05), (1.0, 1.06), 0.96),
    "readyplayer": Family(
        1.68, 1.0, Y_UP, True, Stance(0.0, 3.0), (0.9, 0.92, 0.94), (0.92, 0.85), (1.02, 0.88), 1.18
    ),
    "mixamo": Family(1.8, 0.01, Y_UP, True, Stance(0.0, 4.0), (1.08, 1.0, 1.0), (1.02, 1.1)),
    "unreal": Family(
        1.83, 0.01, Z_UP_TURNED, True, Stance(50.0, 4.0), (1.06, 1.02, 0.98), (1.05, 1.1), (1.03, 1.05)
    ),
    "doll": Family(1.74, 6.0, Y_UP, True, Stance(20.0, 1.0), (0.9, 0.9, 0.95), (0.95, 0.8), (1.1, 0.85), 1.2),
}


def stretched(body: Body, family: Family) -> Body:
    """Our body with the proportions and the height of a family, at rest."""
    maps = _maps(body, family)
    heads = torch.stack(
        [maps[j] @ torch.cat([head, torch.ones(1)]) for j, head in enumerate(body.skeleton.heads)]
    )
    longer = replace(
        body,
        mesh=replace(body.mesh, vertices=skin(body.mesh.vertices, body.weights, maps[None])[0]),
        skeleton=replace(body.skeleton, heads=heads),
        proxies={
            name: replace(proxy, vertices=skin(proxy.vertices, proxy.weights, maps[None])[0])
            for name, proxy in body.proxies.items()
        },
        base=None,
    )
    heights = longer.mesh.vertices[:, 2]
    return resized(longer, family.height / float(heights.max() - heights.min()))


def _maps(body: Body, family: Family) -> Tensor:
    """Affine maps (J, 3, 4) of the joints: parts are stretched along their bones and across."""
    names, parents, heads = body.skeleton.names, body.skeleton.parents, body.skeleton.heads
    stretch = [_stretch(body, joint, family) for joint in range(len(names))]
    places: list[Tensor] = []
    for joint, parent in enumerate(parents):
        bone = heads[joint] - heads[parent]
        places.append(heads[joint] if parent < 0 else places[parent] + stretch[parent] @ bone)
    return torch.stack(
        [
            torch.cat([linear, (place - linear @ head)[:, None]], dim=1)
            for linear, place, head in zip(stretch, places, heads, strict=True)
        ]
    )


def _stretch(body: Body, joint: int, family: Family) -> Tensor:
    name, names, heads = body.skeleton.names[joint], body.skeleton.names, body.skeleton.heads
    if name in TRUNK or name == "Neck":
        return torch.diag(torch.tensor(family.trunk))
    if name in ("Neck1", "Head"):
        return family.head * torch.eye(3)
    length, girth = family.legs if name.endswith(("Leg", "Foot", "ToeBase")) else family.arms
    ends = {"UpLeg": "Leg", "Leg": "Foot", "ForeArm": "Hand", "Arm": "ForeArm"}
    side = "Left" if name.startswith("L") else "Right"
    end = ends.get(name.removeprefix(side))
    if end is None:
        return girth * torch.eye(3)
    along = heads[names.index(side + end)] - heads[joint]
    along = along / along.norm()
    return girth * torch.eye(3) + (length - girth) * along[:, None] * along


@dataclass(frozen=True)
class MadeUp:
    """A garment on a made-up body, both in the coordinates of the family's files, and metres in one unit."""

    garment: Mesh
    body: Mesh
    unit: float


@cache
def made_up(family: str, kind: str, body: Body, number: int = 0) -> MadeUp:
    """A template, or a random garment of a kind and number, on a body of a family, in its stance."""
    convention = FAMILIES[family]
    other = stretched(body, convention)
    garment = fit_template(kind, other) if kind in TEMPLATES else sewn(kind, other, number)
    transforms = limbs_held(other, convention.stance)
    standing = posed_body(other, transforms)
    floor = standing.mesh.vertices[:, 2].min() if convention.floor else torch.tensor(0.0)
    axes = torch.tensor(convention.axes)

    def in_file(points: Tensor) -> Tensor:
        return (points - floor * torch.tensor([0.0, 0.0, 1.0])) @ axes.T / convention.unit

    cloth = skin(garment.mesh.vertices, garment.smooth_weights, transforms[None])[0]
    return MadeUp(
        replace(garment.mesh, vertices=in_file(cloth)),
        replace(standing.mesh, vertices=in_file(standing.mesh.vertices)),
        convention.unit,
    )


def sewn(kind: str, body: Body, number: int) -> Garment:
    """The random garment of a kind (of `wardrobe.designs`) and number, on a body at rest."""
    mesh = make_outfit(number, 0, (kind,), VERTICES, body).pieces[0]
    return make_fitted(kind, mesh, body, None)[0]


def on_another_mesh(body: Mesh) -> Mesh:
    """A body with other vertices: also the middles of its faces, in another order."""
    vertices, faces = body.vertices, body.faces
    middles = vertices[faces].mean(1)
    corners = torch.arange(len(faces)) + len(vertices)
    split = torch.cat([torch.stack([faces[:, k], faces[:, (k + 1) % 3], corners], 1) for k in range(3)])
    turned = torch.randperm(len(vertices) + len(faces), generator=torch.Generator().manual_seed(0))
    place = torch.argsort(turned)
    bare = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
    return Mesh(torch.cat([vertices, middles])[turned], place[split], *bare)


def written(mesh: Mesh, path: Path) -> Path:
    """Write a mesh as OBJ."""
    save_obj(mesh, path)
    return path
