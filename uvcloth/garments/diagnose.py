"""Diagnosis of a user's garment mesh: units, axes, topology, and its place on the body."""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh, face_normals, weld
from uvcloth.physics.surface import BodySurface, SurfacePoints

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001}
"""Metres in one unit of a file."""

Y_UP = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation from Y up, facing +Z, to Z up, facing -Y."""

SMALLEST, LARGEST = 0.12, 1.2
"""Diagonals of what can be a garment, in body diagonals: a decade, so that only one unit fits a size."""

MAX_BODY_DISTANCE = 0.3
"""Metres from the body to the nearest and to the mean vertex beyond which a garment is not worn."""

ENGULFED_SHARE = 0.95
"""Share of vertices inside the body above which a garment counts as wholly inside it."""

REST_SEARCH_DISTANCE = 10.0
"""Metres within which the closest body point is sought at rest."""


@dataclass(frozen=True)
class Diagnosis:
    """Findings about a garment file; counts of faces that were dropped or turned are of the file's triangles.

    unit: of the file. up: its up axis, "Y" or "Z". components: pieces, UV seams taken as joined.
    inside_share: fraction of vertices inside the body. mean_distance, max_distance: metres to the skin.
    ray_misses: vertices whose ray misses the body, so that the closest point says what part they cover.
    unwrapped: whether texture coordinates were made.
    """

    path: Path
    vertices: int
    faces: int
    unit: str
    up: str
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

    def lines(self) -> list[str]:
        """Text of the diagnosis, one finding a line; what is as expected is left out."""
        turned = "" if (self.unit, self.up) == ("m", "Z") else ", converted to metres, Z up"
        pieces = "1 piece" if self.components == 1 else f"{self.components} separate pieces"
        found = [
            f"{self.path}: {self.vertices} vertices, {self.faces} triangles, {pieces}",
            f"  unit {self.unit}, {self.up} up{turned}",
            f"  {1000 * self.mean_distance:.1f} mm from the skin on average, at most "
            f"{1000 * self.max_distance:.0f} mm; {100 * self.inside_share:.1f} % of the vertices inside it",
        ]
        for count, finding in (
            (self.duplicate_faces, "duplicate faces, dropped"),
            (self.degenerate_faces, "faces with two corners at one place, dropped"),
            (self.double_sided_faces, "double-sided faces, one side dropped"),
            (self.flipped_faces, "flipped faces, turned outside out"),
            (self.ray_misses, "vertices whose ray misses the body, taken to cover its closest point"),
        ):
            if count:
                found.append(f"  {count} {finding}")
        if self.unwrapped:
            found.append("  no texture coordinates, unwrapped")
        if self.template:
            found.append(f"  worn as {self.template}")
        return found


def diagnose(path: Path, mesh: Mesh, body: Body) -> tuple[Mesh, Diagnosis]:
    """Examine a mesh as read from a file; returns it in metres and Z up, every face once and facing outward.

    Raises InputError naming the path and the reason if it cannot be worn: its size fits in no unit, it is
    far from the body or wholly inside it, or an edge has more than two faces.
    """
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    unit, up, vertices = _placed(path, mesh.vertices, body, surface)
    skin = surface.closest(vertices, REST_SEARCH_DISTANCE)
    _refuse_unworn(path, skin.signed_distance)
    owner = weld(vertices)
    degenerate, duplicate, reverse = _repeated(owner[mesh.faces])
    keep = ~(degenerate | duplicate | reverse)
    if not bool(keep.any()):
        raise InputError(f"{path}: the garment is empty, none of its {len(mesh.faces)} faces has an area")
    textured = len(mesh.uvs) > 0
    kept = Mesh(vertices, mesh.faces[keep], mesh.uvs, mesh.face_uvs[keep] if textured else mesh.face_uvs)
    components, flipped = _orientation(path, kept, owner[kept.faces], skin)
    faces = torch.where(flipped[:, None], kept.faces.flip(1), kept.faces)
    face_uvs = (
        torch.where(flipped[:, None], kept.face_uvs.flip(1), kept.face_uvs) if textured else kept.face_uvs
    )
    diagnosis = Diagnosis(
        path=path,
        vertices=len(vertices),
        faces=len(mesh.faces),
        unit=unit,
        up=up,
        components=components,
        duplicate_faces=int(duplicate.sum()),
        degenerate_faces=int(degenerate.sum()),
        double_sided_faces=int(reverse.sum()),
        flipped_faces=int(flipped.sum()),
        inside_share=float((skin.signed_distance < 0).float().mean()),
        mean_distance=float(skin.signed_distance.abs().mean()),
        max_distance=float(skin.signed_distance.abs().max()),
    )
    return replace(kept, faces=faces, face_uvs=face_uvs), diagnosis


def _placed(path: Path, points: Tensor, body: Body, surface: BodySurface) -> tuple[str, str, Tensor]:
    """Unit, up axis and vertices (N, 3) in metres, Z up: by size and by nearness to the skin."""
    diagonal = float((points.amax(0) - points.amin(0)).norm())
    tallest = float((body.mesh.vertices.amax(0) - body.mesh.vertices.amin(0)).norm())
    sizes = {unit: diagonal * metres / tallest for unit, metres in UNITS.items()}
    unit = next((unit for unit, size in sizes.items() if SMALLEST <= size < LARGEST), None)
    if unit is None:
        wrong = "large" if sizes["mm"] >= LARGEST else "small"
        raise InputError(
            f"{path}: the garment is {diagonal:.3g} units across, too {wrong} for a body of {tallest:.1f} m "
            "whether a unit is a metre, decimetre, centimetre or millimetre"
        )
    placed = {
        up: (points * UNITS[unit] @ axes.to(points).T).float()
        for up, axes in (("Z", torch.eye(3)), ("Y", Y_UP))
    }
    sample = torch.linspace(0, len(points) - 1, min(len(points), 1000)).long()
    up = min(placed, key=lambda axis: _misfit(placed[axis][sample], surface))
    return unit, up, placed[up]


def _misfit(points: Tensor, surface: BodySurface) -> float:
    """Mean distance to the skin, metres, a vertex inside counting more: cloth is worn outside."""
    distance = surface.closest(points, REST_SEARCH_DISTANCE).signed_distance
    return float(torch.where(distance < 0, -3 * distance, distance).mean())


def _refuse_unworn(path: Path, distance: Tensor) -> None:
    if float((distance < 0).float().mean()) > ENGULFED_SHARE:
        raise InputError(f"{path}: the garment is wholly inside the body, not worn over it")
    if float(distance.abs().min()) > MAX_BODY_DISTANCE or float(distance.abs().mean()) > MAX_BODY_DISTANCE:
        raise InputError(
            f"{path}: the garment is far from the body, {float(distance.abs().mean()):.2f} m on average: "
            "it has to be worn on the body's rest pose"
        )


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
    edges, edge, faces = torch.unique(
        directed.sort(dim=1).values, dim=0, return_inverse=True, return_counts=True
    )
    worst = int(faces.argmax())
    if int(faces[worst]) > 2:
        a, b = edges[worst].tolist()
        raise InputError(
            f"{path}: the garment is not manifold, {int((faces > 2).sum())} edges have more than two faces "
            f"(the edge between vertices {a} and {b} has {int(faces[worst])})"
        )
    order = torch.argsort(edge, stable=True)
    first = torch.nonzero(edge[order][1:] == edge[order][:-1]).squeeze(1)
    one, other = order[first], order[first + 1]
    return one % len(welded), other % len(welded), directed[one, 0] != directed[other, 0]
