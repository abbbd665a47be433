"""Garments from mesh files: read, diagnosed, and attached to a body's rest pose."""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from rasterize.layout import unwrap
from rasterize.raycast import cast_rays, garment_to_body
from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.alignment import UNKNOWN, Known, align, lying
from uvcloth.garments.attach import DIFFUSION, make_garment
from uvcloth.garments.diagnose import Diagnosis, diagnose
from uvcloth.garments.garment import Garment
from uvcloth.garments.judge import UnwearableError
from uvcloth.garments.mhclo import SUFFIX, fit_clothes
from uvcloth.garments.on_character import CharacterFrame
from uvcloth.garments.pose import POSES, REST, arms_held, limbs_held, other_pose, posed_body, unposed
from uvcloth.garments.relaxation import Relaxed, settle
from uvcloth.garments.transfer import transfer
from uvcloth.geometry.authored import AuthoredMesh, follow_triangles
from uvcloth.geometry.mesh import Mesh, vertex_normals, weld
from uvcloth.physics.surface import closest_points

BODY_RAY_LENGTH = 0.3
"""Metres from the garment within which a ray has to meet the body."""

LEAST_LEG_SHARE = 0.15
"""Share of covered body faces on the legs above which a skirt takes the dress's motion."""

LEAST_FOREARM_SHARE = 0.05
"""Share of covered body faces on the forearms above which sleeves are long."""

WAIST_HEIGHT = 0.3
"""Height of the waist, as a fraction of the trunk from crotch to neck."""


LIES_BADLY = 0.09
"""Misfit of an alignment, m, above which it is wrong: garments of other bodies have up to 0.089."""

OFF_LIMBS = 0.005
"""Metres of the misfit for openings that do not go around limbs from which on an alignment is tried too."""

MOST_INSIDE = 0.05
"""Share of the vertices inside the skin from which on too."""

SOME_INSIDE = 0.01
"""Share of them above which a garment is settled where it is."""

BETTER = 0.8
"""Share of the misfit below which the alignment is preferred."""

MOST_STRETCHED = 0.18
"""Share of its length by which 95 % of the edges may differ once a garment is settled."""

FARTHEST_SETTLED = 0.25
"""Metres that a vertex may move until a garment is settled: beyond, it does not lie where it was placed."""

NOWHERE = "the garment lies nowhere on the body as clothes lie"


@dataclass(frozen=True)
class Fitting:
    """Knowledge of the body that a garment file was modelled on, and of where it lies.

    pose: one of POSES, None to find it. known: parts of the alignment. from_body: the mesh of that body, with
    the garment on it. frame: that of the character's file, if the garment lies on it there.
    """

    pose: str | None = None
    known: Known = UNKNOWN
    from_body: Path | None = None
    frame: CharacterFrame | None = None


PLAIN = Fitting()


@dataclass(frozen=True)
class PlacedFile:
    """A garment file on a body at rest; hides: (K,) int64 vertices of the body that it says it hides."""

    mesh: Mesh
    diagnosis: Diagnosis
    hides: Tensor


@dataclass(frozen=True)
class Fitted:
    """A user's garment on a body, and the diagnosis of its file."""

    garment: Garment
    diagnosis: Diagnosis


def fit(path: Path, body: Body, template: str | None = None, how: Fitting = PLAIN) -> Fitted:
    """Fit a file (OBJ, PLY, GLB, STL, MHCLO, ...) to a body, on whose rest pose it was modelled.

    The file's vertex order and texture coordinates stay; unit, axes and origin are found by where it lies
    best (`find_placings`). template: the one of TEMPLATES whose motion it takes;
    None chooses by the part of the body it covers, found by ray casting (PhysXNet section 4.3). The closest
    body vertices give it its blend weights. how: as `read_on_body` takes it. Raises InputError naming the
    file and the reason if it cannot be read or cannot be worn, an UnwearableError if it does not lie as
    clothes lie.
    """
    placed = read_on_body(path, body, how)
    garment, missed = make_fitted(Path(path).stem, placed.mesh, body, template)
    garment = replace(garment, hides=placed.hides)
    return Fitted(garment, replace(placed.diagnosis, ray_misses=missed, template=garment.template or ""))


def read_on_body(path: Path, body: Body, how: Fitting = PLAIN) -> PlacedFile:
    """Read a garment file and place it on a body's rest pose; unwrap it where it has no texture coordinates.

    A mesh file is placed where it lies best, MakeHuman's clothes (.mhclo) where they are bound to; these say
    what skin they hide. how: what is known of the body that a mesh file was modelled on. Raises InputError as
    `fit` does.
    """
    path = Path(path)
    if path.suffix.lower() == SUFFIX:
        mesh, binding = fit_clothes(path, body)
        mesh, diagnosis = diagnose(path, mesh, body, bound=True)
        return _unwrapped(path, mesh, diagnosis, binding.hides(body))
    try:
        return place_on_body(path, read_mesh(path), body, how)
    except UnwearableError as error:
        clothes = path.with_suffix(SUFFIX)
        if not clothes.is_file():
            raise
        raise UnwearableError(f"{error}; use {clothes}, which fits it to any body", error.mesh) from error


def place_on_body(path: Path, mesh: Mesh, body: Body, how: Fitting = PLAIN) -> PlacedFile:
    """Place a mesh on a body's rest pose where it lies best, unwrapped if it has no texture coordinates.

    path: its file, or its name in error messages. how: as `read_on_body` takes it. Raises InputError as that
    does.
    """
    if how.pose is not None and how.pose not in POSES:
        raise InputError(f"--garment-pose {how.pose}: expected one of {', '.join(POSES)}")
    how.known.check()
    if how.from_body is not None:
        placed, diagnosis = _transferred(path, mesh, body, how)
    elif how.known:
        placed, diagnosis = _aligned(path, mesh, body, how)
    elif how.frame is not None:
        placed, diagnosis = _on_character(path, mesh, body, how, how.frame)
    else:
        placed, diagnosis = _usual(path, mesh, body, how)
    return _unwrapped(path, placed, diagnosis, torch.zeros(0, dtype=torch.int64))


def _unwrapped(path: Path, mesh: Mesh, diagnosis: Diagnosis, hides: Tensor) -> PlacedFile:
    mesh = follow_triangles(mesh)
    if isinstance(mesh, AuthoredMesh):
        diagnosis = replace(diagnosis, missing=mesh.polygons.missing)
    if len(mesh.uvs):
        return PlacedFile(mesh, diagnosis, hides)
    uvs, face_uvs = unwrap(mesh.vertices, mesh.faces, str(path))
    return PlacedFile(replace(mesh, uvs=uvs, face_uvs=face_uvs), replace(diagnosis, unwrapped=True), hides)


def _on_character(
    path: Path, mesh: Mesh, body: Body, how: Fitting, frame: CharacterFrame
) -> tuple[Mesh, Diagnosis]:
    """A mesh that lies on a character as its file has it; as `_usual` places it if it does not lie there."""
    posed = frame.posed(body)
    lies = replace(mesh, vertices=frame.to_body(mesh.vertices))
    try:
        there, diagnosis = diagnose(path, lies, posed, bound=True)
    except UnwearableError as error:
        if error.anywhere:
            raise
        at_hips = lies.vertices - posed.skeleton.heads[0] + body.skeleton.heads[0]
        try:
            return _usual(path, replace(lies, vertices=at_hips), body, how)
        except UnwearableError:
            raise error from None
    placed = unposed(there, posed, frame.transforms)
    diagnosis = replace(diagnosis, fitting=("on the character, as its file has it",))
    if diagnosis.inside_share > SOME_INSIDE:
        return _settled(path, placed, diagnosis, body)
    return placed, diagnosis


def _usual(path: Path, mesh: Mesh, body: Body, how: Fitting) -> tuple[Mesh, Diagnosis]:
    """A mesh on the rest pose: in a usual frame of reference if it lies well there, otherwise aligned."""
    try:
        usual = _in_pose(path, mesh, body, how.pose) if how.pose else _in_any_pose(path, mesh, body)
    except UnwearableError as error:
        if error.anywhere:
            raise
        try:
            return _aligned(path, mesh, body, how)
        except UnwearableError as other:
            if not other.lies:
                raise error from None
            reason = str(other).removeprefix(f"{path}: ")
            raise UnwearableError(f"{error}; aligned with it, {reason}", other.mesh) from None
    inside = usual[1].inside_share
    if inside > SOME_INSIDE:
        usual = _settled(path, *usual, body)
    lies = lying(usual[0], body)
    if lies.off_limbs < OFF_LIMBS and inside < MOST_INSIDE:
        return usual
    try:
        aligned = _aligned(path, mesh, body, how)
    except UnwearableError:
        return usual
    return aligned if lying(aligned[0], body).misfit < BETTER * lies.misfit else usual


def _settled(path: Path, mesh: Mesh, diagnosis: Diagnosis, body: Body) -> tuple[Mesh, Diagnosis]:
    """A mesh on the rest pose, but partly in the skin, moved out of it where that does not tear it."""
    settled = settle(mesh.vertices, mesh.faces, mesh.vertices, body)
    if _is_bent(settled):
        return mesh, diagnosis
    placed, after = diagnose(path, replace(mesh, vertices=settled.vertices), body, bound=True)
    return placed, replace(after, pose=diagnosis.pose, fitting=(*diagnosis.way, settled.text()))


def _is_bent(settled: Relaxed) -> bool:
    """Test for a garment that settling would stretch or move too far."""
    return settled.off > MOST_STRETCHED or float(settled.distances.max()) > FARTHEST_SETTLED


def _in_any_pose(path: Path, mesh: Mesh, body: Body) -> tuple[Mesh, Diagnosis]:
    """A mesh that was modelled on the rest pose, or on one of POSES that fits it far better."""
    refusal: UnwearableError | None = None
    try:
        placed, diagnosis = diagnose(path, mesh, body)
    except UnwearableError as error:
        placed, refusal = error.mesh, error
    if pose := other_pose(placed, body):
        return _in_pose(path, mesh, body, pose)
    if refusal:
        raise refusal
    return placed, diagnosis


def _in_pose(path: Path, mesh: Mesh, body: Body, pose: str) -> tuple[Mesh, Diagnosis]:
    """The mesh of a garment modelled on the body in one of POSES, transferred to the rest pose."""
    transforms = arms_held(body, pose)
    posed = posed_body(body, transforms)
    placed, diagnosis = diagnose(path, mesh, posed)
    return unposed(placed, posed, transforms), replace(diagnosis, pose=pose)


def _aligned(path: Path, mesh: Mesh, body: Body, how: Fitting) -> tuple[Mesh, Diagnosis]:
    """A mesh that was modelled on another body, aligned with this one and settled on its rest pose."""
    alignment = align(mesh, body, how.known, None if how.pose is None else POSES[how.pose])
    natural = replace(mesh, vertices=alignment.apply(mesh.vertices))
    if alignment.misfit > LIES_BADLY:
        raise UnwearableError(f"{path}: {NOWHERE}", natural)
    at_rest = natural
    if alignment.stance != REST:
        transforms = limbs_held(body, alignment.stance)
        at_rest = unposed(natural, posed_body(body, transforms), transforms)
    settled = settle(at_rest.vertices, mesh.faces, natural.vertices, body)
    placed, diagnosis = diagnose(path, replace(mesh, vertices=settled.vertices), body, bound=True)
    if _is_bent(settled):
        raise UnwearableError(f"{path}: {NOWHERE}", placed)
    return placed, replace(diagnosis, fitting=(alignment.text(), settled.text()))


def _transferred(path: Path, mesh: Mesh, body: Body, how: Fitting) -> tuple[Mesh, Diagnosis]:
    """A mesh transferred from the body that it was modelled on."""
    assert how.from_body is not None
    transferred = transfer(mesh, how.from_body, body, how.known)
    placed, diagnosis = diagnose(path, transferred.mesh, body, bound=True)
    lines = (f"transferred from {how.from_body}: {transferred.alignment.text()}", transferred.settled.text())
    return placed, replace(diagnosis, fitting=lines)


def make_fitted(name: str, mesh: Mesh, body: Body, template: str | None) -> tuple[Garment, int]:
    """Make a garment of a mesh that lies on a body; returns also how many of its rays missed the body.

    template: as `fit` takes it. Raises InputError for an unknown template.
    """
    if template is not None and template not in DIFFUSION:
        raise InputError(f"{template}: no such template, expected one of {', '.join(DIFFUSION)}")
    skirt = is_skirt(mesh, body)
    faces, missed = covered_faces(mesh, body)
    if template is None:
        template = covering_template(faces, body, skirt)
    diffusion = DIFFUSION["dress"] if skirt else DIFFUSION[template]
    return make_garment(name, mesh, body, diffusion, template=template), int(missed.sum())


def covered_faces(mesh: Mesh, body: Body) -> tuple[Tensor, Tensor]:
    """Body face (N,) under each vertex of a garment at rest, and mask (N,) of vertices whose ray missed.

    A ray runs along each vertex normal, both ways, to the nearest body point within BODY_RAY_LENGTH (PhysXNet
    section 4.3, T^XB); a vertex whose ray misses, or that has no normal, takes the closest surface point.
    """
    owner = weld(mesh.vertices)
    normals = vertex_normals(mesh.vertices, owner[mesh.faces])[owner]
    lonely = normals.norm(dim=1) < 0.5
    normals = torch.where(lonely[:, None], normals.new_tensor([0.0, 0.0, 1.0]), normals)
    hits = garment_to_body(mesh.vertices, normals, body.mesh.vertices, body.mesh.faces, BODY_RAY_LENGTH)
    missed = ~hits.hit | lonely
    nearest = closest_points(mesh.vertices[missed], body.mesh.vertices, body.mesh.faces)
    return hits.face.masked_scatter(missed, nearest.face), missed


def is_skirt(mesh: Mesh, body: Body) -> bool:
    """Test for a skirt: the mesh goes around both legs together, somewhere along the thighs.

    At a few heights a line runs through both thighs, from left to right: a skirt meets it on both outer
    sides and nowhere between the thighs, trousers also there. The lowest line that meets it counts, since
    trousers may have a low crotch.
    """
    thigh = body.regions == REGIONS.index("thigh")
    centres = body.mesh.vertices[body.mesh.faces].mean(1)
    left, right = centres[thigh & (body.sides > 0)], centres[thigh & (body.sides < 0)]
    levels = torch.quantile(left[:, 2], torch.tensor([0.2, 0.4, 0.6]))
    starts = torch.stack([_axis(left, levels), _axis(right, levels)])
    between = starts[1] - starts[0]
    origins = torch.cat([starts[0], starts[1], starts[0]])
    directions = torch.cat([-between, between, between])
    hits = cast_rays(origins, directions, mesh.vertices, mesh.faces, max_distance=1.0, both_ways=False)
    outer_left, outer_right, inner = hits.distance.chunk(3)
    outside = torch.isfinite(outer_left) & torch.isfinite(outer_right)
    lowest = int(outside.int().argmax())
    return bool(outside[lowest] & (inner[lowest] > between[lowest].norm()))


def _axis(centres: Tensor, levels: Tensor) -> Tensor:
    """Centres (L, 3) m of one thigh at some heights (L,), each from the faces within 3 cm."""
    near = ((centres[None, :, 2] - levels[:, None]).abs() < 0.03).to(centres)
    return (near @ centres) / near.sum(1, keepdim=True).clamp(min=1)


def covering_template(covered: Tensor, body: Body, skirt: bool) -> str:
    """Template whose motion serves a garment that covers body faces (N,).

    A skirt without an upper part moves like the dress; what covers trunk and both legs, like the larger.
    """
    legs = torch.isin(body.regions, torch.tensor([REGIONS.index("thigh"), REGIONS.index("calf")]))
    heights = body.mesh.vertices[body.mesh.faces].mean(1)[:, 2]
    trunk = body.regions == REGIONS.index("torso")
    lowest, highest = heights[trunk].aminmax()
    hips = trunk & (heights < lowest + WAIST_HEIGHT * (highest - lowest))
    below = (legs | hips)[covered]
    if skirt and float(legs[covered].float().mean()) > LEAST_LEG_SHARE:
        return "dress"
    if float(below.float().mean()) > 0.5:
        return "bottoms"
    forearms = body.regions == REGIONS.index("forearm")
    return "shirt" if float(forearms[covered].float().mean()) > LEAST_FOREARM_SHARE else "tops"
