"""Placing of a garment file on a body where it lies best: its unit, up axis, facing and vertical origin."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import unit_face_normals
from uvcloth.geometry.units import UNITS
from uvcloth.physics.exposure import spread
from uvcloth.physics.surface import BodySurface, SurfacePoints

AXES = {
    f"{sign}{letter}": torch.tensor([float(sign + "1") * (letter == other) for other in "XYZ"])
    for sign, letter in product("+-", "XYZ")
}

FRONTS = {"Z": ("-Y", "+Y", "+X", "-X"), "Y": ("+Z", "-Z", "+X", "-X")}
"""Axes that the front may face, by the up axis; the usual one first."""

ORIGINS = ("body", "feet")
"""Origin of a file: the body's own, at the hips, or on the floor between its feet."""

SMALLEST, LARGEST = 0.12, 1.2
"""Limits of a garment's diagonal, in body diagonals: a factor of ten, so that few units fit."""

DOLL = 10.0
"""Factor by which a doll's garment may be smaller."""

COMMON = ("m", "cm")
"""Units that files usually have; others are as unusual as a body of another size."""

UNUSUAL = 1.25
"""Factor on the misfit for an unusual facing or origin: skirts fit equally well in several."""

INSIDE_WEIGHT = 3.0
"""Factor on the depth of what is inside the body: cloth is worn outside."""

FAR = 1.0
"""Metres from the skin beyond which a point fits no worse."""

ALONG_COSINE = 0.5
"""Cosine between the normals of cloth and of the skin below it from which on cloth lies along the skin."""

ACROSS_COST = 0.2
"""Metres added to the distance of cloth across the skin, since shrunk, crumpled cloth is close to it."""

POINTS = 256
"""Points over the cloth by which candidates are compared."""

SEARCH_DISTANCE = 10.0
"""Metres within which the closest body point is sought."""


@dataclass(frozen=True)
class Placing:
    """A file's frame of reference, which converts its coordinates to the body's.

    unit: a key of UNITS. up: "Y" or "Z". front: the axis that the garment's front faces. origin: of ORIGINS.
    """

    unit: str
    up: str
    front: str
    origin: str

    @property
    def usual(self) -> bool:
        """Test for a file with the usual front and origin of its up axis."""
        return self.front == FRONTS[self.up][0] and self.origin == ORIGINS[0]

    def apply(self, points: Tensor, body: Body) -> Tensor:
        """Points (N, 3) of the file in the body's frame: (N, 3) float32, metres, Z up, facing -Y."""
        placed = points * UNITS[self.unit] @ self._rotation().to(points).T
        lowest = body.mesh.vertices[:, 2].min().to(placed) if self.origin == "feet" else 0.0
        return (placed + AXES["+Z"].to(placed) * lowest).float()

    def turn(self, directions: Tensor) -> Tensor:
        """Directions (N, 3) of the file in the body's frame: (N, 3) float32."""
        return (directions @ self._rotation().to(directions).T).float()

    def text(self) -> str:
        """Description of the frame and its conversion; one line."""
        frame = f"unit {self.unit}, {self.up} up"
        done = [] if (self.unit, self.up) == ("m", "Z") else ["converted to metres, Z up"]
        if self.front != FRONTS[self.up][0]:
            frame += f", front to {self.front}"
            done.append("turned to the body's front")
        if self.origin != ORIGINS[0]:
            frame += ", origin between the feet"
            done.append("moved to the body's origin at the hips")
        return ", ".join([frame, *done])

    def _rotation(self) -> Tensor:
        """Rotation (3, 3) that takes the front to -Y and the up axis to Z."""
        up, front = AXES["+" + self.up], AXES[self.front]
        return torch.stack([torch.linalg.cross(up, front), -front, up])


@dataclass(frozen=True)
class ClothSample:
    """Points (..., P, 3) spread evenly over the area of a garment, and the unit normals there."""

    points: Tensor
    normals: Tensor

    @classmethod
    def of(cls, vertices: Tensor, faces: Tensor, count: int) -> "ClothSample":
        """Sample `count` points of a mesh (N, 3), (F, 3)."""
        sample = spread(vertices, faces, count)
        normals = unit_face_normals(vertices, sample.corners)
        return cls(sample.points(vertices), normals)


def find_placings(
    path: Path, vertices: Tensor, faces: Tensor, body: Body, surface: BodySurface
) -> tuple[Placing, ...]:
    """Find the placing in which a mesh (N, 3), (F, 3), as its file has it, lies best on a body.

    Where that has another unit than COMMON, the best in one of these follows: a wide skirt is closer to the
    skin the smaller it is. surface: of the body at rest. Raises InputError naming the path if the mesh is
    too large or too small for the body in every unit.
    """
    extent = float((vertices.amax(0) - vertices.amin(0)).norm())
    tallest = float((body.mesh.vertices.amax(0) - body.mesh.vertices.amin(0)).norm())
    sizes = {unit: extent * metres / tallest for unit, metres in UNITS.items()}
    units = [unit for unit, size in sizes.items() if SMALLEST <= size < LARGEST]
    if not units and SMALLEST / DOLL <= sizes["m"] < SMALLEST:
        units = ["m"]
    if not units:
        wrong = "large" if sizes["mm"] >= LARGEST else "small"
        raise InputError(
            f"{path}: the garment is {extent:.3g} units across, too {wrong} for a body of {tallest:.1f} m "
            f"in every unit ({', '.join(UNITS)})"
        )
    candidates = [
        Placing(unit, up, front, origin)
        for unit, up, origin in product(units, FRONTS, ORIGINS)
        for front in FRONTS[up]
    ]
    cloth = ClothSample.of(vertices, faces, POINTS)
    points = torch.stack([candidate.apply(cloth.points, body) for candidate in candidates])
    normals = torch.stack([candidate.turn(cloth.normals) for candidate in candidates])
    unusual = torch.tensor([1.0 if each.usual else UNUSUAL for each in candidates])
    order = (unusual * misfit(ClothSample(points, normals), surface)).argsort(stable=True).tolist()
    common = [index for index in order if candidates[index].unit in COMMON]
    return tuple(candidates[index] for index in dict.fromkeys((*order[:1], *common[:1])))


def misfit(cloth: ClothSample, surface: BodySurface) -> Tensor:
    """Mean distance (...) m of points (..., P, 3) m to the skin, more where cloth is inside or across it."""
    nearest = surface.closest(cloth.points.reshape(-1, 3), SEARCH_DISTANCE)
    distance = nearest.signed_distance
    cost = torch.where(distance < 0, -INSIDE_WEIGHT * distance, distance).clamp(max=FAR)
    cost = cost + ACROSS_COST * ~lies_along(cloth.normals.reshape(-1, 3), nearest)
    return cost.reshape(cloth.points.shape[:-1]).mean(-1)


def lies_along(normals: Tensor, skin: SurfacePoints) -> Tensor:
    """Mask (N,) of cloth with unit normals (N, 3), outward or inward, that lies along the skin beneath it."""
    return (normals * skin.normals).sum(1).abs() > ALONG_COSINE
