"""Making of the templates on a body: cut, remeshed, anchored. Run once; the result ships as data.

`python -m uvcloth.garments.tailor --out DIR [--vertices 3600]` makes them at another density. The shirt that
ships was made with 4,000 vertices, because it covers the most.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from rasterize.charts import boundary_loops, largest_piece
from rasterize.command import run_command
from rasterize.errors import InputError
from rasterize.layout import unwrap
from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.band import BAND_WIDTH, hem_band
from uvcloth.garments.cut import cut, place
from uvcloth.garments.shells import Bodice, dress_shell, joint, tight_shell
from uvcloth.garments.templates import TEMPLATES, Template, faces_outward, offset_from_skin, save_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.surface import BodySurface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SHORT_SLEEVE = 0.55
"""Length of a short sleeve as a share of the upper arm."""

LONG_SLEEVE = 1.04
"""Length of a long sleeve beyond the elbow, as a share of the forearm."""

ARM_RADIUS = 0.115
"""Metres from a bone of the arm within which a point is on the arm."""


def tailor(name: str, body: Body, vertices: int) -> Template:
    """Make one template: cut on a body, remeshed to about `vertices` vertices and anchored on its shell.

    Raises InputError for an unknown name or if the `body` extra (the remesher) is missing.
    """
    if name not in TEMPLATES:
        raise InputError(f"garment {name}: unknown template, expected one of {', '.join(TEMPLATES)}")
    bodice = _bodice(body) if name == "dress" else None
    if bodice is None:
        shell_vertices, shell_faces = tight_shell(body)
        edges, along, faces = cut(shell_faces, _field(name, body, shell_vertices))
        pattern = _largest(place(shell_vertices, edges, along), faces)
    else:
        shell_vertices, shell_faces = dress_shell(body, bodice)
        pattern = _largest(shell_vertices, shell_faces)
    points, faces = _remesh(*pattern, count=vertices)
    anchors = _surface(shell_vertices, shell_faces).closest(torch.from_numpy(points).float())
    placed = anchors.points
    fit = _clearance(name, body, placed.numpy().astype(np.float64))
    faces_tensor = torch.from_numpy(faces)
    mesh = Mesh(placed, faces_tensor, torch.zeros(0, 2), faces_tensor)
    if not faces_outward(mesh, body):
        faces_tensor = faces_tensor.flip(1)
    band = _band(name, body, placed, faces_tensor)
    clearance = torch.from_numpy(fit).float()
    rest = offset_from_skin(placed, faces_tensor, clearance, band, body)
    uvs, face_uvs = unwrap(rest, faces_tensor)
    return Template(
        name=name,
        faces=faces_tensor,
        uvs=uvs,
        face_uvs=face_uvs,
        anchor_faces=anchors.faces,
        anchor_barycentrics=anchors.barycentrics,
        clearance=clearance,
        snug=band,
        band=band,
        bodice=bodice,
    )


def _bodice(body: Body) -> Bodice:
    vertices, faces = tight_shell(body)
    waist = _waist(body) - vertices[:, 2]
    field = np.minimum(np.minimum(-waist, _neck(body, vertices, drop=0.012)), _sleeves(body, vertices))
    edges, along, cut_faces = cut(faces, field)
    placed = place(vertices, edges, along)
    kept, cut_faces = _largest_faces(cut_faces)
    placed = placed[kept]
    loop = min(boundary_loops(cut_faces), key=lambda run: float(placed[run][:, 2].mean()))
    around = placed[loop][:, :2] - placed[loop][:, :2].mean(axis=0)
    turning = np.cross(np.c_[around, np.zeros(len(loop))], np.c_[np.roll(around, -1, 0), np.zeros(len(loop))])
    if turning[:, 2].sum() < 0:
        loop = loop[::-1]
    return Bodice(edges[kept], along[kept], cut_faces, loop)


def _field(name: str, body: Body, vertices: Array) -> Array:
    """Scalar field (P,) m that is positive where the garment is: the least distance to its hems."""
    z = vertices[:, 2]
    if name in ("tops", "shirt"):
        hem = z - (joint(body, "LeftUpLeg")[2] - 0.005)
        sleeves = _sleeves(body, vertices) if name == "tops" else _long_sleeves(body, vertices)
        return np.minimum(np.minimum(hem, _neck(body, vertices, drop=0.0)), sleeves)
    waist = _waist(body) - 0.045 + 0.12 * (vertices[:, 1] - joint(body, "LowerBack")[1]) - z
    ankle = z - (joint(body, "LeftFoot")[2] + 0.055)
    aside = 0.30 - np.abs(vertices[:, 0])
    return np.minimum(np.minimum(waist, ankle), aside)


def _waist(body: Body) -> float:
    return float(joint(body, "LowerBack")[2] + 0.05)


def _neck(body: Body, vertices: Array, drop: float) -> Array:
    """A crew neck: a plane through the base of the neck, lower in front."""
    base = joint(body, "Neck")
    return base[2] + 0.012 - drop + 0.42 * (vertices[:, 1] - base[1]) - vertices[:, 2]


def _arm_share(body: Body, vertices: Array, side: str) -> Array:
    """Place of points along an upper arm: (P,), 0 at the shoulder, 1 at the elbow, -1 off the arm."""
    shoulder, elbow = joint(body, f"{side}Arm"), joint(body, f"{side}ForeArm")
    share, away = _along(vertices, shoulder, elbow)
    limb = (away < ARM_RADIUS) | (share > 1.0) & (np.abs(vertices[:, 0]) > abs(elbow[0]) - 0.08)
    return np.where(limb & (vertices[:, 0] * shoulder[0] > 0), share, -1.0)


def _sleeves(body: Body, vertices: Array) -> Array:
    longest = np.maximum(_arm_share(body, vertices, "Left"), _arm_share(body, vertices, "Right"))
    length = np.linalg.norm(joint(body, "LeftForeArm") - joint(body, "LeftArm"))
    return (SHORT_SLEEVE - longest) * float(length)


def _forearm_share(body: Body, vertices: Array) -> Array:
    """Place of points along a forearm: (P,), 0 at the elbow, 1 at the wrist, -1 off both."""
    longest = np.full(len(vertices), -1.0)
    for side in ("Left", "Right"):
        share, away = _along(vertices, joint(body, f"{side}ForeArm"), joint(body, f"{side}Hand"))
        longest = np.where(away < ARM_RADIUS, np.maximum(longest, share), longest)
    return longest


def _along(vertices: Array, start: Array, end: Array) -> tuple[Array, Array]:
    """Place of points along a bone (P,), 0 at its start, 1 at its end, and metres (P,) from its line."""
    axis = end - start
    share = (vertices - start) @ axis / (axis @ axis)
    return share, np.linalg.norm(vertices - start - share[:, None] * axis, axis=1)


def _long_sleeves(body: Body, vertices: Array) -> Array:
    length = np.linalg.norm(joint(body, "LeftHand") - joint(body, "LeftForeArm"))
    return (LONG_SLEEVE - _forearm_share(body, vertices)) * float(length)


def _clearance(name: str, body: Body, vertices: Array) -> Array:
    """Metres off the skin: snug at shoulders and waist, easier towards the hems."""
    z = vertices[:, 2]
    arm = np.maximum(_arm_share(body, vertices, "Left"), _arm_share(body, vertices, "Right"))
    sleeve = np.interp(arm, [0.15, SHORT_SLEEVE], [0.006, 0.016])
    if name == "shirt":
        sleeve = np.where(
            arm > SHORT_SLEEVE,
            np.interp(_forearm_share(body, vertices), [0.0, LONG_SLEEVE], [0.018, 0.012]),
            sleeve,
        )
    shoulder, chest = joint(body, "LeftArm")[2], joint(body, "Spine1")[2]
    hip = joint(body, "LeftUpLeg")[2]
    if name in ("tops", "shirt"):
        trunk = np.interp(z, [hip, chest, shoulder], [0.022, 0.013, 0.0055])
    elif name == "dress":
        trunk = np.interp(z, [hip, _waist(body), chest, shoulder], [0.012, 0.005, 0.009, 0.0055])
    else:
        foot, knee = joint(body, "LeftFoot")[2], joint(body, "LeftLeg")[2]
        return np.interp(z, [foot, knee, hip, _waist(body) - 0.05], [0.024, 0.015, 0.010, 0.0045])
    return np.where(arm > 0.15, np.maximum(sleeve, 0.006), trunk)


def _band(name: str, body: Body, vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """The strip that is held: neck and, for trousers and dress, waist."""
    top = max(boundary_loops(faces.numpy()), key=lambda run: float(vertices[run][:, 2].mean()))
    band = hem_band(vertices, vertices[top], BAND_WIDTH)
    if name == "dress":
        band |= (vertices[:, 2] - _waist(body)).abs() < BAND_WIDTH / 2
    return band


def _largest_faces(faces: Indices) -> tuple[Indices, Indices]:
    """The vertices of the largest piece, and its faces renumbered to them."""
    kept, renumbered = np.unique(faces[largest_piece(faces)], return_inverse=True)
    return kept, renumbered.reshape(-1, 3)


def _largest(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    kept, renumbered = _largest_faces(faces)
    return vertices[kept], renumbered


def _remesh(vertices: Array, faces: Indices, count: int) -> tuple[Array, Indices]:
    """Even triangles of about one size; hems are pulled back onto the cut they stand for."""
    try:
        import pyacvd
        import pyvista
    except ModuleNotFoundError as error:
        raise InputError("tailoring needs the remesher: install uvcloth[body]") from error
    cells = np.column_stack([np.full(len(faces), 3), faces]).ravel()
    clustering = pyacvd.Clustering(pyvista.PolyData(vertices, cells))
    clustering.subdivide(3)
    clustering.cluster(count)
    even = clustering.create_mesh()
    points = np.asarray(even.points, dtype=np.float64)
    triangles = np.asarray(even.faces).reshape(-1, 4)[:, 1:].astype(np.int64)
    points, triangles = _largest(points, triangles)
    source = _surface(vertices, faces)
    hems = [vertices[run] for run in boundary_loops(faces)]
    for _ in range(10):
        points = _relaxed(points, triangles)
        points = source.closest(torch.from_numpy(points).float()).points.numpy().astype(np.float64)
        for run in boundary_loops(triangles):
            points[run] = _snapped(points[run], hems)
    return points, triangles


def _surface(vertices: Array, faces: Indices) -> BodySurface:
    return BodySurface(torch.from_numpy(vertices).float(), torch.from_numpy(faces))


def _relaxed(points: Array, faces: Indices) -> Array:
    edges = np.unique(
        np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1), axis=0
    )
    total, degree = np.zeros_like(points), np.zeros(len(points))
    for a, b in ((0, 1), (1, 0)):
        np.add.at(total, edges[:, a], points[edges[:, b]])
        np.add.at(degree, edges[:, a], 1.0)
    relaxed = 0.5 * points + 0.5 * total / degree[:, None]
    for run in boundary_loops(faces):
        relaxed[run] = 0.5 * points[run] + 0.25 * (np.roll(points[run], 1, 0) + np.roll(points[run], -1, 0))
    return relaxed


def _snapped(points: Array, hems: list[Array]) -> Array:
    """Closest points on the nearest closed polyline among `hems`."""
    best, distance = points, np.full(len(points), np.inf)
    for hem in hems:
        start, along = hem, np.roll(hem, -1, axis=0) - hem
        share = ((points[:, None] - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
        on_line = start + share.clip(0, 1)[..., None] * along
        gap = np.linalg.norm(on_line - points[:, None], axis=-1)
        nearest = gap.argmin(axis=1)
        rows = np.arange(len(points))
        closer = gap[rows, nearest] < distance
        best = np.where(closer[:, None], on_line[rows, nearest], best)
        distance = np.minimum(distance, gap[rows, nearest])
    return best


@dataclass(frozen=True)
class Options:
    """Tailor templates and write one npz each."""

    out: Path
    """Folder for the templates."""
    garment: tuple[str, ...] = TEMPLATES
    """Which templates to tailor."""
    body: Path | None = None
    """Body npz to cut on; the built-in one if left out."""
    vertices: int = 3600
    """Vertices per template, about."""


def main() -> None:
    """Tailor the templates that the command line names."""
    import tyro

    options = tyro.cli(Options)
    body = load_body(options.body)
    for name in options.garment:
        template = tailor(name, body, options.vertices)
        save_template(template, options.out / f"{name}.npz")
        print(f"{name}: {len(template.anchor_faces)} vertices, {len(template.faces)} faces")


if __name__ == "__main__":
    sys.exit(run_command("tailor", main))
