"""Garment templates: one topology and one UV layout each, for any body that has the proxies."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays, smallest_indices
from uvcloth.garments.attach import DIFFUSION, make_garment
from uvcloth.garments.garment import Garment
from uvcloth.garments.shells import TEMPLATE_SKIRT, Bodice, SkirtCut, dress_shell, tight_shell
from uvcloth.geometry.mesh import Mesh, boundary_edges, neighbour_average, vertex_normals
from uvcloth.geometry.once import once_per_record
from uvcloth.physics.surface import BodySurface

TEMPLATES = ("tops", "bottoms", "dress", "shirt", "skirt", "jacket")
TEMPLATE_FORMAT = "uvcloth-template-1"

EASE_PASSES = 12
"""Passes that move a template off the skin."""

EVENING_PASSES = 30
"""Passes that equalize a template that starts off its shell, where armpits squeeze it together."""

LEAST_CLEARANCE = 0.0035
"""Metres that every template keeps off the skin at rest."""


@dataclass(frozen=True)
class Template:
    """A garment pattern anchored on a shell around the body.

    faces: (M, 3). uvs: (U, 2), face_uvs: (M, 3). anchor_faces: (N,) faces of the shell,
    anchor_barycentrics: (N, 3). lift: (N,) metres off the shell, along its normals, at which a vertex starts.
    clearance: (N,) metres that it keeps off the skin, at least.
    snug: (N,) bool, vertices that keep exactly that distance.
    band: (N,) bool, the strip that holds the garment up (neck or waist).
    bodice: the upper part of a dress shell, None where the shell is the tight one. skirt: the skirt below it.
    """

    name: str
    faces: Tensor
    uvs: Tensor
    face_uvs: Tensor
    anchor_faces: Tensor
    anchor_barycentrics: Tensor
    lift: Tensor
    clearance: Tensor
    snug: Tensor
    band: Tensor
    bodice: Bodice | None
    skirt: SkirtCut = TEMPLATE_SKIRT


def fit_template(name: str, body: Body) -> Garment:
    """Fit a template to a body at rest, once for each body.

    Raises InputError for an unknown name or a body without proxies.
    """
    return _on_body(body, name)


@once_per_record
def _on_body(body: Body, name: str) -> Garment:
    template = load_template(name)
    mesh = tailored(template, body)
    return make_garment(name, mesh, body, DIFFUSION[name], template=name, source="template")


def tailored(template: Template, body: Body) -> Mesh:
    """Mesh of a template on a body: anchored on its shell, then moved off the skin and evened out."""
    placed, shell_faces = shell(body, template.bodice, template.skirt)
    shell_vertices, faces = torch.from_numpy(placed).float(), torch.from_numpy(shell_faces)
    corners = faces[template.anchor_faces]
    vertices = gather(shell_vertices, corners, template.anchor_barycentrics)
    if bool(template.lift.any()):
        normals = gather(vertex_normals(shell_vertices, faces), corners, template.anchor_barycentrics)
        vertices = vertices + template.lift[:, None] * torch.nn.functional.normalize(normals, dim=1)
    vertices = offset_from_skin(vertices, template.faces, template.clearance, template.snug, body)
    if bool(template.lift.any()):
        vertices = evened(vertices, template.faces)
    return Mesh(vertices, template.faces, template.uvs, template.face_uvs)


def shell(
    body: Body, bodice: Bodice | None, skirt: SkirtCut = TEMPLATE_SKIRT
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Surface that a template is anchored on: vertices (P, 3) m and faces (Q, 3).

    Without a bodice the tight shell, with one the dress shell.
    """
    return tight_shell(body) if bodice is None else dress_shell(body, bodice, skirt)


def offset_from_skin(vertices: Tensor, faces: Tensor, clearance: Tensor, snug: Tensor, body: Body) -> Tensor:
    """Move garment vertices (N, 3) m off the skin to their clearance (N,) m, smoothing between the passes.

    Snug vertices end at their clearance from either side, others at no less than it.
    """
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    average = smoothing_matrix(faces, len(vertices))
    for step in range(EASE_PASSES):
        skin = surface.closest(vertices)
        lack = clearance - skin.signed_distance
        move = torch.where(snug, lack, lack.clamp(min=0))[:, None] * skin.normals
        vertices = vertices + move + 0.5 * (average @ move - move) * float(step < EASE_PASSES - 2)
        if step < EASE_PASSES - 2:
            vertices = 0.6 * vertices + 0.4 * (average @ vertices)
    for _ in range(4):
        skin = surface.closest(vertices)
        vertices = (
            vertices + (LEAST_CLEARANCE + 5e-4 - skin.signed_distance).clamp(min=0)[:, None] * skin.normals
        )
    return vertices


def evened(vertices: Tensor, faces: Tensor) -> Tensor:
    """Vertices (N, 3) m moved along their surface towards the mean of their neighbours; hems stay."""
    average, hem = neighbour_average(faces, len(vertices)), boundary_edges(faces).unique()
    for _ in range(EVENING_PASSES):
        normals = vertex_normals(vertices, faces)
        move = 0.5 * (average @ vertices - vertices)
        move = move - (move * normals).sum(1, keepdim=True) * normals
        move[hem] = 0.0
        vertices = vertices + move
    return vertices


def smoothing_matrix(faces: Tensor, count: int) -> Tensor:
    """Neighbour averages, sparse (count, count), in which hem vertices have only neighbours along the hem."""
    hem = boundary_edges(faces)
    average = neighbour_average(faces, count)
    off_hem = ~torch.isin(average.indices()[0], hem)
    places = torch.cat([average.indices()[:, off_hem], hem.T, hem.flip(1).T], dim=1)
    values = torch.cat([average.values()[off_hem], torch.full((2 * len(hem),), 0.5)])
    return torch.sparse_coo_tensor(places, values, (count, count), check_invariants=False).to_sparse_csr()


def faces_outward(mesh: Mesh, body: Body) -> bool:
    """Test of orientation: the normals of most vertices point away from the skin."""
    skin = BodySurface(body.mesh.vertices, body.mesh.faces).closest(mesh.vertices)
    facing = (vertex_normals(mesh.vertices, mesh.faces) * skin.normals).sum(1)
    return bool((facing > 0).float().mean() > 0.5)


@cache
def load_template(name: str) -> Template:
    """Read a template by name from the package. Raises InputError for an unknown name."""
    if name not in TEMPLATES:
        raise InputError(f"garment {name}: unknown template, expected one of {', '.join(TEMPLATES)}")
    path = Path(str(files("uvcloth") / "data" / "templates" / f"{name}.npz"))
    data = load_arrays(path, TEMPLATE_FORMAT, "a garment template")
    bodice, skirt = None, TEMPLATE_SKIRT
    if "bodice_faces" in data:
        bodice = Bodice(
            data["bodice_edges"].astype(np.int64),
            data["bodice_along"].astype(np.float64),
            data["bodice_faces"].astype(np.int64),
            data["bodice_loop"].astype(np.int64),
        )
    if "skirt" in data:
        skirt = SkirtCut(None, *data["skirt"].tolist())
    return Template(
        name=name,
        faces=torch.from_numpy(data["faces"].astype(np.int64)),
        uvs=torch.from_numpy(data["uvs"]),
        face_uvs=torch.from_numpy(data["face_uvs"].astype(np.int64)),
        anchor_faces=torch.from_numpy(data["anchor_faces"].astype(np.int64)),
        anchor_barycentrics=torch.from_numpy(data["anchor_barycentrics"]),
        lift=torch.from_numpy(data.get("lift", np.zeros_like(data["clearance"]))),
        clearance=torch.from_numpy(data["clearance"]),
        snug=torch.from_numpy(data["snug"]),
        band=torch.from_numpy(data["band"]),
        bodice=bodice,
        skirt=skirt,
    )


def save_template(template: Template, path: Path) -> None:
    """Write a template to one npz. Raises InputError if it cannot be written."""
    arrays: dict[str, np.ndarray] = {
        "format": np.array(TEMPLATE_FORMAT),
        "faces": smallest_indices(template.faces.numpy()),
        "uvs": template.uvs.numpy().astype(np.float32),
        "face_uvs": smallest_indices(template.face_uvs.numpy()),
        "anchor_faces": smallest_indices(template.anchor_faces.numpy()),
        "anchor_barycentrics": template.anchor_barycentrics.numpy().astype(np.float32),
        "clearance": template.clearance.numpy().astype(np.float32),
        "snug": template.snug.numpy(),
        "band": template.band.numpy(),
    }
    if bool(template.lift.any()):
        arrays["lift"] = template.lift.numpy().astype(np.float32)
    if template.bodice is not None:
        arrays["bodice_edges"] = smallest_indices(template.bodice.edges)
        arrays["bodice_along"] = template.bodice.along.astype(np.float32)
        arrays["bodice_faces"] = smallest_indices(template.bodice.faces)
        arrays["bodice_loop"] = smallest_indices(template.bodice.loop)
    if template.skirt != TEMPLATE_SKIRT:
        arrays["skirt"] = np.array([template.skirt.ease, template.skirt.flare])
    save_arrays(path, arrays)
