"""Diagnosis of a user's garment mesh: units, axes, topology, and its place on the body."""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.judge import UnwearableError, refuse_unworn
from uvcloth.garments.placing import SEARCH_DISTANCE, Placing, find_placings
from uvcloth.geometry.mesh import Mesh, edge_keys, face_normals, weld
from uvcloth.physics.surface import BodySurface, SurfacePoints


@dataclass(frozen=True)
class Diagnosis:
    """Findings about a garment file; counts of faces that were dropped or turned are of the file's triangles.

    placing: of the file's frame in the body's, None where it is bound to the body or `fitting` says how it
    came there, line by line. components: pieces, UV
    seams taken as joined. inside_share: fraction of vertices inside the body. mean_distance, max_distance:
    metres to the skin. ray_misses: vertices whose ray misses the body, which count as covering their closest
    point. unwrapped: whether texture coordinates were made. missing: material and picture files that it names
    but that do not exist. pose: the one that the garment was modelled in, "" for the rest pose; distances are
    from the body in that pose.
    """

    path: Path
    vertices: int
    faces: int
    placing: Placing | None
    components: int
    duplicate_faces: int
    degenerate_faces: int
    double_sided_faces: int
    flipped_faces: int
    inside_share: float
    mean_distance: float
    max_distance: float
    ray_misses: int = 0
    unwrapped: bool = False
    template: str = ""
    missing: tuple[str, ...] = ()
    pose: str = ""
    fitting: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Text of the diagnosis, one line per finding; expected properties are left out."""
        pieces = "1 piece" if self.components == 1 else f"{self.components} separate pieces"
        faults = [
            f"{self.path}: {self.vertices} vertices, {self.faces} triangles, {pieces}",
            *(f"  {line}" for line in self.way),
            f"  {1000 * self.mean_distance:.1f} mm from the skin on average, at most "
            f"{1000 * self.max_distance:.0f} mm; {100 * self.inside_share:.1f} % of the vertices inside it",
        ]
        for count, finding in (
            (self.duplicate_faces, "duplicate faces, dropped"),
            (self.degenerate_faces, "faces with two corners at one place, dropped"),
            (self.double_sided_faces, "double-sided faces, one side dropped"),
            (self.flipped_faces, "flipped faces, corrected"),
            (self.ray_misses, "vertices whose ray misses the body, taken to cover its closest point"),
        ):
            if count:
                faults.append(f"  {count} {finding}")
        if self.unwrapped:
            faults.append("  no texture coordinates, unwrapped")
        if self.missing:
            faults.append(
                f"  missing files, so colours may be wrong: {', '.join(dict.fromkeys(self.missing))}"
            )
        if self.pose:
            faults.append(f"  modelled in {self.pose.upper()} pose, transferred to the body's rest pose")
        if self.template:
            faults.append(f"  worn as {self.template}")
        return faults

    @property
    def way(self) -> tuple[str, ...]:
        """Lines that say how the garment came to lie on the body."""
        if self.fitting:
            return self.fitting
        return (self.placing.text() if self.placing else "bound to the body, whatever its shape",)


def diagnose(path: Path, mesh: Mesh, body: Body, bound: bool = False) -> tuple[Mesh, Diagnosis]:
    """Examine a mesh as read from a file; returns it in metres and Z up, every face once and facing outward.

    bound: the mesh is in the body's frame already, and stays there. Raises InputError naming the path and the
    reason if it cannot be worn: its size fits in no unit, an edge has more than two faces, or it does not lie
    on the body as clothes lie (then an UnwearableError).
    """
    kept, repeated = _without_repeats(path, mesh)
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    if bound:
        return _diagnosed(path, mesh, kept, repeated, None, body, surface)
    *others, likeliest = find_placings(path, kept.vertices, kept.faces, body, surface)
    for placing in others:
        with suppress(UnwearableError):
            return _diagnosed(path, mesh, kept, repeated, placing, body, surface)
    return _diagnosed(path, mesh, kept, repeated, likeliest, body, surface)


def _diagnosed(
    path: Path,
    mesh: Mesh,
    kept: Mesh,
    repeated: tuple[int, int, int],
    placing: Placing | None,
    body: Body,
    surface: BodySurface,
) -> tuple[Mesh, Diagnosis]:
    """Diagnose a mesh in one placing, None for the body's frame; kept: what `_without_repeats` kept of it."""
    vertices = placing.apply(kept.vertices, body) if placing else kept.vertices
    kept = replace(kept, vertices=vertices)
    skin = surface.closest(vertices, SEARCH_DISTANCE)
    welded = weld(vertices)[kept.faces]
    components, flipped = _orientation(path, kept, welded, skin)
    faces = torch.where(flipped[:, None], kept.faces.flip(1), kept.faces)
    face_uvs = torch.where(flipped[: len(kept.face_uvs), None], kept.face_uvs.flip(1), kept.face_uvs)
    turned = replace(kept, faces=faces, face_uvs=face_uvs)
    refuse_unworn(path, turned, welded, body, surface)
    degenerate, duplicate, reverse = repeated
    diagnosis = Diagnosis(
        path=path,
        vertices=len(vertices),
        faces=len(mesh.faces),
        placing=placing,
        components=components,
        duplicate_faces=duplicate,
        degenerate_faces=degenerate,
        double_sided_faces=reverse,
        flipped_faces=int(flipped.sum()),
        inside_share=float((skin.signed_distance < 0).float().mean()),
        mean_distance=float(skin.signed_distance.abs().mean()),
        max_distance=float(skin.signed_distance.abs().max()),
    )
    return turned, diagnosis


def _without_repeats(path: Path, mesh: Mesh) -> tuple[Mesh, tuple[int, int, int]]:
    """Drop the faces that `_repeated` finds; returns also how many of each kind there were."""
    repeated = _repeated(weld(mesh.vertices)[mesh.faces])
    keep = ~torch.stack(repeated).any(dim=0)
    if not bool(face_normals(mesh.vertices, mesh.faces[keep]).any()):
        raise InputError(f"{path}: the garment is empty, none of its {len(mesh.faces)} faces has an area")
    face_uvs = mesh.face_uvs[keep] if len(mesh.uvs) else mesh.face_uvs
    degenerate, duplicate, reverse = (int(each.sum()) for each in repeated)
    return replace(mesh, faces=mesh.faces[keep], face_uvs=face_uvs), (degenerate, duplicate, reverse)


def _repeated(faces: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Masks (F,) of the faces (F, 3) that have two equal corners, repeat an earlier face, or are its back."""
    ordered = faces.sort(dim=1).values
    degenerate = (ordered[:, 1:] == ordered[:, :-1]).any(dim=1)
    turn = faces.argmin(dim=1)[:, None] + torch.arange(3)
    started = faces.gather(1, turn % 3)
    order = torch.arange(len(faces))
    duplicate = (weld(started) != order) & ~degenerate
    reverse = (weld(ordered) != order) & ~duplicate & ~degenerate
    return degenerate, duplicate, reverse


def _orientation(path: Path, mesh: Mesh, welded: Tensor, skin: SurfacePoints) -> tuple[int, Tensor]:
    """Number of pieces, and mask (F,) of the faces to turn so that each piece faces away from the body.

    Every face appears twice in a graph, as it is and turned; neighbours that agree link equal states. The
    two states of an orientable piece then fall apart into two components.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(welded)
    one, other, agree = _neighbours(path, welded)
    across = torch.where(agree, other, other + count)
    back = torch.where(agree, other + count, other)
    rows, cols = torch.cat([one, one + count]), torch.cat([across, back])
    graph = coo_array((torch.ones(len(rows)).numpy(), (rows.numpy(), cols.numpy())), shape=(2 * count,) * 2)
    label = torch.from_numpy(connected_components(graph, directed=False)[1]).long()
    as_is, turned = label[:count], label[count:]
    piece = torch.minimum(as_is, turned)
    flipped = as_is != piece
    normals = face_normals(mesh.vertices, mesh.faces)
    outward = (normals * skin.normals[mesh.faces].mean(1)).sum(1) * torch.where(flipped, -1.0, 1.0)
    facing = torch.zeros(int(label.max()) + 1).index_add(0, piece, outward)
    return len(torch.unique(piece)), flipped ^ (facing[piece] < 0)


def _neighbours(path: Path, welded: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Pairs of faces at each inner edge, and whether they agree, running along it in opposite directions."""
    directed = torch.cat([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]])
    _, edge, faces = torch.unique(edge_keys(directed), return_inverse=True, return_counts=True)
    worst = int(faces.argmax())
    if int(faces[worst]) > 2:
        a, b = sorted(directed[edge == worst][0].tolist())
        raise InputError(
            f"{path}: the garment is not manifold, {int((faces > 2).sum())} edges have more than two faces "
            f"(the edge between vertices {a} and {b} has {int(faces[worst])})"
        )
    order = torch.argsort(edge, stable=True)
    first = torch.nonzero(edge[order][1:] == edge[order][:-1]).squeeze(1)
    one, other = order[first], order[first + 1]
    return one % len(welded), other % len(welded), directed[one, 0] != directed[other, 0]
