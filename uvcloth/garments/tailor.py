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

from rasterize.charts import boundary_loops
from rasterize.command import run_command
from rasterize.errors import InputError
from rasterize.layout import unwrap
from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.band import BAND_WIDTH, hem_band
from uvcloth.garments.cut import cut, place
from uvcloth.garments.openings import forearm_share, neck, sleeves, upper_arm_share, waist_height, waistband
from uvcloth.garments.remesh import largest, remesh, surface_of
from uvcloth.garments.shells import Bodice, cut_bodice, dress_shell, joint, tight_shell
from uvcloth.garments.templates import TEMPLATES, Template, faces_outward, offset_from_skin, save_template
from uvcloth.geometry.mesh import Mesh

Array = NDArray[np.float64]

SHORT_SLEEVE = 0.55
"""Length of a short sleeve as a share of the upper arm."""

LONG_SLEEVE = 2.04
"""Length of a long sleeve: the upper arm, and beyond the elbow in shares of the forearm."""


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
        pattern = largest(place(shell_vertices, edges, along), faces)
    else:
        shell_vertices, shell_faces = dress_shell(body, bodice)
        pattern = largest(shell_vertices, shell_faces)
    points, faces = remesh(*pattern, count=vertices)
    anchors = surface_of(shell_vertices, shell_faces).closest(torch.from_numpy(points).float())
    placed = anchors.points
    fit = _clearance(name, body, placed.numpy().astype(np.float64))
    faces_tensor = torch.from_numpy(faces)
    mesh = Mesh(placed, faces_tensor, torch.zeros(0, 2), faces_tensor)
    if not faces_outward(mesh, body):
        faces_tensor = faces_tensor.flip(1)
    band = _band(name, body, placed, faces_tensor)
    clearance = torch.from_numpy(fit).float()
    rest = offset_from_skin(placed, faces_tensor, clearance, band, body)
    uvs, face_uvs = unwrap(rest, faces_tensor, name)
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
    vertices, _ = tight_shell(body)
    above = vertices[:, 2] - waist_height(body)
    collar = neck(body, vertices, drop=0.012)
    return cut_bodice(body, np.minimum(np.minimum(above, collar), sleeves(body, vertices, SHORT_SLEEVE)))


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


def _clearance(name: str, body: Body, vertices: Array) -> Array:
    """Metres off the skin: snug at shoulders and waist, easier towards the hems."""
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
    top = max(boundary_loops(faces.numpy()), key=lambda run: float(vertices[run][:, 2].mean()))
    band = hem_band(vertices, vertices[top], BAND_WIDTH)
    if name == "dress":
        band |= (vertices[:, 2] - waist_height(body)).abs() < BAND_WIDTH / 2
    return band


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
