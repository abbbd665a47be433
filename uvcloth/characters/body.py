"""Bodies from characters: the surface of the default body fitted to the character's shape, and its meshes.

Cloth, maps and methods use a closed surface with the mesh that all bodies share. It fits the character, has
its blend weights, and brings along the proxies and the base mesh that garments are bound to. Only the
character's own meshes are visible.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.layout import unwrap
from rasterize.raycast import closest_points
from uvcloth.bodies.body import REGIONS, Appearance, Body, Proxy
from uvcloth.bodies.stature import stature
from uvcloth.characters.enclosed import without_enclosed
from uvcloth.characters.look import polygons_of_parts
from uvcloth.characters.parts import Sorted, is_clothing, sort_parts
from uvcloth.characters.props import split_props
from uvcloth.characters.reader import Part, read_character
from uvcloth.characters.registration import lifted, limbs_of, match, register
from uvcloth.characters.rig import RiggedCharacter, rig_character
from uvcloth.characters.shape import POINTS, SkinnedSurface, region_of, rough_fit
from uvcloth.errors import InputError
from uvcloth.formats.gltf_mesh import read_materials
from uvcloth.geometry.authored import AuthoredMesh, UvSet, polygons_of
from uvcloth.geometry.mesh import Mesh, face_normals, join_meshes, neighbour_average, unit_face_normals
from uvcloth.geometry.skinning import diffuse_weights, skin
from uvcloth.physics.surface import BodySurface

CLOTHED = ("torso", "upper_arm", "forearm", "thigh", "calf")
"""Regions that cloth lies on, where the surface has to match the character's."""

OUTLYING = 0.012
"""Distance, over the body's height, up to which a vertex of the character lifts the surface below it."""

FARTHEST = 0.02
"""Distance from the character, over its height, beyond which a vertex has no counterpart on it."""

MOST_OUT = 0.15
"""Greatest share of a region that may stand FARTHEST out of the surface: cloth would not cover it."""

HIDDEN = 0.05
"""Least share of a region without a counterpart that the report names."""

DIFFUSION = 0.01
"""Metres over which the character's weights are smoothed."""

NEIGHBOURS, SOFTENING = 12, 0.005
"""Nearest vertices whose displacements move a point, and metres that soften their inverse-square weights."""

MOST_LISTED = 4
"""Pictures that are named where some are left out."""

EASE_TURNS, EASE_REACH = 6, 0.05
"""Iterations that restore a shell's distances from the skin, and metres up to which these are restored."""


@dataclass(frozen=True)
class CharacterBody:
    """A body made from a character, and how well it fits.

    off: (V,) m from each vertex of its surface to the character's, at least FARTHEST times the height where
    the vertex has no counterpart.
    """

    body: Body
    rigged: RiggedCharacter
    parts: Sorted
    off: Tensor

    def lines(self) -> list[str]:
        """Report of the meshes and of how well the surface fits, line by line."""
        appearance = self.body.appearance
        missing = dict.fromkeys(polygons_of(appearance.mesh).missing if appearance else ())
        far = FARTHEST * stature(self.body)
        off = self.off[region_vertices(self.body, CLOTHED)]
        near = 1000.0 * off[off < far]
        return [
            f"{self.rigged.name}: {len(self.rigged.roles)} joints with a role, unit {self.rigged.unit}; "
            f"limbs are turned by up to {self.rigged.turned:.0f} degrees to the rest pose of our bodies",
            *self.parts.lines(),
            f"  {len(appearance.mesh.vertices) if appearance else 0} vertices are shown; cloth collides with "
            f"a closed surface of {len(self.off)} vertices; its distance from the character's on trunk "
            f"and limbs: median {near.median():.1f} mm, 95 % below {near.quantile(0.95):.1f} mm",
            *(
                f"  {100 * share:.0f} % of the {region.replace('_', ' ')} has nothing of the character near "
                "it: our shape, at the lengths of its bones, stands in there"
                for region in CLOTHED
                if (share := self._hidden(region, far)) > HIDDEN
            ),
            *([f"  left out: {_listed(missing)}"] if missing else []),
        ]

    def _hidden(self, region: str, far: float) -> float:
        """Share of a region's vertices without a counterpart, which is as far away as that."""
        return float((self.off[region_vertices(self.body, (region,))] >= far).float().mean())


def _listed(names: Iterable[str]) -> str:
    """The first names, and how many more there are."""
    names = list(names)
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more


def body_from_character(
    path: Path,
    pattern: Body,
    joints: Mapping[str, str] | None = None,
    keep: Iterable[str] = (),
    drop: Iterable[str] = (),
    unit: str | None = None,
) -> CharacterBody:
    """Make a body from a rigged character in a glTF file.

    pattern: the body whose surface is fitted, with its proxies and base mesh. joints: joint names by role.
    keep, drop: as in `sort_parts`. unit: as in `rig_character`. Raises InputError naming the file as
    `read_character`, `rig_character` and `sort_parts` do, and if the surface does not fit the character.
    """
    character = read_character(path)
    try:
        rigged = rig_character(character, joints or {}, pattern, unit)
        parts = sort_parts(rigged.parts, rigged.skeleton.names, keep, drop)
        surface, props = split_props(parts.surface, rigged.skeleton)
        parts = replace(parts, surface=surface, props=props)
        target = without_enclosed(_joined(parts.surface))
        rough = rough_fit(pattern, rigged.skeleton, target)
        fitted, off = _fitted(pattern, rough, target, rigged)
        body = replace(
            pattern,
            name=character.name,
            mesh=replace(pattern.mesh, vertices=fitted.vertices),
            skeleton=rigged.skeleton,
            weights=fitted.weights,
        )
        _refuse_unfit(body, _joined([part for part in surface if not is_clothing(part)] or surface))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    deformation = _Deformation(pattern, rough, body)
    proxies = {
        name: replace(proxy, vertices=deformation.shell(proxy)) for name, proxy in pattern.proxies.items()
    }
    base = None if pattern.base is None else deformation.points(pattern.base, _nearest_weights(pattern))
    appearance = _appearance(path, (*parts.surface, *parts.props, *parts.visible))
    return CharacterBody(replace(body, proxies=proxies, base=base, appearance=appearance), rigged, parts, off)


def region_vertices(body: Body, regions: Iterable[str]) -> Tensor:
    """Vertices (K,) of some regions of a body."""
    wanted = torch.tensor([REGIONS.index(region) for region in regions])
    return body.mesh.faces[torch.isin(body.regions, wanted)].unique()


def _joined(parts: Iterable[Part]) -> SkinnedSurface:
    parts = tuple(parts)
    joined = join_meshes((part.mesh.vertices, part.mesh.faces) for part in parts)
    return SkinnedSurface(joined.vertices, joined.faces, torch.cat([part.weights for part in parts]))


def _fitted(
    pattern: Body, rough: Tensor, target: SkinnedSurface, rigged: RiggedCharacter
) -> tuple[SkinnedSurface, Tensor]:
    """The pattern's surface fitted to the target, with its weights, and each vertex's distance (V,) m."""
    limbs = limbs_of(rigged.skeleton.names)
    start = SkinnedSurface(
        skin(pattern.mesh.vertices, pattern.weights, rough[None])[0], pattern.mesh.faces, pattern.weights
    )
    vertices = register(start, target, limbs)
    height = float(vertices[:, 2].max() - vertices[:, 2].min())
    placed = replace(start, vertices=vertices)
    clothed = torch.isin(_strongest_region(pattern, vertices, target), _region_numbers(CLOTHED))
    placed = replace(placed, vertices=lifted(placed, target.vertices[clothed], OUTLYING * height))
    matches = match(placed, target, limbs, FARTHEST * height)
    weights = diffuse_weights(matches.weights, placed.vertices, placed.faces, DIFFUSION)
    off = closest_points(placed.vertices, target.vertices, target.faces).distance
    off = torch.where(matches.hit, off, off.clamp(min=FARTHEST * height))
    return replace(placed, weights=weights), off


def _strongest_region(pattern: Body, vertices: Tensor, target: SkinnedSurface) -> Tensor:
    """Closest region (P,) of the pattern, with vertices (V, 3) m, to each vertex of the target."""
    return pattern.regions[closest_points(target.vertices, vertices, pattern.mesh.faces).face]


def _region_numbers(regions: Iterable[str]) -> Tensor:
    return torch.tensor([REGIONS.index(region) for region in regions])


def _refuse_unfit(body: Body, skin: SkinnedSurface) -> None:
    """Raise InputError naming a region where too much of the character's skin stands out of the surface."""
    far = FARTHEST * stature(body)
    points, moved_by = skin.sample(POINTS)
    closest = closest_points(points, body.mesh.vertices, body.mesh.faces)
    outwards = unit_face_normals(body.mesh.vertices, body.mesh.faces)[closest.face]
    away = points - gather(body.mesh.vertices, body.mesh.faces[closest.face], closest.barycentrics)
    out = ((away * outwards).sum(1) > 0) & (closest.distance > far)
    areas, of_skin = (face_normals(each.vertices, each.faces).norm(dim=1) for each in (body.mesh, skin))
    for region in CLOTHED:
        number = REGIONS.index(region)
        joints = torch.tensor([region_of(name) == region for name in body.skeleton.names])
        there = (joints[moved_by] & out).float().mean() * of_skin.sum()
        share = float(there / areas[body.regions == number].sum())
        if share > MOST_OUT:
            raise InputError(
                f"{100 * share:.0f} % of the {region.replace('_', ' ')} stands more than {1000 * far:.0f} mm "
                "out of the surface that cloth would lie on: joints may be taken for others (--joints), or "
                "its proportions are too far from a person's"
            )


class _Deformation:
    """Deformation from the pattern to the body, for points around the surface."""

    def __init__(self, pattern: Body, rough: Tensor, body: Body) -> None:
        from scipy.spatial import KDTree

        self._pattern, self._rough, self._body = pattern, rough, body
        start = skin(pattern.mesh.vertices, pattern.weights, rough[None])[0]
        self._displacement = body.mesh.vertices - start
        self._tree = KDTree(pattern.mesh.vertices.numpy())

    def points(self, points: Tensor, weights: Tensor) -> Tensor:
        """Move points (P, 3) m with blend weights (P, J) from around the pattern to around the character."""
        distance, nearest = self._tree.query(points.numpy(), k=NEIGHBOURS)
        share = 1.0 / (torch.from_numpy(distance).float() ** 2 + SOFTENING**2)
        share = share / share.sum(1, keepdim=True)
        displacement = (share[..., None] * self._displacement[torch.from_numpy(nearest)]).sum(1)
        return skin(points, weights, self._rough[None])[0] + displacement

    def shell(self, proxy: Proxy) -> Tensor:
        """Vertices (P, 3) m of a shell as far from the character's skin as the proxy from the pattern's."""
        before = BodySurface(self._pattern.mesh.vertices, self._pattern.mesh.faces)
        after = BodySurface(self._body.mesh.vertices, self._body.mesh.faces)
        wanted = before.closest(proxy.vertices).signed_distance
        held = (wanted < EASE_REACH)[:, None]
        average = neighbour_average(proxy.faces, len(proxy.vertices))
        vertices = self.points(proxy.vertices, proxy.weights)
        for _ in range(EASE_TURNS):
            skin_there = after.closest(vertices)
            move = held * (wanted - skin_there.signed_distance)[:, None] * skin_there.normals
            vertices = vertices + 0.5 * (move + average @ move)
        return vertices


def _nearest_weights(pattern: Body) -> Tensor:
    """Weights (B, J) of the base mesh: those of the closest vertex of the skin."""
    from scipy.spatial import KDTree

    assert pattern.base is not None
    _, nearest = KDTree(pattern.mesh.vertices.numpy()).query(pattern.base.numpy())
    return pattern.weights[torch.from_numpy(nearest)]


def _appearance(path: Path, parts: Sequence[Part]) -> Appearance:
    """All visible meshes as one; parts without texture coordinates are unwrapped."""
    meshes = [_with_uvs(path, part) for part in parts]
    joined = join_meshes((mesh.vertices, mesh.faces) for mesh in meshes)
    textured = join_meshes((mesh.uvs, mesh.face_uvs) for mesh in meshes)
    uv_set = UvSet(textured.vertices.numpy().astype(np.float32), textured.faces.numpy().reshape(-1))
    materials, missing = read_materials(path)
    named = {material.name: material for material in materials}
    polygons = polygons_of_parts("body", parts, joined.faces.numpy(), (uv_set,), named)
    weights = torch.cat([part.weights for part in parts])
    return Appearance(AuthoredMesh.of(joined.vertices, replace(polygons, missing=missing)), weights)


def _with_uvs(path: Path, part: Part) -> Mesh:
    if len(part.mesh.uvs):
        return part.mesh
    uvs, face_uvs = unwrap(part.mesh.vertices, part.mesh.faces, f"{path}: {part.name}")
    return replace(part.mesh, uvs=uvs, face_uvs=face_uvs)
