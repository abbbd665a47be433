"""OpenUSD: garments as points over time, the body as a UsdSkel skeleton with all of its blend weights."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from uvcloth.bodies.body import BODY_INFLUENCES
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skinning import strongest
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS
from uvcloth.writers.animation import Animation
from uvcloth.writers.usd_materials import add_subsets
from uvcloth.writers.usd_stage import (
    SavedInParts,
    add_skeleton,
    animate_skeleton,
    bind,
    define_mesh,
    identifiers,
    rest_geometry,
    writing,
)


def write_usd(animation: Animation, path: Path) -> None:
    """Write a binary USD stage: metres, Z up, time codes are frames from 0 on.

    Raises OSError if it cannot be written, and InputError if a texture cannot.
    """
    from pxr import UsdGeom, UsdSkel

    with writing(path, animation.fps, len(animation)) as stage:
        root = UsdGeom.Xform.Define(stage, "/Outfit")
        stage.SetDefaultPrim(root.GetPrim())
        for index, identifier in enumerate(identifiers(animation.names)):
            geometry = _write_garment(stage, animation, index, f"/Outfit/{identifier}")
            # Two garments may have textures of one name.
            garment_path = path.with_stem(f"{path.stem}_{identifier}")
            add_subsets(stage, geometry, animation.meshes[index], garment_path)
        if body := animation.body:
            UsdSkel.Root.Define(stage, "/Outfit/body")
            skeleton = add_skeleton(stage, "/Outfit/body/skeleton", body.skeleton)
            animate_skeleton(stage, skeleton, body.skeleton, animation.transforms)
            geometry = define_mesh(stage, "/Outfit/body/mesh", body.mesh, BODY_COLOR)
            rest_geometry(geometry, body.mesh)
            bind(geometry, skeleton, *strongest(body.weights, BODY_INFLUENCES))
            add_subsets(stage, geometry, body.mesh, path.with_stem(f"{path.stem}_body"))


def _write_garment(stage: Any, animation: Animation, index: int, prim: str) -> Any:
    from pxr import UsdGeom, Vt

    mesh, vertices = animation.meshes[index], animation.vertices[index]
    geometry = define_mesh(stage, prim, mesh, GARMENT_COLORS[index % len(GARMENT_COLORS)])
    points, extent = geometry.GetPointsAttr(), geometry.GetExtentAttr()
    normals = geometry.GetNormalsAttr()
    geometry.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    samples = SavedInParts(stage)
    for frames in animation.chunks():
        positions = np.array(vertices[frames])
        turned = vertex_normals(torch.from_numpy(positions), mesh.faces).numpy()
        bounds = np.stack([positions.min(1), positions.max(1)], axis=1)
        for offset, frame in enumerate(range(frames.start, frames.stop)):
            points.Set(Vt.Vec3fArray.FromNumpy(positions[offset]), frame)
            normals.Set(Vt.Vec3fArray.FromNumpy(turned[offset]), frame)
            extent.Set(Vt.Vec3fArray.FromNumpy(bounds[offset]), frame)
        samples.add(positions.nbytes + turned.nbytes + bounds.nbytes)
    return geometry
