"""Making of the templates on a body: cut, remeshed, anchored. Run once; the result ships as data.

Run as a module, with `--out DIR`, it makes all of them as they ship, with `--garment skirt --vertices 1000`
one at another density (docs/garments.md).
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from rasterize.charts import boundary_loops
from rasterize.gather import gather
from rasterize.layout import unwrap
from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.garments.band import DROP
from uvcloth.garments.cut import cut, place
from uvcloth.garments.openings import forearm_share, neck, sleeves, upper_arm_share, waist_height, waistband
from uvcloth.garments.places import BAND_WIDTH, hem_band
from uvcloth.garments.remesh import Indices, largest, remesh, surface_of
from uvcloth.garments.shells import TEMPLATE_SKIRT, Bodice, SkirtCut, cut_bodice, joint, tight_shell
from uvcloth.garments.templates import (
    TEMPLATES,
    Template,
    faces_outward,
    offset_from_skin,
    save_template,
    shell,
    tailored,
)
from uvcloth.geometry.mesh import Mesh, vertex_normals
from uvcloth.process.command import run_command
from uvcloth.wardrobe.designs import Design, Upper
from uvcloth.wardrobe.patterns import Pattern, cut_pattern, waist_strip

Array = NDArray[np.float64]

VERTICES = {"tops": 3600, "bottoms": 3600, "dress": 3600, "shirt": 4000, "skirt": 3880, "jacket": 3360}
"""Vertices of the templates in the package; numbers close to these give thinner triangles, in the jacket down
to a height of 2 mm.
"""

SHORT_SLEEVE = 0.55
"""Length of a short sleeve as a share of the upper arm."""

LONG_SLEEVE = 2.04
"""Length of a long sleeve: the upper arm, and beyond the elbow in shares of the forearm."""

CIRCLE_SKIRT = SkirtCut(ease=0.02, flare=0.55)
"""The wide skirt, at rest a cone: it falls into folds, and opens in a turn."""

DRAWN_IN = 0.004
"""Metres by which smoothing draws a jacket in, about."""

JACKET = Design(
    "jacket",
    upper=Upper(
        sleeve=1.98,
        hem=-0.02,
        neck_depth=0.06,
        neck_width=0.07,
        neck_power=1.2,
        ease=0.045,
        sleeve_ease=0.03,
        flare=0.0,
        front_gap=0.07,
    ),
)

OVER_SHIRT = (0.014, 0.008)
"""Metres that the jacket is farther off the skin than the shirt, at the hips and at the shoulders."""


def tailor(name: str, body: Body, vertices: int) -> Template:
    """Make one template: cut on a body, remeshed to about `vertices` vertices and anchored on its shell.

    Raises InputError for an unknown name or if the `body` extra (the remesher) is missing.
    """
    if name not in TEMPLATES:
        raise InputError(f"garment {name}: unknown template, expected one of {', '.join(TEMPLATES)}")
    bodice, skirt = _bodice(name, body), CIRCLE_SKIRT if name == "skirt" else TEMPLATE_SKIRT
    shell_vertices, shell_faces = shell(body, bodice, skirt)
    pattern = _pattern(name, body, shell_vertices, shell_faces)
    points, faces, lift = _meshed(name, body, pattern, vertices)
    anchors = surface_of(shell_vertices, shell_faces).closest(torch.from_numpy(points).float())
    placed = anchors.points
    fit = _clearance(name, body, placed.numpy().astype(np.float64))
    faces_tensor = torch.from_numpy(faces)
    mesh = Mesh(placed, faces_tensor, torch.zeros(0, 2), faces_tensor)
    if not faces_outward(mesh, body):
        faces_tensor = faces_tensor.flip(1)
    band = _band(name, body, placed, faces_tensor)
    template = Template(
        name=name,
        faces=faces_tensor,
        uvs=torch.zeros(0, 2),
        face_uvs=faces_tensor,
        anchor_faces=anchors.faces,
        anchor_barycentrics=anchors.barycentrics,
        lift=torch.from_numpy(lift).float(),
        clearance=torch.from_numpy(fit).float(),
        snug=band,
        band=band,
        bodice=bodice,
        skirt=skirt,
    )
    uvs, face_uvs = unwrap(tailored(template, body).vertices, faces_tensor, name)
    return replace(template, uvs=uvs, face_uvs=face_uvs)


def _bodice(name: str, body: Body) -> Bodice | None:
    """The part that holds a skirt, a dress's upper part or a waistband; None for what has no skirt."""
    vertices, _ = tight_shell(body)
    if name == "skirt":
        return cut_bodice(body, waist_strip(body, vertices, drop=0.0))
    if name != "dress":
        return None
    above = vertices[:, 2] - waist_height(body)
    collar = neck(body, vertices, drop=0.012)
    return cut_bodice(body, np.minimum(np.minimum(above, collar), sleeves(body, vertices, SHORT_SLEEVE)))


def _pattern(name: str, body: Body, vertices: Array, faces: Indices) -> Pattern:
    """The part of its shell (P, 3) m, (Q, 3) that a template keeps."""
    if name == "jacket":
        return cut_pattern(JACKET, body)
    if name in ("dress", "skirt"):
        return Pattern(*largest(vertices, faces))
    edges, along, kept = cut(faces, _field(name, body, vertices))
    return Pattern(*largest(place(vertices, edges, along), kept))


def _meshed(name: str, body: Body, pattern: Pattern, count: int) -> tuple[Array, Indices, Array]:
    """Remesh a pattern to `count` vertices: points (N, 3) m on it, faces (M, 3), and metres (N,) off it.

    Parts that lie off their pattern are remeshed at their final place, so that triangles are even there.
    """
    off = _lift(name, body, pattern.vertices)
    if not off.any():
        points, faces = remesh(pattern.vertices, pattern.faces, count)
        return points, faces, np.zeros(len(points))
    tight, corners = torch.from_numpy(pattern.vertices).float(), torch.from_numpy(pattern.faces)
    lifted = tight + torch.from_numpy(off).float()[:, None] * vertex_normals(tight, corners)
    free = torch.zeros(len(tight), dtype=torch.bool)
    lifted = offset_from_skin(lifted, corners, torch.from_numpy(off).float(), free, body)
    points, faces = remesh(lifted.numpy().astype(np.float64), pattern.faces, count)
    nearest = surface_of(lifted.numpy(), pattern.faces).closest(torch.from_numpy(points).float())
    on = corners[nearest.faces]
    return (
        gather(tight, on, nearest.barycentrics).numpy().astype(np.float64),
        faces,
        gather(torch.from_numpy(off).float()[:, None], on, nearest.barycentrics)[:, 0]
        .numpy()
        .astype(np.float64),
    )


def _field(name: str, body: Body, vertices: Array) -> Array:
    """Scalar field (P,) m that is positive where the garment is: the least distance to its hems."""
    z = vertices[:, 2]
    if name in ("tops", "shirt"):
        hem = z - (joint(body, "LeftUpLeg")[2] - 0.005)
        cuffs = sleeves(body, vertices, SHORT_SLEEVE if name == "tops" else LONG_SLEEVE)
        return np.minimum(np.minimum(hem, neck(body, vertices, drop=0.0)), cuffs)
    waist = waistband(body, vertices, drop=0.045)
    ankle = z - (joint(body, "LeftFoot")[2] + 0.055)
    aside = 0.30 - np.abs(vertices[:, 0])
    return np.minimum(np.minimum(waist, ankle), aside)


def _lift(name: str, body: Body, vertices: Array) -> Array:
    """Distance (P,) m from its shell at which a template starts; a jacket ends closer to it."""
    return _clearance(name, body, vertices) + DRAWN_IN if name == "jacket" else np.zeros(len(vertices))


def _clearance(name: str, body: Body, vertices: Array) -> Array:
    """Metres off the skin: snug at shoulders and waist, easier towards the hems."""
    if name == "jacket":
        heights = joint(body, "LeftUpLeg")[2], joint(body, "LeftArm")[2]
        return _clearance("shirt", body, vertices) + np.interp(vertices[:, 2], heights, OVER_SHIRT)
    if name == "skirt":
        return np.interp(
            vertices[:, 2], [waist_height(body) - 0.15, waist_height(body) - 0.04], [0.012, 0.0055]
        )
    z = vertices[:, 2]
    arm = upper_arm_share(body, vertices)
    sleeve = np.interp(arm, [0.15, SHORT_SLEEVE], [0.006, 0.016])
    if name == "shirt":
        sleeve = np.where(
            arm > SHORT_SLEEVE,
            np.interp(forearm_share(body, vertices), [0.0, LONG_SLEEVE - 1.0], [0.018, 0.012]),
            sleeve,
        )
    shoulder, chest = joint(body, "LeftArm")[2], joint(body, "Spine1")[2]
    hip = joint(body, "LeftUpLeg")[2]
    if name in ("tops", "shirt"):
        trunk = np.interp(z, [hip, chest, shoulder], [0.022, 0.013, 0.0055])
    elif name == "dress":
        trunk = np.interp(z, [hip, waist_height(body), chest, shoulder], [0.012, 0.005, 0.009, 0.0055])
    else:
        foot, knee = joint(body, "LeftFoot")[2], joint(body, "LeftLeg")[2]
        return np.interp(z, [foot, knee, hip, waist_height(body) - 0.05], [0.024, 0.015, 0.010, 0.0045])
    return np.where(arm > 0.15, np.maximum(sleeve, 0.006), trunk)


def _band(name: str, body: Body, vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """The strip that is held: neck and, for trousers and dress, waist."""
    heights = vertices[:, 2]
    top = max(boundary_loops(faces.numpy()), key=lambda run: float(heights[run].max()))
    top = top[(heights[top] > heights[top].max() - DROP / 2).numpy()]
    band = hem_band(vertices, vertices[top], BAND_WIDTH)
    if name == "dress":
        band |= (vertices[:, 2] - waist_height(body)).abs() < BAND_WIDTH / 2
    return band


@dataclass(frozen=True)
class TailorOptions:
    """Tailor templates and write one npz each."""

    out: Path
    """Folder for the templates."""
    garment: tuple[str, ...] = TEMPLATES
    """Which templates to tailor."""
    body: Path | None = None
    """Body npz to cut on; by default the one in the package."""
    vertices: int | None = None
    """Vertices per template, about; by default those of the templates in the package."""


def main() -> None:
    """Tailor the templates that the command line names."""
    import tyro

    options = tyro.cli(TailorOptions)
    body = load_body(options.body)
    for name in options.garment:
        template = tailor(name, body, options.vertices or VERTICES[name])
        save_template(template, options.out / f"{name}.npz")
        print(f"{name}: {len(template.anchor_faces)} vertices, {len(template.faces)} faces")


if __name__ == "__main__":
    sys.exit(run_command("tailor", main))
